"""Kernels of the published DR-RRT* (Dillard, NPS 2014, App. C); see ``docs/dr_rrt_star.md``.

The tree is a set of parallel arrays; nearest nodes come from buckets on a square grid, and
costs are passed to a node's descendants along child lists, so that no iteration scans the tree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.hdop import bearing_hdop
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.physics.vehicle import drift_step, inside_box
from baselines.plan import DRIFT, HOP

#: Settings of the source. Distances m, times s.
NEAREST = 5
GOAL_PROBABILITY = 0.05
REWIRE_RADIUS_M = 2500.0
LEAST_RANGE_RATE_M_S = 0.1
PATIENCE = 10
STEP_S = 60.0
K_HDOP, K_DISTANCE, K_FLIGHT, K_SOLAR = 0.0225, 0.0225, 0.95, 0.005
MAX_HDOP = 9000.0

BUCKETS = 48


class Tree(NamedTuple):
    """Nodes as parallel arrays; a node's edge comes from its parent."""

    x: np.ndarray
    y: np.ndarray
    cost: np.ndarray
    parent: np.ndarray
    hop: np.ndarray  # 1: reached by flight
    first_child: np.ndarray
    next_sibling: np.ndarray
    bucket: np.ndarray  # (BUCKETS, BUCKETS) newest node of each bucket, -1: none
    bucket_next: np.ndarray

    @staticmethod
    def allocate(iterations: int) -> Tree:
        """Room for every node that ``iterations`` can add: a drift each and a hop every tenth."""
        size = iterations + iterations // PATIENCE + 2
        return Tree(
            np.empty(size), np.empty(size), np.empty(size), np.empty(size, np.int64), np.empty(size, np.uint8),
            np.empty(size, np.int64), np.empty(size, np.int64), np.full((BUCKETS, BUCKETS), -1, np.int64),
            np.empty(size, np.int64),
        )  # fmt: skip


class Mission(NamedTuple):
    """A problem as the published kernels read it (m, s)."""

    velocity: np.ndarray
    field: int
    axes: tuple
    clearance: np.ndarray
    layer: int
    grid: tuple
    time: float
    half_width: float
    goal_x: float
    goal_y: float
    goal_radius: float
    max_hop: float
    airspeed: float
    team: np.ndarray
    target_x: float
    target_y: float


@kernel
def _bucket_of(m, x, y):
    scale = BUCKETS / (2.0 * m.half_width)
    column = min(max(int((x + m.half_width) * scale), 0), BUCKETS - 1)
    row = min(max(int((y + m.half_width) * scale), 0), BUCKETS - 1)
    return row, column


@loop_kernel
def _add(tree, m, count, x, y, parent, cost, hop):
    tree.x[count] = x
    tree.y[count] = y
    tree.cost[count] = cost
    tree.parent[count] = parent
    tree.hop[count] = hop
    tree.first_child[count] = -1
    tree.next_sibling[count] = -1
    if parent != count:
        tree.next_sibling[count] = tree.first_child[parent]
        tree.first_child[parent] = count
    row, column = _bucket_of(m, x, y)
    tree.bucket_next[count] = tree.bucket[row, column]
    tree.bucket[row, column] = count


@loop_kernel
def _nearest(tree, m, x, y, skip, found, squared):
    """The up to NEAREST nodes nearest to (x, y), nearest first, without node ``skip``; returns how many."""
    n = 0
    row0, column0 = _bucket_of(m, x, y)
    cell = 2.0 * m.half_width / BUCKETS
    for ring in range(BUCKETS):
        # Every node of this ring and beyond is at least (ring - 1) cells away.
        bound = (ring - 1) * cell
        if n == NEAREST and ring > 0 and squared[NEAREST - 1] <= bound * bound:
            break
        for row in range(max(row0 - ring, 0), min(row0 + ring, BUCKETS - 1) + 1):
            edge = row == row0 - ring or row == row0 + ring
            for column in range(column0 - ring, column0 + ring + 1, 1 if edge or ring == 0 else 2 * ring):
                if column < 0 or column >= BUCKETS:
                    continue
                node = tree.bucket[row, column]
                while node >= 0:
                    dx = tree.x[node] - x
                    dy = tree.y[node] - y
                    d2 = dx * dx + dy * dy
                    if node != skip and (n < NEAREST or d2 < squared[n - 1]):
                        at = n if n < NEAREST else NEAREST - 1
                        while at > 0 and squared[at - 1] > d2:
                            squared[at] = squared[at - 1]
                            found[at] = found[at - 1]
                            at -= 1
                        squared[at] = d2
                        found[at] = node
                        n = min(n + 1, NEAREST)
                    node = tree.bucket_next[node]
    return n


@loop_kernel
def _place_cost(m, x, y):
    """K1 HDOP / 9000 + K2 distance / 14142 - K4, the published cost without its flight term."""
    hdop = 0.0
    if m.team.shape[0] > 0:
        hdop = bearing_hdop(x, y, m.team, m.target_x, m.target_y)
        if not np.isfinite(hdop):
            hdop = MAX_HDOP
    distance = np.hypot(m.goal_x - x, m.goal_y - y)
    widest = 2.0 * np.sqrt(2.0) * m.half_width
    return K_HDOP * hdop / MAX_HDOP + K_DISTANCE * distance / widest - K_SOLAR


@kernel
def _feasible(m, x, y):
    return inside_box(x, y, m.half_width) and clearance_at(m.clearance, m.layer, m.grid, x, y) >= 0.0


@loop_kernel
def _is_ancestor(tree, candidate, node):
    while True:
        if node == candidate:
            return True
        if tree.parent[node] == node:
            return False
        node = tree.parent[node]


@loop_kernel
def _move(tree, node, parent, cost):
    """Make ``parent`` the parent of ``node`` by flight at ``cost``; passes the change to its descendants."""
    before = tree.parent[node]
    if tree.first_child[before] == node:
        tree.first_child[before] = tree.next_sibling[node]
    else:
        child = tree.first_child[before]
        while tree.next_sibling[child] != node:
            child = tree.next_sibling[child]
        tree.next_sibling[child] = tree.next_sibling[node]
    tree.parent[node] = parent
    tree.next_sibling[node] = tree.first_child[parent]
    tree.first_child[parent] = node
    tree.hop[node] = 1
    change = cost - tree.cost[node]
    at = node
    while True:
        tree.cost[at] += change
        if tree.first_child[at] >= 0:
            at = tree.first_child[at]
            continue
        while at != node and tree.next_sibling[at] < 0:
            at = tree.parent[at]
        if at == node:
            return
        at = tree.next_sibling[at]


@loop_kernel
def _rewire(tree, m, newest, found, squared):
    n = _nearest(tree, m, tree.x[newest], tree.y[newest], newest, found, squared)
    for j in range(n):
        near = found[j]
        distance = np.sqrt(squared[j])
        cost = tree.cost[newest] + K_FLIGHT * distance / m.max_hop
        if cost >= tree.cost[near] or distance > REWIRE_RADIUS_M or tree.parent[near] == near:
            continue
        if tree.hop[near] == 0 and tree.hop[tree.parent[near]] == 0:
            continue
        # Costs can fall along a path (K4), so a cheaper descendant may offer itself: refuse the cycle.
        if not _is_ancestor(tree, near, newest):
            _move(tree, near, newest, cost)


@loop_kernel
def _flight_distance(tree, node):
    """Distance, m, flown from the root to ``node``, consecutive hops merged into straight flights."""
    total = 0.0
    while tree.parent[node] != node:
        end = node
        while tree.hop[node] == 1 and tree.parent[node] != node:
            node = tree.parent[node]
        if node != end:
            total += np.hypot(tree.x[end] - tree.x[node], tree.y[end] - tree.y[node])
        else:
            node = tree.parent[node]
    return total


@loop_kernel
def _copy_path(tree, node, path):
    """Write the path root → ``node`` to ``path`` rows (x, y, hop); returns its length."""
    n = 1
    at = node
    while tree.parent[at] != at:
        at = tree.parent[at]
        n += 1
    at = node
    for i in range(n - 1, -1, -1):
        path[i, 0] = tree.x[at]
        path[i, 1] = tree.y[at]
        path[i, 2] = tree.hop[at]
        at = tree.parent[at]
    return n


@loop_kernel
def grow_published(tree, m, start_x, start_y, iterations, seeking, state, path):
    """Run the published loop; returns (path length or 0, iterations done, arrivals).

    ``path`` (nodes, 3) receives x, y and whether the point was reached by flight.
    """
    found = np.empty(NEAREST, np.int64)
    squared = np.empty(NEAREST)
    _add(tree, m, 0, start_x, start_y, 0, 0.0, 0)
    count = 1
    counter = 0
    last_distance = np.hypot(m.goal_x - start_x, m.goal_y - start_y)
    rate = 0.0
    best = np.inf
    length = 0
    arrivals = 0
    for i in range(iterations):
        newest = count - 1
        x, y = drift_step(m.velocity, m.field, m.axes, m.time, tree.x[newest], tree.y[newest], STEP_S, True)
        feasible = _feasible(m, x, y)
        arrived = False
        if feasible:
            cost = tree.cost[newest] + STEP_S * _place_cost(m, x, y)
            _add(tree, m, count, x, y, newest, cost, 0)
            count += 1
            distance = np.hypot(m.goal_x - x, m.goal_y - y)
            arrived = distance < m.goal_radius
            rate = (last_distance - distance) / STEP_S
            last_distance = distance
        if arrived:
            arrivals += 1
            flown = _flight_distance(tree, count - 1)
            if flown < best:
                best = flown
                length = _copy_path(tree, count - 1, path)
            if not seeking:
                return length, i + 1, arrivals
        counter = counter + 1 if i > 0 and (rate <= LEAST_RANGE_RATE_M_S or not feasible) else 0
        if counter < PATIENCE:
            continue
        counter = 0
        if not _hop(tree, m, count, found, squared, state):
            continue
        count += 1
        if np.hypot(m.goal_x - tree.x[count - 1], m.goal_y - tree.y[count - 1]) < m.goal_radius:
            arrivals += 1
            flown = _flight_distance(tree, count - 1)
            if flown < best:
                best = flown
                length = _copy_path(tree, count - 1, path)
            if not seeking:
                return length, i + 1, arrivals
        _rewire(tree, m, count - 1, found, squared)
    return length, iterations, arrivals


@loop_kernel
def _hop(tree, m, count, found, squared, state):
    """Add the landing of one hop as node ``count``; False where the landing is not feasible."""
    target_x = m.goal_x
    target_y = m.goal_y
    if uniform(state) >= GOAL_PROBABILITY:
        target_x = (2.0 * uniform(state) - 1.0) * m.half_width
        target_y = (2.0 * uniform(state) - 1.0) * m.half_width
    n = _nearest(tree, m, target_x, target_y, -1, found, squared)
    origin = found[0]
    least = np.inf
    for j in range(n):
        # The flight term is the same for all of them and does not choose.
        cost = _place_cost(m, tree.x[found[j]], tree.y[found[j]])
        if cost < least:
            least = cost
            origin = found[j]
    to_goal = np.hypot(m.goal_x - tree.x[origin], m.goal_y - tree.y[origin])
    if to_goal <= m.max_hop:
        cost = tree.cost[origin] + K_FLIGHT * to_goal / m.max_hop
        _add(tree, m, count, m.goal_x, m.goal_y, origin, cost, 1)
        return True
    dx = target_x - tree.x[origin]
    dy = target_y - tree.y[origin]
    distance = np.hypot(dx, dy)
    if distance <= 0.0:
        return False
    x = tree.x[origin] + dx / distance * m.max_hop
    y = tree.y[origin] + dy / distance * m.max_hop
    if not _feasible(m, x, y):
        return False
    _add(tree, m, count, x, y, origin, tree.cost[origin] + K_FLIGHT, 1)
    return True


@loop_kernel
def published_legs(path, length, m, legs, track):
    """Legs and track (t, x, y) of a path; consecutive drift steps and consecutive hops merge.

    Returns the number of legs and of track points.
    """
    n = 0
    points = 1
    t = 0.0
    track[0] = 0.0, path[0, 0], path[0, 1]
    begin = 0
    for i in range(1, length):
        hop = path[i, 2] == 1.0
        begins = i == 1 or hop != (path[i - 1, 2] == 1.0)
        if begins:
            begin = i - 1
            legs[n]["kind"] = HOP if hop else DRIFT
            legs[n]["x0"] = path[begin, 0]
            legs[n]["y0"] = path[begin, 1]
            legs[n]["t0"] = t
            n += 1
        if hop:
            flown = np.hypot(path[i, 0] - path[begin, 0], path[i, 1] - path[begin, 1])
            t = legs[n - 1]["t0"] + flown / m.airspeed
        else:
            t += STEP_S
        legs[n - 1]["x1"] = path[i, 0]
        legs[n - 1]["y1"] = path[i, 1]
        legs[n - 1]["t1"] = t
        points += 1 if begins or not hop else 0
        track[points - 1] = t, path[i, 0], path[i, 1]
    return n, points

"""Kernels of the product's DR-RRT*: a sparse forward tree of landings and their drifts.

A node is a landing point; from it hangs its *drift chain*, the positions after 0, 1, 2 ...
action periods adrift. An edge is a flight from any point of any chain to a sampled landing.
Per cell of space (and of time, where the current changes) only the cheapest chain point is kept
as a place to depart from. A new landing takes the cheapest departure within reach as its
parent and is kept only if it is the cheapest arrival in its own cell. Nothing is rewired, and a
parent always precedes its children, so that cycles cannot occur and no arrival time changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.physics.vehicle import drift_step, inside_box

CELL_M_PER_HALF_WIDTH = 0.025  # 125 m in the published box
TIME_BIN_S = 7200.0
STALE_POINTS = 36  # a chain that is dearer than known ones this many periods in a row ends
BACKWARD_CHAINS = 48


class Mission(NamedTuple):
    """A problem as the kernels read it: m, s, Wh."""

    velocity: np.ndarray
    field: int
    axes: tuple
    clearance: np.ndarray
    layer: int
    grid: tuple
    time: float  # field time at the start
    horizon: float
    half_width: float
    goal_x: float
    goal_y: float
    goal_radius: float
    aim: float  # the last flight ends this far from the goal
    margin: float  # least clearance
    max_hop: float
    min_hop: float
    airspeed: float
    wh_per_m: float
    hop_price: float  # Wh per flight
    drift_price: float  # Wh per s
    period: float  # s, one drift decision
    steps: int  # integration steps of a period
    coarse_steps: int  # the same in open water, 0: as many
    euler: bool  # integrator: forward Euler, else Runge-Kutta


class Sparse(NamedTuple):
    """The tree: nodes, their chains in one pool, and the cheapest chain point of each cell."""

    parent: np.ndarray  # (nodes,) node departed from, -1: the start
    takeoff: np.ndarray  # (nodes,) how many periods after the parent's landing
    cost: np.ndarray  # (nodes,) at landing, Wh
    time: np.ndarray  # (nodes,) at landing, s since the start
    first: np.ndarray  # (nodes + 1,) where the chain begins in the pool
    x: np.ndarray  # (pool,)
    y: np.ndarray
    arrival: np.ndarray  # (nodes,) least cost of a plan whose last drift is this node's chain, Wh
    arrival_takeoff: np.ndarray  # (nodes,) and the periods it drifts there
    best_cost: np.ndarray  # (time bins, cells, cells)
    best_node: np.ndarray
    best_step: np.ndarray
    back_x: np.ndarray  # (backward chains, chain) drifts that lead to the goal or near it; column = period
    back_y: np.ndarray
    back_begin: np.ndarray  # (backward chains,) first and one past the last column that counts
    back_end: np.ndarray
    back_cost: np.ndarray  # (backward chains,) what the flight from its end to the goal costs, Wh

    @staticmethod
    def allocate(nodes: int, chain: int, bins: int) -> Sparse:
        """Room for ``nodes`` landings with chains of at most ``chain`` points."""
        cells = round(2.0 / CELL_M_PER_HALF_WIDTH)
        pool = nodes * chain
        return Sparse(
            np.empty(nodes, np.int64), np.empty(nodes, np.int64), np.empty(nodes), np.empty(nodes),
            np.empty(nodes + 1, np.int64), np.empty(pool), np.empty(pool), np.empty(nodes),
            np.empty(nodes, np.int64), np.full((bins, cells, cells), np.inf),
            np.empty((bins, cells, cells), np.int64), np.empty((bins, cells, cells), np.int64),
            np.empty((BACKWARD_CHAINS, chain)), np.empty((BACKWARD_CHAINS, chain)),
            np.empty(BACKWARD_CHAINS, np.int64), np.empty(BACKWARD_CHAINS, np.int64), np.empty(BACKWARD_CHAINS),
        )  # fmt: skip


@kernel
def clear(m, x, y):
    """Whether (x, y) lies in the box and at least the margin away from obstacles."""
    return inside_box(x, y, m.half_width) and clearance_at(m.clearance, m.layer, m.grid, x, y) >= m.margin


@loop_kernel
def flight_clear(m, x0, y0, x1, y1):
    """Whether a flight may land where it has to: its equal pieces of at most the longest hop."""
    dx = x1 - x0
    dy = y1 - y0
    pieces = int(np.ceil(np.sqrt(dx * dx + dy * dy) / m.max_hop - 1e-9))
    for i in range(1, pieces):
        if not clear(m, x0 + dx * i / pieces, y0 + dy * i / pieces):
            return False
    return clear(m, x1, y1)


@kernel
def last_landing(m, x, y):
    """Where the last flight from (x, y) lands: (x, y, length); the length is inf if it cannot arrive."""
    dx = m.goal_x - x
    dy = m.goal_y - y
    distance = np.sqrt(dx * dx + dy * dy)
    if distance <= m.goal_radius:
        return x, y, 0.0
    length = max(distance - m.aim, m.min_hop)
    if abs(distance - length) > m.goal_radius:
        return x, y, np.inf
    return x + dx / distance * length, y + dy / distance * length, length


@kernel
def _room(m, x, y):
    """Distance, m, within which nothing happens to a drift: no obstacle's margin, edge or goal."""
    room = clearance_at(m.clearance, m.layer, m.grid, x, y) - m.margin
    room = min(room, m.half_width - max(abs(x), abs(y)))
    return min(room, np.sqrt((m.goal_x - x) ** 2 + (m.goal_y - y) ** 2) - m.goal_radius)


@loop_kernel
def drift_period(m, t, x, y):
    """Drift for one period from (x, y) at ``t`` s: (x, y, outcome, steps done).

    Outcome 0 drifts on, 1 reached the goal, -1 left the box or came too near an obstacle. Where
    nothing lies nearer than the way drifted, ``coarse_steps`` (if not 0) do the work of ``steps``.
    """
    x0 = x
    y0 = y
    free = m.coarse_steps > 0
    if free:
        dt = m.period / m.coarse_steps
        room = _room(m, x, y)
        for i in range(m.coarse_steps):
            from_x = x
            from_y = y
            x, y = drift_step(m.velocity, m.field, m.axes, m.time + t + i * dt, x, y, dt, m.euler)
            way = np.sqrt((x - from_x) ** 2 + (y - from_y) ** 2)
            room = min(room, _room(m, x, y))
            if room <= way:
                free = False
                break
    if free:
        return x, y, 0, m.steps
    x = x0
    y = y0
    dt = m.period / m.steps
    for i in range(m.steps):
        x, y = drift_step(m.velocity, m.field, m.axes, m.time + t + i * dt, x, y, dt, m.euler)
        if not clear(m, x, y):
            return x, y, -1, i + 1
        dx = m.goal_x - x
        dy = m.goal_y - y
        if dx * dx + dy * dy <= m.goal_radius * m.goal_radius:
            return x, y, 1, i + 1
    return x, y, 0, m.steps


@kernel
def _cell(tree, m, t, x, y):
    cells = tree.best_cost.shape[1]
    scale = cells / (2.0 * m.half_width)
    column = min(max(int((x + m.half_width) * scale), 0), cells - 1)
    row = min(max(int((y + m.half_width) * scale), 0), cells - 1)
    return min(int(t / TIME_BIN_S), tree.best_cost.shape[0] - 1), row, column


@loop_kernel
def _add_node(tree, m, node, x, y, t, cost, parent, takeoff, bound):
    """Add a landing and simulate its chain; returns the least cost of a plan that ends from it."""
    tree.parent[node] = parent
    tree.takeoff[node] = takeoff
    tree.cost[node] = cost
    tree.time[node] = t
    at = tree.first[node]
    best = np.inf
    best_step = 0
    stale = 0
    step = 0
    begin = t
    while True:
        tree.x[at] = x
        tree.y[at] = y
        at += 1
        bin_, row, column = _cell(tree, m, t, x, y)
        if cost < tree.best_cost[bin_, row, column]:
            tree.best_cost[bin_, row, column] = cost
            tree.best_node[bin_, row, column] = node
            tree.best_step[bin_, row, column] = step
            stale = 0
        else:
            stale += 1
        gx, gy, length = last_landing(m, x, y)
        total = cost + m.wh_per_m * length + (m.hop_price if length > 0.0 else 0.0)
        if total < best and t + length / m.airspeed <= m.horizon and flight_clear(m, x, y, gx, gy):
            best = total
            best_step = step
        if (stale > STALE_POINTS and node > 0) or t + m.period > m.horizon or cost >= min(best, bound):
            break
        x, y, outcome, _ = drift_period(m, t, x, y)
        step += 1
        t = begin + step * m.period
        cost = tree.cost[node] + m.drift_price * (t - begin)
        if outcome == 1 and cost < best:
            best = cost
            best_step = step
        if outcome != 0:
            break
    tree.first[node + 1] = at
    tree.arrival[node] = best
    tree.arrival_takeoff[node] = best_step
    return best


@loop_kernel
def _cheapest_departure(tree, m, x, y, reach, bound):
    """The chain point from which landing at (x, y) is cheapest: (cost, time, node, step), node -1: none."""
    cells = tree.best_cost.shape[1]
    size = 2.0 * m.half_width / cells
    span = int(reach / size)
    _, row0, column0 = _cell(tree, m, 0.0, x, y)
    best = bound
    best_node = -1
    best_step = 0
    best_time = 0.0
    for bin_ in range(tree.best_cost.shape[0]):
        for row in range(max(row0 - span, 0), min(row0 + span, cells - 1) + 1):
            for column in range(max(column0 - span, 0), min(column0 + span, cells - 1) + 1):
                cost = tree.best_cost[bin_, row, column] + m.hop_price
                if cost >= best:
                    continue
                node = tree.best_node[bin_, row, column]
                step = tree.best_step[bin_, row, column]
                x0 = tree.x[tree.first[node] + step]
                y0 = tree.y[tree.first[node] + step]
                dx = x - x0
                dy = y - y0
                length = np.sqrt(dx * dx + dy * dy)
                cost += m.wh_per_m * length
                time = tree.time[node] + step * m.period + length / m.airspeed
                if cost < best and length >= m.min_hop and time < m.horizon and flight_clear(m, x0, y0, x, y):
                    best = cost
                    best_node = node
                    best_step = step
                    best_time = time
    return best, best_time, best_node, best_step


@loop_kernel
def _drift_back(tree, m, state):
    """Drift back in time from places in and around the goal.

    Who lands on one of these drifts reaches the goal, or its surroundings, for nothing; samples of
    the box alone seldom hit so thin a stream. Where the current changes each supposes a time of arrival.
    """
    dt = -m.period / (m.coarse_steps if m.coarse_steps > 0 else m.steps)
    steady = m.velocity.shape[1] == 1
    periods = int(m.horizon / m.period)
    for chain in range(BACKWARD_CHAINS):
        spread = 0.4 * m.goal_radius if chain % 2 == 0 else 0.5 * m.max_hop
        x = m.goal_x + spread * normal(state)
        y = m.goal_y + spread * normal(state)
        _, _, length = last_landing(m, x, y)
        tree.back_cost[chain] = m.wh_per_m * length + (m.hop_price if length > 0.0 else 0.0)
        column = periods if steady else int(uniform(state) * (periods + 1))
        tree.back_end[chain] = column + 1
        while column >= 0 and clear(m, x, y):
            tree.back_x[chain, column] = x
            tree.back_y[chain, column] = y
            for i in range(m.coarse_steps if m.coarse_steps > 0 else m.steps):
                t = m.time + column * m.period + i * dt
                x, y = drift_step(m.velocity, m.field, m.axes, t, x, y, dt, m.euler)
            column -= 1
        tree.back_begin[chain] = column + 1


@loop_kernel
def _connect(tree, m, node, step):
    """The cheapest landing on a backward drift from one chain point: (x, y, cost to the goal from there on)."""
    steady = m.velocity.shape[1] == 1
    x0 = tree.x[tree.first[node] + step]
    y0 = tree.y[tree.first[node] + step]
    now = (tree.time[node] + step * m.period) / m.period
    best = np.inf
    best_x = x0
    best_y = y0
    for chain in range(BACKWARD_CHAINS):
        begin = tree.back_begin[chain]
        end = tree.back_end[chain] - 1
        share = 0.0
        if not steady:
            begin = max(begin, int(now))
            end = min(end, begin + 1) if begin == int(now) else begin
            share = now - int(now)
        for column in range(begin, end):
            x = tree.back_x[chain, column]
            y = tree.back_y[chain, column]
            x += share * (tree.back_x[chain, column + 1] - x)
            y += share * (tree.back_y[chain, column + 1] - y)
            length = np.sqrt((x - x0) ** 2 + (y - y0) ** 2)
            cost = m.wh_per_m * length + tree.back_cost[chain]
            if cost < best and length >= m.min_hop:
                best = cost
                best_x = x
                best_y = y
    return best_x, best_y, best


@loop_kernel
def _sample(tree, m, nodes, best_node, state):
    """A landing to try: anywhere, near a landing of the best plan, or on from any chain."""
    choice = uniform(state)
    if choice < 0.5:
        return (2.0 * uniform(state) - 1.0) * m.half_width, (2.0 * uniform(state) - 1.0) * m.half_width
    node = int(uniform(state) * nodes)
    if choice < 0.8:
        # Up to a few flights back along the best plan.
        node = best_node
        while tree.parent[node] > 0 and uniform(state) < 0.6:
            node = tree.parent[node]
    step = int(uniform(state) * (tree.first[node + 1] - tree.first[node]))
    x = tree.x[tree.first[node] + step]
    y = tree.y[tree.first[node] + step]
    distance = np.sqrt((m.goal_x - x) ** 2 + (m.goal_y - y) ** 2) + 1e-9
    along = min(uniform(state) * m.max_hop, distance) / distance
    spread = 0.5 * m.max_hop
    x += (m.goal_x - x) * along + spread * normal(state)
    y += (m.goal_y - y) * along + spread * normal(state)
    return x, y


@loop_kernel
def grow(tree, m, start_x, start_y, iterations, reach, state):
    """Grow the tree by ``iterations`` samples from ``state``; returns the number of nodes."""
    tree.first[0] = 0
    best = _add_node(tree, m, 0, start_x, start_y, 0.0, 0.0, -1, 0, np.inf)
    best_node = 0
    nodes = 1
    chain = int(m.horizon / m.period) + 2
    _drift_back(tree, m, state)
    for _ in range(iterations):
        if nodes == tree.cost.size or tree.first[nodes] + chain > tree.x.size:
            break
        if uniform(state) < 0.3:
            parent = int(uniform(state) * nodes)
            takeoff = int(uniform(state) * (tree.first[parent + 1] - tree.first[parent]))
            x, y, cost = _connect(tree, m, parent, takeoff)
            x0 = tree.x[tree.first[parent] + takeoff]
            y0 = tree.y[tree.first[parent] + takeoff]
            length = np.sqrt((x - x0) ** 2 + (y - y0) ** 2)
            before = tree.cost[parent] + takeoff * m.period * m.drift_price + m.hop_price
            if before + cost >= best or not flight_clear(m, x0, y0, x, y):
                continue
            cost = before + m.wh_per_m * length
            time = tree.time[parent] + takeoff * m.period + length / m.airspeed
        else:
            x, y = _sample(tree, m, nodes, best_node, state)
            if not clear(m, x, y):
                continue
            cost, time, parent, takeoff = _cheapest_departure(tree, m, x, y, reach, best)
            if parent < 0:
                continue
            bin_, row, column = _cell(tree, m, time, x, y)
            if cost >= tree.best_cost[bin_, row, column]:
                continue
        arrival = _add_node(tree, m, nodes, x, y, time, cost, parent, takeoff, best)
        if arrival < best:
            best = arrival
            best_node = nodes
        nodes += 1
    return nodes

"""Search for the best k steps: a tree over a grid that shares prefixes, then a climb from its best leaves.

For d = 1 ... k steps in turn, the best plan of d steps is the best of

* the best plan of d - 1 steps with the best last step of the finest grid, and
* the best leaf of the tree of d steps for each of the best first steps,

each moved uphill (:func:`~baselines.omlp_value.climb`). The first makes k steps never worth less than k - 1 and one
more. The tree visits *every* sequence of grid steps: each edge costs one rank-one update a transponder
(:func:`~aquaquad_envs.estimation.range_information.take_range`). Where sequences would be too many the grid is
coarser, and at last the horizon is cut into blocks of equal steps (:func:`make_grids`): the tree is still exact over
that grid, and the climb frees every step.

Where images of a transponder leave its side open, the vehicle that turns keeps to the right (:func:`turn_right`).

Ties: a later candidate replaces an earlier one only if it is worth more than ``TIE`` more. Grid steps come by size
|u|, then turns to the left (positive yaw rate) first, free steps anticlockwise from east; sequences in that order of
their first step, then the second, and so on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.range_information import gain_factor, take_range
from aquaquad_envs.estimation.symmetric3 import PACKED, invert3
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks.transponder_localization_data import AQUAQUAD, RUNNING, YAW_RATE
from baselines.omlp_images import MAX_PLACES, possible_places
from baselines.omlp_value import Scene, Trail, advance, climb, fence, make_trail, step_price

#: Values, in ln det, that differ by less are equal.
TIE = 1e-7
#: Images weigh more than this where a side is not known.
UNSURE = 0.05
#: What a turn to the other side must be worth then, in ln det a transponder.
ABOUT_AS_MUCH = 0.3
#: Parts of a horizon that have steps of their own in the tree.
MOST_BLOCKS = 7
#: Yaw rates of the grid by the number of blocks in a tree: at most 3125 sequences. Odd, so that 0 is among them. Ten
#: times as many sequences change the plans of 1 to 3 steps by less than 1e-3 in ln det: the climb does the rest.
_TURNS = (31, 13, 7, 5, 5, 3, 3)
#: Directions of a free step at each share of the longest, by the number of blocks: at most 4096 sequences.
_RINGS: tuple[dict[float, int], ...] = (
    {0.25: 6, 0.5: 12, 0.75: 18, 1.0: 36}, {0.4: 8, 0.7: 12, 1.0: 24}, {0.5: 4, 1.0: 10}, {1.0: 7}, {1.0: 4}, {1.0: 3},
    {1.0: 2},
)  # fmt: skip


class Grids(NamedTuple):
    """Grids of the trees of d = 1, 2, ... steps, rows d - 1.

    points (k, n, 2) in order of ties, sizes (k,): how many count, blocks (k, MOST_BLOCKS): equal steps in each block,
    levels (k,): blocks that count; starts: first steps whose leaves are climbed from; most, tolerance: of the climb.
    """

    points: np.ndarray
    sizes: np.ndarray
    blocks: np.ndarray
    levels: np.ndarray
    starts: int
    most: int
    tolerance: float


def make_grids(
    steps: int, *, turning: bool, starts: int = 4, most: int = 40, tolerance: float = 1e-6
) -> Grids:
    """Grids for up to ``steps`` steps of a vehicle that turns (yaw rates) or steps freely (rings)."""
    rows = [_points(min(d, MOST_BLOCKS), turning) for d in range(1, steps + 1)]
    points = np.zeros((steps, max(len(row) for row in rows), 2))
    blocks = np.zeros((steps, MOST_BLOCKS), dtype=np.int64)
    for d, row in enumerate(rows, start=1):
        points[d - 1, : len(row)] = row
        levels = min(d, MOST_BLOCKS)
        # Short blocks first: only the first step is made before the plan is made again.
        sizes = np.full(levels, d // levels)
        sizes[levels - d % levels :] += 1
        blocks[d - 1, :levels] = sizes
    return Grids(
        points, np.array([len(row) for row in rows]), blocks,
        np.minimum(np.arange(1, steps + 1), MOST_BLOCKS), starts, most, tolerance,
    )  # fmt: skip


def _points(levels: int, turning: bool) -> np.ndarray:
    if turning:
        half = _TURNS[levels - 1] // 2
        sides = [(sign * i / half, 0.0) for i in range(1, half + 1) for sign in (1.0, -1.0)]
        return np.array([(0.0, 0.0), *sides])
    found = [(0.0, 0.0)]
    for share, count in _RINGS[levels - 1].items():
        angles = 2.0 * np.pi * np.arange(count) / count
        found += zip(share * np.cos(angles), share * np.sin(angles), strict=True)
    return np.array(found)


class Tree(NamedTuple):
    """Scratch of a search: state at each level, what is chosen there, the best leaf of each first step, plans."""

    place: np.ndarray
    covariance: np.ndarray
    value: np.ndarray
    chosen: np.ndarray
    leaf: np.ndarray
    leaf_value: np.ndarray
    plan: np.ndarray
    best: np.ndarray
    trail: Trail


@loop_kernel
def make_tree(steps, width, most_targets):
    """Scratch for plans of ``steps`` steps on grids of at most ``width`` points."""
    return Tree(
        np.zeros((steps + 1, 3)), np.zeros((MOST_BLOCKS + 1, most_targets, PACKED)), np.zeros(MOST_BLOCKS + 1),
        np.zeros(MOST_BLOCKS + 1, np.int64), np.zeros((width, MOST_BLOCKS), np.int64), np.zeros(width),
        np.zeros((steps, 2)), np.zeros((steps, 2)), make_trail(steps),
    )  # fmt: skip


@kernel
def _step_gain(scene, covariance, after, x, y, update, worth):
    """Ln det gained by ranging from (x, y); writes the covariances after it where ``update``."""
    gain = 1.0
    shared = 0.0
    for m in range(scene.number):
        dx = scene.targets[m, 0] - x
        dy = scene.targets[m, 1] - y
        dz = scene.targets[m, 2]
        if update:
            factor = take_range(covariance[m], dx, dy, dz, worth.weight, after[m])
        else:
            factor = gain_factor(covariance[m], dx, dy, dz, worth.weight)
        # One logarithm for all whose place is certain.
        if scene.share[m] == 1.0:
            gain *= factor
        else:
            shared += scene.share[m] * np.log(factor)
    return np.log(gain) + shared


@kernel
def _possible(scene, ux, uy, c):
    """Whether the battery allows step (ux, uy) of the grid."""
    return c.vehicle != AQUAQUAD or ux * ux + uy * uy <= scene.most * scene.most


@loop_kernel
def search_leaves(scene, grids, d, tree, ocean, c, worth):
    """Visit all sequences of the grid of ``d`` steps: the best of each first step into ``tree.leaf`` and its value."""
    levels = grids.levels[d - 1]
    size = grids.sizes[d - 1]
    place, value, chosen = tree.place, tree.value, tree.chosen
    for m in range(scene.number):
        invert3(scene.information[m], tree.covariance[0, m])
    place[0, 0], place[0, 1], place[0, 2] = scene.x, scene.y, scene.heading
    value[0] = 0.0
    for g in range(size):
        tree.leaf_value[g] = -np.inf
    chosen[0] = -1
    level = 0
    # Steps made before this level's.
    made = 0
    while level >= 0:
        chosen[level] += 1
        g = chosen[level]
        if g == size:
            level -= 1
            if level >= 0:
                made -= grids.blocks[d - 1, level]
            continue
        ux = grids.points[d - 1, g, 0]
        uy = grids.points[d - 1, g, 1]
        if not _possible(scene, ux, uy, c):
            continue
        length = grids.blocks[d - 1, level]
        last = level == levels - 1
        total = value[level] - length * step_price(scene, ux, uy, c, worth)
        for i in range(length):
            j = made + i
            x, y, heading = advance(
                place[j, 0],
                place[j, 1],
                place[j, 2],
                scene.time + j * c.period,
                scene.field,
                ux,
                uy,
                ocean,
                c,
            )
            place[j + 1, 0], place[j + 1, 1], place[j + 1, 2] = x, y, heading
            total += _step_gain(
                scene, tree.covariance[level if i == 0 else level + 1], tree.covariance[level + 1], x, y,
                not last or i < length - 1, worth,
            ) - fence(x, y, scene.obstacle, ocean, c, worth)  # fmt: skip
        if last:
            first = chosen[0]
            if total > tree.leaf_value[first] + TIE:
                tree.leaf_value[first] = total
                for i in range(levels):
                    tree.leaf[first, i] = chosen[i]
        else:
            made += length
            level += 1
            value[level] = total
            chosen[level] = -1


@loop_kernel
def extend(scene, grids, d, tree, ocean, c, worth):
    """``tree.plan``: the best plan of ``d`` - 1 steps and the best last step of the finest grid."""
    x, y, heading = scene.x, scene.y, scene.heading
    covariance = tree.covariance[0]
    for m in range(scene.number):
        invert3(scene.information[m], covariance[m])
    for j in range(d - 1):
        ux, uy = tree.best[j, 0], tree.best[j, 1]
        tree.plan[j, 0], tree.plan[j, 1] = ux, uy
        x, y, heading = advance(x, y, heading, scene.time + j * c.period, scene.field, ux, uy, ocean, c)
        _step_gain(scene, covariance, covariance, x, y, True, worth)
    best = -np.inf
    time = scene.time + (d - 1) * c.period
    for g in range(grids.sizes[0]):
        ux, uy = grids.points[0, g, 0], grids.points[0, g, 1]
        if not _possible(scene, ux, uy, c):
            continue
        to_x, to_y, _ = advance(x, y, heading, time, scene.field, ux, uy, ocean, c)
        gain = _step_gain(scene, covariance, covariance, to_x, to_y, False, worth)
        gain -= step_price(scene, ux, uy, c, worth) + fence(to_x, to_y, scene.obstacle, ocean, c, worth)
        if gain > best + TIE:
            best = gain
            tree.plan[d - 1, 0], tree.plan[d - 1, 1] = ux, uy


@loop_kernel
def climb_from_plan(scene, grids, d, best, tree, ocean, c, worth):
    """Move ``tree.plan`` uphill and keep it in ``tree.best`` if it is worth more than ``best``; returns the greater."""
    found = climb(scene, tree.plan, d, grids.most, grids.tolerance, tree.trail, ocean, c, worth)
    if not found > best + TIE:
        return best
    for j in range(d):
        tree.best[j, 0], tree.best[j, 1] = tree.plan[j, 0], tree.plan[j, 1]
    return found


@loop_kernel
def write_leaf(grids, d, first, tree):
    """``tree.plan``: the best leaf of the tree of ``d`` steps that begins with step ``first`` of the grid."""
    j = 0
    for i in range(grids.levels[d - 1]):
        for _ in range(grids.blocks[d - 1, i]):
            tree.plan[j, 0] = grids.points[d - 1, tree.leaf[first, i], 0]
            tree.plan[j, 1] = grids.points[d - 1, tree.leaf[first, i], 1]
            j += 1


@loop_kernel
def turn_right(scene, grids, steps, best, tree, ocean, c, worth):
    """Put the best plan that begins to the right into ``tree.best``, if it is worth about as much; returns its J.

    While the side that a transponder lies on is not known, a bend tells it, and a turn back straightens the bend: one
    way is kept to unless the other is worth clearly more. That it is the right one is a convention.
    """
    search_leaves(scene, grids, steps, tree, ocean, c, worth)
    for g in range(grids.sizes[steps - 1]):
        if not grids.points[steps - 1, g, 0] < 0.0:
            tree.leaf_value[g] = -np.inf
    enough = best - ABOUT_AS_MUCH * scene.transponders
    for _ in range(grids.starts):
        pick = 0
        for g in range(grids.sizes[steps - 1]):
            if tree.leaf_value[g] > tree.leaf_value[pick] + TIE:
                pick = g
        if tree.leaf_value[pick] == -np.inf:
            break
        write_leaf(grids, steps, pick, tree)
        tree.leaf_value[pick] = -np.inf
        found = climb(scene, tree.plan, steps, grids.most, grids.tolerance, tree.trail, ocean, c, worth)
        if tree.plan[0, 0] < 0.0 and found > enough + TIE:
            enough = found
            best = found
            for j in range(steps):
                tree.best[j, 0], tree.best[j, 1] = tree.plan[j, 0], tree.plan[j, 1]
    return best


@loop_kernel
def best_plan(scene, steps, grids, tree, ocean, c, worth):
    """The best plan of ``steps`` steps into ``tree.best``; returns its J, -inf and a plan of 0 where J is no number."""
    best = -np.inf
    for j in range(steps):
        tree.best[j, 0] = 0.0
        tree.best[j, 1] = 0.0
    for d in range(1, steps + 1):
        best = -np.inf
        if d > 1:
            extend(scene, grids, d, tree, ocean, c, worth)
            best = climb_from_plan(scene, grids, d, best, tree, ocean, c, worth)
        search_leaves(scene, grids, d, tree, ocean, c, worth)
        for _ in range(grids.starts):
            pick = 0
            for g in range(grids.sizes[d - 1]):
                if tree.leaf_value[g] > tree.leaf_value[pick] + TIE:
                    pick = g
            if tree.leaf_value[pick] == -np.inf:
                break
            write_leaf(grids, d, pick, tree)
            tree.leaf_value[pick] = -np.inf
            best = climb_from_plan(scene, grids, d, best, tree, ocean, c, worth)
    if c.vehicle == YAW_RATE and scene.unsure > UNSURE and not tree.best[0, 0] < 0.0:
        best = turn_right(scene, grids, steps, best, tree, ocean, c, worth)
    return best


@loop_kernel
def scene_of(w, field, most, images, targets, information, share, c):
    """What the planner reads of world ``w``, believed places copied to ``targets`` (P, 3), ``information``, ``share``.

    ``field``: the currents that it plans with. ``images``: whether images of the estimates count.
    """
    number = w.num_transponders
    unsure = 0.0
    if images:
        number, unsure = possible_places(w, c, targets, information, share)
    else:
        for m in range(number):
            share[m] = 1.0
            for i in range(3):
                targets[m, i] = w.estimate[m, i]
            for i in range(PACKED):
                information[m, i] = w.information[m, i]
    return Scene(
        w.x,
        w.y,
        w.heading,
        w.clock_s + w.time_s,
        field,
        w.obstacle,
        most,
        w.num_transponders,
        number,
        targets,
        information,
        share,
        unsure,
    )


@kernel
def affordable(w, c):
    """The longest hop, as a share of the longest, that leaves the battery what the rest of the mission draws."""
    if c.vehicle != AQUAQUAD:
        return 1.0
    left = c.base_power * c.period * (c.num_measurements - w.count) / 3600.0
    hop = flight_energy_wh(c.max_hop, c.airspeed, c.flight_power)
    return min(max((w.battery_wh - left) / hop, 0.0), 1.0) if hop > 0.0 else 1.0


@loop_kernel
def plan_all(worlds, steps, images, grids, plans, values, ocean, c, worth):
    """The best plan of every running world: actions (n, steps, 2) into ``plans``, J (n,) into ``values``.

    A plan is no longer than the measurements that are left. Worlds do not depend on each other, and nothing is
    allocated for one. Of a record this reads places, ranges, heading, clock, battery, estimates, information and the
    forecast, never ``target`` or ``truth``.
    """
    tree = make_tree(steps, grids.points.shape[1], MAX_PLACES)
    targets = np.zeros((MAX_PLACES, 3))
    information = np.zeros((MAX_PLACES, PACKED))
    share = np.zeros(MAX_PLACES)
    for k in range(worlds.size):
        w = worlds[k]
        values[k] = -np.inf
        plans[k] = 0.0
        if w.outcome != RUNNING:
            continue
        ahead = min(steps, max(c.num_measurements - w.count, 1))
        scene = scene_of(w, w.forecast, affordable(w, c), images, targets, information, share, c)
        values[k] = best_plan(scene, ahead, grids, tree, ocean, c, worth)
        for j in range(ahead):
            plans[k, j, 0] = tree.best[j, 0]
            plans[k, j, 1] = tree.best[j, 1]

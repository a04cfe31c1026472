"""Direct flight: the shortest flight to the goal, no drift; the drift/hop task's score of 0.

A flight is a chain of straight hops, and every landing must be on open water. Where the straight
line to the goal has a stretch of obstacle longer than the longest hop (the published square has, on
the diagonal of the published start and goal), the shortest detour over a graph of landing places is
flown instead, straightened.
"""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.physics.obstacles import clearance_at
from baselines.problem import require_continuous_actions

#: m; landings keep this clearance, so that rounding of an action never touches an obstacle.
_CLEARANCE_M = 1.0
#: Landing places a side of the detour graph at most.
_MOST_NODES = 100
_COMPASS = np.array([(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy], dtype=np.float64)


class DirectFlight:
    """Flies to the goal's centre by the shortest chain of hops that lands on open water.

    Where no such chain exists it flies straight at the goal, whatever comes of it. The seeds of
    :meth:`reset` change nothing.
    """

    information = "all obstacles, its own position and the goal; no current"

    def __init__(self, batch: Any) -> None:
        require_continuous_actions(batch)
        self.batch = batch
        self._landings: list[list[np.ndarray]] = [[] for _ in range(batch.num_worlds)]
        self._known: dict[tuple[int, bytes, bytes], list[np.ndarray]] = {}

    def reset(self, seeds: np.ndarray) -> None:
        """Forget where every world is on its route."""
        self._landings = [[] for _ in range(self.batch.num_worlds)]

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, 2): the next hop as a fraction of the longest."""
        params = self.batch.params
        actions = np.zeros((len(worlds), 2), dtype=np.float32)
        for i in np.flatnonzero(worlds["outcome"] == 0):
            position = np.array([worlds["x"][i], worlds["y"][i]])
            if not self._landings[i]:
                goal = np.array([worlds["goal_x"][i], worlds["goal_y"][i]])
                key = (int(worlds["obstacle"][i]), position.tobytes(), goal.tobytes())
                if key not in self._known:
                    self._known[key] = route(self.batch, key[0], position, goal)
                self._landings[i] = list(self._known[key])
            hop = self._landings[i].pop(0) - position
            # The world takes a hop below its threshold for a drift: overshoot instead.
            least = params.drift_threshold * params.max_hop_m * 1.001
            length = float(np.hypot(*hop))
            if length < least:
                hop = hop * (least / length) if length > 0 else np.array([least, 0.0])
            actions[i] = hop / params.max_hop_m
        return actions


def route(batch: Any, layer: int, start: np.ndarray, goal: np.ndarray) -> list[np.ndarray]:
    """Landing points, each (x, y) in m, of the shortest flight from ``start`` to ``goal``, the goal last."""
    straight = _hops(batch, layer, start, goal)
    if straight is not None:
        return straight
    knots = _detour(batch, layer, start, goal)
    if not len(knots):
        return _pieces(batch, start, goal)
    bends = [knots[0]]
    at = 0
    while at < len(knots) - 1:
        # Straighten: on to the farthest knot that straight hops reach (the next one always is).
        ahead = range(len(knots) - 1, at, -1)
        at = next(k for k in ahead if k == at + 1 or _hops(batch, layer, knots[at], knots[k]) is not None)
        bends.append(knots[at])
    _shorten(batch, layer, bends)
    legs = [_hops(batch, layer, *leg) or [leg[1]] for leg in itertools.pairwise(bends)]
    return [landing for leg in legs for landing in leg]


def _shorten(batch: Any, layer: int, bends: list[np.ndarray]) -> None:
    """Move each inner bend, in ever smaller steps, as long as that shortens the flight."""
    step = batch.params.max_hop_m / 4
    while step > batch.params.max_hop_m / 200:
        moved = False
        for k in range(1, len(bends) - 1):
            for move in step * _COMPASS:
                legs = [(bends[k - 1], bends[k] + move), (bends[k] + move, bends[k + 1])]
                before = _length(bends[k - 1], bends[k]) + _length(bends[k], bends[k + 1])
                if sum(_length(*leg) for leg in legs) < before - 1.0 and all(
                    np.abs(leg[1]).max() <= batch.params.half_width_m
                    and _hops(batch, layer, *leg) is not None
                    for leg in legs
                ):
                    bends[k] = bends[k] + move
                    moved = True
        if not moved:
            step /= 2


def _length(start: np.ndarray, end: np.ndarray) -> float:
    return float(np.hypot(*(end - start)))


def _pieces(batch: Any, start: np.ndarray, goal: np.ndarray) -> list[np.ndarray]:
    """Equal hops along the straight line, the last one exactly at ``goal``."""
    distance = _length(start, goal)
    number = max(int(np.ceil(distance / batch.params.max_hop_m - 1e-9)), 1)
    return [start + (goal - start) * (k / number) for k in range(1, number)] + [goal]


def _hops(batch: Any, layer: int, start: np.ndarray, goal: np.ndarray) -> list[np.ndarray] | None:
    """Hops along the straight line that all land on open water, or None."""
    equal = _pieces(batch, start, goal)
    if _open_water(batch, layer, np.array(equal)).all():
        return equal
    longest = batch.params.max_hop_m
    least = batch.params.drift_threshold * longest * 1.001
    distance = _length(start, goal)
    along = np.linspace(0.0, distance, max(int(distance / 10.0), 2))
    points = start + (goal - start) * (along / distance)[:, None]
    usable = _open_water(batch, layer, points) & ((distance - along >= least) | (along == distance))
    landings, at = [], 0.0
    while at < distance:
        # The farthest landing within reach never rules out what a nearer one allows.
        reach = np.flatnonzero(usable & (along >= at + least) & (along <= at + longest))
        if not len(reach):
            return None
        at = along[reach[-1]]
        landings.append(points[reach[-1]])
    return landings


def _detour(batch: Any, layer: int, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Start, landings and goal, (n, 2), of the shortest chain of hops over a grid of landing places; empty if none."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    params = batch.params
    longest = params.max_hop_m
    side = int(np.clip(2 * params.half_width_m / (longest / 6), 3, _MOST_NODES - 1)) + 1
    axis = np.linspace(-params.half_width_m, params.half_width_m, side)
    grid = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    free = _open_water(batch, layer, grid)
    tails, heads, lengths = _edges(side, float(axis[1] - axis[0]), float(longest))
    kept = free[tails] & free[heads]
    parts = [(tails[kept], heads[kept], lengths[kept])]
    for k, point in enumerate((start, goal)):
        away = np.hypot(*(grid - point).T)
        near = np.flatnonzero(free & (away <= longest))
        parts.append((np.full(len(near), len(grid) + k), near, away[near]))
    rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
    size = len(grid) + 2
    graph = coo_matrix((np.maximum(values, 1e-6), (rows, columns)), shape=(size, size)).tocsr()
    distance, before = dijkstra(graph, directed=False, indices=size - 1, return_predecessors=True)
    if not np.isfinite(distance[size - 2]):
        return np.empty((0, 2))
    knots, at = [start], int(before[size - 2])
    while at != size - 1:
        knots.append(grid[at])
        at = int(before[at])
    return np.array([*knots, goal])


@lru_cache(maxsize=4)
def _edges(side: int, spacing: float, longest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of grid nodes at most ``longest`` apart, each pair once, and their distances, m."""
    reach = int(longest / spacing)
    node = np.arange(side * side).reshape(side, side)
    tails, heads, lengths = [], [], []
    for rows in range(reach + 1):
        for columns in range(-reach, reach + 1):
            length = spacing * float(np.hypot(rows, columns))
            if length > longest or (rows == 0 and columns <= 0):
                continue
            left, right = max(-columns, 0), side - max(columns, 0)
            tail = node[: side - rows, left:right].ravel()
            tails.append(tail)
            heads.append(tail + rows * side + columns)
            lengths.append(np.full(len(tail), length))
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(lengths)


def _open_water(batch: Any, layer: int, points: np.ndarray) -> np.ndarray:
    out = np.empty(len(points), dtype=bool)
    _mark_open(batch.ocean.clearance, layer, batch.ocean.clearance_grid, points, out)
    return out


@loop_kernel
def _mark_open(clearance, layer, grid, points, out):
    for i in range(points.shape[0]):
        out[i] = clearance_at(clearance, layer, grid, points[i, 0], points[i, 1]) >= _CLEARANCE_M

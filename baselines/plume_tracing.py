"""``quadratic-fit``: each robot fits a quadratic to the best readings it knows of and steps towards its minimum.

Byrne, Eskridge, Hurtado and Savage, *Algorithms and Analysis for Underwater Vehicle Plume Tracing*, SAND2003-2643;
SPEC §9; ``docs/quadratic_fit.md``. Readings G become F = 1/G, which is quadratic about a source of light. There is no
centre: robots share readings and decide for themselves, all at once or one after the other as the world has it. The
world shortens moves that would end near another robot by tenths.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.quadratic_fit import (
    CONDITION_LIMIT,
    HORIZONTAL,
    LEAST_CURVATURE,
    METHODS,
    SPACE,
    SVD,
    fit_quadratic,
    fit_space,
    newton_step,
    step_scale,
)
from aquaquad_envs.tasks.plume_tracing_data import (
    MAX_ROBOTS,
    MEMORY,
    PLACE_X,
    PLACE_Y,
    PLACE_Z,
    RUNNING,
    TIME,
    VALUE,
)
from baselines.spiral_surge import GOLDEN_ANGLE, spiral_course

#: What is fitted: "inverse", F = 1/G (published), or "logarithm", F = -ln G, quadratic in a Gaussian plume.
TRANSFORMS = ("inverse", "logarithm")
#: What a robot does that has no fit: "search", or "hold" (published).
WITHOUT_FIT = ("search", "hold")
NOW, BEST, BOTH = range(3)
#: Which readings are fitted.
READINGS = {"now": NOW, "best": BEST, "both": BOTH}
_MOST = MAX_ROBOTS + MEMORY
#: Factor by which the neighbourhood grows (published).
_GROWTH = 1.5


class _Terms(NamedTuple):
    """Options as kernels read them."""

    method: int
    axes: int
    readings: int
    neighbours: int
    reach: float
    most_reach: float
    limit: float
    least: float
    logarithm: bool
    hold: bool
    gap: float


class QuadraticFit:
    """Steps to the minimum of a quadratic through the readings.

    Parameters
    ----------
    method: "svd", "qr" or "tls" (``estimation.quadratic_fit``). dimensions: 3, or 2: depth is left out from the start,
        as it always is of a team bound to the surface.
    readings: "now", what the robots heard read at this moment, as in the published study; "best", the best ones
        remembered (20), as on the published vehicles; or "both", which lets fresh readings outweigh old errors.
    neighbours: readings wanted; those within ``range_m`` count, a range grown by half while they are
        fewer and it is not above ``max_range_m``.
    condition_limit: greatest condition number of a fit in space, then in the plane. least_curvature: see
        ``estimation.quadratic_fit``.
    transform: "inverse" or "logarithm" of readings. without_fit: "search", go to the best reading known, from there
        spiral out; or "hold".

    Without a fit means: fewer readings than ``neighbours`` and than a plane needs, or a condition
    number above the limit in the plane too (but for "svd", which then has the solution of least norm).
    """

    information = (
        "believed places and readings of the robots heard, and the best of them remembered; not the current"
    )

    def __init__(
        self, batch: Any, *, method: str = "svd", dimensions: int = 3, readings: str = "both", neighbours: int = 10,
        range_m: float = 100.0, max_range_m: float = 100.0, condition_limit: float = CONDITION_LIMIT,
        least_curvature: float = LEAST_CURVATURE, transform: str = "inverse", without_fit: str = "search",
        gap_m: float = 2.0,
    ) -> None:  # fmt: skip
        check_choice("method", method, METHODS)
        check_choice("transform", transform, TRANSFORMS)
        check_choice("without_fit", without_fit, WITHOUT_FIT)
        if dimensions not in (2, 3):
            raise InvalidParameterError("dimensions", dimensions, "2 or 3")
        check_choice("readings", readings, READINGS)
        check_range("neighbours", neighbours, 1, _MOST)
        check_range("range_m", range_m, 0.0, 1e9, open_low=True)
        check_range("max_range_m", max_range_m, 0.0, 1e9, open_low=True)
        check_range("condition_limit", condition_limit, 1.0, 1e300, open_low=True)
        check_range("least_curvature", least_curvature, 0.0, 1e300)
        check_range("gap_m", gap_m, 1e-3, 1e6)
        self.batch = batch
        flat = dimensions == 2 or batch.constants.surface_bound
        self.terms = _Terms(
            method=METHODS[method], axes=HORIZONTAL if flat else SPACE, readings=READINGS[readings],
            neighbours=int(neighbours), reach=float(range_m), most_reach=float(max_range_m),
            limit=float(condition_limit), least=float(least_curvature), logarithm=transform == "logarithm",
            hold=without_fit == "hold", gap=float(gap_m),
        )  # fmt: skip
        self._space = fit_space(_MOST)
        self._actions = np.zeros((batch.num_worlds, batch.num_agents, 3))
        #: Of the last decisions: condition number and axes (bits) of each robot's fit; inf and 0 without.
        self.conditions = np.full((batch.num_worlds, batch.num_agents), np.inf)
        self.axes = np.zeros((batch.num_worlds, batch.num_agents), dtype=np.int64)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to forget: what was read is in the world's record."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, robots, 3), in step limits; zeros of robots whose turn it is not."""
        _decide(
            worlds, self.batch.constants, self.terms, self._space, self.conditions, self.axes, self._actions
        )
        return self._actions.astype(np.float32)


@kernel
def _field(value, logarithm):
    return -np.log(value) if logarithm else 1.0 / value


@kernel
def _add(points, values, away, count, w, i, x, y, z, value, logarithm):
    """A reading into the table; returns the new count."""
    dx = x - w.seen_x[i]
    dy = y - w.seen_y[i]
    dz = z - w.seen_z[i]
    away[count] = dx * dx + dy * dy + dz * dz
    values[count] = _field(value, logarithm)
    points[count, 0] = x
    points[count, 1] = y
    points[count, 2] = z
    return count + 1


@kernel
def _within(away, count, reach):
    near = 0
    for k in range(count):
        if away[k] < reach * reach:
            near += 1
    return near


@loop_kernel
def _gather(w, i, c, terms, points, values, away):
    """What robot ``i`` fits; returns how many readings."""
    count = 0
    if terms.readings != NOW:
        table = w.memory[w.memory_of[i]]
        for k in range(w.memory_count[w.memory_of[i]]):
            # Those of this moment come below.
            if terms.readings == BEST or table[k, TIME] < w.time_s:
                count = _add(
                    points, values, away, count, w, i, table[k, PLACE_X], table[k, PLACE_Y], table[k, PLACE_Z],
                    table[k, VALUE], terms.logarithm,
                )  # fmt: skip
    if terms.readings != BEST:
        for j in range(c.num_robots):
            if w.heard[i, j] and w.reading[j] > 0.0:
                count = _add(
                    points, values, away, count, w, i, w.seen_x[j], w.seen_y[j], w.seen_z[j], w.reading[j],
                    terms.logarithm,
                )  # fmt: skip
    reach = terms.reach
    near = _within(away, count, reach)
    while near < terms.neighbours and reach <= terms.most_reach:
        reach *= _GROWTH
        near = _within(away, count, reach)
    if near == count:
        return count
    kept = 0
    for k in range(count):
        if away[k] < reach * reach:
            values[kept] = values[k]
            for axis in range(3):
                points[kept, axis] = points[k, axis]
            kept += 1
    return kept


@kernel
def _search(w, i, c, terms):
    """Without a fit: to the best reading known, from there (or without any) out on a spiral of one's own."""
    table = w.memory_of[i]
    if w.memory_count[table] > 0:
        best = w.memory[table, 0]
        dx = best[PLACE_X] - w.seen_x[i]
        dy = best[PLACE_Y] - w.seen_y[i]
        dz = best[PLACE_Z] - w.seen_z[i]
        if dx * dx + dy * dy + dz * dz > 4.0 * c.spacing * c.spacing:
            return dx, dy, dz
    course = GOLDEN_ANGLE * i + spiral_course(c.step_limit * w.updates, terms.gap)
    return c.step_limit * np.cos(course), c.step_limit * np.sin(course), 0.0


@loop_kernel
def _decide_robot(w, i, c, terms, space, points, values, away, coefficients):
    """Step of robot ``i``, m, not yet limited; condition number and axes of its fit."""
    count = _gather(w, i, c, terms, points, values, away)
    condition = np.inf
    used = 0
    if count >= terms.neighbours or not terms.hold:
        condition, used = fit_quadratic(
            points, values, count, w.seen_x[i], w.seen_y[i], w.seen_z[i], terms.axes, terms.method, terms.limit, space,
            coefficients,
        )  # fmt: skip
    # With several singular values left out the solution of least norm is still a direction down.
    if used != 0 and (condition <= terms.limit or terms.method == SVD):
        sx, sy, sz = newton_step(coefficients, used, terms.least, space)
        if np.isfinite(sx + sy + sz):
            return sx, sy, sz, condition, used
    if terms.hold:
        return 0.0, 0.0, 0.0, condition, 0
    sx, sy, sz = _search(w, i, c, terms)
    return sx, sy, sz, condition, 0


@loop_kernel
def _decide(worlds, c, terms, space, conditions, axes, actions):
    points = np.empty((_MOST, 3))
    values = np.empty(_MOST)
    away = np.empty(_MOST)
    coefficients = np.empty(10)
    for k in range(worlds.size):
        w = worlds[k]
        for i in range(c.num_robots):
            actions[k, i, 0] = 0.0
            actions[k, i, 1] = 0.0
            actions[k, i, 2] = 0.0
            if w.outcome != RUNNING or (w.turn >= 0 and w.turn != i):
                continue
            sx, sy, sz, conditions[k, i], axes[k, i] = _decide_robot(
                w, i, c, terms, space, points, values, away, coefficients
            )
            share = step_scale(sx, sy, sz, c.step_limit, c.step_limit, c.step_limit) / c.step_limit
            actions[k, i, 0] = share * sx
            actions[k, i, 1] = share * sy
            actions[k, i, 2] = share * sz

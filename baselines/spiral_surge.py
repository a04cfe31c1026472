"""``spiral-surge``: out on a spiral until something is smelt, then upstream for a while, then a spiral again.

The usual alternative to gradients where turbulence leaves none: a plume is whiffs with nothing between them, and
upstream is where the source is. After Hayes, Martinoli and Goodman, "Distributed odor source localization", IEEE
Sensors Journal 2(3), 2002 (spirals of two gaps, surges upwind, robots called to where another smells something); surge
and cast are those of moths, see Balkovsky and Shraiman, "Olfactory search at high Reynolds number", PNAS 99, 2002.
Theirs is in the plane; here depth is searched too, by waves along the spiral.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import check_range
from aquaquad_envs.tasks.plume_tracing_data import NEVER, PLACE_X, PLACE_Y, PLACE_Z, RUNNING

#: Angle between the courses of successive robots that begin to search, rad: they spread evenly whatever their number.
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@kernel
def spiral_course(travelled, gap):
    """Course, rad, after ``travelled`` m of an Archimedean spiral whose turns are ``gap`` m apart.

    r = gap θ / 2π, whose length is gap θ² / 4π but for the first turn; the course is a right angle ahead of θ.
    """
    return np.sqrt(4.0 * np.pi * travelled / gap) + 0.5 * np.pi


class _Terms(NamedTuple):
    """Options as kernels read them."""

    surge: float
    gap: float
    cast_gap: float
    wave: float
    patience: float


class SpiralSurge:
    """Surges upstream on every detection, and spirals from where a surge ends without another.

    Parameters
    ----------
    surge_m: way upstream after a detection. gap_m, cast_gap_m: between the turns of the spiral before anything
        was detected, and after a surge. wave_m: length, along a spiral, of the waves in which depth is searched.
    patience_s: a robot without a detection for so long goes to the strongest reading that it has heard of since,
        and upstream from there.

    Without a current there is no upstream: detections call robots to the strongest, and all else is spirals.
    """

    information = "its own place, reading and current, and the places and values of the readings remembered"

    def __init__(
        self, batch: Any, *, surge_m: float = 4.0, gap_m: float = 4.0, cast_gap_m: float = 2.0, wave_m: float = 6.0,
        patience_s: float = 20.0,
    ) -> None:  # fmt: skip
        for name, value in (
            ("surge_m", surge_m), ("gap_m", gap_m), ("cast_gap_m", cast_gap_m), ("wave_m", wave_m)
        ):  # fmt: skip
            check_range(name, value, 0.0, 1e6, open_low=True)
        check_range("patience_s", patience_s, 0.0, 1e9)
        self.batch = batch
        self.terms = _Terms(float(surge_m), float(gap_m), float(cast_gap_m), float(wave_m), float(patience_s))
        rows = (batch.num_worlds, batch.num_agents)
        #: m left of a surge, m travelled on a spiral, time of the detection or call that was acted on last, s.
        self._surge, self._travelled, self._acted = np.zeros(rows), np.zeros(rows), np.full(rows, NEVER)
        self._actions = np.zeros((*rows, 3))

    def reset(self, seeds: np.ndarray) -> None:
        """Begin an episode in every world; nothing is drawn."""
        self._surge[...] = 0.0
        self._travelled[...] = 0.0
        self._acted[...] = NEVER

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, robots, 3), in step limits; zeros of robots whose turn it is not."""
        _decide(
            worlds, self.batch.constants, self.terms, self._surge, self._travelled, self._acted, self._actions
        )
        return self._actions.astype(np.float32)


@kernel
def _spiral(i, travelled, gap, c, terms):
    course = GOLDEN_ANGLE * i + spiral_course(travelled, gap)
    wave = np.sin(2.0 * np.pi * travelled / terms.wave)
    return c.step_limit * np.cos(course), c.step_limit * np.sin(course), 0.5 * c.step_limit * wave


@kernel
def _surge_step(w, i, speed, c):
    """Upstream, and towards the depth of the strongest reading remembered."""
    dz = 0.0
    table = w.memory_of[i]
    if w.memory_count[table] > 0:
        dz = w.memory[table, 0, PLACE_Z] - w.seen_z[i]
        dz = min(max(dz, -0.5 * c.step_limit), 0.5 * c.step_limit)
    return -c.step_limit * w.flow_u[i] / speed, -c.step_limit * w.flow_v[i] / speed, dz


@loop_kernel
def _decide_robot(w, i, c, terms, surge, travelled, acted):
    """Step of robot ``i``, m, each component within the limit."""
    speed = np.sqrt(w.flow_u[i] * w.flow_u[i] + w.flow_v[i] * w.flow_v[i])
    if w.reading[i] > 0.0 and speed > 0.0:
        surge[i] = terms.surge
        acted[i] = w.time_s
    if surge[i] > 0.0 and speed > 0.0:
        surge[i] -= c.step_limit
        travelled[i] = 0.0
        return _surge_step(w, i, speed, c)
    table = w.memory_of[i]
    if w.memory_count[table] > 0 and w.time_s - acted[i] >= terms.patience:
        best = w.memory[table, 0]
        dx = best[PLACE_X] - w.seen_x[i]
        dy = best[PLACE_Y] - w.seen_y[i]
        dz = best[PLACE_Z] - w.seen_z[i]
        away = max(abs(dx), abs(dy), abs(dz))
        # A call once followed is answered: the next must be of a later reading, or after as long a wait.
        if away <= 2.0 * c.spacing + c.step_limit:
            acted[i] = w.time_s
            travelled[i] = 0.0
            surge[i] = terms.surge if speed > 0.0 else 0.0
        scale = c.step_limit / max(away, c.step_limit)
        return scale * dx, scale * dy, scale * dz
    gap = terms.gap if acted[i] <= NEVER else terms.cast_gap
    sx, sy, sz = _spiral(i, travelled[i], gap, c, terms)
    travelled[i] += c.step_limit
    return sx, sy, sz


@loop_kernel
def _decide(worlds, c, terms, surge, travelled, acted, actions):
    for k in range(worlds.size):
        w = worlds[k]
        for i in range(c.num_robots):
            actions[k, i, 0] = 0.0
            actions[k, i, 1] = 0.0
            actions[k, i, 2] = 0.0
            if w.outcome != RUNNING or (w.turn >= 0 and w.turn != i):
                continue
            sx, sy, sz = _decide_robot(w, i, c, terms, surge[k], travelled[k], acted[k])
            actions[k, i, 0] = sx / c.step_limit
            actions[k, i, 1] = sy / c.step_limit
            actions[k, i, 2] = sz / c.step_limit

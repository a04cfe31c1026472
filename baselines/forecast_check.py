"""What a drifting vehicle learns about its forecast: it compares its own track with the forecast drift.

The error of the last drift, extrapolated, warns of an obstacle or edge ahead; the errors along
the track correct the forecast for the next plan (estimation/current_map.py). With an exact forecast nothing happens.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.estimation.current_map import CurrentMap
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step, inside_box

#: Errors below this are rounding, m/s.
_EXACT_M_S = 1e-6
#: How far an error is taken to reach: a share of the box's half-width, and s.
_LENGTH, _TIME_S = 0.25, 24 * 3600.0


class ForecastCheck:
    """Keeps, for each world of a batch, where its drift differed from the forecast and by how much."""

    def __init__(self, batch: Any) -> None:
        self.batch = batch
        self.maps = [self._new_map() for _ in range(batch.num_worlds)]
        self.latest = np.zeros((batch.num_worlds, 2))
        # Where the forecast says each world will be at the next decision; NaN: not adrift.
        self._expected = np.full((batch.num_worlds, 2), np.nan)
        self._last = np.full((batch.num_worlds, 2), np.nan)

    def clear(self, worlds: np.ndarray) -> None:
        """Forget what ``worlds`` learned."""
        self._expected[worlds] = np.nan
        self.latest[worlds] = 0.0
        for i in worlds:
            self.maps[i] = self._new_map()

    def observe(self, worlds: np.ndarray) -> None:
        """Compare the positions with those expected at the last decision."""
        period = self.batch.params.action_period_s
        u = (worlds["x"] - self._expected[:, 0]) / period
        v = (worlds["y"] - self._expected[:, 1]) / period
        for i in np.flatnonzero((np.hypot(u, v) > _EXACT_M_S) & (worlds["outcome"] == 0)):
            x, y = 0.5 * (self._last[i] + (worlds["x"][i], worlds["y"][i]))
            # The mean over the drift belongs to its middle.
            middle = worlds["clock_s"][i] + worlds["time_s"][i] - 0.5 * period
            self.maps[i].add(middle, x, y, [[u[i], v[i]]])
            self.latest[i] = u[i], v[i]

    def dangers(self, worlds: np.ndarray, drifting: np.ndarray, margin_m: float) -> np.ndarray:
        """Drifting worlds (bool) that the corrected forecast takes out of bounds within a period."""
        danger = np.zeros(len(worlds), dtype=bool)
        params, ocean = self.batch.params, self.batch.ocean
        _look_ahead(
            ocean.velocity, ocean.axes, ocean.clearance, ocean.clearance_grid, worlds, drifting, self.latest,
            float(params.action_period_s), int(params.sub_steps), params.integrator == "euler",
            float(params.half_width_m), float(margin_m), self._expected, danger,
        )  # fmt: skip
        self._last[:, 0], self._last[:, 1] = worlds["x"], worlds["y"]
        return danger

    def corrected(self, world: int, field: int) -> np.ndarray | None:
        """The forecast corrected by the world's map of errors, shape (1, frames, rows, columns, 2).

        None where the forecast was never wrong.
        """
        if not len(self.maps[world]):
            return None
        ocean = self.batch.ocean
        return self.maps[world].corrected(ocean.velocity[field], ocean.axes)[None]

    def _new_map(self) -> CurrentMap:
        return CurrentMap(
            length_scale_m=_LENGTH * self.batch.params.half_width_m, time_scale_s=_TIME_S, error_std_m_s=0.2,
            noise_std_m_s=0.1,
        )  # fmt: skip


@loop_kernel
def _look_ahead(
    velocity, axes, clearance, grid, worlds, drifting, errors, period, steps, euler, half_width, margin, expected,
    danger,
):  # fmt: skip
    dt = period / steps
    for i in range(worlds.size):
        expected[i, 0] = np.nan
        expected[i, 1] = np.nan
        if not drifting[i]:
            continue
        w = worlds[i]
        x = w.x
        y = w.y
        for step in range(steps):
            t = w.clock_s + w.time_s + step * dt
            x, y = drift_step(velocity, w.forecast, axes, t, x, y, dt, euler)
            near_x = x + errors[i, 0] * (step + 1) * dt
            near_y = y + errors[i, 1] * (step + 1) * dt
            safe = inside_box(near_x, near_y, half_width)
            safe = safe and clearance_at(clearance, w.obstacle, grid, near_x, near_y) >= margin
            danger[i] = danger[i] or not safe
        expected[i, 0] = x
        expected[i, 1] = y

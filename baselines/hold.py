"""Hold: drift, and hop back to the start when the current has carried a vehicle too far, or would into danger.

What a team of moorings would do: it keeps the place it was given, whatever the target does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import check_range
from aquaquad_envs.physics.vehicle import drift_step
from aquaquad_envs.tasks.sensor_placement_data import RUNNING
from baselines.hdop_optimal_paths import is_open
from baselines.problem import require_continuous_actions

#: Pieces of the coming drift that are looked at.
_PIECES = 4


class Hold:
    """Hops back to the start position once further from it than ``radius_m``.

    Earlier where the forecast of the next decision leads within ``margin_m`` of an obstacle or the box's
    edge. A steered vehicle stays where it is: nothing carries it away.
    """

    information = "its own position and start, and where the forecast carries it in the next decision"

    def __init__(self, batch: Any, *, radius_m: float = 250.0, margin_m: float = 50.0) -> None:
        require_continuous_actions(batch)
        check_range("radius_m", radius_m, 0.0, 1e6)
        check_range("margin_m", margin_m, 0.0, 1e5)
        self.batch = batch
        self.radius_m, self.margin_m = float(radius_m), float(margin_m)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: the start is in the world's record."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, vehicles, 2): zeros, or the hop towards the start."""
        actions = np.zeros((len(worlds), self.batch.num_agents, 2), dtype=np.float32)
        if not self.batch.constants.steered:
            _hold(worlds, self.batch.ocean, self.batch.constants, self.radius_m, self.margin_m, actions)
        return actions


@loop_kernel
def _drifts_into_danger(x, y, w, ocean, c, margin):
    dt = c.action_period / _PIECES
    now = w.clock_s + w.time_s
    for k in range(_PIECES):
        x, y = drift_step(ocean.velocity, w.forecast, ocean.axes, now + k * dt, x, y, dt, c.euler)
        if not is_open(x, y, w, ocean, c, margin):
            return True
    return False


@loop_kernel
def _hold(worlds, ocean, c, radius, margin, actions):
    for k in range(worlds.size):
        w = worlds[k]
        if w.outcome != RUNNING:
            continue
        for i in range(c.num_vehicles):
            if w.agent_outcome[i] != RUNNING:
                continue
            dx = w.start_x[i] - w.x[i]
            dy = w.start_y[i] - w.y[i]
            away = np.sqrt(dx * dx + dy * dy)
            # The world takes a hop below its threshold for a drift: nearer than that there is no way back.
            if away < 1.001 * c.drift_threshold * c.max_hop:
                continue
            if away > radius or _drifts_into_danger(w.x[i], w.y[i], w, ocean, c, margin):
                scale = 1.0 / max(away, c.max_hop)
                actions[k, i, 0] = scale * dx
                actions[k, i, 1] = scale * dy

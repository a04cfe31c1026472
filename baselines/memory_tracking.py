"""``memory-tracking``: sweep dark ground nearest to the guess, then ride round the believed centre of the light.

It acts on what the world itself remembers (:mod:`aquaquad_envs.tasks.laser_tracking_memory`), which learned policies
observe too, and has no memory of its own: an observation decides an action.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import check_range
from aquaquad_envs.tasks.laser_tracking_data import RUNNING, SECTORS
from baselines.laser_guidance import shortened
from baselines.problem import require_continuous_actions

#: How far beyond swept ground to fly, in radii of what a place shows: that overlaps it.
_BEYOND = 0.8
#: What a metre further from the centre of the search is worth avoiding, in metres of way.
_PREFER_NEAR = 1.5
#: The ride: its radius in detectable radii, full after so many s of light; rad/s; 1/s of the way back to it.
_RIDE, _RIDE_S, _RATE, _GAIN = 0.3, 4.0, 1.0, 4.0
#: 1/s; velocity per metre left of the way to ground not seen yet.
_ARRIVE = 2.0


@kernel
def _sweep(w, x, y, c):
    """Velocity, m/s, to the ground not seen yet that is nearest: to the vehicle, and to the centre of the search."""
    fresh = True
    least = np.inf
    to_x = 0.0
    to_y = 0.0
    for k in range(SECTORS):
        if c.axes == 1 and k % (SECTORS // 2) != 0:
            continue
        fresh = fresh and w.swept[k] <= 0.0
        angle = 2.0 * np.pi * k / SECTORS
        reach = w.swept[k] + _BEYOND * c.sweep
        dx = w.search_x + reach * np.cos(angle) - x
        dy = w.search_y + reach * np.sin(angle) - y
        cost = np.sqrt(dx * dx + dy * dy) + _PREFER_NEAR * w.swept[k]
        if cost < least:
            least = cost
            to_x = dx
            to_y = dy
    if fresh:
        to_x = w.search_x - x
        to_y = w.search_y - y
    return shortened(_ARRIVE * to_x, _ARRIVE * to_y, c.max_speed)


@kernel
def _ride(w, x, y, c):
    """Velocity, m/s, beyond the light's: round the believed centre, at it while it was found only just now."""
    ex = x - w.center_x
    ey = y - w.center_y
    r = max(np.sqrt(ex * ex + ey * ey), 1e-6)
    radius = _RIDE * c.radius * min(max((w.time_s - w.edge_s) / _RIDE_S, 0.05), 1.0)
    along = _RATE * radius * min(r / (0.5 * radius), 1.0) / r
    back = _GAIN * (r - radius) / r
    return -along * ey - back * ex, along * ex - back * ey


@loop_kernel
def decide_all(worlds, patience, c, actions):
    """Actions, shares of the greatest speed, of all running worlds: ``actions`` (worlds, axes), written in place."""
    for k in range(worlds.size):
        w = worlds[k]
        if w.outcome != RUNNING:
            continue
        x = w.own_x - w.carried_x
        y = w.own_y - w.carried_y
        if w.light_s >= 0.0 and w.time_s - w.light_s < patience:
            u, v = _ride(w, x, y, c)
        else:
            u, v = _sweep(w, x, y, c)
        u, v = shortened(w.seen_u + u, 0.0 if c.axes == 1 else w.seen_v + v, c.max_speed)
        actions[k, 0] = u / c.max_speed
        if c.axes == 2:
            actions[k, 1] = v / c.max_speed


class MemoryTracking:
    """Acts on the memory that the world keeps of readings.

    ``patience``: s in the dark after which the search begins. Raises ``InvalidParameterError``.
    """

    information = (
        "own motion, readings, the first guess, the submerged vehicle's velocity as far as it is measured"
    )

    def __init__(self, batch: Any, *, patience: float = 2.0) -> None:
        require_continuous_actions(batch)
        check_range("patience", patience, 0.0, 1e6)
        self.batch = batch
        self.patience = float(patience)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: all that it knows is in the world's record."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, axes)."""
        actions = np.zeros((len(worlds), self.batch.action_spec.size))
        decide_all(worlds, self.patience, self.batch.constants, actions)
        return actions.astype(np.float32)

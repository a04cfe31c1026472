"""How vehicles of all tasks take off and lie on the water, compiled."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import flight_time, inside_box


@kernel
def judge_place(x, y, obstacle, ocean, c, afloat, collision, left_box):
    """Outcome of lying on the water at (x, y), without branches: one of the task's own codes, passed last."""
    struck = clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y) < 0.0
    outcome = collision if struck else afloat
    return outcome if inside_box(x, y, c.half_width) else left_box


@kernel
def take_off(action_x, action_y, c):
    """The hop that an action asks for: its duration, s, and velocity (u, v), m/s; zeros where it asks to drift."""
    norm = np.sqrt(action_x * action_x + action_y * action_y)
    if norm < c.drift_threshold or norm == 0.0:
        return 0.0, 0.0, 0.0
    duration = flight_time(c.max_hop * min(norm, 1.0), c.airspeed)
    return duration, c.airspeed * action_x / norm, c.airspeed * action_y / norm

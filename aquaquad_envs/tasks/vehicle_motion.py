"""How vehicles of all tasks lie on the water, hop and drift, compiled.

The decisions of most tasks are *synchronous*: a hop is followed by a drift for the rest of the period. (Those of
drift/hop are not; its drifts run over lanes of worlds.) Outcomes have other codes in every task: callers pass theirs.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step, flight_time, inside_box


@kernel
def judge_place(x, y, obstacle, ocean, c, afloat, collision, left_box):
    """Which of the three codes it is to lie on the water at (x, y), without branches."""
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


@kernel
def fly_and_drift(
    x, y, truth, obstacle, now, dt, flight_left, flight_u, flight_v, ocean, c, afloat, collision, left_box
):
    """Fly, drift, or first one and then the other, for ``dt`` s from (x, y) and field time ``now``.

    ``flight_left`` s of the flight at (flight_u, flight_v), m/s, remain; one that goes on after ``dt`` is over
    all. ``c.still_water``: drifting moves nothing. Returns the new (x, y), m, seconds flown and drifted (those
    after a collision on landing are neither), and the outcome (:func:`judge_place`).
    """
    flown_s = min(flight_left, dt)
    drifted_s = dt - flown_s
    outcome = afloat
    if flown_s > 0.0:
        x += flown_s * flight_u
        y += flown_s * flight_v
        if flown_s == flight_left:
            outcome = judge_place(x, y, obstacle, ocean, c, afloat, collision, left_box)
    if outcome != afloat:
        drifted_s = 0.0
    elif drifted_s > 0.0 and not c.still_water:
        x, y = drift_step(ocean.velocity, truth, ocean.axes, now + flown_s, x, y, drifted_s, c.euler)
        outcome = judge_place(x, y, obstacle, ocean, c, afloat, collision, left_box)
    return x, y, flown_s, drifted_s, outcome

"""How the vehicles of transponder localization move from one measurement to the next, compiled.

The yaw-rate vehicle and the greedy one go through the water, which carries them: their step is that in still water,
made after the drift of the whole period (they are apart by the change of current along one step). The aquaquad hops and
drifts as in sensor placement, on its battery.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.energy import balance, charge_between
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.physics.surface_vehicle import turn_and_go
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh
from aquaquad_envs.tasks.open_water import open_water_near
from aquaquad_envs.tasks.transponder_localization_data import (
    AQUAQUAD,
    BATTERY_EMPTY,
    COLLISION,
    LEFT_BOX,
    RUNNING,
    YAW_RATE,
)
from aquaquad_envs.tasks.vehicle_motion import fly_and_drift, take_off


@kernel
def own_step(x, y, heading, action_x, action_y, c):
    """Place, m, and heading, rad, after one period in still water, of the yaw-rate or the greedy vehicle.

    ``action_x`` in [-1, 1] is the yaw rate of the one; (action_x, action_y), in the unit disc, the step of the other.
    Actions beyond are shortened.
    """
    if c.vehicle == YAW_RATE:
        rate = c.yaw_limit * min(max(action_x, -1.0), 1.0)
        return turn_and_go(x, y, heading, rate, c.speed, c.period)
    norm = np.sqrt(action_x * action_x + action_y * action_y)
    scale = c.max_step / max(norm, 1.0)
    return x + scale * action_x, y + scale * action_y, heading


@kernel
def _live(w, charged, flown_s, duration, c):
    """Charge and spend for ``duration`` s, of which ``flown_s`` in flight; returns whether the battery is empty."""
    flown = flight_energy_wh(c.airspeed * flown_s, c.airspeed, c.flight_power)
    demanded = c.base_power * duration / 3600.0 + flown
    w.battery_wh, used, lost, empty = balance(w.battery_wh, c.capacity, charged, demanded)
    w.flight_wh += flown
    w.solar_wh += charged
    w.spent_wh += used
    w.clipped_wh += lost
    return empty


@kernel
def _hop_and_drift(w, action_x, action_y, ocean, c):
    """The aquaquad: hop, if the action asks for it, and drift for the rest of the period; ends where it is lost."""
    flight_left, flight_u, flight_v = take_off(action_x, action_y, c)
    w.hops += 1 if flight_left > 0.0 else 0
    dt = c.period / c.sub_steps
    began = w.clock_s + w.time_s
    for k in range(c.sub_steps):
        if w.outcome != RUNNING:
            break
        now = began + k * dt
        w.x, w.y, flown_s, drifted_s, w.outcome = fly_and_drift(
            w.x, w.y, w.truth, w.obstacle, now, dt, flight_left, flight_u, flight_v, ocean, c,
            RUNNING, COLLISION, LEFT_BOX,
        )  # fmt: skip
        flight_left -= flown_s
        w.flight_s += flown_s
        w.drift_s += drifted_s
        charged = charge_between(ocean.collected_wh, ocean.solar_step, now, now + dt)
        empty = _live(w, charged, flown_s, dt, c)
        if empty and w.outcome == RUNNING:
            w.outcome = BATTERY_EMPTY


@kernel
def move(w, action_x, action_y, ocean, c):
    """Move the vehicle of record ``w`` for one period; its clock goes on, and ``outcome`` tells whether it was lost."""
    if c.vehicle == AQUAQUAD:
        _hop_and_drift(w, action_x, action_y, ocean, c)
    else:
        x = w.x
        y = w.y
        if not c.still_water:
            now = w.clock_s + w.time_s
            x, y = drift_step(ocean.velocity, w.truth, ocean.axes, now, x, y, c.period, c.euler)
        w.x, w.y, w.heading = own_step(x, y, w.heading, action_x, action_y, c)
    w.time_s += c.period


@kernel
def start_vehicle(w, middle_x, middle_y, ocean, c):
    """Place the vehicle where it begins, given or drawn within ``spread`` of the middle, with a full life ahead."""
    if c.start_x == c.start_x:
        w.x = c.start_x
        w.y = c.start_y
    else:
        w.x, w.y = open_water_near(w.rng_initial, ocean, c, w.obstacle, middle_x, middle_y, c.spread)
    w.heading = 0.0
    if c.vehicle == YAW_RATE:
        given = c.start_heading == c.start_heading
        w.heading = c.start_heading if given else np.pi * (2.0 * uniform(w.rng_initial) - 1.0)
    w.start_x = w.x
    w.start_y = w.y
    w.battery_wh = c.capacity * c.initial_charge
    w.flight_wh = 0.0
    w.solar_wh = 0.0
    w.spent_wh = 0.0
    w.clipped_wh = 0.0
    w.drift_s = 0.0
    w.flight_s = 0.0
    w.hops = 0

"""How the vehicles of sensor placement hop, drift and live on their batteries, compiled.

The physics is that of drift/hop (:mod:`aquaquad_envs.physics.vehicle`, :mod:`aquaquad_envs.physics.energy`); only the
clock differs: decisions of a team are synchronous, so a hop is followed by a drift for the rest of the period.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.energy import balance
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh
from aquaquad_envs.tasks.open_water import open_water_near
from aquaquad_envs.tasks.sensor_placement_data import BATTERY_EMPTY, COLLISION, LEFT_BOX, RUNNING
from aquaquad_envs.tasks.vehicle_motion import judge_place, take_off

#: Vehicles start within this share of the half width, and this share of it clear of obstacles.
START_SHARE = 0.9
START_CLEARANCE = 0.02


@kernel
def _anywhere(w, share, ocean, c):
    """A point of open water within ``share`` of the half width; the scenario's start after 200 tries."""
    for _ in range(200):
        x = share * c.half_width * (2.0 * uniform(w.rng_initial) - 1.0)
        y = share * c.half_width * (2.0 * uniform(w.rng_initial) - 1.0)
        clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y)
        if clear > START_CLEARANCE * c.half_width:
            return x, y
    return ocean.scenarios[w.scenario].start_x, ocean.scenarios[w.scenario].start_y


@kernel
def start_vehicles(w, ocean, c):
    """Place the team: anywhere, or all in one disc."""
    middle_x = 0.0
    middle_y = 0.0
    if c.cluster_radius > 0.0:
        middle_x, middle_y = _anywhere(w, 0.7, ocean, c)
    for i in range(c.num_vehicles):
        if c.cluster_radius > 0.0:
            w.x[i], w.y[i] = open_water_near(
                w.rng_initial, ocean, c, w.obstacle, middle_x, middle_y, c.cluster_radius
            )
        else:
            w.x[i], w.y[i] = _anywhere(w, START_SHARE, ocean, c)
        w.start_x[i] = w.x[i]
        w.start_y[i] = w.y[i]
        w.battery_wh[i] = c.capacity * c.initial_charge
        w.on_water[i] = 1.0


@kernel
def begin_motion(w, i, action_x, action_y, s, c):
    """Turn the action of vehicle ``i`` into a flight: seconds left of it and its velocity."""
    if c.steered:
        scale = c.vehicle_speed / max(np.sqrt(action_x * action_x + action_y * action_y), 1.0)
        s.flight_left_s[i] = 0.0
        s.flight_u[i] = scale * action_x
        s.flight_v[i] = scale * action_y
    else:
        s.flight_left_s[i], s.flight_u[i], s.flight_v[i] = take_off(action_x, action_y, c)
        w.hops[i] += s.flight_left_s[i] > 0.0


@kernel
def _steer(w, i, dt, s, c):
    """Move at the velocity chosen, held at the box's edge."""
    w.x[i] = min(max(w.x[i] + dt * s.flight_u[i], -c.half_width), c.half_width)
    w.y[i] = min(max(w.y[i] + dt * s.flight_v[i], -c.half_width), c.half_width)
    w.drift_s[i] += dt


@kernel
def move_vehicle(w, i, now, dt, charged, ocean, c, s):
    """Fly, drift, or first one and then the other, for ``dt`` s from field time ``now``; and what becomes of it.

    ``charged``: Wh that the sun gives a vehicle meanwhile.
    """
    if c.steered:
        _steer(w, i, dt, s, c)
        return
    flying = min(s.flight_left_s[i], dt)
    outcome = RUNNING
    flown = 0.0
    if flying > 0.0:
        w.x[i] += flying * s.flight_u[i]
        w.y[i] += flying * s.flight_v[i]
        s.flight_left_s[i] -= flying
        w.flight_s[i] += flying
        flown = flight_energy_wh(c.airspeed * flying, c.airspeed, c.flight_power)
        w.flight_wh[i] += flown
        s.flown_wh += flown
        if s.flight_left_s[i] == 0.0:
            outcome = judge_place(w.x[i], w.y[i], w.obstacle, ocean, c, RUNNING, COLLISION, LEFT_BOX)
    drifting = dt - flying
    if drifting > 0.0 and outcome == RUNNING:
        if not c.still_water:
            w.x[i], w.y[i] = drift_step(
                ocean.velocity, w.truth, ocean.axes, now + flying, w.x[i], w.y[i], drifting, c.euler
            )
            outcome = judge_place(w.x[i], w.y[i], w.obstacle, ocean, c, RUNNING, COLLISION, LEFT_BOX)
        w.drift_s[i] += drifting
    demanded = c.base_power * dt / 3600.0 + flown
    w.battery_wh[i], used, lost, empty = balance(w.battery_wh[i], c.capacity, charged, demanded)
    w.solar_wh[i] += charged
    w.spent_wh[i] += used
    w.clipped_wh[i] += lost
    if empty and outcome == RUNNING:
        outcome = BATTERY_EMPTY
    if outcome != RUNNING:
        w.agent_outcome[i] = outcome
        s.died += 1

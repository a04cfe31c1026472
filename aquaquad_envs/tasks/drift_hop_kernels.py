"""Compiled drift/hop worlds: reset and step, over lanes of worlds.

Drifts and observations, the costly parts, run over the lanes of many worlds at once (SIMD); hops and
rewards run world by world. Every lane is computed as if it were alone, so results do not depend on which
worlds share the lanes, on the batch or on the threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.physics.energy import balance, charge_between
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.physics.vehicle import (
    current_after,
    flight_energy_wh,
    flight_time,
    runge_kutta,
)
from aquaquad_envs.tasks.drift_hop_observation import FLOAT_ROWS, INT_ROWS, hdop_of, observe_members
from aquaquad_envs.tasks.ocean import draw_clock, draw_scenario
from aquaquad_envs.tasks.open_water import open_water_near
from aquaquad_envs.tasks.vehicle_motion import judge_place

#: Energy unit of the reward, Wh.
REWARD_UNIT_WH = 10.0

OUTCOMES = ("running", "goal", "collision", "left box", "battery empty", "time out")
RUNNING, GOAL, COLLISION, LEFT_BOX, BATTERY_EMPTY, TIME_OUT = range(6)

REWARD_TERMS = ("flight", "progress", "arrival", "failure")


class Constants(NamedTuple):
    """The parameters as kernels read them (units as in ``drift_hop.Params``)."""

    half_width: float
    horizon: float
    action_period: float
    sub_steps: int
    euler: bool
    goal_radius: float
    max_hop: float
    airspeed: float
    drift_threshold: float
    flight_power: float
    base_power: float
    capacity: float
    initial_charge: float
    start_time_spread: float
    clock_offset: float  # s of local solar time at clock 0
    team: np.ndarray  # (n, 2) m
    target_dx: float
    target_dy: float
    current_noise: float
    start_anywhere: float
    progress_weight: float
    arrival_bonus: float
    failure_penalty: float


@kernel
def reset_world(w, ocean, c):
    """Draw a new episode into record ``w``: scenario, start, goal, clock; the streams go on."""
    draw_scenario(w, ocean)
    scenario = ocean.scenarios[w.scenario]
    w.goal_x, w.goal_y = open_water_near(
        w.rng_initial, ocean, c, w.obstacle, scenario.goal_x, scenario.goal_y, scenario.goal_spread
    )
    w.x, w.y = open_water_near(
        w.rng_initial, ocean, c, w.obstacle, scenario.start_x, scenario.start_y, scenario.start_spread
    )
    if c.start_anywhere > 0.0 and uniform(w.rng_initial) < c.start_anywhere:
        for _ in range(100):
            x = (2.0 * uniform(w.rng_initial) - 1.0) * c.half_width
            y = (2.0 * uniform(w.rng_initial) - 1.0) * c.half_width
            if _judge(x, y, w.goal_x, w.goal_y, w.obstacle, ocean, c) == RUNNING:
                w.x = x
                w.y = y
                break
    w.start_x = w.x
    w.start_y = w.y
    draw_clock(w, c)
    w.battery_wh = c.capacity * c.initial_charge
    w.flight_wh = 0.0
    w.solar_wh = 0.0
    w.spent_wh = 0.0
    w.clipped_wh = 0.0
    w.drift_s = 0.0
    w.flight_s = 0.0
    w.hdop_s = 0.0
    w.hops = 0
    w.steps = 0
    w.outcome = RUNNING


@kernel
def _judge(x, y, goal_x, goal_y, obstacle, ocean, c):
    """Outcome of lying on the water at (x, y), without branches."""
    dx = goal_x - x
    dy = goal_y - y
    afloat = GOAL if dx * dx + dy * dy <= c.goal_radius * c.goal_radius else RUNNING
    return judge_place(x, y, obstacle, ocean, c, afloat, COLLISION, LEFT_BOX)


#: Worlds that are advanced and observed at once; scratch memory then stays in the first-level cache.
LANES = 64
# Rows of the drift's scratch memory, one lane a world.
_X, _Y, _NOW, _BATTERY, _SOLAR, _SPENT, _CLIPPED, _GOAL_X, _GOAL_Y, _NEW_X, _NEW_Y, _REST, _U, _V = range(14)
# Four stages' currents: _U, _V, _U + 2, _V + 2, ...
_DRIFT_ROWS = _U + 8
_TRUTH, _OBSTACLE, _OUTCOME = range(3)


@lane_kernel
def _current_lanes(x, y, now, truth, h, u, v, new_u, new_v, ocean):
    """Current met after moving for ``h`` s at (u, v), in every lane: one stage of Runge and Kutta."""
    for i in range(x.size):
        new_u[i], new_v[i] = current_after(
            ocean.velocity, truth[i], ocean.axes, now[i], x[i], y[i], h, u[i], v[i]
        )


@lane_kernel
def _move_lanes(x, k1, k2, k3, k4, new_x, dt, euler):
    """One coordinate after a step of ``dt`` s, in every lane."""
    for i in range(x.size):
        new_x[i] = x[i] + dt * k1[i] if euler else runge_kutta(x[i], dt, k1[i], k2[i], k3[i], k4[i])


@lane_kernel
def _settle_lanes(
    x, y, new_x, new_y, now, battery, solar, spent, clipped, goal_x, goal_y, obstacle, outcome, ocean, c, dt
):
    """Energy and outcome of a drift of ``dt`` s from (x, y) to the new place, in every lane that is RUNNING."""
    demanded = c.base_power * dt / 3600.0
    for i in range(x.size):
        run = outcome[i] == RUNNING
        charged = charge_between(ocean.collected_wh, ocean.solar_step, now[i], now[i] + dt)
        stored, used, lost, empty = balance(battery[i], c.capacity, charged, demanded)
        judged = _judge(new_x[i], new_y[i], goal_x[i], goal_y[i], obstacle[i], ocean, c)
        judged = BATTERY_EMPTY if empty and judged == RUNNING else judged
        x[i] = new_x[i] if run else x[i]
        y[i] = new_y[i] if run else y[i]
        now[i] = now[i] + dt if run else now[i]
        battery[i] = stored if run else battery[i]
        solar[i] = solar[i] + charged if run else solar[i]
        spent[i] = spent[i] + used if run else spent[i]
        clipped[i] = clipped[i] + lost if run else clipped[i]
        outcome[i] = judged if run else outcome[i]


@loop_kernel
def _drift(worlds, members, rows, fields, ocean, c):
    """Drift ``worlds[members]`` for one action period; as many as there are lanes at most."""
    n = members.size
    for i in range(n):
        w = worlds[members[i]]
        rows[_X, i] = w.x
        rows[_Y, i] = w.y
        rows[_NOW, i] = w.clock_s + w.time_s
        rows[_BATTERY, i] = w.battery_wh
        rows[_SOLAR, i] = 0.0
        rows[_SPENT, i] = 0.0
        rows[_CLIPPED, i] = 0.0
        rows[_GOAL_X, i] = w.goal_x
        rows[_GOAL_Y, i] = w.goal_y
        fields[_TRUTH, i] = w.truth
        fields[_OBSTACLE, i] = w.obstacle
        fields[_OUTCOME, i] = RUNNING
    x, y, now, truth = rows[_X, :n], rows[_Y, :n], rows[_NOW, :n], fields[_TRUTH, :n]
    new_x, new_y, rest = rows[_NEW_X, :n], rows[_NEW_Y, :n], rows[_REST, :n]
    u1, v1, u2, v2 = rows[_U, :n], rows[_V, :n], rows[_U + 2, :n], rows[_V + 2, :n]
    u3, v3, u4, v4 = rows[_U + 4, :n], rows[_V + 4, :n], rows[_U + 6, :n], rows[_V + 6, :n]
    rest[:] = 0.0
    dt = c.action_period / c.sub_steps
    for _ in range(c.sub_steps):
        # As drift_step has it; a loop for every stage, since one over all four runs out of registers.
        _current_lanes(x, y, now, truth, 0.0, rest, rest, u1, v1, ocean)
        if not c.euler:
            _current_lanes(x, y, now, truth, 0.5 * dt, u1, v1, u2, v2, ocean)
            _current_lanes(x, y, now, truth, 0.5 * dt, u2, v2, u3, v3, ocean)
            _current_lanes(x, y, now, truth, dt, u3, v3, u4, v4, ocean)
        _move_lanes(x, u1, u2, u3, u4, new_x, dt, c.euler)
        _move_lanes(y, v1, v2, v3, v4, new_y, dt, c.euler)
        _settle_lanes(
            x, y, new_x, new_y, now, rows[_BATTERY, :n], rows[_SOLAR, :n], rows[_SPENT, :n], rows[_CLIPPED, :n],
            rows[_GOAL_X, :n], rows[_GOAL_Y, :n], fields[_OBSTACLE, :n], fields[_OUTCOME, :n], ocean, c, dt,
        )  # fmt: skip
    for i in range(n):
        w = worlds[members[i]]
        duration = rows[_NOW, i] - (w.clock_s + w.time_s)
        w.x = rows[_X, i]
        w.y = rows[_Y, i]
        w.battery_wh = rows[_BATTERY, i]
        w.solar_wh += rows[_SOLAR, i]
        w.spent_wh += rows[_SPENT, i]
        w.clipped_wh += rows[_CLIPPED, i]
        w.time_s += duration
        w.drift_s += duration
        w.outcome = fields[_OUTCOME, i]


@kernel
def _hop(w, action_x, action_y, norm, ocean, c):
    """Fly the hop and land; returns the energy flown, Wh."""
    length = c.max_hop * min(norm, 1.0)
    w.x += length * action_x / norm
    w.y += length * action_y / norm
    duration = flight_time(length, c.airspeed)
    now = w.clock_s + w.time_s
    charged = charge_between(ocean.collected_wh, ocean.solar_step, now, now + duration)
    demanded = (c.base_power + c.flight_power) * duration / 3600.0
    w.battery_wh, used, lost, empty = balance(w.battery_wh, c.capacity, charged, demanded)
    w.solar_wh += charged
    w.spent_wh += used
    w.clipped_wh += lost
    w.time_s += duration
    w.flight_s += duration
    w.hops += 1
    w.outcome = BATTERY_EMPTY if empty else _judge(w.x, w.y, w.goal_x, w.goal_y, w.obstacle, ocean, c)
    flown = flight_energy_wh(length, c.airspeed, c.flight_power)
    w.flight_wh += flown
    return flown


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    rows = np.empty((FLOAT_ROWS, LANES))
    fields = np.empty((INT_ROWS, LANES), dtype=np.int64)
    members = np.empty(LANES, dtype=np.int64)
    n = 0
    for i in range(worlds.size):
        if mask[i]:
            reset_world(worlds[i], ocean, c)
            members[n] = i
            n += 1
        if n == LANES or (n > 0 and i == worlds.size - 1):
            observe_members(worlds, members[:n], observations, rows, fields, ocean, c)
            n = 0


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one decision: hop, or drift for one action period.

    Writes observations, rewards and their terms (flight, progress, arrival, failure; SPEC and
    docs/drift_hop.md), terminated and truncated. A finished world stays as it is, at no reward.
    """
    rows = np.empty((max(FLOAT_ROWS, _DRIFT_ROWS), LANES))
    fields = np.empty((INT_ROWS, LANES), dtype=np.int64)
    before = np.empty((4, LANES))
    members = np.empty(LANES, dtype=np.int64)
    drifting = np.empty(LANES, dtype=np.int64)
    first = 0
    while first < worlds.size:
        # The next running worlds, as many as there are lanes.
        n = 0
        drifts = 0
        while first < worlds.size and n < LANES:
            w = worlds[first]
            if w.outcome == RUNNING:
                before[0, n] = np.sqrt((w.goal_x - w.x) ** 2 + (w.goal_y - w.y) ** 2)
                before[1, n] = hdop_of(w, c)
                before[2, n] = w.time_s
                before[3, n] = 0.0
                action_x = actions[first, 0]
                action_y = actions[first, 1]
                norm = np.sqrt(action_x * action_x + action_y * action_y)
                if norm < c.drift_threshold or norm == 0.0:
                    drifting[drifts] = first
                    drifts += 1
                else:
                    before[3, n] = _hop(w, action_x, action_y, norm, ocean, c)
                members[n] = first
                n += 1
            else:
                terms[first, :] = 0.0
                rewards[first] = 0.0
                truncated[first] = w.outcome == TIME_OUT
                terminated[first] = w.outcome != TIME_OUT
            first += 1
        if drifts > 0:
            _drift(worlds, drifting[:drifts], rows, fields, ocean, c)
        for i in range(n):
            k = members[i]
            w = worlds[k]
            w.hdop_s += before[1, i] * (w.time_s - before[2, i])
            w.steps += 1
            # A microsecond of grace: rounding of the clock must not add a decision.
            if w.outcome == RUNNING and w.time_s >= c.horizon - 1e-6:
                w.outcome = TIME_OUT
            after = np.sqrt((w.goal_x - w.x) ** 2 + (w.goal_y - w.y) ** 2)
            gained = flight_energy_wh(before[0, i] - after, c.airspeed, c.flight_power)
            term = terms[k]
            term[0] = -before[3, i] / REWARD_UNIT_WH
            term[1] = c.progress_weight * gained / REWARD_UNIT_WH
            term[2] = c.arrival_bonus if w.outcome == GOAL else 0.0
            failed = w.outcome != RUNNING and w.outcome != GOAL and w.outcome != TIME_OUT
            term[3] = -c.failure_penalty if failed else 0.0
            rewards[k] = term[0] + term[1] + term[2] + term[3]
            truncated[k] = w.outcome == TIME_OUT
            terminated[k] = w.outcome != RUNNING and w.outcome != TIME_OUT
        if n > 0:
            observe_members(worlds, members[:n], observations, rows, fields, ocean, c)

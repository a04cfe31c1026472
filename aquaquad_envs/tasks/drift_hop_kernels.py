"""Compiled drift/hop worlds: reset, step and observe, over blocks of worlds.

Worlds are advanced in blocks. A drift, the costly part, runs over the lanes of a block at once
(SIMD); hops, rewards and observations run world by world. Every lane is computed as if it
were alone, so results do not depend on the block, the batch or the threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.estimation.hdop import bearing_hdop
from aquaquad_envs.physics.currents import CurrentAxes, current_at
from aquaquad_envs.physics.energy import balance, charge_between
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import clearance_at, nearest_direction
from aquaquad_envs.physics.randomness import normal, uniform, uniform_in_disc
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh, flight_time, inside_box

#: Greatest HDOP that the published cost assumes, m/rad; stands for singular geometry.
MAX_HDOP = 9000.0
#: Speed that scales current observations, m/s.
CURRENT_SCALE = 2.0
#: Energy unit of the reward, Wh.
REWARD_UNIT_WH = 10.0

OUTCOMES = ("running", "goal", "collision", "left box", "battery empty", "time out")
RUNNING, GOAL, COLLISION, LEFT_BOX, BATTERY_EMPTY, TIME_OUT = range(6)

REWARD_TERMS = ("flight", "progress", "arrival", "failure")
#: Hours ahead at which the forecast drift is observed, and its integration step.
AHEAD_H = (1, 2, 4)
AHEAD_STEP_S = 1200.0
_HEADINGS = np.stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)], -1)

OBSERVATION_NAMES = (
    "x", "y", "goal dx", "goal dy", "goal distance", "goal direction x", "goal direction y",
    "battery", "sin local time", "cos local time", "time left", "current u", "current v",
    "obstacle distance", "obstacle direction x", "obstacle direction y", "HDOP",
    "forecast u", "forecast v",
    *(f"drift {axis} in {hours} h" for hours in AHEAD_H for axis in ("dx", "dy")),
    *(f"{what} {45 * i}°" for i in range(8) for what in ("forecast u", "forecast v", "obstacle distance")),
)  # fmt: skip


class Ocean(NamedTuple):
    """Everything immutable that kernels and planners read: currents, obstacles, sun, team."""

    velocity: np.ndarray  # (F, T, rows, columns, 2) m/s
    axes: CurrentAxes
    clearance: np.ndarray  # (O, rows, columns) m
    clearance_grid: Grid
    scenarios: np.ndarray  # records of SCENARIO_RECORD
    collected_wh: np.ndarray  # (n,) Wh since the clock's start
    solar_step: float  # s
    team: np.ndarray  # (n, 2) m


class Constants(NamedTuple):
    """Scalars of the parameters as kernels read them (units as in ``drift_hop.Params``)."""

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
    k = int(uniform(w.rng_field) * ocean.scenarios.size)
    scenario = ocean.scenarios[k]
    w.scenario = k
    w.truth = scenario.truth
    w.forecast = scenario.forecast
    w.obstacle = scenario.obstacle
    w.goal_x, w.goal_y = _open_water_near(
        w.rng_initial, ocean, c, w.obstacle, scenario.goal_x, scenario.goal_y, scenario.goal_spread
    )
    w.x, w.y = _open_water_near(
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
    w.time_s = 0.0
    w.clock_s = c.start_time_spread * uniform(w.rng_initial) if c.start_time_spread > 0.0 else 0.0
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
def _open_water_near(state, ocean, c, obstacle, x0, y0, spread):
    """A point within ``spread`` of (x0, y0), in the box and in open water; (x0, y0) after 100 tries."""
    if spread <= 0.0:
        return x0, y0
    for _ in range(100):
        dx, dy = uniform_in_disc(state)
        x, y = x0 + spread * dx, y0 + spread * dy
        clear = clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y) > 0.0
        if clear and inside_box(x, y, c.half_width):
            return x, y
    return x0, y0


@kernel
def _judge(x, y, goal_x, goal_y, obstacle, ocean, c):
    """Outcome of lying on the water at (x, y), without branches."""
    dx = goal_x - x
    dy = goal_y - y
    outcome = GOAL if dx * dx + dy * dy <= c.goal_radius * c.goal_radius else RUNNING
    struck = clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y) < 0.0
    outcome = COLLISION if struck else outcome
    return outcome if inside_box(x, y, c.half_width) else LEFT_BOX


@kernel
def hdop_of(w, ocean, c):
    """Bearing HDOP, m/rad, of the vehicle and the team about the target; at most MAX_HDOP, 0 without a team."""
    if ocean.team.shape[0] == 0:
        return 0.0
    return min(bearing_hdop(w.x, w.y, ocean.team, w.goal_x + c.target_dx, w.goal_y + c.target_dy), MAX_HDOP)


# Rows of a block's scratch memory, one lane a world.
_X, _Y, _NOW, _BATTERY, _SOLAR, _SPENT, _CLIPPED, _GOAL_X, _GOAL_Y, _AHEAD = range(10)
_PATCH = _AHEAD + 2 * len(AHEAD_H)
_FLOAT_ROWS = _PATCH + 3 * len(_HEADINGS)
_TRUTH, _FORECAST, _OBSTACLE, _OUTCOME = range(4)
_INT_ROWS = 4
#: Worlds a block; scratch memory then stays in the first-level cache.
BLOCK = 64


@lane_kernel
def _drift_lanes(
    x, y, now, battery, solar, spent, clipped, goal_x, goal_y, truth, obstacle, outcome, ocean, c, dt
):
    """One drift sub-step of ``dt`` s in every lane whose outcome is RUNNING."""
    demanded = c.base_power * dt / 3600.0
    for i in range(x.size):
        run = outcome[i] == RUNNING
        new_x, new_y = drift_step(ocean.velocity, truth[i], ocean.axes, now[i], x[i], y[i], dt, c.euler)
        charged = charge_between(ocean.collected_wh, ocean.solar_step, now[i], now[i] + dt)
        stored, used, lost, empty = balance(battery[i], c.capacity, charged, demanded)
        judged = _judge(new_x, new_y, goal_x[i], goal_y[i], obstacle[i], ocean, c)
        judged = BATTERY_EMPTY if empty and judged == RUNNING else judged
        x[i] = new_x if run else x[i]
        y[i] = new_y if run else y[i]
        now[i] = now[i] + dt if run else now[i]
        battery[i] = stored if run else battery[i]
        solar[i] = solar[i] + charged if run else solar[i]
        spent[i] = spent[i] + used if run else spent[i]
        clipped[i] = clipped[i] + lost if run else clipped[i]
        outcome[i] = judged if run else outcome[i]


@lane_kernel
def _forecast_lanes(x, y, now, forecast, ocean, dt):
    """One Euler step of the forecast drift in every lane."""
    for i in range(x.size):
        x[i], y[i] = drift_step(ocean.velocity, forecast[i], ocean.axes, now[i], x[i], y[i], dt, True)
        now[i] = now[i] + dt


@lane_kernel
def _patch_lanes(x, y, now, forecast, obstacle, u, v, clear, dx, dy, ocean):
    """Forecast current and clearance at (x + dx, y + dy) in every lane."""
    for i in range(x.size):
        u[i], v[i] = current_at(ocean.velocity, forecast[i], ocean.axes, now[i], x[i] + dx, y[i] + dy)
        clear[i] = clearance_at(ocean.clearance, obstacle[i], ocean.clearance_grid, x[i] + dx, y[i] + dy)


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
def _drift_block(worlds, drifting, lanes, indices, ocean, c):
    """Drift the worlds of a block whose ``drifting`` is true for one action period."""
    n = worlds.size
    for i in range(n):
        w = worlds[i]
        lanes[_X, i] = w.x
        lanes[_Y, i] = w.y
        lanes[_NOW, i] = w.clock_s + w.time_s
        lanes[_BATTERY, i] = w.battery_wh
        lanes[_SOLAR, i] = 0.0
        lanes[_SPENT, i] = 0.0
        lanes[_CLIPPED, i] = 0.0
        lanes[_GOAL_X, i] = w.goal_x
        lanes[_GOAL_Y, i] = w.goal_y
        indices[_TRUTH, i] = w.truth
        indices[_OBSTACLE, i] = w.obstacle
        # A lane that does not drift is held by an outcome that is not RUNNING.
        indices[_OUTCOME, i] = RUNNING if drifting[i] else TIME_OUT
    dt = c.action_period / c.sub_steps
    for _ in range(c.sub_steps):
        _drift_lanes(
            lanes[_X, :n], lanes[_Y, :n], lanes[_NOW, :n], lanes[_BATTERY, :n], lanes[_SOLAR, :n],
            lanes[_SPENT, :n], lanes[_CLIPPED, :n], lanes[_GOAL_X, :n], lanes[_GOAL_Y, :n],
            indices[_TRUTH, :n], indices[_OBSTACLE, :n], indices[_OUTCOME, :n], ocean, c, dt,
        )  # fmt: skip
    for i in range(n):
        if drifting[i]:
            w = worlds[i]
            duration = lanes[_NOW, i] - (w.clock_s + w.time_s)
            w.x = lanes[_X, i]
            w.y = lanes[_Y, i]
            w.battery_wh = lanes[_BATTERY, i]
            w.solar_wh += lanes[_SOLAR, i]
            w.spent_wh += lanes[_SPENT, i]
            w.clipped_wh += lanes[_CLIPPED, i]
            w.time_s += duration
            w.drift_s += duration
            w.outcome = indices[_OUTCOME, i]


@loop_kernel
def _observe_block(worlds, chosen, observations, lanes, indices, ocean, c):
    """Write the observations of the worlds of a block whose ``chosen`` is true, all within [-1, 1]."""
    n = worlds.size
    for i in range(n):
        lanes[_X, i] = worlds[i].x
        lanes[_Y, i] = worlds[i].y
        lanes[_NOW, i] = worlds[i].clock_s + worlds[i].time_s
        indices[_FORECAST, i] = worlds[i].forecast
        indices[_OBSTACLE, i] = worlds[i].obstacle
    for k in range(len(_HEADINGS)):
        row = _PATCH + 3 * k
        _patch_lanes(
            lanes[_X, :n], lanes[_Y, :n], lanes[_NOW, :n], indices[_FORECAST, :n], indices[_OBSTACLE, :n],
            lanes[row, :n], lanes[row + 1, :n], lanes[row + 2, :n],
            c.max_hop * _HEADINGS[k, 0], c.max_hop * _HEADINGS[k, 1], ocean,
        )  # fmt: skip
    hours = 0
    for k in range(len(AHEAD_H)):
        for _ in range(int((AHEAD_H[k] - hours) * 3600.0 / AHEAD_STEP_S)):
            _forecast_lanes(
                lanes[_X, :n], lanes[_Y, :n], lanes[_NOW, :n], indices[_FORECAST, :n], ocean, AHEAD_STEP_S
            )
        hours = AHEAD_H[k]
        lanes[_AHEAD + 2 * k, :n] = lanes[_X, :n]
        lanes[_AHEAD + 2 * k + 1, :n] = lanes[_Y, :n]
    for i in range(n):
        if chosen[i]:
            _observe(worlds[i], lanes[:, i], observations[i], ocean, c)


@kernel
def _unit(value):
    return min(max(value, -1.0), 1.0)


@kernel
def _observe(w, lane, out, ocean, c):
    goal_x = w.goal_x - w.x
    goal_y = w.goal_y - w.y
    distance = np.sqrt(goal_x * goal_x + goal_y * goal_y)
    now = w.clock_s + w.time_s
    angle = 2.0 * np.pi * (now + c.clock_offset) / 86400.0
    u, v = current_at(ocean.velocity, w.truth, ocean.axes, now, w.x, w.y)
    forecast_u, forecast_v = current_at(ocean.velocity, w.forecast, ocean.axes, now, w.x, w.y)
    if c.current_noise > 0.0:
        u += c.current_noise * normal(w.rng_sensor)
        v += c.current_noise * normal(w.rng_sensor)
    near_x, near_y = nearest_direction(ocean.clearance, w.obstacle, ocean.clearance_grid, w.x, w.y)
    clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, w.x, w.y)
    out[0] = _unit(w.x / c.half_width)
    out[1] = _unit(w.y / c.half_width)
    out[2] = _unit(goal_x / (2.0 * c.half_width))
    out[3] = _unit(goal_y / (2.0 * c.half_width))
    out[4] = _unit(distance / (3.0 * c.half_width))
    out[5] = _unit(goal_x / max(distance, 1e-9))
    out[6] = _unit(goal_y / max(distance, 1e-9))
    out[7] = _unit(w.battery_wh / c.capacity)
    out[8] = _unit(np.sin(angle))
    out[9] = _unit(np.cos(angle))
    out[10] = _unit(1.0 - w.time_s / c.horizon)
    out[11] = _unit(u / CURRENT_SCALE)
    out[12] = _unit(v / CURRENT_SCALE)
    out[13] = _unit(clear / c.half_width)
    out[14] = _unit(near_x)
    out[15] = _unit(near_y)
    out[16] = _unit(hdop_of(w, ocean, c) / MAX_HDOP)
    out[17] = _unit(forecast_u / CURRENT_SCALE)
    out[18] = _unit(forecast_v / CURRENT_SCALE)
    i = 19
    for k in range(len(AHEAD_H)):
        out[i] = _unit((lane[_AHEAD + 2 * k] - w.x) / c.half_width)
        out[i + 1] = _unit((lane[_AHEAD + 2 * k + 1] - w.y) / c.half_width)
        i += 2
    for k in range(len(_HEADINGS)):
        row = _PATCH + 3 * k
        out[i] = _unit(lane[row] / CURRENT_SCALE)
        out[i + 1] = _unit(lane[row + 1] / CURRENT_SCALE)
        out[i + 2] = _unit(lane[row + 2] / c.half_width)
        i += 3


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    lanes = np.empty((_FLOAT_ROWS, BLOCK))
    indices = np.empty((_INT_ROWS, BLOCK), dtype=np.int64)
    for first in range(0, worlds.size, BLOCK):
        last = min(first + BLOCK, worlds.size)
        any_chosen = False
        for i in range(first, last):
            if mask[i]:
                reset_world(worlds[i], ocean, c)
                any_chosen = True
        if any_chosen:
            _observe_block(
                worlds[first:last], mask[first:last], observations[first:last], lanes, indices, ocean, c
            )


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one decision: hop, or drift for one action period.

    Writes observations, rewards and their terms (flight, progress, arrival, failure; SPEC and
    docs/drift_hop.md), terminated and truncated. A finished world stays as it is, at no reward.
    """
    lanes = np.empty((_FLOAT_ROWS, BLOCK))
    indices = np.empty((_INT_ROWS, BLOCK), dtype=np.int64)
    before = np.empty((4, BLOCK))
    drifting = np.empty(BLOCK, dtype=np.bool_)
    running = np.empty(BLOCK, dtype=np.bool_)
    for first in range(0, worlds.size, BLOCK):
        last = min(first + BLOCK, worlds.size)
        n = last - first
        any_drift = False
        for i in range(n):
            w = worlds[first + i]
            running[i] = w.outcome == RUNNING
            drifting[i] = False
            if running[i]:
                before[0, i] = np.sqrt((w.goal_x - w.x) ** 2 + (w.goal_y - w.y) ** 2)
                before[1, i] = hdop_of(w, ocean, c)
                before[2, i] = w.time_s
                before[3, i] = 0.0
                action_x = actions[first + i, 0]
                action_y = actions[first + i, 1]
                norm = np.sqrt(action_x * action_x + action_y * action_y)
                drifting[i] = norm < c.drift_threshold or norm == 0.0
                any_drift |= drifting[i]
                if not drifting[i]:
                    before[3, i] = _hop(w, action_x, action_y, norm, ocean, c)
        if any_drift:
            _drift_block(worlds[first:last], drifting, lanes, indices, ocean, c)
        for i in range(n):
            w = worlds[first + i]
            term = terms[first + i]
            term[:] = 0.0
            if running[i]:
                w.hdop_s += before[1, i] * (w.time_s - before[2, i])
                w.steps += 1
                # A microsecond of grace: rounding of the clock must not add a decision.
                if w.outcome == RUNNING and w.time_s >= c.horizon - 1e-6:
                    w.outcome = TIME_OUT
                after = np.sqrt((w.goal_x - w.x) ** 2 + (w.goal_y - w.y) ** 2)
                gained = flight_energy_wh(before[0, i] - after, c.airspeed, c.flight_power)
                term[0] = -before[3, i] / REWARD_UNIT_WH
                term[1] = c.progress_weight * gained / REWARD_UNIT_WH
                if w.outcome == GOAL:
                    term[2] = c.arrival_bonus
                elif w.outcome != RUNNING and w.outcome != TIME_OUT:
                    term[3] = -c.failure_penalty
            rewards[first + i] = term[0] + term[1] + term[2] + term[3]
            truncated[first + i] = w.outcome == TIME_OUT
            terminated[first + i] = w.outcome != RUNNING and w.outcome != TIME_OUT
        _observe_block(worlds[first:last], running, observations[first:last], lanes, indices, ocean, c)

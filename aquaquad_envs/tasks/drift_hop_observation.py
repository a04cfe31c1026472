"""What a drift/hop vehicle observes: compiled, one observation a lane.

Rows of scratch memory stand in the order of :data:`OBSERVATION_NAMES`; they are filled lane by lane
(SIMD) and turned into one row of the batch a world at the end.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.estimation.hdop import bearing_hdop
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.obstacles import clearance_at, nearest_direction
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.physics.vehicle import drift_step
from aquaquad_envs.tasks.observing import CURRENT_SCALE, local_time, unit

#: Greatest HDOP that the published cost assumes, m/rad; stands for singular geometry.
MAX_HDOP = 9000.0
#: Hours ahead at which the forecast drift is observed, and its integration step, s.
AHEAD_H = (1, 2, 4)
AHEAD_STEP_S = 1200.0
#: Landing places of a full hop that are observed: headings from the goal's direction, anticlockwise.
HEADINGS_DEG = tuple(range(0, 360, 45))
_COS = np.cos(np.radians(HEADINGS_DEG))
_SIN = np.sin(np.radians(HEADINGS_DEG))

OBSERVATION_NAMES = (
    "x", "y", "goal dx", "goal dy", "goal distance", "goal direction x", "goal direction y",
    "goal hop x", "goal hop y", "battery", "sin local time", "cos local time", "time left",
    "current u", "current v", "obstacle distance", "obstacle direction x", "obstacle direction y",
    "HDOP", "forecast u", "forecast v",
    *(f"drift {axis} in {hours} h" for hours in AHEAD_H for axis in ("dx", "dy")),
    *(f"{what} {heading}°" for heading in HEADINGS_DEG
      for what in ("forecast u", "forecast v", "obstacle distance", "obstacle distance half-way")),
)  # fmt: skip

_GOAL_DX, _GOAL_X, _GOAL_Y, _BATTERY, _CURRENT, _CLEAR, _HDOP, _FORECAST = 2, 5, 6, 9, 13, 15, 18, 19
_AHEAD = 21
_RING = _AHEAD + 2 * len(AHEAD_H)
ROWS = len(OBSERVATION_NAMES)
# Scratch rows behind the observation itself: position, goal and clock, which lanes work on.
_X, _Y, _GX, _GY, _NOW = range(ROWS, ROWS + 5)
FLOAT_ROWS = ROWS + 5
_TRUE_FIELD, _FORECAST_FIELD, _OBSTACLE = range(3)
INT_ROWS = 3


@kernel
def hdop_of(w, c):
    """Bearing HDOP, m/rad, of the vehicle and the team about the target; at most MAX_HDOP, 0 without a team."""
    if c.team.shape[0] == 0:
        return 0.0
    return min(bearing_hdop(w.x, w.y, c.team, w.goal_x + c.target_dx, w.goal_y + c.target_dy), MAX_HDOP)


@lane_kernel
def _place_lanes(x, y, gx, gy, px, py, dx, dy, distance, ux, uy, hop_x, hop_y, c):
    """Own place and the goal's, in every lane."""
    for i in range(x.size):
        px[i] = unit(x[i] / c.half_width)
        py[i] = unit(y[i] / c.half_width)
        away_x = gx[i] - x[i]
        away_y = gy[i] - y[i]
        away = np.sqrt(away_x * away_x + away_y * away_y)
        dx[i] = unit(away_x / (2.0 * c.half_width))
        dy[i] = unit(away_y / (2.0 * c.half_width))
        distance[i] = unit(away / (3.0 * c.half_width))
        nonzero = away if away > 1e-9 else 1e-9
        ux[i] = unit(away_x / nonzero)
        uy[i] = unit(away_y / nonzero)
        hops = away / c.max_hop if away < c.max_hop else 1.0
        hop_x[i] = unit(hops * away_x / nonzero)
        hop_y[i] = unit(hops * away_y / nonzero)


@lane_kernel
def _here_lanes(x, y, now, true_field, forecast, obstacle, u, v, clear, near_x, near_y, fu, fv, ocean, c):
    """Current (m/s), forecast and obstacles at the vehicle, in every lane."""
    for i in range(x.size):
        u[i], v[i] = current_at(ocean.velocity, true_field[i], ocean.axes, now[i], x[i], y[i])
        a, b = current_at(ocean.velocity, forecast[i], ocean.axes, now[i], x[i], y[i])
        fu[i] = unit(a / CURRENT_SCALE)
        fv[i] = unit(b / CURRENT_SCALE)
        away = clearance_at(ocean.clearance, obstacle[i], ocean.clearance_grid, x[i], y[i])
        a, b = nearest_direction(ocean.clearance, obstacle[i], ocean.clearance_grid, x[i], y[i])
        clear[i] = unit(away / c.max_hop)
        near_x[i] = unit(a)
        near_y[i] = unit(b)


@lane_kernel
def _ring_lanes(x, y, ux, uy, now, forecast, obstacle, u, v, clear, half_way, cos, sin, ocean, c):
    """Forecast current and clearances along a hop at an angle from the goal's direction, in every lane."""
    for i in range(x.size):
        dx = c.max_hop * (cos * ux[i] - sin * uy[i])
        dy = c.max_hop * (sin * ux[i] + cos * uy[i])
        a, b = current_at(ocean.velocity, forecast[i], ocean.axes, now[i], x[i] + dx, y[i] + dy)
        far = clearance_at(ocean.clearance, obstacle[i], ocean.clearance_grid, x[i] + dx, y[i] + dy)
        near = clearance_at(
            ocean.clearance, obstacle[i], ocean.clearance_grid, x[i] + 0.5 * dx, y[i] + 0.5 * dy
        )
        u[i] = unit(a / CURRENT_SCALE)
        v[i] = unit(b / CURRENT_SCALE)
        clear[i] = unit(far / c.max_hop)
        half_way[i] = unit(near / c.max_hop)


@lane_kernel
def _ahead_lanes(x, y, now, forecast, ocean):
    """One Euler step of the forecast drift in every lane."""
    for i in range(x.size):
        x[i], y[i] = drift_step(
            ocean.velocity, forecast[i], ocean.axes, now[i], x[i], y[i], AHEAD_STEP_S, True
        )
        now[i] = now[i] + AHEAD_STEP_S


@lane_kernel
def _moved_lanes(x, began, moved, half_width):
    """How far the drift has carried every lane along one axis from where it began."""
    for i in range(x.size):
        moved[i] = unit((x[i] - began[i]) / half_width)


@loop_kernel
def observe_members(worlds, members, observations, rows, fields, ocean, c):
    """Write the observations, all within [-1, 1], of ``worlds[members]``, as many as there are lanes at most.

    ``rows`` (FLOAT_ROWS, lanes) and ``fields`` (INT_ROWS, lanes) are scratch memory.
    """
    n = members.size
    for i in range(n):
        w = worlds[members[i]]
        now = w.clock_s + w.time_s
        rows[_X, i] = w.x
        rows[_Y, i] = w.y
        rows[_GX, i] = w.goal_x
        rows[_GY, i] = w.goal_y
        rows[_NOW, i] = now
        fields[_TRUE_FIELD, i] = w.truth
        fields[_FORECAST_FIELD, i] = w.forecast
        fields[_OBSTACLE, i] = w.obstacle
        rows[_BATTERY, i] = unit(w.battery_wh / c.capacity)
        rows[_BATTERY + 1, i], rows[_BATTERY + 2, i] = local_time(now, c)
        rows[_BATTERY + 3, i] = unit(1.0 - w.time_s / c.horizon)
        rows[_HDOP, i] = unit(hdop_of(w, c) / MAX_HDOP)
    x, y, now, forecast = rows[_X, :n], rows[_Y, :n], rows[_NOW, :n], fields[_FORECAST_FIELD, :n]
    obstacle, ux, uy = fields[_OBSTACLE, :n], rows[_GOAL_X, :n], rows[_GOAL_Y, :n]
    _place_lanes(
        x, y, rows[_GX, :n], rows[_GY, :n], rows[0, :n], rows[1, :n], rows[_GOAL_DX, :n], rows[_GOAL_DX + 1, :n],
        rows[_GOAL_DX + 2, :n], ux, uy, rows[_GOAL_Y + 1, :n], rows[_GOAL_Y + 2, :n], c,
    )  # fmt: skip
    u, v = rows[_CURRENT, :n], rows[_CURRENT + 1, :n]
    _here_lanes(
        x, y, now, fields[_TRUE_FIELD, :n], forecast, obstacle, u, v, rows[_CLEAR, :n], rows[_CLEAR + 1, :n],
        rows[_CLEAR + 2, :n], rows[_FORECAST, :n], rows[_FORECAST + 1, :n], ocean, c,
    )  # fmt: skip
    for i in range(n):
        if c.current_noise > 0.0:
            u[i] += c.current_noise * normal(worlds[members[i]].rng_sensor)
            v[i] += c.current_noise * normal(worlds[members[i]].rng_sensor)
        u[i] = unit(u[i] / CURRENT_SCALE)
        v[i] = unit(v[i] / CURRENT_SCALE)
    for k in range(len(HEADINGS_DEG)):
        r = _RING + 4 * k
        _ring_lanes(
            x, y, ux, uy, now, forecast, obstacle, rows[r, :n], rows[r + 1, :n], rows[r + 2, :n],
            rows[r + 3, :n], _COS[k], _SIN[k], ocean, c,
        )  # fmt: skip
    # The goal's place is needed no more: its rows keep where the drift begins.
    began_x, began_y = rows[_GX, :n], rows[_GY, :n]
    began_x[:] = x
    began_y[:] = y
    hours = 0
    for k in range(len(AHEAD_H)):
        for _ in range(int((AHEAD_H[k] - hours) * 3600.0 / AHEAD_STEP_S)):
            _ahead_lanes(x, y, now, forecast, ocean)
        hours = AHEAD_H[k]
        _moved_lanes(x, began_x, rows[_AHEAD + 2 * k, :n], c.half_width)
        _moved_lanes(y, began_y, rows[_AHEAD + 2 * k + 1, :n], c.half_width)
    for i in range(n):
        out = observations[members[i]]
        for row in range(ROWS):
            out[row] = rows[row, i]

"""What each vehicle of sensor placement observes, and the central view; compiled.

Tables of other vehicles and of targets have as many rows as there may be at most, a mask, and the nearest first:
one policy serves every size of team.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.posterior_bound import bound_position_rmse
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.obstacles import clearance_at, nearest_direction
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.tasks.observing import CURRENT_SCALE, local_time, unit
from aquaquad_envs.tasks.sensor_placement_coverage import coverage, nearest_gap, nearest_on_fence
from aquaquad_envs.tasks.sensor_placement_data import (
    CORNERS,
    FORMATIONS,
    HEADINGS_DEG,
    MAX_TARGETS,
    MAX_VEHICLES,
    RUNNING,
)
from aquaquad_envs.tasks.sensor_placement_hdop import (
    COS,
    believed_hdops,
    direction_of_nearest,
    end_of_hop,
    hdops_of_changes,
    present_formation,
    sort_keys,
    squash,
)
from aquaquad_envs.tasks.sensor_placement_sensing import find_afloat, without
from aquaquad_envs.tasks.sensor_placement_turns import hop_in_turn, regroup, room_at

#: Gain of a hop, in HDOP as observed, that is squashed to a half.
GAIN_SCALE = 0.01
#: Decisions without a measurement after which a track's age is full.
OLD_DECISIONS = 6.0

_OWN = (
    "x", "y", "battery", "sin local time", "cos local time", "time left", "vehicles", "on the water",
    "current u", "current v", "obstacle distance", "obstacle direction x", "obstacle direction y",
    "room", *(f"room after hop {heading}°" for heading in HEADINGS_DEG),
    "HDOP", "HDOP share", *(f"HDOP after hop {heading}°" for heading in HEADINGS_DEG),
    "turn", "turn hop dx", "turn hop dy", "turn hop gain",
    "HDOP before turn", *(f"HDOP after hop {heading}° in turn" for heading in HEADINGS_DEG),
    "coverage", "fence dx", "fence dy", "gap dx", "gap dy",
)  # fmt: skip
_VEHICLE = ("mask", "dx", "dy", "alive", "on the water")
_TARGET = (
    "mask", "dx", "dy", "distance", "direction x", "direction y", "u", "v", "std along", "std across", "correlation",
    "age", "lost",
)  # fmt: skip
OBSERVATION_NAMES = (
    *_OWN,
    *(f"vehicle {k} {name}" for k in range(1, MAX_VEHICLES) for name in _VEHICLE),
    *(f"target {k} {name}" for k in range(1, MAX_TARGETS + 1) for name in _TARGET),
)
SIZE = len(OBSERVATION_NAMES)
_CURRENT, _OBSTACLE, _ROOM, _HDOP, _TURN, _TURN_HDOP, _FENCE = (
    _OWN.index(name)
    for name in ("current u", "obstacle distance", "room", "HDOP", "turn", "HDOP before turn", "coverage")
)
_VEHICLES, _TARGETS = len(_OWN), len(_OWN) + (MAX_VEHICLES - 1) * len(_VEHICLE)
_VEHICLE_WIDTH, _TARGET_WIDTH = len(_VEHICLE), len(_TARGET)

_STATE_WORLD = ("time left", "sin local time", "cos local time", "HDOP", "coverage")
_STATE_VEHICLE = ("mask", "alive", "x", "y", "battery", "on the water", "current u", "current v")
_STATE_TARGET = (
    "mask", "x", "y", "u", "v", "estimate error x", "estimate error y", "estimate u", "estimate v", "std x", "std y",
    "correlation", "bound", "age", "lost",
)  # fmt: skip
STATE_NAMES = (
    *_STATE_WORLD,
    *(f"vehicle {k} {name}" for k in range(1, MAX_VEHICLES + 1) for name in _STATE_VEHICLE),
    *(f"target {k} {name}" for k in range(1, MAX_TARGETS + 1) for name in _STATE_TARGET),
    *(f"fence corner {k} {axis}" for k in range(1, CORNERS + 1) for axis in "xy"),
)
_STATE_VEHICLES = len(_STATE_WORLD)
_STATE_TARGETS = _STATE_VEHICLES + MAX_VEHICLES * len(_STATE_VEHICLE)
_STATE_FENCE = _STATE_TARGETS + MAX_TARGETS * len(_STATE_TARGET)
_STATE_VEHICLE_WIDTH, _STATE_TARGET_WIDTH = len(_STATE_VEHICLE), len(_STATE_TARGET)


@kernel
def _signed(value, scale):
    return value / (abs(value) + scale)


@kernel
def _vehicle_rows(w, i, out, c, s):
    """The other vehicles: alive ones first, the nearest first."""
    for k in range(c.num_vehicles):
        dx = w.x[k] - w.x[i]
        dy = w.y[k] - w.y[i]
        s.key[k] = dx * dx + dy * dy if w.agent_outcome[k] == RUNNING else 1e30
    s.key[i] = np.inf
    sort_keys(c.num_vehicles, s)
    for row in range(c.num_vehicles - 1):
        k = s.order[row]
        at = _VEHICLES + row * _VEHICLE_WIDTH
        out[at] = 1.0
        if w.agent_outcome[k] == RUNNING:
            out[at + 1] = unit(0.5 * (w.x[k] - w.x[i]) / c.half_width)
            out[at + 2] = unit(0.5 * (w.y[k] - w.y[i]) / c.half_width)
            out[at + 3] = 1.0
            out[at + 4] = w.on_water[k]


@kernel
def _target_rows(w, i, out, c, s):
    """What is believed of the targets: the nearest estimate first."""
    for j in range(c.num_targets):
        dx = w.estimate[j, 0] - w.x[i]
        dy = w.estimate[j, 1] - w.y[i]
        s.key[j] = dx * dx + dy * dy
    sort_keys(c.num_targets, s)
    for row in range(c.num_targets):
        j = s.order[row]
        at = _TARGETS + row * _TARGET_WIDTH
        dx = w.estimate[j, 0] - w.x[i]
        dy = w.estimate[j, 1] - w.y[i]
        away = np.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / max(away, 1e-9)
        ex = dx * inverse
        ey = dy * inverse
        a = w.covariance[j, 0, 0]
        b = w.covariance[j, 0, 1]
        d = w.covariance[j, 1, 1]
        along = max(ex * ex * a + 2.0 * ex * ey * b + ey * ey * d, 0.0)
        across = max(ey * ey * a - 2.0 * ex * ey * b + ex * ex * d, 0.0)
        mixed = ex * ey * (d - a) + (ex * ex - ey * ey) * b
        speed = 2.0 * c.target_speed + 1e-9
        out[at] = 1.0
        out[at + 1] = unit(0.5 * dx / c.half_width)
        out[at + 2] = unit(0.5 * dy / c.half_width)
        out[at + 3] = unit(away / (3.0 * c.half_width))
        out[at + 4] = unit(ex)
        out[at + 5] = unit(ey)
        out[at + 6] = unit(w.estimate[j, 2] / speed)
        out[at + 7] = unit(w.estimate[j, 3] / speed)
        out[at + 8] = squash(np.sqrt(along), c.fix_scale)
        out[at + 9] = squash(np.sqrt(across), c.fix_scale)
        out[at + 10] = unit(mixed / max(np.sqrt(along * across), 1e-12))
        out[at + 11] = unit((w.time_s - w.measured_s[j]) / (OLD_DECISIONS * c.action_period))
        out[at + 12] = w.lost[j]


@kernel
def _fence_part(w, i, out, covered, c, s):
    out[_FENCE] = covered
    x, y = nearest_on_fence(w, w.x[i], w.y[i], c)
    out[_FENCE + 1] = unit(0.5 * (x - w.x[i]) / c.half_width)
    out[_FENCE + 2] = unit(0.5 * (y - w.y[i]) / c.half_width)
    without(s.afloat, i, s)
    x, y = nearest_gap(w, s.hears, w.x[i], w.y[i], c)
    out[_FENCE + 3] = unit(0.5 * (x - w.x[i]) / c.half_width)
    out[_FENCE + 4] = unit(0.5 * (y - w.y[i]) / c.half_width)


@kernel
def _own_part(w, i, out, alive, ocean, c):
    now = w.clock_s + w.time_s
    x = w.x[i]
    y = w.y[i]
    out[0] = unit(x / c.half_width)
    out[1] = unit(y / c.half_width)
    out[2] = unit(w.battery_wh[i] / c.capacity)
    out[5] = unit(1.0 - w.time_s / c.horizon)
    out[6] = alive / MAX_VEHICLES
    out[7] = w.on_water[i]
    u = 0.0
    v = 0.0
    if not c.still_water:
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, now, x, y)
    if c.current_noise > 0.0:
        u += c.current_noise * normal(w.rng_sensor)
        v += c.current_noise * normal(w.rng_sensor)
    out[_CURRENT] = unit(u / CURRENT_SCALE)
    out[_CURRENT + 1] = unit(v / CURRENT_SCALE)
    clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y)
    dx, dy = nearest_direction(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y)
    out[_OBSTACLE] = unit(clear / c.longest_step)
    out[_OBSTACLE + 1] = unit(dx)
    out[_OBSTACLE + 2] = unit(dy)


@loop_kernel
def _find_rooms(w, ocean, c, s):
    """Room of every vehicle, m, into ``s.room``: here, and where short hops would land on each heading."""
    for i in range(c.num_vehicles):
        s.room[i, 0] = room_at(w.x[i], w.y[i], w, ocean, c)
        ux, uy = direction_of_nearest(w, i, c)
        for k in range(COS.size):
            x, y = end_of_hop(w, i, k, ux, uy, c)
            s.room[i, 1 + k] = room_at(x, y, w, ocean, c)


@kernel
def _turn_part(w, i, out, c, s):
    """Turn of vehicle ``i``, the hop that the team counts on, and what others would do."""
    out[_TURN] = (1 + s.turn[i]) / MAX_VEHICLES
    before = s.turn_hdop[i, 0]
    out[_TURN + 1] = unit((s.turn_x[i] - w.x[i]) / c.longest_step)
    out[_TURN + 2] = unit((s.turn_y[i] - w.y[i]) / c.longest_step)
    out[_TURN + 3] = _signed(s.turn_gain[i], GAIN_SCALE)
    out[_TURN_HDOP] = before
    for k in range(1, FORMATIONS):
        out[_TURN_HDOP + k] = unit(s.turn_hdop[i, k] - before)


@loop_kernel
def _hdop_parts(w, members, observations, ocean, c, s):
    """HDOP of the team, after changes of each vehicle alone, and as the vehicles hop in turn."""
    hdops_of_changes(w, c, s)
    present = s.lane_hdop[0]
    for i in range(c.num_vehicles):
        if members[i]:
            observations[i, _HDOP] = present
            if s.afloat[i]:
                for k in range(FORMATIONS):
                    observations[i, _HDOP + 1 + k] = unit(s.lane_hdop[1 + FORMATIONS * i + k] - present)
    hop_in_turn(w, c, s)
    regroup(w, ocean, c, s)
    for i in range(c.num_vehicles):
        if members[i] and s.afloat[i]:
            _turn_part(w, i, observations[i], c, s)


@loop_kernel
def observe_world(w, members, observations, ocean, c, s):
    """Observations (A, SIZE), in [-1, 1], of the vehicles where ``members`` (8,) is true; zeros of the others."""
    s.flight_left_s[:] = 0.0
    alive = find_afloat(w, c, s)
    sine, cosine = local_time(w.clock_s + w.time_s, c)
    observations[: c.num_vehicles, :] = 0.0
    _find_rooms(w, ocean, c, s)
    if c.num_targets > 0:
        _hdop_parts(w, members, observations, ocean, c, s)
    covered = coverage(w, s.afloat, c) if c.fence else 0.0
    for i in range(c.num_vehicles):
        if not members[i]:
            continue
        out = observations[i]
        _own_part(w, i, out, alive, ocean, c)
        for k in range(FORMATIONS):
            out[_ROOM + k] = unit(s.room[i, k] / c.longest_step)
        out[3] = sine
        out[4] = cosine
        if c.fence:
            _fence_part(w, i, out, covered, c, s)
        _vehicle_rows(w, i, out, c, s)
        _target_rows(w, i, out, c, s)


@kernel
def view_world(w, out, ocean, c, s):
    """The central view of one world, in the order of ``STATE_NAMES``."""
    out[:] = 0.0
    s.flight_left_s[:] = 0.0
    find_afloat(w, c, s)
    now = w.clock_s + w.time_s
    out[0] = unit(1.0 - w.time_s / c.horizon)
    out[1], out[2] = local_time(now, c)
    present_formation(w, 1, c, s)
    believed_hdops(w, 1, c.fix_scale, c, s)
    out[3] = s.lane_hdop[0]
    for i in range(c.num_vehicles):
        at = _STATE_VEHICLES + i * _STATE_VEHICLE_WIDTH
        out[at] = 1.0
        if w.agent_outcome[i] != RUNNING:
            continue
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, now, w.x[i], w.y[i])
        values = (
            1.0, w.x[i] / c.half_width, w.y[i] / c.half_width, w.battery_wh[i] / c.capacity, w.on_water[i],
            u / CURRENT_SCALE, v / CURRENT_SCALE,
        )  # fmt: skip
        for k in range(len(values)):
            out[at + 1 + k] = unit(values[k])
    speed = 2.0 * c.target_speed + 1e-9
    for j in range(c.num_targets):
        a = max(w.covariance[j, 0, 0], 0.0)
        d = max(w.covariance[j, 1, 1], 0.0)
        beliefs = (
            1.0, w.target_x[j] / c.half_width, w.target_y[j] / c.half_width, w.target_u[j] / speed,
            w.target_v[j] / speed, _signed(w.estimate[j, 0] - w.target_x[j], c.fix_scale),
            _signed(w.estimate[j, 1] - w.target_y[j], c.fix_scale), w.estimate[j, 2] / speed,
            w.estimate[j, 3] / speed, squash(np.sqrt(a), c.fix_scale), squash(np.sqrt(d), c.fix_scale),
            w.covariance[j, 0, 1] / max(np.sqrt(a * d), 1e-12),
            squash(bound_position_rmse(w.bound[j]), c.fix_scale),
            (w.time_s - w.measured_s[j]) / (OLD_DECISIONS * c.action_period), 1.0 * w.lost[j],
        )  # fmt: skip
        for k in range(len(beliefs)):
            out[_STATE_TARGETS + j * _STATE_TARGET_WIDTH + k] = unit(beliefs[k])
    if c.fence:
        out[4] = coverage(w, s.afloat, c)
        for k in range(CORNERS):
            out[_STATE_FENCE + 2 * k] = unit(w.fence[k, 0] / c.half_width)
            out[_STATE_FENCE + 2 * k + 1] = unit(w.fence[k, 1] / c.half_width)

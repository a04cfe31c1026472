"""What each robot of plume tracing observes, and the central view; compiled.

Places are relative to where the robot believes to be, as d / (|d| + 5 m): the direction is kept, and so is the
invariance to where the source lies. Tables have as many rows whatever the team's size, with masks: one policy serves
all.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.tasks.plume_tracing_data import (
    LEVEL,
    MAX_ROBOTS,
    MEMORY,
    PLACE_X,
    PLACE_Y,
    PLACE_Z,
    TIME,
)

#: Other robots in the table, the nearest heard first.
NEIGHBORS = 5
#: m; distance whose observation is a half.
HALF_DISTANCE_M = 5.0
#: Step limits within which walls, surface and bottom are seen.
WALL_STEPS = 10.0
#: Updates after which the observed age of a reading is a half.
HALF_AGE_UPDATES = 10.0
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
#: m/s; scale of the observed current.
CURRENT_SCALE = 0.5

_OWN = (
    "level", "detects", "level change", "mean level", "detection rate", "wall x", "wall y", "wall z", "time left",
    "turn", "surface bound", "team size", "flow direction x", "flow direction y", "flow speed", "moved x", "moved y",
    "moved z", "blocked", "identity cosine", "identity sine",
)  # fmt: skip
_WHIFF = ("mask", "dx", "dy", "dz", "level", "age")
_NEIGHBOR = ("mask", "dx", "dy", "dz", "level")
WHIFFS = ("own whiff", "latest whiff", "upstream reading")
OBSERVATION_NAMES = (
    *_OWN,
    *(f"{whiff} {name}" for whiff in WHIFFS for name in _WHIFF),
    *(f"robot {k} {name}" for k in range(1, NEIGHBORS + 1) for name in _NEIGHBOR),
    *(f"reading {k} {name}" for k in range(1, MEMORY + 1) for name in _WHIFF),
)
SIZE = len(OBSERVATION_NAMES)
_WIDTH, _NEIGHBOR_WIDTH = len(_WHIFF), len(_NEIGHBOR)
_WHIFFS_AT = len(_OWN)
_NEIGHBORS_AT = _WHIFFS_AT + len(WHIFFS) * _WIDTH
_MEMORY_AT = _NEIGHBORS_AT + NEIGHBORS * _NEIGHBOR_WIDTH

_STATE_WORLD = ("time left", "source x", "source y", "source z", "flow u", "flow v", "near time")
_STATE_ROBOT = (
    "mask",
    "turn",
    "x",
    "y",
    "z",
    "source dx",
    "source dy",
    "source dz",
    "level",
    "detection rate",
)
STATE_NAMES = (
    *_STATE_WORLD,
    *(f"robot {k} {name}" for k in range(1, MAX_ROBOTS + 1) for name in _STATE_ROBOT),
)
_ROBOTS_AT, _ROBOT_WIDTH = len(_STATE_WORLD), len(_STATE_ROBOT)


@kernel
def _unit(value):
    value = value if value > -1.0 else -1.0
    return value if value < 1.0 else 1.0


@kernel
def _put_place(out, at, dx, dy, dz):
    scale = 1.0 / (np.sqrt(dx * dx + dy * dy + dz * dz) + HALF_DISTANCE_M)
    out[at] = scale * dx
    out[at + 1] = scale * dy
    out[at + 2] = scale * dz


@kernel
def _put_reading(out, at, row, w, i, half_age):
    """A remembered reading as robot ``i`` sees it."""
    out[at] = 1.0
    _put_place(
        out, at + 1, row[PLACE_X] - w.seen_x[i], row[PLACE_Y] - w.seen_y[i], row[PLACE_Z] - w.seen_z[i]
    )
    out[at + 4] = row[LEVEL]
    age = w.time_s - row[TIME]
    out[at + 5] = age / (age + half_age)


@kernel
def _wall(place, low, high, reach):
    """Nearness of the walls of one axis: 1 at the upper, -1 at the lower, 0 far from both."""
    above = max(1.0 - (high - place) / reach, 0.0)
    below = max(1.0 - (place - low) / reach, 0.0)
    return _unit(above - below)


@kernel
def _own_part(w, i, out, left, c):
    out[0] = w.level[i]
    out[1] = 1.0 if w.reading[i] > 0.0 else 0.0
    out[2] = 0.5 * (w.level[i] - w.level_before[i])
    out[3] = w.mean_level[i]
    out[4] = w.detection_rate[i]
    reach = WALL_STEPS * c.step_limit
    out[5] = _wall(w.seen_x[i], -c.half_width, c.half_width, reach)
    out[6] = _wall(w.seen_y[i], -c.half_width, c.half_width, reach)
    out[7] = 0.0 if c.surface_bound else _wall(w.seen_z[i], 0.0, c.depth, reach)
    out[8] = left
    out[9] = 1.0 if w.turn < 0 or w.turn == i else 0.0
    out[10] = 1.0 if c.surface_bound else 0.0
    out[11] = c.num_robots / MAX_ROBOTS
    speed = np.sqrt(w.flow_u[i] * w.flow_u[i] + w.flow_v[i] * w.flow_v[i])
    if speed > 0.0:
        out[12] = _unit(w.flow_u[i] / speed)
        out[13] = _unit(w.flow_v[i] / speed)
        out[14] = _unit(speed / (speed + CURRENT_SCALE))
    # A heading error may turn a diagonal out of the square.
    out[15] = _unit(w.moved_x[i] / c.step_limit)
    out[16] = _unit(w.moved_y[i] / c.step_limit)
    out[17] = _unit(w.moved_z[i] / c.step_limit)
    out[18] = w.blocked[i]
    # Robots that share a policy must be able to part: the golden angle spreads any number of them evenly.
    out[19] = np.cos(_GOLDEN * i)
    out[20] = np.sin(_GOLDEN * i)


@kernel
def _neighbor_rows(w, i, out, c, s):
    """The nearest robots that were heard."""
    chosen = 0
    for j in range(c.num_robots):
        if j == i or w.heard[i, j] == 0:
            continue
        dx = w.seen_x[j] - w.seen_x[i]
        dy = w.seen_y[j] - w.seen_y[i]
        dz = w.seen_z[j] - w.seen_z[i]
        key = dx * dx + dy * dy + dz * dz
        if chosen == NEIGHBORS and key >= s.key[chosen - 1]:
            continue
        at = min(chosen, NEIGHBORS - 1)
        while at > 0 and s.key[at - 1] > key:
            s.key[at] = s.key[at - 1]
            s.order[at] = s.order[at - 1]
            at -= 1
        s.key[at] = key
        s.order[at] = j
        chosen = min(chosen + 1, NEIGHBORS)
    for row in range(chosen):
        j = s.order[row]
        at = _NEIGHBORS_AT + row * _NEIGHBOR_WIDTH
        out[at] = 1.0
        _put_place(
            out, at + 1, w.seen_x[j] - w.seen_x[i], w.seen_y[j] - w.seen_y[i], w.seen_z[j] - w.seen_z[i]
        )
        out[at + 4] = w.level[j]


@kernel
def _memory_rows(w, i, out, half_age):
    """Readings remembered, the best first, and the one furthest upstream."""
    table = w.memory_of[i]
    count = w.memory_count[table]
    furthest = 0
    least = np.inf
    for k in range(count):
        row = w.memory[table, k]
        _put_reading(out, _MEMORY_AT + k * _WIDTH, row, w, i, half_age)
        along = row[PLACE_X] * w.flow_u[i] + row[PLACE_Y] * w.flow_v[i]
        if along < least:
            least = along
            furthest = k
    if w.own_whiff[i, TIME] >= 0.0:
        _put_reading(out, _WHIFFS_AT, w.own_whiff[i], w, i, half_age)
    if w.heard_whiff[table, TIME] >= 0.0:
        _put_reading(out, _WHIFFS_AT + _WIDTH, w.heard_whiff[table], w, i, half_age)
    if count > 0:
        for column in range(_WIDTH):
            out[_WHIFFS_AT + 2 * _WIDTH + column] = out[_MEMORY_AT + furthest * _WIDTH + column]


@kernel
def _time_left(w, c):
    return _unit(1.0 - w.updates / c.horizon_updates)


@loop_kernel
def observe_world(w, observations, c, s):
    """Observations (A, SIZE), in [-1, 1], of all robots."""
    observations[:] = 0.0
    left = _time_left(w, c)
    half_age = HALF_AGE_UPDATES * c.update_period
    for i in range(c.num_robots):
        out = observations[i]
        _own_part(w, i, out, left, c)
        _neighbor_rows(w, i, out, c, s)
        _memory_rows(w, i, out, half_age)


@kernel
def view_world(w, out, ocean, c):
    """The central view of one world, in the order of ``STATE_NAMES``."""
    out[:] = 0.0
    u = 0.0
    v = 0.0
    if not c.still_water:
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, w.clock_s + w.time_s, w.source_x, w.source_y)
        u += w.meander_u
        v += w.meander_v
    out[0] = _time_left(w, c)
    out[1] = _unit(w.source_x / c.half_width)
    out[2] = _unit(w.source_y / c.half_width)
    out[3] = _unit(w.source_z / c.depth)
    out[4] = _unit(u / CURRENT_SCALE)
    out[5] = _unit(v / CURRENT_SCALE)
    out[6] = _unit(w.near_s / (c.reach_time + c.update_period))
    for i in range(c.num_robots):
        at = _ROBOTS_AT + i * _ROBOT_WIDTH
        out[at] = 1.0
        out[at + 1] = 1.0 if w.turn < 0 or w.turn == i else 0.0
        out[at + 2] = _unit(w.x[i] / c.half_width)
        out[at + 3] = _unit(w.y[i] / c.half_width)
        out[at + 4] = _unit(w.z[i] / c.depth)
        _put_place(out, at + 5, w.source_x - w.x[i], w.source_y - w.y[i], w.source_z - w.z[i])
        out[at + 8] = w.level[i]
        out[at + 9] = w.detection_rate[i]

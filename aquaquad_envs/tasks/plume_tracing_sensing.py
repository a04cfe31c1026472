"""What the robots of plume tracing read, tell each other and remember; compiled."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.sensing.plume import sensor_reading
from aquaquad_envs.tasks.plume_tracing_data import (
    LEVEL,
    MAX_ROBOTS,
    NEVER,
    PLACE_X,
    PLACE_Y,
    PLACE_Z,
    TIME,
    VALUE,
)
from aquaquad_envs.tasks.plume_tracing_motion import walk_team
from aquaquad_envs.tasks.plume_tracing_plume import prepare_reading, true_reading

#: Natural logarithms from the scale at which a level is a half.
_HALF_LEVEL = 3.0
#: Share of a new reading in the running means, for an update.
_FRESH = 0.1


@kernel
def level_of(value, scale):
    """A reading squashed into (-1, 1): L / (|L| + 3), L = ln(value / scale); -1 for nothing."""
    if value <= 0.0:
        return -1.0
    logarithm = np.log(value / scale)
    return logarithm / (abs(logarithm) + _HALF_LEVEL)


@kernel
def _read(w, i, ocean, c, s):
    """Robot ``i`` reads the field and the current where it is."""
    value = true_reading(w, w.x[i], w.y[i], w.z[i], c, s)
    w.reading[i] = sensor_reading(value, c.sensor_noise, c.detection_floor, w.rng_sensor)
    w.level_before[i] = w.level[i]
    w.level[i] = level_of(w.reading[i], c.level_scale)
    if not c.still_water:
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, w.clock_s + w.time_s, w.x[i], w.y[i])
        w.flow_u[i] = u + w.meander_u
        w.flow_v[i] = v + w.meander_v
    if c.current_noise > 0.0:
        w.flow_u[i] += c.current_noise * normal(w.rng_sensor)
        w.flow_v[i] += c.current_noise * normal(w.rng_sensor)


@kernel
def _locate(w, c):
    """Where the robots believe to be."""
    error = 0.0 if c.random_walk else c.position_error
    if c.random_walk and c.position_error > 0.0:
        walk_team(w, c)
    for i in range(c.num_robots):
        w.seen_x[i] = w.x[i]
        w.seen_y[i] = w.y[i]
        w.seen_z[i] = w.z[i]
        if error > 0.0:
            w.seen_x[i] += error * (2.0 * uniform(w.rng_sensor) - 1.0)
            w.seen_y[i] += error * (2.0 * uniform(w.rng_sensor) - 1.0)


@kernel
def measure_distances(w, c):
    """True distances to the source, m: horizontal where robots are bound to the surface."""
    for i in range(c.num_robots):
        dx = w.x[i] - w.source_x
        dy = w.y[i] - w.source_y
        dz = 0.0 if c.surface_bound else w.z[i] - w.source_z
        w.distance[i] = np.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def _copy_row(table, to, row):
    for column in range(6):
        table[to, column] = table[row, column]


@kernel
def _remove(table, count, row):
    """The table without ``row``; returns how many are left."""
    for k in range(row, count - 1):
        _copy_row(table, k, k + 1)
    return count - 1


@kernel
def forget_old(table, count, before):
    """The table without readings older than ``before``, s, in the same order; returns how many are left."""
    kept = 0
    for k in range(count):
        if table[k, TIME] >= before:
            if kept < k:
                _copy_row(table, kept, k)
            kept += 1
    return kept


@loop_kernel
def remember(table, count, rows, spacing, x, y, z, value, time, level):
    """Put a reading into ``table``, best first, of which ``count`` of ``rows`` rows are in use; returns the new count.

    It replaces the first reading nearer to it than ``spacing``, and pushes the worst out of a full table.
    """
    for k in range(count):
        dx = table[k, PLACE_X] - x
        dy = table[k, PLACE_Y] - y
        dz = table[k, PLACE_Z] - z
        if dx * dx + dy * dy + dz * dz < spacing * spacing:
            count = _remove(table, count, k)
            break
    if count == rows and value <= table[rows - 1, VALUE]:
        return count
    at = min(count, rows - 1)
    while at > 0 and table[at - 1, VALUE] < value:
        _copy_row(table, at, at - 1)
        at -= 1
    table[at, PLACE_X] = x
    table[at, PLACE_Y] = y
    table[at, PLACE_Z] = z
    table[at, VALUE] = value
    table[at, TIME] = time
    table[at, LEVEL] = level
    return min(count + 1, rows)


@kernel
def _links(w, c):
    """Who hears whom in this exchange."""
    limit = c.comm_radius * c.comm_radius
    for i in range(c.num_robots):
        for j in range(c.num_robots):
            heard = 1
            if i != j and not c.shared:
                dx = w.x[i] - w.x[j]
                dy = w.y[i] - w.y[j]
                dz = w.z[i] - w.z[j]
                if dx * dx + dy * dy + dz * dz > limit or (
                    c.comm_loss > 0.0 and uniform(w.rng_sensor) < c.comm_loss
                ):
                    heard = 0
            w.heard[i, j] = heard


@kernel
def _write_whiff(row, w, j):
    row[PLACE_X] = w.seen_x[j]
    row[PLACE_Y] = w.seen_y[j]
    row[PLACE_Z] = w.seen_z[j]
    row[VALUE] = w.reading[j]
    row[TIME] = w.time_s
    row[LEVEL] = w.level[j]


@kernel
def _hear(w, i, c):
    """Robot ``i`` takes in what it has heard, its own reading included."""
    table = w.memory[i]
    count = w.memory_count[i]
    if c.memory_age < 1e9:
        count = forget_old(table, count, w.time_s - c.memory_age)
    for j in range(c.num_robots):
        value = w.reading[j]
        if w.heard[i, j] == 0 or value <= 0.0:
            continue
        count = remember(
            table, count, c.memory_rows, c.memory_spacing, w.seen_x[j], w.seen_y[j], w.seen_z[j], value, w.time_s,
            w.level[j],
        )  # fmt: skip
        # The latest detection, of several at once the strongest.
        if w.heard_whiff[i, TIME] < w.time_s or w.heard_whiff[i, VALUE] < value:
            _write_whiff(w.heard_whiff[i], w, j)
    w.memory_count[i] = count


@loop_kernel
def sense(w, ocean, c, s):
    """All robots read the field, find their places, and tell those in reach; ``w.time_s`` is the present.

    In this order, as published: with the published position error places wander after the reading.
    """
    measure_distances(w, c)
    prepare_reading(w, c, s)
    for i in range(c.num_robots):
        _read(w, i, ocean, c, s)
    _locate(w, c)
    fresh = _FRESH / c.num_robots if c.sequential else _FRESH
    for i in range(c.num_robots):
        detects = 1.0 if w.reading[i] > 0.0 else 0.0
        w.mean_level[i] += fresh * (w.level[i] - w.mean_level[i])
        w.detection_rate[i] += fresh * (detects - w.detection_rate[i])
        if detects > 0.0:
            _write_whiff(w.own_whiff[i], w, i)
    _links(w, c)
    tables = 1 if c.shared else c.num_robots
    for i in range(tables):
        _hear(w, i, c)


@kernel
def forget_all(w, c):
    """Nothing was ever read: the state before the first :func:`sense`."""
    for i in range(MAX_ROBOTS):
        w.seen_x[i] = 0.0
        w.seen_y[i] = 0.0
        w.seen_z[i] = 0.0
        w.reading[i] = 0.0
        w.level[i] = -1.0
        w.level_before[i] = -1.0
        w.mean_level[i] = -1.0
        w.detection_rate[i] = 0.0
        w.flow_u[i] = 0.0
        w.flow_v[i] = 0.0
        w.distance[i] = 0.0
        w.memory_count[i] = 0
        w.memory_of[i] = 0 if c.shared else i
        for column in range(6):
            w.own_whiff[i, column] = 0.0
            w.heard_whiff[i, column] = 0.0
        w.own_whiff[i, TIME] = NEVER
        w.heard_whiff[i, TIME] = NEVER
        for j in range(MAX_ROBOTS):
            w.heard[i, j] = 0
    # Rows beyond the count are never read; zeros make equal episodes equal records.
    w.memory[:] = 0.0

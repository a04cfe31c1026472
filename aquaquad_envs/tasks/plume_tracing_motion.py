"""Where the robots of plume tracing begin, and how they move; compiled."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.randomness import uniform, uniform_in_disc
from aquaquad_envs.sensing.plume_puffs import folded
from aquaquad_envs.tasks.plume_tracing_data import CORNER, DOWNSTREAM, MAX_ROBOTS, SURROUND

#: Published corner: the arc, degrees.
_ARC_FROM, _ARC_TO = np.deg2rad(25.0), np.deg2rad(65.0)
#: Places that a robot tries at the start.
_TRIES = 100
#: A move is shortened by this share of its length until its end is free (published).
_TENTHS = 10
#: m; what counts as having moved.
MOVED = 1e-3


@kernel
def _held(value, low, high):
    return min(max(value, low), high)


@kernel
def _varied(value, share, state):
    """``value``, uniform within ± ``share`` of it."""
    return value * (1.0 + share * (2.0 * uniform(state) - 1.0))


@kernel
def _start_source(w, ex, ey, c):
    """The source of a new episode; downstream teams lie along (ex, ey) from it."""
    if c.layout == DOWNSTREAM:
        away = _varied(c.start_radius, c.start_radius_spread, w.rng_initial)
        w.source_x = -0.5 * away * ex
        w.source_y = -0.5 * away * ey
    else:
        dx, dy = uniform_in_disc(w.rng_initial)
        w.source_x = c.source_spread * dx
        w.source_y = c.source_spread * dy
    share = 0.2 + 0.6 * uniform(w.rng_initial)
    w.source_z = c.source_depth if c.source_depth >= 0.0 else share * c.depth


@kernel
def _start_place(w, i, center_x, center_y, c):
    """A place for robot ``i`` by the layout of the team."""
    if c.layout == SURROUND or c.layout == CORNER:
        angle = 2.0 * np.pi * i / c.num_robots
        if c.layout == CORNER:
            angle = _ARC_FROM + (_ARC_TO - _ARC_FROM) * i / (c.num_robots - 1)
        radius = _varied(c.start_radius, c.start_radius_spread, w.rng_initial)
        height = _varied(c.start_height, c.start_height_spread, w.rng_initial)
        return (
            w.source_x + radius * np.cos(angle), w.source_y + radius * np.sin(angle), folded(w.source_z - height,
            c.depth)
        )  # fmt: skip
    if c.layout == DOWNSTREAM:
        dx, dy = uniform_in_disc(w.rng_initial)
        x = center_x + c.cluster_radius * dx
        y = center_y + c.cluster_radius * dy
    else:
        x = c.half_width * (2.0 * uniform(w.rng_initial) - 1.0)
        y = c.half_width * (2.0 * uniform(w.rng_initial) - 1.0)
    return x, y, c.depth * uniform(w.rng_initial)


@kernel
def _too_near(w, i, count, x, y, z, c):
    """Whether (x, y, z) lies within the spacing of a robot before ``count`` that is not ``i``."""
    for j in range(count):
        dx = x - w.x[j]
        dy = y - w.y[j]
        dz = z - w.z[j]
        if j != i and dx * dx + dy * dy + dz * dz < c.spacing * c.spacing:
            return True
    return False


@loop_kernel
def start_team(w, ocean, c):
    """Draw source and robots of a new episode: record ``w`` has field and clock already."""
    ex = 1.0
    ey = 0.0
    if not c.still_water:
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, w.clock_s, 0.0, 0.0)
        speed = np.sqrt(u * u + v * v)
        if speed > 1e-6:
            ex = u / speed
            ey = v / speed
    _start_source(w, ex, ey, c)
    # Off the axis of the flow by up to a radius of the team.
    aside = c.cluster_radius * (2.0 * uniform(w.rng_initial) - 1.0)
    center_x = -w.source_x - aside * ey
    center_y = -w.source_y + aside * ex
    for i in range(MAX_ROBOTS):
        x = 0.0
        y = 0.0
        z = 0.0
        if i < c.num_robots:
            for _ in range(_TRIES):
                x, y, z = _start_place(w, i, center_x, center_y, c)
                x = _held(x, -c.half_width, c.half_width)
                y = _held(y, -c.half_width, c.half_width)
                z = 0.0 if c.surface_bound else z
                if c.layout == SURROUND or c.layout == CORNER or not _too_near(w, i, i, x, y, z, c):
                    break
            turned = c.heading_error * (2.0 * uniform(w.rng_initial) - 1.0)
        else:
            turned = 0.0
        w.x[i] = x
        w.y[i] = y
        w.z[i] = z
        w.start_x[i] = x
        w.start_y[i] = y
        w.start_z[i] = z
        w.course_error[i] = turned
        w.moved_x[i] = 0.0
        w.moved_y[i] = 0.0
        w.moved_z[i] = 0.0
        w.blocked[i] = 0


@kernel
def _is_free(w, i, x, y, z, c):
    """Whether robot ``i`` may end at (x, y, z): nobody within the spacing, but for those it moves away from."""
    limit = c.spacing * c.spacing
    for j in range(c.num_robots):
        dx = x - w.x[j]
        dy = y - w.y[j]
        dz = z - w.z[j]
        square = dx * dx + dy * dy + dz * dz
        if square < limit and j != i:
            dx = w.x[i] - w.x[j]
            dy = w.y[i] - w.y[j]
            dz = w.z[i] - w.z[j]
            if square <= dx * dx + dy * dy + dz * dz:
                return False
    return True


@kernel
def move_robot(w, i, action_x, action_y, action_z, c):
    """Move robot ``i``: an action of 1 is the step limit along its axis. Returns 1 if others were in the way.

    A heading error turns the horizontal part; the box, surface and bottom hold it; and it is shortened by tenths of
    its length until its end is clear of the other robots (SAND2003-2643, A.3, which may go on into the opposite
    direction).
    """
    dx = c.step_limit * _held(action_x, -1.0, 1.0)
    dy = c.step_limit * _held(action_y, -1.0, 1.0)
    dz = 0.0 if c.surface_bound else c.step_limit * _held(action_z, -1.0, 1.0)
    if c.heading_error > 0.0:
        turned = w.course_error[i]
        if not c.constant_heading:
            turned = c.heading_error * (2.0 * uniform(w.rng_sensor) - 1.0)
        cosine = np.cos(turned)
        sine = np.sin(turned)
        dx, dy = cosine * dx - sine * dy, sine * dx + cosine * dy
    dx = _held(w.x[i] + dx, -c.half_width, c.half_width) - w.x[i]
    dy = _held(w.y[i] + dy, -c.half_width, c.half_width) - w.y[i]
    dz = _held(w.z[i] + dz, 0.0, c.depth) - w.z[i]
    tenths = _TENTHS
    while tenths > 0:
        share = tenths / _TENTHS
        if _is_free(w, i, w.x[i] + share * dx, w.y[i] + share * dy, w.z[i] + share * dz, c):
            break
        tenths -= 1
    share = tenths / _TENTHS
    w.moved_x[i] = share * dx
    w.moved_y[i] = share * dy
    w.moved_z[i] = share * dz
    w.x[i] += w.moved_x[i]
    w.y[i] += w.moved_y[i]
    w.z[i] += w.moved_z[i]
    w.blocked[i] = 1 if tenths < _TENTHS else 0
    return w.blocked[i]


@loop_kernel
def move_team(w, actions, c):
    """Move whose turn it is; returns how many were in each other's way, as a share of the team."""
    blocked = 0
    furthest = 0.0
    first = w.turn if c.sequential else 0
    last = first + 1 if c.sequential else c.num_robots
    for i in range(first, last):
        blocked += move_robot(w, i, actions[i, 0], actions[i, 1], actions[i, 2], c)
        square = w.moved_x[i] ** 2 + w.moved_y[i] ** 2 + w.moved_z[i] ** 2
        furthest = max(furthest, square)
    if furthest > MOVED * MOVED:
        w.last_moved = w.updates + 1
    return blocked / c.num_robots


@kernel
def walk_team(w, c):
    """The published position error: true positions wander by up to ± the error in x and y."""
    for i in range(c.num_robots):
        w.x[i] = _held(
            w.x[i] + c.position_error * (2.0 * uniform(w.rng_sensor) - 1.0), -c.half_width, c.half_width
        )
        w.y[i] = _held(
            w.y[i] + c.position_error * (2.0 * uniform(w.rng_sensor) - 1.0), -c.half_width, c.half_width
        )

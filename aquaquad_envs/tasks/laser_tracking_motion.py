"""How both vehicles of laser tracking move: two planar models each, over lanes of worlds (SIMD).

Each horizontal axis has a planar model of its own, with the whole mass and its own height: small tilts, where what
one plane does to the other is of second order. The altitude is the mean of the two planes'. Along one axis (published)
there is one plane and nothing is neglected.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.physics.quadrotor import quadrotor_control, quadrotor_step, quadrotor_velocity
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.physics.rov import rov_control, rov_step, trimmed_integral
from aquaquad_envs.tasks.laser_tracking_data import (
    INT_VZ,
    MIXED,
    MOVING,
    PLANAR,
    TURNING,
    WANDERING,
    U,
    W,
    X,
    Z,
)

#: Worlds that are advanced at once, and rows of scratch memory: the states of a plane, its command and its forces.
LANES = 64
ROWS = PLANAR + 4


@lane_kernel
def _command_quadrotors(
    x, z, pitch, u, w, rate, int_z, int_vx, int_vz, int_pitch, wanted, thrust, moment, altitude, p, dt
):
    """Rotor forces for a velocity ``wanted`` along the plane at a held ``altitude``, in every lane."""
    for i in range(x.size):
        thrust[i], moment[i], _, int_z[i], int_vx[i], int_vz[i], int_pitch[i] = quadrotor_control(
            x[i], z[i], pitch[i], u[i], w[i], rate[i], 0.0, int_z[i], int_vx[i], int_vz[i], int_pitch[i], wanted[i],
            -altitude, False, True, p, dt,
        )  # fmt: skip


@lane_kernel
def _move_quadrotors(x, z, pitch, u, w, rate, thrust, moment, p, dt):
    for i in range(x.size):
        x[i], z[i], pitch[i], u[i], w[i], rate[i] = quadrotor_step(
            x[i], z[i], pitch[i], u[i], w[i], rate[i], thrust[i], moment[i], p, dt
        )


@lane_kernel
def _command_rovs(
    x, z, pitch, u, w, rate, int_z, int_vx, int_vz, int_pitch, wanted, surge, heave, moment, depth, p, dt
):
    """Thruster forces for a velocity ``wanted`` along the plane at a held ``depth``, level, in every lane."""
    for i in range(x.size):
        surge[i], heave[i], moment[i], _, int_z[i], int_vx[i], int_vz[i], int_pitch[i] = rov_control(
            x[i], z[i], pitch[i], u[i], w[i], rate[i], 0.0, int_z[i], int_vx[i], int_vz[i], int_pitch[i], wanted[i],
            depth, 0.0, False, True, p, dt,
        )  # fmt: skip


@lane_kernel
def _move_rovs(x, z, pitch, u, w, rate, surge, heave, moment, p, dt):
    for i in range(x.size):
        x[i], z[i], pitch[i], u[i], w[i], rate[i] = rov_step(
            x[i], z[i], pitch[i], u[i], w[i], rate[i], surge[i], heave[i], moment[i], p, dt
        )


@loop_kernel
def move_members(worlds, members, rows, c):
    """Advance both vehicles of ``worlds[members]`` by one decision, at their commanded velocities.

    ``rows`` (ROWS, LANES) is scratch memory, of at least as many lanes as members.
    """
    n = members.size
    dt = c.action_period / c.sub_steps
    x, z, pitch, u, w, rate = rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n], rows[4, :n], rows[5, :n]
    int_z, int_vx, int_vz, int_pitch = rows[6, :n], rows[7, :n], rows[8, :n], rows[9, :n]
    wanted, first, second, third = rows[10, :n], rows[11, :n], rows[12, :n], rows[13, :n]
    for plane in range(c.axes):
        for i in range(n):
            world = worlds[members[i]]
            for k in range(PLANAR):
                rows[k, i] = world.uav[plane, k]
            wanted[i] = world.command_u if plane == 0 else world.command_v
        for _ in range(c.sub_steps):
            _command_quadrotors(
                x, z, pitch, u, w, rate, int_z, int_vx, int_vz, int_pitch, wanted, first, second, c.altitude,
                c.quadrotor, dt,
            )  # fmt: skip
            _move_quadrotors(x, z, pitch, u, w, rate, first, second, c.quadrotor, dt)
        for i in range(n):
            world = worlds[members[i]]
            for k in range(PLANAR):
                world.uav[plane, k] = rows[k, i]
                rows[k, i] = world.rov[plane, k]
            wanted[i] = world.wanted_u if plane == 0 else world.wanted_v
        for _ in range(c.sub_steps):
            _command_rovs(
                x, z, pitch, u, w, rate, int_z, int_vx, int_vz, int_pitch, wanted, first, second, third, c.depth,
                c.vehicle, dt,
            )  # fmt: skip
            _move_rovs(x, z, pitch, u, w, rate, first, second, third, c.vehicle, dt)
        for i in range(n):
            world = worlds[members[i]]
            for k in range(PLANAR):
                world.rov[plane, k] = rows[k, i]


@kernel
def place_vehicles(world, c):
    """Positions and velocities of both vehicles from their planar states."""
    uav = world.uav
    rov = world.rov
    world.x = uav[0, X]
    world.u, _ = quadrotor_velocity(uav[0, 2], uav[0, U], uav[0, W])
    world.altitude = -uav[0, Z]
    world.rov_x = rov[0, X]
    world.rov_u, _ = quadrotor_velocity(rov[0, 2], rov[0, U], rov[0, W])
    world.depth = rov[0, Z]
    if c.axes == 2:
        world.y = uav[1, X]
        world.v, _ = quadrotor_velocity(uav[1, 2], uav[1, U], uav[1, W])
        world.altitude = -0.5 * (uav[0, Z] + uav[1, Z])
        world.rov_y = rov[1, X]
        world.rov_v, _ = quadrotor_velocity(rov[1, 2], rov[1, U], rov[1, W])
        world.depth = 0.5 * (rov[0, Z] + rov[1, Z])


@kernel
def start_vehicles(world, rov_x, rov_y, c):
    """Both at rest, trimmed: the quadrotor at the origin, the submerged vehicle at (``rov_x``, ``rov_y``) m."""
    world.uav[:, :] = 0.0
    world.rov[:, :] = 0.0
    world.uav[:, Z] = -c.start_altitude
    world.rov[:, Z] = c.depth
    world.rov[:, INT_VZ] = trimmed_integral(c.vehicle)
    world.rov[0, X] = rov_x
    world.rov[1, X] = rov_y
    world.y = 0.0
    world.v = 0.0
    world.rov_y = 0.0
    world.rov_v = 0.0
    place_vehicles(world, c)


@kernel
def start_motion(world, c):
    """Draw how the submerged vehicle moves: its kind, velocity and rate of turn."""
    kind = uniform(world.rng_target)
    course = 2.0 * np.pi * uniform(world.rng_target)
    speed = c.rov_speed * (0.1 + 0.9 * uniform(world.rng_target))
    turn = uniform(world.rng_target)
    # Two draws whatever the kind: kinds of one seed then differ in nothing else.
    wander_u = 0.5 * c.rov_speed * normal(world.rng_target)
    wander_v = 0.5 * c.rov_speed * normal(world.rng_target)
    world.motion = min(int(MIXED * kind), MIXED - 1) if c.motion == MIXED else c.motion
    world.turn_rate = 0.0
    if world.motion == TURNING:
        world.turn_rate = (
            2.0 * np.pi / c.turn_period * (0.5 + turn) * (1.0 if kind * 1000.0 % 2.0 < 1.0 else -1.0)
        )
    if world.motion == MOVING or world.motion == TURNING:
        world.wanted_u = speed * np.cos(course)
        world.wanted_v = speed * np.sin(course)
        if c.axes == 1 and world.motion == MOVING:
            world.wanted_u = speed if world.wanted_u > 0.0 else -speed
    elif world.motion == WANDERING:
        world.wanted_u, world.wanted_v = _within(wander_u, wander_v, c.rov_speed)
    else:
        world.wanted_u = 0.0
        world.wanted_v = 0.0


@kernel
def _within(u, v, speed):
    """The velocity, shortened to ``speed`` m/s if it is more."""
    squared = u * u + v * v
    scale = speed / np.sqrt(squared) if squared > speed * speed else 1.0
    return scale * u, scale * v


@kernel
def change_motion(world, c):
    """The submerged vehicle's commanded velocity in the next decision: turned, or wandered on.

    Turning: a circle at constant speed (along one axis: there and back). Wandering: each component an
    Ornstein–Uhlenbeck process of standard deviation half the greatest speed, the vector shortened to that speed.
    """
    if world.motion == TURNING:
        angle = world.turn_rate * c.action_period
        cos = np.cos(angle)
        sin = np.sin(angle)
        u = world.wanted_u
        world.wanted_u = cos * u - sin * world.wanted_v
        world.wanted_v = sin * u + cos * world.wanted_v
    elif world.motion == WANDERING:
        kept = np.exp(-c.action_period / c.wander_time)
        fresh = 0.5 * c.rov_speed * np.sqrt(1.0 - kept * kept)
        u = kept * world.wanted_u + fresh * normal(world.rng_target)
        v = kept * world.wanted_v + fresh * normal(world.rng_target)
        world.wanted_u, world.wanted_v = _within(u, v, c.rov_speed)

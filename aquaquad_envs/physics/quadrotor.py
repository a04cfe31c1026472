"""Planar quadrotor with a cascaded controller (Toombs 2022, ch. 3.1; SPEC §10).

North-east-down: x forward, z down, m; pitch θ, rad, positive nose up; u, w the inertial velocity in body axes, m/s.
With (c, s) the cosine and sine of θ, two rotors of thrust T1 and T2, T = T1 + T2, M = d (T2 - T1):

    ẋ = c u + s w                       ż = -s u + c w                      θ̈ = M / J
    u̇ = -g s - T C_d u / m - θ̇ w        ẇ = g c - T / m + θ̇ u

Induced drag T C_d u alone: parasitic drag is small at the speeds of hovering. Valid without wind and away from ground.

Controller: position → velocity → acceleration (ẍ_c, z̈_c) → attitude. a_c = √((g - z̈_c)² + ẍ_c²),
θ_c = -asin(ẍ_c / a_c), which has the sign that the rotation above requires; T is m a_c projected on the present thrust
axis, m ((g - z̈_c) c - ẍ_c s). The velocity loops are PI: acceleration is no state. Departures from the paper: eq. 3.12
divides by cos θ, which grows without bound; eq. 3.13 needs +1/(2d) in its second row.
The tilt is bounded through ẍ_c, at most (g - z̈_c) times the greatest slope, so that anti-windup sees the bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.angles import arc_tangent, sine_cosine, smallest_turn
from aquaquad_envs.physics.pid import Gains, bounded, pid
from aquaquad_envs.physics.vehicle import runge_kutta

#: States of the motion, and integrals of the controllers, in the order of :func:`fly`.
STATES = ("x", "z", "pitch", "u", "w", "pitch rate")
INTEGRALS = ("x", "z", "x velocity", "z velocity", "pitch")


class Quadrotor(NamedTuple):
    """Parameters, SI; the defaults are a ROSflight-class quadrotor that carries the 1.5 kg receiver.

    Mass (2.856 kg without payload), inertia, arm and induced drag: multirotor of the ROSflight simulator
    (rosflight_sim, multirotor.urdf.xacro and multirotor_dynamics.yaml, 2024). Thrust and gains are free: twice the
    weight; loops of about 10, 2.5 and 1 rad/s, each slow enough to see the one below it as done.
    """

    mass: float = 4.356
    inertia: float = 0.08
    arm: float = 0.19
    induced_drag: float = 0.05
    gravity: float = 9.81
    max_thrust: float = 85.0
    #: tangent of the greatest tilt that is commanded, of 30°
    max_tilt_slope: float = float(np.tan(np.radians(30.0)))
    #: m/s, of what the position controllers command
    max_speed: float = 2.0
    max_climb: float = 1.0
    #: m/s², vertical
    max_climb_acceleration: float = 4.0
    #: rad/s²
    max_turn_acceleration: float = 60.0
    position: Gains = Gains(1.0)
    altitude: Gains = Gains(1.2)
    velocity: Gains = Gains(2.5, 1.5)
    climb: Gains = Gains(4.0, 3.0)
    attitude: Gains = Gains(100.0, 0.0, 17.0)


def make_quadrotor(**values: float | Gains) -> Quadrotor:
    """A quadrotor with ``values`` in place of the defaults. Raises ``InvalidParameterError`` for what cannot fly."""
    unknown = sorted(set(values) - set(Quadrotor._fields))
    if unknown:
        raise InvalidParameterError(unknown[0], values[unknown[0]], "one of " + ", ".join(Quadrotor._fields))
    made = Quadrotor(**values)  # type: ignore[arg-type]
    for name, high in (
        ("mass", 1e4), ("inertia", 1e5), ("arm", 100), ("gravity", 100), ("max_thrust", 1e6), ("max_speed", 100),
        ("max_climb", 100), ("max_climb_acceleration", 0.9 * made.gravity), ("max_turn_acceleration", 1e5),
    ):  # fmt: skip
        check_range(name, getattr(made, name), 0, high, open_low=True)
    check_range("induced_drag", made.induced_drag, 0, 10)
    check_range("max_tilt_slope", made.max_tilt_slope, 0, 1.732, open_low=True, remedy="At most 60°.")
    weight = made.mass * made.gravity
    if made.max_thrust <= weight:
        raise InvalidParameterError("max_thrust", made.max_thrust, f"more than the weight, {weight:.1f} N")
    return made


@kernel
def quadrotor_rates(pitch, u, w, pitch_rate, thrust, moment, p):
    """Rates of (x, z, pitch, u, w, pitch rate) under ``thrust`` N and ``moment`` N·m; see the module."""
    s, c = sine_cosine(pitch)
    return (
        c * u + s * w,
        c * w - s * u,
        pitch_rate,
        -p.gravity * s - thrust * p.induced_drag * u / p.mass - pitch_rate * w,
        p.gravity * c - thrust / p.mass + pitch_rate * u,
        moment / p.inertia,
    )


@kernel
def quadrotor_step(x, z, pitch, u, w, pitch_rate, thrust, moment, p, dt):
    """State after ``dt`` s of constant ``thrust`` N and ``moment`` N·m: classical Runge–Kutta, order 4."""
    h = 0.5 * dt
    x1, z1, t1, u1, w1, q1 = quadrotor_rates(pitch, u, w, pitch_rate, thrust, moment, p)
    x2, z2, t2, u2, w2, q2 = quadrotor_rates(
        pitch + h * t1, u + h * u1, w + h * w1, pitch_rate + h * q1, thrust, moment, p
    )
    x3, z3, t3, u3, w3, q3 = quadrotor_rates(
        pitch + h * t2, u + h * u2, w + h * w2, pitch_rate + h * q2, thrust, moment, p
    )
    x4, z4, t4, u4, w4, q4 = quadrotor_rates(
        pitch + dt * t3, u + dt * u3, w + dt * w3, pitch_rate + dt * q3, thrust, moment, p
    )
    return (
        runge_kutta(x, dt, x1, x2, x3, x4),
        runge_kutta(z, dt, z1, z2, z3, z4),
        runge_kutta(pitch, dt, t1, t2, t3, t4),
        runge_kutta(u, dt, u1, u2, u3, u4),
        runge_kutta(w, dt, w1, w2, w3, w4),
        runge_kutta(pitch_rate, dt, q1, q2, q3, q4),
    )


@kernel
def quadrotor_velocity(pitch, u, w):
    """Inertial velocity (ẋ, ż), m/s."""
    s, c = sine_cosine(pitch)
    return c * u + s * w, c * w - s * u


@kernel
def rotor_thrusts(thrust, moment, p):
    """Thrusts (T1, T2), N, of the two rotors for ``thrust`` and ``moment``: the mixer, each rotor within its bounds.

    Thrust is bounded first, so that a rotor can still turn a vehicle that should not push.
    """
    thrust = bounded(thrust, 0.0, p.max_thrust)
    difference = moment / p.arm
    most = 0.5 * p.max_thrust
    return bounded(0.5 * (thrust - difference), 0.0, most), bounded(0.5 * (thrust + difference), 0.0, most)


@kernel
def quadrotor_control(
    x, z, pitch, u, w, pitch_rate, int_x, int_z, int_vx, int_vz, int_pitch, want_x, want_z,
    x_by_position, z_by_position, p, dt,
):  # fmt: skip
    """Thrust, N, and moment, N·m, as the saturated rotors give them, and the five integrals after ``dt`` s.

    ``want_x``, ``want_z``: positions, m, where ``x_by_position``, ``z_by_position``; else velocities, m/s.
    """
    s, c = sine_cosine(pitch)
    vx = c * u + s * w
    vz = c * w - s * u
    want_vx = want_x
    want_vz = want_z
    if x_by_position:
        want_vx, int_x = pid(want_x - x, -vx, int_x, p.position, p.max_speed, dt)
    if z_by_position:
        want_vz, int_z = pid(want_z - z, -vz, int_z, p.altitude, p.max_climb, dt)
    down, int_vz = pid(want_vz - vz, 0.0, int_vz, p.climb, p.max_climb_acceleration, dt)
    lift = p.gravity - down
    forward, int_vx = pid(want_vx - vx, 0.0, int_vx, p.velocity, lift * p.max_tilt_slope, dt)
    want_pitch = -arc_tangent(forward, lift)
    turn, int_pitch = pid(
        smallest_turn(want_pitch, pitch), -pitch_rate, int_pitch, p.attitude, p.max_turn_acceleration, dt
    )
    first, second = rotor_thrusts(p.mass * (lift * c - forward * s), p.inertia * turn, p)
    return first + second, p.arm * (second - first), int_x, int_z, int_vx, int_vz, int_pitch


@loop_kernel
def fly(state, integrals, wanted, x_by_position, z_by_position, p, dt, track):
    """Follow ``wanted`` (n, 2), a command (x, z) a step of ``dt`` s; see :func:`quadrotor_control`.

    ``state`` (6,) and ``integrals`` (5,), in the order of :data:`STATES` and :data:`INTEGRALS`, are advanced in place;
    ``track`` (n + 1, 6) gets every state.
    """
    x, z, pitch, u, w, rate = state[0], state[1], state[2], state[3], state[4], state[5]
    ix, iz, ivx, ivz, ip = integrals[0], integrals[1], integrals[2], integrals[3], integrals[4]
    for k in range(wanted.shape[0] + 1):
        track[k, 0] = x
        track[k, 1] = z
        track[k, 2] = pitch
        track[k, 3] = u
        track[k, 4] = w
        track[k, 5] = rate
        if k < wanted.shape[0]:
            thrust, moment, ix, iz, ivx, ivz, ip = quadrotor_control(
                x, z, pitch, u, w, rate, ix, iz, ivx, ivz, ip, wanted[k, 0], wanted[k, 1], x_by_position,
                z_by_position, p, dt,
            )  # fmt: skip
            x, z, pitch, u, w, rate = quadrotor_step(x, z, pitch, u, w, rate, thrust, moment, p, dt)
    state[:] = track[wanted.shape[0]]
    integrals[0] = ix
    integrals[1] = iz
    integrals[2] = ivx
    integrals[3] = ivz
    integrals[4] = ip

"""Planar submerged vehicle with four thrusters and a cascaded controller (Toombs 2022, ch. 3.2; SPEC §10).

North-east-down: x forward, z down, m; pitch θ, rad, positive nose up; u, w the inertial velocity in body axes, m/s.
With (c, s) the cosine and sine of θ, weight m g, buoyancy B = ρ g V and its centre a height h over that of mass:

    ẋ = c u + s w            m u̇ = -(m g - B) s + F_x - (d_u + D_u |u|) u - m θ̇ w
    ż = -s u + c w           m ẇ = (m g - B) c + F_z - (d_w + D_w |w|) w + m θ̇ u
                             J θ̈ = M - B h s - (d_q + D_q |θ̇|) θ̇

Thrusters: F_z = -T1 - T2, M = d (T2 - T1), F_x = T3 - T4 with T4 = -T3. Deeply submerged, in still water, without
tether and, as published, without added mass.

Controller: position → velocity → force, and attitude → moment apart from it: the vehicle holds any pitch while it
moves. Pitch turns the shorter way round (alg. 1). Departure from the paper: the force that the velocity controller asks
for along x and z is turned into body axes before it is mixed; eq. 3.20 takes the two for one.
"""

from __future__ import annotations

from typing import NamedTuple

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.angles import sine_cosine, smallest_turn
from aquaquad_envs.physics.pid import Gains, bounded, pid
from aquaquad_envs.physics.vehicle import runge_kutta


class Rov(NamedTuple):
    """Parameters, SI; the defaults are a BlueROV2 Heavy in fresh water, the published test tank.

    Mass, inertia, damping, volume and centre of buoyancy: von Benzon et al., "An open-source benchmark simulator:
    control of a BlueROV2 underwater robot", J. Mar. Sci. Eng. 10, 1898, 2022. A modelled thruster stands for a
    pair of T200, 40 N each way at 16 V (the lesser, reverse one; Blue Robotics). Gains are free.
    """

    mass: float = 13.5
    inertia: float = 0.23
    arm: float = 0.12
    gravity: float = 9.81
    water_density: float = 1000.0
    volume: float = 0.0134
    #: m, of the centre of buoyancy over that of mass
    buoyancy_height: float = 0.01
    #: N·s/m and N·s²/m²
    drag_u: float = 13.7
    drag_uu: float = 141.0
    drag_w: float = 33.0
    drag_ww: float = 190.0
    #: N·m·s/rad and N·m·s²/rad²
    drag_q: float = 0.8
    drag_qq: float = 0.47
    #: N, either way, of each of the four
    max_thrust: float = 80.0
    #: m/s, of what the position controller commands
    max_speed: float = 1.0
    #: N·m
    max_moment: float = 10.0
    position: Gains = Gains(0.6)
    velocity: Gains = Gains(200.0, 100.0)
    attitude: Gains = Gains(12.0, 3.0, 2.5)


def make_rov(**values: float | Gains) -> Rov:
    """A vehicle with ``values`` in place of the defaults; ``InvalidParameterError`` for what is out of bounds."""
    unknown = sorted(set(values) - set(Rov._fields))
    if unknown:
        raise InvalidParameterError(unknown[0], values[unknown[0]], "one of " + ", ".join(Rov._fields))
    made = Rov(**values)  # type: ignore[arg-type]
    for name in (
        "mass",
        "inertia",
        "arm",
        "gravity",
        "water_density",
        "max_thrust",
        "max_speed",
        "max_moment",
    ):
        check_range(name, getattr(made, name), 0, 1e6, open_low=True)
    for name in ("volume", "buoyancy_height", "drag_u", "drag_uu", "drag_w", "drag_ww", "drag_q", "drag_qq"):
        check_range(name, getattr(made, name), 0, 1e6)
    return made


@kernel
def rov_rates(pitch, u, w, pitch_rate, surge, heave, moment, p):
    """Rates of (x, z, pitch, u, w, pitch rate) under body forces ``surge``, ``heave`` N and ``moment`` N·m."""
    s, c = sine_cosine(pitch)
    buoyancy = p.water_density * p.gravity * p.volume
    sinking = p.mass * p.gravity - buoyancy
    drag_u = (p.drag_u + p.drag_uu * abs(u)) * u
    drag_w = (p.drag_w + p.drag_ww * abs(w)) * w
    drag_q = (p.drag_q + p.drag_qq * abs(pitch_rate)) * pitch_rate
    return (
        c * u + s * w,
        c * w - s * u,
        pitch_rate,
        (surge - sinking * s - drag_u) / p.mass - pitch_rate * w,
        (heave + sinking * c - drag_w) / p.mass + pitch_rate * u,
        (moment - buoyancy * p.buoyancy_height * s - drag_q) / p.inertia,
    )


@kernel
def rov_step(x, z, pitch, u, w, pitch_rate, surge, heave, moment, p, dt):
    """State after ``dt`` s of constant body forces, N, and ``moment``, N·m: classical Runge–Kutta, order 4.

    Where a velocity changes sign its quadratic drag has a kink, and the order falls to three.
    """
    h = 0.5 * dt
    x1, z1, t1, u1, w1, q1 = rov_rates(pitch, u, w, pitch_rate, surge, heave, moment, p)
    x2, z2, t2, u2, w2, q2 = rov_rates(
        pitch + h * t1, u + h * u1, w + h * w1, pitch_rate + h * q1, surge, heave, moment, p
    )
    x3, z3, t3, u3, w3, q3 = rov_rates(
        pitch + h * t2, u + h * u2, w + h * w2, pitch_rate + h * q2, surge, heave, moment, p
    )
    x4, z4, t4, u4, w4, q4 = rov_rates(
        pitch + dt * t3, u + dt * u3, w + dt * w3, pitch_rate + dt * q3, surge, heave, moment, p
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
def thruster_forces(surge, heave, moment, p):
    """Thrusts (T1, T2, T3), N, T4 = -T3, for body forces and ``moment``: the mixer, each thruster within its bounds."""
    turning = moment / p.arm
    return (
        bounded(0.5 * (-heave - turning), -p.max_thrust, p.max_thrust),
        bounded(0.5 * (-heave + turning), -p.max_thrust, p.max_thrust),
        bounded(0.5 * surge, -p.max_thrust, p.max_thrust),
    )


@kernel
def trimmed_integral(p):
    """Integral of the vertical velocity controller that holds the vehicle's weight in water, m; 0 without its gain."""
    gain = p.velocity.integral
    return p.gravity * (p.water_density * p.volume - p.mass) / gain if gain > 0.0 else 0.0


@kernel
def rov_control(
    x, z, pitch, u, w, pitch_rate, int_x, int_z, int_vx, int_vz, int_pitch, want_x, want_z, want_pitch,
    x_by_position, z_by_position, p, dt,
):  # fmt: skip
    """Body forces (surge, heave), N, and moment, N·m, as the thrusters give them, and five integrals after ``dt`` s.

    ``want_x``, ``want_z``: positions, m, where ``x_by_position``, ``z_by_position``; else velocities, m/s.
    ``want_pitch`` in rad.
    """
    s, c = sine_cosine(pitch)
    vx = c * u + s * w
    vz = c * w - s * u
    want_vx = want_x
    want_vz = want_z
    if x_by_position:
        want_vx, int_x = pid(want_x - x, -vx, int_x, p.position, p.max_speed, dt)
    if z_by_position:
        want_vz, int_z = pid(want_z - z, -vz, int_z, p.position, p.max_speed, dt)
    most = 2.0 * p.max_thrust
    force_x, int_vx = pid(want_vx - vx, 0.0, int_vx, p.velocity, most, dt)
    force_z, int_vz = pid(want_vz - vz, 0.0, int_vz, p.velocity, most, dt)
    moment, int_pitch = pid(
        smallest_turn(want_pitch, pitch), -pitch_rate, int_pitch, p.attitude, p.max_moment, dt
    )
    first, second, third = thruster_forces(c * force_x - s * force_z, s * force_x + c * force_z, moment, p)
    return 2.0 * third, -first - second, p.arm * (second - first), int_x, int_z, int_vx, int_vz, int_pitch


@loop_kernel
def dive(state, integrals, wanted, x_by_position, z_by_position, p, dt, track):
    """Follow ``wanted`` (n, 3), a command (x, z, pitch) a step of ``dt`` s; see :func:`rov_control`.

    ``state`` (6,): x, z, pitch, u, w, pitch rate, and ``integrals`` (5,) are advanced in place; ``track`` (n + 1, 6)
    gets every state.
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
            surge, heave, moment, ix, iz, ivx, ivz, ip = rov_control(
                x, z, pitch, u, w, rate, ix, iz, ivx, ivz, ip, wanted[k, 0], wanted[k, 1], wanted[k, 2],
                x_by_position, z_by_position, p, dt,
            )  # fmt: skip
            x, z, pitch, u, w, rate = rov_step(x, z, pitch, u, w, rate, surge, heave, moment, p, dt)
    state[:] = track[wanted.shape[0]]
    integrals[0] = ix
    integrals[1] = iz
    integrals[2] = ivx
    integrals[3] = ivz
    integrals[4] = ip

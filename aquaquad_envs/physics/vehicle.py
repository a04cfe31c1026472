"""Switched drift/flight kinematics of the AquaQuad.

ẋ = δ V cos ψ + (1-δ) u, ẏ = δ V sin ψ + (1-δ) v, with δ = 1 in flight (no wind) and δ = 0
adrift, x east and y north in m, (u, v) the current in m/s, V the air speed in m/s
(Dobrokhodov et al., OCEANS 2016, eq. 1). Flight is straight at constant speed, hence exact;
drift is integrated.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.currents import current_at


@kernel
def current_after(velocity, k, axes, t, x, y, h, u, v):
    """Current (u, v), m/s, that is met after moving for ``h`` s at (u, v) from (x, y) at time ``t``."""
    return current_at(velocity, k, axes, t + h, x + h * u, y + h * v)


@kernel
def runge_kutta(x, dt, k1, k2, k3, k4):
    """``x`` advanced by ``dt`` s from its four rates (classical Runge–Kutta)."""
    return x + dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@kernel
def drift_step(velocity, k, axes, t, x, y, dt, euler):
    """Position (x, y), m, after drifting for ``dt`` s from (x, y) at time ``t``.

    Classical Runge–Kutta of fourth order; forward Euler where ``euler`` (the published
    variant, Dillard 2014, App. C). The order holds inside a cell, where the field is smooth;
    across cell edges a bilinear field has a kink and the order falls to two.
    """
    u1, v1 = current_at(velocity, k, axes, t, x, y)
    if euler:
        return x + dt * u1, y + dt * v1
    u2, v2 = current_after(velocity, k, axes, t, x, y, 0.5 * dt, u1, v1)
    u3, v3 = current_after(velocity, k, axes, t, x, y, 0.5 * dt, u2, v2)
    u4, v4 = current_after(velocity, k, axes, t, x, y, dt, u3, v3)
    return runge_kutta(x, dt, u1, u2, u3, u4), runge_kutta(y, dt, v1, v2, v3, v4)


@kernel
def flight_time(distance, airspeed):
    """Time, s, to fly ``distance`` m at ``airspeed`` m/s."""
    return distance / airspeed


@kernel
def flight_energy_wh(distance, airspeed, flight_power):
    """Energy, Wh, to fly ``distance`` m at ``airspeed`` m/s and ``flight_power`` W."""
    return flight_power * flight_time(distance, airspeed) / 3600.0


@kernel
def inside_box(x, y, half_width):
    """Whether (x, y) lies in the mission box ``[-half_width, half_width]²``, m (edges included)."""
    return np.abs(x) <= half_width and np.abs(y) <= half_width

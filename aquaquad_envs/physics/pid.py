"""A controller of the cascades: proportional, integral and derivative, saturated, its integral kept from winding up."""

from __future__ import annotations

from typing import NamedTuple

from aquaquad_envs.compilation import kernel


class Gains(NamedTuple):
    """Gains on the error, its integral (1/s) and its rate (s), in units of output a unit of error."""

    proportional: float
    integral: float = 0.0
    derivative: float = 0.0


@kernel
def bounded(value, low, high):
    """``value`` held in [low, high]."""
    value = value if value > low else low
    return value if value < high else high


@kernel
def pid(error, error_rate, integral, gains, limit, dt):
    """Output within ±``limit``, and the integral of the error after ``dt`` s.

    output = k_p e + k_i ∫e dt + k_d ė. Anti-windup: while the output is saturated, an error that would drive it
    further is not integrated (conditional integration; Åström and Hägglund, *PID Controllers*, 1995, sec. 3.5). The
    caller gives the rate ė, of states that it knows, so that a step of the command makes no spike.
    """
    wanted = gains.proportional * error + gains.integral * integral + gains.derivative * error_rate
    output = bounded(wanted, -limit, limit)
    winding = output != wanted and wanted * error > 0.0
    return output, integral + (0.0 if winding else error * dt)

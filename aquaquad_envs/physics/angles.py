"""Angles without the system's trigonometry: plain arithmetic, so that loops over many worlds become SIMD code."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel

# π/2 in two parts: multiples of the first, of few digits, are exact; the cosine is what a float leaves of π/2.
_QUARTER = float(np.float32(np.pi / 2))
_QUARTER_REST = np.pi / 2 - _QUARTER + float(np.cos(np.pi / 2))


@kernel
def sine_cosine(angle):
    """(sin, cos) of ``angle``, rad, within 3e-16 for angles up to 1000.

    Taylor series about the nearest quarter turn, 0.79 rad away at most: terms beyond the 16th power are below rounding.
    """
    turns = np.rint(angle * (2.0 / np.pi))
    x = (angle - turns * _QUARTER) - turns * _QUARTER_REST
    y = x * x
    sin = x * (1 + y * (-1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (
        1 / 362880 + y * (-1 / 39916800 + y * (1 / 6227020800 - y * (1 / 1307674368000))))))))  # fmt: skip
    cos = 1 + y * (-1 / 2 + y * (1 / 24 + y * (-1 / 720 + y * (1 / 40320 + y * (
        -1 / 3628800 + y * (1 / 479001600 - y * (1 / 87178291200 - y * (1 / 20922789888000))))))))  # fmt: skip
    # Quarter turns 0 to 3 exchange the two and change their signs.
    quarter = turns - 4.0 * np.floor(0.25 * turns)
    odd = quarter == 1.0 or quarter == 3.0
    s = cos if odd else sin
    c = sin if odd else cos
    return (-s if quarter >= 2.0 else s), (-c if quarter == 1.0 or quarter == 2.0 else c)


@kernel
def arc_tangent(y, x):
    """Angle of the vector (x, y), rad, for x > 0 and angles up to π/3 either way, within 1e-15.

    Halved twice, tan(φ/2) = y / (x + √(x² + y²)), it is 15° at most, where 14 terms of the series do.
    """
    half = y / (x + np.sqrt(x * x + y * y))
    t = half / (1.0 + np.sqrt(1.0 + half * half))
    z = t * t
    return 4.0 * t * (1 + z * (-1 / 3 + z * (1 / 5 + z * (-1 / 7 + z * (1 / 9 + z * (-1 / 11 + z * (
        1 / 13 + z * (-1 / 15 + z * (1 / 17 + z * (-1 / 19 + z * (1 / 21 + z * (-1 / 23 + z * (
        1 / 25 - z * (1 / 27))))))))))))))  # fmt: skip


@kernel
def smallest_turn(wanted, angle):
    """What is left to turn from ``angle`` to ``wanted``, rad in [-π, π]: the shorter way (Toombs 2022, alg. 1)."""
    turn = wanted - angle
    return turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))

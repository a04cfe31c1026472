"""What one more range tells of a point: the gain in ln det Y, and how it changes with the place of the vehicle.

A range of standard deviation σ from p to a point at p + d adds σ⁻² e eᵀ, e = d / ‖d‖, to the point's information
matrix Y (3 × 3, packed as :mod:`aquaquad_envs.estimation.symmetric3` has it). By the matrix determinant lemma

    det(Y + w e eᵀ) = det Y (1 + w eᵀ C e),    C = Y⁻¹,  w = σ⁻²,

and by Sherman and Morrison (Y + w e eᵀ)⁻¹ = C - w C e eᵀ C / (1 + w eᵀ C e): along a tree of plans each step costs
one product of a matrix and a vector (SPEC §8; Garcia, UC Riverside 2018, eq. 4.20 to 4.30). ``d`` in m, ``weight`` w
in 1/m². A point at the very place of the vehicle (d = 0) gives no direction, and no gain.
"""

from __future__ import annotations

from aquaquad_envs.compilation import kernel
from aquaquad_envs.estimation.symmetric3 import quadratic3


@kernel
def gain_factor(c, dx, dy, dz, weight):
    """Det(Y + w e eᵀ) / det Y = 1 + w eᵀ C e, of the packed covariance ``c`` = Y⁻¹."""
    square = dx * dx + dy * dy + dz * dz
    return 1.0 + weight * quadratic3(c, dx, dy, dz) / square if square > 0.0 else 1.0


@kernel
def take_range(c, dx, dy, dz, weight, after):
    """Write the covariance after one more range into ``after`` (may be ``c``); returns :func:`gain_factor`."""
    square = dx * dx + dy * dy + dz * dz
    scale = weight / square if square > 0.0 else 0.0
    x = c[0] * dx + c[1] * dy + c[2] * dz
    y = c[1] * dx + c[3] * dy + c[4] * dz
    z = c[2] * dx + c[4] * dy + c[5] * dz
    factor = 1.0 + scale * (dx * x + dy * y + dz * z)
    scale /= factor
    after[0] = c[0] - scale * x * x
    after[1] = c[1] - scale * x * y
    after[2] = c[2] - scale * x * z
    after[3] = c[3] - scale * y * y
    after[4] = c[4] - scale * y * z
    after[5] = c[5] - scale * z * z
    return factor


@kernel
def gain_slope(c, dx, dy, dz, weight):
    """∂ ln det Y / ∂p, 1/m, east and north, of a range taken at p: -(2 w / ‖d‖) (I - e eᵀ) C e.

    ``c`` is the covariance with that range, and all others, in it. The direction of the point changes with the place,
    d = p_T - p, its position does not.
    """
    square = dx * dx + dy * dy + dz * dz
    if square <= 0.0:
        return 0.0, 0.0
    x = c[0] * dx + c[1] * dy + c[2] * dz
    y = c[1] * dx + c[3] * dy + c[4] * dz
    z = c[2] * dx + c[4] * dy + c[5] * dz
    along = (dx * x + dy * y + dz * z) / square
    scale = -2.0 * weight / square
    return scale * (x - along * dx), scale * (y - along * dy)

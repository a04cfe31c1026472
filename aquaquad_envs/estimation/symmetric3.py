"""Symmetric 3 × 3 matrices of points in space, packed as (xx, xy, xz, yy, yz, zz), for kernels.

Information and covariance of one submerged point; :mod:`aquaquad_envs.estimation.small_matrices` serves other sizes.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel

#: Length of a packed matrix.
PACKED = 6
#: Sweeps of Jacobi rotations; six bring any 3 × 3 matrix to rounding.
_SWEEPS = 6


@kernel
def add_line_of_sight(y, dx, dy, dz, weight):
    """Y ← Y + ``weight`` e eᵀ with e = d / ‖d‖, the direction of a range, in place; nothing where d is zero."""
    square = dx * dx + dy * dy + dz * dz
    scale = weight / square if square > 0.0 else 0.0
    y[0] += scale * dx * dx
    y[1] += scale * dx * dy
    y[2] += scale * dx * dz
    y[3] += scale * dy * dy
    y[4] += scale * dy * dz
    y[5] += scale * dz * dz


@kernel
def determinant3(y):
    """Det Y."""
    return (
        y[0] * (y[3] * y[5] - y[4] * y[4])
        - y[1] * (y[1] * y[5] - y[4] * y[2])
        + y[2] * (y[1] * y[4] - y[3] * y[2])
    )


@kernel
def log_determinant3(y):
    """Natural logarithm of det Y; -inf where Y is not positive definite to rounding.

    By the pivots of its Cholesky factor, which keep the digits that sums of products lose when one range is worth far
    more than the prior.
    """
    first = y[0]
    second = y[3] - y[1] * y[1] / first
    mixed = y[4] - y[1] * y[2] / first
    third = y[5] - y[2] * y[2] / first - mixed * mixed / second
    return np.log(first * second * third) if first > 0.0 and second > 0.0 and third > 0.0 else -np.inf


@kernel
def invert3(y, inverse):
    """Y⁻¹, packed, into ``inverse``; inf on the diagonal and 0 beside it where Y is singular."""
    value = determinant3(y)
    if not value > 0.0:
        inverse[0] = np.inf
        inverse[1] = 0.0
        inverse[2] = 0.0
        inverse[3] = np.inf
        inverse[4] = 0.0
        inverse[5] = np.inf
        return
    scale = 1.0 / value
    xx = scale * (y[3] * y[5] - y[4] * y[4])
    xy = scale * (y[2] * y[4] - y[1] * y[5])
    xz = scale * (y[1] * y[4] - y[2] * y[3])
    yy = scale * (y[0] * y[5] - y[2] * y[2])
    yz = scale * (y[1] * y[2] - y[0] * y[4])
    zz = scale * (y[0] * y[3] - y[1] * y[1])
    inverse[0] = xx
    inverse[1] = xy
    inverse[2] = xz
    inverse[3] = yy
    inverse[4] = yz
    inverse[5] = zz


@kernel
def quadratic3(y, ex, ey, ez):
    """eᵀ Y e."""
    return (
        ex * (y[0] * ex + 2.0 * (y[1] * ey + y[2] * ez)) + ey * (y[3] * ey + 2.0 * y[4] * ez) + y[5] * ez * ez
    )


@kernel
def solve3(y, bx, by, bz):
    """Y⁻¹ b of a positive definite Y, by its Cholesky factor; NaN where Y is not."""
    l00 = np.sqrt(y[0])
    l10 = y[1] / l00
    l20 = y[2] / l00
    l11 = np.sqrt(y[3] - l10 * l10)
    l21 = (y[4] - l20 * l10) / l11
    l22 = np.sqrt(y[5] - l20 * l20 - l21 * l21)
    u0 = bx / l00
    u1 = (by - l10 * u0) / l11
    u2 = (bz - l20 * u0 - l21 * u1) / l22
    z = u2 / l22
    v = (u1 - l21 * z) / l11
    return (u0 - l10 * v - l20 * z) / l00, v, z


@kernel
def _rotate(a, v, p, q):
    """One Jacobi rotation that zeroes ``a[p, q]``; the columns of ``v`` turn with it."""
    if a[p, q] == 0.0:
        return
    theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
    t = t if theta >= 0.0 else -t
    c = 1.0 / np.sqrt(t * t + 1.0)
    s = t * c
    r = 3 - p - q
    a[p, p] -= t * a[p, q]
    a[q, q] += t * a[p, q]
    a[p, q] = 0.0
    a[q, p] = 0.0
    rp = a[r, p]
    rq = a[r, q]
    a[r, p] = c * rp - s * rq
    a[p, r] = a[r, p]
    a[r, q] = s * rp + c * rq
    a[q, r] = a[r, q]
    for k in range(3):
        vp = v[k, p]
        vq = v[k, q]
        v[k, p] = c * vp - s * vq
        v[k, q] = s * vp + c * vq


@kernel
def eigen3(y, work, values, vectors):
    """Eigenvalues of Y, greatest first, into ``values`` (3,), unit eigenvectors into the columns of ``vectors`` (3, 3).

    Cyclic Jacobi rotations (Golub and Van Loan, Matrix Computations, 8.5). ``work`` (3, 3) is scratch. The sign of a
    vector is free.
    """
    work[0, 0] = y[0]
    work[0, 1] = work[1, 0] = y[1]
    work[0, 2] = work[2, 0] = y[2]
    work[1, 1] = y[3]
    work[1, 2] = work[2, 1] = y[4]
    work[2, 2] = y[5]
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        _rotate(work, vectors, 0, 1)
        _rotate(work, vectors, 0, 2)
        _rotate(work, vectors, 1, 2)
    for i in range(3):
        values[i] = work[i, i]
    for i in range(2):
        for j in range(2 - i):
            if values[j] < values[j + 1]:
                lower = values[j]
                values[j] = values[j + 1]
                values[j + 1] = lower
                for k in range(3):
                    swapped = vectors[k, j]
                    vectors[k, j] = vectors[k, j + 1]
                    vectors[k, j + 1] = swapped

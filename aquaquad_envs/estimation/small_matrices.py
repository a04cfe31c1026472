"""Linear algebra of small symmetric matrices by hand, for kernels: factor, solve, orthogonal update.

Sizes are those of one track (2 to 6 states): a library call would cost more than the work itself.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel

#: A pivot below this share of its diagonal element is lost in rounding: the matrix counts as indefinite.
LOST_PIVOT = 4e-15
#: What a repair raises it to.
RAISED_PIVOT = 1e-12


@kernel
def _repair_row(matrix, factor, j):
    """Row ``j`` of the factor of a matrix that is not positive definite there: variance kept, correlations shrunk."""
    greatest = 0.0
    for i in range(matrix.shape[0]):
        greatest = max(greatest, matrix[i, i])
    variance = max(matrix[j, j], RAISED_PIVOT * greatest, 1e-200)
    pivot = RAISED_PIVOT * variance
    total = 0.0
    for k in range(j):
        total += factor[j, k] * factor[j, k]
    shrink = np.sqrt((variance - pivot) / total) if total > variance - pivot else 1.0
    for k in range(j):
        factor[j, k] *= shrink
    factor[j, j] = np.sqrt(pivot)


@kernel
def cholesky(matrix, factor):
    """Lower triangle L of ``matrix`` = L Lᵀ into the leading (n, n) of ``factor``; returns 1 if repaired, else 0.

    ``matrix`` is (n, n), symmetric and finite; its upper triangle is read, nothing above L's
    diagonal is written. Where a pivot is not above ``LOST_PIVOT`` of its diagonal element the matrix
    is not positive definite to working accuracy. It is then repaired: that variance is kept (a small
    one given where it is not positive), its correlations with the states before are shrunk until ``RAISED_PIVOT`` of
    it remains, and the states after it lose what correlation they had with the remainder (in a positive
    semi-definite matrix they had none). So L Lᵀ is positive definite and no variance grows.
    """
    n = matrix.shape[0]
    repaired = 0
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        # Written so that NaN is repaired too.
        if pivot > LOST_PIVOT * matrix[j, j] and pivot > 0.0:
            root = np.sqrt(pivot)
            factor[j, j] = root
            inverse = 1.0 / root
            for i in range(j + 1, n):
                total = matrix[j, i]
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                factor[i, j] = total * inverse
        else:
            repaired = 1
            _repair_row(matrix, factor, j)
            for i in range(j + 1, n):
                factor[i, j] = 0.0
    return repaired


@kernel
def mahalanobis_squared(factor, vector, n):
    """eᵀ (L Lᵀ)⁻¹ e of e = ``vector`` (n,), with L the leading (n, n) of ``factor``; overwrites ``vector`` by L⁻¹ e."""
    total = 0.0
    for i in range(n):
        value = vector[i]
        for k in range(i):
            value -= factor[i, k] * vector[k]
        value /= factor[i, i]
        vector[i] = value
        total += value * value
    return total


@kernel
def inverse_from_cholesky(factor, inverse, n):
    """(L Lᵀ)⁻¹ into ``inverse`` (n, n), exactly symmetric; the leading (n, n) of ``factor`` becomes L⁻¹."""
    for j in range(n):
        factor[j, j] = 1.0 / factor[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= factor[i, k] * factor[k, j]
            factor[i, j] = total / factor[i, i]
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(j, n):
                total += factor[k, i] * factor[k, j]
            inverse[i, j] = total
            inverse[j, i] = total


@kernel
def triangularize(work, first, rows, columns, top, keep):
    """Rotate ``rows`` rows of ``work`` orthogonally into an identity matrix standing on top of them.

    The stacked matrix [I; B | 0; b], B = ``work[first : first + rows, :columns]`` and b the column
    after it, becomes [U; 0 | c; r] with U upper triangular, UᵀU = I + BᵀB, by Householder reflections.
    Only the last ``keep`` rows and columns of U and c are stored, at ``work[top : top + keep, : keep + 1]``.
    Returns |r|² = bᵀ(I + B Bᵀ)⁻¹ b. U's diagonal is at least 1 whatever the data, and no square
    of B is ever inverted: digits are lost with B's condition, not with its square.
    """
    drop = columns - keep
    for j in range(columns):
        total = 0.0
        for i in range(first, first + rows):
            total += work[i, j] * work[i, j]
        norm = np.sqrt(1.0 + total)
        along = 1.0 / norm
        across = along / (1.0 + norm)
        if j >= drop:
            work[top + j - drop, j - drop] = norm
        for k in range(j + 1, columns + 1):
            dot = 0.0
            for i in range(first, first + rows):
                dot += work[i, j] * work[i, k]
            if j >= drop:
                work[top + j - drop, k - drop] = dot * along
            dot *= across
            for i in range(first, first + rows):
                work[i, k] -= work[i, j] * dot
    left = 0.0
    for i in range(first, first + rows):
        left += work[i, columns] * work[i, columns]
    return left

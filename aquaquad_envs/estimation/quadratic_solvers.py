"""Scratch and solvers of the quadratic fit (:mod:`aquaquad_envs.estimation.quadratic_fit`), by LAPACK.

Every fit begins with R of the QR factors of [D | f], of eleven columns at most: whatever follows works on that square.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.lapack import address, dgelsd, dgeqrf, dgesvd

#: Bits of the axes that a fit uses.
AXIS_X, AXIS_Y, AXIS_Z = 1, 2, 4
#: A fit's numbers: a₀, g (x, y, z), H (xx, xy, xz, yy, yz, zz).
COEFFICIENTS = 10
_WIDTH = COEFFICIENTS + 1
_WORK = 2048
# Places of the whole numbers that LAPACK reads and writes.
_ROWS, _COLUMNS, _LEADING, _ROOM, _INFO, _ONE, _RANK, _SQUARE, _NONE, _ALL, _SCRATCH = range(11)


class FitSpace(NamedTuple):
    """Scratch of one fit at a time; matrices column by column, as LAPACK has them: ``design[j, i]`` is D_ij."""

    design: Any
    factor: Any
    again: Any
    vectors: Any
    singular: Any
    solution: Any
    work: Any
    integers: Any
    columns: Any
    row: Any
    packed: Any
    turned: Any
    eigenvalues: Any
    eigenvectors: Any


@loop_kernel
def fit_space(readings):
    """Scratch for fits of up to ``readings`` readings: make it once, use it for any number of fits in one thread."""
    integers = np.zeros(256, np.int64)
    integers[_ROOM] = _WORK
    integers[_ONE] = 1
    integers[_SQUARE] = _WIDTH
    integers[_NONE] = 78  # "N": no vectors
    integers[_ALL] = 65  # "A": all of them
    rows = max(readings, _WIDTH)
    integers[_LEADING] = rows
    return FitSpace(
        np.zeros((_WIDTH, rows)),
        np.zeros((_WIDTH, _WIDTH)),
        np.zeros((_WIDTH, _WIDTH)),
        np.zeros((_WIDTH, _WIDTH)),
        np.zeros(_WIDTH),
        np.zeros(_WIDTH),
        np.zeros(_WORK),
        integers,
        np.zeros(_WIDTH, np.int64),
        np.zeros(COEFFICIENTS),
        np.zeros(6),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros((3, 3)),
    )


@kernel
def name_columns(columns, axes):
    """Which coefficient each column of D belongs to, into ``columns``; returns how many there are."""
    x = axes & AXIS_X != 0
    y = axes & AXIS_Y != 0
    z = axes & AXIS_Z != 0
    count = 0
    for name in range(COEFFICIENTS):
        needs_x = name == 1 or (4 <= name <= 6)
        needs_y = name == 2 or name == 5 or name == 7 or name == 8
        needs_z = name == 3 or name == 6 or name == 8 or name == 9
        if (x or not needs_x) and (y or not needs_y) and (z or not needs_z):
            columns[count] = name
            count += 1
    return count


@kernel
def _monomials(dx, dy, dz, row):
    """What each coefficient is multiplied by at (dx, dy, dz)."""
    row[0] = 1.0
    row[1] = dx
    row[2] = dy
    row[3] = dz
    row[4] = 0.5 * dx * dx
    row[5] = dx * dy
    row[6] = dx * dz
    row[7] = 0.5 * dy * dy
    row[8] = dy * dz
    row[9] = 0.5 * dz * dz


@loop_kernel
def factorize(points, values, count, cx, cy, cz, axes, space):
    """R of [D | f] into ``space.factor``; returns the unknowns, scale of distance, m, mean and scale of F."""
    x = 1.0 if axes & AXIS_X else 0.0
    y = 1.0 if axes & AXIS_Y else 0.0
    z = 1.0 if axes & AXIS_Z else 0.0
    mean = 0.0
    square = 0.0
    for i in range(count):
        mean += values[i]
        dx = x * (points[i, 0] - cx)
        dy = y * (points[i, 1] - cy)
        dz = z * (points[i, 2] - cz)
        square += dx * dx + dy * dy + dz * dz
    mean /= count
    length = np.sqrt(square / count)
    spread = 0.0
    for i in range(count):
        spread += (values[i] - mean) * (values[i] - mean)
    unit = np.sqrt(spread / count)
    length = length if length > 0.0 else 1.0
    unit = unit if unit > 0.0 else 1.0
    per_m = 1.0 / length
    unknowns = name_columns(space.columns, axes)
    for i in range(count):
        _monomials(
            per_m * (points[i, 0] - cx), per_m * (points[i, 1] - cy), per_m * (points[i, 2] - cz), space.row
        )  # fmt: skip
        for j in range(unknowns):
            space.design[j, i] = space.row[space.columns[j]]
        space.design[unknowns, i] = (values[i] - mean) / unit
    # With fewer readings than columns rows of zeros complete the square: they change nothing.
    rows = max(count, unknowns + 1)
    for j in range(unknowns + 1):
        for i in range(count, rows):
            space.design[j, i] = 0.0
    whole = address(space.integers)
    space.integers[_ROWS] = rows
    space.integers[_COLUMNS] = unknowns + 1
    dgeqrf(
        whole + 8 * _ROWS,
        whole + 8 * _COLUMNS,
        address(space.design),
        whole + 8 * _LEADING,
        address(space.solution),
        address(space.work),
        whole + 8 * _ROOM,
        whole + 8 * _INFO,
    )
    for j in range(unknowns + 1):
        for i in range(unknowns + 1):
            space.factor[j, i] = space.design[j, i] if i <= j else 0.0
    return unknowns, length, mean, unit


@kernel
def _copy_square(space, size):
    for j in range(size):
        for i in range(size):
            space.again[j, i] = space.factor[j, i]


@kernel
def decompose(space, size, vectors):
    """Singular values of the leading (size, size) of R, and if ``vectors`` its right singular vectors, by rows."""
    _copy_square(space, size)
    whole = address(space.integers)
    space.integers[_COLUMNS] = size
    dgesvd(
        whole + 8 * _NONE,
        whole + 8 * (_ALL if vectors else _NONE),
        whole + 8 * _COLUMNS,
        whole + 8 * _COLUMNS,
        address(space.again),
        whole + 8 * _SQUARE,
        address(space.singular),
        address(space.vectors),
        whole + 8 * _SQUARE,
        address(space.vectors),
        whole + 8 * _SQUARE,
        address(space.work),
        whole + 8 * _ROOM,
        whole + 8 * _INFO,
    )


@kernel
def condition_of(singular, size):
    """Greatest over least of ``size`` singular values."""
    return singular[0] / singular[size - 1] if singular[size - 1] > 0.0 else np.inf


@loop_kernel
def solve_qr(space, unknowns):
    """Back substitution; an unknown that nothing determines is 0."""
    decompose(space, unknowns, False)
    for j in range(unknowns - 1, -1, -1):
        total = space.factor[unknowns, j]
        for k in range(j + 1, unknowns):
            total -= space.factor[k, j] * space.solution[k]
        pivot = space.factor[j, j]
        space.solution[j] = total / pivot if pivot != 0.0 else 0.0
    return condition_of(space.singular, unknowns)


@loop_kernel
def solve_svd(space, unknowns, limit):
    """Solution of least norm, singular values below 1 / ``limit`` of the greatest left out."""
    _copy_square(space, unknowns)
    for j in range(unknowns):
        space.solution[j] = space.factor[unknowns, j]
    whole = address(space.integers)
    space.integers[_COLUMNS] = unknowns
    # The share lies at the end of the work that LAPACK is told of.
    share = space.work[_WORK - 1 :]
    share[0] = 1.0 / limit
    space.integers[_ROOM] = _WORK - 1
    dgelsd(
        whole + 8 * _COLUMNS,
        whole + 8 * _COLUMNS,
        whole + 8 * _ONE,
        address(space.again),
        whole + 8 * _SQUARE,
        address(space.solution),
        whole + 8 * _SQUARE,
        address(space.singular),
        address(share),
        whole + 8 * _RANK,
        address(space.work),
        whole + 8 * _ROOM,
        whole + 8 * _SCRATCH,
        whole + 8 * _INFO,
    )
    space.integers[_ROOM] = _WORK
    return condition_of(space.singular, unknowns)


@loop_kernel
def dependent_axis(space, unknowns, axes, limit):
    """The axis whose columns weigh most in the null space of D; call after :func:`decompose` with vectors."""
    name_columns(space.columns, axes)
    worst = -1.0
    chosen = 0
    for axis in range(3):
        if not axes & (1 << axis):
            continue
        line = 1 + axis
        square = 4 if axis == 0 else (7 if axis == 1 else 9)
        weight = 0.0
        for k in range(unknowns):
            # Vectors come as rows of Vᵀ, stored column by column.
            if space.singular[k] * limit < space.singular[0] or space.singular[0] == 0.0:
                for j in range(unknowns):
                    if space.columns[j] == line or space.columns[j] == square:
                        weight += space.vectors[j, k] * space.vectors[j, k]
        # Of equals the last, that is depth, goes first.
        if weight >= worst * (1.0 - 1e-9):
            worst = weight
            chosen = 1 << axis
    return chosen


@loop_kernel
def solve_tls(space, unknowns):
    """Total least squares: the right singular vector of [D | f] of the least singular value."""
    decompose(space, unknowns + 1, True)
    last = space.vectors[unknowns, unknowns]
    for j in range(unknowns):
        # Where the last entry vanishes there is no solution (Golub and Van Loan's nongeneric case).
        space.solution[j] = -space.vectors[j, unknowns] / last if abs(last) > 1e-12 else 0.0

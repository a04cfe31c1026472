"""A quadratic through scattered readings, and the Newton step to its minimum: the core of cooperative plume tracing.

Byrne, Eskridge, Hurtado and Savage, *Algorithms and Analysis for Underwater Vehicle Plume Tracing*, SAND2003-2643,
section 2; SPEC §9. About a robot at c the field is taken to be

    F(c + d) ≈ a₀ + gᵀd + ½ dᵀH d,        D a = f,

one row of D a reading, ten unknowns in space and six in a plane. Three ways to solve it, :data:`METHODS`, each with
the condition number of D; what they do with readings that cannot carry the fit is in :func:`fit_quadratic`. The step is
-H⁻¹g with H made positive definite (the report's displayed update lacks the minus sign: an erratum).

Distances are divided by their root mean square and F by its standard deviation before the fit (the report leaves
both in metres and volts). Least squares do not notice, up to rounding. The condition number then says how the readings
lie and not in which unit they came, and total least squares do not depend on units either.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.quadratic_solvers import (
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    COEFFICIENTS,
    condition_of,
    decompose,
    dependent_axis,
    factorize,
    fit_space,
    solve_qr,
    solve_svd,
    solve_tls,
)
from aquaquad_envs.estimation.symmetric3 import eigen3

QR, SVD, TLS = 0, 1, 2
#: Ways to solve the fit: QR factors, singular value decomposition, total least squares with rank reduction.
METHODS = {"qr": QR, "svd": SVD, "tls": TLS}
#: Axes that a fit may use, as bits.
HORIZONTAL, SPACE = AXIS_X | AXIS_Y, AXIS_X | AXIS_Y | AXIS_Z
#: Above it the readings count as unable to carry the fit; the report gives no number.
CONDITION_LIMIT = 1e4
#: Least eigenvalue of H, F's unit per m², below which the report replaces all by their absolute values. Since a
#: positive one is its own absolute value, any threshold from 0 up has the same effect.
LEAST_CURVATURE = 0.01
#: An eigenvalue this far below the greatest is rounding, and not divided by.
_FLAT = 1e-12


@kernel
def _unknowns(axes):
    count = (axes & 1) + ((axes >> 1) & 1) + ((axes >> 2) & 1)
    return (count + 1) * (count + 2) // 2


@kernel
def _without_depth(axes):
    """The axes of the report's 2-D algorithm, none where they are tried already."""
    return axes & HORIZONTAL if axes & AXIS_Z else 0


@loop_kernel
def fit_quadratic(points, values, count, cx, cy, cz, axes, method, limit, space, out):
    """Fit the first ``count`` readings about (cx, cy, cz); returns (condition number of D, axes that were used).

    points: (≥ count, 3), m; values: (≥ count,), F; axes: bits of those to fit, ``SPACE``, ``HORIZONTAL`` or any;
    method: code of :data:`METHODS`; limit: greatest condition number; space: of :func:`fit_space`; out: (10,),
    a₀ in F's unit, g per m (x, y, z), H per m² (xx, xy, xz, yy, yz, zz), 0 of axes not used.

    Readings too few for the unknowns leave depth out; too few for a plane too, no axis is left, and a₀ is the mean.
    Where the condition number is above ``limit``, QR and SVD leave depth out (the report's method II); a plane that is
    ill-conditioned as well (a line) is kept, and its condition number above ``limit`` says so: SVD then gives
    the solution of least norm. TLS leaves out one axis after the other, each time the one whose columns weigh most in
    D's null space, until the rest is well-conditioned (method I; the report reads the columns from one singular
    vector, which is arbitrary where the null space has several dimensions).
    """
    used = axes
    while used and count < _unknowns(used):
        used = _without_depth(used)
    condition = np.inf
    unknowns = 0
    length = 1.0
    mean = 0.0
    unit = 1.0
    for name in range(COEFFICIENTS):
        out[name] = 0.0
    if count == 0:
        return condition, 0
    while True:
        unknowns, length, mean, unit = factorize(points, values, count, cx, cy, cz, used, space)
        if method == QR:
            condition = solve_qr(space, unknowns)
        elif method == SVD:
            condition = solve_svd(space, unknowns, limit)
        else:
            decompose(space, unknowns, True)
            condition = condition_of(space.singular, unknowns)
        if condition <= limit or used == 0:
            break
        if method == TLS:
            used &= ~dependent_axis(space, unknowns, used, limit)
        elif _without_depth(used) != 0:
            used = _without_depth(used)
        else:
            break
    if method == TLS:
        solve_tls(space, unknowns)
    for j in range(unknowns):
        name = space.columns[j]
        scale = unit if name == 0 else (unit / length if name < 4 else unit / (length * length))
        out[name] = scale * space.solution[j]
    out[0] += mean
    return condition, used


@loop_kernel
def newton_step(coefficients, axes, least, space):
    """The step -H⁻¹g, m, with all eigenvalues of H replaced by their absolute values if any is below ``least``.

    coefficients: (10,) of :func:`fit_quadratic`, which used ``axes``; space: its scratch. An eigenvalue below 10⁻¹² of
    the greatest counts as that much, so that a flat direction gives a long step and not an infinite one;
    where H vanishes the step is -g. Axes that were not fitted keep still.
    """
    g = coefficients[1:4]
    packed = space.packed
    greatest = 0.0
    for k in range(6):
        packed[k] = coefficients[4 + k]
        greatest = max(greatest, abs(packed[k]))
    if not greatest > 0.0:
        return -g[0], -g[1], -g[2]
    # Without a slope any curvature keeps still.
    packed[0] = packed[0] if axes & AXIS_X else greatest
    packed[3] = packed[3] if axes & AXIS_Y else greatest
    packed[5] = packed[5] if axes & AXIS_Z else greatest
    values = space.eigenvalues
    vectors = space.eigenvectors
    eigen3(packed, space.turned, values, vectors)
    absolute = values[2] < least
    floor = _FLAT * max(abs(values[0]), abs(values[2]))
    sx = 0.0
    sy = 0.0
    sz = 0.0
    for k in range(3):
        curvature = max(abs(values[k]) if absolute else values[k], floor)
        along = -(vectors[0, k] * g[0] + vectors[1, k] * g[1] + vectors[2, k] * g[2]) / curvature
        sx += along * vectors[0, k]
        sy += along * vectors[1, k]
        sz += along * vectors[2, k]
    return sx, sy, sz


@kernel
def step_scale(sx, sy, sz, limit_x, limit_y, limit_z):
    """The factor, at most 1, that brings every component of a step within its limit, m."""
    excess = max(abs(sx) / limit_x, abs(sy) / limit_y, abs(sz) / limit_z)
    return 1.0 / excess if excess > 1.0 else 1.0


@loop_kernel
def _fit_all(points, values, counts, centres, axes, method, limit, least, out, conditions, used, steps):
    space = fit_space(points.shape[1])
    for k in range(points.shape[0]):
        conditions[k], used[k] = fit_quadratic(
            points[k], values[k], counts[k], centres[k, 0], centres[k, 1], centres[k, 2], axes, method, limit, space,
            out[k],
        )  # fmt: skip
        steps[k, 0], steps[k, 1], steps[k, 2] = newton_step(out[k], used[k], least, space)


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticFits:
    """Fits of a batch (b,) of data sets.

    value: (b,), F at the centre. gradient: (b, 3) per m. hessian: (b, 3, 3) per m². condition: (b,), of the design
    matrix that was solved last. axes: bool (b, 3), which were fitted; the others' slopes and curvatures are 0.
    step: (b, 3), m, to the minimum (with |eigenvalues|), unlimited.
    """

    value: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray
    condition: np.ndarray
    axes: np.ndarray
    step: np.ndarray


def fit_quadratics(
    points: Any,
    values: Any,
    centres: Any,
    *,
    counts: Any = None,
    method: str = "svd",
    horizontal: bool = False,
    condition_limit: float = CONDITION_LIMIT,
    least_curvature: float = LEAST_CURVATURE,
) -> QuadraticFits:
    """Fit a quadratic about each of ``centres`` (b, 3), m, to ``values`` (b, n) of F at ``points`` (b, n, 3), m.

    counts: (b,), how many of the first readings count, None for all n; method: "qr", "svd" or "tls"; horizontal: leave
    depth out from the start; see :func:`fit_quadratic` for the rest. Raises ``InvalidParameterError`` for
    wrong shapes, numbers that are not finite, or limits out of bounds.
    """
    check_choice("method", method, METHODS)
    check_range("condition_limit", condition_limit, 1.0, 1e300, open_low=True)
    check_range("least_curvature", least_curvature, 0.0, 1e300)
    places = _finite("points", points, 3)
    readings = _finite("values", values, 2)
    about = _finite("centres", centres, 2)
    batch, most = readings.shape
    if places.shape != (batch, most, 3):
        raise InvalidParameterError("points", places.shape, f"shape {(batch, most, 3)}, as values have it")
    if about.shape != (batch, 3):
        raise InvalidParameterError("centres", about.shape, f"shape {(batch, 3)}")
    number = np.full(batch, most) if counts is None else np.asarray(counts)
    whole = np.issubdtype(number.dtype, np.integer) and number.shape == (batch,)
    if not whole or (batch and not (number.min() >= 0 and number.max() <= most)):
        raise InvalidParameterError("counts", counts, f"({batch},) whole numbers in [0, {most}]")
    out = np.zeros((batch, COEFFICIENTS))
    conditions, used, steps = np.zeros(batch), np.zeros(batch, np.int64), np.zeros((batch, 3))
    _fit_all(
        places, readings, number.astype(np.int64), about, HORIZONTAL if horizontal else SPACE, METHODS[method],
        float(condition_limit), float(least_curvature), out, conditions, used, steps,
    )  # fmt: skip
    return QuadraticFits(
        value=out[:, 0], gradient=out[:, 1:4], hessian=out[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3),
        condition=conditions, axes=(used[:, None] & np.array([AXIS_X, AXIS_Y, AXIS_Z])) != 0, step=steps,
    )  # fmt: skip


def _finite(name: str, values: Any, dimensions: int) -> np.ndarray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != dimensions or not np.isfinite(array).all():
        raise InvalidParameterError(name, array.shape, f"finite numbers in {dimensions} dimensions")
    return array

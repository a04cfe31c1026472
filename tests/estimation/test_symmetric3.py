"""Packed 3 × 3 matrices against NumPy."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.estimation.symmetric3 import (
    add_line_of_sight,
    determinant3,
    eigen3,
    invert3,
    log_determinant3,
    quadratic3,
    solve3,
)

_ROWS = np.triu_indices(3)


@loop_kernel
def _all(y, b, inverse, values, vectors):
    eigen3(y, np.empty((3, 3)), values, vectors)
    invert3(y, inverse)
    return determinant3(y), log_determinant3(y), quadratic3(y, b[0], b[1], b[2]), solve3(y, b[0], b[1], b[2])


@loop_kernel
def _add(y, d, weight):
    add_line_of_sight(y, d[0], d[1], d[2], weight)


@given(seed=st.integers(0, 2**32 - 1), spread=st.floats(0.0, 3.0))
@settings(max_examples=60, deadline=None)
def test_of_a_positive_definite_matrix_all_is_as_numpy_has_it(seed, spread):
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    truth = np.sort(10.0 ** rng.uniform(-spread, spread, 3))[::-1]
    full = turn @ np.diag(truth) @ turn.T
    full = 0.5 * (full + full.T)
    b = rng.normal(size=3)
    inverse, values, vectors = np.empty(6), np.empty(3), np.empty((3, 3))
    determinant, logarithm, form, solution = _all(full[_ROWS], b, inverse, values, vectors)
    condition = truth[0] / truth[-1]
    scale = 1e-13 * condition**2 + 1e-12
    np.testing.assert_allclose(determinant, truth.prod(), rtol=scale)
    np.testing.assert_allclose(logarithm, np.log(truth).sum(), atol=scale)
    np.testing.assert_allclose(form, b @ full @ b, rtol=1e-9)
    np.testing.assert_allclose(
        solution, np.linalg.solve(full, b), rtol=scale, atol=scale * np.abs(solution).max()
    )
    np.testing.assert_allclose(
        inverse, np.linalg.inv(full)[_ROWS], rtol=scale, atol=scale * inverse[[0, 3, 5]].max()
    )
    np.testing.assert_allclose(values, truth, rtol=1e-12 * condition + 1e-12)
    np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, full, atol=1e-12 * truth[0])
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-12)


def test_a_range_adds_its_weight_along_its_line_alone():
    y = np.zeros(6)
    d = np.array([3.0, -4.0, 12.0])
    _add(y, d, 7.0)
    unit = d / 13.0
    np.testing.assert_allclose(y, 7.0 * np.outer(unit, unit)[_ROWS], rtol=1e-14)
    _add(y, np.zeros(3), 7.0)
    np.testing.assert_allclose(y[[0, 3, 5]].sum(), 7.0, rtol=1e-14)


def test_what_is_singular_says_so():
    y = np.zeros(6)
    _add(y, np.array([1.0, 2.0, 3.0]), 1.0)
    inverse, values, vectors = np.empty(6), np.empty(3), np.empty((3, 3))
    y[:] = [1.0, 0, 0, 1.0, 0, 0]
    _, logarithm, _, _ = _all(y, np.ones(3), inverse, values, vectors)
    assert logarithm == -np.inf and np.isinf(inverse[[0, 3, 5]]).all() and values[2] == 0.0

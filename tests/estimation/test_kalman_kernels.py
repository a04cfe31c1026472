"""The parts of the filters: motion, differences of measurements, small matrices, use inside a world."""

import numba
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numba.core.runtime import _nrt_python, rtsys

from aquaquad_envs.estimation.kalman import TrackerBatch, position_nees, state_nees
from aquaquad_envs.estimation.kalman_ekf import ekf_update
from aquaquad_envs.estimation.kalman_motion import make_motion, predict, states_of
from aquaquad_envs.estimation.kalman_ukf import make_sigma_points, measurement_difference, ukf_update
from aquaquad_envs.estimation.kalman_update import work_shape
from aquaquad_envs.estimation.small_matrices import cholesky, inverse_from_cholesky, triangularize
from aquaquad_envs.sensing.measurements import KINDS, measurement_gradient, predicted_measurement
from tests.estimation.kalman_reference import PRIOR, TRIANGLE, process_noise, rows_of, transition

coordinate = st.floats(-1000, 1000)


@pytest.mark.parametrize("dt", [0.0, 0.005, 1.0, 60.0])
@pytest.mark.parametrize(
    "motion",
    [
        make_motion("constant-velocity", density=0.3, step_variances=(1.0, 0.1, 0.0)),
        make_motion("constant-acceleration", density=0.02, step_variances=(1.0, 0.1, 0.01)),
        make_motion("published", step_variances=(1.0, 0.1, 0.01)),
    ],
)
def test_prediction_is_the_matrix_exponential(motion, dt):
    """Φ by scipy's expm, Q by Van Loan's method."""
    n = states_of(motion)
    rng = np.random.default_rng(0)
    state, root = rng.standard_normal(n), rng.standard_normal((n, n))
    covariance = root @ root.T
    covariance = 0.5 * (covariance + covariance.T)
    phi = transition(motion, dt)
    expected = phi @ covariance @ phi.T + process_noise(motion, dt)
    moved = phi @ state
    predict(state, covariance, dt, motion)
    np.testing.assert_allclose(state, moved, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(covariance, expected, rtol=1e-11, atol=1e-11)
    assert (covariance == covariance.T).all()


def test_two_short_steps_are_one_long_one():
    motion = make_motion("constant-acceleration", density=0.02)
    once, twice = [np.arange(6.0), np.diag(np.arange(1.0, 7))], [np.arange(6.0), np.diag(np.arange(1.0, 7))]
    predict(*once, 5.0, motion)
    predict(*twice, 2.0, motion)
    predict(*twice, 3.0, motion)
    np.testing.assert_allclose(once[0], twice[0], rtol=1e-13)
    np.testing.assert_allclose(once[1], twice[1], rtol=1e-12)


@pytest.mark.parametrize("wrap", [True, False])
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=60)
@given(coordinate, coordinate, coordinate, coordinate, coordinate, coordinate)
def test_differences_are_those_of_the_measurement(kind, wrap, x, y, dx, dy, ox, oy):
    code = KINDS[kind]
    arguments = (0.0, 0.0, ox, oy, 1500.0)
    assume(min(np.hypot(x, y), np.hypot(x + dx, y + dy)) > 1e-3)
    ours = measurement_difference(code, x, y, dx, dy, *arguments, wrap)
    plain = predicted_measurement(code, x + dx, y + dy, *arguments) - predicted_measurement(
        code, x, y, *arguments
    )
    error = ours - plain
    if wrap and kind == "bearing":
        assert abs(ours) <= np.pi
        error = (error + np.pi) % (2 * np.pi) - np.pi
    assert abs(error) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=60)
@given(coordinate, coordinate, st.floats(0, 6.3), coordinate, coordinate)
def test_small_differences_keep_their_digits(kind, x, y, direction, ox, oy):
    """Half the sum of steps ±d is second order in d: compare with the gradient at 1e-6 m, where h cancels."""
    assume(min(np.hypot(x, y), np.hypot(x - ox, y - oy)) > 1.0)
    dx, dy = 1e-6 * np.cos(direction), 1e-6 * np.sin(direction)
    arguments = (KINDS[kind], x, y, 0.0, 0.0, ox, oy, 1500.0)
    ours = measurement_difference(*arguments[:3], dx, dy, *arguments[3:], True)
    g = measurement_gradient(*arguments)
    scale = 1e-6 * (1 / 1500.0 if kind == "tdoa" else 1.0)
    assert ours == pytest.approx(g[0] * dx + g[1] * dy, abs=2e-6 * scale)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=60)
@given(coordinate, coordinate, coordinate, coordinate)
def test_the_ekf_uses_the_derivative_of_its_measurement(kind, x, y, ox, oy):
    """Read off the filter itself: of a prior of 1e-6 m the update moves x by P Hᵀ ν / σ²; H by differences."""
    assume(min(np.hypot(x, y), np.hypot(x - ox, y - oy)) > 10.0)
    code, here, there = KINDS[kind], np.zeros((1, 2)), np.array([[ox, oy]])

    def h(x, y):
        return predicted_measurement(code, x, y, 0.0, 0.0, ox, oy, 1500.0)

    state, covariance = np.array([x, y, 0.0, 0.0]), 1e-12 * np.eye(4)
    ekf_update(
        state, covariance, np.zeros(work_shape(4, 1)), np.array([code]), here, there,
        np.array([h(x, y) + 1e6]), np.ones(1), np.ones(1, bool), 1, 1500.0, False,
    )  # fmt: skip
    step = 1e-4
    slope = np.array([h(x + step, y) - h(x - step, y), h(x, y + step) - h(x, y - step)])
    if kind == "bearing":
        slope = (slope + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose((state[:2] - [x, y]) * 1e6, slope / (2 * step), atol=2e-6)


@settings(max_examples=60)
@given(st.integers(1, 6), st.integers(0, 2**32 - 1), st.floats(-150, 150))
def test_cholesky_and_inverse(n, seed, exponent):
    root = np.random.default_rng(seed).standard_normal((n, n))
    matrix = (root @ root.T + 0.1 * np.eye(n)) * 10.0**exponent
    matrix = 0.5 * (matrix + matrix.T)
    factor, inverse = np.zeros((n, n)), np.zeros((n, n))
    assert cholesky(matrix, factor) == 0
    np.testing.assert_allclose(
        factor, np.linalg.cholesky(matrix), rtol=1e-9, atol=1e-12 * 10 ** (exponent / 2)
    )
    inverse_from_cholesky(factor, inverse, n)
    np.testing.assert_allclose(inverse @ matrix, np.eye(n), atol=1e-9)
    assert (inverse == inverse.T).all()


@settings(max_examples=60)
@given(st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_a_repair_is_positive_and_bounded(n, seed):
    """An indefinite matrix becomes a positive definite one whose variances have not grown."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((n, n))
    matrix = root @ np.diag(np.where(np.arange(n) == rng.integers(n), -0.5, rng.random(n))) @ root.T
    matrix = 0.5 * (matrix + matrix.T)
    factor = np.zeros((n, n))
    assert cholesky(matrix, factor) == 1
    mended = factor @ factor.T
    assert (np.diag(factor) > 0).all() and np.isfinite(factor).all()
    floor = 2e-12 * max(np.diag(matrix).max(), 0.0) + 1e-199
    assert (np.diag(mended) <= np.maximum(np.diag(matrix), floor) * (1 + 1e-9)).all()


@settings(max_examples=40)
@given(st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**32 - 1), st.floats(-6, 6))
def test_triangularization(rows, columns, seed, exponent):
    rng = np.random.default_rng(seed)
    b = 10.0**exponent * rng.standard_normal((rows, columns))
    residual = rng.standard_normal(rows)
    work = np.zeros((rows + columns + 2, columns + 1))
    work[1 : rows + 1] = np.column_stack([b, residual])
    left = triangularize(work, 1, rows, columns, rows + 2, columns)
    upper = np.triu(work[rows + 2 : rows + 2 + columns, :columns])
    gram = np.eye(columns) + b.T @ b
    np.testing.assert_allclose(upper.T @ upper, gram, rtol=1e-9, atol=1e-9 * np.abs(gram).max())
    np.testing.assert_allclose(
        upper.T @ work[rows + 2 : rows + 2 + columns, columns], b.T @ residual, rtol=1e-9,
        atol=1e-9 * max(1.0, 10.0**exponent),
    )  # fmt: skip
    assert 0 <= left <= residual @ residual * (1 + 1e-12)
    if exponent < 3:
        expected = residual @ np.linalg.solve(np.eye(rows) + b @ b.T, residual)
        assert left == pytest.approx(expected, rel=1e-6, abs=1e-9)


RECORD = np.dtype([("state", np.float64, 6), ("covariance", np.float64, (6, 6)), ("repairs", np.int64)])
POINTS = make_sigma_points(6)
MOTION = make_motion("constant-acceleration", density=1e-6)


@numba.njit
def _run_worlds(worlds, work, steps, kinds, sensors, others, values, stds, mask):
    """A world's step as tasks have it: records with nested arrays, one scratch for all."""
    total = 0.0
    for i in range(worlds.shape[0]):
        w = worlds[i]
        for _ in range(steps):
            predict(w.state, w.covariance, 2.0, MOTION)
            used, nis, repaired = ukf_update(
                w.state,
                w.covariance,
                work,
                kinds,
                sensors,
                others,
                values,
                stds,
                mask,
                3,
                1500.0,
                True,
                POINTS,
            )
            w.repairs += repaired
            total += nis / used
        total += state_nees(w.state, w.covariance, w.state, work)
        total += position_nees(w.state, w.covariance, w.state[0], w.state[1])
    return total


def test_kernels_run_inside_a_world_record_and_allocate_nothing():
    kinds, sensors, others, stds = rows_of(TRIANGLE, "tdoa")
    values, mask = np.array([0.3, -0.1, 0.2]), np.ones(3, bool)
    worlds = np.zeros(5, RECORD)
    worlds["covariance"] = PRIOR
    work = np.zeros(work_shape(6, 3))
    arguments = (worlds, work, 4, kinds, sensors, others, values, stds, mask)
    _run_worlds(*arguments)
    tracker = TrackerBatch(5, MOTION)
    tracker.place(np.zeros(6), PRIOR)
    for _ in range(4):
        tracker.cycle(2.0, kinds, sensors, values, stds, others=others)
    assert (worlds["state"] == tracker.states[:, 0]).all()
    assert (worlds["covariance"] == tracker.covariances[:, 0]).all()
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats().alloc
    _run_worlds(*arguments)
    once = rtsys.get_allocation_stats().alloc - before
    worlds = np.zeros(500, RECORD)
    worlds["covariance"] = PRIOR
    before = rtsys.get_allocation_stats().alloc
    _run_worlds(worlds, *arguments[1:])
    assert rtsys.get_allocation_stats().alloc - before == once, "allocations grow with the number of worlds"


def test_the_scratch_is_as_large_as_needed():
    """A scratch of exactly the stated shape: what lies behind it is untouched, and its contents do not matter."""
    kinds, sensors, others, stds = rows_of(TRIANGLE, "tdoa")
    rows, columns = work_shape(6, 3)
    for fill in (0.0, np.nan):
        store = np.full((rows + 4, columns), fill)
        store[rows:] = 7.0
        state, covariance = np.zeros(6), PRIOR.copy()
        ukf_update(
            state, covariance, store[:rows], kinds, sensors, others, np.zeros(3), stds, np.ones(3, bool), 3, 1500.0,
            True, POINTS,
        )  # fmt: skip
        assert (store[rows:] == 7.0).all() and np.isfinite(state).all() and np.isfinite(covariance).all()

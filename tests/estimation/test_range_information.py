"""What one more range tells: determinant, covariance and slope against NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.estimation.map_estimator import pack, unpack
from aquaquad_envs.estimation.range_information import gain_factor, gain_slope, take_range

coordinate = st.floats(-50.0, 50.0)


def some_information(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3))
    return root @ root.T + 0.1 * np.eye(3)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    arm=st.tuples(coordinate, coordinate, st.floats(0.5, 20.0)),
    weight=st.floats(0.01, 100),
)
def test_the_rank_one_update_is_that_of_the_whole_matrix(seed, arm, weight):
    y = some_information(seed)
    e = np.array(arm) / np.linalg.norm(arm)
    after = y + weight * np.outer(e, e)
    covariance, updated = pack(np.linalg.inv(y)), np.zeros(6)
    ratio = np.linalg.det(after) / np.linalg.det(y)
    assert gain_factor(covariance, *arm, weight) == pytest.approx(ratio, rel=1e-9)
    assert take_range(covariance, *arm, weight, updated) == pytest.approx(ratio, rel=1e-9)
    assert unpack(updated) == pytest.approx(np.linalg.inv(after), rel=1e-7, abs=1e-9)
    # In place, too.
    take_range(covariance, *arm, weight, covariance)
    assert np.array_equal(covariance, updated)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), arm=st.tuples(coordinate, coordinate, st.floats(1.0, 20.0)))
def test_the_slope_is_the_derivative(seed, arm):
    y, target, weight = some_information(seed), np.array([3.0, -2.0, arm[2]]), 5.0

    def log_det(place):
        e = target - np.array([*place, 0.0])
        e /= np.linalg.norm(e)
        return np.linalg.slogdet(y + weight * np.outer(e, e))[1]

    place = target[:2] - arm[:2]
    e = target - np.array([*place, 0.0])
    after = y + weight * np.outer(e, e) / (e @ e)
    found = gain_slope(pack(np.linalg.inv(after)), *e, weight)
    step = 1e-5
    for k, direction in enumerate(np.eye(2)):
        expected = (log_det(place + step * direction) - log_det(place - step * direction)) / (2 * step)
        assert found[k] == pytest.approx(expected, rel=1e-5, abs=1e-8)


def test_no_direction_tells_nothing():
    covariance, after = pack(np.diag([4.0, 9.0, 1.0])), np.zeros(6)
    assert gain_factor(covariance, 0.0, 0.0, 0.0, 7.0) == 1.0
    assert take_range(covariance, 0.0, 0.0, 0.0, 7.0, after) == 1.0 and np.array_equal(after, covariance)
    assert gain_slope(covariance, 0.0, 0.0, 0.0, 7.0) == (0.0, 0.0)

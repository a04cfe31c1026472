"""Bearing, range and TDOA: values, gradients against differences, seams, noise."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import stats

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.randomness import normal, seed_streams
from aquaquad_envs.sensing.measurements import (
    BEARING,
    KINDS,
    RANGE,
    TDOA,
    measurement_gradient,
    measurement_residual,
    measurement_std,
    noisy_measurement,
    predicted_measurement,
    std_from_noise_power,
    wrap_angle,
)

C = 1500.0
coordinate = st.floats(-1e4, 1e4)
point = st.tuples(coordinate, coordinate)
kinds = st.sampled_from([BEARING, RANGE, TDOA])


def stream(seed=0):
    return seed_streams(seed)[2]


# --- angles ------------------------------------------------------------------------------------------------


@settings(max_examples=300)
@given(st.floats(-1e6, 1e6))
def test_wrapped_angles_differ_by_whole_turns_and_stay_in_range(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    turns = (angle - wrapped) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-9 + 1e-15 * abs(angle))
    if -math.pi <= angle < math.pi:
        assert wrapped == angle


@pytest.mark.parametrize("turn", range(-5, 6))
@pytest.mark.parametrize("way", [-math.inf, 0.0, math.inf])
def test_beside_every_seam(turn, way):
    seam = (2 * turn + 1) * math.pi
    angle = seam if way == 0 else math.nextafter(seam, way)
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert abs(wrapped) == pytest.approx(math.pi, abs=2e-14)


def test_residuals_of_bearings_take_the_short_way():
    assert measurement_residual(BEARING, math.pi - 0.01, -math.pi + 0.01) == pytest.approx(-0.02)
    assert measurement_residual(RANGE, 10.0, 2.0) == 8.0
    assert measurement_residual(TDOA, 10.0, 2.0) == 8.0


# --- values ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "target, bearing",
    [
        ((1.0, 0.0), 0.0),
        ((0.0, 2.0), math.pi / 2),
        ((-3.0, 0.0), math.pi),
        ((-3.0, -0.0), math.pi),
        ((-1.0, -1e-300), math.pi),
        ((0.0, -4.0), -math.pi / 2),
        ((1.0, 1.0), math.pi / 4),
        ((0.0, 0.0), 0.0),
        ((-0.0, -0.0), 0.0),
    ],
)
def test_bearings_by_hand(target, bearing):
    assert predicted_measurement(BEARING, *target, 0.0, 0.0, 0.0, 0.0, C) == bearing


def test_range_and_tdoa_by_hand():
    assert predicted_measurement(RANGE, 13.0, 24.0, 10.0, 20.0, 0.0, 0.0, C) == 5.0
    # 5 m from sensor i, 4 m from j: sound reaches i 1/1500 s later.
    assert predicted_measurement(TDOA, 3.0, 4.0, 0.0, 0.0, 3.0, 0.0, C) == pytest.approx(1 / 1500, rel=1e-15)


@given(point, point, point, point)
def test_differences_of_arrival_add_up_and_stay_below_the_distance(target, a, b, c):
    def tau(i, j):
        return predicted_measurement(TDOA, *target, *i, *j, C)

    assert tau(a, b) == -tau(b, a)
    assert tau(a, b) + tau(b, c) == pytest.approx(tau(a, c), abs=1e-14)
    assert abs(tau(a, b)) <= math.dist(a, b) / C + 1e-12


def test_three_differences_hold_two():
    """Why the noise of (τ12, τ23, τ13) must be drawn per pair: the third row is the sum of the others."""
    sensors = [(0.0, 0.0), (4.0, 1.0), (1.0, 5.0)]
    rows = np.array(
        [
            measurement_gradient(TDOA, 2.0, 1.5, *sensors[i], *sensors[j], C)
            for i, j in ((0, 1), (1, 2), (0, 2))
        ]
    )
    np.testing.assert_allclose(rows[0] + rows[1], rows[2], atol=1e-18)
    per_arrival = np.array([[1, -1, 0], [0, 1, -1], [1, 0, -1]])
    assert np.linalg.matrix_rank(per_arrival @ per_arrival.T) == 2


# --- gradients ---------------------------------------------------------------------------------------------


@settings(max_examples=300)
@given(kinds, point, point, point)
def test_gradients_against_differences(kind, target, sensor, other):
    nearest = min(math.dist(target, sensor), math.dist(target, other))
    assume(nearest > 1.0)
    step = 1e-4 * nearest

    def value(dx, dy):
        return predicted_measurement(kind, target[0] + dx, target[1] + dy, *sensor, *other, C)

    found = measurement_gradient(kind, *target, *sensor, *other, C)
    by_x = measurement_residual(kind, value(step, 0.0), value(-step, 0.0)) / (2 * step)
    by_y = measurement_residual(kind, value(0.0, step), value(0.0, -step)) / (2 * step)
    scale = {BEARING: 1 / nearest, RANGE: 1.0, TDOA: 2 / C}[kind]
    np.testing.assert_allclose(found, (by_x, by_y), atol=1e-7 * scale)


@given(point, point, st.floats(-math.pi, math.pi))
def test_gradients_have_their_known_sizes(target, sensor, turn):
    r = math.dist(target, sensor)
    assume(r > 1e-3)
    assert math.hypot(*measurement_gradient(RANGE, *target, *sensor, 0.0, 0.0, C)) == pytest.approx(1.0)
    assert math.hypot(*measurement_gradient(BEARING, *target, *sensor, 0.0, 0.0, C)) == pytest.approx(1 / r)
    # A TDOA's gradient is 2 sin(half the angle between the two lines of sight) / c.
    other = target[0] - 100 * math.cos(turn), target[1] - 100 * math.sin(turn)
    sight = math.atan2(target[1] - sensor[1], target[0] - sensor[0])
    size = math.hypot(*measurement_gradient(TDOA, *target, *sensor, *other, C))
    assert size == pytest.approx(2 * abs(math.sin((turn - sight) / 2)) / C, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS.values())
@pytest.mark.parametrize("distance", [0.0, 1e-300, 1e-160, 1e-140, 1e-12])
def test_nothing_infinite_beside_a_sensor(kind, distance):
    place = (distance, 0.0, 0.0, 0.0, 0.0, 0.0, C)
    found = predicted_measurement(kind, *place), *measurement_gradient(kind, *place)
    assert np.isfinite(found).all()
    if distance == 0:
        assert found == (0.0, 0.0, 0.0)


# --- noise -------------------------------------------------------------------------------------------------


def test_published_noise_powers():
    """SPEC §3: 1.414 ms and 0.141 rad; the mean error of 1.1 ms, 1.7 m, follows as σ √(2/π)."""
    sigma = std_from_noise_power(1e-8, 0.005)
    assert sigma == pytest.approx(1.4142e-3, rel=1e-4)
    assert std_from_noise_power(1e-4, 0.005) == pytest.approx(0.14142, rel=1e-4)
    mean_error = sigma * math.sqrt(2 / math.pi)
    assert round(mean_error, 4) == 0.0011 and round(mean_error * 1500, 1) == 1.7


@pytest.mark.parametrize("power, sample_time", [(-1.0, 0.005), (1.0, 0.0), (math.nan, 1.0)])
def test_noise_powers_refused(power, sample_time):
    with pytest.raises(InvalidParameterError, match=r"power|sample_time_s"):
        std_from_noise_power(power, sample_time)


@given(kinds, st.floats(1e-6, 10), st.floats(0, 5), point, point, point)
def test_range_dependent_noise(kind, std, level, target, sensor, other):
    def at(level_):
        return measurement_std(kind, std, level_, 1000.0, *target, *sensor, *other)

    assert at(0.0) == std
    assert at(level) >= std
    r2 = math.dist(target, sensor) ** 2
    if kind == TDOA:
        r2 = (r2 + math.dist(target, other) ** 2) / 2
    assert at(level) == pytest.approx(math.hypot(std, std * level * math.sqrt(r2) / 1000.0), rel=1e-9)


def test_a_level_of_a_quarter_is_a_quarter_of_the_range():
    std = measurement_std(RANGE, 1.0, 0.25, 1.0, 1200.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert std == pytest.approx(0.25 * 1200, rel=1e-4)


@pytest.mark.parametrize("kind, exact, std", [(BEARING, 0.1, 0.2), (RANGE, 500.0, 3.0), (TDOA, 1e-3, 1e-4)])
def test_noise_is_normal(kind, exact, std):
    words = stream(7)
    draws = np.array([noisy_measurement(kind, exact, std, words) for _ in range(4000)])
    assert stats.kstest((draws - exact) / std, "norm").pvalue > 1e-3


def test_noisy_bearings_are_wrapped_and_no_level_shifts_the_stream():
    words, same = stream(3), stream(3)
    draws = [noisy_measurement(BEARING, math.pi, 0.1, words) for _ in range(100)]
    assert min(draws) < -3 and max(draws) > 3 and all(-math.pi <= d < math.pi for d in draws)
    for _ in range(100):
        assert noisy_measurement(BEARING, 0.5, 0.0, same) == 0.5
    assert normal(words) == normal(same)

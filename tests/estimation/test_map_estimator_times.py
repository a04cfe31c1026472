"""Positions from two-way times, with sound speed and delay known and unknown."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.stats import chi2, kstest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.map_estimator import CONVERGED, SINGULAR, estimate_transponders
from aquaquad_envs.estimation.map_estimator_times import estimate_from_times

TRUTH = np.array([12.0, -8.0, 60.0])
SPEED, DELAY, STD = 1490.0, 4e-4, 1e-4
PRIOR = np.diag([1e4, 1e4, 400.0])


def survey(rng, shape=(), count=80, std=STD, delay=DELAY):
    """Places of sending and receiving on a cross through the circle above the transponder, and the times."""
    angle = np.linspace(0, 2 * np.pi, count)
    radius = np.where(np.arange(count) % 2, 90.0, np.linspace(-90, 90, count))
    sent = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.normal(0, 0.2, count)], axis=-1)
    received = sent + np.array([0.4, 0.3, 0.05])
    path = np.linalg.norm(sent - TRUTH, axis=-1) + np.linalg.norm(received - TRUTH, axis=-1)
    return sent, received, path / SPEED + delay + std * rng.standard_normal((*shape, count))


def whitened(u, sent, received, times, mean, speed_std, delay_std):
    path = np.linalg.norm(u[:3] - sent, axis=1) + np.linalg.norm(u[:3] - received, axis=1)
    heard = np.isfinite(times)
    return np.concatenate(
        [
            (u[:3] - mean) / np.sqrt(np.diag(PRIOR)),
            [(u[3] - 1500.0) / speed_std, u[4] / delay_std],
            ((times - path / u[3] - u[4]) / STD)[heard],
        ]
    )


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), count=st.integers(3, 60), missing=st.booleans())
def test_the_minimum_is_that_of_scipy(seed, count, missing):
    rng = np.random.default_rng(seed)
    sent, received, times = survey(rng, count=count)
    if missing:
        times[rng.random(count) < 0.3] = np.nan
    mean = TRUTH + rng.normal(0, 1, 3) * [30, 30, 10]
    found = estimate_from_times(
        sent, received, times, mean, PRIOR, time_std_s=STD, sound_speed_std_m_s=20.0, delay_std_s=1e-3
    )
    assert found.converged
    arguments = sent, received, times, mean, 20.0, 1e-3
    assert found.cost == pytest.approx(0.5 * np.sum(whitened(found.unknowns, *arguments) ** 2), rel=1e-8)
    again = least_squares(
        whitened, found.unknowns, args=arguments, x_scale=[1, 1, 1, 10, 1e-4], xtol=1e-13, ftol=1e-15
    )
    assert again.cost >= found.cost - 1e-6
    np.testing.assert_allclose(again.x[:3], found.position_m, atol=1e-2)
    jacobian = again.jac
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), expected, rtol=1e-2)


@pytest.mark.parametrize("speed_std, delay_std", [(0.0, 0.0), (np.inf, 0.0), (0.0, np.inf), (np.inf, np.inf)])
def test_exact_times_give_what_is_unknown(speed_std, delay_std):
    rng = np.random.default_rng(30)
    delay = DELAY if delay_std else 0.0
    sent, received, times = survey(rng, std=0.0, delay=delay)
    found = estimate_from_times(
        sent, received, times, TRUTH + np.array([20, -30, 25]), 1e12 * np.eye(3), time_std_s=1e-9,
        sound_speed_m_s=1500.0 if speed_std else SPEED, sound_speed_std_m_s=speed_std, delay_std_s=delay_std,
    )  # fmt: skip
    assert found.converged
    np.testing.assert_allclose(found.unknowns, [*TRUTH, SPEED, delay], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.residuals_s, 0, atol=1e-10)
    known = np.array([False, False, False, speed_std == 0, delay_std == 0])
    assert ((np.diag(found.covariance) == 0) == known).all()


def test_nees_of_five_unknowns_is_chi_squared():
    rng = np.random.default_rng(31)
    sent, received, times = survey(rng, shape=(600,))
    found = estimate_from_times(
        sent,
        received,
        times,
        TRUTH + np.array([5, 5, 5]),
        None,
        time_std_s=STD,
        sound_speed_std_m_s=np.inf,
        delay_std_s=np.inf,
    )
    assert found.converged.all()
    error = found.unknowns - [*TRUTH, SPEED, DELAY]
    scale = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))
    scaled = found.covariance / (scale[:, :, None] * scale[:, None, :])
    whitened_error = np.linalg.solve(scaled, (error / scale)[..., None])[..., 0]
    squared = np.sum(error / scale * whitened_error, axis=-1)
    assert kstest(squared, chi2(5).cdf).pvalue > 1e-3


def test_one_place_and_known_speed_are_the_ranges_of_the_other_estimator():
    rng = np.random.default_rng(32)
    sent, _, times = survey(rng)
    found = estimate_from_times(sent, sent, times, TRUTH + 9, PRIOR, time_std_s=STD, sound_speed_m_s=SPEED)
    half = 0.5 * SPEED
    points = estimate_transponders(sent, half * times, TRUTH + 9, PRIOR, std_m=half * STD)
    np.testing.assert_allclose(found.position_m, points.estimate, atol=1e-5)
    np.testing.assert_allclose(found.covariance[:3, :3], points.covariance, rtol=1e-4, atol=1e-8)


def test_the_other_side_is_considered():
    rng = np.random.default_rng(33)
    line = np.stack([np.linspace(-50, 50, 40), 0.02 * np.linspace(-50, 50, 40) ** 2, np.zeros(40)], axis=-1)
    truth = np.array([5.0, 40.0, 30.0])
    times = 2 * np.linalg.norm(line - truth, axis=-1) / 1500 + STD * rng.standard_normal(40)
    arguments = line, line, times, [5.0, -40.0, 30.0], PRIOR
    found = estimate_from_times(*arguments, time_std_s=STD)
    alone = estimate_from_times(*arguments, time_std_s=STD, mirror=False)
    assert found.converged and found.cost < alone.cost
    np.testing.assert_allclose(found.position_m, truth, atol=2.0)
    above = estimate_from_times(
        *arguments[:3], [5.0, 30.0, 25.0], PRIOR, time_std_s=STD, start=[5, 40, -30, 1500, 0]
    )
    assert above.position_m[2] > 0


def test_outliers_and_singular_surveys():
    rng = np.random.default_rng(34)
    sent, received, times = survey(rng)
    times[::10] += 0.05
    arguments = sent, received, times, TRUTH + np.array([10, 20, -10]), PRIOR
    robust = estimate_from_times(
        *arguments, time_std_s=STD, sound_speed_std_m_s=np.inf, delay_std_s=1e-3, huber=1.345
    )
    plain = estimate_from_times(*arguments, time_std_s=STD, sound_speed_std_m_s=np.inf, delay_std_s=1e-3)
    assert robust.converged
    assert np.linalg.norm(robust.position_m - TRUTH) < 0.5 < np.linalg.norm(plain.position_m - TRUTH)
    few = estimate_from_times(
        sent[:3], received[:3], times[1:4], TRUTH, None, time_std_s=STD, sound_speed_std_m_s=np.inf
    )
    assert few.status == SINGULAR and np.isinf(np.diag(few.covariance)[:4]).all() and few.reasons
    level = estimate_from_times(
        sent * [1, 1, 0],
        sent * [1, 1, 0],
        times,
        [0.0, 0.0, 0.0],
        1e6 * np.eye(3),
        time_std_s=STD,
        huber=1.345,
    )
    assert level.status == CONVERGED and abs(level.position_m[2]) > 50


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"times_s": 1.0}, "times_s: got 1.0"),
        ({"transmit": np.zeros((4, 2))}, r"transmit: got \(4, 2\)"),
        ({"receive": np.full((4, 3), np.nan)}, "receive: got 'NaN"),
        ({"time_std_s": 0.0}, "time_std_s: got 0.0"),
        ({"prior_mean": [1.0]}, r"prior_mean: got \(1,\)"),
        ({"sound_speed_m_s": 0.0}, "sound_speed_m_s: got 0.0"),
        ({"sound_speed_std_m_s": -1.0}, "0: known; inf: unknown"),
        ({"delay_std_s": np.nan}, "delay_std_s: got nan"),
        ({"start": [1.0, 2, 3, -1500, 0]}, "start"),
        ({"prior_mean": np.ones((2, 3)), "times_s": np.ones((3, 4))}, "shapes"),
    ],
)
def test_refusals_say_why(changes, words):
    arguments = {
        "transmit": np.zeros((4, 3)),
        "receive": np.zeros((4, 3)),
        "times_s": np.full(4, 0.1),
        "prior_mean": TRUTH,
        "prior_covariance": PRIOR,
        "time_std_s": STD,
    }
    with pytest.raises(InvalidParameterError, match=words):
        estimate_from_times(**{**arguments, **changes})

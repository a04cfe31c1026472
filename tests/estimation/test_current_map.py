"""The corrected forecast: exact where it was measured, the forecast far away, better in between."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.current_map import CurrentMap
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid


def measured(n=20, seed=0, **settings):
    rng = np.random.default_rng(seed)
    places = rng.uniform(0, 7200, n), rng.uniform(-5000, 5000, n), rng.uniform(-5000, 5000, n)
    errors = rng.normal(0, 0.2, (n, 2))
    current_map = CurrentMap(**{"length_scale_m": 1000.0, **settings})
    current_map.add(*places, errors)
    return current_map, places, errors


def test_exact_where_measured_without_noise_and_the_forecast_far_away():
    current_map, places, errors = measured(noise_std_m_s=1e-5)
    mean, std = current_map.correction(*places)
    np.testing.assert_allclose(mean, errors, atol=1e-4)
    assert (std < 1e-3).all()
    mean, std = current_map.correction(0.0, 50_000.0, 0.0)
    np.testing.assert_allclose(mean, 0.0, atol=1e-12)
    assert std == pytest.approx(0.2)


def test_nothing_measured_changes_nothing():
    velocity = np.random.default_rng(1).normal(size=(2, 4, 5, 2))
    field = CurrentField(velocity=velocity, grid=Grid(0.0, 0.0, 500.0))
    empty = CurrentMap(length_scale_m=1000.0)
    assert len(empty) == 0
    np.testing.assert_array_equal(empty.corrected(field.velocity, field.axes), velocity)


def test_one_measurement_by_hand():
    """Weight C/(C + noise²) at the place, times exp(-1/2) one length away, exp(-1/2) one time scale later."""
    one = CurrentMap(length_scale_m=800.0, time_scale_s=3600.0, error_std_m_s=0.3, noise_std_m_s=0.1)
    one.add(100.0, 10.0, -20.0, [[0.5, -0.25]])
    weight = 0.09 / (0.09 + 0.01)
    for t, x, factor in ((100.0, 10.0, 1.0), (100.0, 810.0, np.exp(-0.5)), (3700.0, 10.0, np.exp(-0.5))):
        mean, std = one.correction(t, x, -20.0)
        np.testing.assert_allclose(mean, weight * factor * np.array([0.5, -0.25]))
        assert std == pytest.approx(0.3 * np.sqrt(1 - weight * factor**2))


@given(st.integers(1, 30), st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_sharing_is_adding_in_any_order(n, seed):
    together, places, errors = measured(n, seed)
    apart = CurrentMap(length_scale_m=1000.0)
    for i in np.random.default_rng(seed).permutation(n):
        apart.add(places[0][i], places[1][i], places[2][i], errors[i])
    mean, std = together.correction(3600.0, 500.0, -300.0)
    again, same = apart.correction(3600.0, 500.0, -300.0)
    np.testing.assert_allclose(again, mean, atol=1e-9)
    assert same == pytest.approx(std, abs=1e-9)
    fewer = CurrentMap(length_scale_m=1000.0)
    fewer.add(places[0][:-1], places[1][:-1], places[2][:-1], errors[:-1])
    assert std <= fewer.correction(3600.0, 500.0, -300.0)[1] + 1e-9


def test_the_stated_uncertainty_is_the_real_one():
    """Errors drawn from the map's own covariance: normalised residuals at unseen places have variance 1."""
    rng = np.random.default_rng(3)
    spread, runs = [], 300
    for _ in range(runs):
        current_map = CurrentMap(length_scale_m=1000.0, noise_std_m_s=0.05)
        places = np.stack([np.zeros(12), *rng.uniform(-2000, 2000, (2, 12))], -1)
        covariance = current_map._covariance(places, places) + 1e-12 * np.eye(12)
        truth = np.linalg.cholesky(covariance) @ rng.normal(size=(12, 2))
        current_map.add(*places[1:].T, truth[1:] + rng.normal(0, 0.05, (11, 2)))
        mean, std = current_map.correction(*places[0])
        spread.append((truth[0] - mean) / std)
    assert np.var(spread) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (2 * runs)))


def test_measurements_of_two_vehicles_better_a_wrong_forecast():
    """In the suite's own wrong forecasts: less error near the tracks with the map, and with both than with one."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 1, scenario="forecast-error", num_fields=20)
    velocity, axes = batch.ocean.velocity, batch.ocean.axes
    rng, left = np.random.default_rng(0), np.zeros(3)
    for k in range(20):
        errors = CurrentField(
            velocity=velocity[k] - velocity[k + 20], grid=Grid(*axes[:3]), time_step_s=axes.time_step
        )
        place = rng.uniform(-3000, 3000, 2)
        nearby = place + rng.normal(0, 700, (30, 2))
        truth = errors.sample(*nearby.T, 1800.0)
        maps = CurrentMap(length_scale_m=1250.0), CurrentMap(length_scale_m=1250.0)
        for vehicle in range(2):
            track = place + rng.normal(0, 700, (5, 2))
            seen = errors.sample(*track.T, 1800.0)
            for current_map in maps[vehicle:]:
                current_map.add(1800.0, *track.T, seen)
        left += [
            np.mean((truth - mean) ** 2)
            for mean in (0.0, *(m.correction(1800.0, *nearby.T)[0] for m in maps))
        ]
    assert left[2] < left[1] < left[0]


def test_keeps_the_latest():
    current_map, *_ = measured(20, capacity=5)
    assert len(current_map) == 5


@pytest.mark.parametrize(
    "bad", [{"length_scale_m": 0.0}, {"time_scale_s": -1.0}, {"noise_std_m_s": 0.0}, {"error_std_m_s": np.nan},
            {"capacity": 0}]
)  # fmt: skip
def test_refuses_bad_parameters(bad):
    with pytest.raises(InvalidParameterError, match=next(iter(bad))):
        measured(**bad)


def test_refuses_bad_measurements():
    current_map = CurrentMap(length_scale_m=1000.0)
    for errors in ([[np.nan, 0.0]], [[0.0, 0.0], [0.0, 0.0]]):
        with pytest.raises(InvalidParameterError, match="errors"):
            current_map.add(0.0, 0.0, 0.0, errors)
    assert len(current_map) == 0

"""What the estimator says of its own error: NEES, covariance, confidence regions, noise (SPEC §8)."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.map_estimator import estimate_transponders
from aquaquad_envs.estimation.map_estimator_noise import (
    adapt_noise,
    expected_square,
    line_of_sight_std,
    residual_std,
)
from aquaquad_envs.estimation.map_estimator_statistics import confidence_ellipse, confidence_ellipsoid, nees
from tests.estimation.ranging_worlds import FOUR, SQUARE, TRANSPONDER, random_tracks, ranges_of

STD = 0.1
PRIOR = np.diag([100.0, 100.0, 4.0])


def four_positions(seed, transponders, runs):
    """Estimates of the published experiment: four fixed positions, prior drawn about the truth."""
    rng = np.random.default_rng(seed)
    truths = np.broadcast_to(transponders, (runs, len(transponders), 3))
    ranges = ranges_of(SQUARE, truths, rng, STD)
    means = truths + rng.normal(size=truths.shape) * np.sqrt(np.diag(PRIOR))
    return truths, estimate_transponders(SQUARE, ranges, means, PRIOR, std_m=STD)


@pytest.mark.parametrize("count", [1, 4])
def test_nees_of_the_four_positions_is_chi_squared(count):
    truths, found = four_positions(20 + count, FOUR[:count], 2000)
    assert found.converged.all()
    errors = nees(found.estimate, truths, found.covariance).sum(axis=-1)
    # The published 500 runs: the distribution, not only its mean.
    assert kstest(errors[:500], chi2(3 * count).cdf).pvalue > 1e-3
    # 2000 runs: the mean to five of its standard errors, and the little that nonlinearity adds.
    assert errors.mean() == pytest.approx(3 * count, abs=5 * np.sqrt(6 * count / len(errors)) + 0.05 * count)


def test_covariance_is_that_of_the_errors():
    rng = np.random.default_rng(21)
    runs = 4000
    positions = random_tracks(rng, 1, 20)[0]
    ranges = ranges_of(positions, np.broadcast_to(TRANSPONDER, (runs, 3)), rng, STD)
    means = TRANSPONDER + rng.normal(size=(runs, 3)) * np.sqrt(np.diag(PRIOR))
    found = estimate_transponders(positions, ranges, means, PRIOR, std_m=STD)
    errors = found.estimate - TRANSPONDER
    sample = errors.T @ errors / runs
    claimed = found.covariance.mean(axis=0)
    scale = np.sqrt(np.diag(claimed))
    np.testing.assert_allclose(sample / np.outer(scale, scale), claimed / np.outer(scale, scale), atol=0.15)
    ellipse = confidence_ellipse(found.covariance)
    along = np.einsum("rij,ri->rj", ellipse.directions, errors[:, :2])
    inside = np.sum((along / ellipse.semi_axes_m) ** 2, axis=1) <= 1
    assert inside.mean() == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / runs) + 0.005)
    ellipsoid = confidence_ellipsoid(found.covariance)
    along = np.einsum("rij,ri->rj", ellipsoid.directions, errors)
    inside = np.sum((along / ellipsoid.semi_axes_m) ** 2, axis=1) <= 1
    assert inside.mean() == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / runs) + 0.005)


def test_ellipse_of_95_percent_has_the_published_scale():
    region = confidence_ellipse(np.diag([4.0, 9.0, 100.0]))
    np.testing.assert_allclose(region.semi_axes_m, 2.4477 * np.array([3.0, 2.0]), rtol=3e-5)
    np.testing.assert_allclose(np.abs(region.directions), [[0, 1], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(
        confidence_ellipsoid(np.eye(3), 0.95).semi_axes_m, np.sqrt(chi2(3).ppf(0.95)), rtol=1e-12
    )
    assert confidence_ellipse(np.eye(2), 0.5).semi_axes_m == pytest.approx(np.sqrt(2 * np.log(2)))


def test_receiver_error_counts_along_the_line_of_sight():
    estimate = [10.0, 0.0, 0.0]
    stds = line_of_sight_std(
        [[0, 0, 0], [10, 5, 0], [10, 0, -3], [13, 4, 0], [10, 0, 0]], estimate, [1.0, 2.0, 3.0]
    )
    np.testing.assert_allclose(stds, [1, 2, 3, np.sqrt(0.36 * 1 + 0.64 * 4), 3])
    # And that is what such errors do to a range, to first order.
    rng = np.random.default_rng(22)
    place = np.array([13.0, 4.0, -5.0])
    moved = place + 0.01 * rng.normal(size=(40000, 3)) * [1, 2, 3]
    spread = np.linalg.norm(moved - estimate, axis=1).std()
    assert spread == pytest.approx(0.01 * line_of_sight_std([place], estimate, [1, 2, 3])[0], rel=0.02)


@pytest.mark.parametrize("huber", [0.0, 1.345, 3.0])
def test_noise_is_found_from_residuals(huber):
    rng = np.random.default_rng(23)
    extra = rng.uniform(0.0, 0.2, 20000)
    errors = rng.normal(size=extra.size) * np.hypot(0.1, extra)
    assert residual_std(errors, extra, 0, huber=huber) == pytest.approx(0.1, rel=0.03)
    u = rng.normal(size=400000)
    assert expected_square(huber or np.inf) == pytest.approx(
        np.minimum(u**2, huber**2 or np.inf).mean(), rel=0.01
    )
    assert residual_std(errors, 3 * extra + 1, 0, huber=huber) == 0.0


def test_gross_outliers_hardly_move_the_noise():
    rng = np.random.default_rng(24)
    errors = 0.1 * rng.normal(size=2000)
    errors[:200] += 1000.0
    errors[200:210] = np.nan
    assert residual_std(errors, 0.0, 3, huber=1.345) == pytest.approx(0.1, rel=0.25)
    assert residual_std(errors, 0.0, 3) > 100


def test_solution_and_noise_settle_together():
    rng = np.random.default_rng(25)
    positions = random_tracks(rng, 1, 200)[0]
    fixes = positions + rng.normal(size=positions.shape) * [0.3, 0.1, 0.2]
    ranges = ranges_of(positions, TRANSPONDER, rng, 0.2)
    ranges[::15] += 30.0
    extra = np.zeros(200)

    def solve(std):
        found = estimate_transponders(
            fixes, ranges, TRANSPONDER + 5, 100 * PRIOR, std_m=np.hypot(std, extra), huber=1.345
        )
        extra[:] = line_of_sight_std(fixes, found.estimate, [0.3, 0.1, 0.2])
        return found, ranges - np.linalg.norm(fixes - found.estimate, axis=1), extra, 3

    outcome = adapt_noise(solve, 10.0, huber=1.345)
    assert outcome.settled and outcome.std == pytest.approx(0.2, rel=0.3)
    error = nees(outcome.solution.estimate, TRANSPONDER, outcome.solution.covariance)
    assert error < chi2(3).ppf(0.9999)
    assert not adapt_noise(solve, 10.0, huber=1.345, max_rounds=1).settled


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: nees([1.0, 2, 3], [1.0, 2, 3], np.diag([1.0, 1, 0])), "not positive definite"),
        (lambda: nees([1.0, 2, 3], [1.0, 2, 3], np.eye(2)), "covariances"),
        (lambda: confidence_ellipse(np.diag([1.0, np.inf, 1])), "infinite or NaN"),
        (lambda: confidence_ellipse(np.eye(4)), "covariances: got"),
        (lambda: confidence_ellipsoid(np.eye(2)), r"covariances: got \(2, 2\)"),
        (lambda: confidence_ellipse(np.eye(2), 1.0), "probability: got 1.0"),
        (lambda: residual_std([1.0, 2, np.nan], 0.0, 2), "more than the 2 unknowns"),
        (lambda: adapt_noise(lambda std: (0, [1.0, 2], 0.0, 1), 0.0), "start_std: got 0.0"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

"""Maximum a-posteriori positions against other methods, limits, symmetry, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.map_estimator import (
    CONVERGED,
    ITERATIONS,
    NOT_FINITE,
    SINGULAR,
    estimate_transponders,
    map_settings,
    pack,
    solve_point,
    unpack,
)
from aquaquad_envs.estimation.symmetric3 import add_line_of_sight
from tests.estimation.ranging_worlds import SQUARE, TRANSPONDER, cost, random_tracks, ranges_of, roots

PRIOR = np.diag([100.0, 100.0, 4.0])
WIDE = np.diag([1e4, 1e4, 4.0])
STD = 0.12


def one_by_one(runs, positions, ranges, means, covariance, *, std=STD, huber=0.0, mirror=True):
    """Estimates, costs and status after each range, every solution started from the one before, as a world does."""
    count = ranges.shape[-1]
    estimates, costs, status = means.copy(), np.zeros((runs, count)), np.zeros((runs, count), dtype=int)
    for n in range(1, count + 1):
        found = estimate_transponders(
            positions[:, :n], ranges[:, :n], means, covariance, std_m=std, start=estimates, huber=huber, mirror=mirror
        )  # fmt: skip
        estimates, costs[:, n - 1], status[:, n - 1] = found.estimate, found.cost, found.status
    return estimates, costs, status


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(0, 30),
    spread=st.sampled_from([2.0, 10.0, 50.0]),
    huber=st.sampled_from([0.0, 1.345]),
    deep=st.booleans(),
)
def test_the_minimum_is_that_of_scipy(seed, count, spread, huber, deep):
    rng = np.random.default_rng(seed)
    positions = rng.normal(0, 20, (count, 3)) * [1, 1, 0.2 if deep else 0]
    covariance = np.diag([spread**2, spread**2, 4.0]) + 0.5
    mean = TRANSPONDER + rng.multivariate_normal(np.zeros(3), covariance)
    std = rng.uniform(0.1, 1.0, count)
    ranges = ranges_of(positions, TRANSPONDER) + std * rng.standard_t(3, count)
    ranges[rng.random(count) < 0.2] = np.nan
    found = estimate_transponders(positions, ranges, mean, covariance, std_m=std, huber=huber)
    assert found.converged
    arguments = positions, ranges, mean, covariance, std, huber
    assert found.cost == pytest.approx(cost(found.estimate, *arguments), rel=1e-9, abs=1e-12)
    # From our own solution another method goes nowhere.
    again = least_squares(roots, found.estimate, args=arguments, xtol=1e-12, ftol=1e-14, gtol=1e-12)
    assert again.cost >= found.cost - 1e-7
    np.testing.assert_allclose(again.x, found.estimate, atol=2e-3)
    # From elsewhere it does no better. (With uneven depths or outliers there may be minima that are no images.)
    for start in () if deep or huber else (mean, TRANSPONDER, mean * [-1, -1, 1]):
        other = least_squares(roots, start, args=arguments, xtol=1e-12)
        assert other.cost >= found.cost - 1e-6 or other.x[2] < 0


def test_no_measurements_leave_the_prior():
    found = estimate_transponders(
        np.zeros((0, 3)), np.zeros(0), [3.0, -4.0, 5.0], PRIOR, std_m=STD, start=[90, 80, 7]
    )
    np.testing.assert_allclose(found.estimate, [3, -4, 5], atol=1e-9)
    np.testing.assert_allclose(found.covariance, PRIOR)
    assert found.converged and found.cost == pytest.approx(0, abs=1e-12)


def test_exact_ranges_find_the_place():
    rng = np.random.default_rng(1)
    positions = rng.normal(0, 15, (50, 8, 3)) * [1, 1, 0]
    truth = rng.normal(0, 20, (50, 3)) * [1, 1, 0.1] + [0, 0, 8]
    found = estimate_transponders(
        positions,
        ranges_of(positions, truth),
        truth + rng.normal(0, 3, (50, 3)),
        1e10 * np.eye(3),
        std_m=0.01,
    )
    assert found.converged.all()
    np.testing.assert_allclose(found.estimate, truth, atol=1e-5)


def test_information_grows_range_by_range_as_it_does_at_once():
    @loop_kernel
    def one_at_a_time(information, positions, point, weight):
        for place in positions:
            add_line_of_sight(
                information, point[0] - place[0], point[1] - place[1], point[2] - place[2], weight
            )

    rng = np.random.default_rng(2)
    positions = random_tracks(rng, 1, 21)[0]
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    found = estimate_transponders(positions, ranges, TRANSPONDER + 5, PRIOR, std_m=STD)
    grown = pack(np.linalg.inv(PRIOR))
    one_at_a_time(grown, positions, found.estimate, STD**-2)
    np.testing.assert_allclose(pack(found.information), grown, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(found.covariance @ unpack(grown), np.eye(3), atol=1e-8)


def test_the_kernel_of_worlds_solves_the_same():
    rng = np.random.default_rng(3)
    positions = random_tracks(rng, 1, 30)[0]
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    ranges[[3, 11]] = np.nan
    settings_ = map_settings(std_m=STD, tolerance_m=1e-6)
    mean, information = TRANSPONDER + np.array([40.0, -70.0, 1.0]), np.zeros(6)
    for length in (30, 32, 128):  # whole blocks of lanes, a rest, room to spare
        px, py, read = np.full((3, length), 1e3)
        px[:30], py[:30], read[:30] = positions[:, 0], positions[:, 1], ranges
        point = np.full(3, np.nan)
        status = solve_point(
            30, px, py, read, mean, pack(np.linalg.inv(WIDE)), settings_, point, information
        )  # fmt: skip
        found = estimate_transponders(positions, ranges, mean, WIDE, std_m=STD)
        assert status == found.status == CONVERGED
        np.testing.assert_allclose(point, found.estimate, atol=1e-6)
        np.testing.assert_allclose(information, pack(found.information), rtol=1e-5, atol=1e-5)


def test_batches_do_not_change_a_digit():
    rng = np.random.default_rng(4)
    positions = random_tracks(rng, 20, 13)
    ranges, means = ranges_of(positions, TRANSPONDER, rng, STD), TRANSPONDER + rng.normal(0, 50, (20, 3))
    whole = estimate_transponders(positions, ranges, means, WIDE, std_m=STD)
    for i in (0, 7, 19):
        single = estimate_transponders(positions[i], ranges[i], means[i], WIDE, std_m=STD)
        assert (single.estimate == whole.estimate[i]).all() and (
            single.information == whole.information[i]
        ).all()


def test_wide_priors_never_end_in_the_worse_minimum():
    """As a world runs: at every count no start on circles about the vehicle ends lower than the solution."""
    rng = np.random.default_rng(5)
    runs, count = 200, 30
    # From straight on to hard turns: the straighter, the longer both sides stay alive.
    turn = np.repeat([0.02, 0.1, 0.3, np.pi / 6], runs // 4)[:, None]
    positions = random_tracks(rng, runs, count, turn=turn)
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    means = TRANSPONDER + rng.normal(0, 1, (runs, 3)) * [100, 100, 2]
    estimates, costs, status = one_by_one(runs, positions, ranges, means, WIDE)
    assert (status == CONVERGED).all()
    alone = one_by_one(runs, positions, ranges, means, WIDE, mirror=False)[1]
    for n in (1, 2, 3, 4, 6, 9, 15, 30):
        lowest = np.full(runs, np.inf)
        for angle in np.linspace(0, 2 * np.pi, 16, endpoint=False):
            for radius in (12.0, 30.0):
                start = positions[:, n // 2] + radius * np.array([np.cos(angle), np.sin(angle), 0.0])
                start[:, 2] = means[:, 2]
                other = estimate_transponders(
                    positions[:, :n], ranges[:, :n], means, WIDE, std_m=STD, start=start, mirror=False
                )
                lowest = np.minimum(lowest, other.cost)
        assert (costs[:, n - 1] <= lowest + 1e-6).all(), n
    # Without the look at the other side some runs do end there: the test can fail.
    assert (alone[:, -1] > costs[:, -1] + 1.0).sum() >= 3
    wrong = np.linalg.norm(estimates - TRANSPONDER, axis=-1) > 5
    assert wrong[runs // 2 :].mean() < 0.05


def test_plain_gauss_newton_would_run_away():
    """What the damping is for: undamped steps from the prior mean leave for good in some wide-prior runs."""
    rng = np.random.default_rng(6)
    runs = 300
    positions = random_tracks(rng, runs, 1)
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    means = TRANSPONDER + rng.normal(0, 1, (runs, 3)) * [100, 100, 2]
    points, prior = means.copy(), np.linalg.inv(WIDE)
    for _ in range(100):
        arms = points[:, None] - positions
        distance = np.linalg.norm(arms, axis=-1)
        h = arms / distance[..., None]
        information = prior + np.einsum("rni,rnj->rij", h, h) / STD**2
        slope = (means - points) @ prior + np.einsum("rni,rn->ri", h, ranges - distance) / STD**2
        step = np.linalg.solve(information, slope[..., None])[..., 0]
        points = points + step
    assert (np.linalg.norm(step, axis=-1) > 1e-3).mean() > 0.02
    found = estimate_transponders(positions, ranges, means, WIDE, std_m=STD)
    assert found.converged.all()


def test_above_the_surface_is_left_for_below():
    rng = np.random.default_rng(7)
    positions = random_tracks(rng, 30, 12)
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    found = estimate_transponders(
        positions, ranges, TRANSPONDER + np.array([3, 2, 1]), PRIOR, std_m=STD, start=TRANSPONDER * [1, 1, -1]
    )
    assert (found.estimate[:, 2] > 0).all() and found.converged.all()


def test_a_prior_above_the_surface_is_no_reason_to_fly():
    rng = np.random.default_rng(12)
    positions = random_tracks(rng, 30, 20)
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    mean = TRANSPONDER * [1, 1, 0] - [0, 0, 0.5]
    found = estimate_transponders(positions, ranges, mean, PRIOR, std_m=STD)
    alone = estimate_transponders(positions, ranges, mean, PRIOR, std_m=STD, mirror=False)
    assert found.converged.all() and (alone.estimate[:, 2] < 0).all()
    # But where the ranges say so little of the depth that there is no minimum in the water.
    air = found.estimate[:, 2] < 0
    below = estimate_transponders(
        positions[air], ranges[air], mean, PRIOR, std_m=STD, start=TRANSPONDER, mirror=False
    )
    assert air.mean() < 0.3 and (below.estimate[:, 2] < 0).all()
    deep = positions + np.array([0, 0, 1.0]) * rng.normal(0, 0.01, (30, 20, 1))
    prior_wins = estimate_transponders(deep, ranges, mean * [1, 1, 8], PRIOR, std_m=STD)
    assert (prior_wins.estimate[:, 2] < 0).all()


def test_a_start_between_two_minima_rolls_down():
    rng = np.random.default_rng(8)
    positions = random_tracks(rng, 1, 12)[0]
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    # Nothing known of the depth, the start at the surface: no gradient leads down.
    found = estimate_transponders(positions, ranges, [10.0, 10.0, 0.0], 1e4 * np.eye(3), std_m=STD)
    assert found.converged and found.estimate == pytest.approx(TRANSPONDER, abs=1.5)
    # The prior mean on the vehicle, where a range has no direction.
    found = estimate_transponders(positions[:1], ranges[:1], positions[0], 1e4 * np.eye(3), std_m=STD)
    assert np.isfinite(found.estimate).all() and found.converged


def test_huber_lives_with_outliers():
    rng = np.random.default_rng(9)
    runs = 100
    positions = random_tracks(rng, runs, 30)
    clean = ranges_of(positions, TRANSPONDER, rng, STD)
    spoilt = clean + np.where(rng.random(clean.shape) < 0.1, rng.uniform(5, 50, clean.shape), 0)
    means = TRANSPONDER + rng.normal(0, 1, (runs, 3)) * [10, 10, 2]
    plain, robust = (
        estimate_transponders(positions, spoilt, means, PRIOR, std_m=STD, huber=bound)
        for bound in (0.0, 1.345)
    )
    assert robust.converged.all()
    errors = [np.linalg.norm(found.estimate - TRANSPONDER, axis=-1) for found in (plain, robust)]
    assert np.median(errors[0]) > 10 * np.median(errors[1]) and np.median(errors[1]) < 0.3


def test_missed_replies_change_nothing_but_their_absence():
    rng = np.random.default_rng(10)
    positions = random_tracks(rng, 1, 14)[0]
    ranges = ranges_of(positions, TRANSPONDER, rng, STD)
    keep = np.ones(14, dtype=bool)
    keep[[0, 5, 6, 13]] = False
    gaps, places = np.where(keep, ranges, np.nan), np.where(keep[:, None], positions, np.inf)
    with_gaps = estimate_transponders(places, gaps, TRANSPONDER + 4, PRIOR, std_m=np.where(keep, STD, np.nan))
    without = estimate_transponders(positions[keep], ranges[keep], TRANSPONDER + 4, PRIOR, std_m=STD)
    np.testing.assert_allclose(with_gaps.estimate, without.estimate, atol=1e-7)
    np.testing.assert_allclose(with_gaps.information, without.information, rtol=1e-7, atol=1e-7)
    silent = estimate_transponders(positions, np.full(14, np.nan), TRANSPONDER, PRIOR, std_m=STD)
    np.testing.assert_allclose(silent.covariance, PRIOR)


def test_what_is_not_a_minimum_says_why():
    straight = np.array([[0.0, 0, 0], [3, 0, 0], [6, 0, 0]])
    ranges = ranges_of(straight, TRANSPONDER)
    found = estimate_transponders(straight[:1], ranges[:1], [5.0, 5, 5], std_m=STD)
    assert found.status == SINGULAR and np.isinf(np.diag(found.covariance)).all()
    assert "do not fix a point" in found.reasons[0] and not found.converged
    nothing = estimate_transponders(straight[:0], ranges[:0], [5.0, 5, 5], std_m=STD)
    assert nothing.status == SINGULAR and (nothing.estimate == 5).all()
    hurried = estimate_transponders(
        straight, ranges, [90.0, -80, 2], WIDE, std_m=STD, max_iterations=2, mirror=False
    )
    assert hurried.status == ITERATIONS and hurried.reasons == ["iterations exhausted"]
    huge = estimate_transponders(straight, ranges, [1e200, 0, 0], PRIOR, std_m=1e-9, start=[-1e200, 0, 0])
    assert huge.status == NOT_FINITE


def test_covariances_pack_and_unpack():
    rng = np.random.default_rng(11)
    root = rng.normal(size=(4, 5, 3, 3))
    matrices = root @ root.swapaxes(-1, -2)
    assert (unpack(pack(matrices)) == np.triu(matrices) + np.triu(matrices, 1).swapaxes(-1, -2)).all()


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"std_m": 0.0}, "std_m: got 0.0"),
        ({"std_m": [1.0, 2.0]}, "shapes"),
        ({"std_m": np.nan}, "std_m"),
        ({"ranges": 4.0}, "ranges: got 4.0"),
        ({"ranges": "long"}, "ranges: got 'long'"),
        ({"positions": SQUARE[:3]}, r"positions: got \(3, 3\)"),
        ({"positions": SQUARE + np.inf}, "positions: got 'NaN or infinite'"),
        ({"prior_mean": [1.0, 2.0]}, r"prior_mean: got \(2,\)"),
        ({"prior_mean": [1.0, 2.0, np.nan]}, "prior_mean or start"),
        ({"start": [1.0]}, r"start: got \(1,\)"),
        ({"prior_covariance": np.eye(2)}, "prior_covariance"),
        ({"prior_covariance": np.diag([1.0, 1.0, 0.0])}, "not positive definite"),
        ({"prior_covariance": np.eye(3) + np.eye(3, k=1)}, "not symmetric"),
        ({"huber": -1.0}, "huber: got -1.0"),
        ({"max_iterations": 0}, "max_iterations: got 0"),
        ({"tolerance_m": 0.0}, "tolerance_m: got 0.0"),
        ({"prior_mean": np.ones((2, 3)), "start": np.ones((3, 3))}, "shapes"),
    ],
)
def test_refusals_say_why(changes, words):
    arguments = {
        "positions": SQUARE,
        "ranges": ranges_of(SQUARE, TRANSPONDER),
        "prior_mean": TRANSPONDER,
        "prior_covariance": PRIOR,
        "std_m": 0.1,
    }
    with pytest.raises(InvalidParameterError, match=words):
        estimate_transponders(**{**arguments, **changes})

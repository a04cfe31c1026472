"""On matched models the filters' own uncertainty is right: NEES and NIS follow χ² over many runs."""

import numpy as np
import pytest
from scipy.stats import chi2

from aquaquad_envs.estimation.kalman import METHODS, TrackerBatch
from aquaquad_envs.estimation.kalman_motion import make_motion
from tests.estimation.kalman_reference import TRIANGLE, measure, process_noise, rows_of, transition, wrapped

RUNS = 600
STEPS = 40
DT = 2.0
#: Two-sided chance that one mean of a consistent filter falls outside: about forty are looked at below.
CHANCE = 1e-5
MOTIONS = {
    "constant-velocity": make_motion("constant-velocity", density=0.01),
    "constant-acceleration": make_motion("constant-acceleration", density=1e-5),
}


def within(mean, freedom, runs):
    """Whether the mean over ``runs`` of χ²(``freedom``) variables lies in its interval."""
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom * runs) / runs
    return low < mean < high


def experiment(model, kinds, method, *, doubt=1.0, missing=0.2, alpha=1e-3):
    """NEES (STEPS, RUNS), NIS and degrees of freedom of a filter that takes ``doubt`` times the true deviation."""
    motion = MOTIONS[model]
    rng = np.random.default_rng(11)
    codes, sensors, others, stds = rows_of(TRIANGLE, kinds)
    phi, q = transition(motion, DT), process_noise(motion, DT)
    n = len(phi)
    prior = np.diag([400.0, 400.0, 1.0, 1.0, 1e-4, 1e-4][:n])
    guess = np.array([30.0, -20.0, 1.5, 1.0, 0.0, 0.0][:n])
    truth = rng.multivariate_normal(guess, prior, RUNS)
    tracker = TrackerBatch(RUNS, motion, method=method, alpha=alpha)
    tracker.place(guess, prior)
    nees, nis, used = [], [], []
    for _ in range(STEPS):
        truth = truth @ phi.T + rng.multivariate_normal(np.zeros(n), q, RUNS)
        exact = np.array([measure(codes, sensors, others, x, y) for x, y in truth[:, :2]])
        noisy = exact + stds * rng.standard_normal(exact.shape)
        noisy = np.where(codes == 0, wrapped(noisy), noisy)
        noisy[rng.random(noisy.shape) < missing] = np.nan
        tracker.cycle(DT, codes, sensors, noisy[:, None], doubt * stds, others=others)
        nees.append(tracker.nees(truth[:, None])[:, 0])
        nis.append(tracker.nis[:, 0].copy())
        used.append(tracker.used[:, 0].copy())
    assert tracker.repairs.sum() == 0
    return np.array(nees), np.array(nis), np.array(used)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kinds", ["bearing", "range", "tdoa", "all"])
@pytest.mark.parametrize("model", MOTIONS)
def test_nees_and_nis_are_chi_square(model, kinds, method):
    nees, nis, used = experiment(model, kinds, method)
    n = {"constant-velocity": 4, "constant-acceleration": 6}[model]
    assert within(nees[-1].mean(), n, RUNS), f"NEES {nees[-1].mean():.3f}, expected {n}"
    # Innovations of different times are independent: one long sum.
    assert within(nis.sum() / RUNS, used.sum() / RUNS, RUNS), (
        f"NIS {nis.sum() / used.sum():.4f} per measurement"
    )


@pytest.mark.parametrize("method", ["ekf", "ukf"])
def test_a_mismatched_filter_is_found_out(method):
    """The test has teeth: deviations half or one and a half of the true ones fail it."""
    for doubt, sign in ((0.5, 1), (1.5, -1)):
        nees, nis, used = experiment("constant-velocity", "tdoa", method, doubt=doubt)
        assert not within(nees[-1].mean(), 4, RUNS) and not within(nis.sum() / RUNS, used.sum() / RUNS, RUNS)
        assert sign * (nis.sum() - used.sum()) > 0


def test_the_unscented_filter_knows_its_curvature():
    """A precise range to a target known to ±30 % of that range: the arc is no straight line.

    The EKF takes it for one and believes x to about the range's own deviation; the UKF adds the curvature's spread.
    """
    rng = np.random.default_rng(3)
    guess, prior = np.array([100.0, 0.0, 0.0, 0.0]), np.diag([900.0, 900.0, 1.0, 1.0])
    truth = rng.multivariate_normal(guess, prior, 4000)
    values = np.hypot(*truth[:, :2].T) + rng.standard_normal(4000)
    nees = {}
    for method in ("ekf", "ukf"):
        tracker = TrackerBatch(4000, MOTIONS["constant-velocity"], method=method, alpha=1.0)
        tracker.place(guess, prior)
        tracker.update("range", [[0.0, 0.0]], values[:, None, None], 1.0)
        nees[method] = tracker.nees(truth[:, None]).mean()
    assert nees["ekf"] > 5 * 4
    assert abs(nees["ukf"] - 4) < 1

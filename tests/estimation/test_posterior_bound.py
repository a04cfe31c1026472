"""The posterior Cramér–Rao bound against its recursion by numpy, and against filters that obey it."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.kalman import TrackerBatch
from aquaquad_envs.estimation.kalman_motion import make_motion, states_of
from aquaquad_envs.estimation.posterior_bound import posterior_bound
from aquaquad_envs.sensing.measurements import measurement_gradient
from tests.estimation.kalman_reference import (
    PRIOR,
    TRIANGLE,
    measure,
    process_noise,
    rows_of,
    simulate,
    transition,
    wrapped,
)

MOTIONS = {
    "constant-velocity": make_motion("constant-velocity", density=0.01),
    "constant-acceleration": make_motion("constant-acceleration", density=1e-5),
}
START = np.array([30.0, -20.0, 1.5, 1.0, 0.01, 0.0])


def information(rows, x, y, mask):
    kinds, sensors, others, stds = rows
    total = np.zeros((2, 2))
    for i in np.flatnonzero(mask):
        g = np.array(measurement_gradient(kinds[i], x, y, *sensors[i], *others[i], 1500.0)) / stds[i]
        total += np.outer(g, g)
    return total


@pytest.mark.parametrize("kinds", ["bearing", "range", "tdoa", "all"])
@pytest.mark.parametrize("model", MOTIONS)
@pytest.mark.parametrize("average", [False, True])
def test_agrees_with_the_recursion_of_information_matrices(average, model, kinds):
    """J ← (Q + Φ J⁻¹ Φᵀ)⁻¹ + mean of HᵀR⁻¹H, by numpy; steps of unequal length, measurements missing."""
    motion = MOTIONS[model]
    n = states_of(motion)
    rng = np.random.default_rng(0)
    rows = rows_of(TRIANGLE, kinds)
    tracks = np.array([simulate(motion, START[:n], 12, 2.0, rng, rows)[0] for _ in range(4)])
    steps = rng.uniform(0.5, 5, 12)
    mask = rng.random((4, 12, 3)) < 0.7
    result = posterior_bound(
        motion, PRIOR[:n, :n], steps, tracks[..., :2], rows[0], rows[1], rows[3], others=rows[2], mask=mask,
        average=average,
    )  # fmt: skip
    assert result.information.shape == (1 if average else 4, 12, n, n)
    gathered = np.array(
        [[information(rows, *tracks[w, k, :2], mask[w, k]) for k in range(12)] for w in range(4)]
    )
    if average:
        gathered = gathered.mean(0, keepdims=True)
    for w in range(len(gathered)):
        j = np.linalg.inv(PRIOR[:n, :n])
        for k in range(12):
            phi = transition(motion, steps[k])
            j = np.linalg.inv(process_noise(motion, steps[k]) + phi @ np.linalg.inv(j) @ phi.T)
            j[:2, :2] += gathered[w, k]
            scale = np.sqrt(np.outer(np.diag(j), np.diag(j)))
            np.testing.assert_allclose(result.information[w, k] / scale, j / scale, atol=1e-8)
            expected = np.sqrt(np.trace(np.linalg.inv(j)[:2, :2]))
            assert result.position_rmse_m[w, k] == pytest.approx(expected, rel=1e-7)


def test_the_bound_over_the_scenario_is_the_weaker_one():
    """By convexity: the bound from mean information is no higher than the root mean of the single bounds."""
    motion = MOTIONS["constant-velocity"]
    rng = np.random.default_rng(1)
    tracks = rng.uniform(-800, 800, (50, 1, 2)) + np.cumsum(rng.uniform(-5, 5, (50, 30, 2)), axis=1)
    arguments = (motion, PRIOR[:4, :4], 2.0, tracks, "bearing", TRIANGLE, 0.02)
    single = posterior_bound(*arguments).position_rmse_m
    together = posterior_bound(*arguments, average=True).position_rmse_m[0]
    assert (together <= np.sqrt((single**2).mean(0)) * (1 + 1e-12)).all()
    assert together[-1] < 0.99 * np.sqrt((single[:, -1] ** 2).mean())


def test_without_measurements_it_is_the_prediction():
    motion = MOTIONS["constant-acceleration"]
    result = posterior_bound(motion, PRIOR, 3.0, np.zeros((5, 2)), "range", TRIANGLE, 1.0, mask=False)
    covariance = PRIOR
    for k in range(5):
        phi = transition(motion, 3.0)
        covariance = phi @ covariance @ phi.T + process_noise(motion, 3.0)
        expected = np.sqrt(covariance[0, 0] + covariance[1, 1])
        assert result.position_rmse_m[0, k] == pytest.approx(expected, rel=1e-12)


def test_a_target_that_is_known_to_stand_still_needs_no_process_noise():
    """Q = 0: after k equal measurements the information is k times as large (plus the prior)."""
    motion = make_motion("constant-velocity")
    prior = np.diag([1e8, 1e8, 1e-20, 1e-20])
    result = posterior_bound(motion, prior, 1.0, np.zeros((100, 2)), "range", TRIANGLE, 2.0)
    one, hundred = result.position_rmse_m[0, [0, -1]]
    assert hundred == pytest.approx(one / 10, rel=1e-6)


@pytest.mark.parametrize("kinds", ["bearing", "range", "tdoa"])
def test_filters_obey_it_and_come_close(kinds):
    """600 matched runs with exact priors: root mean square error in [0.95, 1.1] of the bound at every late step."""
    motion = MOTIONS["constant-velocity"]
    rng = np.random.default_rng(8)
    rows = rows_of(TRIANGLE, kinds)
    prior = np.diag([400.0, 400.0, 1.0, 1.0])
    states = rng.multivariate_normal(START[:4], prior, 600)
    phi, q = transition(motion, 2.0), process_noise(motion, 2.0)
    tracker = TrackerBatch(600, motion)
    tracker.place(START[:4], prior)
    tracks, squares = [], []
    for _ in range(40):
        states = states @ phi.T + rng.multivariate_normal(np.zeros(4), q, 600)
        values = np.array([measure(*rows[:3], x, y) for x, y in states[:, :2]])
        values = values + rows[3] * rng.standard_normal(values.shape)
        values = wrapped(values) if kinds == "bearing" else values
        tracker.cycle(2.0, rows[0], rows[1], values[:, None], rows[3], others=rows[2])
        tracks.append(states[:, :2])
        squares.append(((tracker.states[:, 0, :2] - states[:, :2]) ** 2).sum(1))
    bound = posterior_bound(
        motion, prior, 2.0, np.swapaxes(tracks, 0, 1), rows[0], rows[1], rows[3], others=rows[2], average=True
    ).position_rmse_m[0]
    ratio = np.sqrt(np.mean(squares, axis=1)) / bound
    assert (ratio[10:] > 0.9).all() and (ratio[10:] < 1.15).all()
    assert 0.97 < np.sqrt((ratio[10:] ** 2).mean()) < 1.08


def test_results_do_not_depend_on_the_batch():
    motion = MOTIONS["constant-velocity"]
    tracks = np.random.default_rng(4).uniform(-500, 500, (5, 8, 2))
    together = posterior_bound(motion, PRIOR[:4, :4], 2.0, tracks, "range", TRIANGLE, 3.0)
    for w in range(5):
        alone = posterior_bound(motion, PRIOR[:4, :4], 2.0, tracks[w], "range", TRIANGLE, 3.0)
        assert (alone.information[0] == together.information[w]).all()
        assert (alone.position_rmse_m[0] == together.position_rmse_m[w]).all()


@pytest.mark.parametrize(
    "change, words",
    [
        ({"prior": np.zeros((4, 4))}, "prior: got 'not positive definite'"),
        ({"steps_s": -1.0}, "steps_s: got -1.0"),
        ({"positions": np.zeros((3, 3))}, "positions"),
        ({"kinds": "tdoa"}, "others: got None"),
        ({"kinds": "radar"}, "kinds: got 'radar'"),
        ({"kinds": 7}, r"kinds: got \[7, 7\]"),
        ({"stds": 0.0}, "stds: got 0.0"),
        ({"sensors": [1.0, 2.0]}, "sensors"),
        ({"sensors": np.full((3, 2), np.inf)}, "sensors: got 'NaN or infinite'"),
        ({"mask": np.ones((2, 2), bool)}, "mask"),
    ],
)
def test_refusals_say_why(change, words):
    arguments = {
        "motion": MOTIONS["constant-velocity"], "prior": PRIOR[:4, :4], "steps_s": 1.0,
        "positions": np.zeros((3, 2)), "kinds": "range", "sensors": TRIANGLE, "stds": 1.0,
    }  # fmt: skip
    with pytest.raises(InvalidParameterError, match=words):
        posterior_bound(**{**arguments, **change})

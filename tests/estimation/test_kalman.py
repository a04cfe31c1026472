"""The compiled filters against filterpy, against 60 exact digits, and against themselves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.kalman import METHODS, TrackerBatch
from aquaquad_envs.estimation.kalman_motion import PUBLISHED_STEP_VARIANCES, make_motion
from tests.estimation.kalman_reference import (
    PRIOR,
    PUBLISHED_PAIRS,
    TRIANGLE,
    Reference,
    measure,
    rows_of,
    simulate,
    states_of,
    transition,
    wrapped,
)

MOTIONS = {
    "constant-velocity": make_motion("constant-velocity", density=1e-3),
    "constant-acceleration": make_motion("constant-acceleration", density=1e-6),
    "published": make_motion("published", step_variances=PUBLISHED_STEP_VARIANCES),
}
START = np.array([30.0, -20.0, 1.5, 1.0, 0.001, -0.002])
OFF = np.array([60.0, -50.0, 1.0, -1.0, 0.0, 0.0])


def scenario(motion, kinds, steps, seed=1, dt=2.0, sensors=TRIANGLE):
    rows = rows_of(sensors, kinds)
    n = states_of(motion)
    truth, values = simulate(motion, START[:n], steps, dt, np.random.default_rng(seed), rows)
    return rows, truth, values, truth[0] + OFF[:n], PRIOR[:n, :n]


def run(tracker, rows, values, dt=2.0):
    for value in values:
        tracker.cycle(dt, rows[0], rows[1], value, rows[3], others=rows[2])


def apart(tracker, state, covariance):
    """Greatest differences of state and covariance, relative to the standard deviations."""
    deviation = np.sqrt(np.diag(covariance))
    scale = np.abs(state) + deviation
    return (
        np.max(np.abs(tracker.states[0, 0] - state) / scale),
        np.max(np.abs(tracker.covariances[0, 0] - covariance) / np.outer(deviation, deviation)),
    )


@pytest.mark.parametrize("kinds", ["bearing", "range", "tdoa", "all"])
@pytest.mark.parametrize("model", MOTIONS)
@pytest.mark.parametrize(
    "method, alpha, allowed",
    [("ekf", 1.0, 1e-9), ("ukf", 1.0, 1e-9), ("ukf", 0.3, 1e-9), ("ukf", 1e-3, 1e-6)],
)
def test_agrees_with_filterpy(method, alpha, allowed, model, kinds):
    """One cycle from the same start, forty times: relative to |x| + σ, and to σσᵀ after the update.

    From a prior of 15 m: P - K S Kᵀ as filterpy has it loses digits where the prior is much wider than the
    posterior, and at α = 1e-3 its weights of ±1e6 cancel. The next test shows whose digits are right.
    """
    pytest.importorskip("filterpy")
    motion = MOTIONS[model]
    rows, _, values, state, covariance = scenario(motion, kinds, 40)
    ours = TrackerBatch(1, motion, method=method, alpha=alpha, kappa=0.0)
    state, covariance = state - 0.75 * OFF[: len(state)], covariance / 40.0
    for step, value in enumerate(values):
        theirs = Reference(motion, state, covariance, method=method, alpha=alpha, beta=2.0, kappa=0.0)
        ours.place(state, covariance)
        run(ours, rows, [value])
        state, covariance = theirs.step(2.0, *rows[:3], value, rows[3])
        covariance = 0.5 * (covariance + covariance.T)
        assert max(apart(ours, state, covariance)) < allowed, f"step {step}"
    assert ours.repairs[0, 0] == 0


@pytest.mark.parametrize("kinds", ["bearing", "range", "tdoa", "all"])
@pytest.mark.parametrize("carry", [False, True], ids=["drawn", "carried"])
@pytest.mark.parametrize("alpha, kappa", [(1.0, 0.0), (1.0, -3.0), (0.3, 2.0), (1e-3, 0.0)])
def test_digits_are_right(alpha, kappa, carry, kinds):
    """Ten cycles against the textbook's weights and points in 60 digits, bearings as plain numbers."""
    pytest.importorskip("mpmath")
    from tests.estimation.exact_ukf import as_array, exact_ukf_cycle

    motion = MOTIONS["constant-acceleration"]
    rows, _, values, state, covariance = scenario(motion, kinds, 10)
    ours = TrackerBatch(1, motion, alpha=alpha, kappa=kappa, carry_sigma_points=carry, wrap=False)
    ours.place(state, covariance)
    for value in values:
        state, covariance, nis = exact_ukf_cycle(
            motion, state, covariance, 2.0, rows, value, alpha=alpha, kappa=kappa, carry=carry
        )
        run(ours, rows, [value])
        assert max(apart(ours, as_array(state)[:, 0], as_array(covariance))) < 2e-10
        assert ours.nis[0, 0] == pytest.approx(float(nis), rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_the_seam_of_bearings_is_no_obstacle(method):
    """Turning the whole scene by any angle turns the estimate with it."""
    motion = MOTIONS["constant-velocity"]
    rows, _, values, state, covariance = scenario(motion, "bearing", 20)
    covariance = np.diag([1e4, 1e4, 4.0, 4.0])
    ends = []
    for angle in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        both = np.kron(np.eye(2), turn)
        tracker = TrackerBatch(1, motion, method=method, alpha=1e-3)
        tracker.place(both @ state, covariance)
        turned = (rows[0], rows[1] @ turn.T, rows[2] @ turn.T, rows[3])
        run(tracker, turned, wrapped(values + angle))
        ends.append(both.T @ tracker.states[0, 0])
    # The points of the UKF do not turn with the scene: its curvature terms differ a little.
    np.testing.assert_allclose(ends, np.tile(ends[0], (6, 1)), atol=0.05 if method == "ukf" else 1e-7)


def test_without_wrapping_the_seam_breaks_the_filter():
    motion = MOTIONS["constant-velocity"]
    # Due west of the first sensor, where its bearing jumps from π to -π.
    sensors = [[1000.0, -10.0], *TRIANGLE[1:]]
    rows, truth, values, state, covariance = scenario(motion, "bearing", 20, sensors=sensors)
    assert (np.abs(np.diff(values[:, 0])) > 6).any()
    worst = {}
    for wrap in (True, False):
        tracker = TrackerBatch(1, motion, method="ekf", wrap=wrap)
        tracker.place(state, covariance)
        worst[wrap] = 0.0
        for k, value in enumerate(values):
            run(tracker, rows, [value])
            if k > 2:
                worst[wrap] = max(worst[wrap], np.hypot(*(tracker.states[0, 0] - truth[k])[:2]))
        assert np.isfinite(tracker.states).all()
    assert worst[True] < 60 and worst[False] > 300


@pytest.mark.parametrize("method", METHODS)
def test_a_missing_measurement_is_one_that_was_never_listed(method):
    motion = MOTIONS["constant-acceleration"]
    rows, _, values, state, covariance = scenario(motion, "all", 6)
    kinds, sensors, others, stds = rows
    few, masked, holes = (TrackerBatch(1, motion, method=method) for _ in range(3))
    for tracker in (few, masked, holes):
        tracker.place(state, covariance)
    for value in values:
        few.cycle(2.0, kinds[::2], sensors[::2], value[::2], stds[::2], others=others[::2])
        masked.cycle(2.0, kinds, sensors, value, stds, others=others, mask=[True, False, True])
        hole = np.where([True, False, True], value, np.nan)
        holes.cycle(2.0, kinds, sensors, hole, stds, others=others)
    for tracker in (masked, holes):
        assert (tracker.states == few.states).all() and (tracker.covariances == few.covariances).all()
        assert (tracker.used == 2).all() and (tracker.nis == few.nis).all()


@pytest.mark.parametrize("carry", [False, True])
def test_nothing_measured_is_prediction_alone(carry):
    motion = MOTIONS["constant-acceleration"]
    rows, _, values, state, covariance = scenario(motion, "all", 1)
    silent = TrackerBatch(1, motion, carry_sigma_points=carry)
    alone = TrackerBatch(1, motion)
    for tracker in (silent, alone):
        tracker.place(state, covariance)
    silent.cycle(2.0, rows[0], rows[1], values[0], rows[3], others=rows[2], mask=False)
    alone.predict(2.0)
    np.testing.assert_allclose(silent.states, alone.states, rtol=1e-14)
    np.testing.assert_allclose(silent.covariances, alone.covariances, rtol=1e-12, atol=1e-12)
    assert silent.used[0, 0] == 0 and silent.nis[0, 0] == 0


def test_together_the_order_of_measurements_does_not_matter():
    rows, _, values, state, covariance = scenario(MOTIONS["constant-velocity"], "all", 1)
    turned = tuple(part[[2, 0, 1]] for part in rows)
    for method in ("ekf", "ukf"):
        ends = []
        for listed, value in ((rows, values[0]), (turned, values[0][[2, 0, 1]])):
            tracker = TrackerBatch(1, MOTIONS["constant-velocity"], method=method)
            tracker.place(state, covariance)
            run(tracker, listed, [value])
            ends.append(tracker.states[0, 0])
        np.testing.assert_allclose(*ends, rtol=1e-9, atol=1e-9)


def test_one_after_another_differs_from_together_to_second_order():
    """A tenth of the prior and of the error: about a hundredth of the difference."""
    motion = MOTIONS["constant-velocity"]
    rows, truth, _, _, covariance = scenario(motion, "all", 1)
    exact = measure(*rows[:3], *truth[0, :2])
    apart = []
    for scale in (0.1, 0.01):
        ends = []
        for method in ("ekf", "ekf-sequential"):
            tracker = TrackerBatch(1, motion, method=method)
            tracker.place(truth[0] + scale * OFF[:4], scale**2 * covariance)
            tracker.update(rows[0], rows[1], exact, scale * rows[3], others=rows[2])
            ends.append(tracker.states[0, 0])
        apart.append(np.abs(ends[0] - ends[1]).max())
    assert 0 < apart[1] < apart[0] / 50


def test_the_published_laboratory_filter_converges():
    """Dillard 2014, V.C: three sensors in a Y within 8 m, (τ12, τ23, τ13) of rank 2, start (0.5, 0.5).

    Published noise (1.414 ms), Q, R = 1e-6 I, step 0.005 s, motion and carried sigma points at α = 1e-3.
    """
    sensors = np.array([[0.0, 4.0], [-3.5, -2.0], [3.5, -2.0]])
    target = np.array([1.2551, 0.9699])
    first, second = (np.array(PUBLISHED_PAIRS)[:, k] for k in (0, 1))
    ranges = np.hypot(*(target - sensors).T)
    exact = (ranges[first] - ranges[second]) / 1500.0
    tracker = TrackerBatch(200, MOTIONS["published"], carry_sigma_points=True, wrap=False)
    tracker.place([0.5, 0.5, 0, 0, 0, 0], np.eye(6))
    rng = np.random.default_rng(5)
    for _ in range(4000):
        values = exact + 1.414e-3 * rng.standard_normal((200, 1, 3))
        tracker.cycle(0.005, "tdoa", sensors[first], values, 1e-3, others=sensors[second])
    assert np.isfinite(tracker.states).all() and (np.linalg.eigvalsh(tracker.covariances) > 0).all()
    mean = tracker.states[:, 0, :2].mean(0)
    spread = tracker.states[:, 0, :2].std(0)
    assert (np.abs(mean - target) < 4 * spread / np.sqrt(200) + 0.1).all()
    assert tracker.repairs.sum() == 0


# --- safety ------------------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(METHODS)),
    st.sampled_from(sorted(MOTIONS)),
    st.integers(0, 2**32 - 1),
    st.floats(-8, 1),
    st.floats(-3, 4),
    st.floats(-3, 2),
)
def test_covariances_stay_symmetric_and_positive(method, model, seed, noise, width, step):
    """Whatever the scales: deviations from 1e-8 to 10, priors from 1 mm to 10 km, wild measurements."""
    rng = np.random.default_rng(seed)
    motion = MOTIONS[model]
    n = states_of(motion)
    tracker = TrackerBatch(8, motion, method=method, alpha=float(rng.choice([1e-3, 0.1, 1.0])))
    root = 10.0**width * np.tril(rng.standard_normal((n, n)))
    tracker.place(rng.uniform(-1000, 1000, (8, 1, n)), root @ root.T + 1e-9 * 10 ** (2 * width) * np.eye(n))
    for _ in range(10):
        kinds = rng.integers(0, 3, 5)
        values = np.where(kinds == 0, rng.uniform(-3, 3, (8, 1, 5)), rng.uniform(0, 1000, (8, 1, 5)))
        tracker.cycle(
            10.0**step, kinds, rng.uniform(-1000, 1000, (5, 2)), values, 10.0**noise,
            others=rng.uniform(-1000, 1000, (5, 2)), mask=rng.random((8, 1, 5)) < 0.7,
        )  # fmt: skip
        p = tracker.covariances
        assert np.isfinite(p).all() and np.isfinite(tracker.states).all()
        assert (p == p.swapaxes(-1, -2)).all()
        diagonal = np.einsum("...ii->...i", p)
        assert (diagonal > 0).all()
        # In units of its own deviations, so that rounding is the same in all directions.
        scale = np.sqrt(diagonal)
        scaled = p / (scale[..., :, None] * scale[..., None, :])
        assert np.linalg.eigvalsh(scaled).min() > -1e-13
        assert (tracker.nis >= 0).all()


def test_a_lost_covariance_is_repaired_and_counted():
    motion = MOTIONS["constant-velocity"]
    rows, truth, values, state, covariance = scenario(motion, "range", 30)
    tracker = TrackerBatch(2, motion)
    tracker.place(state, covariance)
    tracker.covariances[0, 0, 0, 1] = tracker.covariances[0, 0, 1, 0] = 1e5  # correlation above 1
    run(tracker, rows, values)
    assert tracker.repairs[0, 0] == 1 and tracker.repairs[1, 0] == 0
    assert (np.linalg.eigvalsh(tracker.covariances) > 0).all()
    # It goes on tracking.
    assert (np.hypot(*(tracker.states[:, 0, :2] - truth[-1, :2]).T) < 20).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["bearing", "range", "tdoa"])
def test_an_estimate_on_a_sensor_stays_finite(kind, method):
    tracker = TrackerBatch(1, MOTIONS["constant-velocity"], method=method)
    tracker.place([1000.0, 50.0, 0, 0], np.eye(4))
    tracker.update(kind, TRIANGLE, [0.5, 0.5, 0.5], 0.1, others=np.roll(TRIANGLE, 1, 0))
    assert np.isfinite(tracker.states).all() and (np.linalg.eigvalsh(tracker.covariances) > 0).all()


# --- batches -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_results_do_not_depend_on_the_batch(method):
    motion = MOTIONS["constant-acceleration"]
    rng = np.random.default_rng(3)
    kinds = rng.integers(0, 3, (7, 3, 4))
    sensors, others = rng.uniform(-1000, 1000, (2, 7, 3, 4, 2))
    values, steps = rng.uniform(-1, 1, (5, 7, 3, 4)), rng.uniform(0, 5, (7, 3))
    states = rng.uniform(-100, 100, (7, 3, 6))
    together = TrackerBatch(7, motion, num_tracks=3, method=method)
    together.place(states, PRIOR)
    for value in values:
        together.cycle(steps, kinds, sensors, value, 0.1, others=others)
    for w in range(7):
        for t in range(3):
            alone = TrackerBatch(1, motion, method=method)
            alone.place(states[w, t], PRIOR)
            for value in values:
                alone.predict(steps[w, t])
                alone.update(kinds[w, t], sensors[w, t], value[w, t], 0.1, others=others[w, t])
            assert (alone.states[0, 0] == together.states[w, t]).all()
            assert (alone.covariances[0, 0] == together.covariances[w, t]).all()


def test_only_masked_tracks_are_placed():
    tracker = TrackerBatch(3, MOTIONS["constant-velocity"], num_tracks=2)
    mask = np.zeros((3, 2), dtype=bool)
    mask[1, 0] = True
    tracker.place([5.0, 6.0, 0, 0], 2 * np.eye(4), mask=mask)
    assert (tracker.states[1, 0] == [5, 6, 0, 0]).all() and np.abs(tracker.states).sum() == 11
    assert (tracker.covariances[1, 0] == 2 * np.eye(4)).all() and (
        tracker.covariances[0, 0] == np.eye(4)
    ).all()


def test_nees_is_the_quadratic_form():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((6, 6))
    tracker = TrackerBatch(4, MOTIONS["constant-acceleration"])
    tracker.place(rng.standard_normal((4, 1, 6)), root @ root.T)
    truth = rng.standard_normal((4, 1, 6))
    error = (truth - tracker.states)[:, 0]
    expected = [e @ np.linalg.solve(root @ root.T, e) for e in error]
    np.testing.assert_allclose(tracker.nees(truth)[:, 0], expected, rtol=1e-9)


def test_prediction_follows_the_exponential():
    motion = MOTIONS["constant-acceleration"]
    tracker = TrackerBatch(1, motion)
    tracker.place(START, PRIOR)
    tracker.predict(7.0)
    np.testing.assert_allclose(tracker.states[0, 0], transition(motion, 7.0) @ START, rtol=1e-13)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda t: t.predict(-1.0), "dt_s: got -1.0"),
        (lambda t: t.predict(np.nan), "dt_s"),
        (lambda t: t.update("sonar", TRIANGLE, [1.0, 2, 3], 0.1), "Did you mean|one of bearing"),
        (lambda t: t.update("tdoa", TRIANGLE, [1.0, 2, 3], 0.1), "others: got None"),
        (lambda t: t.update([0, 1, 5], TRIANGLE, [1.0, 2, 3], 0.1), r"kinds: got \[0, 5\]"),
        (lambda t: t.update("range", TRIANGLE, [1.0, 2, 3], 0.0), "stds: got 0.0"),
        (lambda t: t.update("range", TRIANGLE[:2], [1.0, 2, 3], 0.1), r"sensors: got \(2, 2\)"),
        (lambda t: t.update("range", np.full((3, 2), np.nan), [1.0, 2, 3], 0.1), "sensors: got 'NaN"),
        (lambda t: t.update("range", TRIANGLE, 1.0, 0.1), "values: got 1.0"),
        (lambda t: t.place(np.zeros(4), np.zeros((4, 4))), "not positive definite"),
        (lambda t: t.place(np.zeros(4), np.eye(4) + np.eye(4, k=1)), "not symmetric"),
        (lambda t: t.place(np.full(4, np.inf), np.eye(4)), "states: got 'NaN or infinite'"),
        (lambda t: TrackerBatch(0, t.motion), "num_worlds: got 0"),
        (lambda t: TrackerBatch(1, t.motion, method="kf"), "method: got 'kf'"),
        (lambda t: TrackerBatch(1, t.motion, alpha=0.0), "alpha: got 0.0"),
        (lambda t: TrackerBatch(1, t.motion, alpha=1.0, beta=0.0, kappa=-3.0), "beta: got 0.0"),
        (lambda t: TrackerBatch(1, t.motion, method="ekf", carry_sigma_points=True), "carry_sigma_points"),
        (lambda t: make_motion("constant-acceleration", density=-1.0), "density: got -1.0"),
        (lambda t: make_motion("published", density=1.0), "density: got 1.0"),
        (
            lambda t: make_motion("constant-velocity", step_variances=(0, 0, 1.0)),
            "no variance of acceleration",
        ),
        (lambda t: make_motion("circular"), "model: got 'circular'"),
    ],
)
def test_refusals_say_why(call, words):
    tracker = TrackerBatch(1, MOTIONS["constant-velocity"])
    with pytest.raises(InvalidParameterError, match=words):
        call(tracker)
    assert (tracker.states == 0).all() and (tracker.covariances == np.eye(4)).all()

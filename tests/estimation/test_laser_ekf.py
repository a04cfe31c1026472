"""The laser's extended Kalman filter: Jacobians by differences, a plain matrix filter beside, and what it can find."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.kalman_motion import make_motion
from aquaquad_envs.estimation.laser_ekf import (
    LaserEkf,
    make_laser_model,
    polar_from_cartesian,
    polar_velocity,
    slope_and_residual,
)
from aquaquad_envs.sensing.laser import detectable_radius, intensity, make_beam

BEAM, HEIGHT = make_beam(), 5.0
W = detectable_radius(BEAM, HEIGHT)
MODEL = make_laser_model(BEAM, HEIGHT, intensity_std=1e-3)
TANGENT = make_laser_model(BEAM, HEIGHT, intensity_std=1e-3, gate=math.inf)


def cartesian_readings(state):
    return np.array([intensity(BEAM, math.hypot(*state[:2]), HEIGHT), *state[2:]])


def polar_readings(state):
    r, angle, along, rate = state
    return np.array(
        [
            intensity(BEAM, r, HEIGHT),
            along * math.cos(angle) - r * rate * math.sin(angle),
            along * math.sin(angle) + r * rate * math.cos(angle),
        ]
    )


def jacobian(function, state, step=1e-6):
    columns = []
    for k in range(4):
        change = np.zeros(4)
        change[k] = step
        columns.append((function(state + change) - function(state - change)) / (2 * step))
    return np.stack(columns, axis=1)


def matrix_filter(function, state, covariance, transition, noise, readings, stds, moved=(0.0, 0.0)):
    """One cycle of the textbook's equations (5.12-5.18), gradients by differences."""
    state = transition @ state - np.array([*moved, 0, 0])
    covariance = transition @ covariance @ transition.T + noise
    gradient = jacobian(function, state)[: len(readings)]
    innovation = gradient @ covariance @ gradient.T + np.diag(np.square(stds))
    gain = covariance @ gradient.T @ np.linalg.inv(innovation)
    residual = readings - function(state)[: len(readings)]
    nis = residual @ np.linalg.solve(innovation, residual)
    return state + gain @ residual, covariance - gain @ innovation @ gain.T, nis


def a_covariance(seed):
    root = np.random.default_rng(seed).normal(size=(4, 4)) * np.array([0.1, 0.1, 0.05, 0.05])[:, None]
    return root @ root.T + 1e-4 * np.eye(4)


TRANSITION = np.eye(4) + 0.1 * np.eye(4, k=2)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.1, 1.4), st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 1000))
def test_one_cycle_is_the_matrix_filters(r, angle, u, v, seed):
    """All three updates against matrices and numeric Jacobians: the analytic ones are right."""
    covariance = a_covariance(seed)
    rng = np.random.default_rng(seed)
    state = np.array([r * W * math.cos(angle), r * W * math.sin(angle), u, v])
    stds = np.array([TANGENT.std, TANGENT.velocity_std, TANGENT.velocity_std])
    readings = cartesian_readings(TRANSITION @ state) + stds * rng.normal(size=3)
    q = 0.01
    noise = q * np.kron([[0.1**3 / 3, 0.1**2 / 2], [0.1**2 / 2, 0.1]], np.eye(2))
    moved = np.array([0.02, -0.03])

    ours = LaserEkf(1, TANGENT, motion=make_motion("constant-velocity", density=q))
    for rows in (1, 3):
        ours.place(state, covariance)
        ours.cycle(0.1, readings[0], moved=moved, velocities=readings[1:] if rows == 3 else None)
        x, p, nis = matrix_filter(
            cartesian_readings, state, covariance, TRANSITION, noise, readings[:rows], stds[:rows], moved
        )
        np.testing.assert_allclose(ours.states[0], x, atol=1e-6)
        np.testing.assert_allclose(ours.covariances[0], p, atol=1e-6)
        assert ours.nis[0] == pytest.approx(nis, rel=1e-4, abs=1e-6)

    polar, spread = (part[0] for part in polar_from_cartesian(state[None], covariance[None]))
    predicted = TRANSITION @ polar
    if predicted[0] < 0.05 * W:
        return
    readings = polar_readings(predicted) + stds * rng.normal(size=3)
    rates = (1e-4, 1e-4, 1e-3, 1e-3)
    ours = LaserEkf(1, TANGENT, form="polar", polar_noise=rates)
    ours.place(state, covariance)
    ours.cycle(0.1, readings[0], velocities=readings[1:])
    x, p, nis = matrix_filter(polar_readings, polar, spread, TRANSITION, 0.1 * np.diag(rates), readings, stds)
    scale = np.sqrt(np.diag(spread)) + 1.0
    np.testing.assert_allclose(ours.states[0] / scale, x / scale, atol=2e-5)
    np.testing.assert_allclose(
        ours.covariances[0] / np.outer(scale, scale), p / np.outer(scale, scale), atol=2e-5
    )
    assert ours.nis[0] == pytest.approx(nis, rel=1e-3, abs=1e-5)


@settings(max_examples=40, deadline=None)
@given(st.floats(0.05, 2), st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_polar_form_says_the_same(r, angle, u, v):
    state = np.array([r * math.cos(angle), r * math.sin(angle), u, v])

    def convert(values):
        return polar_from_cartesian(values, np.eye(4))[0]

    polar, spread = polar_from_cartesian(state, np.eye(4))
    assert polar_velocity(polar) == pytest.approx((u, v), abs=1e-12)
    assert polar[0] * np.array([math.cos(polar[1]), math.sin(polar[1])]) == pytest.approx(state[:2])
    gradient = jacobian(convert, state)
    np.testing.assert_allclose(spread, gradient @ gradient.T, rtol=1e-5, atol=1e-5 * np.abs(spread).max())


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 3), st.floats(0, 3))
def test_the_secant_points_at_the_reading(estimated, true):
    """Far off, the update's slope leads from the estimate towards the radius that the reading tells; near, the tangent."""
    r, reading = estimated * W, intensity(BEAM, true * W, HEIGHT)
    slope, residual = slope_and_residual(MODEL, r, reading)
    plain, plain_residual = slope_and_residual(TANGENT, r, reading)
    if abs(plain_residual) <= MODEL.gate * MODEL.std:
        assert (slope, residual) == (plain, plain_residual)
        return
    assert residual * plain_residual > 0
    if slope == plain:
        return
    # A whole step along the secant ends between the estimate and the truth, but for the margin at dark and peak.
    landing = r + residual / slope
    margin = MODEL.gate * MODEL.std
    assert margin <= intensity(BEAM, landing, HEIGHT) * (1 + 1e-9)
    assert intensity(BEAM, landing, HEIGHT) <= (MODEL.peak - margin) * (1 + 1e-9)
    assert (landing - r) * (true * W - r) > 0


def test_a_flat_top_tells_the_tangent_nothing_but_the_secant_that_it_is_dark():
    covariance = np.diag([0.04, 1e-4, 0.01, 0.01])
    moved = {}
    for name, model in (("tangent", TANGENT), ("secant", MODEL)):
        ours = LaserEkf(1, model)
        ours.place([0.2 * W, 0.0, 0.0, 0.0], covariance)
        ours.cycle(0.0, 0.0)
        moved[name] = ours.states[0, 0]
    assert moved["tangent"] == pytest.approx(0.2 * W, abs=1e-3)
    assert moved["secant"] > W


def test_a_wide_arc_is_not_taken_for_a_point():
    """Unsure across the line of sight, the filter must not become sure along it: r is a curve there."""
    left = []
    for model in (TANGENT, MODEL):
        ours = LaserEkf(1, model)
        ours.place([1.1 * W, 0.0, 0.0, 0.0], np.diag([(0.1 * W) ** 2, (0.6 * W) ** 2, 1e-4, 1e-4]))
        ours.cycle(0.0, intensity(BEAM, 1.1 * W, HEIGHT))
        left.append(math.sqrt(ours.covariances[0, 0, 0]) / W)
        # Of all centres at that distance the mean is nearer.
        assert (ours.states[0, 0] < 1.1 * W - 1e-3) == (model is MODEL)
    assert left[0] < 0.05 < 0.08 < left[1] <= 0.1


def _circle(form, model, noise, *, velocity=(0.1, -0.05), turns=6, seed=0):
    """Errors of position over time while the receiver rides round the disc's edge at 0.9 W."""
    rng = np.random.default_rng(seed)
    dt, count = 0.1, 60 * turns
    angle = 2 * math.pi / 60 * np.arange(count + 1)
    # Centre seen from the receiver.
    d = 0.9 * W * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    centre = dt * np.arange(count + 1)[:, None] * np.array(velocity)
    own = centre - d
    ours = LaserEkf(1, model, form=form, motion=make_motion("constant-velocity", density=1e-3))
    relative = (d[1] - d[0]) / dt
    start = d[0] + np.array([0.1, -0.1])
    ours.place([*start, *(relative if form == "polar" else (0.0, 0.0))], np.diag([0.02, 0.02, 0.02, 0.02]))
    errors = []
    for k in range(1, count + 1):
        reading = intensity(BEAM, math.hypot(*d[k]), HEIGHT) + noise * rng.normal()
        ours.cycle(
            dt, reading, moved=own[k] - own[k - 1] if form == "cartesian" else 0.0,
            velocities=(d[k] - d[k - 1]) / dt if form == "polar" else None,
        )  # fmt: skip
        errors.append(ours.positions()[0] - d[k])
    return np.hypot(*np.array(errors).T), ours


def test_riding_the_edge_finds_centre_and_velocity():
    """The edge shows which way the centre is: without any reading of velocity."""
    errors, ours = _circle("cartesian", MODEL, 1e-3)
    assert errors[:5].min() > 0.05
    assert errors[-60:].max() < 0.2 * W
    assert ours.states[0, 2:] == pytest.approx((0.1, -0.05), abs=0.04)
    assert (ours.repairs == 0).all()


def test_published_form_follows_with_relative_velocity():
    errors, _ = _circle("polar", TANGENT, 1e-3)
    assert errors[-60:].max() < 0.2 * W


def test_variance_shrinks_on_the_edge_and_grows_inside():
    def trace_after(r):
        ours = LaserEkf(1, MODEL)
        ours.place([r, 0.0, 0.0, 0.0], 0.01 * np.eye(4))
        for _ in range(5):
            ours.cycle(0.1, intensity(BEAM, r, HEIGHT))
        return ours.covariances[0, 0, 0]

    assert trace_after(0.2 * W) > 0.01
    assert trace_after(1.2 * W) < 0.001


def test_batch_equals_single_worlds_and_masks():
    rng = np.random.default_rng(3)
    states = rng.normal(size=(5, 4)) * 0.3
    many = LaserEkf(5, MODEL)
    many.place(states, 0.05 * np.eye(4))
    readings = rng.uniform(0, MODEL.peak, 5)
    moved = rng.normal(size=(5, 2)) * 0.1
    mask = np.array([True, False, True, True, True])
    many.cycle(0.1, readings, moved=moved, mask=mask)
    for i in range(5):
        one = LaserEkf(1, MODEL)
        one.place(states[i], 0.05 * np.eye(4))
        one.cycle(0.1, readings[i], moved=moved[i], mask=mask[i])
        np.testing.assert_array_equal(one.states[0], many.states[i])
        np.testing.assert_array_equal(one.covariances[0], many.covariances[i])
    assert many.states[1, :2] == pytest.approx(states[1, :2] + 0.1 * states[1, 2:] - moved[1])


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: make_laser_model(BEAM, 0.0, intensity_std=1e-3), "height_m: got 0.0"),
        (lambda: make_laser_model(BEAM, 5.0, intensity_std=0.0), "intensity_std: got 0.0"),
        (lambda: make_laser_model(BEAM, 5.0, intensity_std=1e-3, gate=0.5), "gate: got 0.5"),
        (lambda: LaserEkf(0, MODEL), "num_worlds: got 0"),
        (lambda: LaserEkf(1, MODEL, form="polr"), "Did you mean 'polar'"),
        (lambda: LaserEkf(1, MODEL, motion=make_motion()), "constant-velocity"),
        (lambda: LaserEkf(1, MODEL, form="polar").cycle(0.1, 0.0), "velocities: got None"),
        (lambda: LaserEkf(1, MODEL, form="polar").place(np.zeros(4), np.eye(4)), "form='cartesian'"),
        (lambda: LaserEkf(1, MODEL).place(np.zeros(4), np.zeros((4, 4))), "positive definite"),
        (lambda: LaserEkf(1, MODEL).cycle(0.1, [math.nan]), "readings"),
        (lambda: LaserEkf(2, MODEL).cycle(0.1, [0.0, 0.0, 0.0]), "readings"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

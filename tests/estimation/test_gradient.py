"""Algorithm 2 on fields whose gradient is known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.gradient import GradientBatch, gradient_command, make_gradient_settings
from aquaquad_envs.sensing.laser import detectable_radius, intensity, make_beam


def along(path, field, **options):
    """The estimate after the points of ``path`` (steps, 2)."""
    batch = GradientBatch(1, make_gradient_settings(**options))
    for point in path:
        batch.update(point[None], [field(*point)])
    return batch.gradients[0].copy()


def published_by_hand(path, field, d_min, beta, gamma):
    """The source's lines one by one, in each coordinate."""
    gradient, last = np.zeros(2), path[0]
    for point in path[1:]:
        if np.linalg.norm(point - last) >= d_min:
            quotient = (field(*point) - field(*last)) / (point - last)
            gradient, last = beta * quotient + (1 - beta) * gradient, point
        else:
            gradient = (1 - gamma) * gradient
    return gradient


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.floats(0.02, 0.3), st.floats(0.05, 1), st.floats(0, 0.2))
def test_published_form_line_by_line(seed, d_min, beta, gamma):
    path = np.cumsum(np.random.default_rng(seed).uniform(0.02, 0.1, (30, 2)), axis=0)

    def field(x, y):
        return math.sin(x) + 0.3 * x * y

    found = along(path, field, min_move_m=d_min, smoothing=beta, decay=gamma, form="published")
    np.testing.assert_allclose(found, published_by_hand(path, field, d_min, beta, gamma), rtol=1e-10)


@pytest.mark.parametrize("axis", [0, 1])
def test_along_one_axis_both_forms_are_one(axis):
    path = np.zeros((25, 2))
    path[:, axis] = np.cumsum(np.random.default_rng(1).uniform(0.0, 0.1, 25))

    def field(x, y):
        return math.cos(x) - y * y

    forms = [along(path, field, form=form) for form in ("directional", "published")]
    np.testing.assert_allclose(*forms, rtol=1e-12)
    assert forms[0][1 - axis] == 0.0


@settings(max_examples=30, deadline=None)
@given(st.floats(-5, 5), st.floats(-5, 5))
def test_a_turning_path_finds_the_gradient_of_a_plane(gx, gy):
    """The directional form converges to it; the published one credits each axis with the whole rise."""
    angle = 0.3 * np.arange(80)
    path = np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def field(x, y):
        return gx * x + gy * y

    assert along(path, field) == pytest.approx((gx, gy), abs=1e-6 * (1 + abs(gx) + abs(gy)))


def test_estimate_decays_at_rest_by_gamma_a_call():
    path = np.array([[0.0, 0.0], [0.1, 0.0], *[[0.1, 0.0]] * 10])
    found = along(path, lambda x, y: 2.0 * x, smoothing=1.0, decay=0.1)
    assert found == pytest.approx((2.0 * 0.9**10, 0.0))


def test_small_moves_add_up():
    path = np.stack([0.01 * np.arange(20), np.zeros(20)], axis=-1)
    assert along(path, lambda x, y: 3.0 * x, min_move_m=0.05, smoothing=1.0, decay=0.0)[0] == pytest.approx(
        3.0
    )


@pytest.mark.parametrize("form, aside", [("directional", 0.1), ("published", 0.0)])
def test_following_it_climbs_the_beam(form, aside):
    """To near the Gaussian's centre, but no further than the flat top's brim; published was motion in one axis."""
    ends = {}
    for profile in ("gaussian", "flat-top"):
        beam = make_beam(profile=profile)
        w = detectable_radius(beam, 5.0)
        position = np.array([1.1 * w, aside * w])
        batch = GradientBatch(1, make_gradient_settings(min_move_m=0.01, form=form))
        batch.update(position[None], [intensity(beam, math.hypot(*position), 5.0)])
        velocity = np.array([-0.2, -0.2 * aside])
        for _ in range(400):
            position = position + 0.1 * velocity
            gradient = batch.update(position[None], [intensity(beam, math.hypot(*position), 5.0)])[0]
            velocity = np.array(gradient_command(*gradient, 2.0, 0.3))
        ends[profile] = math.hypot(*position) / w
    assert ends["gaussian"] < 0.3
    assert 0.5 < ends["flat-top"] < 1.0


def test_command_is_clipped_at_its_speed():
    assert gradient_command(3.0, 4.0, 0.1, 1.0) == pytest.approx((0.3, 0.4))
    assert gradient_command(3.0, 4.0, 10.0, 1.0) == pytest.approx((0.6, 0.8))
    assert gradient_command(0.0, 0.0, 10.0, 1.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: make_gradient_settings(min_move_m=0.0), "min_move_m: got 0.0"),
        (lambda: make_gradient_settings(smoothing=1.5), "smoothing: got 1.5"),
        (lambda: make_gradient_settings(decay=-0.1), "decay"),
        (lambda: make_gradient_settings(form="publishd"), "Did you mean 'published'"),
        (lambda: GradientBatch(0), "num_worlds: got 0"),
        (lambda: GradientBatch(2).update([[0.0, 0.0]], [1.0, 1.0]), "positions"),
        (lambda: GradientBatch(1).update([[0.0, 0.0]], [math.nan]), "intensities"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

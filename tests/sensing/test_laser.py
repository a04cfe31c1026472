"""The laser's light: golden values by another route, its power by quadrature, its limits, and the reading."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.randomness import normal, seed_streams
from aquaquad_envs.sensing.laser import (
    beam_sigma,
    detectable_radius,
    effective_divergence,
    illuminated_radius,
    intensity,
    intensity_gradient,
    make_beam,
    peak_intensity,
    profile_slope,
    radius_of_intensity,
    reading,
)

DEGREE = math.pi / 180

beams = st.builds(
    make_beam,
    power_w=st.floats(1e-3, 10),
    divergence_rad=st.floats(2 * DEGREE, 60 * DEGREE),
    field_of_view_rad=st.floats(2 * DEGREE, 60 * DEGREE),
    order=st.sampled_from([2, 4, 10, 30]),
    water_depth_m=st.floats(0, 10),
    attenuation_per_m=st.floats(0, 1),
    refractive_index=st.floats(1, 1.4),
)
heights = st.floats(0.5, 20)


# --- golden values -----------------------------------------------------------------------------------------


def test_gaussian_by_the_textbook():
    """The waist form of laser optics, I = 2P/(π w²) exp(-2 r²/w²), from which the thesis starts."""
    beam = make_beam(profile="gaussian")
    z = 5.0
    w = z * math.sin(5 * DEGREE)
    for r in (0.0, 0.1, 0.4, 1.0):
        expected = 2 * 0.045 / (math.pi * w**2) * math.exp(-2 * (r / w) ** 2)
        assert intensity(beam, r, z) == pytest.approx(expected, rel=1e-13)
    assert intensity(beam, w, z) == pytest.approx(math.exp(-2) * peak_intensity(beam, z))


def test_flat_top_by_its_normalisation():
    """Peak from the integral of the profile, in place of the gamma function."""
    beam, z = make_beam(), 5.0
    w = z * math.sin(5 * DEGREE)
    volume = 2 * math.pi * quad(lambda r: r * math.exp(-0.05 * (r / w) ** 10), 0, 3 * w)[0]
    for r in (0.0, 0.3, 0.45, 0.6):
        expected = 0.045 / volume * math.exp(-0.05 * (r / w) ** 10)
        assert intensity(beam, r, z) == pytest.approx(expected, rel=1e-9)
    assert intensity(beam, w, z) == pytest.approx(math.exp(-0.05) * peak_intensity(beam, z))


@pytest.mark.parametrize("order", [2, 4, 6, 10, 20, 50, 100])
@pytest.mark.parametrize("z", [0.5, 6.0])
def test_the_plane_receives_the_power_for_every_order(order, z):
    profiles = ("gaussian", "flat-top") if order == 2 else ("flat-top",)
    for profile in profiles:
        beam = make_beam(order=order, profile=profile)
        sigma = beam_sigma(beam, z)
        light = lambda r, beam=beam: 2 * math.pi * r * intensity(beam, r, z)  # noqa: E731
        found = quad(light, 0, 12 * sigma, points=[0.8 * sigma, 1.2 * sigma], limit=200)[0]
        assert found == pytest.approx(0.045, rel=1e-7)


# --- limits and directions ---------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(beams, heights)
def test_gradient_is_the_derivative_and_points_inward(beam, z):
    w = detectable_radius(beam, z)
    assert intensity_gradient(beam, 0.0, z) == 0.0
    for r in w * np.array([0.3, 0.9, 1.1, 1.3]):
        h = 1e-5 * r
        numeric = (intensity(beam, r + h, z) - intensity(beam, r - h, z)) / (2 * h)
        assert intensity_gradient(beam, r, z) == pytest.approx(
            numeric, rel=1e-4, abs=1e-7 * peak_intensity(beam, z) / w
        )
        assert intensity_gradient(beam, r, z) <= 0.0
    assert intensity_gradient(beam, 1e6 * w, z) == 0.0
    value, slope = profile_slope(peak_intensity(beam, z), beam_sigma(beam, z), beam.half_order, -w)
    assert value == pytest.approx(intensity(beam, w, z), rel=1e-14)
    assert slope == pytest.approx(-intensity_gradient(beam, w, z), rel=1e-14)


def test_higher_orders_approach_a_step():
    z = 4.0
    beam = make_beam(order=100)
    w = detectable_radius(beam, z)
    flat = 0.045 / (math.pi * w**2)
    assert intensity(beam, 0.0, z) == pytest.approx(flat, rel=0.06)
    assert intensity(beam, 0.98 * w, z) == pytest.approx(flat, rel=0.06)
    assert intensity(beam, 1.1 * w, z) < 1e-100


@settings(max_examples=50, deadline=None)
@given(beams, heights, st.floats(0.01, 0.99))
def test_radius_of_intensity_inverts(beam, z, share):
    level = share * peak_intensity(beam, z)
    assert intensity(beam, radius_of_intensity(beam, level, z), z) == pytest.approx(level, rel=1e-9)
    assert radius_of_intensity(beam, 1.01 * peak_intensity(beam, z), z) == 0.0
    assert radius_of_intensity(beam, 0.0, z) == math.inf


def test_light_falls_with_the_square_of_the_height():
    beam = make_beam()
    assert peak_intensity(beam, 2.0) == pytest.approx(4 * peak_intensity(beam, 4.0))


@given(st.floats(2 * DEGREE, 80 * DEGREE), st.floats(2 * DEGREE, 80 * DEGREE), heights)
@settings(deadline=None, max_examples=50)
def test_effective_divergence_is_the_lesser_angle(divergence, view, z):
    beam = make_beam(divergence_rad=divergence, field_of_view_rad=view)
    assert effective_divergence(beam, z) == pytest.approx(min(divergence, view), rel=1e-9)
    assert illuminated_radius(beam, z) == pytest.approx(z * math.sin(divergence / 2), rel=1e-12)
    assert detectable_radius(beam, z) <= illuminated_radius(beam, z)


# --- water -------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 2), st.floats(0.1, 8), heights, st.floats(0, 2))
def test_water_takes_its_share_by_beer_and_lambert(attenuation, depth, z, r):
    clear = make_beam(water_depth_m=depth)
    murky = make_beam(water_depth_m=depth, attenuation_per_m=attenuation)
    share = math.exp(-attenuation * min(depth, z))
    assert intensity(murky, r, z) == pytest.approx(share * intensity(clear, r, z), rel=1e-12, abs=1e-300)


def _landing_radius(angle_in_water, index, depth, height):
    """A ray by Snell's law and the tangents of its two legs."""
    in_air = math.asin(index * math.sin(angle_in_water))
    return depth * math.tan(angle_in_water) + height * math.tan(in_air)


@settings(max_examples=50, deadline=None)
@given(st.floats(1, 1.4), st.floats(0.5, 6), st.floats(0.5, 6))
def test_rays_bend_at_the_surface_as_snell_says(index, depth, height):
    """LIA and LDA against rays of the edge of the laser's cone and of the field of view: to the sine's 2 %."""
    beam = make_beam(water_depth_m=depth, refractive_index=index)
    laser = _landing_radius(10 * DEGREE, index, depth, height)
    assert illuminated_radius(beam, depth + height) == pytest.approx(laser, rel=0.035)
    seen = _landing_radius(math.asin(math.sin(5 * DEGREE) / index), index, depth, height)
    assert detectable_radius(beam, depth + height) == pytest.approx(seen, rel=0.005)
    # Below the surface nothing has bent yet.
    assert illuminated_radius(beam, 0.5 * depth) == pytest.approx(0.5 * depth * math.sin(10 * DEGREE))


def test_default_neglects_water_as_published():
    assert intensity(make_beam(water_depth_m=3.0), 0.2, 5.0) == intensity(make_beam(), 0.2, 5.0)


# --- the reading -------------------------------------------------------------------------------------------


def test_without_noise_and_converter_the_reading_is_the_light():
    assert reading(0.037, 0.0, 0.0, 0, math.inf, 1.7) == 0.037
    assert reading(0.037, 0.01, 0.0, 4096, math.inf, 1.7) == pytest.approx(0.047, abs=1e-15)


@settings(max_examples=100, deadline=None)
@given(st.floats(0, 0.3), st.integers(1, 16), st.floats(-3, 3))
def test_converter_rounds_to_its_levels_and_saturates(light, bits, draw):
    levels, full_scale, noise = 2**bits, 0.2, 0.01
    exact = light + noise * draw
    found = reading(light, 0.0, noise, levels, full_scale, draw)
    step = full_scale / (levels - 1)
    assert 0.0 <= found <= full_scale * (1 + 1e-12)
    assert abs(found / step - round(found / step)) < 1e-6
    assert abs(found - min(max(exact, 0.0), full_scale)) <= step / 2 * (1 + 1e-9)
    assert reading(light, 0.0, noise, 0, full_scale, draw) == min(max(exact, 0.0), full_scale)


def test_noise_and_ambient_light_show_in_mean_and_spread():
    stream = seed_streams(3)[2]
    values = np.array([reading(0.05, 0.02, 0.004, 0, math.inf, normal(stream)) for _ in range(4000)])
    assert values.mean() == pytest.approx(0.07, abs=4 * 0.004 / math.sqrt(4000))
    assert values.std() == pytest.approx(0.004, rel=0.06)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"power_w": 0.0}, "power_w: got 0.0"),
        ({"divergence_rad": 2.0}, "divergence_rad: got 2.0"),
        ({"field_of_view_rad": 0.0}, "field_of_view_rad"),
        ({"order": 3}, "order: got 3, expected an even"),
        ({"order": 0}, "order: got 0"),
        ({"order": 10, "profile": "gaussian"}, "profile='flat-top'"),
        ({"profile": "gausian"}, "Did you mean 'gaussian'"),
        ({"ambient_w_m2": -1.0}, "ambient_w_m2"),
        ({"attenuation_per_m": math.nan}, "attenuation_per_m"),
        ({"refractive_index": 1.5}, "refractive_index"),
    ],
)
def test_refusals_say_why(options, words):
    with pytest.raises(InvalidParameterError, match=words):
        make_beam(**options)

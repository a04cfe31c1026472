"""Rays against closed forms, an independent integrator, mirror images, and the duct that traps them."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.sensing.acoustics import sound_speed
from aquaquad_envs.sensing.profiles import SoundSpeedProfile
from aquaquad_envs.sensing.rays import trace_ray

angles = st.floats(0.2, math.pi - 0.2)


def linear(gradient, *, surface=1500.0, bottom=4000.0, layers=1):
    depths = np.linspace(0, bottom, layers + 1)
    return SoundSpeedProfile(depths, surface + gradient * depths)


# --- constant gradient -------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(st.sampled_from([-0.05, -0.016, 1e-3, 0.016, 0.2]), angles, st.floats(100, 3900), st.integers(1, 7))
def test_a_constant_gradient_bends_rays_into_circles(gradient, angle, depth, layers):
    """Centre at the depth where c would be 0, radius 1/(p g); time (1/g) arcosh(1 + g² d²/(2 c1 c2))."""
    profile = linear(gradient, layers=layers)
    ray = trace_ray(profile, source_depth_m=depth, angle=angle, max_range_m=2000.0)
    free = np.array([event in ("surface", "bottom") for event in ray.events])
    end = ray.range_m[free.argmax()] if free.any() else 2000.0
    x = np.linspace(0, end, 30)
    z, c = ray.depth_at(x), profile.speed(ray.depth_at(x))
    radius = 1 / (ray.parameter * gradient)
    distance = np.hypot(x - radius * math.cos(angle), z + 1500 / gradient)
    np.testing.assert_allclose(distance, abs(radius), rtol=1e-9)
    chord2 = x**2 + (z - depth) ** 2
    exact = np.arccosh(1 + gradient**2 * chord2 / (2 * c[0] * c)) / abs(gradient)
    # The closed form itself loses digits at short times: arcosh near 1.
    np.testing.assert_allclose(ray.time_at(x), exact, rtol=1e-6, atol=1e-7 / abs(gradient) * 1e-3)


def test_the_turning_point_of_a_circle():
    profile = linear(0.016)
    angle = math.radians(80)
    ray = trace_ray(profile, source_depth_m=500.0, angle=angle, max_range_m=40_000.0)
    turn = ray.events.index("turn")
    c = 1508.0
    assert profile.speed(ray.depth_m[turn]) == pytest.approx(c / math.sin(angle), rel=1e-13)
    assert ray.depth_m[turn] == pytest.approx((c / math.sin(angle) - 1500) / 0.016, rel=1e-12)
    assert ray.range_m[turn] == pytest.approx(c / 0.016 / math.tan(angle), rel=1e-12)
    assert ray.angle_at(ray.range_m[turn]) == pytest.approx(math.pi / 2, abs=1e-7)


@pytest.mark.parametrize("gradient", [0.0, 1e-12, 1e-9, -1e-9])
def test_rays_are_straight_without_a_gradient(gradient):
    """Mirror images: unfolded at surface and bottom the ray is one line, its time length / c."""
    profile = linear(gradient, bottom=100.0)
    for degrees in (20.0, 60.0, 89.0, 100.0):
        angle = math.radians(degrees)
        ray = trace_ray(profile, source_depth_m=30.0, angle=angle, max_range_m=1000.0)
        x = np.linspace(0, 1000, 101)
        unfolded = 30.0 + x / math.tan(angle)
        np.testing.assert_allclose(
            ray.depth_at(x), np.abs((unfolded + 100) % 200 - 100), atol=1e-5 if gradient else 1e-9
        )
        np.testing.assert_allclose(ray.time_at(x), x / math.sin(angle) / 1500, rtol=1e-9)
        crossings = math.floor(30 / 100 + 1000 / math.tan(angle) / 100)
        assert ray.count("surface") + ray.count("bottom") == abs(crossings)


# --- layered water -----------------------------------------------------------------------------------------


def munk(depth):
    """The canonical deep sound channel (Munk, 1974): axis at 1300 m."""
    eta = 2 * (depth - 1300) / 1300
    return 1500 * (1 + 0.00737 * (eta + np.exp(-eta) - 1))


def munk_slope(depth):
    eta = 2 * (depth - 1300) / 1300
    return 1500 * 0.00737 * (1 - np.exp(-eta)) * 2 / 1300


def integrated_ray(depth, angle, distance):
    """Depth and time at ``distance`` by the ray's differential equations, not by Snell's law."""

    def slopes(_, state):
        _, z, theta, _ = state
        c = munk(z)
        # d(sin θ / c) = 0 along the path: dθ/ds = sin θ c'(z) / c.
        return [math.sin(theta), math.cos(theta), math.sin(theta) * munk_slope(z) / c, 1 / c]

    def arrived(_, state):
        return state[0] - distance

    arrived.terminal = True
    state = [0.0, depth, angle, 0.0]
    found = solve_ivp(
        slopes, (0, 3 * distance), state, events=arrived, rtol=1e-11, atol=1e-9, method="DOP853"
    )
    return found.y[1, -1], found.y[3, -1]


def errors_of_layers(launch_degrees, distance, layer_counts):
    """Root mean square errors of depth and time over a fan of rays, one row a number of layers."""
    fan = np.radians(launch_degrees)
    exact = np.array([integrated_ray(1000.0, angle, distance) for angle in fan])
    rows = []
    for layers in layer_counts:
        depths = np.linspace(0, 5000, layers + 1)
        profile = SoundSpeedProfile(depths, munk(depths))
        rays = [trace_ray(profile, source_depth_m=1000.0, angle=angle, max_range_m=distance) for angle in fan]
        found = np.array([[ray.depth_m[-1], ray.time_s[-1]] for ray in rays])
        rows.append(np.sqrt(np.mean((found - exact) ** 2, axis=0)))
    return np.array(rows), {ray.count("turn") for ray in rays}


def test_layers_converge_to_the_smooth_profile_in_second_order():
    errors, turns = errors_of_layers(np.linspace(60, 75, 4), 4000.0, (125, 250, 500, 1000))
    assert turns == {0}
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:])[1:], 2.0, atol=0.02)
    assert errors[-1, 0] < 1e-3 and errors[-1, 1] < 1e-6


def test_turning_points_cost_half_an_order():
    """How a turning point lies to the nodes changes its arc by h^(3/2), up and down: over 16-fold layers."""
    errors, turns = errors_of_layers(np.linspace(80, 86, 6), 30_000.0, (125, 2000))
    assert turns == {1}
    order = np.log2(errors[0] / errors[1]) / 4
    assert ((order > 1.25) & (order < 2.2)).all(), order
    assert errors[1, 0] < 0.05 and errors[1, 1] < 3e-6


depth_lists = st.lists(st.floats(20, 200), min_size=1, max_size=6)


@st.composite
def profiles(draw):
    thickness = draw(depth_lists)
    speeds = draw(st.lists(st.floats(1450, 1550), min_size=len(thickness) + 1, max_size=len(thickness) + 1))
    return SoundSpeedProfile(np.concatenate([[0.0], np.cumsum(thickness)]), speeds)


@settings(max_examples=150)
@given(profiles(), st.floats(0, 1), angles)
def test_snells_law_everywhere(profile, share, angle):
    source = share * profile.bottom_m
    ray = trace_ray(profile, source_depth_m=source, angle=angle, max_range_m=2000.0)
    assert ray.complete
    x = np.linspace(0, 2000, 200)
    z = ray.depth_at(x)
    assert (z >= -1e-6).all() and (z <= profile.bottom_m + 1e-6).all()
    sines = np.sin(ray.angle_at(x))
    np.testing.assert_allclose(sines / profile.speed(z), math.sin(angle) / profile.speed(source), rtol=1e-7)
    # Never faster than the fastest water, never slower than the slowest; and the clock never stands still.
    time = ray.time_at(x)
    assert (np.diff(time) > 0).all()
    length = np.hypot(np.diff(x), np.diff(z)).sum()
    assert time[-1] >= length / profile.speeds_m_s.max() * (1 - 1e-9)
    # Vertices and arcs agree.
    np.testing.assert_allclose(ray.depth_at(ray.range_m), ray.depth_m, atol=1e-6)
    np.testing.assert_allclose(ray.time_at(ray.range_m), ray.time_s, atol=1e-9)


@settings(max_examples=60)
@given(profiles(), st.floats(0.05, 0.95), angles)
def test_sound_goes_back_the_way_it_came(profile, share, angle):
    source = share * profile.bottom_m
    # Beside a level ray the way back hangs on the last digit of the angle.
    assume(abs(angle - math.pi / 2) > 0.05)
    there = trace_ray(profile, source_depth_m=source, angle=angle, max_range_m=1000.0)
    arrival = there.angle_at(1000.0)
    assume(abs(arrival - math.pi / 2) > 0.05)
    near = min(abs(1 / there.parameter - c) for c in profile.speeds_m_s)
    assume(near > 0.01)  # a ray that all but grazes a layer splits there
    back = trace_ray(
        profile,
        source_depth_m=min(max(there.depth_m[-1], 0), profile.bottom_m),
        angle=math.pi - arrival,
        max_range_m=1000.0,
    )
    assert back.depth_m[-1] == pytest.approx(source, abs=1e-4)
    assert back.time_s[-1] == pytest.approx(there.time_s[-1], rel=1e-8)


# --- level rays and ends -----------------------------------------------------------------------------------


def test_level_rays_turn_towards_slow_water_or_stay_on_an_axis():
    def depths(profile, source):
        ray = trace_ray(profile, source_depth_m=source, angle=math.pi / 2, max_range_m=2000.0)
        return ray.depth_at(np.linspace(1, 2000, 50)), ray

    assert (depths(linear(0.016), 500.0)[0] < 500).all()
    assert (depths(linear(-0.016), 500.0)[0] > 500).all()
    channel = SoundSpeedProfile([0, 100, 200], [1510, 1500, 1510])
    z, ray = depths(channel, 100.0)
    assert (z == 100).all() and ray.time_s[-1] == pytest.approx(2000 / 1500)
    crest = SoundSpeedProfile([0, 100, 200], [1500, 1510, 1500])
    assert (depths(crest, 100.0)[0] > 100).all()
    assert (depths(linear(0.0), 500.0)[0] == 500).all()
    assert (depths(linear(0.016), 0.0)[0] == 0).all()  # creeps along the surface
    assert (depths(linear(-0.016), 4000.0)[0] == 4000).all()  # and along the bottom


@pytest.mark.parametrize("offset", [1e-15, 1e-11, 1e-9, 1e-7, 1e-5])
@pytest.mark.parametrize("sign", [-1, 1])
def test_nearly_level_rays_are_nearly_level(offset, sign):
    profile = linear(0.016)
    ray = trace_ray(profile, source_depth_m=500.0, angle=math.pi / 2 + sign * offset, max_range_m=1000.0)
    straight = trace_ray(profile, source_depth_m=500.0, angle=math.pi / 2, max_range_m=1000.0)
    assert ray.depth_m[-1] == pytest.approx(straight.depth_m[-1], abs=1100 * offset + 1e-4)
    assert ray.time_s[-1] == pytest.approx(straight.time_s[-1], rel=1e-9 + 0.02 * offset)


def test_a_nearly_vertical_ray_takes_the_time_of_the_water_column():
    profile = SoundSpeedProfile([0, 100, 1000], [1520, 1500, 1530])
    ray = trace_ray(profile, source_depth_m=0.0, angle=1e-9, max_range_m=1e-3, bottom="absorb")
    assert ray.events[-1] == "bottom" and not ray.complete
    exact = 100 / -20 * math.log(1500 / 1520) + 900 / 30 * math.log(1530 / 1500)
    assert ray.time_s[-1] == pytest.approx(exact, rel=1e-13)


def test_a_ray_out_of_legs_says_so():
    ray = trace_ray(linear(0.0), source_depth_m=0.0, angle=1e-6, max_range_m=1e5, max_legs=7)
    assert not ray.complete and len(ray.cosines) == 7 and ray.range_m[-1] < 1e5
    with pytest.raises(InvalidParameterError, match="range_m"):
        ray.depth_at(1e5)


# --- the surface duct --------------------------------------------------------------------------------------


def test_the_mixed_layer_is_a_duct():
    """SPEC §3: about 40 m of mixed layer; pressure alone makes its speed rise by 0.016 1/s."""
    profile = SoundSpeedProfile.mixed_layer()
    assert profile.duct_depth() == 40.0
    assert profile.gradients[0] == pytest.approx(0.016)
    assert profile.speed(40.0) == sound_speed(20.0, 35.0, 40.0)
    assert profile.gradients[1] < -0.1 and profile.gradients[2] == pytest.approx(0.016)


@settings(max_examples=60)
@given(st.floats(0, 39.9), st.floats(0.02, 0.98), st.booleans())
def test_rays_within_the_limiting_angle_never_leave_the_duct(source, share, up):
    profile = SoundSpeedProfile.mixed_layer()
    limit = math.pi / 2 - profile.limiting_angle(source)

    def deepest(elevation):
        angle = math.pi / 2 + (elevation if up else -elevation)
        ray = trace_ray(profile, source_depth_m=source, angle=angle, max_range_m=30_000.0)
        return ray.depth_m.max()

    assert deepest(share * limit) < 40.0
    assert deepest(limit * (1 + 1e-6) + 1e-7) > 40.0
    assert deepest(limit / share) > 99.0  # through the thermocline, for good


def test_the_skip_of_the_limiting_ray():
    """Between two bounces at the surface: √(8 R H) with R = c/g, the usual approximation."""
    profile = SoundSpeedProfile.mixed_layer()
    angle = profile.limiting_angle(0.0) + 1e-9
    ray = trace_ray(profile, source_depth_m=0.0, angle=angle, max_range_m=20_000.0)
    bounces = ray.range_m[[event == "surface" for event in ray.events]]
    skip = np.diff(bounces)
    np.testing.assert_allclose(skip, math.sqrt(8 * 1521.52 / 0.016 * 40), rtol=1e-3)


def test_no_duct_traps_nothing():
    cooling = linear(-0.1)
    assert cooling.duct_depth() == 0.0
    assert cooling.limiting_angle(10.0) == math.pi / 2 and cooling.transition_range(10.0) == math.inf
    profile = SoundSpeedProfile.mixed_layer()
    assert profile.limiting_angle(60.0) == math.pi / 2
    assert linear(0.016).duct_depth() == 4000.0


def test_a_duct_is_filled_where_the_trapped_beam_meets_its_height():
    profile = SoundSpeedProfile.mixed_layer()
    elevation = math.pi / 2 - profile.limiting_angle(20.0)
    assert profile.transition_range(20.0) == pytest.approx(40 / (2 * math.sin(elevation)))
    assert 900 < profile.transition_range(20.0) < 1050


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: SoundSpeedProfile([10, 20], [1500, 1500]), "depths_m"),
        (lambda: SoundSpeedProfile([0, 20, 20], [1500] * 3), "rising depths"),
        (lambda: SoundSpeedProfile([0, 20], [1500, math.nan]), "speeds_m_s"),
        (lambda: SoundSpeedProfile([0, 20], [1500]), "one speed for each of 2"),
        (lambda: SoundSpeedProfile.mixed_layer(bottom_depth_m=50.0), "bottom_depth_m"),
        (lambda: linear(0.0).limiting_angle(5000.0), "source_depth_m"),
        (lambda: trace_ray(linear(0.0), source_depth_m=-1.0, angle=1.0, max_range_m=1.0), "source_depth_m"),
        (lambda: trace_ray(linear(0.0), source_depth_m=1.0, angle=0.0, max_range_m=1.0), "angle"),
        (lambda: trace_ray(linear(0.0), source_depth_m=1.0, angle=1.0, max_range_m=0.0), "max_range_m"),
        (
            lambda: trace_ray(linear(0.0), source_depth_m=1.0, angle=1.0, max_range_m=1.0, bottom="reflects"),
            "Did you mean 'reflect'",
        ),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

"""Formulas and random draws of currents against their definitions."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics import current_formulas as formulas


def divergence(field, frame=0):
    """Central differences of a field at its inner nodes, 1/s."""
    u, v = field.velocity[frame, ..., 0], field.velocity[frame, ..., 1]
    h = 2 * field.grid.spacing
    return (u[1:-1, 2:] - u[1:-1, :-2]) / h + (v[2:, 1:-1] - v[:-2, 1:-1]) / h


def shear(field, frame=0):
    """Greatest single derivative: the scale that a divergence is small against."""
    return np.abs(np.gradient(field.velocity[frame], field.grid.spacing, axis=(0, 1))).max()


@pytest.mark.parametrize("a, b", [(-0.4, 0.4), (0.3, -0.3), (0.0, 0.0), (0.5, -0.5), (-0.5, 0.25)])
def test_vortex_is_the_published_formula(a, b):
    field = formulas.published_vortex()
    assert field.velocity.shape == (1, 21, 21, 2)
    expected = (-a - 2 * b * a**2 + b, -a - b)
    np.testing.assert_allclose(field.sample(10_000 * a, 10_000 * b), expected, atol=1e-14)


def test_vortex_values_by_hand():
    # Start (-4000, 4000): u = 0.4 - 2·0.4·0.16 + 0.4, v = 0.4 - 0.4.
    np.testing.assert_allclose(formulas.published_vortex().sample(-4000, 4000), (0.672, 0.0), atol=1e-14)
    # Between nodes bilinear stays close to the formula: a² bends by 2·0.5·(0.05)²/4 at most.
    np.testing.assert_allclose(
        formulas.published_vortex().sample(1250, 4750),
        (-0.125 - 2 * 0.475 * 0.125**2 + 0.475, -0.6),
        atol=7e-4,
    )


def test_uniform_is_uniform():
    field = formulas.uniform(0.3, -0.2)
    points = np.random.default_rng(0).uniform(-9000, 9000, (2, 30))
    np.testing.assert_array_equal(field.sample(*points, 5e5), np.tile((0.3, -0.2), (30, 1)))


def test_double_gyre_follows_its_streamfunction():
    """u = -∂ψ/∂y, v = ∂ψ/∂x, differentiated numerically from Shadden's ψ."""
    speed, wobble, period, half = 0.6, 0.25, 20_000.0, 5000.0
    field = formulas.double_gyre(speed_m_s=speed, wobble=wobble, period_s=period, duration_s=18_000.0)

    def psi(x, y, t):
        across, along = x / half + 1, (y / half + 1) / 2
        e = wobble * np.sin(2 * np.pi * t / period)
        f = e * across**2 + (1 - 2 * e) * across
        return speed * half / np.pi * np.sin(np.pi * f) * np.sin(np.pi * along)

    side = field.velocity.shape[1]
    x, y = field.grid.nodes(side, side)
    for frame in (0, 3, 7):
        t = frame * field.time_step_s
        u = -(psi(x, y + 1.0, t) - psi(x, y - 1.0, t)) / 2.0
        v = (psi(x + 1.0, y, t) - psi(x - 1.0, y, t)) / 2.0
        np.testing.assert_allclose(field.velocity[frame], np.stack([u, v], -1), atol=1e-6)


def test_double_gyre_walls_speed_and_time():
    field = formulas.double_gyre(speed_m_s=0.6, wobble=0.3, period_s=14_400.0, duration_s=14_400.0)
    assert np.abs(field.velocity[:, :, [0, -1], 0]).max() < 1e-12, "flow through the west or east wall"
    assert np.abs(field.velocity[:, [0, -1], :, 1]).max() < 1e-12, "flow through the south or north wall"
    np.testing.assert_allclose(field.velocity[0], field.velocity[-1], atol=1e-12)
    steady = formulas.double_gyre(speed_m_s=0.6, wobble=0.0)
    assert len(steady.velocity) == 1
    assert np.hypot(*np.moveaxis(steady.velocity, -1, 0)).max() == pytest.approx(0.6, abs=1e-12)


@pytest.mark.parametrize("kind", ["double gyre", "random gyres"])
def test_divergence_vanishes_with_the_square_of_the_spacing(kind):
    def field(spacing):
        if kind == "double gyre":
            return formulas.double_gyre(spacing_m=spacing), 1
        rng = np.random.default_rng(5)
        return formulas.random_gyres(
            rng, spacing_m=spacing, turnover_s=86_400.0, duration_s=7200.0, mean_flow_m_s=0.2
        ), 1

    greatest = []
    for spacing in (200.0, 100.0, 50.0):
        made, frame = field(spacing)
        greatest.append(np.abs(divergence(made, frame)).max() / shear(made, frame))
    assert greatest[-1] < 2e-3
    order = np.log2(np.array(greatest[:-1]) / np.array(greatest[1:]))
    np.testing.assert_allclose(order, 2.0, atol=0.15)


def test_the_vortex_does_diverge_and_the_measure_sees_it():
    # ∂u/∂a + ∂v/∂b = -1 - 4ab - 1, per 10 km.
    field = formulas.published_vortex()
    x, y = field.grid.nodes(21, 21)
    expected = (-2 - 4 * x * y / 1e8) / 10_000
    np.testing.assert_allclose(divergence(field), expected[1:-1, 1:-1], atol=1e-12)


@pytest.mark.parametrize("minor, turn", [(0.2, 1), (-0.2, -1)])
def test_tide_is_an_ellipse_turned_the_right_way(minor, turn):
    angle = 0.7
    field = formulas.rotating_tide(
        major_m_s=0.5, minor_m_s=minor, orientation_rad=angle, period_s=40_000.0, duration_s=40_000.0
    )
    assert np.ptp(field.velocity, axis=(1, 2)).max() == 0, "not uniform in space"
    u, v = field.velocity[:, 0, 0].T
    along, across = np.cos(angle) * u + np.sin(angle) * v, -np.sin(angle) * u + np.cos(angle) * v
    np.testing.assert_allclose((along / 0.5) ** 2 + (across / minor) ** 2, 1.0, atol=1e-12)
    assert (np.sign(u[:-1] * v[1:] - v[:-1] * u[1:]) == turn).all()
    np.testing.assert_allclose((u[0], v[0]), (u[-1], v[-1]), atol=1e-12)
    # Linear between 48 frames a period: the chord sags by 1 - cos(π/48) at most.
    t = 12_345.0
    phase = 2 * np.pi * t / 40_000.0
    exact = 0.5 * np.cos(phase) * np.array([np.cos(angle), np.sin(angle)]) + minor * np.sin(phase) * np.array(
        [-np.sin(angle), np.cos(angle)]
    )
    np.testing.assert_allclose(field.sample(0, 0, t), exact, atol=0.5 * (1 - np.cos(np.pi / 48)) * 1.01)


def test_random_gyres_are_seeded():
    def draw(seed):
        return formulas.random_gyres(np.random.default_rng(seed)).velocity

    np.testing.assert_array_equal(draw(3), draw(3))
    assert np.abs(draw(3) - draw(4)).max() > 0.05


def test_random_gyres_have_the_stated_speed():
    """Over a box of many eddies the root-mean-square speed is the parameter; the mean flow adds itself."""
    ratios = []
    for seed in range(10):
        field = formulas.random_gyres(
            np.random.default_rng(seed), half_width_m=60_000.0, eddy_scale_m=2500.0, speed_m_s=0.4,
            mean_flow_m_s=0.0, spacing_m=700.0,
        )  # fmt: skip
        ratios.append(np.sqrt(np.mean(np.sum(field.velocity**2, -1))) / 0.4)
    np.testing.assert_allclose(ratios, 1.0, atol=0.06)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_random_gyres_mean_flow_is_bounded():
    flows = []
    for seed in range(40):
        field = formulas.random_gyres(np.random.default_rng(seed), speed_m_s=0.0, mean_flow_m_s=0.3)
        assert np.ptp(field.velocity, axis=(0, 1, 2)).max() < 1e-15
        flows.append(np.hypot(*field.velocity[0, 0, 0]))
    assert max(flows) <= 0.3 and max(flows) > 0.2 and min(flows) < 0.1


def test_frames_span_the_duration():
    steady = formulas.random_gyres(np.random.default_rng(0), duration_s=9e4)
    assert len(steady.velocity) == 1
    moving = formulas.random_gyres(np.random.default_rng(0), turnover_s=5e4, duration_s=9e4, time_step_s=7200)
    assert (len(moving.velocity) - 1) * moving.time_step_s == pytest.approx(9e4)
    assert moving.time_step_s <= 7200
    np.testing.assert_array_equal(moving.velocity[0], steady_of_same_draw(5e4))


def steady_of_same_draw(turnover):
    return formulas.random_gyres(np.random.default_rng(0), turnover_s=turnover, duration_s=0.0).velocity[0]


@pytest.mark.parametrize(
    "call",
    [
        lambda: formulas.double_gyre(wobble=0.7),
        lambda: formulas.double_gyre(period_s=0),
        lambda: formulas.rotating_tide(major_m_s=0.2, minor_m_s=0.3),
        lambda: formulas.rotating_tide(major_m_s=np.nan),
        lambda: formulas.random_gyres(np.random.default_rng(0), eddy_scale_m=0.0),
        lambda: formulas.random_gyres(np.random.default_rng(0), modes=0),
        lambda: formulas.random_gyres(np.random.default_rng(0), spacing_m=1e6),
        lambda: formulas.from_formula(lambda x, y, t: (x * np.nan, y), half_width_m=100.0, spacing_m=10.0),
    ],
)
def test_bad_numbers_are_refused(call):
    with pytest.raises(InvalidParameterError, match="got"):
        call()

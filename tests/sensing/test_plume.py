"""Fields of scalar sources: the published forms, their limits, and the plume of puffs against independent formulas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.randomness import seed_streams
from aquaquad_envs.sensing.plume import LEAST_M, sensor_reading, steady_field
from aquaquad_envs.sensing.plume_puffs import PuffTerms, folded, plume_concentration, scatter

coordinate = st.floats(-50.0, 50.0)


@settings(max_examples=60, deadline=None)
@given(coordinate, coordinate, coordinate, st.floats(0.1, 100.0))
def test_the_three_published_forms(x, y, z, strength):
    square = x * x + y * y + z * z
    if square < 1e-3:
        return
    place = np.array([x, y, z])
    angle = np.arctan2(z, np.hypot(x, y))
    assert steady_field("light", place, strength=strength) == pytest.approx(strength / square, rel=1e-12)
    assert steady_field("oriented-light", place, strength=strength) == pytest.approx(
        strength * abs(np.sin(angle)) / square, rel=1e-9, abs=1e-15
    )
    assert steady_field("rational", place, strength=strength, offset_m2=2.5) == pytest.approx(
        strength / (square + 2.5), rel=1e-12
    )


def test_forms_at_the_source_and_far_away():
    near = steady_field("light", np.array([[0, 0, 0], [LEAST_M / 2, 0, 0], [LEAST_M, 0, 0]]))
    assert (near == 1.0 / LEAST_M**2).all()
    # Level with a lamp, a vehicle that keeps its pitch sees nothing of it; above it, all.
    level, above = steady_field("oriented-light", np.array([[3.0, 4.0, 0.0], [0.0, 0.0, -5.0]]))
    assert level == 0.0 and above == pytest.approx(1 / 25)
    far = np.array([1e3, 2e3, 5.0])
    ratio = steady_field("rational", far) / steady_field("light", far)
    assert ratio == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(
    "values, name",
    [
        ({"kind": "sound"}, "kind"), ({"kind": "plume"}, "kind"), ({"strength": 0.0}, "strength"),
        ({"offset_m2": -1.0}, "offset_m2"), ({"places_m": np.zeros(2)}, "places_m"),
        ({"places_m": np.array([np.nan, 0, 0])}, "places_m"),
    ],
)  # fmt: skip
def test_what_is_no_field_is_refused_by_name(values, name):
    with pytest.raises(InvalidParameterError, match=name):
        steady_field(**{"kind": "light", "places_m": np.ones(3), **values})


def test_sensor_noise_is_uniform_within_its_per_cent_and_the_floor_hides_the_rest():
    state = seed_streams(4)[2].copy()
    values = np.array([sensor_reading(2.0, 0.05, 0.0, state) for _ in range(4000)])
    share = (values / 2.0 - 1.0) / 0.05
    assert np.abs(share).max() <= 1.0
    # Moments of a uniform draw, within four standard errors.
    assert abs(share.mean()) < 4 * np.sqrt(1 / 3 / 4000)
    assert abs((share**2).mean() - 1 / 3) < 4 * np.sqrt((1 / 5 - 1 / 9) / 4000)
    before = state.copy()
    assert sensor_reading(0.3, 0.0, 0.3, state) == 0.3 and sensor_reading(0.3, 0.0, 0.31, state) == 0.0
    assert (state == before).all(), "without noise nothing is drawn"


def terms(**values):
    return PuffTerms(
        **{
            "size": 256, "period": 1.0, "amount": 2.0, "first_spread2": 0.09, "growth": 0.02, "scatter": 0.01,
            "vertical_scatter": 0.001, "meander_std": 0.0, "meander_time": 30.0, "depth": 10.0, **values,
        }
    )  # fmt: skip


def test_puffs_are_the_sum_of_normal_densities_and_their_images():
    rng = np.random.default_rng(0)
    found = terms()
    puffs = np.column_stack(
        [rng.uniform(-4, 4, 40), rng.uniform(-4, 4, 40), rng.uniform(0, 10, 40), -rng.uniform(0, 90, 40)]
    )
    places = rng.uniform((-5, -5, 0), (5, 5, 10), (60, 3))
    wanted = np.zeros(60)
    for x, y, z, birth in puffs:
        spread2 = found.first_spread2 + found.growth * (5.0 - birth)
        for image in (z, -z, 2 * found.depth - z):
            square = ((places - (x, y, image)) ** 2).sum(-1)
            wanted += found.amount / (2 * np.pi * spread2) ** 1.5 * np.exp(-square / (2 * spread2))
    got = plume_concentration(found, puffs, places, 5.0)
    # What lies beyond 5.3 standard deviations of a puff is left out: 1e-6 of its peak.
    peak = found.amount / (2 * np.pi * found.first_spread2) ** 1.5
    np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-5 * peak)
    assert plume_concentration(found, puffs, np.array([1e4, 0, 5]), 5.0) == 0.0
    assert (plume_concentration(found, np.empty((0, 4)), places, 5.0) == 0.0).all()


def test_surface_and_bottom_keep_all_of_a_puff():
    found = terms()
    axis, cell = np.linspace(-8, 8, 65), 16 / 64
    depth = (np.arange(40) + 0.5) * 0.25
    places = np.stack(np.meshgrid(axis, axis, depth, indexing="ij"), -1)
    for z in (0.2, 5.0, 9.9):
        held = (
            plume_concentration(found, np.array([[0.0, 0.0, z, -60.0]]), places, 0.0).sum() * cell**2 * 0.25
        )
        assert held == pytest.approx(found.amount, rel=1e-3)


def test_dense_puffs_in_a_steady_current_make_the_gaussian_plume():
    """C = Q / (4 π K r) exp(-U (r - x) / 2K), the exact plume of a point source."""
    speed, diffusivity, rate = 0.2, 0.01, 1.5
    period = 0.5
    found = terms(amount=rate * period, first_spread2=1e-3, growth=2 * diffusivity, depth=1e3)
    ages = (np.arange(4000) + 0.5) * period
    puffs = np.column_stack([speed * ages, 0 * ages, 0 * ages + 500.0, -ages])
    places = np.array([[x, y, z] for x in (5.0, 20.0, 60.0) for y in (0.0, 0.8, -1.5) for z in (0.0, 0.7)])
    r = np.linalg.norm(places, axis=1)
    wanted = rate / (4 * np.pi * diffusivity * r) * np.exp(-speed * (r - places[:, 0]) / (2 * diffusivity))
    got = plume_concentration(found, puffs, places + np.array([0, 0, 500.0]), 0.0)
    # The width of a new puff is what sets them apart: σ₀² against 2 K t of the nearest place.
    np.testing.assert_allclose(got, wanted, rtol=0.02, atol=2e-6 * wanted.max())


@pytest.mark.parametrize(
    "puffs, places",
    [(np.zeros((3, 3)), np.zeros(3)), (np.full((1, 4), np.inf), np.zeros(3)), (np.zeros((1, 4)), np.zeros(2)),
     (np.array([[0, 0, 0, 1.0]]), np.zeros(3))],
)  # fmt: skip
def test_what_is_no_plume_is_refused(puffs, places):
    with pytest.raises(InvalidParameterError):
        plume_concentration(terms(), puffs, places, 0.0)


def test_dispersion_has_its_variance_and_stays_in_the_water():
    state = seed_streams(1)[1].copy()
    found, dt = terms(scatter=0.02, vertical_scatter=0.005), 2.0
    ends = np.array([scatter(1.0, -2.0, 5.0, dt, found, state) for _ in range(6000)]) - (1.0, -2.0, 5.0)
    wanted = 2 * dt * np.array([0.02, 0.02, 0.005])
    np.testing.assert_allclose(ends.mean(0), 0.0, atol=4 * np.sqrt(wanted.max() / 6000))
    np.testing.assert_allclose(ends.var(0), wanted, rtol=0.06)
    assert np.abs(np.corrcoef(ends.T) - np.eye(3)).max() < 0.06
    shallow = found._replace(depth=0.1)
    assert all(0.0 <= scatter(0.0, 0.0, 0.05, 5.0, shallow, state)[2] <= 0.1 for _ in range(300))


@settings(max_examples=50, deadline=None)
@given(st.floats(-9.9, 19.9))
def test_depths_are_reflected(z):
    wanted = abs(z) if abs(z) <= 10 else 20 - abs(z)
    assert folded(z, 10.0) == pytest.approx(wanted)

"""The quadratic fit: against NumPy, exact where it can be, and on readings that cannot carry it."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation import quadratic_fit
from aquaquad_envs.estimation.quadratic_fit import METHODS, fit_quadratics

SEEDS = st.integers(0, 2**32 - 1)


def design(offsets, axes=(0, 1, 2)):
    """D of the SPEC, column by column: 1, lines, then products in the order xx, xy, xz, yy, yz, zz."""
    columns = [np.ones(len(offsets)), *(offsets[:, a] for a in axes)]
    for k, a in enumerate(axes):
        for b in axes[k:]:
            columns.append(offsets[:, a] * offsets[:, b] * (0.5 if a == b else 1.0))
    return np.stack(columns, axis=1)


def readings(seed, count=20, dimensions=3, spread=5.0):
    rng = np.random.default_rng(seed)
    points = np.zeros((count, 3))
    points[:, :dimensions] = spread * rng.normal(size=(count, dimensions))
    return rng, points + 10.0 * rng.normal(size=3)


def hessian_of(rng, least=0.5):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn @ np.diag(rng.uniform(least, 3.0, 3)) @ turn.T


def one(points, values, centre, **options):
    """A fit of one data set, and its numbers without the axis of the batch."""
    made = fit_quadratics(points[None], values[None], centre[None], **options)
    return {name: getattr(made, name)[0] for name in made.__dataclass_fields__}


@pytest.mark.parametrize("method", METHODS)
@given(seed=SEEDS, count=st.integers(10, 20))
@settings(max_examples=25, deadline=None)
def test_a_quadratic_field_is_found_in_one_step(method, seed, count):
    rng, points = readings(seed, count)
    source, hessian = points.mean(axis=0) + rng.normal(size=3), hessian_of(rng)
    away = points - source
    values = 7.0 + 0.5 * np.einsum("ni,ij,nj->n", away, hessian, away)
    made = one(points, values, points[0], method=method, condition_limit=1e12)
    tolerance = 1e-12 * made["condition"]
    np.testing.assert_allclose(points[0] + made["step"], source, atol=50 * tolerance)
    np.testing.assert_allclose(made["hessian"], hessian, atol=20 * tolerance)
    assert made["value"] == pytest.approx(values[0], abs=200 * tolerance) and made["axes"].all()


@pytest.mark.parametrize("method", ("qr", "svd"))
@given(seed=SEEDS, count=st.integers(10, 24), horizontal=st.booleans())
@settings(max_examples=25, deadline=None)
def test_least_squares_and_condition_are_numpys(method, seed, count, horizontal):
    rng, points = readings(seed, count)
    values, centre = rng.normal(size=count), points[0]
    axes = (0, 1) if horizontal else (0, 1, 2)
    made = one(points, values, centre, method=method, horizontal=horizontal, condition_limit=1e12)
    offsets = points - centre
    length = np.sqrt((offsets[:, list(axes)] ** 2).sum(axis=1).mean())
    scaled = design(offsets / length, axes)
    assert made["condition"] == pytest.approx(np.linalg.cond(scaled), rel=1e-9 * made["condition"])
    right = np.linalg.lstsq(scaled, values, rcond=None)[0]
    lines = len(axes)
    near = dict(atol=1e-13 * made["condition"] * np.abs(right).max(), rtol=1e-9)
    np.testing.assert_allclose(made["value"], right[0], **near)
    np.testing.assert_allclose(made["gradient"][:lines] * length, right[1 : lines + 1], **near)
    rows, columns = np.triu_indices(lines)
    np.testing.assert_allclose(made["hessian"][rows, columns] * length**2, right[lines + 1 :], **near)
    if horizontal:
        assert made["gradient"][2] == made["step"][2] == 0.0 and not made["hessian"][2].any()


@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_total_least_squares_is_the_published_formula(seed):
    rng, points = readings(seed)
    values = np.sum((points - points.mean(axis=0)) ** 2, axis=1) + rng.normal(size=20)
    made = one(points, values, points[0], method="tls", condition_limit=1e12)
    offsets = points - points[0]
    length, unit = np.sqrt((offsets**2).sum(axis=1).mean()), values.std()
    d, f = design(offsets / length), (values - values.mean()) / unit
    least = np.linalg.svd(np.column_stack([d, f]), compute_uv=False)[-1]
    right = np.linalg.solve(d.T @ d - least**2 * np.eye(10), d.T @ f)
    np.testing.assert_allclose(made["gradient"] * length / unit, right[1:4], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(made["value"], right[0] * unit + values.mean(), rtol=1e-6, atol=1e-6 * unit)


@given(seed=SEEDS, metres=st.floats(1e-3, 1e4), volts=st.floats(1e-6, 1e6))
@settings(max_examples=25, deadline=None)
def test_units_do_not_matter(seed, metres, volts):
    rng, points = readings(seed)
    values = np.sum(points**2, axis=1) + 5.0 * rng.normal(size=20)
    for method in METHODS:
        plain = one(points, values, points[3], method=method)
        scaled = one(metres * points, volts * values, metres * points[3], method=method, least_curvature=0.0)
        assert scaled["condition"] == pytest.approx(plain["condition"], rel=1e-6)
        size = np.abs(plain["step"]).max()
        np.testing.assert_allclose(scaled["step"] / metres, plain["step"], rtol=1e-5, atol=1e-5 * size)


@pytest.mark.parametrize("method", METHODS)
def test_readings_at_one_depth_give_the_plane(method):
    rng, points = readings(1, dimensions=2)
    source = points.mean(axis=0)
    values = np.sum((points - source) ** 2, axis=1)
    made = one(points, values, points[0], method=method)
    assert made["axes"].tolist() == [True, True, False] and made["condition"] < 1e3
    np.testing.assert_allclose(made["step"], (source - points[0]) * [1, 1, 0], atol=1e-10)
    # Nearly so: below the limit space is kept, above it not.
    points[:, 2] += 0.01 * rng.normal(size=20)
    assert not one(points, values, points[0], method=method, condition_limit=1e3)["axes"][2]
    assert one(points, values, points[0], method=method, condition_limit=1e9)["axes"][2]


def test_total_least_squares_finds_which_plane():
    for gone in range(3):
        _, points = readings(2)
        points[:, gone] = 4.0
        source = points.mean(axis=0)
        values = np.sum((points - source) ** 2, axis=1)
        made = one(points, values, points[0], method="tls")
        assert made["axes"].tolist() == [axis != gone for axis in range(3)]
        np.testing.assert_allclose(points[0] + made["step"], source, atol=1e-9)


def test_total_least_squares_takes_any_plane_down_to_what_it_carries():
    rng, points = readings(3, dimensions=2)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = points @ turn.T
    values = np.sum((points - points.mean(axis=0)) ** 2, axis=1)
    made = one(points, values, points[0], method="tls")
    assert made["axes"].sum() == 2 and made["condition"] < quadratic_fit.CONDITION_LIMIT
    # The rest is exact: the field is quadratic in any two coordinates of its plane.
    better = points[0] + made["step"]
    kept = made["axes"]
    np.testing.assert_allclose(better[kept], points.mean(axis=0)[kept], atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_readings_on_a_line(method):
    along = np.linspace(-3.0, 4.0, 15)[:, None]
    points = along * np.array([1.0, 0.0, 0.0]) + [5.0, 2.0, 1.0]
    values = 3.0 * (points[:, 0] - 4.0) ** 2
    made = one(points, values, points[0], method=method)
    assert np.isfinite(made["step"]).all()
    if method == "tls":
        assert made["axes"].tolist() == [True, False, False] and made["condition"] < 1e3
        np.testing.assert_allclose(made["step"], [4.0 - points[0, 0], 0.0, 0.0], atol=1e-10)
    else:  # a plane that the line cannot carry: the condition number says so
        assert made["condition"] > 1e12 and made["axes"].tolist() == [True, True, False]
    if method == "svd":  # the solution of least norm stays on the line
        np.testing.assert_allclose(made["step"], [4.0 - points[0, 0], 0.0, 0.0], atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_readings_at_one_place(method):
    points = np.tile([1.0, 2.0, 3.0], (12, 1))
    values = 5.0 + 0.1 * np.arange(12)
    made = one(points, values, points[0], method=method)
    assert made["value"] == pytest.approx(values.mean()) and not made["step"].any()
    assert made["condition"] == np.inf if method != "tls" else not made["axes"].any()
    # The same one step away has no direction either, but must not become NaN.
    away = one(points, values, points[0] + 1.0, method=method)
    assert np.isfinite(away["step"]).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count, dimensions", [(0, 0), (1, 0), (5, 0), (6, 2), (9, 2), (10, 3), (20, 3)])
def test_fewer_readings_carry_fewer_dimensions(method, count, dimensions):
    _, points = readings(5)
    values = np.sum((points - points[7]) ** 2, axis=1)
    made = one(points, values, points[0], method=method, counts=[count], condition_limit=1e9)
    assert made["axes"].sum() == dimensions and np.isfinite(made["step"]).all()
    if count == 0:
        assert made["condition"] == np.inf and made["value"] == 0.0
    elif dimensions == 0:
        assert made["value"] == pytest.approx(values[:count].mean()) and not made["step"].any()
    if dimensions == 3:
        np.testing.assert_allclose(points[0] + made["step"], points[7], atol=1e-6)


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_the_step_goes_down_whatever_the_curvature(seed):
    rng, points = readings(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    curvatures = rng.uniform(-3.0, 3.0, 3)
    hessian, gradient = turn @ np.diag(curvatures) @ turn.T, rng.normal(size=3)
    away = points - points[0]
    values = away @ gradient + 0.5 * np.einsum("ni,ij,nj->n", away, hessian, away)
    step = one(points, values, points[0], condition_limit=1e9)["step"]
    assert gradient @ step < 0
    expected = -turn @ (turn.T @ gradient / np.abs(curvatures))
    np.testing.assert_allclose(step, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_a_flat_field_keeps_still_and_a_slope_goes_straight_down():
    _, points = readings(8)
    assert not one(points, np.full(20, 3.0), points[0])["step"].any()
    slope = np.array([1.0, -2.0, 0.5])
    step = one(points, points @ slope, points[0])["step"]
    assert step @ slope < 0 and np.isfinite(step).all()


def test_a_fit_does_not_depend_on_its_neighbours():
    rng = np.random.default_rng(9)
    points, values = rng.normal(size=(7, 20, 3)), rng.normal(size=(7, 20))
    counts = np.array([20, 10, 6, 0, 13, 3, 20])
    for method in METHODS:
        together = fit_quadratics(points, values, points[:, 0], counts=counts, method=method)
        for k in range(7):
            alone = one(points[k], values[k], points[k, 0], counts=counts[k : k + 1], method=method)
            for name, value in alone.items():
                np.testing.assert_array_equal(value, getattr(together, name)[k])


_ELSEWHERE = """
import numpy as np
from aquaquad_envs.estimation import quadratic_fit
rng = np.random.default_rng(4)
points, values = rng.normal(size=(3, 20, 3)), rng.normal(size=(3, 20))
made = quadratic_fit.fit_quadratics(points, values, points[:, 0])
print(sum(quadratic_fit._fit_all.stats.cache_hits.values()), made.step.tobytes().hex())
"""


def test_compiled_fits_are_read_from_the_cache_by_another_process():
    """Where LAPACK lies differs between processes; machine code kept on disk must not remember it."""
    rng = np.random.default_rng(4)
    points, values = rng.normal(size=(3, 20, 3)), rng.normal(size=(3, 20))
    here = fit_quadratics(points, values, points[:, 0])
    said = subprocess.run(
        [sys.executable, "-c", _ELSEWHERE], capture_output=True, text=True, check=True, timeout=120
    ).stdout.split()
    assert int(said[0]) == 1 and said[1] == here.step.tobytes().hex()


@pytest.mark.parametrize(
    "change, named",
    [
        ({"method": "rq"}, "method: got 'rq', expected one of qr, svd, tls"),
        ({"condition_limit": 1.0}, "condition_limit: got 1.0"),
        ({"least_curvature": -1.0}, "least_curvature: got -1.0"),
        ({"counts": [21]}, "counts"),
        ({"counts": [1.5]}, "counts"),
        ({"points": np.zeros((1, 19, 3))}, "points"),
        ({"values": np.full((1, 20), np.nan)}, "values"),
        ({"centres": np.zeros((2, 3))}, "centres"),
    ],
)
def test_wrong_input_is_named(change, named):
    given_ = {"points": np.zeros((1, 20, 3)), "values": np.zeros((1, 20)), "centres": np.zeros((1, 3))}
    with pytest.raises(InvalidParameterError, match=named):
        fit_quadratics(**{**given_, **change})

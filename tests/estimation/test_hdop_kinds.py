"""HDOP and Cramér–Rao ellipses of bearing, range and TDOA against numpy, closed forms, bounds and samples."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.hdop import (
    SCALE_95,
    all_pairs,
    bearing_hdop,
    cramer_rao_ellipse,
    even_spread_hdop,
    hdop,
    two_sensor_hdop,
)

KINDS = ["bearing", "range", "tdoa"]
coordinate = st.floats(-5000, 5000)
points = st.tuples(coordinate, coordinate)
deviation = st.floats(1e-3, 10)


def jacobian(kind, sensors, target, pairs=None, c=1500.0):
    """Rows of SPEC §5."""
    d = np.asarray(target, float) - np.asarray(sensors, float)
    r = np.hypot(*d.T)[:, None]
    if kind == "bearing":
        return np.stack([-d[:, 1], d[:, 0]], -1) / r**2
    if kind == "range":
        return d / r
    pairs = all_pairs(len(sensors)) if pairs is None else np.asarray(pairs)
    return ((d / r)[pairs[:, 0]] - (d / r)[pairs[:, 1]]) / c


def clear_of(sensors, target, least=1.0):
    return min(np.hypot(*(np.array(target) - s)) for s in sensors) > least


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=100)
@given(st.lists(points, min_size=2, max_size=6), points, st.integers(0, 2**32 - 1), st.booleans())
def test_agrees_with_the_inverse(kind, sensors, target, seed, weighted):
    assume(clear_of(sensors, target))
    h = jacobian(kind, sensors, target)
    stds = np.random.default_rng(seed).uniform(0.1, 2, len(h)) if weighted else np.ones(len(h))
    j = (h / stds[:, None]).T @ (h / stds[:, None])
    assume(np.linalg.cond(j) < 1e6)
    expected = np.sqrt(np.trace(np.linalg.inv(j)))
    given_stds = stds if weighted else None
    assert hdop(kind, sensors, target, stds=given_stds) == pytest.approx(expected, rel=1e-6)
    ellipse = cramer_rao_ellipse(kind, sensors, target, stds=given_stds, scale=1.0)
    assert np.hypot(ellipse.semi_major_m, ellipse.semi_minor_m) == pytest.approx(expected, rel=1e-6)
    values, vectors = np.linalg.eigh(np.linalg.inv(j))
    assert ellipse.semi_major_m == pytest.approx(np.sqrt(values[1]), rel=1e-6)
    assert ellipse.semi_minor_m == pytest.approx(np.sqrt(values[0]), rel=1e-6)
    if values[1] > 1.01 * values[0]:
        along = vectors[:, 1] @ [np.cos(ellipse.angle), np.sin(ellipse.angle)]
        assert abs(along) == pytest.approx(1, abs=1e-6)


@settings(max_examples=100)
@given(st.lists(points, min_size=1, max_size=5), points, points)
def test_bearings_agree_with_the_kernel_of_the_drift_world(sensors, first, target):
    assume(clear_of([first, *sensors], target, 1e-3))
    assume(np.linalg.cond(jacobian("bearing", [*sensors, first], target)) < 1e4)
    kernel = bearing_hdop(*first, np.array(sensors), *target)
    assert hdop("bearing", [*sensors, first], target) == pytest.approx(kernel, rel=1e-7)


@pytest.mark.parametrize("kind", ["bearing", "range"])
@settings(max_examples=100)
@given(points, points, points)
def test_closed_forms_of_two_sensors(kind, first, second, target):
    assume(clear_of([first, second], target))
    closed = two_sensor_hdop(kind, [first, second], target)
    general = hdop(kind, [first, second], target)
    if closed < np.inf and np.linalg.cond(jacobian(kind, [first, second], target)) < 1e3:
        assert general == pytest.approx(float(closed), rel=1e-6)
    # But for rounding.
    assert closed >= (np.sqrt(2) * (1.0 - 1e-12) if kind == "range" else 0.0)


def test_two_sensors_by_hand():
    assert two_sensor_hdop("bearing", [(300.0, 0.0), (0.0, 400.0)], (0.0, 0.0)) == pytest.approx(500.0)
    assert two_sensor_hdop("range", [(300.0, 0.0), (0.0, 400.0)], (0.0, 0.0)) == pytest.approx(np.sqrt(2))
    # 30 degrees between the arms: sin φ = 1/2.
    arm = 100 * np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    assert two_sensor_hdop("range", [(100.0, 0.0), arm], (0.0, 0.0)) == pytest.approx(2 * np.sqrt(2))
    assert np.isinf(two_sensor_hdop("bearing", [(1.0, 1.0), (-2.0, -2.0)], (0.0, 0.0)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", range(3, 9))
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_even_spread_reaches_the_bound(kind, count, turn):
    """SPEC §5: range 2/√N, bearing 2r/√N; TDOA over all pairs 2c/N."""
    angle = turn + 2 * np.pi * np.arange(count) / count
    sensors = np.array([300.0, -200.0]) + 1234.0 * np.stack([np.cos(angle), np.sin(angle)], -1)
    value = hdop(kind, sensors, (300.0, -200.0), sound_speed_m_s=1480.0)
    expected = even_spread_hdop(kind, count, range_m=1234.0, sound_speed_m_s=1480.0)
    assert value == pytest.approx(expected, rel=1e-12)
    ellipse = cramer_rao_ellipse(kind, sensors, (300.0, -200.0))
    assert ellipse.semi_major_m == pytest.approx(ellipse.semi_minor_m, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=100)
@given(st.lists(st.floats(0, 6.28), min_size=3, max_size=8))
def test_no_arrangement_on_the_circle_beats_even_spread(kind, angles):
    sensors = 800.0 * np.stack([np.cos(angles), np.sin(angles)], -1)
    bound = even_spread_hdop(kind, len(angles), range_m=800.0)
    assert hdop(kind, sensors, (0.0, 0.0)) >= bound * (1 - 1e-9)


@pytest.mark.parametrize("kind, power", [("range", 0), ("tdoa", 0), ("bearing", 1)])
def test_how_hdop_grows_with_the_distance(kind, power):
    """Scaling the scene by 10: bearing HDOP grows tenfold, range and TDOA HDOP stay (erratum of the thesis)."""
    sensors = np.array([(1000.0, 100.0), (-600.0, 700.0), (-300.0, -900.0)])
    near, far = hdop(kind, sensors, (10.0, 20.0)), hdop(kind, 10 * sensors, (100.0, 200.0))
    assert far == pytest.approx(near * 10**power, rel=1e-9)


def test_tdoa_pairs():
    """The published set is all pairs of three; a closed loop knows nothing that two of its pairs do not."""
    sensors = [(1000.0, 0.0), (-500.0, 800.0), (-500.0, -700.0)]
    published = hdop("tdoa", sensors, (50.0, 30.0), pairs=[(0, 1), (1, 2), (0, 2)])
    assert published == pytest.approx(float(hdop("tdoa", sensors, (50.0, 30.0))), rel=1e-12)
    two = hdop("tdoa", sensors, (50.0, 30.0), pairs=[(0, 1), (0, 2)])
    assert np.isfinite(two) and two > published
    assert np.isinf(hdop("tdoa", sensors, (50.0, 30.0), pairs=[(0, 1), (1, 0)]))


@pytest.mark.parametrize(
    "kind, sensors",
    [
        ("bearing", [(1000.0, 0.0)]),
        ("range", [(1000.0, 0.0)]),
        ("tdoa", [(1000.0, 0.0)]),
        ("tdoa", [(1000.0, 0.0), (0.0, 500.0)]),
        ("tdoa", [(1000.0, 0.0), (2000.0, 0.0), (-500.0, 0.0)]),
        ("tdoa", [(100.0, 100.0), (200.0, 200.0), (300.0, 300.0)]),
        ("range", [(1000.0, 1000.0), (-700.0, -700.0), (3.0, 3.0)]),
        ("bearing", [(1.0, 3.0), (-2.0, -6.0)]),
        ("bearing", [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)]),
        ("range", [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)]),
        ("tdoa", [(100.0, 20.0), (0.0, 100.0), (-50.0, -50.0), (0.0, 0.0)]),
        ("bearing", [(1e-160, 0.0), (100.0, 0.0), (0.0, 100.0)]),
    ],
)
@pytest.mark.parametrize("stds", [None, 0.5])
def test_singular_geometry_is_infinite(kind, sensors, stds):
    value = hdop(kind, sensors, (0.0, 0.0), stds=stds)
    ellipse = cramer_rao_ellipse(kind, sensors, (0.0, 0.0), stds=stds)
    on_target = any(np.hypot(*s) < 1e-100 for s in sensors)
    assert np.isinf(value)
    assert not np.isnan(ellipse).any()
    assert np.isinf(ellipse.semi_major_m) or on_target


def test_one_range_measures_along_its_arm():
    ellipse = cramer_rao_ellipse("range", [(300.0, 400.0)], (0.0, 0.0), stds=2.0, scale=1.0)
    assert ellipse.semi_major_m == np.inf and ellipse.semi_minor_m == pytest.approx(2.0)
    assert np.tan(ellipse.angle) == pytest.approx(-300 / 400)


@pytest.mark.parametrize("kind", KINDS)
def test_least_squares_errors_fill_the_ellipse(kind):
    """95 % of linear least squares estimates of noisy measurements lie within the 95 % ellipse."""
    sensors, target = [(900.0, 50.0), (-200.0, 800.0), (-450.0, -600.0)], (40.0, -70.0)
    std = {"bearing": 0.01, "range": 4.0, "tdoa": 2e-3}[kind]
    h = jacobian(kind, sensors, target)
    noise = std * np.random.default_rng(0).standard_normal((20_000, len(h)))
    x, y = np.linalg.pinv(h) @ noise.T
    ellipse = cramer_rao_ellipse(kind, sensors, target, stds=std)
    c, s = np.cos(ellipse.angle), np.sin(ellipse.angle)
    inside = ((c * x + s * y) / ellipse.semi_major_m) ** 2 + ((c * y - s * x) / ellipse.semi_minor_m) ** 2 < 1
    assert pytest.approx(2.4477, abs=1e-4) == SCALE_95
    assert inside.mean() == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 20_000))
    rms = np.sqrt((x**2 + y**2).mean())
    assert hdop(kind, sensors, target, stds=std) == pytest.approx(rms, rel=0.03)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40)
@given(st.lists(points, min_size=3, max_size=5), points, st.floats(0, 6.28), points)
def test_turning_and_moving_everything_changes_nothing(kind, sensors, target, angle, shift):
    assume(clear_of(sensors, target))
    assume(np.linalg.cond(jacobian(kind, sensors, target)) < 1e3)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = np.array([turn @ s + shift for s in sensors])
    here = hdop(kind, sensors, target)
    assert hdop(kind, moved, turn @ target + shift) == pytest.approx(float(here), rel=1e-5)


def test_maps():
    sensors = [(900.0, 50.0), (-200.0, 800.0), (-450.0, -600.0)]
    targets = np.random.default_rng(0).uniform(-2000, 2000, (4, 5, 2))
    whole = hdop("tdoa", sensors, targets)
    assert whole.shape == (4, 5)
    assert whole[2, 3] == hdop("tdoa", sensors, targets[2, 3])


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: hdop("sonar", [(1, 2)], (0, 0)), "kind: got 'sonar'"),
        (lambda: hdop("range", [1, 2], (0, 0)), "sensors"),
        (lambda: hdop("range", [(1, np.nan)], (0, 0)), "sensors"),
        (lambda: hdop("range", [(1, 2)], (0, 0, 0)), "targets"),
        (lambda: hdop("range", [(1, 2)], (0, 0), pairs=[(0, 0)]), "pairs"),
        (lambda: hdop("tdoa", [(1, 2), (3, 4)], (0, 0), pairs=[(0, 2)]), "pairs"),
        (lambda: hdop("range", [(1, 2)], (0, 0), stds=0.0), "stds: got 0.0"),
        (lambda: hdop("range", [(1, 2)], (0, 0), stds=[1, 2]), "stds"),
        (lambda: hdop("tdoa", [(1, 2)], (0, 0), sound_speed_m_s=0.0), "sound_speed_m_s: got 0.0"),
        (lambda: cramer_rao_ellipse("range", [(1, 2)], (0, 0), scale=0.0), "scale: got 0.0"),
        (lambda: two_sensor_hdop("tdoa", [(1, 2), (3, 4)], (0, 0)), "kind: got 'tdoa'"),
        (lambda: two_sensor_hdop("range", [(1, 2)], (0, 0)), "sensors"),
        (lambda: even_spread_hdop("range", 2), "count: got 2"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()


@pytest.mark.parametrize("turn", np.linspace(0, np.pi, 9))
def test_tdoa_of_two_directions_is_singular_however_they_lie(turn):
    """Two of three sensors in one direction: every difference of unit vectors is along one line, or zero."""
    rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sensors = np.array([[-2500.0, 2500.0], [2500.0, 2500.0], [3000 / np.sqrt(2), 3000 / np.sqrt(2)]])
    assert np.isinf(hdop("tdoa", sensors @ rotate.T, np.zeros((1, 2)))).all()

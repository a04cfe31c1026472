"""Bearing HDOP against numpy's inverse, closed forms, bounds and symmetries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.estimation.hdop import bearing_hdop

coordinate = st.floats(-5000, 5000)
points = st.tuples(coordinate, coordinate)


def golden(sensors, target):
    """sqrt(trace((HᵀH)⁻¹)) by numpy, and the condition of HᵀH."""
    d = np.asarray(target) - np.asarray(sensors)
    r2 = (d**2).sum(1, keepdims=True)
    h = np.stack([-d[:, 1], d[:, 0]], -1) / r2
    return np.sqrt(np.trace(np.linalg.inv(h.T @ h))), np.linalg.cond(h.T @ h)


def ours(sensors, target):
    return bearing_hdop(
        *map(float, sensors[0]), np.array(sensors[1:], dtype=float).reshape(-1, 2), *map(float, target)
    )


@settings(max_examples=100)
@given(st.lists(points, min_size=2, max_size=8), points)
def test_agrees_with_the_inverse(sensors, target):
    if min(np.hypot(*(np.array(target) - s)) for s in sensors) < 1.0:
        return
    with np.errstate(all="ignore"):
        try:
            expected, condition = golden(sensors, target)
        except np.linalg.LinAlgError:
            return
    if condition < 1e6:
        assert ours(sensors, target) == pytest.approx(expected, rel=1e-6)


@settings(max_examples=100)
@given(st.lists(points, min_size=1, max_size=6), points)
def test_never_nan_and_never_below_the_bound(sensors, target):
    """trace(HᵀH) = Σ 1/r², and of all matrices of that trace the even one has the least HDOP, 2/√Σ."""
    value = ours(sensors, target)
    assert not np.isnan(value) and value > 0
    r2 = ((np.array(sensors) - target) ** 2).sum(1)
    if np.isfinite(value):
        assert value >= 2 / np.sqrt((1 / r2).sum()) * (1 - 1e-9)


@pytest.mark.parametrize("count", range(3, 9))
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_even_spread_reaches_the_bound(count, turn):
    """N sensors evenly about the target at range r: 2 r / √N (SPEC §5)."""
    angle = turn + 2 * np.pi * np.arange(count) / count
    sensors = np.array([300.0, -200.0]) + 1234.0 * np.stack([np.cos(angle), np.sin(angle)], -1)
    assert ours(sensors, (300.0, -200.0)) == pytest.approx(2 * 1234.0 / np.sqrt(count), rel=1e-12)


def test_two_sensors_in_closed_form():
    # Right angle at ranges r1, r2: HᵀH = diag(1/r2², 1/r1²).
    assert ours([(300.0, 0.0), (0.0, 400.0)], (0.0, 0.0)) == pytest.approx(500.0)


@pytest.mark.parametrize(
    "sensors",
    [
        [(1000.0, 0.0)],
        [(1000.0, 0.0), (-3000.0, 0.0), (200.0, 0.0)],
        [(0.0, 50.0), (0.0, -70.0)],
        [(1000.0, 1000.0), (-700.0, -700.0), (3.0, 3.0)],
        [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)],
        [(1e-100, 0.0), (100.0, 0.0), (0.0, 100.0)],
    ],
    ids=["one", "horizontal", "vertical", "diagonal", "on the target", "all but on the target"],
)
def test_singular_geometry_is_infinite(sensors):
    assert ours(sensors, (0.0, 0.0)) == np.inf


@settings(max_examples=40)
@given(st.lists(points, min_size=3, max_size=5), points, st.floats(0, 2 * np.pi), points)
def test_turning_and_moving_everything_changes_nothing(sensors, target, angle, shift):
    if min(np.hypot(*(np.array(target) - s)) for s in sensors) < 1.0:
        return
    with np.errstate(all="ignore"):
        try:
            condition = golden(sensors, target)[1]
        except np.linalg.LinAlgError:
            return
    if not condition < 1e6:
        return
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = [turn @ s + shift for s in sensors]
    assert ours(moved, turn @ target + shift) == pytest.approx(ours(sensors, target), rel=1e-5)


@settings(max_examples=40)
@given(st.lists(points, min_size=2, max_size=5), points, points)
def test_another_sensor_never_harms(sensors, more, target):
    assert ours([*sensors, more], target) <= ours(sensors, target) * (1 + 1e-6) or np.allclose(more, target)

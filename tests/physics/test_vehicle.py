"""Drift and flight: measured order of convergence, an independent integrator, directions, published energy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from aquaquad_envs.physics import current_formulas
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh, flight_time, inside_box


def drift(field, x, y, duration, steps, *, start=0.0, euler=False):
    dt = duration / steps
    for i in range(steps):
        x, y = drift_step(field.velocity[None], 0, field.axes, start + i * dt, x, y, dt, euler)
    return np.array([x, y])


def rotation(rates):
    """Solid-body rotation at rates (rad/s) that change linearly between hourly frames: the grid is exact."""
    grid, side = Grid.square(5000.0, 500.0)
    x, y = grid.nodes(side, side)
    velocity = np.stack([np.stack([-rate * y, rate * x], -1) for rate in rates])
    return CurrentField(velocity=velocity, grid=grid, time_step_s=7200.0)


def shear(strength):
    """u = s·y, v = 0.2 + t-dependent part: x is a cubic in t, exact for order 4, not for order 1."""
    grid, side = Grid.square(5000.0, 500.0)
    x, y = grid.nodes(side, side)
    frames = [np.stack([strength * y, np.full_like(x, v)], -1) for v in (0.1, 0.4)]
    return CurrentField(velocity=np.stack(frames), grid=grid, time_step_s=7200.0)


def orders(field, exact, *, euler, steps):
    errors = [np.hypot(*(drift(field, 1500.0, -800.0, 7200.0, n, euler=euler) - exact)) for n in steps]
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:])), errors


@pytest.mark.parametrize("rates", [(6e-4,), (2e-4, 9e-4)], ids=["steady", "changing"])
@pytest.mark.parametrize(
    "euler, order, steps", [(False, 4, (12, 24, 48, 96)), (True, 1, (800, 1600, 3200, 6400))]
)
def test_order_of_convergence(rates, euler, order, steps):
    angle = 7200.0 * np.mean(rates)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    measured, errors = orders(rotation(rates), turn @ (1500.0, -800.0), euler=euler, steps=steps)
    np.testing.assert_allclose(measured, order, atol=0.15)
    assert errors[-1] < 20.0


def test_rk4_is_exact_where_the_path_is_a_cubic():
    s, x0, y0, t = 2e-4, 1500.0, -800.0, 7200.0
    rate = 0.3 / 7200.0
    exact = (x0 + s * (y0 * t + 0.1 * t**2 / 2 + rate * t**3 / 6), y0 + 0.1 * t + rate * t**2 / 2)
    np.testing.assert_allclose(drift(shear(s), x0, y0, t, 3), exact, atol=1e-8)
    assert np.abs(drift(shear(s), x0, y0, t, 3, euler=True) - exact).max() > 10.0


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_an_independent_integrator(seed):
    """Six hours adrift in a field that changes: scipy's DOP853 on scipy's interpolant of the same grid."""
    field = current_formulas.random_gyres(
        np.random.default_rng(seed), turnover_s=86_400.0, duration_s=6 * 3600.0, speed_m_s=0.3
    )
    frames, side = field.velocity.shape[:2]
    nodes = field.grid.x0 + field.grid.spacing * np.arange(side)
    table = RegularGridInterpolator(
        (field.time_step_s * np.arange(frames), nodes, nodes),
        field.velocity,
        bounds_error=False,
        fill_value=None,
    )
    start = np.random.default_rng(100 + seed).uniform(-1500, 1500, 2)
    golden = solve_ivp(
        lambda t, p: table((min(t, 21_600.0), p[1], p[0])), (0, 21_600.0), start,
        method="DOP853", rtol=1e-9, atol=1e-6, max_step=300.0,
    ).y[:, -1]  # fmt: skip
    assert np.abs(golden).max() < 5000, "the golden path left the grid; nothing is compared"
    assert np.hypot(*(golden - start)) > 500, "the golden path hardly moves"
    np.testing.assert_allclose(drift(field, *start, 21_600.0, 360), golden, atol=0.05)
    coarse = np.hypot(*(drift(field, *start, 21_600.0, 360, euler=True) - golden))
    assert 0.05 < coarse < 500


@pytest.mark.parametrize("euler", [False, True])
@pytest.mark.parametrize("u, v", [(0.5, 0.0), (0.0, -0.4), (-0.3, 0.3)])
def test_drifts_with_the_current(u, v, euler):
    moved = drift(current_formulas.uniform(u, v), 100.0, 200.0, 600.0, 10, euler=euler) - (100.0, 200.0)
    np.testing.assert_allclose(moved, (600 * u, 600 * v), atol=1e-9)


def test_a_drift_starts_at_its_own_time():
    field = current_formulas.rotating_tide(
        major_m_s=0.5, minor_m_s=0.5, period_s=40_000.0, duration_s=40_000.0
    )
    east = drift(field, 0, 0, 60.0, 1)
    north = drift(field, 0, 0, 60.0, 1, start=10_000.0)
    np.testing.assert_allclose(east, (30.0, 0.0), atol=0.2)
    np.testing.assert_allclose(north, (0.0, 30.0), atol=0.2)


def test_published_flight_numbers():
    """Dillard 2014: 200 W at 40 000 m/h; start to goal 9899.5 m costs 49.5 Wh; a full hop lasts 2 minutes."""
    airspeed = 40_000 / 3600
    distance = np.hypot(7000, 7000)
    assert distance == pytest.approx(9899.5, abs=0.05)
    assert flight_energy_wh(distance, airspeed, 200.0) == pytest.approx(49.497, abs=5e-4)
    assert flight_time(4000 / 3, airspeed) == pytest.approx(120.0)
    # Dobrokhodov et al. 2016: 340 W for 1.1 h are 374 Wh (the table's 470 is an erratum, SPEC §2).
    assert flight_energy_wh(1.1 * 40_000, airspeed, 340.0) == pytest.approx(374.0)


def test_the_box_has_edges_inside():
    assert inside_box(5000.0, -5000.0, 5000.0)
    assert not inside_box(5000.1, 0.0, 5000.0)
    assert not inside_box(0.0, -5000.1, 5000.0)

"""The planar submerged vehicle: drag, buoyancy, righting, order of its integration, what its controller does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.rov import (
    Rov,
    dive,
    make_rov,
    rov_rates,
    rov_step,
    thruster_forces,
    trimmed_integral,
)

P = Rov()
NEUTRAL = make_rov(volume=P.mass / P.water_density)
BUOYANCY = P.water_density * P.gravity * P.volume


def advance(state, forces, p, dt, steps):
    for _ in range(steps):
        state = rov_step(*state, *forces, p, dt)
    return np.array(state)


def follow(wanted, seconds, state=None, by_position=(True, True), p=P, dt=0.01):
    steps = round(seconds / dt)
    track = np.empty((steps + 1, 6))
    state = np.zeros(6) if state is None else np.array(state, dtype=float)
    dive(state, np.zeros(5), np.tile(np.array(wanted, dtype=float), (steps, 1)), *by_position, p, dt, track)
    return track


def test_neutral_and_level_it_stays():
    assert rov_rates(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, NEUTRAL) == pytest.approx((0.0,) * 6, abs=1e-12)


def test_terminal_speeds():
    """Sinking: weight less buoyancy meets linear and quadratic drag. Surging: thrust does."""
    sinking = P.mass * P.gravity - BUOYANCY
    assert sinking > 0.0
    terminal = (-P.drag_w + np.sqrt(P.drag_w**2 + 4 * P.drag_ww * sinking)) / (2 * P.drag_ww)
    assert advance([0.0] * 6, (0.0, 0.0, 0.0), P, 0.02, 3000)[4] == pytest.approx(terminal, rel=1e-6)
    for thrust in (-40.0, 40.0):
        speed = (-P.drag_u + np.sqrt(P.drag_u**2 + 4 * P.drag_uu * 40.0)) / (2 * P.drag_uu)
        end = advance([0.0] * 6, (thrust, 0.0, 0.0), NEUTRAL, 0.02, 1000)
        assert end[3] == pytest.approx(np.sign(thrust) * speed, rel=1e-6)


@given(*[st.floats(-2, 2)] * 3)
@settings(max_examples=50, deadline=None)
def test_drag_only_takes_energy(u, w, rate):
    """Neutral, centres together, no thrust: kinetic energy falls in every direction of motion."""
    p = make_rov(volume=NEUTRAL.volume, buoyancy_height=0.0)
    *_, du, dw, dq = rov_rates(0.3, u, w, rate, 0.0, 0.0, 0.0, p)
    power = p.mass * (u * du + w * dw) + p.inertia * rate * dq
    expected = (
        -(p.drag_u + p.drag_uu * abs(u)) * u**2
        - (p.drag_w + p.drag_ww * abs(w)) * w**2
        - (p.drag_q + p.drag_qq * abs(rate)) * rate**2
    )
    assert power == pytest.approx(expected, abs=1e-9) and power <= 0.0


@pytest.mark.parametrize("pitch", [-2.5, -0.5, 0.5, 2.5])
def test_buoyancy_rights_it(pitch):
    """Left alone it comes upright from any pitch; the first push is towards level."""
    assert np.sign(rov_rates(pitch, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, P)[5]) == -np.sign(pitch)
    assert abs(advance([0.0, 0.0, pitch, 0.0, 0.0, 0.0], (0.0, 0.0, 0.0), P, 0.02, 1500)[2]) < 1e-3


def test_it_swings_like_a_pendulum():
    """Without drag, at small angles: period 2π √(J / (B h))."""
    p = make_rov(drag_u=0, drag_uu=0, drag_w=0, drag_ww=0, drag_q=0, drag_qq=0)
    period = 2 * np.pi * np.sqrt(p.inertia / (BUOYANCY * p.buoyancy_height))
    end = advance([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0], (0.0, 0.0, 0.0), p, period / 200, 200)
    assert end[2] == pytest.approx(1e-3, rel=1e-5)
    half = advance([0.0, 0.0, 1e-3, 0.0, 0.0, 0.0], (0.0, 0.0, 0.0), p, period / 200, 100)
    assert half[2] == pytest.approx(-1e-3, rel=1e-5)


def test_runge_kutta_is_of_fourth_order():
    """No velocity changes sign, where quadratic drag has its kink."""
    start, forces = (0.0, 0.0, 0.3, 1.0, 0.5, 1.0), (60.0, 30.0, 3.0)
    exact = advance(start, forces, P, 1 / 2048, 2048)
    assert (exact[3:] > 0).all()
    errors = [np.abs(advance(start, forces, P, 1 / n, n) - exact).max() for n in (64, 128, 256)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 4.0) < 0.25).all()


def test_mixer_and_its_bounds():
    first, second, third = thruster_forces(30.0, -20.0, 1.0, P)
    assert -first - second == pytest.approx(-20.0) and 2 * third == pytest.approx(30.0)
    assert P.arm * (second - first) == pytest.approx(1.0)
    assert thruster_forces(1e4, 1e4, 0.0, P) == pytest.approx((-P.max_thrust, -P.max_thrust, P.max_thrust))


def test_goes_where_it_is_asked_at_any_pitch():
    """It keeps its weight up, and moves along x and z while it holds an angle."""
    for pitch in (0.0, 1.0):
        end = follow((2.0, 1.0, pitch), 40.0)[-1]
        np.testing.assert_allclose(end, [2.0, 1.0, pitch, 0.0, 0.0, 0.0], atol=0.01)


def test_trim_holds_it_from_the_first_moment():
    track = np.empty((101, 6))
    integrals = np.array([0.0, 0.0, 0.0, trimmed_integral(P), 0.0])
    dive(
        np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0]),
        integrals,
        np.tile([0.0, 5.0, 0.0], (100, 1)),
        True,
        True,
        P,
        0.01,
        track,
    )
    np.testing.assert_allclose(track, np.tile([0.0, 5.0, 0.0, 0.0, 0.0, 0.0], (101, 1)), atol=1e-14)


def test_velocity_commands():
    track = follow((0.3, 5.0, 0.0), 15.0, state=[0.0, 5.0, 0.0, 0.0, 0.0, 0.0], by_position=(False, True))
    assert np.diff(track[-2:, 0])[0] / 0.01 == pytest.approx(0.3, abs=1e-3)
    assert abs(track[:, 1] - 5.0).max() < 0.05


def test_turns_the_shorter_way():
    """From -135° to 135°: a quarter turn through 180°, as the paper has it, not three quarters through 0°."""
    track = follow((0.0, 0.0, 0.75 * np.pi), 40.0, state=[0.0, 0.0, -0.75 * np.pi, 0.0, 0.0, 0.0])
    assert track[-1, 2] == pytest.approx(-1.25 * np.pi, abs=0.01)
    assert track[:, 2].max() < -0.7 * np.pi


@pytest.mark.parametrize("values, words", [({"mass": 0.0}, "mass"), ({"drag_uu": -1.0}, "drag_uu"),
                                           ({"fins": 2}, "fins: got 2, expected one of"),
                                           ({"volume": float("nan")}, "volume")])  # fmt: skip
def test_bad_parameters(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        make_rov(**values)

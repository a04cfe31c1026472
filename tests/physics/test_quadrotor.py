"""The planar quadrotor: limits of its motion, order of its integration, what its controller does."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.quadrotor import (
    Quadrotor,
    fly,
    make_quadrotor,
    quadrotor_control,
    quadrotor_rates,
    quadrotor_step,
    rotor_thrusts,
)

P = Quadrotor()
WEIGHT = P.mass * P.gravity


def advance(state, thrust, moment, p, dt, steps):
    for _ in range(steps):
        state = quadrotor_step(*state, thrust, moment, p, dt)
    return np.array(state)


def follow(wanted, seconds, state=None, by_position=(True, True), p=P, dt=0.01):
    """Track, (n + 1, 6), under a constant command (x, z)."""
    steps = round(seconds / dt)
    track = np.empty((steps + 1, 6))
    state = np.zeros(6) if state is None else np.array(state, dtype=float)
    fly(state, np.zeros(5), np.tile(np.array(wanted, dtype=float), (steps, 1)), *by_position, p, dt, track)
    return track


def test_hover_is_an_equilibrium():
    assert quadrotor_rates(0.0, 0.0, 0.0, 0.0, WEIGHT, 0.0, P) == pytest.approx((0.0,) * 6, abs=1e-15)
    thrust, moment, *integrals = quadrotor_control(
        3.0, -2.0, *[0.0] * 9, 3.0, -2.0, True, True, P, 0.01
    )  # fmt: skip
    assert thrust == pytest.approx(WEIGHT, rel=1e-15) and moment == 0.0 and integrals == [0.0] * 5
    np.testing.assert_allclose(follow((0.0, 0.0), 1.0)[-1], 0.0, atol=1e-12)


def test_a_tumbling_free_fall_keeps_momentum_and_energy():
    """Without thrust there is no induced drag: gravity alone, whatever the attitude does."""
    start = np.array([0.0, 0.0, 0.4, 2.0, -1.0, 3.0])
    end = advance(start, 0.0, 0.0, P, 0.01, 100)

    def inertial(state):
        s, c = np.sin(state[2]), np.cos(state[2])
        return np.array([c * state[3] + s * state[4], c * state[4] - s * state[3]])

    def energy(state):
        return 0.5 * (state[3] ** 2 + state[4] ** 2) - P.gravity * state[1]

    before, after = inertial(start), inertial(end)
    assert after[0] == pytest.approx(before[0], abs=1e-6)
    assert after[1] == pytest.approx(before[1] + P.gravity, abs=1e-6)
    assert end[1] == pytest.approx(before[1] + 0.5 * P.gravity, abs=1e-6)
    assert end[5] == 3.0 and end[2] == pytest.approx(0.4 + 3.0)
    assert energy(end) == pytest.approx(energy(start), abs=1e-5)


def test_thrust_and_moment_turn_into_momentum():
    """From rest, for an instant: acceleration along the thrust axis and about the pitch axis."""
    for pitch in (0.0, 0.5, -2.0, np.pi):
        end = advance([0.0, 0.0, pitch, 0.0, 0.0, 0.0], 20.0, 0.3, P, 1e-4, 1)
        s, c = np.sin(pitch), np.cos(pitch)
        force = np.array([-20.0 * s, P.mass * P.gravity - 20.0 * c])
        velocity = [c * end[3] + s * end[4], c * end[4] - s * end[3]]
        np.testing.assert_allclose(velocity, 1e-4 * force / P.mass, atol=1e-7)
        assert end[5] == pytest.approx(1e-4 * 0.3 / P.inertia)


def test_drag_opposes_motion_and_sets_the_speed_of_a_held_tilt():
    for u in (-3.0, 3.0):
        rate = quadrotor_rates(0.0, u, 0.0, 0.0, WEIGHT, 0.0, P)[3]
        assert rate == pytest.approx(-P.gravity * P.induced_drag * u)
    # At a held pitch, thrust balancing weight across it, gravity along it meets the drag at u = -m g s / (T C_d).
    pitch = -0.2
    thrust = WEIGHT * np.cos(pitch)
    end = advance([0.0, 0.0, pitch, 0.0, 0.0, 0.0], thrust, 0.0, P, 0.01, 3000)
    assert end[3] == pytest.approx(-WEIGHT * np.sin(pitch) / (thrust * P.induced_drag), rel=1e-5)
    assert end[3] > 0.0


def test_runge_kutta_is_of_fourth_order():
    start = (0.0, 0.0, 0.3, 1.0, 0.5, 2.0)
    exact = advance(start, 30.0, 0.05, P, 1 / 512, 512)
    errors = [np.abs(advance(start, 30.0, 0.05, P, 1 / n, n) - exact).max() for n in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 4.0) < 0.25).all()


def test_mixer_and_its_bounds():
    first, second = rotor_thrusts(40.0, 1.5, P)
    assert first + second == pytest.approx(40.0) and P.arm * (second - first) == pytest.approx(1.5)
    assert rotor_thrusts(500.0, 0.0, P) == pytest.approx((0.5 * P.max_thrust,) * 2)
    assert rotor_thrusts(-5.0, 0.0, P) == (0.0, 0.0)
    assert rotor_thrusts(10.0, 50.0, P) == pytest.approx((0.0, 0.5 * P.max_thrust))


def test_goes_where_it_is_asked():
    """Arrives and stays; pitches forward (nose down) to begin with; climbs for a negative z; its mirror does the same."""
    track = follow((2.0, -3.0), 15.0)
    np.testing.assert_allclose(track[-1], [2.0, -3.0, 0, 0, 0, 0], atol=0.01)
    assert track[30, 2] < -0.05 and track[100, 1] < -0.3
    mirrored = follow((-2.0, -3.0), 15.0)
    np.testing.assert_allclose(mirrored * (-1, 1, -1, -1, 1, -1), track, atol=1e-12)
    # The attitude has to turn first: altitude answers at once, x does not.
    assert abs(track[10, 0]) < 0.1 * abs(track[10, 1])


def test_velocity_commands():
    track = follow((0.8, 0.0), 10.0, by_position=(False, True))
    assert np.diff(track[-2:, 0])[0] / 0.01 == pytest.approx(0.8, abs=0.01)
    assert abs(track[:, 1]).max() < 0.05


def test_tilt_and_speed_stay_within_bounds():
    track = follow((200.0, 0.0), 20.0)
    assert abs(track[:, 2]).max() < np.arctan(P.max_tilt_slope) * 1.2
    assert abs(track[:, 2]).max() > np.arctan(P.max_tilt_slope) * 0.5
    speed = np.diff(track[:, 0]) / 0.01
    assert speed.max() < 1.2 * P.max_speed and speed[-1] == pytest.approx(P.max_speed, rel=0.05)


def test_thrust_that_would_push_the_wrong_way_is_not_given():
    """Upside down the projection on the thrust axis is negative: rotors stop pushing, and turn it upright."""
    thrust, *_ = quadrotor_control(*[0.0, 0.0, np.pi - 0.1], *[0.0] * 8, 0.0, 0.0, True, True, P, 0.01)
    assert 0.0 <= thrust < WEIGHT
    track = follow((0.0, 0.0), 10.0, state=[0.0, 0.0, np.pi - 0.1, 0.0, 0.0, 0.0])
    assert abs(np.sin(0.5 * track[-1, 2])) < 1e-3 and abs(track[-1, 1]) < 0.5


@pytest.mark.parametrize(
    "values, words",
    [
        ({"mass": 0.0}, "mass"), ({"max_thrust": 10.0}, "more than the weight"), ({"arm": -1.0}, "arm"),
        ({"max_tilt_slope": 3.0}, "max_tilt_slope.*60°"), ({"inertia": float("nan")}, "inertia"),
        ({"wings": 2}, "wings: got 2, expected one of"), ({"max_climb_acceleration": 9.81}, "max_climb_acceleration"),
    ],
)  # fmt: skip
def test_bad_parameters(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        make_quadrotor(**values)
    assert make_quadrotor(mass=3.0).mass == 3.0

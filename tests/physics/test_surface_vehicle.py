"""The vehicle that holds its speed and turns."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.physics.surface_vehicle import turn_and_go


@loop_kernel
def _go(x, y, heading, yaw_rate, speed, dt):
    return turn_and_go(x, y, heading, yaw_rate, speed, dt)


@given(heading=st.floats(-7, 7), yaw_rate=st.floats(-2, 2), speed=st.floats(0, 10), dt=st.floats(0.01, 10))
@settings(max_examples=50, deadline=None)
def test_a_step_is_as_long_as_speed_and_time_along_the_new_heading(heading, yaw_rate, speed, dt):
    x, y, turned = _go(1.0, -2.0, heading, yaw_rate, speed, dt)
    assert -np.pi <= turned <= np.pi
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * (heading + yaw_rate * dt)), atol=1e-9)
    np.testing.assert_allclose((x - 1.0) + 1j * (y + 2.0), speed * dt * np.exp(1j * turned), atol=1e-9)


def test_a_constant_turn_closes_its_polygon():
    x, y, heading = 3.0, 4.0, 0.5
    for _ in range(12):
        x, y, heading = _go(x, y, heading, 2 * np.pi / 12, 2.0, 1.0)
    np.testing.assert_allclose((x, y, heading), (3.0, 4.0, 0.5), atol=1e-12)


def test_a_positive_yaw_rate_turns_from_east_to_north():
    x, y, heading = _go(0.0, 0.0, 0.0, np.pi / 2, 1.0, 1.0)
    np.testing.assert_allclose((x, y, heading), (0.0, 1.0, np.pi / 2), atol=1e-12)

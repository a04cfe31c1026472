"""Arithmetic in place of the system's trigonometry, and the shorter way round."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.physics.angles import arc_tangent, sine_cosine, smallest_turn


def test_sine_and_cosine_are_those_of_the_system():
    angles = np.concatenate([np.linspace(-1000, 1000, 4001), np.arange(-16, 17) * np.pi / 4])
    found = np.array([sine_cosine(angle) for angle in angles])
    np.testing.assert_allclose(found[:, 0], np.sin(angles), atol=3e-16)
    np.testing.assert_allclose(found[:, 1], np.cos(angles), atol=3e-16)


@given(st.floats(-np.pi / 3, np.pi / 3), st.floats(1e-3, 1e3))
@settings(max_examples=100, deadline=None)
def test_arc_tangent_inverts_the_tangent(angle, length):
    assert arc_tangent(length * np.sin(angle), length * np.cos(angle)) == pytest.approx(angle, abs=1e-15)


@given(st.floats(-20, 20), st.floats(-20, 20))
@settings(max_examples=200, deadline=None)
def test_smallest_turn_is_algorithm_1(wanted, angle):
    left = wanted
    while left - angle > np.pi:
        left -= 2 * np.pi
    while left - angle < -np.pi:
        left += 2 * np.pi
    turn = smallest_turn(wanted, angle)
    assert abs(turn) <= np.pi + 1e-12
    # Half a turn is as short either way.
    assert min(abs(turn - (left - angle)), abs(abs(turn) - np.pi) + abs(abs(left - angle) - np.pi)) < 1e-12

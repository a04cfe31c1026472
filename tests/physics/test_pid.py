"""The controller: its three parts, its bounds, and an integral that does not wind up."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.physics.pid import Gains, pid


def test_three_parts():
    output, integral = pid(0.5, -2.0, 3.0, Gains(2.0, 0.1, 0.25), 10.0, 0.1)
    assert output == pytest.approx(2.0 * 0.5 + 0.1 * 3.0 - 0.25 * 2.0)
    assert integral == pytest.approx(3.0 + 0.5 * 0.1)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0, 100))
@settings(max_examples=100, deadline=None)
def test_output_is_bounded(error, rate, integral, limit):
    output, _ = pid(error, rate, integral, Gains(1.0, 0.5, 0.1), limit, 0.01)
    assert -limit <= output <= limit


def respond(limit, steps, gains, anti_windup=True):
    """A unit integrator asked to rise by 10 through a saturated controller; the greatest overshoot."""
    x = integral = most = 0.0
    for _ in range(steps):
        output, new = pid(10.0 - x, 0.0, integral, gains, limit, 0.01)
        integral = new if anti_windup else integral + (10.0 - x) * 0.01
        x += 0.01 * output
        most = max(most, x - 10.0)
    return x, most


def test_anti_windup_spares_the_overshoot():
    """Saturated most of the way: without it the integral that has piled up carries far beyond."""
    gains = Gains(4.0, 1.0)
    end, overshoot = respond(1.0, 3000, gains)
    _, wound = respond(1.0, 3000, gains, anti_windup=False)
    assert end == pytest.approx(10.0, abs=0.1)
    assert overshoot < 0.1 < 2.0 < wound


def test_a_saturated_integral_comes_off_at_once():
    """An error that leads back from the stop is integrated although the output is still there."""
    _, pushed = pid(1.0, 0.0, 5.0, Gains(1.0, 1.0), 1.0, 0.1)
    _, relieved = pid(-1.0, 0.0, 5.0, Gains(1.0, 1.0), 1.0, 0.1)
    assert pushed == 5.0 and relieved == pytest.approx(4.9)

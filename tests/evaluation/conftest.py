"""Lets tests name the policies in own_policies.py as users name their own."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="module")
def quick_bound():
    """A made-up bound, a third of the straight flight, for tests of what is done with it: real ones take seconds."""
    from baselines.optimal import Optimal

    def bound_wh(self):
        worlds, params = self.batch.worlds, self.batch.params
        dx, dy = worlds["goal_x"] - worlds["start_x"], worlds["goal_y"] - worlds["start_y"]
        return params.flight_power_w * (dx**2 + dy**2) ** 0.5 / params.airspeed_m_s / 3600 / 3

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Optimal, "bound_wh", bound_wh)
        yield

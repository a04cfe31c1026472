"""Step responses of both vehicles: the numbers against curves whose answer is known, the published statements."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from evaluation.published_vehicles import (
    QUADROTOR_STEPS,
    ROV_STEPS,
    quadrotor_response,
    reproduce_vehicles,
    rov_response,
    step_numbers,
    step_table,
)


def test_numbers_of_known_curves():
    t = 0.01 * np.arange(2000)
    found = step_numbers(3.0 - 2.0 * (1 - np.exp(-t)), 1.0, 0.01)
    assert found["step"] == -2.0 and found["overshoot"] == 0.0
    assert found["settling_s"] == pytest.approx(np.log(20), abs=0.01)
    assert found["delay_s"] == pytest.approx(-np.log(0.98), abs=0.01)
    # Second order, damping ratio ζ: overshoot exp(-π ζ / √(1 - ζ²)).
    zeta, root = 0.5, np.sqrt(0.75)
    swing = 1 - np.exp(-zeta * t) * (np.cos(root * t) + zeta / root * np.sin(root * t))
    assert step_numbers(swing, 1.0, 0.01)["overshoot"] == pytest.approx(
        np.exp(-np.pi * zeta / root), rel=1e-3
    )
    assert step_numbers(t[:50], 10.0, 0.01)["settling_s"] == np.inf
    with pytest.raises(InvalidParameterError, match="band"):
        step_numbers(t, 1.0, 0.01, band=0.0)


def test_every_step_is_in_the_table_and_followed():
    for response, steps in ((quadrotor_response(), QUADROTOR_STEPS), (rov_response(), ROV_STEPS)):
        rows = step_table(response)
        changes = np.diff(np.concatenate([np.zeros((1, len(steps[0]))), steps]), axis=0)
        assert len(rows) == np.count_nonzero(changes)
        assert all(0 < row["delay_s"] < row["settling_s"] < response.hold_s for row in rows)
        assert all(row["overshoot"] < 0.3 for row in rows)


def test_published_statements_hold():
    table, figures = reproduce_vehicles()
    assert all(table["statements"].values()) and len(table["statements"]) == 3
    assert set(figures) == {"quadrotor-steps", "rov-steps"}
    assert all(png.startswith(b"\x89PNG") for png in figures.values())

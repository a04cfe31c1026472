"""The task's page says what the code does: its tables against the code, its example run."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.tasks import sensor_placement, sensor_placement_params
from aquaquad_envs.tasks.sensor_placement_data import OUTCOMES, REWARD_TERMS, TARGET_MOTIONS, WORLD
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES, STATE_NAMES
from tests.tasks.pages import table_of

PAGE = (Path(__file__).parents[2] / "docs" / "sensor_placement.md").read_text()


def table(heading):
    return table_of(PAGE, heading)


def test_observations_and_state():
    rows = table("Observation space")
    assert [(int(row[0]), row[1]) for row in rows] == list(enumerate(OBSERVATION_NAMES))
    assert all(row[3:5] == ["-1", "1"] for row in rows)
    assert f"({len(OBSERVATION_NAMES)},)" in PAGE
    assert f"float32 of {len(STATE_NAMES)} numbers" in PAGE


def test_reward_outcomes_metrics_targets_and_scenarios():
    assert tuple(row[0] for row in table("Reward")) == REWARD_TERMS
    assert ("running", *(row[0] for row in table("Episode end"))) == OUTCOMES
    assert [row[0] for row in table("Scenarios")] == list(sensor_placement.SCENARIOS)
    assert [row[0] for row in table("Targets")] == list(TARGET_MOTIONS)
    metrics = sensor_placement.metrics(np.zeros(1, WORLD), sensor_placement.Params())
    assert [row[0] for row in table("Metrics")] == list(metrics)


def number(text):
    powers = {
        "10⁵": "1e5",
        "10⁶": "1e6",
        "10⁸": "1e8",
        "2⁶³": str(2**63),
        "10⁻³": "1e-3",
        "10⁻⁶": "1e-6",
        "10⁻⁷": "1e-7",
    }
    return float(powers.get(text.strip(), text))


def test_parameters():
    rows = {row[0]: row for row in table("Parameters")}
    assert sorted(rows) == sorted(field.name for field in dataclasses.fields(sensor_placement.Params))
    for field in dataclasses.fields(sensor_placement.Params):
        written = eval(rows[field.name][1], {"__builtins__": {}})
        assert written == pytest.approx(field.default), field.name
    bounds = {name: row[3] for name, row in rows.items() if row[3]}
    assert set(bounds) == {name for name, *_ in sensor_placement_params._BOUNDS}
    for name, low, high, open_low in sensor_placement_params._BOUNDS:
        a, b = bounds[name][1:-1].split(",")
        assert (bounds[name][0] == "(") == open_low and (number(a), number(b)) == (low, high), name


def test_scales_that_the_page_names():
    for measurement, scale in (("bearing", 354), ("range", 50), ("tdoa", 1.06)):
        params = sensor_placement.Params(scenario="calm", measurement=measurement)
        assert sensor_placement.build(params)[1].fix_scale == pytest.approx(scale, rel=5e-3)


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(code, {})
    assert "tracking_rmse_m" in capsys.readouterr().out

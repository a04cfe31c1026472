"""The task's page says what the code does: its tables against the code, its example run."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.tasks import laser_tracking, laser_tracking_params
from aquaquad_envs.tasks.laser_tracking_data import OUTCOMES, REWARD_TERMS, SCENARIOS, WORLD
from aquaquad_envs.tasks.laser_tracking_observation import OBSERVATION_NAMES
from evaluation.suites import SUITES
from tests.tasks.pages import table_of

PAGE = (Path(__file__).parents[2] / "docs" / "laser_tracking.md").read_text()


def table(heading):
    return table_of(PAGE, heading)


def test_observations():
    rows = table("Observation space")
    assert [(int(row[0]), row[1]) for row in rows] == list(enumerate(OBSERVATION_NAMES))
    assert all(row[3:5] == ["-1", "1"] for row in rows)
    assert f"({len(OBSERVATION_NAMES)},)" in PAGE


def test_reward_outcomes_metrics_scenarios_and_suites():
    assert tuple(row[0] for row in table("Reward")) == REWARD_TERMS
    assert ("running", *(row[0] for row in table("Episode end"))) == OUTCOMES
    assert [row[0] for row in table("Scenarios")] == list(SCENARIOS)
    metrics = laser_tracking.metrics(np.zeros(1, WORLD), laser_tracking.Params())
    assert [row[0] for row in table("Metrics")] == list(metrics)
    suites = {suite.name: suite.params["scenario"] for suite in SUITES["laser-tracking"]}
    assert {row[0]: row[1].strip("`") for row in table("Suites")} == suites


def test_what_the_page_says_of_a_record_is_in_it():
    fields = {name for row in table("What is in a record") for name in re.findall(r"\w+", row[0])}
    assert fields <= set(WORLD.names) and len(fields) > 25


def number(text):
    powers = {"10⁴": "1e4", "10⁶": "1e6", "10⁹": "1e9", "10⁻³": "1e-3"}
    return float(powers.get(text.strip(), text))


def test_parameters():
    rows = {row[0]: row for row in table("Parameters")}
    assert list(rows) == [field.name for field in dataclasses.fields(laser_tracking.Params)]
    for field in dataclasses.fields(laser_tracking.Params):
        written = eval(rows[field.name][1], {"__builtins__": {}})
        assert written == pytest.approx(field.default), field.name
    bounds = {name: row[3] for name, row in rows.items() if row[3]}
    assert set(bounds) == {name for name, *_ in laser_tracking_params._BOUNDS}
    for name, low, high, open_low in laser_tracking_params._BOUNDS:
        a, b = bounds[name][1:-1].split(",")
        assert (bounds[name][0] == "(") == open_low and (number(a), number(b)) == (low, high), name


def test_numbers_that_the_page_names():
    for profile, peak in (("flat-top", 17.6e-3), ("gaussian", 59e-3)):
        constants = laser_tracking.build(laser_tracking.Params(profile=profile))[1]
        assert constants.peak == pytest.approx(peak, rel=5e-3)
        assert constants.radius == pytest.approx(0.70, abs=5e-3)
    flat = laser_tracking.build(laser_tracking.Params())[1]
    sigma = flat.beam.sigma_ratio * flat.radius
    assert sigma * (2 * np.log(4)) ** 0.1 == pytest.approx(0.97, abs=5e-3)
    assert 2 * flat.radius == pytest.approx(1.39, abs=5e-3)


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(code, {})
    assert "time_in_lda" in capsys.readouterr().out

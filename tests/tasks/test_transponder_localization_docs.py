"""The task's page says what the code does: its tables against the code, its example run."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.tasks import transponder_localization, transponder_localization_params
from aquaquad_envs.tasks.transponder_localization_data import OUTCOMES, REWARD_TERMS, VEHICLES, WORLD
from aquaquad_envs.tasks.transponder_localization_observation import OBSERVATION_NAMES
from aquaquad_envs.tasks.transponder_localization_params import Params
from tests.tasks.pages import table_of

PAGE = (Path(__file__).parents[2] / "docs" / "transponder_localization.md").read_text()


def table(heading):
    return table_of(PAGE, heading)


def test_observations():
    rows = table("Observation space")
    assert [(int(row[0]), row[1]) for row in rows] == list(enumerate(OBSERVATION_NAMES))
    assert all(row[3:5] == ["-1", "1"] for row in rows)
    assert f"({len(OBSERVATION_NAMES)},)" in PAGE


def test_actions_vehicles_rewards_outcomes_metrics_and_scenarios():
    assert [row[0] for row in table("Vehicles")] == list(VEHICLES)
    for vehicle in VEHICLES:
        numbers = [int(row[1]) for row in table("Action space") if row[0] == vehicle]
        spec = transponder_localization.TASK.action_spec(Params(scenario="deep", vehicle=vehicle))
        assert numbers == list(range(spec.size))
    assert tuple(row[0] for row in table("Reward")) == REWARD_TERMS
    assert ("running", *(row[0] for row in table("Episode end"))) == OUTCOMES
    assert [row[0] for row in table("Scenarios")] == list(transponder_localization.SCENARIOS)
    metrics = transponder_localization.metrics(np.zeros(1, WORLD), Params())
    assert [row[0] for row in table("Metrics")] == list(metrics)


def test_suites():
    suites = pytest.importorskip("evaluation.suites").SUITES["transponder-localization"]
    assert [(row[0], int(row[1])) for row in table("Suites")] == [(s.name, s.episodes) for s in suites]


def number(text):
    """A bound as the page writes it: powers with raised digits."""
    power = re.fullmatch(r"(\d+)([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", text.strip())
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    return float(power[1]) ** int(power[2].translate(raised)) if power else float(text)


def test_parameters():
    rows = {row[0]: row for row in table("Parameters")}
    assert set(rows) == {field.name for field in dataclasses.fields(Params)}
    for field in dataclasses.fields(Params):
        written = eval(rows[field.name][1], {"__builtins__": {}})
        assert written == pytest.approx(field.default), field.name
    bounds = {name: row[3] for name, row in rows.items() if row[3]}
    assert set(bounds) == {name for name, *_ in transponder_localization_params._BOUNDS}
    for name, low, high, open_low in transponder_localization_params._BOUNDS:
        a, b = bounds[name][1:-1].split(",")
        assert (bounds[name][0] == "(") == open_low, name
        assert (number(a), number(b)) == pytest.approx((low, high)), name


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(code, {})
    assert "rmse_m" in capsys.readouterr().out

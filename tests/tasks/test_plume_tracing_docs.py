"""The task's page says what the code does: its tables against the code, its example run."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.sensing.plume import KINDS
from aquaquad_envs.tasks import plume_tracing, plume_tracing_params
from aquaquad_envs.tasks.plume_tracing_data import LAYOUTS, OUTCOMES, REWARD_TERMS, WORLD
from aquaquad_envs.tasks.plume_tracing_observation import OBSERVATION_NAMES, STATE_NAMES
from baselines import POLICIES
from evaluation.suites import SUITES
from tests.tasks.pages import table_of

PAGE = (Path(__file__).parents[2] / "docs" / "plume_tracing.md").read_text()
_POWER = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


def table(heading):
    return table_of(PAGE, heading)


def test_observations_and_state():
    rows = table("Observation space")
    assert [(int(row[0]), row[1]) for row in rows] == list(enumerate(OBSERVATION_NAMES))
    assert all(row[3:5] == ["-1", "1"] for row in rows)
    assert f"({len(OBSERVATION_NAMES)},)" in PAGE and f"float32 of {len(STATE_NAMES)} numbers" in PAGE


def test_reward_outcomes_metrics_fields_and_scenarios():
    assert tuple(row[0] for row in table("Reward")) == REWARD_TERMS
    assert ("running", *(row[0] for row in table("Episode end"))) == OUTCOMES
    assert [row[0] for row in table("Scenarios")] == list(plume_tracing.SCENARIOS)
    assert [row[0] for row in table("Starting state")] == list(LAYOUTS)
    assert [row[0] for row in table("Field")] == list(KINDS)
    metrics = plume_tracing.metrics(np.zeros(1, WORLD), plume_tracing.Params())
    assert [row[0] for row in table("Metrics")] == list(metrics)


def test_policies_and_suites():
    listed = {row[0] for row in table("Policies")}
    assert set(POLICIES["plume-tracing"]) <= listed <= {*POLICIES["plume-tracing"], "ppo"}
    named = {name for row in table("Suites") for name in re.findall(r"[a-z0-9-]+", row[0])}
    assert named == {suite.name for suite in SUITES["plume-tracing"]}
    episodes = [int(n) for row in table("Suites") for n in re.findall(r"\d+", row[1])]
    assert set(episodes) == {suite.episodes for suite in SUITES["plume-tracing"]}


def number(text):
    base, exponent = re.fullmatch(r"(-?[\d.]+)([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]*)", text.strip()).groups()
    return float(base) ** int(exponent.translate(_POWER)) if exponent else float(base)


def test_parameters():
    rows = {row[0]: row for row in table("Parameters")}
    assert list(rows) == [field.name for field in dataclasses.fields(plume_tracing.Params)]
    for field in dataclasses.fields(plume_tracing.Params):
        written = eval(rows[field.name][1], {"__builtins__": {}})
        assert written == pytest.approx(field.default) and type(written) is type(field.default), field.name
    bounds = {name: row[3] for name, row in rows.items() if row[3]}
    assert set(bounds) == {name for name, *_ in plume_tracing_params._BOUNDS}
    for name, low, high, open_low in plume_tracing_params._BOUNDS:
        a, b = bounds[name][1:-1].split(",")
        assert (bounds[name][0] == "(") == open_low and (number(a), number(b)) == pytest.approx(
            (low, high)
        ), name


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(code, {})
    assert "updates_to_source" in capsys.readouterr().out

"""The task's page says what the code does: its tables against the code, its example run."""

import dataclasses
import re
from pathlib import Path

import pytest

from aquaquad_envs.tasks import drift_hop
from aquaquad_envs.tasks.drift_hop_kernels import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.drift_hop_observation import OBSERVATION_NAMES
from aquaquad_envs.tasks.scenarios import SCENARIOS

PAGE = (Path(__file__).parents[2] / "docs" / "drift_hop.md").read_text()


def table(heading):
    """Rows of the first table under a heading, cells stripped of spaces and backticks."""
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)[1]
    lines = section[section.index("|---") :].splitlines()[1:]
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().strip("`") for cell in line.strip("|").split("|")])
    return rows


def test_observations():
    rows = table("Observation space")
    assert [(int(row[0]), row[1]) for row in rows] == list(enumerate(OBSERVATION_NAMES))
    assert all(row[3:5] == ["-1", "1"] for row in rows)
    assert f"({len(OBSERVATION_NAMES)},)" in PAGE


def test_reward_outcomes_metrics_and_scenarios():
    assert tuple(row[0] for row in table("Reward")) == REWARD_TERMS
    assert ("running", *(row[0] for row in table("Episode end"))) == OUTCOMES
    assert [row[0] for row in table("Scenarios")] == list(SCENARIOS)
    batch_metrics = drift_hop.metrics(drift_hop.np.zeros(1, drift_hop.WORLD), drift_hop.Params())
    assert [row[0] for row in table("Metrics")] == list(batch_metrics)


def number(text):
    return float(
        text.replace("10⁵", "1e5").replace("10⁶", "1e6").replace("10⁸", "1e8").replace("2⁶³", str(2**63))
    )


def test_parameters():
    rows = {row[0]: row for row in table("Parameters")}
    assert sorted(rows) == sorted(field.name for field in dataclasses.fields(drift_hop.Params))
    for field in dataclasses.fields(drift_hop.Params):
        written = eval(rows[field.name][1], {"__builtins__": {}})
        assert written == pytest.approx(field.default), field.name
    bounds = {name: row[3] for name, row in rows.items() if row[3]}
    assert set(bounds) == {name for name, *_ in drift_hop._BOUNDS}
    for name, low, high, open_low in drift_hop._BOUNDS:
        a, b = bounds[name][1:-1].split(",")
        assert (bounds[name][0] == "(") == open_low and (number(a), number(b)) == (low, high), name


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    exec(code, {})
    assert "flight_energy_wh" in capsys.readouterr().out

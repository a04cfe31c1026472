"""The run: results.json by its schema, kept whatever happens, the same from run to run."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.errors import CheckpointError
from evaluation.benchmark import Benchmark, write_json
from evaluation.report import write_report
from evaluation.suites import find_suites

ROOT = Path(__file__).parents[2]
METRICS = {
    "success", "flight_energy_wh", "saving_vs_direct", "optimality_gap", "duration_s", "mean_hdop", "solar_wh",
}  # fmt: skip


def benchmark(output, policies, suites=("vortex",), episodes=9):
    return Benchmark(
        task="drift-hop", suites=find_suites("drift-hop", suites), policies=list(policies), seed=0, output=output,
        arguments=["--episodes", str(episodes)], episodes=episodes,
    )  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory, quick_bound):
    run = benchmark(
        tmp_path_factory.mktemp("run"),
        ["direct-flight", "own_policies:Crash", "own_policies:WrongShape", "drift", "own_policies:Worse"],
        ["vortex-perturbed"],
    )
    run.run()
    write_report(run)
    return run, json.loads((run.output / "results.json").read_text())


def test_results_follow_the_schema(finished):
    run, content = finished
    assert content["schema"] == 1
    assert content["manifest"]["complete"] is True
    assert content["machine"]["packages"]["numpy"] == np.__version__
    assert [entry["policy"] for entry in content["results"]] == run.policies
    for entry in content["results"]:
        assert (entry["task"], entry["suite"], entry["episodes"], entry["seed"]) == (
            "drift-hop", "vortex-perturbed", 9, 0,
        )  # fmt: skip
        assert entry["wall_s"] >= 0
        if "error" in entry:
            continue
        assert set(entry["metrics"]) == METRICS
        for summary in entry["metrics"].values():
            assert {"mean", "std", "median", "iqm", "ci95"} <= set(summary)
            assert len(summary["ci95"]) == 2


def test_the_numbers_are_those_of_the_episodes(finished):
    run, content = finished
    entries = {entry["policy"]: entry for entry in content["results"]}
    direct, drift, worse = entries["direct-flight"], entries["drift"], entries["own_policies:Worse"]
    assert direct["metrics"]["success"]["mean"] == 1.0
    assert direct["score"] == pytest.approx(0.0, abs=1e-9)
    assert direct["outcomes"] == {"goal": 9}
    energies = run.runs[0].runs["direct-flight"].worlds["flight_wh"]
    assert direct["metrics"]["flight_energy_wh"]["mean"] == pytest.approx(energies.mean())
    # Nothing that did not arrive has an energy, and a failure scores 0.
    assert drift["metrics"]["flight_energy_wh"]["mean"] is None and drift["score"] == 0.0
    assert worse["score"] < 0 < worse["metrics"]["optimality_gap"]["mean"]
    pair = next(p for p in content["paired"] if {p["a"], p["b"]} == {"direct-flight", "own_policies:Worse"})
    assert pair["a"] == "direct-flight"
    assert pair["flight_energy_wh"]["probability_of_improvement"] == 1.0
    assert pair["flight_energy_wh"]["ci95"][1] < 0
    assert pair["score"]["difference"] > 0
    assert len(content["paired"]) == 3, "three policies ran: three pairs"


def test_a_policy_that_crashes_is_reported_and_the_rest_is_kept(finished):
    run, content = finished
    crashed, shape = content["results"][1:3]
    assert crashed["error"]["type"] == "RuntimeError"
    assert crashed["error"]["message"] == "the third decision is too much"
    assert crashed["error"]["where"].startswith("own_policies.py:")
    assert crashed["metrics"] == {} and crashed["score"] is None
    assert shape["error"]["type"] == "InvalidActionError" and "shape" in shape["error"]["message"]
    assert len(run.crashed) == 2
    assert "error" not in content["results"][4]


def test_the_same_command_gives_the_same_numbers(finished, tmp_path):
    _, before = finished
    run = benchmark(tmp_path, ["own_policies:Worse"], ["vortex-perturbed"])
    run.run()
    again = json.loads((tmp_path / "results.json").read_text())["results"][0]
    first = before["results"][4]
    assert again["metrics"] == first["metrics"] and again["score"] == first["score"]


def test_strata_are_reported_apart_and_make_up_the_whole(tmp_path, quick_bound):
    run = benchmark(tmp_path, ["direct-flight"], ["gyres"], episodes=4)
    run.run()
    entry = json.loads((tmp_path / "results.json").read_text())["results"][0]
    assert {name: part["episodes"] for name, part in entry["strata"].items()} == {
        "easy": 2,
        "medium": 1,
        "hard": 1,
    }
    energies = [(p["episodes"], p["metrics"]["flight_energy_wh"]["mean"]) for p in entry["strata"].values()]
    whole = sum(n * mean for n, mean in energies) / 4
    assert entry["metrics"]["flight_energy_wh"]["mean"] == pytest.approx(whole)
    assert "easy" in (write_report(run)).read_text()


def test_a_missing_checkpoint_is_reported_but_is_no_crash(tmp_path, monkeypatch):
    import evaluation.rollouts as rollouts

    def missing(name, batch):
        raise CheckpointError("no such folder")

    monkeypatch.setattr(rollouts, "build_policy", missing)
    run = benchmark(tmp_path, ["ppo"], episodes=2)
    run.run()
    entry = json.loads((tmp_path / "results.json").read_text())["results"][0]
    assert entry["error"]["type"] == "CheckpointError"
    assert run.crashed == []


def test_an_interrupted_run_keeps_what_was_finished(tmp_path):
    run = benchmark(tmp_path, ["drift", "own_policies:Interrupting", "direct-flight"])
    with pytest.raises(KeyboardInterrupt):
        run.run()
    run.write()
    content = json.loads((tmp_path / "results.json").read_text())
    assert [entry["policy"] for entry in content["results"]] == ["drift"]
    assert content["manifest"]["complete"] is False
    assert "Not complete" in write_report(run).read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("how, status", [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_a_killed_run_loses_at_most_one_policy(tmp_path, how, status):
    command = [
        sys.executable, "evaluate.py", "--suite", "vortex", "--episodes", "2", "--output", str(tmp_path),
        "--policies", "direct-flight,drift,own_policies:Sleepy",
    ]  # fmt: skip
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(Path(__file__).parent)])}
    process = subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        path, found = tmp_path / "results.json", []
        for _ in range(1200):
            if path.exists():
                # Whole at every moment: this parses or the test fails.
                found = [entry["policy"] for entry in json.loads(path.read_text())["results"]]
            if len(found) == 2 or process.poll() is not None:
                break
            time.sleep(0.1)
        assert found == ["direct-flight", "drift"], process.communicate()[0]
        process.send_signal(how)
        # Less than the policy sleeps: Ctrl-C waits for nobody.
        assert process.wait(45) == status
        kept = json.loads(path.read_text())["results"]
        assert [entry["policy"] for entry in kept] == ["direct-flight", "drift"]
    finally:
        process.kill()
        process.wait()


def test_json_has_null_for_what_is_not_a_number(tmp_path):
    path = tmp_path / "x" / "y.json"
    write_json(
        path,
        {"a": [math.nan, np.float64("inf"), np.int64(3), (1.5, None)], "b": np.array([True]), "c": Path("z")},
    )
    assert json.loads(path.read_text()) == {"a": [None, None, 3, [1.5, None]], "b": [True], "c": "z"}
    assert [p.name for p in path.parent.iterdir()] == ["y.json"]

"""Sensor placement in the benchmark: its score, its suites, its part of the report, all tasks in one run."""

import json
import re

import numpy as np
import pytest

import evaluate
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from aquaquad_envs.tasks.sensor_placement_data import TEAM_LOST, TIME_OUT
from baselines import make_policy
from evaluation import figures, figures_team, scores_placement
from evaluation.benchmark import Benchmark
from evaluation.policies import policies_by_task, shipped_names
from evaluation.report import write_report
from evaluation.scores import References
from evaluation.suites import SUITES, find_suites, find_tasks
from evaluation.tables import TABLES

PLACEMENT = SUITES["sensor-placement"]


def results_with(rmse, coverage=None, lost=()):
    n = len(rmse)
    worlds = np.zeros(n, dtype=[("outcome", np.int64)])
    worlds["outcome"] = TIME_OUT
    worlds["outcome"][list(lost)] = TEAM_LOST
    nothing = np.full(n, np.nan)
    return EpisodeResults(
        seeds=np.arange(n), worlds=worlds, rewards=np.zeros(n), decisions=np.ones(n, dtype=int), planning_s=0.0,
        metrics={
            "tracking_rmse_m": np.array(rmse, dtype=float), "bound_rmse_m": np.full(n, 2.0),
            "coverage": nothing if coverage is None else np.array(coverage, dtype=float),
        },
    )  # fmt: skip


def test_the_score_runs_from_the_null_to_the_bound_in_ratios():
    references = References(null=np.full(4, 8.0), bound=np.full(4, 2.0))
    scores = scores_placement.scores_of(results_with([8.0, 2.0, 4.0, 32.0]), references)
    assert scores == pytest.approx([0.0, 1.0, 0.5, -1.0])


def test_the_mean_score_is_a_ratio_of_means():
    rng = np.random.default_rng(0)
    null, bound, value = np.exp(rng.normal([[3.0], [1.0], [1.4]], 0.3, (3, 50)))
    scores = scores_placement.scores_of(results_with(value), References(null=null, bound=bound))
    expected = np.log(null / value).mean() / np.log(null / bound).mean()
    assert scores.mean() == pytest.approx(expected)


def test_a_lost_team_scores_nothing_and_a_fence_is_scored_by_coverage():
    references = References(null=np.full(2, 8.0), bound=np.full(2, 2.0))
    results = results_with([2.0, 32.0], lost=(0, 1))
    assert scores_placement.scores_of(results, references) == pytest.approx([0.0, -1.0])
    assert scores_placement.metrics_of(results, references)["survived"].tolist() == [0, 0]
    fence = results_with([np.nan, np.nan], coverage=[0.2, 0.9])
    references = References(null=np.full(2, 0.2), bound=np.ones(2))
    assert scores_placement.scores_of(fence, references) == pytest.approx([0.0, 0.875])


def test_a_suite_on_which_null_and_bound_agree_has_no_score():
    references = References(null=np.full(2, 2.0), bound=np.full(2, 2.0))
    assert np.isnan(scores_placement.scores_of(results_with([2.0, 3.0]), references)).all()


def test_references_are_computed_on_the_same_seeds():
    seeds = np.array([3, 11])
    batch = make_world_batch("sensor-placement", 2, scenario="calm", horizon_s=3600.0)
    found = scores_placement.ReferenceSolver().solve(batch, seeds)
    held = rollout(make_policy("hold", batch), batch, seeds)
    assert np.array_equal(found.null, held.metrics["tracking_rmse_m"])
    assert (found.bound < held.metrics["bound_rmse_m"]).all()
    assert scores_placement.scores_of(held, found) == pytest.approx(0.0)


@pytest.mark.parametrize("suite", PLACEMENT, ids=lambda suite: suite.name)
def test_suites_make_worlds_and_keep_away_from_training(suite):
    seeds = suite.seeds(300, 99)
    assert len(set(seeds.tolist())) == 300 and seeds.min() >= 0 and seeds.max() < 1_000_000
    assert suite.params.get("field_seed", 0) == 0
    if suite.name != "file":
        batch = make_world_batch(suite.task, 1, **suite.params)
        n = int(suite.name[-1]) if suite.name.startswith("grid") else 4
        assert batch.num_agents == n


def test_names_choose_tasks():
    assert find_tasks(None) == list(SUITES) and find_tasks("drift-hop", ["fence"]) == ["drift-hop"]
    assert find_tasks(None, ["fence"]) == ["sensor-placement"] and find_tasks(None, ["gyres"]) == [
        "drift-hop"
    ]
    both = [(suite.task, suite.name) for suite in find_suites(None, ["vortex", "fence"])]
    assert both == [("drift-hop", "vortex"), ("sensor-placement", "fence")]
    with pytest.raises(InvalidParameterError, match="Did you mean 'fence'"):
        find_tasks(None, ["fense"])
    chosen = policies_by_task(list(SUITES), ["drift", "hold", "greedy"])
    assert chosen.pop("drift-hop") == ["drift", "greedy"]
    assert chosen.pop("sensor-placement") == ["drift", "hold"] and not any(chosen.values())
    assert policies_by_task(list(SUITES), [])["sensor-placement"] == shipped_names("sensor-placement")
    with pytest.raises(InvalidParameterError, match="Did you mean 'hold'"):
        policies_by_task(list(SUITES), ["hodl"])


def test_every_task_has_a_table_whose_metrics_exist():
    assert set(TABLES) == set(SUITES)
    for task, shown in TABLES.items():
        batch = make_world_batch(task, 1)
        known = {
            *batch.metrics(),
            "score",
            "optimality_gap",
            "survived",
            "rmse_over_bound",
            "below_bound",
            "reached_after",
        }
        assert {column.metric for column in shown.main} <= known
        assert {metric for _, metric, _ in shown.terminal} <= {column.metric for column in shown.main}
        assert {pairing.metric for pairing in shown.pairings} <= known


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    made = Benchmark(
        task="sensor-placement", suites=find_suites("sensor-placement", ["calm-tdoa", "fence", "grid-3x3"]),
        policies=["random", "hold", "hdop-optimal"], seed=0, output=tmp_path_factory.mktemp("placement"),
        arguments=[], episodes=2,
    )  # fmt: skip
    made.run()
    return made


def test_the_results_follow_the_schema(run):
    content = json.loads((run.output / "results.json").read_text())
    assert len(content["results"]) == 9 and not run.crashed
    for entry in content["results"]:
        assert entry["task"] == "sensor-placement"
        assert {
            "tracking_rmse_m",
            "mean_hdop",
            "flight_energy_wh",
            "nees",
            "bound_rmse_m",
            "coverage",
        } <= set(entry["metrics"])
        known = "coverage" if entry["suite"] == "fence" else "tracking_rmse_m"
        assert entry["metrics"][known]["mean"] is not None and len(entry["metrics"][known]["ci95"]) == 2
        # A mean over vehicles: how each ended.
        team = 3 if entry["suite"] == "grid-3x3" else 4
        assert sum(entry["outcomes"].values()) == 2 * team
    held = [entry for entry in content["results"] if entry["policy"] == "hold"]
    assert [entry["score"] for entry in held] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    pair = next(p for p in content["paired"] if (p["a"], p["b"]) == ("hold", "hdop-optimal"))
    assert pair["suite"] == "calm-tdoa" and pair["tracking_rmse_m"]["difference"] > 0
    assert content["suites"][0]["references"].keys() == {"null", "bound"}


def test_the_page_shows_what_each_suite_has(run):
    text = write_report(run).read_text(encoding="utf-8")
    tracked = text[text.index('id="calm-tdoa"') : text.index('id="fence"')]
    fenced = text[text.index('id="fence"') : text.index('id="grid-3x3"')]
    assert "RMSE over<br>its bound" in tracked and "<th>coverage</th>" not in tracked
    assert "<th>coverage</th>" in fenced and "RMSE over<br>its bound" not in fenced
    assert "Cramér–Rao" in text and "direct flight" not in text
    assert text.count('src="data:image/png;base64,') == 6
    assert not re.search(r"\bnan\b|\binf\b|None", re.sub(r"base64,[^\"]*", "", text))


def test_lost_teams_rank_last(run):
    part = run.runs[0]
    fake = type(part)(suite=part.suite, seeds=np.arange(3), strata=np.repeat("", 3))
    fake.metrics["p"] = {
        "tracking_rmse_m": np.array([1.0, 5.0, 4.0]), "coverage": np.full(3, np.nan),
        "survived": np.array([0.0, 1.0, 1.0]),
    }  # fmt: skip
    assert figures.best_and_median(fake, "p") == (2, 1)


def test_targets_are_drawn_where_they_went_whatever_the_team_did(run):
    part = run.runs[0]
    batch = make_world_batch("sensor-placement", 1, **part.suite.params)
    for name, results in part.runs.items():
        steps = int(results.decisions[0])
        track = figures_team.target_tracks(batch, int(part.seeds[0]), steps)
        end = [results.worlds["target_x"][0, 0], results.worlds["target_y"][0, 0]]
        assert track.shape == (steps + 1, 1, 2) and track[-1, 0] == pytest.approx(end), name


def test_the_ellipse_holds_95_percent():
    covariance = np.array([[9.0, 3.0], [3.0, 4.0]])
    curve = figures_team.ellipse(covariance)
    squares = np.einsum("ni,ij,nj->n", curve, np.linalg.inv(covariance), curve)
    assert squares == pytest.approx(-2.0 * np.log(0.05))


def test_all_tasks_in_one_run(tmp_path, capsys, quick_bound):
    arguments = ["--suite", "vortex,grid-3x3", "--policies", "drift,hold", "--episodes", "2"]
    assert evaluate.main([*arguments, "--output", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "drift-hop-vortex" in printed and "sensor-placement-grid-3x3" in printed
    content = json.loads((tmp_path / "results.json").read_text())
    played = [(entry["task"], entry["policy"]) for entry in content["results"]]
    assert played == [("drift-hop", "drift"), ("sensor-placement", "drift"), ("sensor-placement", "hold")]
    text = (tmp_path / "index.html").read_text()
    assert 'id="drift-hop-vortex"' in text and "Scores: sensor-placement" in text

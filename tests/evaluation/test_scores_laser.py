"""Laser tracking in the benchmark: its score, and its part of the report."""

import json

import numpy as np
import pytest

import evaluate
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import POLICIES, make_policy
from evaluation import scores_laser
from evaluation.policies import ABOUT
from evaluation.scores import References


def results_with(shares):
    count = len(shares)
    return EpisodeResults(
        seeds=np.arange(count), worlds=np.zeros(count), rewards=np.zeros(count), planning_s=0.0,
        decisions=np.ones(count, dtype=int),
        metrics={"time_in_lda": np.array(shares), "acquired": (np.array(shares) > 0).astype(float)},
    )  # fmt: skip


def test_the_score_runs_from_search_hold_to_the_true_centre():
    references = References(null=np.array([0.2, 0.4]), bound=np.array([0.8, 1.0]))
    assert scores_laser.scores_of(results_with([0.2, 0.4]), references) == pytest.approx([0.0, 0.0])
    assert scores_laser.scores_of(results_with([0.8, 1.0]), references) == pytest.approx([1.0, 1.0])
    assert scores_laser.scores_of(results_with([0.5, 0.1]), references) == pytest.approx([0.5, -0.5])
    same = References(null=np.ones(2), bound=np.ones(2))
    assert np.isnan(scores_laser.scores_of(results_with([0.5, 0.1]), same)).all()


def test_outcomes_count_who_found_the_light():
    assert scores_laser.outcomes_of(results_with([0.0, 0.3, 0.9]), None) == {
        "light found": 2,
        "never found": 1,
    }


def test_references_are_flown_on_the_same_seeds():
    seeds = np.array([3, 11])
    batch = make_world_batch("laser-tracking", 2, scenario="still", horizon_s=20.0)
    found = scores_laser.ReferenceSolver().solve(batch, seeds)
    for name, values in (("search-hold", found.null), ("true-center", found.bound)):
        assert np.array_equal(values, rollout(make_policy(name, batch), batch, seeds).metrics["time_in_lda"])
    assert (found.bound > found.null).all()


def test_every_policy_is_described():
    assert set(POLICIES["laser-tracking"]) <= set(ABOUT)


def test_the_benchmark_runs_and_reports(tmp_path):
    evaluate.main(
        ["--task", "laser-tracking", "--suite", "still", "--policies", "rov-tracking", "--episodes", "2",
         "--output", str(tmp_path)]
    )  # fmt: skip
    results = json.loads((tmp_path / "results.json").read_text())["results"]
    assert [(entry["task"], entry["policy"]) for entry in results] == [("laser-tracking", "rov-tracking")]
    assert 0.5 < results[0]["metrics"]["time_in_lda"]["mean"] <= 1.0
    assert 0.5 < results[0]["score"] < 1.2
    page = (tmp_path / "index.html").read_text()
    assert "in the LDA" in page and "0 is search-hold" in page
    assert "vehicle that holds its place" in page

"""Scores: 0 at direct flight, 1 at the bound, 0 for a failure; references are computed, not typed in."""

import numpy as np
import pytest

from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import make_policy
from evaluation.scores import References, ReferenceSolver, metrics_of, scores_of


def results_with(energy, success, saving=None):
    n = len(energy)
    return EpisodeResults(
        seeds=np.arange(n),
        worlds=np.zeros(n),
        metrics={
            "success": np.array(success, dtype=float),
            "flight_energy_wh": np.array(energy, dtype=float),
            "duration_s": np.full(n, 60.0),
        },
        rewards=np.zeros(n),
        decisions=np.ones(n, dtype=int),
        planning_s=0.0,
    )


def test_the_score_runs_from_the_null_to_the_bound():
    references = References(null=np.full(5, 50.0), bound=np.full(5, 20.0))
    results = results_with([50, 20, 35, 80, 5], [1, 1, 1, 1, 0])
    assert scores_of(results, references) == pytest.approx([0, 1, 0.5, -1, 0])


def test_episodes_that_tell_nothing_apart_are_left_out():
    references = References(
        null=np.array([50.0, 50.0, np.nan, 50.0]), bound=np.array([49.9, np.nan, 20.0, 0.0])
    )
    scores = scores_of(results_with([49.95, 30, 30, 25], [1, 1, 1, 1]), references)
    assert np.isnan(scores[:3]).all() and scores[3] == pytest.approx(0.5)


def test_metrics_of_the_way_taken_are_those_of_arrivals():
    references = References(null=np.full(3, 50.0), bound=np.array([20.0, 20.0, 0.0]))
    metrics = metrics_of(results_with([25, 0, 3], [1, 0, 1]), references)
    assert metrics["success"].tolist() == [1, 0, 1]
    assert metrics["flight_energy_wh"][0] == 25 and np.isnan(metrics["flight_energy_wh"][1])
    assert np.isnan(metrics["duration_s"][1])
    assert metrics["optimality_gap"][0] == pytest.approx(0.25)
    assert np.isnan(metrics["optimality_gap"][1:]).all(), "no arrival, and no relative gap to nothing"


def test_references_are_direct_flight_and_the_bound_on_the_same_seeds():
    seeds = np.array([3, 11, 3])
    batch = make_world_batch("drift-hop", 3, scenario="vortex-perturbed")
    found = ReferenceSolver().solve(batch, seeds)
    direct = rollout(make_policy("direct-flight", batch), batch, seeds)
    assert np.array_equal(found.null, direct.metrics["flight_energy_wh"])
    batch.reset(seeds)
    assert found.bound == pytest.approx(make_policy("optimal", batch).bound_wh())
    assert found.bound[0] == found.bound[2] != found.bound[1]
    assert scores_of(direct, found) == pytest.approx(0.0)
    best = rollout(make_policy("optimal", batch), batch, seeds)
    # Bound and policy differ by whole drift periods at most: a few per cent.
    assert scores_of(best, found) == pytest.approx(1.0, abs=0.05)


def test_equal_episodes_of_other_suites_share_a_bound(monkeypatch):
    solver = ReferenceSolver()
    seeds = np.array([5])
    kept = {}
    for scenario in ("vortex", "vortex-perturbed", "vortex"):
        batch = make_world_batch("drift-hop", 1, scenario=scenario)
        kept.setdefault(scenario, []).append((solver.solve(batch, seeds).bound[0], len(solver._bounds)))
    (first, after_first), (again, after_last) = kept["vortex"]
    assert (after_first, after_last) == (1, 2), "the second look must not solve again"
    assert first == again != kept["vortex-perturbed"][0][0]
    # Another vehicle is another episode.
    solver.solve(make_world_batch("drift-hop", 1, scenario="vortex", flight_power_w=340.0), seeds)
    assert len(solver._bounds) == 3

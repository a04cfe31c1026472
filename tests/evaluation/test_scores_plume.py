"""Plume tracing in the benchmark: the ends of its score, its table, its picture."""

import numpy as np
import pytest

from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import POLICIES, make_policy
from evaluation import scores_plume
from evaluation.figures_plume import draw_plume, plume_title
from evaluation.policies import about
from evaluation.scores import References
from evaluation.tables import TABLES

SHORT = {
    "scenario": "turbulent",
    "num_fields": 2,
    "num_robots": 4,
    "plume_age_s": 60.0,
    "horizon_updates": 90,
}


def results_with(updates, reached):
    n = len(updates)
    return EpisodeResults(
        seeds=np.arange(n), worlds=np.zeros(n), rewards=np.zeros(n), decisions=np.ones(n, dtype=int), planning_s=0.0,
        metrics={"updates_to_source": np.array(updates, dtype=float), "success": np.array(reached, dtype=float)},
    )  # fmt: skip


def test_the_mean_score_is_a_ratio_of_means():
    rng = np.random.default_rng(0)
    null, bound, value = rng.uniform([[200.0], [40.0], [60.0]], [[300.0], [80.0], [250.0]], (3, 40))
    scores = scores_plume.scores_of(results_with(value, np.ones(40)), References(null=null, bound=bound))
    assert scores.mean() == pytest.approx((null - value).mean() / (null - bound).mean())


def test_without_a_span_there_is_no_score():
    same = References(null=np.full(3, 50.0), bound=np.full(3, 50.0))
    assert np.isnan(scores_plume.scores_of(results_with([50, 50, 50], [0, 0, 0]), same)).all()


def test_updates_of_failures_are_not_taken_for_times():
    found = scores_plume.metrics_of(
        results_with([30, 50], [1, 0]), References(null=np.zeros(2), bound=np.zeros(2))
    )
    assert found["reached_after"][0] == 30 and np.isnan(found["reached_after"][1])


def test_both_ends_are_run_on_the_seeds_that_are_scored():
    seeds = np.arange(3)
    batch = make_world_batch("plume-tracing", 3, **SHORT)
    references = scores_plume.ReferenceSolver().solve(batch, seeds)
    for name, end in (("random", 0.0), ("straight-line", 1.0)):
        results = rollout(make_policy(name, batch), batch, seeds, tracks=True)
        assert scores_plume.scores_of(results, references).mean() == pytest.approx(end)
    assert results.metrics["success"].all()
    assert sum(scores_plume.outcomes_of(results, batch).values()) == 3

    from matplotlib.figure import Figure

    axis = Figure().subplots()
    draw_plume(axis, batch, results, 0)
    assert len(axis.lines) == 3 * batch.num_agents + 1 and len(axis.collections) == 1
    assert plume_title(results, 0).endswith(" updates")


def test_the_table_names_metrics_that_exist():
    table = TABLES["plume-tracing"]
    batch = make_world_batch("plume-tracing", 1, **SHORT)
    batch.reset(0)
    known = {*batch.metrics(), "reached_after", "score"}
    used = {column.metric for column in table.main} | {pairing.metric for pairing in table.pairings}
    used |= {metric for _, metric, _ in table.terminal} | {metric for metric, _ in table.rank}
    used |= {table.lasted, *table.shares, *table.robust, *(metric for metric, _ in table.distribution)}
    assert used <= known
    assert all(about(name) for name in POLICIES["plume-tracing"])

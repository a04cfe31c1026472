"""Score of transponder localization: its two ends, what it is made of, and the report."""

import numpy as np
import pytest

from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy
from baselines.known_transponders import KnownTransponders
from evaluation import scores_localization
from evaluation.benchmark import Benchmark
from evaluation.policies import about, find_policies, policies_by_task
from evaluation.report import write_report
from evaluation.scores import References
from evaluation.suites import Suite
from evaluation.tables import TABLES

SEEDS = np.arange(4)


@pytest.fixture(scope="module")
def references():
    batch = make_world_batch("transponder-localization", 4, scenario="random", num_measurements=10)
    return batch, scores_localization.ReferenceSolver().solve(batch, SEEDS)


def test_the_ends_are_random_and_the_known_trajectory(references):
    batch, ends = references
    null = rollout(make_policy("random", batch), batch, SEEDS)
    best = rollout(KnownTransponders(batch), batch, SEEDS)
    planned = rollout(make_policy("omlp-3", batch), batch, SEEDS)
    assert scores_localization.scores_of(null, ends) == pytest.approx(np.zeros(4), abs=1e-12)
    assert scores_localization.scores_of(best, ends).mean() == pytest.approx(1.0, abs=1e-9)
    assert 0.2 < scores_localization.scores_of(planned, ends).mean() < 1.0
    metrics = scores_localization.metrics_of(planned, ends)
    assert (metrics["survived"] == 1.0).all() and (metrics["below_bound"] > 0).all()
    assert sum(scores_localization.outcomes_of(planned, batch).values()) == 4


def test_a_wrong_estimate_scores_nothing(references):
    batch, ends = references
    found = rollout(make_policy("omlp-1", batch), batch, SEEDS)
    score = scores_localization.scores_of(found, ends)
    # Information at the estimates, however great, is not in it.
    found.metrics["log_det"] += 100.0
    assert np.array_equal(scores_localization.scores_of(found, ends), score)
    found.metrics["log_det_true"] += 1.0
    assert (scores_localization.scores_of(found, ends) > score).all()


def test_a_lost_vehicle_scores_nothing_at_most(references):
    batch, ends = references
    found = rollout(make_policy("omlp-3", batch), batch, SEEDS)
    found.worlds["outcome"][0] = batch.task.outcomes.index("left box")
    assert scores_localization.scores_of(found, ends)[0] <= 0.0
    assert scores_localization.metrics_of(found, ends)["survived"].tolist() == [0.0, 1.0, 1.0, 1.0]
    same = References(null=ends.null, bound=ends.null)
    assert np.isnan(scores_localization.scores_of(found, same)[1:]).all()


def test_names_with_a_number_are_policies_everywhere():
    task = "transponder-localization"
    assert find_policies(task, ["omlp-7", "random"]) == ["omlp-7", "random"]
    assert policies_by_task(["drift-hop", task], ["omlp-4", "direct-flight"]) == {
        "drift-hop": ["direct-flight"], task: ["omlp-4"],
    }  # fmt: skip
    assert "7 steps" in about("omlp-7") and "1 step" in about("omlp-1").replace("the step", "1 step")
    with pytest.raises(ValueError, match="omlp"):
        find_policies(task, ["omlp-"])


def test_the_report_shows_it(tmp_path):
    suite = Suite(
        task="transponder-localization", name="single", about="the published transponder", episodes=3,
        params={"scenario": "single", "num_measurements": 8},
    )  # fmt: skip
    run = Benchmark(
        task=suite.task, suites=[suite], policies=["random", "omlp-2"], seed=0, output=tmp_path, arguments=[]
    )
    run.run()
    assert not run.crashed, run.crashed
    entries = {entry["policy"]: entry for entry in run.results()["results"]}
    assert entries["random"]["score"] == pytest.approx(0.0, abs=1e-12) and 0 < entries["omlp-2"]["score"] <= 1
    for column in TABLES[suite.task].main:
        assert column.metric == "score" or column.metric in entries["random"]["metrics"], column.metric
    page = write_report(run).read_text(encoding="utf-8")
    assert "omlp-2" in page and page.count("data:image/png") >= 2 and "random" in page

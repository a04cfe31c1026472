"""Suites: frozen seeds that training never uses, strata, and clear refusals."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from evaluation import strata, suites
from evaluation.policies import find_policies
from evaluation.suites import MOST_SEEDS, SEEDS_EACH, STRATA, SUITES, find_suites, frozen_strata

ALL = SUITES["drift-hop"]
#: Below this no training or validation seed lies (agents/recipes.py).
FIRST_SEED_OF_TRAINING = 1_000_000


@pytest.mark.parametrize("suite", ALL, ids=lambda suite: suite.name)
def test_seeds_are_distinct_repeatable_and_not_of_training(suite):
    for seed in (0, MOST_SEEDS - 1):
        seeds = suite.seeds(300, seed)
        assert len(set(seeds.tolist())) == 300
        assert np.array_equal(seeds, suite.seeds(300, seed))
        assert seeds.min() >= 0 and seeds.max() < FIRST_SEED_OF_TRAINING
        assert suite.params.get("field_seed", 0) == 0


def test_training_keeps_away_from_the_suites():
    recipes = pytest.importorskip("agents.recipes")
    assert min(recipes.VALIDATION_SEED, recipes.FIRST_TRAINING_SEED) >= FIRST_SEED_OF_TRAINING
    for scenario in ("vortex", "gyres"):
        assert recipes.make_recipe("drift-hop", scenario, "ppo").params.get("field_seed") != 0 or (
            scenario == "vortex"
        )


@pytest.mark.parametrize("suite", [s for s in ALL if not s.stratified], ids=lambda suite: suite.name)
def test_other_seed_sets_are_disjoint_and_more_episodes_begin_with_fewer(suite):
    assert not set(suite.seeds(SEEDS_EACH, 0)) & set(suite.seeds(SEEDS_EACH, 1))
    assert np.array_equal(suite.seeds(50, 3), suite.seeds(80, 3)[:50])


def test_strata_are_equal_parts_and_disjoint():
    frozen = frozen_strata()
    everything = [seed for name in STRATA for seed in frozen[name]]
    assert len(everything) == len(set(everything)) == strata.CANDIDATES
    assert len({len(frozen[name]) for name in STRATA}) == 1
    suite = next(s for s in ALL if s.name == "gyres")
    parts = suite.strata_seeds(91, 0)
    assert [len(parts[name]) for name in STRATA] == [31, 30, 30]
    assert all(set(parts[name]) <= set(frozen[name]) for name in STRATA)
    other = suite.strata_seeds(90, 1)
    assert all(set(other[name]) <= set(frozen[name]) for name in STRATA)
    assert set(other["easy"]) != set(parts["easy"])
    with pytest.raises(InvalidParameterError, match="at most 1200"):
        suite.seeds(1201, 0)


def test_the_forecast_suite_has_the_episodes_of_gyres():
    by_name = {suite.name: suite for suite in ALL}
    assert np.array_equal(by_name["gyres"].seeds(60, 0), by_name["forecast-error"].seeds(60, 0))


def test_splitting_by_difficulty():
    difficulty = np.array([0.5, np.inf, 0.1, 0.9, 0.2, 0.3])
    assert [part.tolist() for part in strata.split(difficulty)] == [[2, 4], [0, 5], [1, 3]]


def test_the_frozen_strata_are_those_of_the_baseline():
    """The baseline itself, on a few seeds of the outer thirds."""
    from evaluation.rollouts import Workers, run_policy

    made = json.loads((Path(suites.__file__).with_name(suites.STRATA_FILE)).read_text())
    suite = next(s for s in ALL if s.name == "gyres")
    for name, side in (("easy", -1), ("hard", 1)):
        seeds = np.array(made["seeds"][name][:3])
        results, _ = run_policy(suite, made["baseline"], seeds, Workers(1), lambda n: None)
        ratio = np.where(results.metrics["success"] == 1, 1 - results.metrics["saving_vs_direct"], np.inf)
        bound = made["terciles"][0 if side < 0 else 1]
        # Improvements of the planner move energies a little: a tenth of the bound is forgiven.
        assert (side * (ratio - bound) > -0.1 * bound).all(), (name, ratio, bound)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: find_suites("drift-hop", ["gyre"]), "Did you mean 'gyres'"),
        (lambda: find_suites("drift-hopp"), "Did you mean 'drift-hop'"),
        (lambda: find_suites("drift-hop", ["file"]), "NetCDF"),
        (lambda: find_suites("drift-hop", currents=[Path("nowhere.nc")]), "nowhere.nc"),
        (lambda: find_suites("drift-hop", center=(1.0, 2.0)), "currents"),
        (lambda: find_policies("drift-hop", ["dr-rrt"]), "Did you mean 'dr-rrt-star'"),
        (lambda: find_policies("drift-hop", ["optimal=there"]), "only ppo"),
        (lambda: find_policies("drift-hop", ["ppo=nowhere"]), "no folder 'nowhere'"),
        (lambda: find_policies("drift-hop", ["nowhere:Policy"]), "MODULE:CLASS"),
        (lambda: ALL[0].seeds(0, 0), r"episodes: got 0, expected a number in \[1"),
        (lambda: ALL[0].seeds(5, -1), "seed: got -1"),
        (lambda: ALL[0].seeds(5, MOST_SEEDS), "seed: got 100"),
    ],
)
def test_what_cannot_be_is_refused_by_name(call, message):
    with pytest.raises(AquaQuadError, match=message):
        call()


def test_currents_bring_the_file_suite_along(tmp_path):
    path = tmp_path / "sea.nc"
    path.write_bytes(b"not a file of currents")
    names = [suite.name for suite in find_suites("drift-hop")]
    assert names == ["vortex", "vortex-perturbed", "gyres", "forecast-error"]
    found = find_suites("drift-hop", currents=[path], center=(36.0, -122.0))
    assert [suite.name for suite in found] == [*names, "file"]
    assert found[-1].params["currents_file"] == str(path)
    assert found[-1].params["currents_center"] == (36.0, -122.0)
    assert "currents_file" not in ALL[-1].params, "the frozen suite must stay as it is"
    with pytest.raises(dataclasses.FrozenInstanceError):
        ALL[0].episodes = 3

"""The bound: better than every policy, not above what no trajectory can pass, followed as planned."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy
from baselines.known_transponders import KnownTransponders

SEEDS = np.arange(3)


def make(scenario, num_worlds=3, **params):
    return aquaquad_envs.make_world_batch(
        "transponder-localization", num_worlds, scenario=scenario, **({"num_measurements": 12} | params)
    )


def most(params, ranges):
    """Σ ln det of one transponder whose information is spread evenly over the three directions: none has more."""
    prior = 1.0 / np.square(params.prior_std_m)
    return 3.0 * np.log((prior.sum() + ranges / params.range_std_m**2) / 3.0)


@pytest.mark.parametrize(
    "scenario, params",
    [
        ("random", {}), ("single", {"vehicle": "greedy"}), ("four", {}), ("current", {}),
        ("deep", {"vehicle": "aquaquad"}),
    ],
)  # fmt: skip
def test_no_policy_passes_it(scenario, params):
    batch = make(scenario, **params)
    bound = KnownTransponders(batch)
    best = rollout(bound, batch, SEEDS)
    # Fences apart, which are for the planner alone, it gets what it planned.
    assert (best.metrics["log_det_true"] >= bound.values - 0.02 * abs(bound.values)).all()
    if scenario in ("random", "single", "four"):
        assert best.metrics["log_det_true"] == pytest.approx(bound.values, abs=1e-3)
    ceiling = best.worlds["num_transponders"] * most(batch.params, 12)
    assert (best.metrics["log_det_true"] <= ceiling).all() and (bound.spread >= 0).all()
    for name in ("random", "omlp-1", "omlp-3"):
        other = rollout(make_policy(name, batch), batch, SEEDS)
        assert (other.metrics["log_det_true"] <= best.metrics["log_det_true"] + 1e-6).all()
    assert (best.worlds["outcome"] == batch.task.outcomes.index("time out")).all()


def test_two_steps_are_the_best_of_a_fine_grid():
    batch = make("four", 1, num_measurements=3)
    bound = KnownTransponders(batch)
    batch.reset([0])
    bound.act(batch.observations, batch.worlds)
    grid = np.linspace(-1.0, 1.0, 41)
    pairs = np.stack(np.meshgrid(grid, grid, indexing="ij"), -1).reshape(-1, 2).astype(np.float32)
    tries = make("four", len(pairs), num_measurements=3)
    tries.reset(np.zeros(len(pairs), dtype=int))
    for j in range(2):
        tries.step(pairs[:, j : j + 1])
    found = tries.metrics()["log_det_true"].max()
    assert bound.values[0] >= found - 1e-9
    assert bound.values[0] == pytest.approx(found, abs=0.02)


def test_equal_problems_are_solved_once_and_the_plan_depends_on_nothing_else():
    memory: dict[bytes, tuple[np.ndarray, float, float]] = {}
    batch = make("single")
    policy = KnownTransponders(batch, memory=memory)
    rollout(policy, batch, SEEDS)
    assert len(memory) == 1 and np.array_equal(policy.plans[0], policy.plans[2])
    several = make("random")
    together = KnownTransponders(several, memory=memory)
    rollout(together, several, SEEDS)
    assert len(memory) == 4
    alone = make("random", 1)
    single = KnownTransponders(alone)
    rollout(single, alone, SEEDS[2:])
    assert np.array_equal(single.plans[0], together.plans[2])


def test_it_refuses_what_it_cannot_plan_for():
    with pytest.raises(InvalidParameterError, match="continuous"):
        KnownTransponders(make("single", action_type="discrete"))
    with pytest.raises(InvalidParameterError, match="task"):
        KnownTransponders(aquaquad_envs.make_world_batch("drift-hop", 1))
    with pytest.raises(InvalidParameterError, match="shakes"):
        KnownTransponders(make("single"), shakes=-1)

"""MAPPO: the critic sees the world, the actor its own observation, and only the actor is stored."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from agents.learned import LearnedPolicy  # noqa: E402
from agents.recipes import make_recipe  # noqa: E402
from agents.training import build, train  # noqa: E402
from aquaquad_envs.tasks.batch import make_world_batch  # noqa: E402
from aquaquad_envs.tasks.rollout import rollout  # noqa: E402


def tiny(algorithm="mappo", **overrides):
    recipe = make_recipe("sensor-placement", "calm", algorithm)
    settings = {**recipe.algorithm_settings, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    values = {
        "num_worlds": 4, "variants": ({},), "hidden": (16, 16), "imitation_rounds": 0, "value_warmup_frames": 0,
        "checkpoint_every": 10_000, "evaluate_every": 10_000, "evaluation_episodes": 3,
        "algorithm_settings": settings,
        "params": {**recipe.params, "horizon_s": 3600.0}, "validation": {**recipe.validation, "horizon_s": 3600.0},
    }  # fmt: skip
    return dataclasses.replace(recipe, **{**values, **overrides})


def test_rows_carry_their_worlds_view():
    env = build(tiny(), seed=0, threads=1, log_folder=None).env
    size, seen = env.batch.observations.shape[-1], env.reset()
    agents = env.batch.num_agents
    assert (
        seen.shape == (4 * agents, size + env.batch.state_size)
        and env.observation_space.shape == seen.shape[1:]
    )
    np.testing.assert_array_equal(seen[:, size:], np.repeat(env.batch.state(), agents, axis=0))
    for _ in range(30):
        before = seen
        seen, _, done, infos = env.step(np.zeros((4 * agents, 2), np.float32))
        assert env.observation_space.contains(seen[0]) and np.abs(seen).max() <= np.sqrt(2)
        if done.any():
            break
    rows = np.flatnonzero(done)
    assert len(rows), "no episode ended: nothing of the ends was seen"
    for row in rows:
        last = infos[row]["terminal_observation"]
        np.testing.assert_array_equal(last[size:], before[row, size:])
        assert last.shape == seen[row].shape


def test_only_the_critic_sees_it():
    model = build(tiny(), seed=0, threads=1, log_folder=None)
    observations = torch.from_numpy(model.env.reset())
    size = model.env.batch.observations.shape[-1]
    other = observations.clone()
    other[:, size:] += 0.3
    policy = model.policy
    for deterministic in (True, False):
        torch.manual_seed(0)
        action, value, _ = policy(observations, deterministic=deterministic)
        torch.manual_seed(0)
        same, moved, _ = policy(other, deterministic=deterministic)
        assert torch.equal(action, same) and not torch.allclose(value, moved)
    changed = observations.clone()
    changed[:, : size // 2] += 0.3
    assert not torch.allclose(
        policy.get_distribution(changed).mode(), policy.get_distribution(observations).mode()
    )


@pytest.mark.parametrize("algorithm", ["ppo", "mappo"])
def test_a_trained_team_flies_at_any_size(algorithm, tmp_path):
    card = train(tiny(algorithm), steps=300, seed=0, output=tmp_path, quiet=True)
    assert (
        card["algorithm"] == algorithm and card["frame"] == "goal" and np.isfinite(card["results"]["score"])
    )
    for vehicles in (3, 5, 8):
        batch = make_world_batch(
            "sensor-placement", 2, scenario="calm", num_vehicles=vehicles, horizon_s=1800.0
        )
        policy = LearnedPolicy(batch, checkpoint=tmp_path / "policy")
        result = rollout(policy, batch, [0, 1])
        assert result.decisions.min() > 0
        batch.reset(0)
        together = policy.act(batch.observations, batch.worlds)
        assert together.shape == (2, vehicles, 2)
        np.testing.assert_array_equal(policy.act(batch.observations[:1], batch.worlds[:1]), together[:1])

"""Stable-Baselines3's view: the behaviour that its algorithms rely on."""

import gymnasium
import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.tasks.task import TASKS

SINGLE = [name for name, (_, agents, _) in TASKS.items() if agents == "single"]
SHORT = {
    "drift-hop": {"horizon_s": 600.0, "scenario": "vortex-perturbed"},
    "transponder-localization": {
        "scenario": "deep", "vehicle": "aquaquad", "num_fields": 2, "solar": "constant", "half_width_m": 2000.0,
        "spread_m": 1000.0, "num_measurements": 4,
    },
    "laser-tracking": {"horizon_s": 0.1},
}  # fmt: skip


def make(task="drift-hop", worlds=4, **params):
    return aquaquad_envs.sb3_vec_env(task, worlds, **{**SHORT.get(task, {}), **params})


def sample(env, rng):
    space = env.action_space
    if isinstance(space, gymnasium.spaces.Discrete):
        return rng.integers(0, space.n, env.num_envs)
    return rng.uniform(-1, 1, (env.num_envs, *space.shape)).astype(np.float32)


@pytest.mark.parametrize("task", SINGLE)
def test_shapes_dtypes_and_ends(task):
    env, rng = make(task), np.random.default_rng(0)
    env.seed(0)
    obs = env.reset()
    returns, lengths, ends = np.zeros(4), np.zeros(4, int), {"terminated": 0, "truncated": 0}
    for _ in range(200):
        kept = obs.copy()
        new, rewards, done, infos = env.step(sample(env, rng))
        assert new.shape == (4, *env.observation_space.shape) and new.dtype == np.float32
        assert rewards.shape == (4,) and rewards.dtype == np.float32
        assert done.shape == (4,) and done.dtype == bool and len(infos) == 4
        assert np.array_equal(obs, kept) and not np.shares_memory(obs, new), (
            "an earlier return was written to"
        )
        obs = new
        returns += env.batch.rewards
        lengths += 1
        for i in range(4):
            assert ("terminal_observation" in infos[i]) == done[i] == ("episode" in infos[i])
            if done[i]:
                assert infos[i]["terminal_observation"] in env.observation_space
                assert infos[i]["episode"]["r"] == pytest.approx(returns[i])
                assert infos[i]["episode"]["l"] == lengths[i]
                ends["truncated" if infos[i]["TimeLimit.truncated"] else "terminated"] += 1
                assert infos[i]["TimeLimit.truncated"] == (infos[i]["outcome"] == "time out")
                returns[i], lengths[i] = 0.0, 0
    kinds = {"truncated" if name == "time out" else "terminated" for name in env.batch.task.outcomes[1:]}
    assert min(ends[kind] for kind in kinds) > 0, ends


def test_seeds_count_up_and_streams_go_on():
    env, again = make(), make()
    env.seed(7)
    again.seed(7)
    first = env.reset()
    assert np.array_equal(first, again.reset())
    assert not np.array_equal(first, env.reset()), "a reset without a new seed must draw on"
    alone = aquaquad_envs.make_world_batch("drift-hop", 1, **SHORT["drift-hop"])
    for i in range(4):
        assert np.array_equal(alone.reset([7 + i])[0], first[i])


def test_attributes():
    env = make()
    assert env.get_attr("num_worlds") == [4] * 4
    assert env.get_attr("params", indices=[1])[0].horizon_s == 600.0
    assert env.get_attr("render_mode") == [None] * 4
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 4
    with pytest.raises(AttributeError, match="share their parameters"):
        env.set_attr("params", None)
    with pytest.raises(AttributeError, match="not Python objects"):
        env.env_method("reset")
    with pytest.raises(AttributeError):
        env.get_attr("nothing_of_that_name")
    env.close()


@pytest.mark.parametrize("task", SINGLE)
def test_wrappers_and_ppo_work_on_it(task):
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    env = VecNormalize(VecMonitor(make(task, 8)))
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=64, n_epochs=1, seed=0, device="cpu")
    model.learn(256)
    assert model.num_timesteps == 256
    assert len(model.ep_info_buffer) > 0


def test_ppo_is_reproducible():
    from stable_baselines3 import PPO

    weights = []
    for _ in range(2):
        model = PPO("MlpPolicy", make(worlds=8), n_steps=16, batch_size=64, n_epochs=1, seed=3, device="cpu")
        model.learn(128)
        weights.append([p.detach().numpy().copy() for p in model.policy.parameters()])
    assert all(np.array_equal(a, b) for a, b in zip(*weights, strict=True))

"""The PettingZoo view: its own checkers, and the very episode of the other interfaces."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("pettingzoo")
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from pettingzoo.utils import parallel_to_aec

from aquaquad_envs.errors import InvalidActionError
from aquaquad_envs.interfaces.pettingzoo import WorldParallelEnv
from aquaquad_envs.tasks.task import TASKS


@pytest.fixture(params=list(TASKS))
def task(request):
    return request.param


def test_parallel_api(task):
    parallel_api_test(WorldParallelEnv(task), num_cycles=300)


def test_aec_api(task):
    api_test(parallel_to_aec(WorldParallelEnv(task)), num_cycles=100)


def test_seed(task):
    parallel_seed_test(lambda: WorldParallelEnv(task), num_cycles=20)


def test_whole_episode_equals_gymnasium(task):
    parallel = WorldParallelEnv(task, scenario="vortex-perturbed")
    single = gymnasium.make(TASKS[task][0], scenario="vortex-perturbed")
    observations, _ = parallel.reset(seed=11)
    observation, _ = single.reset(seed=11)
    rng = np.random.default_rng(0)
    ended = False
    while not ended:
        np.testing.assert_array_equal(observations["vehicle_0"], observation)
        assert parallel.observation_space("vehicle_0").contains(observation)
        action = rng.uniform(-0.3, 0.3, 2).astype(np.float32)
        observations, rewards, terminated, truncated, infos = parallel.step({"vehicle_0": action})
        observation, reward, end, stop, info = single.step(action)
        assert (rewards["vehicle_0"], terminated["vehicle_0"], truncated["vehicle_0"]) == (reward, end, stop)
        assert infos["vehicle_0"]["reward_terms"] == info["reward_terms"]
        ended = end or stop
    assert parallel.agents == []
    assert infos["vehicle_0"]["outcome"] == info["outcome"] != "running"
    assert parallel.step({}) == ({}, {}, {}, {}, {})


def test_state_and_render(task):
    env = WorldParallelEnv(task, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.state_space.contains(env.state())
    frame = env.render()
    assert frame.ndim == 3 and frame.dtype == np.uint8
    env.close()


def test_a_missing_action_is_named(task):
    env = WorldParallelEnv(task)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="vehicle_0"):
        env.step({})

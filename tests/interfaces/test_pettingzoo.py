"""The PettingZoo view: its own checkers, the very episodes of the other interfaces, agents that end one by one."""

import pickle
import re
import warnings
from contextlib import contextmanager
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

pytest.importorskip("pettingzoo")
import pettingzoo
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, render_test, seed_test
from pettingzoo.test.max_cycles_test import max_cycles_test
from pettingzoo.test.state_test import state_test
from pettingzoo.utils import parallel_to_aec

from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from aquaquad_envs.interfaces.gymnasium import WorldEnv
from aquaquad_envs.interfaces.pettingzoo import WorldParallelEnv
from aquaquad_envs.interfaces.vector import WorldVectorEnv
from aquaquad_envs.tasks.task import TASKS
from tests.interfaces.teams import SHORT, TEAMS, TOGETHER, list_toy
from tests.interfaces.toy_team import NAME as TOY

SINGLE = [name for name, (_, agents, _) in TASKS.items() if agents == "single"]


@pytest.fixture(autouse=True)
def toy_is_listed(monkeypatch):
    list_toy(monkeypatch)


@pytest.fixture(params=[*SINGLE, *TEAMS])
def task(request):
    return request.param


@pytest.fixture(params=TEAMS)
def team(request):
    return request.param


@contextmanager
def strict():
    """What the checkers only warn of is an error here."""
    with warnings.catch_warnings():
        warnings.filterwarnings("error", module="pettingzoo")
        # An agent that is out sees zeros: those are meant.
        warnings.filterwarnings("ignore", message=".*all zeros.*")
        yield


@pytest.fixture
def screen(monkeypatch):
    """A screen that nobody looks at."""
    pygame = pytest.importorskip("pygame")
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def make(task, **params):
    return WorldParallelEnv(task, **{**SHORT.get(task, {}), **params})


def test_parallel_api(task):
    with strict():
        parallel_api_test(WorldParallelEnv(task), num_cycles=300)
        parallel_api_test(make(task), num_cycles=300)


def test_aec_api(task):
    with strict():
        api_test(parallel_to_aec(WorldParallelEnv(task)), num_cycles=100)
        api_test(parallel_to_aec(make(task)), num_cycles=100)


def test_seed(task):
    parallel_seed_test(lambda: WorldParallelEnv(task), num_cycles=20)
    seed_test(lambda: parallel_to_aec(make(task)), num_cycles=20)


def test_state(task):
    with strict():
        state_test(parallel_to_aec(make(task)), make(task), num_cycles=20)


def test_max_cycles(task):
    def parallel_env(**options):
        env = WorldParallelEnv(task, **options)
        env.reset(seed=0)  # the checker resets and samples without a seed: its episode goes on from here
        seed_spaces(env, 0)
        return env

    max_cycles_test(
        SimpleNamespace(
            parallel_env=parallel_env, env=lambda **options: parallel_to_aec(parallel_env(**options))
        )
    )


def test_render(task, screen):
    render_test(lambda render_mode: parallel_to_aec(make(task, render_mode=render_mode)))


def test_pictures_follow_the_world(task):
    pytest.importorskip("pygame")
    env = make(task, render_mode="rgb_array")
    seed_spaces(env, 0)
    env.reset(seed=0)
    frame = env.render()
    assert np.array_equal(frame, env.render())
    env.step(sampled(env))
    assert not np.array_equal(frame, env.render())
    env.close()
    assert make(task).render() is None


def test_registered_teams_are_made_by_id():
    registered = {env_id for env_id in pettingzoo.parallel_registry if env_id.startswith("AquaQuad/")}
    assert registered == {TASKS[name][0] for name in TEAMS if name != TOY}


@pytest.mark.parametrize("name", [name for name in TEAMS if name != TOY])
def test_make_by_id(name):
    env_id = TASKS[name][0]
    env = pettingzoo.make("parallel", env_id, max_cycles=3)
    assert isinstance(env, WorldParallelEnv) and env.max_cycles == 3
    assert pettingzoo.spec("parallel", env_id).version == 0
    assert pettingzoo.spec("parallel", env_id).make(**SHORT[name]).view.batch.task.name == name
    with pytest.raises(InvalidParameterError, match="expected a parameter of"):
        pettingzoo.make("parallel", env_id, nonsense=1)


def sampled(env, scale=1.0):
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    return {agent: action * scale for agent, action in actions.items()} if scale != 1.0 else actions


def seed_spaces(env, seed):
    for k, agent in enumerate(env.possible_agents):
        env.action_space(agent).seed(seed + k)


def whole_episode(env, seed):
    """Everything that an episode returns, with the central view of each step."""
    seed_spaces(env, seed)
    log = [env.reset(seed=seed), env.state()]
    while env.agents:
        log += [env.step(sampled(env)), env.state()]
    return log


def test_whole_episodes_repeat(task):
    env, other = make(task), make(task)
    first = whole_episode(env, 3)
    for again in (whole_episode(other, 3), whole_episode(env, 3)):
        assert str(first) == str(again)
        assert len(first) == len(again) > 3
        assert all(np.array_equal(a, b) for a, b in zip(first[1::2], again[1::2], strict=True))
    assert str(whole_episode(env, 4)) != str(first)


def test_agents_leave_one_by_one(team):
    """Every return has exactly the agents that were alive before; who is done is gone from then on."""
    env = make(team)
    terms = env.view.batch.task.reward_terms
    left_early = 0
    for seed in range(6):
        seed_spaces(env, seed)
        observations, infos = env.reset(seed=seed)
        assert env.agents == env.possible_agents == list(observations) == list(infos)
        assert env.num_agents == env.max_num_agents == env.view.batch.num_agents
        assert all(info == {"outcome": "running"} for info in infos.values())
        for _ in range(1000):
            before = list(env.agents)
            returned = env.step(sampled(env))
            observations, rewards, terminated, truncated, infos = returned
            assert all(list(each) == before for each in returned)
            done = {agent for agent in before if terminated[agent] or truncated[agent]}
            assert env.agents == [agent for agent in before if agent not in done]
            for agent in before:
                assert observations[agent] in env.observation_space(agent)
                assert type(rewards[agent]) is float
                assert type(terminated[agent]) is bool is type(truncated[agent])
                info = infos[agent]
                assert tuple(info["reward_terms"]) == terms
                assert sum(info["reward_terms"].values()) == pytest.approx(rewards[agent], abs=1e-12)
                assert (info["outcome"] == "running") == (agent not in done)
                assert (info["team_outcome"] == "running") == bool(env.agents) == ("metrics" not in info)
                assert info["alive"] == [other for other in env.agents if other != agent]
            assert env.state() in env.state_space
            left_early += len(done) if env.agents else 0
            if not env.agents:
                break
        assert not env.agents
        assert all(set(info["metrics"]) == set(env.view.batch.metrics()) for info in infos.values())
        assert env.step({}) == ({}, {}, {}, {}, {})
    assert (left_early > 0) != (team in TOGETHER), (
        f"{team}: all agents ended with their worlds; make some end earlier in SHORT"
    )


def test_whole_episode_equals_gymnasium():
    parallel = WorldParallelEnv("drift-hop", scenario="vortex-perturbed")
    single = gymnasium.make("AquaQuad/DriftHop-v0", scenario="vortex-perturbed")
    observations, _ = parallel.reset(seed=11)
    observation, _ = single.reset(seed=11)
    rng = np.random.default_rng(0)
    ended = False
    while not ended:
        np.testing.assert_array_equal(observations["vehicle_0"], observation)
        np.testing.assert_array_equal(parallel.state(), observation)
        assert parallel.observation_space("vehicle_0").contains(observation)
        action = rng.uniform(-0.3, 0.3, 2).astype(np.float32)
        observations, rewards, terminated, truncated, infos = parallel.step({"vehicle_0": action})
        observation, reward, end, stop, info = single.step(action)
        assert (rewards["vehicle_0"], terminated["vehicle_0"], truncated["vehicle_0"]) == (reward, end, stop)
        assert infos["vehicle_0"] == info
        ended = end or stop
    assert parallel.agents == []
    assert infos["vehicle_0"]["outcome"] == info["outcome"] != "running"
    assert parallel.step({}) == ({}, {}, {}, {}, {})


def test_max_cycles_cut_whoever_is_left(task):
    env, plain = WorldParallelEnv(task, max_cycles=2), WorldParallelEnv(task)
    for each in (env, plain):
        seed_spaces(each, 0)
        each.reset(seed=0)
    cut = [env.step(sampled(env, 0.1)) for _ in range(2)][1]
    going_on = [plain.step(sampled(plain, 0.1)) for _ in range(2)][1]
    assert plain.agents and not env.agents
    assert all(cut[3].values()) and not any(cut[2].values()) and not any(going_on[3].values())
    assert str(cut[:3]) == str(going_on[:3])
    assert all(set(info["metrics"]) == set(env.view.batch.metrics()) for info in cut[4].values())
    env.reset()
    env.step(sampled(env, 0.1))
    assert env.agents == env.possible_agents, "the count begins anew"


@pytest.mark.parametrize("max_cycles", [0, -1, 1.5, True, "4"])
def test_bad_max_cycles_are_refused(max_cycles):
    with pytest.raises(InvalidParameterError, match="max_cycles: got"):
        WorldParallelEnv(TOY, max_cycles=max_cycles)


def test_a_missing_action_is_named(task):
    env = WorldParallelEnv(task)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match=re.escape(env.possible_agents[0])):
        env.step({})


BAD = {
    "NaN": np.array([np.nan, 0.0]), "infinity": [np.inf, 0.0], "short": np.zeros(0), "long": np.zeros(9),
    "batched": np.zeros((1, 2)), "scalar": 0.5, "objects": np.zeros(2, object), "none": None,
    "strings": np.array(["a", "b"]), "complex": np.zeros(2, complex), "bool": np.zeros(2, bool),
    "ragged": [[1.0], 2.0], "dict": {"x": 1},
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_action_is_named_and_nothing_moves(task, name):
    """One bad action among good ones: the agent is named and the world untouched."""
    env = make(task)
    env.reset(seed=0)
    agent = env.possible_agents[-1]
    before, cycles = env.view.batch.snapshot(), env.cycles
    with pytest.raises(InvalidActionError, match="action: got") as error:
        env.step({**sampled(env), agent: BAD[name]})
    assert task in SINGLE or agent in str(error.value)
    assert env.view.batch.worlds.tobytes() == before.tobytes() and env.cycles == cycles
    env.step(sampled(env))
    assert env.cycles == 1


@pytest.mark.parametrize("index", [3.0, np.float64(1), -1, 5, True, None, "1", np.array([1]), 2**70, np.nan])
def test_a_bad_index_is_refused_and_nothing_moves(index):
    env = make(TOY, action_type="discrete")
    env.reset(seed=0)
    before = env.view.batch.snapshot()
    with pytest.raises(InvalidActionError, match="action: got"):
        env.step({**sampled(env), "drifter_1": index})
    assert env.view.batch.worlds.tobytes() == before.tobytes()
    env.step({**sampled(env), "drifter_1": 4})


@pytest.mark.parametrize("actions", [None, [0.0, 0.0], np.zeros((3, 2)), "drift"])
def test_actions_must_be_a_dict(task, actions):
    env = WorldParallelEnv(task)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="expected a dict"):
        env.step(actions)


def test_actions_of_agents_that_have_left_are_ignored(team):
    env, other = make(team), make(team)
    for each in (env, other):
        seed_spaces(each, 1)
        each.reset(seed=1)
    while env.agents:
        actions = sampled(env)
        gone = {agent: np.full(7, np.nan) for agent in env.possible_agents if agent not in env.agents}
        assert str(env.step(actions)) == str(other.step({**actions, **gone}))


def test_returns_are_not_written_to_later(task):
    env = make(task)
    seed_spaces(env, 0)
    kept, _ = env.reset(seed=0)
    state = env.state()
    copies = {agent: values.copy() for agent, values in kept.items()}, state.copy()
    env.step(sampled(env))
    env.reset()
    assert all(np.array_equal(kept[agent], copies[0][agent]) for agent in kept)
    assert np.array_equal(state, copies[1])


def test_a_pickle_in_mid_episode_goes_on_identically(task):
    env = make(task)
    seed_spaces(env, 2)
    env.reset(seed=2)
    for _ in range(3):
        env.step(sampled(env))
    copy = pickle.loads(pickle.dumps(env))
    assert copy.agents == env.agents
    while env.agents:
        actions = sampled(env)
        assert str(env.step(actions)) == str(copy.step(actions))
        assert np.array_equal(env.state(), copy.state())
    assert str(env.reset()) == str(copy.reset())


@pytest.mark.parametrize("view", [WorldEnv, WorldVectorEnv])
def test_teams_have_no_gymnasium_view(team, view):
    with pytest.raises(
        InvalidParameterError, match=re.escape(f'pettingzoo.make("parallel", "{TASKS[team][0]}"')
    ):
        view(team)

"""Stable-Baselines3's view of teams: rows are agents, in order whoever is out."""

import pickle

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from tests.interfaces.teams import SHORT, TEAMS, TOGETHER, list_toy, make_batch, random_actions
from tests.interfaces.toy_team import NAME as TOY

WORLDS = 6


@pytest.fixture(autouse=True)
def toy_is_listed(monkeypatch):
    list_toy(monkeypatch)


@pytest.fixture(params=[(name, {}) for name in TEAMS] + [(TOY, {"last_look": True})], ids=str)
def case(request):
    return request.param


def make(task, worlds=WORLDS, **params):
    return aquaquad_envs.sb3_vec_env(task, worlds, **{**SHORT.get(task, {}), **params})


def row_actions(env, decision):
    actions = random_actions(env.batch, range(env.batch.num_worlds), decision)
    return actions.reshape(env.num_envs, *actions.shape[2:])


def test_rows_are_agents_and_wait_for_their_world(case):
    """Step by step beside a plain batch: who ends, who waits, and what the infos say."""
    task, params = case
    env, batch = make(task, **params), make_batch(task, WORLDS, **params)
    agents, rows = batch.num_agents, WORLDS * batch.num_agents
    assert env.num_envs == rows
    env.seed(3)
    before = env.reset().copy()
    assert np.array_equal(before, batch.reset(3).reshape(rows, -1))
    returns, lengths = np.zeros(rows), np.zeros(rows, dtype=int)
    seen = {"waiting": 0, "ended early": 0, "cut": 0, "worlds": 0}
    for decision in range(120):
        gone = batch.done.reshape(rows)
        assert np.array_equal(env.waiting, gone)
        observations, rewards, done, infos = env.step(row_actions(env, decision))
        batch.step(random_actions(batch, range(WORLDS), decision))
        assert observations.shape == (rows, batch.observations.shape[-1]) and observations.dtype == np.float32
        assert rewards.shape == (rows,) and rewards.dtype == np.float32 and done.dtype == bool
        ended = batch.done.reshape(rows) & ~gone
        finished = np.repeat(batch.finished, agents)
        assert np.array_equal(done, ended)
        assert np.array_equal(rewards, batch.rewards.reshape(rows).astype(np.float32))
        assert not rewards[gone].any()
        returns += batch.rewards.reshape(rows)
        lengths += ~gone
        last, cut = batch.observations.reshape(rows, -1).copy(), batch.truncated.reshape(rows).copy()
        outcomes, metrics = batch.outcomes.reshape(rows).copy(), batch.metrics()
        for i in range(rows):
            if gone[i]:
                assert infos[i] == {"dead": True}
            elif not ended[i]:
                assert infos[i] == {}
            else:
                info = infos[i]
                assert info["terminal_observation"].any(), "an agent's last look at its world"
                expected = last[i] if last[i].any() else before[i]
                assert np.array_equal(info["terminal_observation"], expected)
                assert info["TimeLimit.truncated"] is bool(cut[i])
                assert info["episode"]["r"] == pytest.approx(returns[i])
                assert info["episode"]["l"] == lengths[i]
                assert info["outcome"] == batch.task.outcomes[outcomes[i]] != "running"
                assert ("metrics" in info) == finished[i]
                for name, value in info.get("metrics", {}).items():
                    np.testing.assert_equal(value, metrics[name][i // agents])
        batch.reset(mask=batch.finished)
        fresh = batch.observations.reshape(rows, -1)
        assert np.array_equal(observations[finished], fresh[finished])
        assert not observations[gone & ~finished].any()
        assert np.array_equal(observations[~ended], fresh[~ended])
        seen["waiting"] += int(gone.sum())
        seen["ended early"] += int((ended & ~finished).sum())
        seen["cut"] += int((ended & cut).sum())
        seen["worlds"] += int(finished.sum()) // agents
        returns[ended], lengths[finished] = 0.0, 0
        # What comes next is what the caller was given, whatever the caller does to it.
        before = observations.copy()
        observations[:] = 7.0
    if task in TOGETHER:
        assert seen.pop("waiting") == seen.pop("ended early") == 0
    assert min(seen.values()) > 0, f"{task}: not all was seen ({seen}); change SHORT"


def test_returns_are_not_written_to_later(case):
    task, params = case
    env = make(task, **params)
    kept = [(env.reset(), None)]
    kept[0] = (kept[0][0], kept[0][0].copy())
    for decision in range(30):
        for values in env.step(row_actions(env, decision))[:3]:
            kept.append((values, values.copy()))
    assert all(np.array_equal(values, copy) for values, copy in kept)


def test_seeds_count_up_by_world(case):
    task, params = case
    env = make(task, **params)
    agents = env.batch.num_agents
    assert list(env.seed(7)) == [7 + row // agents for row in range(env.num_envs)]
    first = env.reset()
    for world in range(WORLDS):
        alone = make_batch(task, 1, **params)
        alone.reset([7 + world])
        assert np.array_equal(first.reshape(WORLDS, agents, -1)[world], alone.observations[0])
    assert not np.array_equal(first, env.reset()), "a reset without a new seed must draw on"


@pytest.mark.parametrize("task", TEAMS)
def test_bad_actions_are_refused_and_nothing_moves(task):
    env = make(task)
    env.seed(0)
    env.reset()
    rows, size = env.num_envs, env.batch.action_spec.size
    nan = np.zeros((rows, size))
    nan[env.batch.num_agents + 1, 0] = np.nan
    before = env.batch.snapshot()
    for actions, words in (
        (nan, r"nan.*_1 in world 1"),
        (np.zeros(env.batch.action_shape), rf"expected \({rows}, {size}\)"),
        (np.zeros((rows // env.batch.num_agents, size)), "action: got shape"),
        (np.zeros((rows, size + 1)), "action: got shape"),
        (np.zeros((rows, size), dtype=bool), "dtype bool"),
        ([[0.0] * size] * (rows - 1) + [[0.0]], "unequal length"),
        (None, "action: got shape"),
    ):
        with pytest.raises(InvalidActionError, match=words):
            env.step(actions)
        assert env.batch.worlds.tobytes() == before.tobytes()
    env.step(np.zeros((rows, size)))


def test_indices_by_row():
    env, plain = make(TOY, action_type="discrete"), make(TOY)
    for each in (env, plain):
        each.seed(0)
        each.reset()
    for decision in range(20):
        index = row_actions(env, decision)
        assert index.shape == (env.num_envs,)
        returned = env.step(index)
        expected = plain.step(env.batch.action_spec.table[index])
        assert all(np.array_equal(a, b) for a, b in zip(returned[:3], expected[:3], strict=True))
    with pytest.raises(InvalidActionError, match="expected whole numbers"):
        env.step(np.zeros(env.num_envs))


@pytest.mark.parametrize("task", [*TEAMS, "drift-hop"])
def test_staggered_starts_have_all_ages(task):
    idle = {"toy-team": {"battery": 1000.0}, "drift-hop": {"scenario": "gyres", "num_fields": 4}}
    params = {**SHORT.get(task, {}), **idle.get(task, {})}
    env = aquaquad_envs.sb3_vec_env(task, 8, stagger=4, **params)
    again = aquaquad_envs.sb3_vec_env(task, 8, stagger=4, **params)
    for each in (env, again):
        each.seed(1)
    first = env.reset()
    assert np.array_equal(first, again.reset())
    ages = env.batch.worlds["steps"]
    # A world that ended on the way is younger than meant.
    expected = np.arange(8) * 4 // 8
    assert (ages <= expected).all() and (ages == expected).sum() >= 6
    assert np.array_equal(env.waiting, env.batch.done.reshape(-1))
    assert np.array_equal(first, env.batch.observations.reshape(env.num_envs, -1))
    plain = aquaquad_envs.sb3_vec_env(task, 8, **params)
    plain.reset()
    assert not plain.batch.worlds["steps"].any()


@pytest.mark.parametrize("stagger", [-1, 1.5, None, "3"])
def test_bad_staggers_are_refused(stagger):
    with pytest.raises(InvalidParameterError, match="stagger: got"):
        make(TOY, stagger=stagger)


@pytest.mark.parametrize("task", TEAMS)
def test_a_pickle_in_mid_episode_goes_on_identically(task):
    env = make(task)
    env.seed(0)
    env.reset()
    for decision in range(5):
        env.step(row_actions(env, decision))
    copy = pickle.loads(pickle.dumps(env))
    for decision in range(5, 30):
        logs = []
        for each in (env, copy):
            *arrays, infos = each.step(row_actions(env, decision))
            for info in infos:
                info.get("episode", {}).pop("t", None)
            logs.append([array.tobytes() for array in arrays] + [str(infos)])
        assert logs[0] == logs[1]


@pytest.mark.parametrize("task", TEAMS)
def test_ppo_shares_one_policy_among_agents(task):
    from stable_baselines3 import PPO

    weights = []
    for _ in range(2):
        env = make(task)
        model = PPO("MlpPolicy", env, n_steps=16, batch_size=env.num_envs, n_epochs=1, seed=3, device="cpu")
        model.learn(32 * env.num_envs)
        assert model.num_timesteps == 32 * env.num_envs and len(model.ep_info_buffer) > 0
        weights.append([p.detach().numpy().copy() for p in model.policy.parameters()])
    assert all(np.array_equal(a, b) for a, b in zip(*weights, strict=True)), "equal seeds, equal training"

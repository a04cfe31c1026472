"""The same seed gives the same episodes, bit for bit, from every interface, at every batch size and thread count."""

import pickle

import gymnasium
import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.tasks.task import TASKS

SINGLE = {name: env_id for name, (env_id, agents, _) in TASKS.items() if agents == "single"}
#: Parameters under which random actions end episodes soon, by task; a new task runs with its defaults.
PARAMS = {
    "drift-hop": {"scenario": "gyres", "num_fields": 8, "current_noise_m_s": 0.05, "horizon_s": 4 * 3600.0},
    "transponder-localization": {
        "scenario": "current", "num_fields": 8, "num_transponders": 2, "current_noise_m_s": 0.05, "outlier_share": 0.1,
        "sound_speed_error": 0.01, "robust_threshold": 2.0,
    },
    "laser-tracking": {
        "scenario": "mixed", "ambient_w_m2": 0.005, "ambient_variation": 0.3, "horizon_s": 2.0,
    },
}  # fmt: skip
WORLDS, SEED, DECISIONS = 5, 20, 60


def action_table(task, params):
    """Actions by world and decision: what every interface is given, whatever else happens in its batch."""
    space = gymnasium.make(SINGLE[task], **params).action_space
    space.seed(1)
    table = np.array([[space.sample() for _ in range(DECISIONS)] for _ in range(WORLDS)])
    if table.dtype.kind == "f":
        table[:, ::2] *= 0.05  # every other decision is a small one: drift
    return table


class Log:
    """Events of each world in order: ("reset", observation) or ("step", observation, reward, end, end)."""

    def __init__(self, table):
        self.events = [[] for _ in range(WORLDS)]
        self.table, self.decisions = table, np.zeros(WORLDS, dtype=int)

    def action(self):
        return self.table[np.arange(WORLDS), np.minimum(self.decisions, DECISIONS - 1)]

    def step(self, i, observation, reward, terminated, truncated):
        self.decisions[i] += 1
        record = (observation.tobytes(), np.float64(reward).tobytes(), bool(terminated), bool(truncated))
        self.events[i].append(("step", *record))

    def reset(self, i, observation):
        self.events[i].append(("reset", observation.tobytes()))

    @property
    def full(self):
        return (self.decisions >= DECISIONS).all()

    def cut(self):
        """Events up to the last decision that every interface makes."""
        kept = []
        for events in self.events:
            steps = np.cumsum([event[0] == "step" for event in events])
            kept.append(events[: int(np.searchsorted(steps, DECISIONS)) + 1])
        return kept


def play_gymnasium(task, params, log):
    for i in range(WORLDS):
        env = gymnasium.make(SINGLE[task], **params)
        log.reset(i, env.reset(seed=SEED + i)[0])
        while log.decisions[i] < DECISIONS:
            obs, reward, terminated, truncated, _ = env.step(log.action()[i])
            log.step(i, obs, reward, terminated, truncated)
            if terminated or truncated:
                log.reset(i, env.reset()[0])


def play_vector(mode, threads):
    def play(task, params, log):
        env = gymnasium.make_vec(SINGLE[task], WORLDS, autoreset_mode=mode, threads=threads, **params)
        for i, obs in enumerate(env.reset(seed=SEED)[0]):
            log.reset(i, obs)
        restarting = np.zeros(WORLDS, dtype=bool)
        while not log.full:
            obs, rewards, terminated, truncated, info = env.step(log.action())
            done = terminated | truncated
            for i in range(WORLDS):
                if restarting[i]:
                    log.reset(i, obs[i])
                else:
                    last = info["final_obs"][i] if mode == "SameStep" and done[i] else obs[i]
                    log.step(i, last, rewards[i], terminated[i], truncated[i])
                    if mode == "SameStep" and done[i]:
                        log.reset(i, obs[i])
            if mode == "NextStep":
                restarting = done
            elif mode == "Disabled" and done.any():
                obs, _ = env.reset(options={"reset_mask": done})
                for i in np.flatnonzero(done):
                    log.reset(i, obs[i])

    return play


def play_sync(task, params, log):
    """Gymnasium's own vector of our single environments."""
    env = gymnasium.make_vec(SINGLE[task], WORLDS, vectorization_mode="sync", **params)
    for i, obs in enumerate(env.reset(seed=SEED)[0]):
        log.reset(i, obs)
    restarting = np.zeros(WORLDS, dtype=bool)
    while not log.full:
        obs, rewards, terminated, truncated, _ = env.step(log.action())
        for i in range(WORLDS):
            if restarting[i]:
                log.reset(i, obs[i])
            else:
                log.step(i, obs[i], rewards[i], terminated[i], truncated[i])
        restarting = terminated | truncated


def play_sb3(task, params, log):
    env = aquaquad_envs.sb3_vec_env(task, WORLDS, **params)
    env.seed(SEED)
    for i, obs in enumerate(env.reset()):
        log.reset(i, obs)
    while not log.full:
        obs, rewards, done, infos = env.step(log.action())
        # SB3's rewards are float32; the exact ones are the batch's.
        assert rewards.dtype == np.float32 and np.array_equal(rewards, env.batch.rewards.astype(np.float32))
        for i in range(WORLDS):
            cut = infos[i].get("TimeLimit.truncated", False)
            last = infos[i]["terminal_observation"] if done[i] else obs[i]
            log.step(i, last, env.batch.rewards[i], done[i] and not cut, cut)
            if done[i]:
                log.reset(i, obs[i])


def play_batch(task, params, log, *, size=WORLDS, threads=1):
    batch = aquaquad_envs.make_world_batch(task, size, threads=threads, **params)
    for i, obs in enumerate(batch.reset(SEED)[:WORLDS]):
        log.reset(i, obs)
    while not log.full:
        actions = np.resize(log.action(), (size, *log.table.shape[2:]))
        batch.step(actions)
        for i in range(WORLDS):
            log.step(i, batch.observations[i], batch.rewards[i], batch.terminated[i], batch.truncated[i])
        done = batch.terminated | batch.truncated
        batch.reset(mask=done)
        for i in np.flatnonzero(done[:WORLDS]):
            log.reset(i, batch.observations[i])


PLAYS = {
    "NextStep": play_vector("NextStep", 1),
    "SameStep": play_vector("SameStep", 1),
    "Disabled": play_vector("Disabled", 1),
    "NextStep, two threads": play_vector("NextStep", 2),
    "Gymnasium's SyncVectorEnv": play_sync,
    "SB3": play_sb3,
    "raw": play_batch,
    "raw, 7 worlds": lambda *a: play_batch(*a, size=7),
    "raw, 4096 worlds, two threads": lambda *a: play_batch(*a, size=4096, threads=2),
}


@pytest.fixture(scope="module", params=list(SINGLE))
def golden(request):
    task = request.param
    params = PARAMS.get(task, {})
    table = action_table(task, params)
    log = Log(table)
    play_gymnasium(task, params, log)
    events = log.cut()
    ends = [sum(event[0] == "reset" for event in world) - 1 for world in events]
    assert sum(ends) >= WORLDS, f"{task}: too few episodes ended ({ends}); shorten them in PARAMS"
    return task, params, table, events


@pytest.mark.parametrize("interface", PLAYS)
def test_same_episodes_as_gymnasium_env(golden, interface):
    task, params, table, events = golden
    log = Log(table)
    PLAYS[interface](task, params, log)
    for i, (ours, theirs) in enumerate(zip(log.cut(), events, strict=True)):
        assert len(ours) == len(theirs)
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            assert a == b, f"world {i}, event {k}: {a[0]} against {b[0]}"


@pytest.mark.parametrize("task", SINGLE)
def test_discrete_and_continuous_are_one_world(task):
    """An index does what its row of the table does."""
    params = PARAMS.get(task, {})
    try:
        indexed = aquaquad_envs.make_world_batch(task, 3, action_type="discrete", **params)
    except ValueError:
        pytest.skip("the task has no discrete variant")
    plain = aquaquad_envs.make_world_batch(task, 3, **params)
    indexed.reset(0)
    plain.reset(0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        index = rng.integers(0, len(indexed.action_spec.table), 3)
        indexed.step(index)
        plain.step(indexed.action_spec.table[index])
        assert np.array_equal(indexed.worlds, plain.worlds)


def continue_gymnasium(env, table):
    log = []
    for actions in table:
        obs, reward, terminated, truncated, info = env.step(actions[0])
        log.append((obs.tobytes(), reward, terminated, truncated, str(info)))
        if terminated or truncated:
            log.append(env.reset()[0].tobytes())
    return log


def continue_vector(env, table):
    log = []
    for actions in table:
        obs, rewards, terminated, truncated, info = env.step(actions)
        log.append((obs.tobytes(), rewards.tobytes(), terminated.tobytes(), truncated.tobytes(), str(info)))
    return log


def continue_sb3(env, table):
    log = []
    for actions in table:
        obs, rewards, done, infos = env.step(actions)
        for info in infos:
            info.get("episode", {}).pop("t", None)
        log.append((obs.tobytes(), rewards.tobytes(), done.tobytes(), str(infos)))
    return log


@pytest.mark.parametrize("interface", ["gymnasium", "NextStep", "SameStep", "SB3"])
@pytest.mark.parametrize("task", SINGLE)
def test_a_pickle_in_mid_episode_goes_on_identically(task, interface):
    params = PARAMS.get(task, {})
    table = np.swapaxes(action_table(task, params), 0, 1)
    if interface == "gymnasium":
        env, go_on = gymnasium.make(SINGLE[task], **params).unwrapped, continue_gymnasium
        env.reset(seed=3)
    elif interface == "SB3":
        env, go_on = aquaquad_envs.sb3_vec_env(task, WORLDS, **params), continue_sb3
        env.seed(3)
        env.reset()
    else:
        env = gymnasium.make_vec(SINGLE[task], WORLDS, autoreset_mode=interface, **params).unwrapped
        go_on = continue_vector
        env.reset(seed=3)
    go_on(env, table[:7])
    copy = pickle.loads(pickle.dumps(env))
    assert go_on(copy, table[7:]) == go_on(env, table[7:])

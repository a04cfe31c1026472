"""A team's episodes are the same, bit for bit, from every interface, at every batch size and thread count."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.interfaces.pettingzoo import WorldParallelEnv
from tests.interfaces.teams import SHORT, TEAMS, list_toy, make_batch, random_actions

WORLDS, SEED, DECISIONS = 5, 20, 60


@pytest.fixture(autouse=True)
def toy_is_listed(monkeypatch):
    list_toy(monkeypatch)


class Log:
    """Events of each world in order, with all agents: ("reset", observations) or ("step", ...)."""

    def __init__(self, table):
        self.events = [[] for _ in range(WORLDS)]
        self.table, self.decisions = table, np.zeros(WORLDS, dtype=int)
        self.seen = [None] * WORLDS

    def action(self, world):
        return self.table[min(self.decisions[world], DECISIONS - 1)][world]

    def actions(self):
        return np.stack([self.action(world) for world in range(WORLDS)])

    def reset(self, world, observations):
        self.seen[world] = observations.copy()
        self.events[world].append(("reset", observations.tobytes()))

    def step(self, world, observations, rewards, terminated, truncated, state):
        self.decisions[world] += 1
        done = terminated | truncated
        # SB3 gives an agent that ends its last look; a task may blank it. Both become that look.
        look = np.where((done & ~observations.any(-1))[:, None], self.seen[world], observations)
        self.seen[world] = np.where(done[:, None], look, observations)
        event = (look, np.asarray(rewards, dtype=np.float64), terminated, truncated)
        # At a world's end SB3 shows the next one already.
        shown = b"" if done.all() else state.tobytes()
        self.events[world].append(("step", *(values.tobytes() for values in event), shown))

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


def play_batch(task, params, log, *, size=WORLDS, threads=1):
    batch = aquaquad_envs.make_world_batch(task, size, threads=threads, **params)
    for world, observations in enumerate(batch.reset(SEED)[:WORLDS]):
        log.reset(world, observations)
    while not log.full:
        batch.step(np.resize(log.actions(), batch.action_shape))
        state = batch.state()
        for i in range(WORLDS):
            rows = (batch.observations[i], batch.rewards[i], batch.terminated[i], batch.truncated[i])
            log.step(i, *rows, state[i])
        finished = batch.finished
        batch.reset(mask=finished)
        for i in np.flatnonzero(finished[:WORLDS]):
            log.reset(i, batch.observations[i])


def play_one_at_a_time(task, params, log):
    """Batches of one world each."""
    for i in range(WORLDS):
        batch = aquaquad_envs.make_world_batch(task, 1, **params)
        log.reset(i, batch.reset([SEED + i])[0])
        while log.decisions[i] < DECISIONS:
            batch.step(log.action(i)[None])
            rows = (batch.observations[0], batch.rewards[0], batch.terminated[0], batch.truncated[0])
            log.step(i, *rows, batch.state()[0])
            if batch.finished[0]:
                log.reset(i, batch.reset()[0])


def play_pettingzoo(task, params, log):
    for i in range(WORLDS):
        env = WorldParallelEnv(task, **params)
        names = env.possible_agents
        log.reset(i, np.stack(list(env.reset(seed=SEED + i)[0].values())))
        flags = np.zeros((2, len(names)), dtype=bool)
        while log.decisions[i] < DECISIONS:
            action = log.action(i)
            observations, rewards, terminated, truncated, _ = env.step(
                {agent: action[k] for k, agent in enumerate(names) if agent in env.agents}
            )
            # Who left earlier keeps its flags, and is otherwise at rest.
            rest = np.zeros(env.observation_space(names[0]).shape, dtype=np.float32)
            flags = np.array([[each.get(a, old) for a, old in zip(names, row, strict=True)]
                              for each, row in zip((terminated, truncated), flags, strict=True)])  # fmt: skip
            rows = np.stack([observations.get(agent, rest) for agent in names])
            log.step(i, rows, [rewards.get(agent, 0.0) for agent in names], *flags, env.state())
            if not env.agents:
                log.reset(i, np.stack(list(env.reset()[0].values())))
                flags[:] = False


def play_sb3(task, params, log, threads=1):
    env = aquaquad_envs.sb3_vec_env(task, WORLDS, threads=threads, **params)
    env.seed(SEED)
    agents = env.batch.num_agents
    for world, observations in enumerate(env.reset().reshape(WORLDS, agents, -1)):
        log.reset(world, observations)
    terminated = np.zeros((WORLDS, agents), dtype=bool)
    truncated = terminated.copy()
    while not log.full:
        actions = log.actions()
        observations, _, done, infos = env.step(actions.reshape(env.num_envs, *actions.shape[2:]))
        state = env.batch.state()
        for i in range(WORLDS):
            rows = slice(i * agents, (i + 1) * agents)
            cut = np.array([info.get("TimeLimit.truncated", False) for info in infos[rows]])
            over = any("metrics" in info for info in infos[rows])
            waited = terminated[i] | truncated[i]
            terminated[i] |= done[rows] & ~cut
            truncated[i] |= cut
            look = observations[rows].copy()
            look[waited] = 0.0
            for k in np.flatnonzero(done[rows]):
                look[k] = infos[rows][k]["terminal_observation"]
            # SB3's rewards are float32; the exact ones are the batch's.
            log.step(i, look, env.batch.rewards[i], terminated[i].copy(), truncated[i].copy(), state[i])
            if over:
                log.reset(i, observations[rows])
                terminated[i] = truncated[i] = False


PLAYS = {
    "PettingZoo": play_pettingzoo,
    "SB3": play_sb3,
    "SB3, two threads": lambda *a: play_sb3(*a, threads=2),
    "raw, one world at a time": play_one_at_a_time,
    "raw, two threads": lambda *a: play_batch(*a, threads=2),
    "raw, 7 worlds": lambda *a: play_batch(*a, size=7),
    "raw, 64 worlds, two threads": lambda *a: play_batch(*a, size=64, threads=2),
    "raw, 1200 worlds, two threads": lambda *a: play_batch(*a, size=1200, threads=2),
}


@pytest.fixture(scope="module", params=TEAMS)
def golden(request):
    task, params = request.param, SHORT.get(request.param, {})
    with pytest.MonkeyPatch.context() as patch:
        list_toy(patch)
        batch = make_batch(task, WORLDS)
        table = [random_actions(batch, range(WORLDS), decision) for decision in range(DECISIONS)]
        log = Log(table)
        play_batch(task, params, log)
    events = log.cut()
    ends = sum(event[0] == "reset" for world in events for event in world) - WORLDS
    assert ends >= WORLDS, f"{task}: too few episodes ended ({ends}); shorten them in SHORT"
    return task, params, table, events


@pytest.mark.parametrize("interface", PLAYS)
def test_same_episodes_as_the_raw_batch(golden, interface):
    task, params, table, events = golden
    log = Log(table)
    PLAYS[interface](task, params, log)
    for i, (ours, theirs) in enumerate(zip(log.cut(), events, strict=True)):
        assert len(ours) == len(theirs)
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            assert a == b, f"world {i}, event {k}: {a[0]} against {b[0]}"

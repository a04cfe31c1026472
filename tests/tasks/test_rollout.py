"""The plain rollout: one episode a seed, whatever the batch around it."""

import numpy as np
import pytest

from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from tests.interfaces.teams import TEAMS, TOGETHER, list_toy, make_batch, random_actions


class Hop:
    """Hops with a heading of its own until the episode ends, and counts what it is asked."""

    information = "nothing"

    def __init__(self, batch):
        self.shape = (batch.num_worlds, 2)
        self.calls = 0

    def reset(self, seeds):
        angle = np.asarray(seeds, dtype=float)
        self.actions = 0.5 * np.stack([np.cos(angle), np.sin(angle)], -1).astype(np.float32)
        self.calls = 0

    def act(self, observations, worlds):
        self.calls += 1
        return self.actions * (self.calls % 2)


def test_an_episode_depends_on_its_seed_alone():
    whole = make_world_batch("drift-hop", 7, scenario="gyres")
    together = rollout(Hop(whole), whole, range(7), tracks=True)
    parts = []
    for seeds in ([0, 1, 2, 3], [4, 5, 6]):
        batch = make_world_batch("drift-hop", len(seeds), scenario="gyres")
        parts.append(rollout(Hop(batch), batch, seeds, tracks=True))
    joined = EpisodeResults.join(parts)
    assert np.array_equal(joined.worlds, together.worlds)
    assert np.array_equal(joined.seeds, together.seeds)
    assert np.array_equal(joined.decisions, together.decisions)
    assert np.array_equal(joined.rewards, together.rewards)
    assert np.array_equal(joined.track, together.track)
    assert np.array_equal(joined.flown, together.flown)
    for name, values in together.metrics.items():
        assert np.array_equal(joined.metrics[name], values, equal_nan=True)


def test_counts_and_tracks_agree_with_the_worlds():
    batch = make_world_batch("drift-hop", 5, scenario="gyres")
    running = []
    results = rollout(Hop(batch), batch, range(5), tracks=True, on_decision=running.append)
    worlds = results.worlds
    assert (worlds["outcome"] > 0).all()
    assert np.array_equal(results.decisions, worlds["steps"])
    assert running[-1] == 0 and running == sorted(running, reverse=True)
    assert len(running) == results.decisions.max() == len(results.flown)
    assert np.array_equal(results.flown.sum(0), worlds["hops"])
    assert np.array_equal(results.track[0], np.stack([worlds["start_x"], worlds["start_y"]], -1))
    assert np.array_equal(results.track[-1], np.stack([worlds["x"], worlds["y"]], -1))
    # Flown pieces are as long as the energy says.
    length = np.hypot(*np.moveaxis(np.diff(results.track, axis=0), -1, 0))
    flown = np.where(results.flown, length, 0).sum(0)
    assert worlds["flight_wh"] == pytest.approx(200.0 * flown / (100 / 9) / 3600.0, rel=1e-6)
    assert results.planning_s > 0


def test_rewards_are_summed_only_while_an_episode_runs():
    batch = make_world_batch("drift-hop", 3, scenario="gyres")
    results = rollout(Hop(batch), batch, range(3))
    for i in range(3):
        alone = make_world_batch("drift-hop", 1, scenario="gyres")
        assert rollout(Hop(alone), alone, [i]).rewards[0] == results.rewards[i]


def test_what_on_decision_raises_ends_the_rollout():
    batch = make_world_batch("drift-hop", 2)

    def stop(running):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        rollout(Hop(batch), batch, [0, 1], on_decision=stop)


class Wander:
    """Each agent of each world goes its own way, and never learns who is out."""

    def __init__(self, batch):
        self.batch = batch

    def reset(self, seeds):
        self.seeds, self.decision = seeds, -1

    def act(self, observations, worlds):
        assert observations.shape[:2] == self.batch.rows and len(worlds) == self.batch.num_worlds
        self.decision += 1
        return random_actions(self.batch, self.seeds, self.decision)


@pytest.mark.parametrize("task", TEAMS)
def test_a_teams_episode_depends_on_its_seed_alone(task, monkeypatch):
    list_toy(monkeypatch)
    whole = make_batch(task, 5)
    together = rollout(Wander(whole), whole, range(5), tracks=True)
    agents = whole.num_agents
    assert together.rewards.shape == (5, agents) and together.decisions.shape == (5,)
    assert together.track.shape == (together.decisions.max() + 1, 5, agents, 2)
    assert together.flown.shape == (together.decisions.max(), 5, agents)
    assert (together.worlds["outcome"] > 0).all()
    # Where agents end together, a team reward is the same for all.
    apart = np.ptp(together.rewards, axis=1).max() > 0
    assert apart or task in TOGETHER or not together.rewards.any()
    parts = []
    for seeds in ([0, 1, 2], [3, 4]):
        batch = make_batch(task, len(seeds))
        parts.append(rollout(Wander(batch), batch, seeds, tracks=True))
    joined = EpisodeResults.join(parts)
    assert joined.worlds.tobytes() == together.worlds.tobytes()
    for name in ("seeds", "decisions", "rewards", "track", "flown"):
        assert np.array_equal(getattr(joined, name), getattr(together, name)), name


def test_a_teams_rewards_are_those_of_its_episode(monkeypatch):
    list_toy(monkeypatch)
    batch = make_batch("toy-team", 4)
    results = rollout(Wander(batch), batch, range(4), tracks=True)
    worlds = results.worlds
    assert np.array_equal(results.decisions, worlds["steps"])
    assert np.array_equal(results.flown.sum(0), worlds["hops"][:, :3])
    assert np.array_equal(results.track[-1], np.stack([worlds["x"], worlds["y"]], -1)[:, :3])
    # What a battery lost beyond 1 a decision was moved; the loss of an agent costs 5.
    lost = worlds["agent_outcome"][:, :3] == 1
    again = make_batch("toy-team", 4)
    again.reset(range(4))
    lasted = (np.abs(np.diff(results.track, axis=0)).sum(-1) > 0).sum(0)
    moved = again.worlds["battery"][:, :3] - worlds["battery"][:, :3] - lasted
    assert results.rewards == pytest.approx(-moved - 5.0 * lost)

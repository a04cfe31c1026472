"""One episode of every world of a batch under a policy: the loop behind evaluation, in and after training."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.tasks.batch import WorldBatch

#: A policy that is still at it after this many decisions will not end.
_MOST_DECISIONS = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeResults:
    """What became of one episode per seed.

    Parameters
    ----------
    seeds: (episodes,). worlds: records at the end of each episode, (episodes,).
    metrics: the task's metrics by name, each (episodes,). rewards: sum of rewards, (episodes,), of a
        team's task (episodes, agents). decisions: decisions of each episode, (episodes,).
    planning_s: wall-clock seconds spent in the policy, all worlds together.
    track: (decisions + 1, episodes, 2) positions, m, where the record has x and y (else zeros), held after
        an episode's end; None unless asked for. flown: bool (decisions, episodes), whether that
        piece was flown, of tasks whose record counts hops. Of a team both have an axis of agents after
        that of episodes.
    """

    seeds: np.ndarray
    worlds: np.ndarray = field(repr=False)
    metrics: dict[str, np.ndarray]
    rewards: np.ndarray
    decisions: np.ndarray
    planning_s: float
    track: np.ndarray | None = field(default=None, repr=False)
    flown: np.ndarray | None = field(default=None, repr=False)

    @staticmethod
    def join(parts: Sequence[EpisodeResults]) -> EpisodeResults:
        """Several results as one, episodes in the order given."""
        if not parts:
            raise InvalidParameterError("parts", parts, "at least one result to join")
        tracks = [part.track for part in parts if part.track is not None]
        flown = [part.flown for part in parts if part.flown is not None]
        longest = max((len(track) for track in tracks), default=0)
        return EpisodeResults(
            seeds=np.concatenate([part.seeds for part in parts]),
            worlds=np.concatenate([part.worlds for part in parts]),
            metrics={
                name: np.concatenate([part.metrics[name] for part in parts]) for name in parts[0].metrics
            },
            rewards=np.concatenate([part.rewards for part in parts]),
            decisions=np.concatenate([part.decisions for part in parts]),
            planning_s=sum(part.planning_s for part in parts),
            track=np.concatenate([_lengthened(track, longest) for track in tracks], 1) if tracks else None,
            flown=np.concatenate([_lengthened(rows, longest - 1) for rows in flown], 1) if flown else None,
        )


def _lengthened(rows: np.ndarray, length: int) -> np.ndarray:
    """Hold the last row until there are ``length`` rows."""
    return np.concatenate([rows, np.repeat(rows[-1:], length - len(rows), axis=0)])


def rollout(
    policy: Any,
    batch: WorldBatch,
    seeds: Sequence[int] | np.ndarray,
    *,
    tracks: bool = False,
    on_decision: Callable[[int], None] | None = None,
) -> EpisodeResults:
    """One episode in every world of ``batch``, world i from ``seeds[i]``, until all have ended.

    ``policy`` has ``reset(seeds)`` and ``act(observations, worlds) -> actions``, all of shapes as the batch
    has them: of a team, observations (episodes, agents, n) and actions (episodes, agents, size) or indices
    (episodes, agents); those of agents that are done are ignored but must be finite. ``on_decision`` is called
    after every decision with the number of worlds still running; what it raises ends the rollout.
    """
    seeds = np.asarray(seeds)
    batch.reset(seeds)
    rewards = np.zeros(batch.rows)
    decisions = np.zeros(batch.num_worlds, dtype=np.int64)
    positions, flown = [_positions(batch)], []
    planning = 0.0
    begun = time.perf_counter()
    policy.reset(seeds)
    planning += time.perf_counter() - begun
    running, alive = ~batch.finished, ~batch.done
    for _ in range(_MOST_DECISIONS):
        begun = time.perf_counter()
        actions = policy.act(batch.observations, batch.worlds)
        planning += time.perf_counter() - begun
        hops = _hops(batch)
        batch.step(actions)
        decisions += running
        rewards += np.where(alive, batch.rewards, 0.0)
        if tracks:
            positions.append(_positions(batch))
            flown.append(_hops(batch) > hops)
        running, alive = ~batch.finished, ~batch.done
        if on_decision is not None:
            on_decision(int(running.sum()))
        if not running.any():
            break
    else:
        raise AquaQuadError(
            f"rollout: {int(running.sum())} episodes did not end in {_MOST_DECISIONS} decisions."
        )
    return EpisodeResults(
        seeds=seeds.copy(), worlds=batch.snapshot(), metrics=batch.metrics(), rewards=rewards,
        decisions=decisions, planning_s=planning, track=np.stack(positions) if tracks else None,
        flown=np.stack(flown) if tracks else None,
    )  # fmt: skip


def _field(batch: WorldBatch, name: str, dtype: type) -> np.ndarray:
    """A copy of a field of the records, one value a decision-maker; zeros where the task has none."""
    if name not in (batch.worlds.dtype.names or ()):
        return np.zeros(batch.rows, dtype=dtype)
    values = batch.worlds[name]
    return (values if values.ndim == 1 else values[:, : batch.num_agents]).copy()


def _positions(batch: WorldBatch) -> np.ndarray:
    return np.stack([_field(batch, "x", float), _field(batch, "y", float)], -1)


def _hops(batch: WorldBatch) -> np.ndarray:
    return _field(batch, "hops", np.int64)

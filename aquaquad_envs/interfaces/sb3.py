"""Stable-Baselines3 ``VecEnv``: rows are worlds, or the agents of all worlds, stepped by one compiled call."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.interfaces.spaces import action_space, observation_space
from aquaquad_envs.tasks.batch import action_array, make_world_batch


class WorldVecEnv(VecEnv):
    """``num_worlds`` worlds as a ``VecEnv``; finished worlds begin their next episode in the same step.

    Rows are worlds; of a team they are agents, world by world (row = world × agents + agent), so that
    all share one policy. Infos of a row that ends hold ``terminal_observation``, ``TimeLimit.truncated``,
    ``episode`` (return ``r``, length ``l``, time ``t``: what ``VecMonitor`` would add) and ``outcome``,
    with the world's end also ``metrics``.

    An agent that ends before its world ends its row once. From then on the row waits: observations of
    zeros (the first of the next episode, once there is one), reward 0, not done, info ``{"dead": True}``,
    action ignored. Trainers leave such transitions out; ``waiting`` tells which come next.

    Missions that end by time all end at once, and PPO values last observations one row at a time:
    ``stagger`` spreads the ages of the worlds that ``reset`` returns evenly over so many decisions
    (all of them zeros or index 0; returns and lengths count from there), best an episode's whole length.
    """

    def __init__(
        self, task: str, num_worlds: int, *, threads: int = 1, stagger: int = 0, **params: Any
    ) -> None:
        if not isinstance(stagger, int | np.integer) or stagger < 0:
            raise InvalidParameterError("stagger", stagger, "a whole number of 0 or more")
        self.batch = make_world_batch(task, num_worlds, threads=threads, **params)
        #: The batches behind the rows, in their order.
        self.batches = [self.batch]
        self.stagger = int(stagger)
        self.render_mode: str | None = None
        rows = num_worlds * self.batch.num_agents
        self._actions: np.ndarray | None = None
        self._returns = np.zeros(rows)
        self._lengths = np.zeros(rows, dtype=np.int64)
        self._before = np.zeros(0, dtype=np.float32)
        self._began = time.time()
        #: bool (rows,): agents that ended before their worlds.
        self.waiting = np.zeros(rows, dtype=bool)
        super().__init__(rows, observation_space(self.batch), action_space(self.batch))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds of the next reset: world i gets ``seed`` + i, as everywhere."""
        first = super().seed(seed)[0]
        self._seeds = [first + row // self.batch.num_agents for row in range(self.num_envs)]
        return self._seeds

    def reset(self) -> np.ndarray:
        """Begin an episode in every world, with the seeds of :meth:`seed` if it was called."""
        seeds = self._seeds[:: self.batch.num_agents]
        self.batch.reset(seeds if any(seed is not None for seed in seeds) else None)
        self._reset_seeds()
        self._reset_options()
        self._stagger_starts()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        self.waiting = self.batch.done.reshape(-1)
        self._before = self._rows(self.batch.observations).copy()
        return self._before.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Keep ``actions`` for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """One decision in every row."""
        batch, waited = self.batch, self.waiting
        batch.step(self._batch_actions())
        self._returns += batch.rewards.reshape(-1)
        self._lengths += ~waited
        finished = batch.finished
        ended = batch.done.reshape(-1) & ~waited
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(waited):
            infos[row] = {"dead": True}
        rewards = batch.rewards.astype(np.float32).reshape(-1)
        rows = np.flatnonzero(ended)
        if rows.size:
            self._describe_ends(infos, rows, finished)
            self._returns[rows] = 0.0
            self._lengths[rows] = 0
        if finished.any():
            batch.reset(mask=finished)
        self.waiting = batch.done.reshape(-1)
        observations = self._rows(batch.take_observations())
        if batch.task.num_agents is not None:
            self._before = observations.copy()  # the caller may write to what it is given
        return observations, rewards, ended, infos

    def _describe_ends(self, infos: list[dict[str, Any]], rows: np.ndarray, finished: np.ndarray) -> None:
        """Fill the infos of ``rows``, which end now."""
        batch = self.batch
        last, outcomes = self._rows(batch.observations), batch.outcomes.reshape(-1)
        cut = (batch.truncated & ~batch.terminated).reshape(-1)
        metrics = batch.metrics(finished) if finished.any() else {}
        place = np.cumsum(finished) - 1
        elapsed = round(time.time() - self._began, 6)
        for i in rows:
            world = i // batch.num_agents
            # A team's task may blank an agent's observation in the very step that ends it.
            blank = batch.task.num_agents is not None and not last[i].any()
            infos[i] = {
                "terminal_observation": (self._before if blank else last)[i].copy(),
                "TimeLimit.truncated": bool(cut[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": elapsed},
                "outcome": batch.task.outcomes[outcomes[i]],
            }
            if finished[world]:
                infos[i]["metrics"] = {name: float(values[place[world]]) for name, values in metrics.items()}

    def _stagger_starts(self) -> None:
        """Let time pass and begin worlds anew one after another, so that world i is i / worlds × stagger old."""
        batch = self.batch
        ages = np.arange(batch.num_worlds) * self.stagger // batch.num_worlds
        idle = np.zeros(batch.action_shape, dtype=float if batch.action_spec.table is None else int)
        for left in reversed(range(self.stagger)):
            batch.step(idle)
            batch.reset(mask=batch.finished | (ages == left))

    def _rows(self, observations: np.ndarray) -> np.ndarray:
        return observations.reshape(self.num_envs, -1)

    def _batch_actions(self) -> np.ndarray:
        discrete, shape = self.batch.action_spec.table is not None, self.batch.action_shape
        tail = shape[len(self.batch.rows) :]
        return action_array(self._actions, (self.num_envs, *tail), discrete=discrete).reshape(shape)

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of the batch of worlds, once a row."""
        value = getattr(self if attr_name == "render_mode" else self.batch, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Refused: worlds of one batch share their parameters."""
        raise AttributeError(f"{attr_name}: worlds of one batch share their parameters; make a new VecEnv.")

    def env_method(
        self, method_name: str, *args: Any, indices: int | Iterable[int] | None = None, **kwargs: Any
    ) -> list[Any]:
        """Refused: there is no object a world to call."""
        raise AttributeError(f"{method_name}: worlds of a native batch are not Python objects; use .batch.")

    def env_is_wrapped(self, wrapper_class: type, indices: int | Iterable[int] | None = None) -> list[bool]:
        """False in every row: no wrapper can sit inside a native batch."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """No pictures: render a ``gymnasium.make`` env instead."""
        return [None] * self.num_envs

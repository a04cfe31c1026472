"""Stable-Baselines3 ``VecEnv``: rows are worlds, stepped by one compiled call."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from aquaquad_envs.interfaces.spaces import action_space, observation_space
from aquaquad_envs.tasks.batch import make_world_batch


class WorldVecEnv(VecEnv):
    """``num_worlds`` worlds as a ``VecEnv``; finished worlds begin their next episode in the same step.

    Infos of a finished row hold ``terminal_observation``, ``TimeLimit.truncated``, ``episode``
    (return ``r``, length ``l``, time ``t``: what ``VecMonitor`` would add), ``outcome`` and ``metrics``.
    """

    def __init__(self, task: str, num_worlds: int, *, threads: int = 1, **params: Any) -> None:
        self.batch = make_world_batch(task, num_worlds, threads=threads, **params)
        self.render_mode: str | None = None
        self._actions: np.ndarray | None = None
        self._returns = np.zeros(num_worlds)
        self._lengths = np.zeros(num_worlds, dtype=np.int64)
        self._began = time.time()
        super().__init__(num_worlds, observation_space(self.batch), action_space(self.batch))

    def reset(self) -> np.ndarray:
        """Begin an episode in every world, with the seeds of :meth:`seed` if it was called."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        self.batch.reset(seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0.0
        self._lengths[:] = 0
        return self.batch.observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        """Keep ``actions`` for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """One decision in every world."""
        batch = self.batch
        batch.step(self._actions)
        self._returns += batch.rewards
        self._lengths += 1
        done = batch.terminated | batch.truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        rewards = batch.rewards.astype(np.float32)
        finished = np.flatnonzero(done)
        if finished.size:
            metrics = batch.metrics(done)
            elapsed = round(time.time() - self._began, 6)
            for k, i in enumerate(finished):
                infos[i] = {
                    "terminal_observation": batch.observations[i].copy(),
                    "TimeLimit.truncated": bool(batch.truncated[i] and not batch.terminated[i]),
                    "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]), "t": elapsed},
                    "outcome": batch.task.outcomes[batch.worlds["outcome"][i]],
                    "metrics": {name: float(values[k]) for name, values in metrics.items()},
                }
            self._returns[finished] = 0.0
            self._lengths[finished] = 0
            batch.reset(mask=done)
        return batch.take_observations(), rewards, done, infos

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

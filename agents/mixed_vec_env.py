"""Worlds of several kinds side by side in one Stable-Baselines3 ``VecEnv``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from aquaquad_envs.interfaces.sb3 import WorldVecEnv


class MixedVecEnv(VecEnv):
    """The rows of all ``parts``, one part after another; spaces must be the same.

    What is asked of the batch (names, metrics, parameters) is answered by the first part's.
    """

    def __init__(self, parts: Sequence[WorldVecEnv]) -> None:
        self.parts = list(parts)
        first = self.parts[0]
        self.batch = first.batch
        self.batches = [part.batch for part in self.parts]
        self.render_mode: str | None = None
        self._bounds = np.cumsum([part.num_envs for part in self.parts])[:-1]
        super().__init__(
            sum(part.num_envs for part in self.parts), first.observation_space, first.action_space
        )

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds of the next reset: worlds count on from part to part."""
        given: list[int | None] = []
        for part in self.parts:
            seeds = part.seed(seed)
            given += seeds
            seed = int(seeds[-1]) + 1  # type: ignore[arg-type]
        return given

    def reset(self) -> np.ndarray:
        """Begin an episode in every world."""
        return np.concatenate([part.reset() for part in self.parts])

    def step_async(self, actions: np.ndarray) -> None:
        """Keep ``actions`` for :meth:`step_wait`."""
        for part, own in zip(self.parts, np.split(actions, self._bounds), strict=True):
            part.step_async(own)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """One decision in every row."""
        observations, rewards, done, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        told = [info for part in infos for info in part]
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(done), told

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the first part's batch, once a row."""
        return self.parts[0].get_attr(attr_name, 0) * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused, as by the parts."""
        self.parts[0].set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Refused, as by the parts."""
        return self.parts[0].env_method(method_name, *args, **kwargs)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False in every row."""
        return [False for _ in self._get_indices(indices)]

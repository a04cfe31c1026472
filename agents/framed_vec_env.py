"""A Stable-Baselines3 ``VecEnv`` seen in a policy's frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.frames import Frame


class FramedVecEnv(VecEnvWrapper):
    """``venv`` with observations and actions in ``frame``; everything else passes through."""

    def __init__(self, venv: VecEnv, frame: Frame) -> None:
        own = venv.observation_space
        assert isinstance(own, spaces.Box)
        # A corner of the box, turned, sticks out of it.
        reach = float(np.sqrt(2.0)) if frame.turns else 1.0
        super().__init__(venv, observation_space=spaces.Box(-reach, reach, own.shape, np.float32))
        self.frame = frame
        self._world_observations = np.empty(0)

    def seed(self, seed: int | None = None) -> Any:
        """Seeds of the next reset, as the wrapped env takes them."""
        return self.venv.seed(seed)

    def reset(self) -> np.ndarray:
        """Begin an episode in every world."""
        self._world_observations = self.venv.reset()
        return self.frame.observe(self._world_observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep ``actions``, turned back into the world's frame."""
        self.venv.step_async(self.frame.act(actions, self._world_observations))

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """One decision in every world."""
        self._world_observations, rewards, done, infos = self.venv.step_wait()
        if self.frame.turns:
            for i in np.flatnonzero(done):
                last = infos[i]["terminal_observation"]
                infos[i]["terminal_observation"] = self.frame.observe(last[None])[0]
        return self.frame.observe(self._world_observations), rewards, done, infos

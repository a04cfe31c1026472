"""``gymnasium.Env``: a batch of one world."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from aquaquad_envs.interfaces.spaces import action_space, check_options, check_single, observation_space
from aquaquad_envs.interfaces.world_view import RENDER_FPS, RENDER_MODES, WorldView
from aquaquad_envs.tasks.batch import action_array


class WorldEnv(gymnasium.Env):
    """One world of a task.

    Info of every step: ``reward_terms`` (the reward's parts by name) and ``outcome``. Info of an
    episode's last step also holds ``metrics`` (the task's metrics by name). ``params`` are the
    task's parameters, see its page in ``docs/``.
    """

    metadata = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}

    def __init__(self, task: str, render_mode: str | None = None, **params: Any) -> None:
        self.view = WorldView(task, render_mode, params)
        self.batch = self.view.batch
        check_single(self.batch)
        self.render_mode = render_mode
        self.observation_space = observation_space(self.batch)
        self.action_space = action_space(self.batch)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode; without ``seed`` the world's random streams go on."""
        check_options(options)
        super().reset(seed=seed)
        self.view.reset(seed)
        return self.view.observation(), {"outcome": "running"}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One decision. Raises ``InvalidActionError`` for a wrong shape or dtype, NaN or infinity."""
        action = action_array(
            action, self.action_space.shape or (), discrete=self.batch.action_spec.table is not None
        )
        self.view.step(action)
        reward, terminated, truncated, info = self.view.result()
        if terminated or truncated:
            info["metrics"] = self.view.metrics()
        return self.view.observation(), reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """An RGB picture (rows, columns, 3) uint8, or a window when ``render_mode="human"``."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() without a mode: pass render_mode="rgb_array" or "human".')
            return None
        return self.view.draw()

    def close(self) -> None:
        """Close the window, if any."""
        self.view.close()

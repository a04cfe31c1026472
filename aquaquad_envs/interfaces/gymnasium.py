"""``gymnasium.Env``: a batch of one world."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np

from aquaquad_envs.errors import InvalidActionError, check_choice
from aquaquad_envs.interfaces.spaces import action_space, check_options, observation_space
from aquaquad_envs.tasks.batch import make_world_batch


class WorldEnv(gymnasium.Env):
    """One world of a task.

    Info of every step: ``reward_terms`` (the reward's parts by name) and ``outcome``. Info of an
    episode's last step also holds ``metrics`` (the task's metrics by name). ``params`` are the
    task's parameters, see its page in ``docs/``.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array", "human"], "render_fps": 10}

    def __init__(self, task: str, render_mode: str | None = None, **params: Any) -> None:
        if render_mode is not None:
            check_choice("render_mode", render_mode, self.metadata["render_modes"])
        self.batch = make_world_batch(task, 1, **params)
        self.render_mode = render_mode
        self.observation_space = observation_space(self.batch)
        self.action_space = action_space(self.batch)
        self._terms = self.batch.task.reward_terms
        self._renderer: Any = None
        self._discrete = self.batch.action_spec.table is not None

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode; without ``seed`` the world's random streams go on."""
        check_options(options)
        super().reset(seed=seed)
        self.batch.reset(None if seed is None else [seed])
        if self._renderer is not None:
            self._renderer.restart()
        if self.render_mode == "human":
            self.render()
        return self.batch.observations[0].copy(), {"outcome": "running"}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One decision. Raises ``InvalidActionError`` for a wrong shape or dtype, NaN or infinity."""
        batch = self.batch
        action = np.asarray(action)
        if action.shape != self.action_space.shape:
            raise InvalidActionError(
                f"action: got shape {action.shape}, expected {self.action_space.shape}."
            )
        batch.step(action[None])
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        info: dict[str, Any] = {
            "reward_terms": dict(zip(self._terms, batch.reward_terms[0].tolist(), strict=True)),
            "outcome": batch.task.outcomes[batch.worlds["outcome"][0]],
        }
        if terminated or truncated:
            info["metrics"] = {name: float(value[0]) for name, value in batch.metrics().items()}
        if self.render_mode == "human":
            self.render()
        return batch.observations[0].copy(), float(batch.rewards[0]), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """An RGB picture (rows, columns, 3) uint8, or a window when ``render_mode="human"``."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() without a mode: pass render_mode="rgb_array" or "human".')
            return None
        if self._renderer is None:
            from aquaquad_envs.rendering import make_renderer

            self._renderer = make_renderer(self.batch, self.render_mode, self.metadata["render_fps"])
        return self._renderer.draw(self.batch.worlds[0])

    def close(self) -> None:
        """Close the window, if any."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        state["_renderer"] = None  # a window cannot travel; the copy opens its own
        return state

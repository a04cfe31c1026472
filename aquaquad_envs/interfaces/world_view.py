"""What every view of a single world shares: the batch of one, its infos, its renderer."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import check_choice
from aquaquad_envs.tasks.batch import make_world_batch

RENDER_MODES = ["rgb_array", "human"]
RENDER_FPS = 10


class WorldView:
    """One world of a task, with what a Gymnasium or PettingZoo class needs to show it."""

    def __init__(self, task: str, render_mode: str | None, params: dict[str, Any]) -> None:
        if render_mode is not None:
            check_choice("render_mode", render_mode, RENDER_MODES)
        self.batch = make_world_batch(task, 1, **params)
        self.render_mode = render_mode
        self._renderer: Any = None

    def reset(self, seed: int | None) -> None:
        """Begin an episode; without ``seed`` the world's random streams go on."""
        self.batch.reset(None if seed is None else [seed])
        if self._renderer is not None:
            self._renderer.restart()
        if self.render_mode == "human":
            self.draw()

    def step(self, action: np.ndarray) -> None:
        """One decision: ``action`` is that of the only agent, or of all of a team, (agents, ...)."""
        self.batch.step(action[None])
        if self.render_mode == "human":
            self.draw()

    def result(self, *agent: int) -> tuple[float, bool, bool, dict[str, Any]]:
        """Reward, terminated, truncated and info of the last decision, of the team's agent ``agent``."""
        batch, at = self.batch, (0, *agent)
        info: dict[str, Any] = {
            "reward_terms": dict(zip(batch.task.reward_terms, batch.reward_terms[at].tolist(), strict=True)),
            "outcome": batch.task.outcomes[batch.outcomes[at]],
        }
        return float(batch.rewards[at]), bool(batch.terminated[at]), bool(batch.truncated[at]), info

    def team_outcome(self) -> str:
        """How the world ended, "running" while some agent goes on."""
        return self.batch.task.outcomes[self.batch.worlds["outcome"][0]]

    def metrics(self) -> dict[str, float]:
        """The task's metrics of the episode so far."""
        return {name: float(value[0]) for name, value in self.batch.metrics().items()}

    def observation(self, *agent: int) -> np.ndarray:
        """A copy of the present observation of the only agent, or the team's agent ``agent``."""
        return self.batch.observations[(0, *agent)].copy()

    def draw(self) -> np.ndarray | None:
        """An RGB picture (rows, columns, 3) uint8, or None after showing it in a window."""
        if self._renderer is None:
            from aquaquad_envs.rendering import make_renderer

            self._renderer = make_renderer(self.batch, self.render_mode or "rgb_array", RENDER_FPS)
        return self._renderer.draw(self.batch.worlds[0])

    def close(self) -> None:
        """Close the window, if any."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        # A window cannot travel; the copy opens its own.
        return {**self.__dict__, "_renderer": None}

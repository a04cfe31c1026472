"""PettingZoo ``ParallelEnv``: one world, one entry a vehicle.

Drift/hop has one vehicle, so its parallel env has one agent, ``vehicle_0``; the tasks of teams have more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from aquaquad_envs.errors import InvalidActionError
from aquaquad_envs.interfaces.spaces import action_space, check_options, observation_space
from aquaquad_envs.interfaces.world_view import RENDER_FPS, RENDER_MODES, WorldView


class WorldParallelEnv(ParallelEnv):
    """One world of a task as a PettingZoo parallel environment.

    Infos hold ``outcome`` and ``reward_terms``; the last ones also ``metrics``. ``params`` are the
    task's parameters.
    """

    def __init__(self, task: str, render_mode: str | None = None, **params: Any) -> None:
        self.metadata = {
            "render_modes": RENDER_MODES,
            "render_fps": RENDER_FPS,
            "name": f"aquaquad_{task.replace('-', '_')}_v0",
            "is_parallelizable": True,
        }
        self.view = WorldView(task, render_mode, params)
        self.render_mode = render_mode
        batch = self.view.batch
        self.possible_agents = ["vehicle_0"]
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(batch) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space(batch) for agent in self.possible_agents}
        self.state_space = observation_space(batch)

    def observation_space(self, agent: str) -> spaces.Box:
        """The space of ``agent``'s observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box | spaces.Discrete:
        """The space of ``agent``'s actions."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode; without ``seed`` the world's random streams go on."""
        check_options(options)
        self.view.reset(seed)
        self.agents = list(self.possible_agents)
        return self._each(self.view.observation()), self._each({"outcome": "running"})

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """One decision of every live agent. Raises ``InvalidActionError`` for a missing or bad action."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise InvalidActionError(f"actions: none for {missing}, expected one for each of {self.agents}.")
        action = np.asarray(actions[self.agents[0]])
        reward, terminated, truncated, info = self.view.step(action)
        each = self._each
        result = each(self.view.observation()), each(reward), each(terminated), each(truncated), each(info)
        if terminated or truncated:
            self.agents = []
        return result

    def state(self) -> np.ndarray:
        """The central view: with one vehicle, its own observation."""
        return self.view.observation()

    def render(self) -> np.ndarray | None:
        """An RGB picture (rows, columns, 3) uint8, or a window when ``render_mode="human"``."""
        return None if self.render_mode is None else self.view.draw()

    def close(self) -> None:
        """Close the window, if any."""
        self.view.close()

    def _each(self, value: Any) -> dict[str, Any]:
        return {agent: value for agent in self.agents}

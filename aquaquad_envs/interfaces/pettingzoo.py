"""PettingZoo ``ParallelEnv``: one world, one entry an agent.

Agents are called ``vehicle_0``, ``vehicle_1`` and so on; the world of a single agent has ``vehicle_0`` alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from aquaquad_envs.interfaces.spaces import action_space, check_options, observation_space, state_space
from aquaquad_envs.interfaces.world_view import RENDER_FPS, RENDER_MODES, WorldView
from aquaquad_envs.tasks.batch import action_array


class WorldParallelEnv(ParallelEnv):
    """One world of a task as a PettingZoo parallel environment.

    An agent that is done leaves ``agents``; the others go on. Infos hold ``outcome`` (the agent's) and
    ``reward_terms``, of a team also ``team_outcome`` and ``alive`` (the other agents that go on); those of the
    world's last step, ``metrics``. ``max_cycles`` truncates whoever is left after so many steps: None
    leaves the end to the task, whose missions end by time. ``params`` are the task's parameters.
    """

    def __init__(
        self, task: str, render_mode: str | None = None, max_cycles: int | None = None, **params: Any
    ) -> None:
        whole = isinstance(max_cycles, int | np.integer) and not isinstance(max_cycles, bool)
        if max_cycles is not None and not (whole and max_cycles >= 1):
            raise InvalidParameterError("max_cycles", max_cycles, "None or a whole number of at least 1")
        self.metadata = {
            "render_modes": RENDER_MODES,
            "render_fps": RENDER_FPS,
            "name": f"aquaquad_{task.replace('-', '_')}_v0",
            "is_parallelizable": True,
        }
        self.view = WorldView(task, render_mode, params)
        self.render_mode = render_mode
        self.max_cycles = max_cycles
        self.cycles = 0
        batch = self.view.batch
        self.is_team = batch.task.num_agents is not None
        self.possible_agents = [f"{batch.task.agent_name}_{k}" for k in range(batch.num_agents)]
        #: Where each agent's values lie in the arrays of a world.
        self._place = {name: (k,) if self.is_team else () for k, name in enumerate(self.possible_agents)}
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(batch) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space(batch) for agent in self.possible_agents}
        self.state_space = state_space(batch)

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
        self.cycles = 0
        return self._observations(), {agent: {"outcome": "running"} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """One decision of every live agent; those of others are ignored.

        Raises ``InvalidActionError`` for a missing or bad action, before the world moves.
        """
        live = self.agents
        if not live:
            return {}, {}, {}, {}, {}
        self.view.step(self._joint_action(actions))
        self.cycles += 1
        cut = self.max_cycles is not None and self.cycles >= self.max_cycles
        rewards, terminated, truncated, infos = {}, {}, {}, {}
        for agent in live:
            result = self.view.result(*self._place[agent])
            rewards[agent], terminated[agent], truncated[agent], infos[agent] = result
            truncated[agent] = truncated[agent] or (cut and not terminated[agent])
        observations = self._observations()
        self.agents = [agent for agent in live if not (terminated[agent] or truncated[agent])]
        metrics = self.view.metrics() if not self.agents else None
        for agent, info in infos.items():
            if self.is_team:
                info["team_outcome"] = self.view.team_outcome()
                info["alive"] = [other for other in self.agents if other != agent]
            if metrics is not None:
                info["metrics"] = dict(metrics)
        return observations, rewards, terminated, truncated, infos

    def state(self) -> np.ndarray:
        """The central view of the world, float32 in [-1, 1]; of a single agent, its own observation."""
        return self.view.batch.state()[0]

    def render(self) -> np.ndarray | None:
        """An RGB picture (rows, columns, 3) uint8, or a window when ``render_mode="human"``."""
        return None if self.render_mode is None else self.view.draw()

    def close(self) -> None:
        """Close the window, if any."""
        self.view.close()

    def _observations(self) -> dict[str, np.ndarray]:
        return {agent: self.view.observation(*self._place[agent]) for agent in self.agents}

    def _joint_action(self, actions: dict[str, Any]) -> np.ndarray:
        """Actions of all agents as the batch takes them, zeros for those that are done."""
        if not isinstance(actions, dict):
            raise InvalidActionError(
                f"actions: got {type(actions).__name__}, expected a dict of one an agent."
            )
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise InvalidActionError(f"actions: none for {missing}, expected one for each of {self.agents}.")
        discrete = self.view.batch.action_spec.table is not None
        joint = np.zeros(self.view.batch.action_shape[1:], dtype=np.int64 if discrete else np.float64)
        for agent in self.agents:
            shape = self.action_spaces[agent].shape or ()
            joint[self._place[agent]] = action_array(actions[agent], shape, discrete=discrete, agent=agent)
        return joint

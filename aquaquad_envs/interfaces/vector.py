"""``gymnasium.vector.VectorEnv``: a native batch of worlds, all autoreset modes."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from aquaquad_envs.errors import InvalidParameterError, check_choice
from aquaquad_envs.interfaces.spaces import action_space, check_options, check_single, observation_space
from aquaquad_envs.tasks.batch import make_world_batch


class WorldVectorEnv(VectorEnv):
    """``num_envs`` worlds stepped by one compiled call.

    Parameters: ``autoreset_mode`` ("NextStep", the default; "SameStep"; "Disabled": reset by
    ``reset(options={"reset_mask": mask})``), ``threads``, and the task's own.

    Infos are dicts of arrays with ``_key`` masks: ``outcome`` and every reward term at each step;
    ``metrics`` (a dict of arrays) and, in same-step mode, ``final_obs`` and ``final_info`` of the worlds
    that finished.
    """

    def __init__(
        self,
        task: str,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        **params: Any,
    ) -> None:
        if render_mode is not None:
            raise InvalidParameterError(
                "render_mode", render_mode, "None in a vector env", "Render a gymnasium.make env instead."
            )
        if max_episode_steps is not None:
            raise InvalidParameterError(
                "max_episode_steps", max_episode_steps, "None", "Missions end by time: set horizon_s instead."
            )
        if not isinstance(autoreset_mode, AutoresetMode):
            check_choice("autoreset_mode", autoreset_mode, [mode.value for mode in AutoresetMode])
        self._mode = AutoresetMode(autoreset_mode)
        self.batch = make_world_batch(task, num_envs, threads=threads, **params)
        check_single(self.batch)
        self.num_envs = self.batch.num_worlds
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.render_mode = None
        self.single_observation_space = observation_space(self.batch)
        self.single_action_space = action_space(self.batch)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._finished = np.zeros(self.num_envs, dtype=bool)

    def reset(self, *, seed: Any = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin episodes everywhere, or where ``options["reset_mask"]`` is true (autoreset disabled).

        ``seed``: an int s seeds world i with s + i; a list gives one seed (or None) a world.
        """
        mask = self._reset_mask(options)
        if isinstance(seed, int | np.integer):
            self._np_random, self._np_random_seed = gymnasium.utils.seeding.np_random(int(seed))
        self.batch.reset(seed, mask=mask)
        self._finished[mask if mask is not None else slice(None)] = False
        return self.batch.observations.copy(), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """One decision in every world. Raises ``InvalidActionError`` for bad actions, before any world moves."""
        batch = self.batch
        if self._mode == AutoresetMode.DISABLED and self._finished.any():
            raise InvalidParameterError(
                "step", f"{int(self._finished.sum())} finished worlds", "none when autoreset is disabled",
                'Call reset(options={"reset_mask": terminated | truncated}) first.',
            )  # fmt: skip
        restarting = self._finished if self._mode == AutoresetMode.NEXT_STEP else None
        batch.step(actions)
        terminated, truncated = batch.terminated.copy(), batch.truncated.copy()
        rewards = batch.rewards.copy()
        if restarting is not None and restarting.any():
            # A finished world ignored its action above; now its next episode begins.
            batch.reset(mask=restarting)
            terminated[restarting] = truncated[restarting] = False
            rewards[restarting] = 0.0
        finished = terminated | truncated
        info = self._info(finished, np.ones(self.num_envs, bool) if restarting is None else ~restarting)
        if self._mode == AutoresetMode.SAME_STEP:
            if finished.any():
                final = {
                    key: value.copy() if hasattr(value, "copy") else value for key, value in info.items()
                }
                info["final_obs"] = batch.observations.copy()
                info["final_obs"][~finished] = 0.0
                info["_final_obs"] = finished.copy()
                info["final_info"], info["_final_info"] = final, finished.copy()
                batch.reset(mask=finished)
        else:
            self._finished = finished
        # With autoreset every row is written anew by each step, so that the array can be given away.
        keep = self._mode == AutoresetMode.DISABLED
        observations = batch.observations.copy() if keep else batch.take_observations()
        return observations, rewards, terminated, truncated, info

    def _info(self, finished: np.ndarray, stepped: np.ndarray) -> dict[str, Any]:
        batch = self.batch
        # A world that only restarted has terms of 0.
        terms = batch.reward_terms.copy()
        info: dict[str, Any] = {"outcome": batch.worlds["outcome"].copy(), "_outcome": stepped}
        info["reward_terms"] = {}
        for i, name in enumerate(batch.task.reward_terms):
            info["reward_terms"][name] = terms[:, i]
            info["reward_terms"][f"_{name}"] = stepped
        info["_reward_terms"] = stepped
        if finished.any():
            info["metrics"] = {}
            for name, values in batch.metrics(finished).items():
                info["metrics"][name] = np.zeros(self.num_envs)
                info["metrics"][name][finished] = values
                info["metrics"][f"_{name}"] = finished.copy()
            info["_metrics"] = finished.copy()
        return info

    def _reset_mask(self, options: dict | None) -> np.ndarray | None:
        check_options(options)
        if not options or "reset_mask" not in options:
            return None
        if self._mode != AutoresetMode.DISABLED:
            raise InvalidParameterError(
                "options['reset_mask']", "a mask", f"none with autoreset mode {self._mode.value}",
                'Finished worlds reset themselves; make the env with autoreset_mode="Disabled" to choose.',
            )  # fmt: skip
        mask = np.asarray(options["reset_mask"])
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise InvalidParameterError(
                "options['reset_mask']", f"{mask.dtype} {mask.shape}",
                f"a boolean array of shape ({self.num_envs},) with at least one True",
            )  # fmt: skip
        return mask

"""Gymnasium spaces of a batch's observations and actions."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.task import TASKS


def observation_space(batch: WorldBatch) -> spaces.Box:
    """One agent's observations: float32 in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (batch.observations.shape[-1],), np.float32)


def state_space(batch: WorldBatch) -> spaces.Box:
    """One world's central view: float32 in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (batch.state_size,), np.float32)


def action_space(batch: WorldBatch) -> spaces.Box | spaces.Discrete:
    """One agent's actions: numbers in [-1, 1], or an index in the discrete variant."""
    table = batch.action_spec.table
    if table is not None:
        return spaces.Discrete(len(table))
    return spaces.Box(-1.0, 1.0, (batch.action_spec.size,), np.float32)


def check_single(batch: WorldBatch) -> None:
    """Raise ``InvalidParameterError`` for a task of a team, which Gymnasium has no interface for."""
    if batch.task.num_agents is not None:
        raise InvalidParameterError(
            "task", batch.task.name, "a task of one agent",
            f'A team: use pettingzoo.make("parallel", "{TASKS[batch.task.name][0]}"), sb3_vec_env or make_world_batch.',
        )  # fmt: skip


def check_options(options: object) -> None:
    """Raise ``InvalidParameterError`` unless ``options`` of a reset are None or a dict."""
    if options is not None and not isinstance(options, dict):
        raise InvalidParameterError("options", options, "None or a dict")

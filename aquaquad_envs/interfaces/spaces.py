"""Gymnasium spaces of a batch's observations and actions."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import WorldBatch


def observation_space(batch: WorldBatch) -> spaces.Box:
    """One world's observations: float32 in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (batch.observations.shape[1],), np.float32)


def action_space(batch: WorldBatch) -> spaces.Box | spaces.Discrete:
    """One world's actions: numbers in [-1, 1], or an index in the discrete variant."""
    table = batch.action_spec.table
    if table is not None:
        return spaces.Discrete(len(table))
    return spaces.Box(-1.0, 1.0, (batch.action_spec.size,), np.float32)


def check_options(options: object) -> None:
    """Raise ``InvalidParameterError`` unless ``options`` of a reset are None or a dict."""
    if options is not None and not isinstance(options, dict):
        raise InvalidParameterError("options", options, "None or a dict")

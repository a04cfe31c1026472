"""The hops that all worlds of the AquaQuad take for actions, and their discrete variant."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.tasks.task import ActionSpec
from aquaquad_envs.tasks.vehicle_params import VehicleParams


def discrete_hops() -> np.ndarray:
    """Hop vectors (33, 2): 0 drifts, then 16 headings (from east, anticlockwise) at half and at full length."""
    angle = np.arange(16) * np.pi / 8
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    return np.concatenate([np.zeros((1, 2)), 0.5 * ring, ring])


def hop_actions(params: VehicleParams) -> ActionSpec:
    """Hop vectors in the unit disc, or indices into :func:`discrete_hops`, as ``params.action_type`` says."""
    return ActionSpec(size=2, table=discrete_hops() if params.action_type == "discrete" else None)

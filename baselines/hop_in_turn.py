"""``hop-in-turn``: every vehicle makes the hop that those after it in turn count on, if it gains enough.

It reads observations alone (:func:`aquaquad_envs.tasks.sensor_placement_turns.hop_in_turn`). Hops are short: over
before the tracker's next step, so that however many vehicles hop, none is missed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.tasks.sensor_placement_observation import GAIN_SCALE, OBSERVATION_NAMES
from aquaquad_envs.tasks.sensor_placement_turns import KEEP_CLEAR
from baselines.problem import require_continuous_actions

_HOP, _GAIN, _ROOM = (OBSERVATION_NAMES.index(name) for name in ("turn hop dx", "turn hop gain", "room"))


class HopInTurn:
    """Makes the hop of its turn.

    ``least_gain``: of HDOP, as h / (h + 20 s), that a hop must bring, unless there is no room to stay. Raises
    ``InvalidParameterError``.
    """

    information = (
        "its observation: where the team gains most by its hop, once those before it in turn have hopped"
    )

    def __init__(self, batch: Any, *, least_gain: float = 0.002) -> None:
        require_continuous_actions(batch)
        check_range("least_gain", least_gain, 0.0, 1.0)
        self._least = least_gain / (least_gain + GAIN_SCALE)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: an observation decides an action."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, vehicles, 2)."""
        goes = (observations[..., _GAIN] > self._least) | (observations[..., _ROOM] < KEEP_CLEAR)
        return np.where(goes[..., None], observations[..., _HOP : _HOP + 2], np.float32(0.0))

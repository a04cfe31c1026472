"""``hop-in-turn``: every vehicle hops where the team gains most, knowing what those before it in turn do.

It reads observations alone: the HDOP as the vehicles hop in turn, and the room to land
(:func:`aquaquad_envs.tasks.sensor_placement_hdop.hdops_in_turn`). Hops are short: over before the tracker's next step,
so that however many vehicles hop, none is missed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.tasks.sensor_placement_data import HEADINGS_DEG
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES
from baselines.problem import require_continuous_actions

_TURN, _ROOM, _GO = (
    OBSERVATION_NAMES.index(name) for name in ("HDOP before turn", "room", "target 1 direction x")
)
_HEADINGS = np.radians(HEADINGS_DEG)
#: What room to land is worth to a vehicle that must leave, in HDOP as it is observed.
_ROOM_WORTH, _ROOM_ENOUGH = 0.3, 0.5


class HopInTurn:
    """Hops to the best of eight places a short hop away.

    ``least_gain``: of HDOP as observed (h / (h + 20 s)) that a hop must bring. ``room``: share of a longest hop that is
    kept from edges and obstacles; a vehicle with less hops away. Raises ``InvalidParameterError``.
    """

    information = (
        "its observation: HDOPs about the estimates as the vehicles hop in turn, and the room to land"
    )

    def __init__(self, batch: Any, *, least_gain: float = 0.002, room: float = 0.15) -> None:
        require_continuous_actions(batch)
        check_range("least_gain", least_gain, 0.0, 1.0)
        check_range("room", room, 0.0, 1.0)
        self.batch = batch
        self.least_gain, self.room = float(least_gain), float(room)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: an observation decides an action."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, vehicles, 2)."""
        count = len(_HEADINGS)
        gain = -observations[..., _TURN + 1 : _TURN + 1 + count]
        here = observations[..., _ROOM, None]
        there = observations[..., _ROOM + 1 : _ROOM + 1 + count]
        stay = np.where(there > self.room, gain, -np.inf)
        leave = np.where(there > here, 1.0 + gain + _ROOM_WORTH * np.minimum(there, _ROOM_ENOUGH), -np.inf)
        worth = np.where(here < self.room, leave, stay)
        ahead = np.arctan2(observations[..., _GO + 1], observations[..., _GO])
        angle = ahead + _HEADINGS[worth.argmax(-1)]
        c = self.batch.constants
        length = np.where(worth.max(-1) > self.least_gain, c.short_hop / c.longest_step, 0.0)
        return (length[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)).astype(np.float32)

"""The frame in which a policy sees and gives vectors: the world's, or one turned towards the goal.

In the goal's frame the first axis points from the vehicle to the goal, or to the nearest target of a team, or along the
current where a plume is traced, so that missions which differ by a turn of the map look alike and one lesson serves
them all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice

FRAMES = ("world", "goal")
#: Observations that tell the frame, the first that a task has; they alone stay in the world's: north is known.
_DIRECTIONS = (
    ("goal direction x", "goal direction y"),
    ("target 1 direction x", "target 1 direction y"),
    ("flow direction x", "flow direction y"),
)
_SECOND = {"x": "y", "dx": "dy", "u": "v"}


def vector_pairs(names: Sequence[str]) -> np.ndarray:
    """Indices (n, 2) of the observations that are the two components of one vector, by their names."""
    place = {name: i for i, name in enumerate(names)}
    pairs = []
    for i, name in enumerate(names):
        second = " ".join(_SECOND.get(word, word) for word in name.split())
        if second != name and second in place and name not in frame_direction(names):
            pairs.append((i, place[second]))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def frame_direction(names: Sequence[str]) -> tuple[str, str]:
    """The pair of observations that the goal's frame is turned by."""
    for direction in _DIRECTIONS:
        if direction[0] in names:
            return direction
    raise InvalidParameterError(
        "frame", "goal", "a task that observes the direction of a goal, target or current"
    )


class Frame:
    """Turns observations into a policy's frame and its actions back.

    ``name`` is one of :data:`FRAMES`; ``observation_names`` are the task's.
    """

    def __init__(self, name: str, observation_names: Sequence[str]) -> None:
        check_choice("frame", name, FRAMES)
        self.turns = name == "goal"
        self._pairs = vector_pairs(observation_names) if self.turns else np.empty((0, 2), dtype=np.int64)
        names = list(observation_names)
        self._direction = [names.index(part) for part in frame_direction(names)] if self.turns else []

    def observe(self, observations: np.ndarray) -> np.ndarray:
        """Observations (rows, n) as the policy sees them: a new array, or the same in the world's frame."""
        if not self.turns:
            return observations
        cos, sin = self._axes(observations)
        first, second = observations[:, self._pairs[:, 0]], observations[:, self._pairs[:, 1]]
        turned = observations.copy()
        turned[:, self._pairs[:, 0]] = cos * first + sin * second
        turned[:, self._pairs[:, 1]] = cos * second - sin * first
        return turned

    def act(self, actions: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """The policy's ``actions`` (rows, 2, or 3 with a vertical part) in the world's frame of ``observations``."""
        return self._turned(actions, observations, 1.0) if self.turns else actions

    def see_actions(self, actions: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Actions (rows, 2 or 3) of the world as the policy would have given them."""
        return self._turned(actions, observations, -1.0) if self.turns else actions

    def _axes(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cos, sin = observations[:, self._direction[:1]], observations[:, self._direction[1:]]
        # No direction (nothing to go to, an agent that is done): the world's frame.
        return np.where((cos == 0.0) & (sin == 0.0), np.float32(1.0), cos), sin

    def _turned(self, actions: np.ndarray, observations: np.ndarray, way: float) -> np.ndarray:
        cos, sin = self._axes(observations)
        sin = way * sin
        first, second = actions[:, :1], actions[:, 1:2]
        turned = np.concatenate([cos * first - sin * second, sin * first + cos * second], axis=1)
        # A diagonal of the policy's square may leave the world's: keep its direction.
        turned /= np.maximum(np.abs(turned).max(axis=1, keepdims=True), 1.0)
        return np.concatenate([turned, actions[:, 2:]], axis=1).astype(np.float32)

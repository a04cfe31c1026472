"""The frame in which a policy sees and gives vectors: the world's, or one turned towards the goal.

In the goal's frame the first axis points from the vehicle to the goal, so that missions which differ
by a turn of the map look alike and one lesson serves them all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

FRAMES = ("world", "goal")
#: The observations that tell the frame; they alone stay in the world's, so that north is known.
_DIRECTION = ("goal direction x", "goal direction y")
_SECOND = {"x": "y", "dx": "dy", "u": "v"}


def vector_pairs(names: Sequence[str]) -> np.ndarray:
    """Indices (n, 2) of the observations that are the two components of one vector, by their names."""
    pairs = []
    for i, name in enumerate(names):
        second = " ".join(_SECOND.get(word, word) for word in name.split())
        if second != name and second in names and name not in _DIRECTION:
            pairs.append((i, list(names).index(second)))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


class Frame:
    """Turns observations into a policy's frame and its actions back.

    ``name`` is one of :data:`FRAMES`; ``observation_names`` are the task's.
    """

    def __init__(self, name: str, observation_names: Sequence[str]) -> None:
        self.turns = name == "goal"
        self._pairs = vector_pairs(observation_names)
        self._direction = [list(observation_names).index(part) for part in _DIRECTION] if self.turns else []

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
        """The policy's ``actions`` (rows, 2), turned back into the world's frame of ``observations``."""
        return self._turned(actions, observations, 1.0) if self.turns else actions

    def see_actions(self, actions: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Actions (rows, 2) of the world as the policy would have given them."""
        return self._turned(actions, observations, -1.0) if self.turns else actions

    def _axes(self, observations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return observations[:, self._direction[:1]], observations[:, self._direction[1:]]

    def _turned(self, actions: np.ndarray, observations: np.ndarray, way: float) -> np.ndarray:
        cos, sin = self._axes(observations)
        sin = way * sin
        first, second = actions[:, :1], actions[:, 1:]
        turned = np.concatenate([cos * first - sin * second, sin * first + cos * second], axis=1)
        # A diagonal of the policy's square may leave the world's: keep its direction.
        return (turned / np.maximum(np.abs(turned).max(axis=1, keepdims=True), 1.0)).astype(np.float32)

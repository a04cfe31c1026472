"""Policies that plan nothing: uniform random actions, and drifting for ever."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Distinguishes this policy's random stream from the world's own, which has the same seed.
_STREAM = 0x52414E44
_BLOCK = 64


class Random:
    """Any action, uniformly: the box of a continuous task, all indices of a discrete one.

    World i draws for all its agents from its own generator, seeded by the i-th seed of :meth:`reset`: its
    actions do not depend on the other worlds of the batch.
    """

    information = "nothing"

    def __init__(self, batch: Any) -> None:
        self.table = batch.action_spec.table
        #: Of the actions of one world: none or (size,), of a team (agents,) or (agents, size).
        self.shape = batch.action_shape[1:]
        self.generators: list[np.random.Generator] = []

    def reset(self, seeds: np.ndarray) -> None:
        """Begin an episode in every world, world i with seed ``seeds[i]`` (whole numbers of 0 or more)."""
        self.generators = [np.random.default_rng([_STREAM, int(seed)]) for seed in seeds]
        self._drawn: np.ndarray | None = None
        self._next = _BLOCK

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions: float32 (num_worlds, size) in [-1, 1), or indices (num_worlds,); of a team for each agent."""
        if self._next == _BLOCK:
            # A block at a time: a call into each world's generator at every decision would be slow.
            self._drawn = np.stack([self._draw(generator) for generator in self.generators], axis=1)
            self._next = 0
        assert self._drawn is not None
        self._next += 1
        return self._drawn[self._next - 1]

    def _draw(self, generator: np.random.Generator) -> np.ndarray:
        if self.table is not None:
            return generator.integers(len(self.table), size=(_BLOCK, *self.shape))
        return generator.uniform(-1.0, 1.0, (_BLOCK, *self.shape)).astype(np.float32)


class Drift:
    """Never flies: the current decides where the vehicle ends."""

    information = "nothing"

    def __init__(self, batch: Any) -> None:
        discrete = batch.action_spec.table is not None
        self._still = np.zeros(batch.action_shape, dtype=np.int64 if discrete else np.float32)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Zeros: drift in both variants of the action."""
        return self._still

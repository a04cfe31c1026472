"""The bound of plume tracing: every robot goes straight to a source that it knows."""

from __future__ import annotations

from typing import Any

import numpy as np


class StraightLine:
    """Straight to the true source, as far as the step limit lets it along that line in one step.

    No policy's robot nears the source faster along the line between them. Others may be in the way, at the source
    they must be, and errors of place and course are the world's.
    """

    information = "where the source is, and its own true place"

    def __init__(self, batch: Any) -> None:
        self.robots = batch.num_agents
        self.step_limit_m = float(batch.constants.step_limit)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, robots, 3), in step limits."""
        step = np.stack(
            [worlds[f"source_{axis}"][:, None] - worlds[axis][:, : self.robots] for axis in "xyz"], axis=-1
        )
        step /= self.step_limit_m
        return (step / np.maximum(np.abs(step).max(axis=-1, keepdims=True), 1.0)).astype(np.float32)

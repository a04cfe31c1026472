"""A learned policy: a multilayer perceptron read from a checkpoint, in plain NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from agents import checkpoints
from agents.frames import Frame
from aquaquad_envs.errors import CheckpointError
from aquaquad_envs.tasks.batch import WorldBatch


class LearnedPolicy:
    """The deterministic (mean) action of a trained actor.

    Parameters: ``batch``, and ``checkpoint``, a folder as :mod:`agents.checkpoints` writes it;
    None takes the one shipped for the batch's task and scenario. Raises ``CheckpointError``.
    """

    information = "its observations only"

    def __init__(self, batch: WorldBatch, *, checkpoint: str | Path | None = None) -> None:
        folder = (
            checkpoints.shipped(batch.task.name, batch.params.scenario) if checkpoint is None else checkpoint
        )
        tensors, self.card = checkpoints.load(folder, task=batch.task.name, kind="policy")
        if self.card.get("observation_names") != list(batch.task.observation_names):
            raise CheckpointError(f"{folder}: trained on other observations than this version's.")
        if batch.action_spec.table is not None:
            raise CheckpointError(f"{folder}: trained for continuous actions, the batch has discrete ones.")
        layers = sum(name.endswith(".weight") for name in tensors)
        try:
            self._layers = [(tensors[f"{i}.weight"].T.copy(), tensors[f"{i}.bias"]) for i in range(layers)]
        except KeyError as error:
            raise CheckpointError(f"{folder}: has no tensor {error}.") from error
        sizes = [self._layers[0][0].shape[0], self._layers[-1][0].shape[1]] if layers else []
        # What a network says of an axis that the world has not (laser tracking in a plane) is left out.
        self._size = batch.action_spec.size
        if not sizes or sizes[0] != batch.observations.shape[-1] or sizes[1] < self._size:
            raise CheckpointError(f"{folder}: the network maps {sizes}, the task needs other sizes.")
        self._activation = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}[self.card["activation"]]
        self._squash = self.card["squash"]
        self._frame = Frame(self.card["frame"], batch.task.observation_names)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: the policy has no memory."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions (..., size) float32 in [-1, 1] for ``observations`` (..., n): a row a world, or a world and agent."""
        rows = observations.reshape(-1, observations.shape[-1])
        own = forward(self._layers, self._activation, self._squash, self._frame.observe(rows))
        return self._frame.act(own, rows)[:, : self._size].reshape(*observations.shape[:-1], -1)


def forward(
    layers: list[tuple[np.ndarray, np.ndarray]], activation: Any, squash: bool, observations: np.ndarray
) -> np.ndarray:
    """The perceptron's output, squashed by tanh (SAC) or clipped (PPO) to [-1, 1].

    Sums run through ``einsum`` in a fixed order, so that a row does not depend on the batch around it.
    """
    x = observations
    for i, (weight, bias) in enumerate(layers):
        x = np.einsum("ij,jk->ik", x, weight) + bias
        if i < len(layers) - 1:
            x = activation(x)
    return np.tanh(x) if squash else np.clip(x, -1.0, 1.0)

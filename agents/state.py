"""A model's state as flat tensors, so that it can be stored without pickling."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from aquaquad_envs.errors import CheckpointError


def actor_of(model: BaseAlgorithm) -> torch.nn.Sequential:
    """The module that maps observations to mean actions, as one chain of layers."""
    policy = model.policy
    if hasattr(policy, "mlp_extractor"):
        return torch.nn.Sequential(*policy.mlp_extractor.policy_net, policy.action_net)
    return torch.nn.Sequential(*policy.actor.latent_pi, policy.actor.mu)


def actor_tensors(model: BaseAlgorithm) -> dict[str, np.ndarray]:
    """Weights of the actor's linear layers, named ``0.weight``, ``0.bias``, ``1.weight`` ..."""
    layers = [layer for layer in actor_of(model) if isinstance(layer, torch.nn.Linear)]
    tensors = {}
    for i, layer in enumerate(layers):
        tensors[f"{i}.weight"] = layer.weight.detach().numpy().copy()
        tensors[f"{i}.bias"] = layer.bias.detach().numpy().copy()
    return tensors


def put_actor(model: BaseAlgorithm, tensors: dict[str, np.ndarray]) -> None:
    """Put the tensors of :func:`actor_tensors` back; raises ``CheckpointError`` where they do not fit."""
    layers = [layer for layer in actor_of(model) if isinstance(layer, torch.nn.Linear)]
    wanted = {
        f"{i}.{name}": value for i, layer in enumerate(layers) for name, value in layer.named_parameters()
    }
    shapes = {name: tuple(value.shape) for name, value in wanted.items()}
    if shapes != {name: value.shape for name, value in tensors.items()}:
        raise CheckpointError(f"starting policy: does not fit the recipe's network of {shapes}.")
    with torch.no_grad():
        for name, value in wanted.items():
            value.copy_(torch.from_numpy(tensors[name]))


def training_tensors(model: BaseAlgorithm) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Every tensor of networks and optimisers, flat, and the optimisers' settings (JSON)."""
    tensors: dict[str, np.ndarray] = {}
    settings: dict[str, Any] = {}
    for name, state in model.get_parameters().items():
        if "param_groups" in state:
            settings[name] = state["param_groups"]
            for index, slots in state["state"].items():
                for slot, value in slots.items():
                    tensors[f"{name}/{index}/{slot}"] = torch.as_tensor(value).numpy().copy()
        elif isinstance(state, torch.Tensor):
            tensors[f"{name}/"] = state.detach().numpy().copy()
        else:
            for key, value in state.items():
                tensors[f"{name}/{key}"] = value.detach().numpy().copy()
    return tensors, settings


def restore_state(model: BaseAlgorithm, tensors: dict[str, np.ndarray], settings: dict[str, Any]) -> None:
    """Put the tensors of :func:`training_tensors` back; raises ``CheckpointError`` where they do not fit."""
    parameters: dict[str, Any] = {}
    for name, state in model.get_parameters().items():
        mine = {
            key.removeprefix(f"{name}/"): torch.from_numpy(value.copy())
            for key, value in tensors.items()
            if key.startswith(f"{name}/")
        }
        if "param_groups" in state:
            slots: dict[int, dict[str, torch.Tensor]] = {}
            for key, value in mine.items():
                index, slot = key.split("/")
                slots.setdefault(int(index), {})[slot] = value
            parameters[name] = {"state": slots, "param_groups": settings[name]}
        elif isinstance(state, torch.Tensor):
            parameters[name] = mine[""]
        else:
            parameters[name] = mine
    try:
        model.set_parameters(parameters, exact_match=True, device="cpu")
    except (ValueError, RuntimeError, KeyError) as error:
        raise CheckpointError(f"training checkpoint: does not fit the model ({error}).") from error

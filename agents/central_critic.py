"""A critic that sees the central view of a team's world, for actors that see their own observations (MAPPO).

Yu et al., "The surprising effectiveness of PPO in cooperative multi-agent games", NeurIPS 2022: parameters are
shared by all agents, acting is decentralised, and only in training the value function knows more. Rows
carry ``[own observation | central view]``; the actor reads the first part, the critic all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper


class StateVecEnv(VecEnvWrapper):
    """Rows of ``venv``, a team's, each with the central view of its world appended.

    The world of a last observation has begun anew when it is asked for: that row carries the view from before its
    last decision.
    """

    def __init__(self, venv: VecEnv) -> None:
        own = venv.observation_space
        assert isinstance(own, spaces.Box)
        size = own.shape[0] + venv.batch.state_size
        super().__init__(venv, observation_space=spaces.Box(own.low[0], own.high[0], (size,), np.float32))
        self._state = np.empty(0, dtype=np.float32)

    def seed(self, seed: int | None = None) -> Any:
        """Seeds of the next reset, as the wrapped env takes them."""
        return self.venv.seed(seed)

    def reset(self) -> np.ndarray:
        """Begin an episode in every world."""
        return self._with_state(self.venv.reset())

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        """One decision in every row."""
        before = self._state
        observations, rewards, done, infos = self.venv.step_wait()
        for row in np.flatnonzero(done):
            infos[row]["terminal_observation"] = np.concatenate(
                [infos[row]["terminal_observation"], before[row]]
            )
        return self._with_state(observations), rewards, done, infos

    def _with_state(self, observations: np.ndarray) -> np.ndarray:
        views = [np.repeat(batch.state(), batch.num_agents, axis=0) for batch in self.venv.batches]
        self._state = np.concatenate(views)
        return np.concatenate([observations, self._state], axis=1)


class _SplitExtractor(MlpExtractor):
    """An actor's perceptron on the first ``own`` features, a critic's on all of them."""

    def __init__(self, own: int, feature_dim: int, net_arch: Any, activation_fn: Any, device: Any) -> None:
        super().__init__(feature_dim, net_arch=net_arch, activation_fn=activation_fn, device=device)
        self.own = own
        actor = MlpExtractor(own, net_arch=net_arch, activation_fn=activation_fn, device=device)
        self.policy_net = actor.policy_net

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.policy_net(features[:, : self.own])


class CentralCriticPolicy(ActorCriticPolicy):
    """An actor-critic policy whose actor reads only the first ``own`` observations."""

    def __init__(self, *arguments: Any, own: int, **settings: Any) -> None:
        self.own = own
        super().__init__(*arguments, **settings)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _SplitExtractor(
            self.own, self.features_dim, self.net_arch, self.activation_fn, self.device
        )

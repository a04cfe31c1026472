"""Registration of every task under its standard id; interfaces load on first use."""

from __future__ import annotations

from typing import Any

from aquaquad_envs.tasks.task import TASKS


def register_all() -> None:
    """Register single-agent tasks with Gymnasium, teams with PettingZoo; a second call changes nothing."""
    import gymnasium
    import pettingzoo  # its registry only: a hundredth of a second

    for name, (env_id, agents, _) in TASKS.items():
        if agents == "single" and env_id not in gymnasium.registry:
            gymnasium.register(
                id=env_id,
                entry_point="aquaquad_envs.interfaces.gymnasium:WorldEnv",
                vector_entry_point="aquaquad_envs.interfaces.vector:WorldVectorEnv",
                kwargs={"task": name},
            )
        if agents == "team" and env_id not in pettingzoo.parallel_registry:
            pettingzoo.register(
                "parallel",
                env_id,
                entry_point="aquaquad_envs.interfaces.pettingzoo:WorldParallelEnv",
                kwargs={"task": name},
            )


def sb3_vec_env(task: str, num_worlds: int, *, threads: int = 1, stagger: int = 0, **params: Any) -> Any:
    """A Stable-Baselines3 ``VecEnv`` over a native batch of ``num_worlds`` worlds of ``task``.

    A row is a world, of a team an agent: those of a world lie together and share one policy. ``stagger``
    spreads the first episodes over so many decisions; see ``interfaces/sb3.py``.

    Example: ``PPO("MlpPolicy", sb3_vec_env("drift-hop", 256, scenario="vortex-perturbed"))``.
    """
    from aquaquad_envs.interfaces.sb3 import WorldVecEnv

    return WorldVecEnv(task, num_worlds, threads=threads, stagger=stagger, **params)

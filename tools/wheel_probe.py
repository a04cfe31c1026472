"""What ``check_wheel.py`` runs in an empty environment: import everything, step a world."""

from __future__ import annotations

import importlib
import json
import pkgutil
import re
from importlib import metadata

#: Modules that are about an optional package, and the packages of extras that they may miss.
NEEDS = {
    "aquaquad_envs.interfaces.sb3": {"stable_baselines3"},
    "agents": {"rich", "safetensors", "stable_baselines3", "torch", "tyro"},
    "evaluation": {"PIL", "matplotlib", "rich", "safetensors", "stable_baselines3", "torch", "tyro"},
    "train": {"rich", "safetensors", "stable_baselines3", "torch", "tyro"},
    "evaluate": {"PIL", "matplotlib", "rich", "safetensors", "stable_baselines3", "torch", "tyro"},
}
PACKAGES = ("aquaquad_envs", "baselines", "agents", "evaluation")


def import_all() -> int:
    """Import every module of the wheel and return how many came in.

    A module in ``NEEDS`` (or below one) may stop at a package of an extra; any other failure is raised.
    """
    names = ["train", "evaluate"]
    for package in PACKAGES:
        module = importlib.import_module(package)
        names.append(package)
        names += [found.name for found in pkgutil.walk_packages(module.__path__, f"{package}.", _raise)]
    imported = 0
    for name in names:
        try:
            importlib.import_module(name)
            imported += 1
        except ModuleNotFoundError as error:
            if (error.name or "").split(".")[0] not in optional_packages(name):
                raise
    return imported


def optional_packages(module: str) -> set[str]:
    """The packages that ``module`` may miss: those of its own entry in ``NEEDS`` or of a parent's."""
    found = (needs for known, needs in NEEDS.items() if f"{module}.".startswith(f"{known}."))
    return set().union(*found)


def _raise(name: str) -> None:
    # walk_packages imports packages to look inside; it would hide what went wrong there.
    if not optional_packages(name):
        raise ImportError(f"{name} does not import.")


def episode() -> dict[str, float]:
    """Twenty decisions of one world from a fixed seed; where it ended and what it cost."""
    import gymnasium
    import numpy as np

    import aquaquad_envs  # registers the ids

    assert aquaquad_envs.__doc__
    env = gymnasium.make("AquaQuad/DriftHop-v0")
    observation, _ = env.reset(seed=1)
    total = 0.0
    for decision in range(20):
        action = np.array([0.3, -0.2] if decision % 4 == 0 else [0.0, 0.0], dtype=np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        assert env.observation_space.contains(observation), observation
        total += float(reward)
        if terminated or truncated:
            break
    env.close()
    return {"decisions": float(decision), "return": total, "observation": float(np.sum(observation))}


if __name__ == "__main__":
    required = [re.split(r"[<>=!~ ;\[]", line)[0] for line in metadata.requires("aquaquad-envs") or []
                if "extra ==" not in line]  # fmt: skip
    print(
        json.dumps(
            {
                "episode": episode(),
                "modules": import_all(),
                "versions": [f"{name} {metadata.version(name)}" for name in required],
            }
        )
    )

"""Every policy that the benchmark knows, scripted and learned, by name, and the user's own."""

from __future__ import annotations

import importlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from aquaquad_envs.errors import CheckpointError, InvalidParameterError, check_choice
from aquaquad_envs.tasks.batch import WorldBatch
from baselines import POLICIES, knows, make_policy

LEARNED = "ppo"

ABOUT = {
    "random": "any action, uniformly",
    "drift": "never flies",
    "direct-flight": "the shortest flight to the goal that lands on open water",
    "greedy": "the hop, or none, after which four hours of forecast drift bring it nearest to the goal",
    "dr-rrt-star": "a tree of drifts and hops, grown towards the goal, improved, followed, replanned on a miss",
    "optimal": "greedy look-ahead on the least-flight-energy value function, solved on a grid",
    "ppo": "a learned network",
    "hold": "drifts, and hops back to its start when carried too far",
    "quadratic-fit": "steps to the minimum of a quadratic through the best readings shared (Byrne et al. 2003)",
    "spiral-surge": "upstream on every detection, on spirals in between",
    "straight-line": "knows the source and goes straight to it: the bound",
    "hop-in-turn": "every vehicle hops where the team gains most, knowing what those before it in turn do",
    "hdop-optimal": "hops to where the predicted error of the tracks is least, energy priced",
    "omlp-greedy": "measures next where one range tells most",
    "search-hold": "concentric search, then stays where the light was met",
    "gradient-ascent": "concentric search, then climbs the gradient of the reading",
    "ekf-tracking": "concentric search, then rides the rim about the centre that a bank of Kalman filters believes in",
    "memory-tracking": "sweeps ground from the guess outwards, then rides round the centre that the world believes in",
    "rov-tracking": "flies over where filtered acoustic fixes place the submerged vehicle",
    "true-center": "flies to the true centre",
}


#: Folder of the checkpoints that ship, by task.
_CHECKPOINTS = Path(__file__).resolve().parents[1] / "agents" / "checkpoints"


def policy_names(task: str) -> list[str]:
    """Names of the policies of ``task``, in the order of the report."""
    return [*POLICIES[task], LEARNED]


def shipped_names(task: str) -> list[str]:
    """Those that run without more: ``ppo`` where a checkpoint for ``task`` ships."""
    return [name for name in policy_names(task) if name != LEARNED or (_CHECKPOINTS / task).is_dir()]


def _is_of(task: str, name: str) -> bool:
    return name == LEARNED or knows(task, name)


def policies_by_task(tasks: Sequence[str], names: Sequence[str]) -> dict[str, list[str]]:
    """Policies of each task: of ``names`` those that it knows, all that ship by default.

    Raises ``InvalidParameterError`` where no task knows a name, or ``CheckpointError``.
    """
    if len(tasks) == 1:
        return {tasks[0]: find_policies(tasks[0], names)}
    known = list(dict.fromkeys(name for task in tasks for name in policy_names(task)))
    for name in names:
        if ":" not in name and not any(_is_of(task, name.partition("=")[0]) for task in tasks):
            check_choice("policy", name.partition("=")[0], known)
    chosen = {}
    for task in tasks:
        theirs = [n for n in names if ":" in n or _is_of(task, n.partition("=")[0])]
        chosen[task] = find_policies(task, theirs) if theirs or not names else []
    return chosen


def find_policies(task: str, names: Sequence[str]) -> list[str]:
    """``names``, checked, each once; all that ship by default.

    A name is one of :func:`policy_names`, ``ppo=FOLDER`` (a checkpoint of your own) or ``module:Class`` (a
    policy of your own). Raises ``InvalidParameterError`` naming the nearest, or ``CheckpointError``.
    """
    for name in names:
        if ":" in name:
            _own_class(name)
            continue
        if knows(task, name):
            continue
        known, _, folder = name.partition("=")
        check_choice("policy", known, policy_names(task))
        if "=" in name and known != LEARNED:
            raise InvalidParameterError(
                "policy", name, f"{known}; only {LEARNED} takes a checkpoint after '='"
            )
        if "=" in name and not Path(folder).is_dir():
            raise CheckpointError(
                f"{name}: no folder {folder!r}, expected one that train.py wrote (OUTPUT/policy)."
            )
    return list(dict.fromkeys(names)) or shipped_names(task)


def build_policy(name: str, batch: WorldBatch) -> Any:
    """The policy called ``name`` for ``batch``: see ``baselines.Policy`` for its members.

    Raises ``CheckpointError`` where a learned one has no checkpoint that fits, or lacks a package.
    """
    if ":" in name:
        return _own_class(name)(batch)
    known, _, folder = name.partition("=")
    if known != LEARNED:
        return make_policy(known, batch)
    try:
        from agents.learned import LearnedPolicy

        return LearnedPolicy(batch, checkpoint=folder or None)
    except ModuleNotFoundError as error:
        raise CheckpointError(f"ppo: needs the package {error.name}; install the extra 'train'.") from error


def about(name: str) -> str:
    """One line on what the policy does."""
    found = re.fullmatch(r"omlp-(\d+)", name)
    if found:
        steps = "step" if found[1] == "1" else f"{found[1]} steps"
        return f"the first of the {steps} after which the ranges tell most, planned anew each time"
    return ABOUT.get(name.partition("=")[0], "")


def description(policy: Any) -> dict[str, Any]:
    """What the report says of a policy: its information, and where a learned one comes from."""
    card = getattr(policy, "card", None) or {}
    kept = ("command", "steps", "seed", "algorithm", "scenario", "sha256")
    found: dict[str, Any] = {"information": str(getattr(policy, "information", "not stated"))}
    if card:
        found["checkpoint"] = {key: card[key] for key in kept if key in card}
    return found


def _own_class(name: str) -> Any:
    module, _, attribute = name.partition(":")
    try:
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise InvalidParameterError(
            "policy", name, "MODULE:CLASS that can be imported", f"{type(error).__name__}: {error}."
        ) from error

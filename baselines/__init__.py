"""Scripted policies, one file each, and the names that command lines know them by.

A policy is a class with ``information`` (one sentence: what it was allowed to know),
``reset(seeds)`` and ``act(observations, worlds) -> actions``, both over all worlds of the batch
that it was constructed with.
"""

from __future__ import annotations

import importlib
import re
from typing import Any, Protocol

import numpy as np

from aquaquad_envs.errors import check_choice


class Policy(Protocol):
    """What decides for all worlds of a batch, scripted or learned."""

    #: What it was allowed to know, in one sentence.
    information: str

    def reset(self, seeds: np.ndarray) -> None:
        """Begin an episode in every world; ``seeds`` decide whatever the policy draws."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions of all worlds, (num_worlds, size), of a team (num_worlds, agents, size).

        Those of finished worlds, and of agents that are done, are ignored.
        """


#: Task -> policy name -> where its class is: "module:class". Imported when asked for.
POLICIES: dict[str, dict[str, str]] = {
    "drift-hop": {
        "random": "baselines.simple:Random",
        "drift": "baselines.simple:Drift",
        "direct-flight": "baselines.direct_flight:DirectFlight",
        "greedy": "baselines.greedy:Greedy",
        "dr-rrt-star": "baselines.dr_rrt_star:DrRrtStar",
        "optimal": "baselines.optimal:Optimal",
    },
    "sensor-placement": {
        "random": "baselines.simple:Random",
        "drift": "baselines.simple:Drift",
        "hold": "baselines.hold:Hold",
        "hop-in-turn": "baselines.hop_in_turn:HopInTurn",
        "hdop-optimal": "baselines.hdop_optimal:HdopOptimal",
    },
    "transponder-localization": {
        "random": "baselines.simple:Random",
        "omlp-greedy": "baselines.omlp:OmlpGreedy",
        "omlp-1": "baselines.omlp:Omlp",
        "omlp-2": "baselines.omlp:Omlp",
        "omlp-3": "baselines.omlp:Omlp",
    },
    "laser-tracking": {
        "random": "baselines.simple:Random",
        "search-hold": "baselines.laser_policies:SearchHold",
        "gradient-ascent": "baselines.laser_policies:GradientAscent",
        "ekf-tracking": "baselines.laser_policies:EkfTracking",
        "memory-tracking": "baselines.memory_tracking:MemoryTracking",
        "rov-tracking": "baselines.laser_policies:RovTracking",
        "true-center": "baselines.laser_policies:TrueCenter",
    },
    "plume-tracing": {
        "random": "baselines.simple:Random",
        "quadratic-fit": "baselines.plume_tracing:QuadraticFit",
        "spiral-surge": "baselines.spiral_surge:SpiralSurge",
        "straight-line": "baselines.straight_line:StraightLine",
    },
}

#: Task -> families of policies: what their names look like, the option that the number in them is, and an example.
FAMILIES: dict[str, tuple[tuple[str, str, str], ...]] = {
    "transponder-localization": ((r"omlp-(\d{1,4})", "steps", "omlp-3"),),
}


def knows(task: str, name: str) -> bool:
    """Whether ``name`` is a scripted policy of ``task``, listed or of a family."""
    return name in POLICIES.get(task, {}) or any(
        re.fullmatch(pattern, name) for pattern, *_ in FAMILIES.get(task, ())
    )


def find_policy(task: str, name: str) -> tuple[str, dict[str, Any]]:
    """Where the class of policy ``name`` is, "module:class", and the options that are in its name.

    ``omlp-5`` is found though only ``omlp-1`` to ``omlp-3`` are listed. Raises ``InvalidParameterError`` for an
    unknown name.
    """
    known = POLICIES.get(task, {})
    for pattern, option, example in FAMILIES.get(task, ()):
        found = re.fullmatch(pattern, name)
        if found:
            return known[example], {option: int(found[1])}
    check_choice("policy", name, known)
    return known[name], {}


def make_policy(name: str, batch: Any, **options: Any) -> Policy:
    """The scripted policy called ``name`` for all worlds of ``batch``.

    ``options`` go to its class. Raises ``InvalidParameterError`` for an unknown name.
    """
    where, in_name = find_policy(batch.task.name, name)
    module, _, attribute = where.partition(":")
    return getattr(importlib.import_module(module), attribute)(batch, **in_name, **options)

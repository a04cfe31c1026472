"""What a task file offers to the rest of the package, and the list of tasks."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice

#: Task name on command lines -> (registered id, "single" agent or "team", module).
TASKS = {
    "drift-hop": ("AquaQuad/DriftHop-v0", "single", "aquaquad_envs.tasks.drift_hop"),
    "sensor-placement": ("AquaQuad/SensorPlacement-v0", "team", "aquaquad_envs.tasks.sensor_placement"),
    "transponder-localization": (
        "AquaQuad/TransponderLocalization-v0", "single", "aquaquad_envs.tasks.transponder_localization",
    ),
    "laser-tracking": ("AquaQuad/LaserTracking-v0", "single", "aquaquad_envs.tasks.laser_tracking"),
    "plume-tracing": ("AquaQuad/PlumeTracing-v0", "team", "aquaquad_envs.tasks.plume_tracing"),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ActionSpec:
    """Actions of one agent: ``size`` numbers in [-1, 1], or an index into ``table`` (n, size)."""

    size: int
    table: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A decision problem: parameters, world record, and compiled functions over batches of records.

    ``reset(worlds, mask, observations, *data)`` and ``step(worlds, actions, observations, rewards,
    terms, terminated, truncated, *data)`` loop over records without the GIL; ``data`` is the first
    two results of ``build(params)``, its third is notes. Records hold ``outcome``: 0 while the world runs,
    else how it ended, an index into ``outcomes``.

    A task of a team has ``num_agents(params)``, and after the axis of worlds its arrays have one of agents.
    Its records also hold ``agent_outcome``, at least as long as the team. An agent that is terminated or
    truncated is *done*: from the next step on its actions are ignored, its observation is all zeros (already
    in that step, if the task likes), its reward is 0 and its flags stay set, until the world is reset. A
    world is finished when all its agents are done. ``step`` tells who is done from the records alone, and
    writes the rows of all agents. ``state(worlds, out, *data)`` writes the central view, float32 (worlds,
    state_names) in [-1, 1].
    """

    name: str
    params: type
    world: np.dtype
    observation_names: tuple[str, ...]
    reward_terms: tuple[str, ...]
    outcomes: tuple[str, ...]
    build: Callable[[Any], tuple[Any, Any, tuple[str, ...]]]
    action_spec: Callable[[Any], ActionSpec]
    reset: Callable[..., None]
    step: Callable[..., None]
    metrics: Callable[[np.ndarray, Any], dict[str, np.ndarray]]
    #: None: one agent, and no axis of agents.
    num_agents: Callable[[Any], int] | None = None
    agent_name: str = "vehicle"
    #: None: the central view is the agents' observations in a row.
    state: Callable[..., None] | None = None
    state_names: Callable[[Any], tuple[str, ...]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        # A task travels between processes by its name: compiled functions stay at home.
        return load_task, (self.name,)

    def make_params(self, **values: Any) -> Any:
        """Parameters from keywords; an unknown name raises ``InvalidParameterError`` with the nearest known."""
        known = [field.name for field in fields(self.params)]
        for name in values:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                raise InvalidParameterError(
                    name, values[name], f"a parameter of {self.name}: " + ", ".join(known),
                    f"Did you mean {close[0]!r}?" if close else "",
                )  # fmt: skip
        # JSON and command lines give lists; the frozen, hashable form is a tuple.
        return self.params(
            **{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}
        )


def load_task(name: str) -> Task:
    """The task called ``name`` on command lines; raises ``InvalidParameterError`` if there is none."""
    check_choice("task", name, TASKS)
    return importlib.import_module(TASKS[name][2]).TASK

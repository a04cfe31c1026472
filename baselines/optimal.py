"""The least-flight-energy policy on a grid: eikonal flight and free drift (see ``docs/optimal.md``).

Its value at the start is the bound that the drift/hop task is scored against (solved on the
true field); the greedy policy on the forecast's value function is the planner ``optimal``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import check_choice
from baselines import lookahead
from baselines.problem import DriftHopProblem, require_continuous_actions
from baselines.value_function import Chart, Tables
from baselines.value_solver import DriftTables, ValueFunction, solve, solve_timed, solve_with

__all__ = ["Optimal", "ValueFunction", "solve"]


def _problem(batch: Any, world: np.ndarray, index: int) -> DriftHopProblem:
    """The planning problem of one world at its start, on current field ``index``."""
    params, ocean = batch.params, batch.ocean
    return DriftHopProblem(
        velocity=ocean.velocity, axes=ocean.axes, clearance=ocean.clearance,
        clearance_grid=ocean.clearance_grid, field_index=int(index), obstacle_index=int(world["obstacle"]),
        start=(float(world["start_x"]), float(world["start_y"])),
        goal=(float(world["goal_x"]), float(world["goal_y"])),
        half_width_m=params.half_width_m, goal_radius_m=params.goal_radius_m, max_hop_m=params.max_hop_m,
        airspeed_m_s=params.airspeed_m_s, flight_power_w=params.flight_power_w,
        time_s=float(world["clock_s"]), horizon_s=params.horizon_s,
        drift_step_s=params.action_period_s / params.sub_steps,
    )  # fmt: skip


class _Solver:
    """Value functions of the worlds of a batch, solved once for equal fields, obstacles, goals and clocks."""

    def __init__(self, batch: Any, spacing_m: float | None, action_period_s: float | None) -> None:
        self.batch = batch
        params = batch.params
        self.action_period_s = action_period_s
        self.euler = params.integrator == "euler"
        self.steady = batch.ocean.velocity.shape[1] == 1
        # Slices in time cost: a coarser grid there (100 m and 150 m in the box of 10 km).
        self.spacing_m = spacing_m or params.half_width_m / (50 if self.steady else 100 / 3)
        self._tables: tuple[Any, DriftTables | None] = (None, None)

    def keys(self, worlds: np.ndarray, field: str) -> np.ndarray:
        """What decides a world's value function, (num_worlds, 5)."""
        clock = np.zeros(len(worlds)) if self.steady else worlds["clock_s"]
        columns = (worlds[field], worlds["obstacle"], worlds["goal_x"], worlds["goal_y"], clock)
        return np.stack(columns, -1).astype(np.float64)

    def solve(self, world: np.ndarray, index: int, *, timed: bool = False) -> ValueFunction:
        problem = _problem(self.batch, world, index)
        if timed:
            return solve_timed(problem, self.spacing_m, self.action_period_s, self.euler)
        key = (int(index), int(world["obstacle"]))
        if self._tables[0] != key:
            made = DriftTables.make(problem, self.spacing_m, self.action_period_s, self.euler)
            self._tables = (key, made)
        return solve_with(problem, self._tables[1], self.spacing_m, 1.0, self.action_period_s, self.euler)


class Optimal:
    """Greedy one-step look-ahead on the grid value function of a current field.

    Parameters
    ----------
    batch: the worlds it acts in (continuous actions).
    spacing_m: of the grid; None: 1/50 of the half-width (100 m in the box of 10 km), 3/100 (150 m) where
        the field changes with time.
    field: which field it may know, "forecast" (default) or "truth" (for bounds and ablations).

    Deterministic: the seeds of :meth:`reset` change nothing.
    """

    information = (
        "the forecast of the current over the whole mission, all obstacles, its own position, "
        "the goal and the clock"
    )

    def __init__(self, batch: Any, *, spacing_m: float | None = None, field: str = "forecast") -> None:
        check_choice("field", field, ("forecast", "truth"))
        require_continuous_actions(batch)
        if field == "truth":
            self.information = self.information.replace("the forecast of", "the true", 1)
        self.batch = batch
        self.field = field
        self._solver = _Solver(batch, spacing_m, batch.params.action_period_s)
        self._keys = np.full((batch.num_worlds, 5), np.nan)
        self._slots = np.zeros(batch.num_worlds, dtype=np.int64)
        self._known: dict[tuple[float, ...], int] = {}
        self._timed = not self._solver.steady
        self._tables: Tables | None = None
        self._chart: Chart | None = None

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to forget: value functions are found again by field, obstacles, goal and clock."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, 2): (0, 0) to drift, else the hop as a fraction of the longest."""
        self._prepare(worlds)
        params = self.batch.params
        actions = np.zeros((len(worlds), 2), dtype=np.float32)
        shortest = max(params.drift_threshold, 1e-3) * params.max_hop_m * 1.0001
        vehicle = (
            float(params.half_width_m), float(params.action_period_s), int(params.sub_steps),
            float(params.horizon_s), float(shortest), self._solver.euler,
        )  # fmt: skip
        if self._tables is None:  # every world is finished
            return actions
        lookahead.decide_all(
            worlds, worlds[self.field], self._slots, *self._tables, self._chart,
            self.batch.ocean, vehicle, actions,
        )  # fmt: skip
        return actions

    def bound_wh(self, *, spacing_m: float | None = None) -> np.ndarray:
        """Least flight energy, Wh, from each world's start on the true field: the task's bound, (num_worlds,).

        In a steady field drift may end at any time here, not only after whole action periods. The bound is
        the cost of a plan that lands on grid nodes, approached from above as the grid is refined: a
        policy that lands anywhere may beat it by the grid's error (see docs/optimal.md).
        """
        worlds = self.batch.worlds
        solver = _Solver(self.batch, spacing_m or self._solver.spacing_m, None)
        keys = solver.keys(worlds, "truth")
        bounds = np.empty(len(worlds))
        _, groups = np.unique(keys, axis=0, return_inverse=True)
        for group in range(groups.max() + 1):
            members = np.flatnonzero(groups == group)
            first = worlds[members[0]]
            found = solver.solve(first, first["truth"])
            bounds[members] = found.energy_wh(worlds["start_x"][members], worlds["start_y"][members])
        return bounds

    def _prepare(self, worlds: np.ndarray) -> None:
        """Solve what changed since the last call."""
        keys = self._solver.keys(worlds, self.field)
        changed = np.flatnonzero((keys != self._keys).any(-1) & (worlds["outcome"] == 0))
        for i in changed:
            self._keys[i] = keys[i]
            self._slots[i] = self._slot(worlds, int(i))

    def _slot(self, worlds: np.ndarray, i: int) -> int:
        key = tuple(self._keys[i])
        if key not in self._known:
            found = self._solver.solve(worlds[i], worlds[self.field][i], timed=self._timed)
            if len(found.times_s) > 1 and not self._timed:
                # One deadline that matters makes all value functions of the batch timed.
                self._timed = True
                self._known.clear()
                self._keys[:] = np.nan
                self._prepare(worlds)
                return int(self._slots[i])
            self._store(key, found)
        return self._known[key]

    def _store(self, key: tuple[float, ...], found: ValueFunction) -> None:
        tables = self._tables
        slots = 0 if tables is None else len(tables.values)
        free = set(range(slots)) - set(self._known.values())
        if not free and slots == self.batch.num_worlds:
            in_use = {tuple(row) for row in self._keys}
            for old in [known for known in self._known if known not in in_use]:
                free.add(self._known.pop(old))
        if tables is None or not free or tables.values.shape[1:] != found.tables.values.shape[1:]:
            size = min(max(2 * len(self._known), 1), self.batch.num_worlds)
            grown = Tables(*(np.zeros((size, *array.shape[1:]), array.dtype) for array in found.tables))
            if tables is not None and self._known:
                for array, rows in zip(grown, tables, strict=True):
                    array[: len(rows)] = rows
            self._tables = tables = grown
            free = set(range(size)) - set(self._known.values())
        slot = min(free)
        for array, new in zip(tables, found.tables, strict=True):
            array[slot] = new[0]
        self._known[key] = slot
        self._chart = found.chart

"""The least-flight-energy policy on a grid: eikonal flight and free drift (see ``docs/optimal.md``).

Its value at the start is the bound that the drift/hop task is scored against (solved on the
true field); the greedy policy on the forecast's value function is the planner ``optimal``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, PlanningError, check_choice, check_range
from aquaquad_envs.physics.grids import Grid
from baselines import lookahead
from baselines import value_function as kernels
from baselines.problem import DriftHopProblem
from baselines.value_function import Chart, Sea

#: Flight that an hour of drift may cost, m: breaks ties, so that no plan circles for nothing.
PRICE_M_PER_HOUR = 0.1
#: Longest integration step far from obstacles, s.
_LONGEST_STEP_S = 300.0
#: Slices of a value function in time at most, and periods of look-ahead in its table.
_MAX_SLICES, _LOOK_AHEAD = 145, 2
#: Nodes a side that a landing place can name.
_MAX_SIDE = 2**15
_MAX_ITERATIONS = 500


@dataclass(frozen=True, kw_only=True, eq=False)
class ValueFunction:
    """V(x, t): the least flight distance, m, from (x, t) into the goal disc, drift being free.

    V = min( min over h of |h| + V(x + h, t + |h|/airspeed),  min over τ of V(φ_τ(x, t), t + τ) ), V = 0
    in the goal disc, φ the drift; a drift that leaves the box or touches an obstacle is forbidden, as
    is landing there. SPEC §6, "the true optimum". An hour of drift is priced at
    ``PRICE_M_PER_HOUR`` (0.1 m) to break ties, which V includes.

    Parameters
    ----------
    distance: float32 (frames, rows, columns), V at the nodes, m; one frame where the field is steady
        (then without a deadline); inf in obstacles and where no plan arrives in time.
    landings: int32, same shape: landing place of the best flight, row << 16 | column; the node itself
        where drifting is best; -1 the goal, -2 none.
    grid: the nodes. times_s: mission time of each frame.
    iterations, change_m: of the steady fixed point, and its greatest last change anywhere (at most the
        tolerance); 1 and 0 where slices are swept once.
    """

    distance: np.ndarray
    landings: np.ndarray
    grid: Grid
    times_s: np.ndarray
    iterations: int
    change_m: float
    step_s: float
    problem: DriftHopProblem
    sea: Sea
    chart: Chart

    def at(self, x: Any, y: Any, time_s: Any = 0.0) -> np.ndarray:
        """V, m, at places and mission times (any shapes that broadcast); inf outside open water.

        Off the nodes the drift ahead is simulated, not interpolated.
        """
        x, y, t = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in (x, y, time_s)))
        out = np.empty(x.size)
        lookahead.values_at(
            self.sea, self.distance[None], self.landings[None], 0, self.chart,
            x.ravel(), y.ravel(), t.ravel(), self.step_s, self.problem.horizon_s, out,
        )  # fmt: skip
        return out.reshape(x.shape)

    def energy_wh(self, x: Any, y: Any, time_s: Any = 0.0) -> np.ndarray:
        """The least flight energy, Wh, from there to the goal."""
        return self.at(x, y, time_s) * self.problem.flight_energy_wh(1.0)

    def follow(self) -> tuple[float, float]:
        """Metres flown and duration, s, of the plan from the problem's start (landing on nodes)."""
        periods = int(self.problem.horizon_s / self.step_s + 1e-9)
        return lookahead.follow(
            self.sea, self.distance[None], self.landings[None], 0, self.chart,
            float(self.problem.start[0]), float(self.problem.start[1]), 0.0, self.step_s, periods,
        )  # fmt: skip


def solve(
    problem: DriftHopProblem,
    *,
    spacing_m: float = 100.0,
    tolerance_m: float = 1.0,
    action_period_s: float | None = None,
) -> ValueFunction:
    """The value function of ``problem`` on a grid of ``spacing_m``.

    A steady field is iterated to a fixed point (greatest change below ``tolerance_m``); if the plan from
    the start then outlasts the horizon, or the field changes with time, V is swept back from the
    horizon in slices instead. ``action_period_s``: a drift lasts a whole number of these; None lets it end
    every fourth integration step (steady), or at every slice of 600 s or more.
    """
    tables = _DriftTables.make(problem, spacing_m, action_period_s)
    return _solve(problem, tables, spacing_m, tolerance_m, action_period_s)


def _solve(
    problem: DriftHopProblem,
    tables: _DriftTables | None,
    spacing_m: float,
    tolerance_m: float,
    action_period_s: float | None,
    euler: bool = False,
) -> ValueFunction:
    check_range("tolerance_m", tolerance_m, 0, 1e6, open_low=True)
    if tables is not None:
        found = _fixed_point(problem, tables, tolerance_m)
        if found.follow()[1] <= problem.horizon_s or not np.isfinite(found.at(*problem.start)):
            return found
    return _swept_back(problem, spacing_m, action_period_s or 600.0, euler)


@dataclass(frozen=True, kw_only=True, eq=False)
class _DriftTables:
    """Drift from every node of a steady field: the part of the work that no goal changes."""

    sea: Sea
    grid: Grid
    sample_s: float
    stride: float
    paths: np.ndarray
    counts: np.ndarray
    visits: np.ndarray
    blocked: np.ndarray
    any_blocked: bool

    @staticmethod
    def make(
        problem: DriftHopProblem, spacing_m: float, action_period_s: float | None, euler: bool = False
    ) -> _DriftTables | None:
        """The tables, or None where the field changes with time."""
        grid, side = _grid(problem, spacing_m)
        if problem.velocity.shape[1] > 1:
            return None
        sample_s = min(action_period_s or 4.0 * problem.drift_step_s, problem.horizon_s)
        sea = _sea(problem, euler)
        paths = np.empty((side, side, max(int(problem.horizon_s / sample_s), 1), 2), dtype=np.float32)
        counts = np.zeros((side, side), dtype=np.int32)
        visits = np.zeros((side, side), dtype=np.uint64)
        kernels.drift_paths(sea, grid, sample_s, paths, counts, visits)
        blocked = np.zeros((side, side), dtype=bool)
        any_blocked = kernels.blocked_nodes(sea, grid, blocked)
        speed = float(np.sqrt(np.sum(problem.velocity[problem.field_index] ** 2, -1)).max())
        return _DriftTables(
            sea=sea, grid=grid, sample_s=sample_s, stride=max(speed * sample_s, 1e-3), paths=paths,
            counts=counts, visits=visits, blocked=blocked, any_blocked=any_blocked,
        )  # fmt: skip


def _grid(problem: DriftHopProblem, spacing_m: float) -> tuple[Grid, int]:
    width = 2 * problem.half_width_m
    check_range("spacing_m", spacing_m, width / _MAX_SIDE, width, remedy="Take about a hundredth of the box.")
    grid, side = Grid.square(float(problem.half_width_m), float(spacing_m))
    return Grid(*map(float, grid)), side


def _sea(problem: DriftHopProblem, euler: bool) -> Sea:
    fine = float(problem.drift_step_s)
    return Sea(
        velocity=problem.velocity, field=int(problem.field_index), axes=problem.axes,
        clearance=problem.clearance, layer=int(problem.obstacle_index),
        clearance_grid=Grid(*map(float, problem.clearance_grid)), half_width=float(problem.half_width_m),
        time0=float(problem.time_s), euler=euler, fine_step=fine,
        longest_step=fine if euler else max(fine, _LONGEST_STEP_S),
    )  # fmt: skip


def _chart(problem: DriftHopProblem, grid: Grid, time_step: float, end: float) -> Chart:
    return Chart(
        grid=grid, goal_x=float(problem.goal[0]), goal_y=float(problem.goal[1]),
        goal_radius=float(problem.goal_radius_m), max_hop=float(problem.max_hop_m),
        airspeed=float(problem.airspeed_m_s), time_step=float(time_step), end=float(end),
        price=PRICE_M_PER_HOUR / 3600.0,
    )  # fmt: skip


def _fixed_point(problem: DriftHopProblem, tables: _DriftTables, tolerance_m: float) -> ValueFunction:
    grid, blocked = tables.grid, tables.blocked
    chart = _chart(problem, grid, tables.sample_s, np.inf)
    values = np.full((1, 1, *blocked.shape), np.inf, dtype=np.float32)
    landings = np.full(values.shape, kernels.NOWHERE, dtype=np.int32)
    over = np.zeros(blocked.shape, dtype=np.float32)
    before = np.full(blocked.shape, np.nan, dtype=np.float32)
    kernels.seed_goal(values, landings, 0, 0, chart, blocked, over, 0.0)
    kernels.spread_flights(values, landings, 0, 0, chart, blocked, tables.any_blocked, over, 2)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        changed = np.uint64(kernels.changed_blocks(tables.sea, grid, before, values, 0))
        change = kernels.relax_drift(
            values, landings, 0, chart, over, tables.paths, tables.counts, tables.sample_s,
            tables.stride, tables.visits, changed,
        )  # fmt: skip
        kernels.spread_flights(values, landings, 0, 0, chart, blocked, tables.any_blocked, over, 1)
        if change < tolerance_m:
            break
    else:
        raise PlanningError(
            f"value function: still changing by {change:.3g} m after {_MAX_ITERATIONS} iterations, "
            f"expected less than {tolerance_m:g} m. Raise tolerance_m."
        )
    return ValueFunction(
        distance=_open_only(values[0], blocked), landings=landings[0], grid=grid, times_s=np.zeros(1),
        iterations=iteration, change_m=float(change), step_s=tables.sample_s, problem=problem,
        sea=tables.sea, chart=chart,
    )  # fmt: skip


def _swept_back(problem: DriftHopProblem, spacing_m: float, period_s: float, euler: bool) -> ValueFunction:
    grid, side = _grid(problem, spacing_m)
    # A whole number of periods a slice, so that long horizons stay affordable.
    step = period_s * max(1.0, np.ceil(problem.horizon_s / period_s / (_MAX_SLICES - 1)))
    frames = max(int(problem.horizon_s / step + 1e-9), 1) + 1
    step = min(step, problem.horizon_s)
    sea = _sea(problem, euler)
    chart = _chart(problem, grid, step, (frames - 1) * step)
    values = np.full((1, frames, side, side), np.inf, dtype=np.float32)
    landings = np.full(values.shape, kernels.NOWHERE, dtype=np.int32)
    blocked = np.zeros((side, side), dtype=bool)
    any_blocked = kernels.blocked_nodes(sea, grid, blocked)
    over = np.zeros((side, side), dtype=np.float32)
    kernels.sweep_back(sea, values, landings, 0, chart, blocked, any_blocked, over, _LOOK_AHEAD)
    return ValueFunction(
        distance=_open_only(values[0], blocked), landings=landings[0], grid=grid,
        times_s=step * np.arange(frames), iterations=1, change_m=0.0, step_s=step, problem=problem,
        sea=sea, chart=chart,
    )  # fmt: skip


def _open_only(values: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    # Nodes in obstacles hold the cost of passing over them, which is no V.
    values[:, blocked] = np.inf
    return values


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
        self.spacing_m = params.half_width_m / 50 if spacing_m is None else spacing_m
        self.action_period_s = action_period_s
        self.euler = params.integrator == "euler"
        self.steady = batch.ocean.velocity.shape[1] == 1
        self._tables: tuple[Any, _DriftTables | None] = (None, None)

    def keys(self, worlds: np.ndarray, field: str) -> np.ndarray:
        """What decides a world's value function, (num_worlds, 5)."""
        clock = np.zeros(len(worlds)) if self.steady else worlds["clock_s"]
        columns = (worlds[field], worlds["obstacle"], worlds["goal_x"], worlds["goal_y"], clock)
        return np.stack(columns, -1).astype(np.float64)

    def solve(self, world: np.ndarray, index: int, *, timed: bool = False) -> ValueFunction:
        problem = _problem(self.batch, world, index)
        if timed:
            return _swept_back(problem, self.spacing_m, self.action_period_s or 600.0, self.euler)
        key = (int(index), int(world["obstacle"]))
        if self._tables[0] != key:
            made = _DriftTables.make(problem, self.spacing_m, self.action_period_s, self.euler)
            self._tables = (key, made)
        return _solve(problem, self._tables[1], self.spacing_m, 1.0, self.action_period_s, self.euler)


class Optimal:
    """Greedy one-step look-ahead on the grid value function of a current field.

    Parameters
    ----------
    batch: the worlds it acts in (continuous actions).
    spacing_m: of the grid; None: a fiftieth of the half-width (100 m in the box of 10 km).
    field: which field it may know, "forecast" (default) or "truth" (for bounds and ablations).

    Deterministic: the seeds of :meth:`reset` change nothing.
    """

    information = "the forecast of the current over the whole mission, all obstacles, its own position, the goal and the clock"

    def __init__(self, batch: Any, *, spacing_m: float | None = None, field: str = "forecast") -> None:
        check_choice("field", field, ("forecast", "truth"))
        if batch.action_spec.table is not None:
            raise InvalidParameterError(
                "action_type",
                "discrete",
                "continuous actions",
                "Make the batch with action_type='continuous'.",
            )
        if field == "truth":
            self.information = self.information.replace("the forecast of", "the true", 1)
        self.batch = batch
        self.field = field
        self._solver = _Solver(batch, spacing_m, batch.params.action_period_s)
        self._keys = np.full((batch.num_worlds, 5), np.nan)
        self._slots = np.zeros(batch.num_worlds, dtype=np.int64)
        self._known: dict[tuple[float, ...], int] = {}
        self._timed = not self._solver.steady
        self._values = self._landings = np.empty((0, 0, 0, 0), dtype=np.float32)
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
        lookahead.decide_all(
            worlds, worlds[self.field], self._slots, self._values, self._landings, self._chart,
            self.batch.ocean, vehicle, actions,
        )  # fmt: skip
        return actions

    def bound_wh(self, *, spacing_m: float | None = None) -> np.ndarray:
        """Least flight energy, Wh, from each world's start on the true field: the task's bound, (num_worlds,).

        Drift may end at any time here, not only after whole action periods.
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
            self._slots[i] = self._slot(worlds, i)

    def _slot(self, worlds: np.ndarray, i: int) -> int:
        key = tuple(self._keys[i])
        if key not in self._known:
            found = self._solver.solve(worlds[i], worlds[self.field][i], timed=self._timed)
            if len(found.distance) > 1 and not self._timed:
                # One deadline that matters makes all value functions of the batch timed.
                self._timed = True
                self._known.clear()
                self._keys[:] = np.nan
                self._prepare(worlds)
                return int(self._slots[i])
            self._store(key, found)
        return self._known[key]

    def _store(self, key: tuple[float, ...], found: ValueFunction) -> None:
        in_use = {tuple(row) for row in self._keys}
        free = set(range(len(self._values))) - set(self._known.values())
        if not free and len(self._values) >= self.batch.num_worlds:
            for old in [known for known in self._known if known not in in_use]:
                free.add(self._known.pop(old))
        if not free or self._values.shape[1:] != found.distance.shape:
            size = min(max(2 * len(self._known), 1), self.batch.num_worlds)
            values = np.empty((size, *found.distance.shape), dtype=np.float32)
            landings = np.empty(values.shape, dtype=np.int32)
            if self._known:
                values[: len(self._values)] = self._values
                landings[: len(self._landings)] = self._landings
            self._values, self._landings = values, landings
            free = set(range(size)) - set(self._known.values())
        slot = min(free)
        self._values[slot], self._landings[slot] = found.distance, found.landings
        self._known[key] = slot
        self._chart = found.chart

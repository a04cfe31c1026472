"""The drift/hop value function on a grid: solved for one problem (see ``docs/optimal.md``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import PlanningError, check_range
from aquaquad_envs.physics.grids import Grid
from baselines import lookahead, value_steady, value_timed
from baselines.problem import DriftHopProblem
from baselines.value_function import (
    NOWHERE,
    Chart,
    Sea,
    Tables,
    blocked_nodes,
    seed_goal,
    spread_flights,
)

#: Flight that an hour of drift costs, m: breaks ties, so that no plan circles for nothing.
PRICE_M_PER_HOUR = 0.1
#: Longest integration step far from obstacles, s.
_LONGEST_STEP_S = 300.0
#: Slices of a value function in time, at most; length of one where nothing else is asked for, s.
_MAX_SLICES, _SLICE_S = 145, 600.0
#: Floats a node, at most, in a field that changes with time.
_FLOATS_A_NODE = 2.0
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
    tables: what the kernels read; :attr:`distance` is its readable part.
    grid: the nodes. times_s: mission time of each frame; one frame where the field is steady (then
        without a deadline).
    iterations, change_m: of the steady fixed point, and its greatest last change anywhere (at most the
        tolerance); 1 and 0 where slices are swept once.
    """

    tables: Tables
    grid: Grid
    times_s: np.ndarray
    iterations: int
    change_m: float
    step_s: float
    problem: DriftHopProblem
    sea: Sea
    chart: Chart

    @property
    def distance(self) -> np.ndarray:
        """V at the nodes, m, float32 (frames, rows, columns); inf in obstacles and where no plan is in time.

        In a field that changes with time it is that of flying at once (:meth:`at` also tries drifting).
        """
        return self.tables.values[0]

    def at(self, x: Any, y: Any, time_s: Any = 0.0) -> np.ndarray:
        """V, m, at places and mission times (any shapes that broadcast); inf outside open water.

        Off the nodes the drift ahead is simulated, not interpolated.
        """
        x, y, t = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in (x, y, time_s)))
        out = np.empty(x.size)
        lookahead.values_at(
            self.sea, *self.tables, 0, self.chart,
            x.flatten(), y.flatten(), t.flatten(), self.step_s, self.problem.horizon_s, out,
        )  # fmt: skip
        return out.reshape(x.shape)

    def energy_wh(self, x: Any, y: Any, time_s: Any = 0.0) -> np.ndarray:
        """The least flight energy, Wh, from there to the goal."""
        return self.at(x, y, time_s) * self.problem.flight_energy_wh(1.0)

    def follow(self) -> tuple[float, float]:
        """Metres flown and duration, s, of the plan from the problem's start (landing on nodes)."""
        periods = int(self.problem.horizon_s / self.step_s + 1e-9)
        return lookahead.follow(
            self.sea, *self.tables, 0, self.chart,
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
    tables = DriftTables.make(problem, spacing_m, action_period_s)
    return solve_with(problem, tables, spacing_m, tolerance_m, action_period_s)


def solve_with(
    problem: DriftHopProblem,
    tables: DriftTables | None,
    spacing_m: float,
    tolerance_m: float,
    action_period_s: float | None,
    euler: bool = False,
) -> ValueFunction:
    """As :func:`solve`, with drift ``tables`` made before (None where the field changes with time)."""
    check_range("tolerance_m", tolerance_m, 0, 1e6, open_low=True)
    if tables is not None:
        found = _fixed_point(problem, tables, tolerance_m)
        if found.follow()[1] <= problem.horizon_s or not np.isfinite(found.at(*problem.start)):
            return found
    return solve_timed(problem, spacing_m, action_period_s, euler)


@dataclass(frozen=True, kw_only=True, eq=False)
class DriftTables:
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
    ) -> DriftTables | None:
        """The tables, or None where the field changes with time."""
        grid, side = _grid(problem, spacing_m)
        if problem.velocity.shape[1] > 1:
            return None
        sample_s = min(action_period_s or 4.0 * problem.drift_step_s, problem.horizon_s)
        sea = _sea(problem, euler)
        paths = np.empty((side, side, max(int(problem.horizon_s / sample_s), 1), 2), dtype=np.float32)
        counts = np.zeros((side, side), dtype=np.int32)
        visits = np.zeros((side, side), dtype=np.uint64)
        value_steady.drift_paths(sea, grid, sample_s, paths, counts, visits)
        blocked = np.zeros((side, side), dtype=bool)
        any_blocked = blocked_nodes(sea, grid, blocked)
        speed = float(np.sqrt(np.sum(problem.velocity[problem.field_index] ** 2, -1)).max())
        return DriftTables(
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


def _fixed_point(problem: DriftHopProblem, drift: DriftTables, tolerance_m: float) -> ValueFunction:
    grid, blocked = drift.grid, drift.blocked
    chart = _chart(problem, grid, drift.sample_s, np.inf)
    tables = _empty_tables(1, blocked.shape, 0)
    before = np.full(blocked.shape, np.nan, dtype=np.float32)
    seed_goal(drift.sea, *tables, 0, 0, chart, blocked, 0.0)
    spread_flights(drift.sea, *tables, 0, 0, chart, blocked, drift.any_blocked, 2)
    change, iterations = np.inf, 0
    while change >= tolerance_m:
        if iterations == _MAX_ITERATIONS:
            raise PlanningError(
                f"value function: still changing by {change:.3g} m after {iterations} iterations, "
                f"expected less than {tolerance_m:g} m. Raise tolerance_m."
            )
        changed = np.uint64(value_steady.changed_blocks(drift.sea, grid, before, tables.values, 0))
        change = value_steady.relax_drift(
            tables.values, tables.landings, 0, chart, drift.paths, drift.counts, drift.sample_s, drift.stride,
            drift.visits, changed,
        )  # fmt: skip
        spread_flights(drift.sea, *tables, 0, 0, chart, blocked, drift.any_blocked, 1)
        iterations += 1
    # Nodes in obstacles hold the cost of passing over them, which is no V.
    tables.values[:, :, blocked] = np.inf
    return ValueFunction(
        tables=tables, grid=grid, times_s=np.zeros(1), iterations=iterations, change_m=float(change),
        step_s=drift.sample_s, problem=problem, sea=drift.sea, chart=chart,
    )  # fmt: skip


def solve_timed(
    problem: DriftHopProblem, spacing_m: float, period_s: float | None, euler: bool = False
) -> ValueFunction:
    """The value function with a deadline, whether or not the field changes with time."""
    period_s = period_s or _SLICE_S
    grid, side = _grid(problem, spacing_m)
    # A whole number of periods a slice, so that long horizons stay affordable.
    step = period_s * max(1.0, np.ceil(problem.horizon_s / period_s / (_MAX_SLICES - 1)))
    frames = max(int(problem.horizon_s / step + 1e-9), 1) + 1
    step = min(step, problem.horizon_s)
    sea = _sea(problem, euler)
    chart = _chart(problem, grid, step, (frames - 1) * step)
    tables = _empty_tables(frames, (side, side), int(_FLOATS_A_NODE * side * side))
    blocked = np.zeros((side, side), dtype=bool)
    any_blocked = blocked_nodes(sea, grid, blocked)
    states = np.zeros(tables.floats.shape[1:3], dtype=np.int8)
    near = np.zeros((side, side), dtype=np.int32)
    value_timed.release_floats(sea, tables.floats, states, 0, chart, blocked, near)
    value_timed.sweep_back(sea, *tables, states, 0, chart, blocked, any_blocked)
    tables.values[:, :, blocked] = np.inf
    return ValueFunction(
        tables=tables, grid=grid, times_s=step * np.arange(frames), iterations=1, change_m=0.0, step_s=step,
        problem=problem, sea=sea, chart=chart,
    )  # fmt: skip


def _empty_tables(frames: int, shape: tuple[int, ...], floats: int) -> Tables:
    return Tables(
        values=np.full((1, frames, *shape), np.inf, dtype=np.float32),
        landings=np.full((1, frames, *shape), NOWHERE, dtype=np.int32),
        floats=np.full((1, frames, floats, 3), np.inf, dtype=np.float32),
    )

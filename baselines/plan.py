"""A drift/hop plan, and how it is followed in a world with watch circles.

A plan is a chain of legs from the start to the goal: drifts that last a known time and
straight flights. Following is open loop in the drift: the vehicle takes off when, at its
scheduled decision, it is inside the *watch circle* of the planned take-off point, and flies
to the planned landing point, which takes the drift error back to zero (Dillard 2014, V.D).
Missing the circle, or straying from the planned track, asks for a new plan.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel

DRIFT, HOP = 0, 1
#: One leg: kind (DRIFT or HOP), from (x0, y0) at t0 to (x1, y1) at t1; m, s since the plan's start.
LEG = np.dtype([("kind", np.int64)] + [(name, np.float64) for name in ("x0", "y0", "x1", "y1", "t0", "t1")])

FOLLOWING, NEEDS_PLAN = 0, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A plan and what was claimed of it.

    Parameters
    ----------
    legs: structured array of dtype :data:`LEG`; empty where no plan was found. A flight is one
        leg however long; it is flown in equal pieces of at most the longest hop.
    track: drift and flight points for drawing, shape (n, 3): t (s), x, y (m).
    flight_energy_wh: energy of all flights, Wh; ``inf`` without success.
    success: whether the last leg ends within the goal radius.
    iterations: iterations used. planning_time_s: wall clock, excluded from equality.
    """

    legs: np.ndarray
    track: np.ndarray = field(repr=False)
    flight_energy_wh: float
    success: bool
    iterations: int
    planning_time_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time from start to arrival, s."""
        return float(self.legs["t1"][-1]) if len(self.legs) else 0.0

    @property
    def flights(self) -> np.ndarray:
        """The flight legs alone."""
        return self.legs[self.legs["kind"] == HOP]

    def __eq__(self, other: object) -> bool:
        """Whether two plans are the same, bit for bit; the time it took to find them does not count."""
        if not isinstance(other, Plan):
            return NotImplemented
        return (
            self.success == other.success
            and self.iterations == other.iterations
            and np.array_equal(self.legs, other.legs)
            and np.array_equal(self.track, other.track)
            and (self.flight_energy_wh == other.flight_energy_wh)
        )

    __hash__ = None  # type: ignore[assignment]

    @staticmethod
    def none(iterations: int, planning_time_s: float) -> Plan:
        """The plan that says that none was found."""
        return Plan(
            legs=np.empty(0, LEG), track=np.empty((0, 3)), flight_energy_wh=float("inf"),
            success=False, iterations=iterations, planning_time_s=planning_time_s,
        )  # fmt: skip


class FollowSettings(NamedTuple):
    """What the follower needs to know of the world and of the watch circles (m, s)."""

    watch_radius: float  # take off inside this distance of the planned take-off point
    deviation: float  # a new plan beyond this distance from the planned track
    patience: float  # s beyond the schedule before a circle counts as missed
    period: float  # s, one drift decision
    max_hop: float  # m
    min_hop: float  # m, shorter hops count as drift in the world


class Followed(NamedTuple):
    """Plans of many worlds as the compiled follower reads them (row = world)."""

    legs: np.ndarray  # (worlds, max legs), dtype LEG
    planned: np.ndarray  # (worlds,) legs of each plan
    leg: np.ndarray  # (worlds,) present leg
    started: np.ndarray  # (worlds,) mission time when the present leg began, s; NaN: not yet
    expected: np.ndarray  # (worlds, max points, 2) planned positions at the decisions of the drifts
    first: np.ndarray  # (worlds, max legs + 1) where each leg's positions begin in ``expected``


class PlanFollower:
    """Keeps the plans of ``num_worlds`` worlds and turns them into actions."""

    def __init__(self, num_worlds: int, settings: FollowSettings) -> None:
        self.settings = settings
        self.num_worlds = num_worlds
        self.status = np.full(num_worlds, NEEDS_PLAN)
        self._arrays = self._allocate(8, 80)

    def _allocate(self, legs: int, points: int) -> Followed:
        n = self.num_worlds
        return Followed(
            legs=np.zeros((n, legs), LEG), planned=np.zeros(n, np.int64), leg=np.zeros(n, np.int64),
            started=np.full(n, np.nan), expected=np.zeros((n, points, 2)),
            first=np.zeros((n, legs + 1), np.int64),
        )  # fmt: skip

    def clear(self, worlds: np.ndarray | None = None) -> None:
        """Forget the plans of ``worlds`` (all by default)."""
        chosen = slice(None) if worlds is None else worlds
        self._arrays.planned[chosen] = 0
        self.status[chosen] = NEEDS_PLAN

    def follow(self, world: int, plan: Plan) -> None:
        """Follow ``plan`` in ``world`` from now on; a plan without success leaves it without one."""
        expected, first = _expected_positions(plan, self.settings.period)
        self._grow(len(plan.legs), len(expected))
        arrays = self._arrays
        arrays.legs[world, : len(plan.legs)] = plan.legs
        arrays.expected[world, : len(expected)] = expected
        arrays.first[world, : len(first)] = first
        arrays.planned[world] = len(plan.legs) if plan.success else 0
        arrays.leg[world] = 0
        arrays.started[world] = np.nan
        self.status[world] = FOLLOWING if plan.success else NEEDS_PLAN

    def _grow(self, legs: int, points: int) -> None:
        old = self._arrays
        have_legs, have_points = old.legs.shape[1], old.expected.shape[1]
        if legs <= have_legs and points <= have_points:
            return
        new = self._allocate(max(2 * legs, have_legs), max(2 * points, have_points))
        for name in Followed._fields:
            before = getattr(old, name)
            getattr(new, name)[tuple(slice(size) for size in before.shape)] = before
        self._arrays = new

    def act(
        self, x: np.ndarray, y: np.ndarray, time_s: np.ndarray, running: np.ndarray, actions: np.ndarray
    ) -> None:
        """Write the rows of ``actions`` (worlds, 2) and of ``self.status`` of the running worlds.

        Positions ``x``, ``y`` in m, mission time in s; the other worlds' rows stay as they are.
        """
        _follow(self._arrays, self.settings, x, y, time_s, running, self.status, actions)


def _expected_positions(plan: Plan, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions at whole periods after the start of each drift, and where each leg's begin."""
    points, first = [], [0]
    times = plan.track[:, 0]
    for leg in plan.legs:
        if leg["kind"] == DRIFT:
            due = leg["t0"] + period * np.arange(int((leg["t1"] - leg["t0"]) / period + 1e-9) + 1)
            points.append(np.stack([np.interp(due, times, plan.track[:, i]) for i in (1, 2)], -1))
        first.append(first[-1] + (len(points[-1]) if leg["kind"] == DRIFT else 0))
    return (np.concatenate(points) if points else np.empty((0, 2))), np.array(first)


@loop_kernel
def _follow(plans, settings, x, y, time, running, status, actions):
    for i in range(x.size):
        if not running[i]:
            continue
        actions[i, 0] = 0.0
        actions[i, 1] = 0.0
        if status[i] == FOLLOWING:
            _follow_one(i, plans, settings, x[i], y[i], time[i], status, actions)


@loop_kernel
def _follow_one(i, plans, settings, x, y, time, status, actions):
    while plans.leg[i] < plans.planned[i]:
        number = plans.leg[i]
        leg = plans.legs[i, number]
        if leg["kind"] == HOP:
            dx = leg["x1"] - x
            dy = leg["y1"] - y
            distance = np.sqrt(dx * dx + dy * dy)
            pieces = max(np.ceil(distance / settings.max_hop - 1e-6), 1.0)
            # The world takes a hop below its threshold for a drift: fly the least hop instead.
            length = max(distance / pieces, settings.min_hop)
            if distance > 0.0:
                actions[i, 0] = dx / distance * length / settings.max_hop
                actions[i, 1] = dy / distance * length / settings.max_hop
            else:
                actions[i, 0] = length / settings.max_hop
            if pieces == 1.0:
                plans.leg[i] += 1
                plans.started[i] = np.nan
            return
        if np.isnan(plans.started[i]):
            plans.started[i] = time
        elapsed = time - plans.started[i]
        duration = leg["t1"] - leg["t0"]
        if elapsed + 0.5 * settings.period > duration:
            if (
                number + 1 < plans.planned[i]
                and _distance(x - leg["x1"], y - leg["y1"]) <= settings.watch_radius
            ):
                plans.leg[i] += 1
                continue
            if elapsed > duration + settings.patience:
                status[i] = NEEDS_PLAN
            return
        step = min(
            int(elapsed / settings.period + 0.5), plans.first[i, number + 1] - plans.first[i, number] - 1
        )
        planned = plans.expected[i, plans.first[i, number] + step]
        if _distance(x - planned[0], y - planned[1]) > settings.deviation:
            status[i] = NEEDS_PLAN
        return
    # The plan is used up and the goal was not reached.
    status[i] = NEEDS_PLAN


@kernel
def _distance(dx, dy):
    return np.sqrt(dx * dx + dy * dy)

"""DR-RRT*: the published planner in both variants, the product's own, and the policy that follows them.

See ``docs/dr_rrt_star.md`` for the algorithms, what is unclear in the source, and what was measured.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, PlanningError, check_choice, check_range
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import seed_streams
from baselines import dr_rrt_star_published as published
from baselines import dr_rrt_star_tree as tree_kernels
from baselines.dr_rrt_star_improve import (
    MAX_LANDINGS,
    Draft,
    complete,
    draft_legs,
    improve,
    improve_candidates,
)
from baselines.forecast_check import ForecastCheck
from baselines.plan import LEG, NEEDS_PLAN, FollowSettings, Plan, PlanFollower
from baselines.problem import DriftHopProblem, require_continuous_actions

#: Prices that break ties between plans of like energy: Wh per hour adrift and Wh per flight.
DRIFT_PRICE_WH_PER_H = 0.02
HOP_PRICE_WH = 0.02
ITERATIONS = 3000
#: m kept from obstacles beyond their own margin.
MARGIN_M = 25.0
#: Plans of the tree that are improved a little before the best of them is improved well.
CANDIDATES = 8
#: s; integration step of the drift far from everything.
COARSE_STEP_S = 300.0
#: The search wants a little more than the final plan must keep, so that finer steps do not undo it.
_RESERVE_M, _RESERVE_SHARE = 3.0, 0.97
#: s kept before the horizon once the forecast was seen to be wrong.
RESERVE_S = 1800.0
VARIANTS = ("product", "published-single", "published-seeking")

Seed = int | np.random.SeedSequence


def plan_published(
    problem: DriftHopProblem, *, seed: Seed, variant: str = "single", iterations: int = 25_000
) -> Plan:
    """Plan with the published DR-RRT* (Dillard, NPS 2014, App. C; SPEC §6).

    Parameters
    ----------
    problem: its field is used as it is at ``problem.time_s`` (the source knows no other time), constant
        per cell where the field says so; ``team`` and ``target`` enter the cost through the HDOP,
        which is left out where the team is empty.
    seed: decides the plan, bit for bit.
    variant: ``"single"`` stops at the first arrival; ``"seeking"`` runs all ``iterations`` and keeps the
        arrival of the least flight energy.

    Cost of a node: K1 HDOP/9000 + K2 distance/14142 - K4 for each second of a 60 s Euler drift step, and
    K3 (distance / longest hop) for a flight, (K1..K4) = (0.0225, 0.0225, 0.95, 0.005): drift is
    over-priced against flight, as published. Neither horizon nor battery nor the landings inside a merged
    flight are considered. Raises ``PlanningError`` or ``InvalidParameterError``.
    """
    check_choice("variant", variant, ("single", "seeking"))
    _check_iterations(iterations)
    began = time.perf_counter()
    tree = published.Tree.allocate(iterations)
    mission = published.Mission(
        _frozen(problem.velocity), problem.field_index, problem.axes, _frozen(problem.clearance),
        problem.obstacle_index, problem.clearance_grid, float(problem.time_s), float(problem.half_width_m),
        float(problem.goal[0]), float(problem.goal[1]), float(problem.goal_radius_m), float(problem.max_hop_m),
        float(problem.airspeed_m_s), _frozen(problem.team), float(problem.target[0]), float(problem.target[1]),
    )  # fmt: skip
    path = np.empty((len(tree.x), 3))
    length, used, _ = published.grow_published(
        tree, mission, float(problem.start[0]), float(problem.start[1]), int(iterations), variant == "seeking",
        seed_streams(seed)[0], path,
    )  # fmt: skip
    if not length:
        return Plan.none(used, time.perf_counter() - began)
    legs, track = np.zeros(length, LEG), np.empty((length, 3))
    num_legs, points = published.published_legs(path, length, mission, legs, track)
    return _plan(problem, legs[:num_legs], track[:points], used, began)


def plan(
    problem: DriftHopProblem,
    *,
    seed: Seed,
    iterations: int = ITERATIONS,
    action_period_s: float = 600.0,
    min_hop_m: float | None = None,
    margin_m: float = MARGIN_M,
    euler: bool = False,
) -> Plan:
    """Plan with the product's DR-RRT*: a sparse forward tree, then local improvement of its best plans.

    Parameters
    ----------
    seed: decides the plan, bit for bit.
    iterations: samples of the tree; two thirds as many changes are then tried on its best plans.
    action_period_s: drifts last a whole number of these from their landing, as the world has it; a multiple
        of ``problem.drift_step_s``.
    min_hop_m: shortest flight (None: just over a tenth of the longest hop, below which the world drifts).
    margin_m: least clearance of drifts and landings; less where start or goal lie nearer to an obstacle.
    euler: integrate drifts by forward Euler, else Runge–Kutta.

    Cost, Wh: flight energy + 0.02 per hour adrift + 0.02 per flight. Energy is what counts; the
    prices break ties. Currents may change with time; arrival is within ``problem.horizon_s``; the battery
    is not considered. Raises ``PlanningError`` or ``InvalidParameterError``.
    """
    _check_iterations(iterations)
    check_range("margin_m", margin_m, 0, 1e6)
    steps = round(action_period_s / problem.drift_step_s)
    if steps < 1 or abs(steps * problem.drift_step_s - action_period_s) > 1e-6 * action_period_s:
        raise InvalidParameterError(
            "action_period_s", action_period_s, f"a multiple of drift_step_s = {problem.drift_step_s:g} s"
        )
    began = time.perf_counter()
    state = seed_streams(seed)[0]
    coarse_steps = max(1, round(action_period_s / COARSE_STEP_S))
    searches = (coarse_steps, 0) if coarse_steps < steps and not euler else (0,)
    for coarse in searches:
        search, final = _missions(problem, action_period_s, steps, coarse, min_hop_m, margin_m, euler)
        draft = _search(problem, search, final, iterations, state)
        if np.isfinite(draft.total[0]):
            rows = int(np.sum(draft.takeoff[: draft.landings[0] + 1])) * steps + MAX_LANDINGS + 3
            legs, track = np.zeros(2 * MAX_LANDINGS + 2, LEG), np.empty((rows, 3))
            num_legs, points, _ = draft_legs(final, draft, legs, track)
            return _plan(problem, legs[:num_legs], track[:points], iterations, began)
    return Plan.none(iterations, time.perf_counter() - began)


def _search(
    problem: DriftHopProblem, search: tree_kernels.Mission, final: tree_kernels.Mission, iterations: int,
    state: np.ndarray,
) -> Draft:  # fmt: skip
    """The best draft found, its total infinite where there is none."""
    steady = problem.velocity.shape[1] == 1
    chain = int(problem.horizon_s / search.period) + 2
    bins = 1 if steady else max(1, int(np.ceil(problem.horizon_s / tree_kernels.TIME_BIN_S)))
    tree = tree_kernels.Sparse.allocate(iterations + 1, chain, bins)
    start = float(problem.start[0]), float(problem.start[1])
    nodes = tree_kernels.grow(tree, search, *start, iterations, 2.0 * problem.max_hop_m, state)
    best, *scratch = (Draft.allocate() for _ in range(4))
    budget = 2 * iterations // 3
    improve_candidates(tree, search, nodes, *scratch, best, steady, CANDIDATES, budget, state)
    if np.isfinite(best.total[0]):
        complete(final, best, 0, MAX_LANDINGS, best, np.inf, False)
    if np.isfinite(best.total[0]):
        improve(final, best, *scratch[:2], steady, budget // 10, state)
    return best


def _missions(
    problem: DriftHopProblem, period: float, steps: int, coarse_steps: int, min_hop: float | None,
    margin: float, euler: bool,
) -> tuple[tree_kernels.Mission, tree_kernels.Mission]:  # fmt: skip
    """The problem as searched, with a little in reserve, and as the final plan must keep it."""
    room = [
        clearance_at(problem.clearance, problem.obstacle_index, problem.clearance_grid, *map(float, point))
        for point in (problem.start, problem.goal)
    ]
    margin = max(0.0, min(margin + _RESERVE_M, *room))
    radius = float(problem.goal_radius_m)
    final = tree_kernels.Mission(
        velocity=_frozen(problem.velocity), field=problem.field_index, axes=problem.axes,
        clearance=_frozen(problem.clearance), layer=problem.obstacle_index, grid=problem.clearance_grid,
        time=float(problem.time_s), horizon=float(problem.horizon_s), half_width=float(problem.half_width_m),
        goal_x=float(problem.goal[0]), goal_y=float(problem.goal[1]), goal_radius=radius, aim=0.99 * radius,
        margin=max(0.0, margin - _RESERVE_M), max_hop=float(problem.max_hop_m),
        min_hop=float(0.1001 * problem.max_hop_m if min_hop is None else min_hop),
        airspeed=float(problem.airspeed_m_s), wh_per_m=problem.flight_energy_wh(1.0), hop_price=HOP_PRICE_WH,
        drift_price=DRIFT_PRICE_WH_PER_H / 3600.0, period=float(period), steps=steps, coarse_steps=0,
        euler=euler,
    )  # fmt: skip
    search = final._replace(
        margin=margin, goal_radius=_RESERVE_SHARE * radius, aim=0.99 * _RESERVE_SHARE * radius,
        coarse_steps=coarse_steps,
    )  # fmt: skip
    return search, final


def _plan(
    problem: DriftHopProblem, legs: np.ndarray, track: np.ndarray, iterations: int, began: float
) -> Plan:
    flights = legs[legs["kind"] == 1]
    flown = np.hypot(flights["x1"] - flights["x0"], flights["y1"] - flights["y0"]).sum()
    return Plan(
        legs=legs.copy(), track=track.copy(), flight_energy_wh=problem.flight_energy_wh(float(flown)),
        success=True, iterations=int(iterations), planning_time_s=time.perf_counter() - began,
    )  # fmt: skip


def _frozen(array: np.ndarray) -> np.ndarray:
    """A read-only view: kernels are compiled anew for arrays that may be written, so none may be."""
    view = np.ascontiguousarray(array).view()
    view.setflags(write=False)
    return view


def _check_iterations(iterations: int) -> None:
    if not isinstance(iterations, int | np.integer) or not 1 <= iterations <= 10_000_000:
        raise InvalidParameterError("iterations", iterations, "a whole number in [1, 10000000]")


class DrRrtStar:
    """Plans with DR-RRT* in every world and follows the plan, replanning on a miss.

    Parameters
    ----------
    batch: the drift/hop worlds.
    variant: ``"product"``, ``"published-single"`` or ``"published-seeking"``.
    iterations: of the planner; None for its default.
    watch_radius_m: a flight begins only this near to its planned take-off point.
    deviation_m: farther than this from the planned track a new plan is made.
    margin_m: clearance that the product's plans keep beyond the obstacles' own margin.

    A plan is made at the first action after a reset, from the seed given to :meth:`reset`, and again
    from the present place and time when a take-off is missed, the track is left, the plan ends without
    arrival, or drifting on would end in an obstacle or outside the box. Where the track has shown the
    forecast to be wrong, the product's new plans correct it by what was seen, keep four margins from
    obstacles and half an hour in reserve. Where no plan is found the vehicle drifts and tries again an hour later.
    """

    information = "the forecast current (never the truth), all obstacles, its own track and the clock"

    def __init__(
        self,
        batch: Any,
        *,
        variant: str = "product",
        iterations: int | None = None,
        watch_radius_m: float = 250.0,
        deviation_m: float = 500.0,
        margin_m: float = MARGIN_M,
    ) -> None:
        check_choice("variant", variant, VARIANTS)
        check_range("watch_radius_m", watch_radius_m, 0, 1e6, open_low=True)
        check_range("deviation_m", deviation_m, 0, 1e6, open_low=True)
        require_continuous_actions(batch)
        params = batch.params
        self.batch, self.variant, self.margin_m = batch, variant, margin_m
        self.iterations = iterations or (ITERATIONS if variant == "product" else 25_000)
        self._min_hop = 1.001 * params.drift_threshold * params.max_hop_m
        self._check = ForecastCheck(batch)
        self._follower = PlanFollower(
            batch.num_worlds,
            FollowSettings(
                watch_radius=float(watch_radius_m), deviation=float(deviation_m),
                patience=2.0 * params.action_period_s, period=float(params.action_period_s),
                max_hop=float(params.max_hop_m), min_hop=float(self._min_hop),
            ),
        )  # fmt: skip
        #: The plan that each world follows now, and how many were made for it since its reset.
        self.plans: list[Plan | None] = [None] * batch.num_worlds
        self.plan_counts = np.zeros(batch.num_worlds, dtype=np.int64)
        self.reset(np.arange(batch.num_worlds))

    def reset(self, seeds: np.ndarray) -> None:
        """Forget all plans; ``seeds`` (num_worlds,) decide the next ones."""
        self._seeds = [int(seed) for seed in seeds]
        self._forget(np.arange(self.batch.num_worlds))

    def _forget(self, worlds: np.ndarray) -> None:
        if not hasattr(self, "_last_time"):
            self._last_time = np.zeros(self.batch.num_worlds)
            self._retry_at = np.zeros(self.batch.num_worlds)
        self._follower.clear(worlds)
        self._check.clear(worlds)
        self.plan_counts[worlds] = 0
        self._last_time[worlds] = 0.0
        self._retry_at[worlds] = 0.0
        for i in worlds:
            self.plans[i] = None

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, 2): the hop as a fraction of the longest, (0, 0) to drift."""
        del observations
        now = worlds["time_s"]
        again = np.flatnonzero(now < self._last_time)
        if len(again):  # reset by itself, without a reset of the policy
            self._forget(again)
        self._last_time[:] = now
        actions = np.zeros((len(worlds), 2), dtype=np.float32)
        running = worlds["outcome"] == 0
        self._check.observe(worlds)
        follower = self._follower
        follower.act(worlds["x"], worlds["y"], now, running, actions)
        self._plan_where(running & (follower.status == NEEDS_PLAN) & (now >= self._retry_at), worlds, actions)
        danger = self._check.dangers(worlds, running & ~actions.any(axis=1), 0.0)
        self._plan_where(danger, worlds, actions)
        return actions

    def _plan_where(self, chosen: np.ndarray, worlds: np.ndarray, actions: np.ndarray) -> None:
        """Make new plans for the ``chosen`` worlds and write what they do first."""
        if chosen.any():
            for i in np.flatnonzero(chosen):
                self._make_plan(int(i), worlds[i])
            self._follower.act(worlds["x"], worlds["y"], worlds["time_s"], chosen, actions)

    def _make_plan(self, i: int, world: np.void) -> None:
        seed = np.random.SeedSequence([self._seeds[i], int(self.plan_counts[i])])
        self.plan_counts[i] += 1
        try:
            found = self._planned(i, world, seed)
        except PlanningError:
            # The vehicle floats where no plan may begin (at the very edge): drift on.
            found = Plan.none(0, 0.0)
        self.plans[i] = found
        self._follower.follow(i, found)
        if not found.success:
            self._retry_at[i] = world["time_s"] + 3600.0

    def _planned(self, i: int, world: np.void, seed: np.random.SeedSequence) -> Plan:
        params, ocean = self.batch.params, self.batch.ocean
        goal = float(world["goal_x"]), float(world["goal_y"])
        field, left = int(world["forecast"]), float(params.horizon_s - world["time_s"])
        corrected = self._check.corrected(i, field) if self.variant == "product" else None
        wrong = corrected is not None
        if wrong and left > 2 * RESERVE_S:
            left -= RESERVE_S
        problem = DriftHopProblem(
            velocity=ocean.velocity if corrected is None else corrected, axes=ocean.axes, clearance=ocean.clearance,
            clearance_grid=ocean.clearance_grid, field_index=0 if wrong else field,
            obstacle_index=int(world["obstacle"]), start=(float(world["x"]), float(world["y"])), goal=goal,
            half_width_m=params.half_width_m, goal_radius_m=params.goal_radius_m, max_hop_m=params.max_hop_m,
            airspeed_m_s=params.airspeed_m_s, flight_power_w=params.flight_power_w,
            time_s=float(world["clock_s"] + world["time_s"]),
            horizon_s=max(left, 1.0),
            drift_step_s=params.action_period_s / params.sub_steps, team=self.batch.constants.team,
            target=(goal[0] + params.target_offset[0], goal[1] + params.target_offset[1]),
        )  # fmt: skip
        if self.variant != "product":
            kind = self.variant.removeprefix("published-")
            return plan_published(problem, seed=seed, variant=kind, iterations=self.iterations)
        return plan(
            problem, seed=seed, iterations=self.iterations, action_period_s=params.action_period_s,
            min_hop_m=self._min_hop, margin_m=(4 if wrong else 1) * self.margin_m, euler=params.integrator == "euler",
        )  # fmt: skip

"""Far places by way of the current: ``hdop-optimal`` on routes of drifts and hops that DR-RRT* plans.

A place beyond one hop need not be flown to at once. Where a plan (:func:`baselines.dr_rrt_star.plan`) needs less
flight energy than the straight flight, the vehicle follows it until it ends, misses its watch circle, leads into
danger, or the place wanted has moved away.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import PlanningError
from aquaquad_envs.physics.vehicle import flight_energy_wh
from baselines import dr_rrt_star
from baselines.hdop_optimal_paths import Paths, Settings, find_path
from baselines.plan import FOLLOWING, FollowSettings, PlanFollower
from baselines.problem import DriftHopProblem

_ITERATIONS = 800
#: In longest hops: how near a route must end, and how far its end may come to lie from the place wanted.
_ARRIVAL, _OUTDATED = 0.2, 0.75
#: Share of the straight flight's energy that a route may need.
_WORTHWHILE = 0.8
#: m; a flight begins this near to its planned take-off point: hops here end with a drift, so plans are met less well.
_WATCH_M, _DEVIATION_M = 300.0, 600.0


class Routes:
    """Routes of all vehicles of ``batch``; a vehicle has one or none."""

    def __init__(self, batch: Any, settings: Settings) -> None:
        self.batch, self.settings = batch, settings
        params = batch.params
        self._rows = batch.num_worlds * batch.num_agents
        self._follower = PlanFollower(
            self._rows,
            FollowSettings(
                watch_radius=_WATCH_M, deviation=_DEVIATION_M, patience=2.0 * params.action_period_s,
                period=float(params.action_period_s), max_hop=settings.reach, min_hop=settings.least,
            ),
        )  # fmt: skip
        self._goals = np.full((self._rows, 2), np.nan)
        #: Routes followed since the reset, by vehicle.
        self.taken = np.zeros(self._rows, dtype=np.int64)
        self._tried = np.zeros(self._rows, dtype=np.int64)
        self._seeds = np.zeros(batch.num_worlds, dtype=np.int64)
        self._check = Paths.allocate(1, settings.decisions)

    def reset(self, seeds: np.ndarray) -> None:
        """Forget all routes; ``seeds`` (num_worlds,) decide what the next ones are drawn from."""
        self._follower.clear()
        self._goals[:] = np.nan
        self.taken[:] = self._tried[:] = 0
        self._seeds[:] = seeds

    def redirect(self, k: int, world: Any, goals: np.ndarray, actions: np.ndarray) -> None:
        """Change the ``actions`` of vehicles of world ``k`` that go by a route; ``goals`` are the places wanted.

        A vehicle that is content to drift (NaN) ends its route.
        """
        agents = self.batch.num_agents
        reach = self.settings.reach
        for i in range(agents):
            row = k * agents + i
            here = np.array([world["x"][i], world["y"][i]])
            away = np.hypot(*(goals[i] - here))
            if world["agent_outcome"][i] != 0 or not away > reach:
                self._drop(row)
                continue
            if not np.hypot(*(self._goals[row] - goals[i])) <= _OUTDATED * reach:
                self._drop(row)
                self._plan(k, i, world, here, goals[i], away)
            action = self._step(row, world, i)
            if action is not None:
                actions[i] = action

    def _drop(self, row: int) -> None:
        self._follower.clear(np.array([row]))
        self._goals[row] = np.nan

    def _plan(self, k: int, i: int, world: Any, here: np.ndarray, goal: np.ndarray, away: float) -> None:
        batch, row = self.batch, k * self.batch.num_agents + i
        params, ocean, c = batch.params, batch.ocean, batch.constants
        self._tried[row] += 1
        # Kept without a plan too: what was found not to be worth it is not tried at every decision.
        self._goals[row] = goal
        left = min(params.horizon_s - world["time_s"], self.settings.decisions * params.action_period_s)
        try:
            problem = DriftHopProblem(
                velocity=ocean.velocity, axes=ocean.axes, clearance=ocean.clearance,
                clearance_grid=ocean.clearance_grid, field_index=int(world["forecast"]),
                obstacle_index=int(world["obstacle"]), start=tuple(here), goal=tuple(goal),
                half_width_m=params.half_width_m, goal_radius_m=_ARRIVAL * params.max_hop_m,
                max_hop_m=self.settings.reach, airspeed_m_s=params.airspeed_m_s, flight_power_w=params.flight_power_w,
                time_s=float(world["clock_s"] + world["time_s"]), horizon_s=float(max(left, params.action_period_s)),
                drift_step_s=params.action_period_s / params.sub_steps,
            )  # fmt: skip
            found = dr_rrt_star.plan(
                problem, seed=np.random.SeedSequence([int(self._seeds[k]), i, int(self._tried[row])]),
                iterations=_ITERATIONS, action_period_s=params.action_period_s, min_hop_m=self.settings.least,
                margin_m=self.settings.margin, euler=c.euler,
            )  # fmt: skip
        except PlanningError:
            return  # at the very edge, where no plan may begin or end
        straight = flight_energy_wh(away, c.airspeed, c.flight_power)
        if found.success and found.flight_energy_wh < _WORTHWHILE * straight:
            self._follower.follow(row, found)
            self.taken[row] += 1

    def _step(self, row: int, world: Any, i: int) -> np.ndarray | None:
        """The action on the route, None where there is none or it would end in danger."""
        if self._follower.status[row] != FOLLOWING:
            return None
        x, y, time_s, running = (np.zeros(self._rows, kind) for kind in (float, float, float, bool))
        x[row], y[row], time_s[row] = world["x"][i], world["y"][i], world["time_s"]
        running[row] = True
        actions = np.zeros((self._rows, 2))
        self._follower.act(x, y, time_s, running, actions)
        if self._follower.status[row] != FOLLOWING:
            self._drop(row)
            return None
        hop = actions[row] * self.settings.reach
        paths = self._check
        paths.goes[i, 0] = bool(np.any(hop))
        paths.place[i, 0] = x[row] + hop[0], y[row] + hop[1]
        find_path(i, 0, world, self.batch.ocean, self.batch.constants, self.settings, paths)
        if not paths.usable[i, 0]:
            self._drop(row)
            return None
        return hop / self.batch.params.max_hop_m

"""``hdop-optimal``: hops to where the team's predicted position error is least, energy priced.

Every decision anew, for each world: every vehicle has a fan of places, near and several hops away, and the path to each
(:mod:`baselines.hdop_optimal_paths`). One place a vehicle is chosen by descent, vehicle after vehicle, on the
predicted error over the look-ahead (:mod:`baselines.hdop_optimal_cost`), from two starts: all drift on; and an even
spread about the targets (or along the fence), whose places are assigned to vehicles for the least distance
(``scipy.optimize.linear_sum_assignment``). The places found are at last assigned anew likewise, if that costs
less. The first hop of each path is made.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import check_choice, check_range
from aquaquad_envs.estimation.kalman_motion import predict_state
from aquaquad_envs.sensing.measurements import BEARING
from aquaquad_envs.tasks.sensor_placement_data import RUNNING
from aquaquad_envs.tasks.sensor_placement_targets import fence_point
from baselines.hdop_optimal_cost import Beliefs, cost, descend
from baselines.hdop_optimal_paths import Paths, find_fan, find_path, first_step, make_fan, make_settings
from baselines.problem import require_continuous_actions

THROUGH = ("hops", "dr-rrt-star")
#: Directions of the fan from that of the nearest target, and distances in longest steps: of hops, and steered.
_HEADINGS = 16
_HOPS, _STEERED = (0.25, 0.5, 1.0, 2.0, 3.5), (1.0, 3.0, 8.0, 16.0)
#: Radius of the even spread in longest steps: bearings gain by nearness, ranges and TDOA do not.
_NEAR, _WIDE = 0.25, 1.0
#: Rotations of the even spread that are tried.
_ROTATIONS = 4
#: Distance of a place on land from everybody, m.
_NEVER = 1e9


class HdopOptimal:
    """Minimises the predicted position error of the tracks over ``lookahead_s``.

    Parameters
    ----------
    price_per_wh: what a Wh of flight must gain, as a share of the predicted RMSE (or of the fence).
    margin_m: clearance that landings and drifts keep. reserve: share of the battery that is never flown.
    through: "hops", straight and one after another; or "dr-rrt-star", places further than one hop are made for
        on routes of drifts and hops where these need less energy.

    Seeds of :meth:`reset` decide what ``dr-rrt-star`` draws.
    """

    information = (
        "tracks and their covariances, all vehicles, the forecast, all obstacles; not the targets themselves"
    )

    def __init__(
        self, batch: Any, *, lookahead_s: float | None = None, price_per_wh: float = 0.01, margin_m: float = 50.0,
        reserve: float = 0.05, through: str = "hops",
    ) -> None:  # fmt: skip
        require_continuous_actions(batch)
        c = batch.constants
        if lookahead_s is None:
            lookahead_s = 20 * c.action_period if c.steered else 3600.0
        check_range("lookahead_s", lookahead_s, 0.0, 1e6, open_low=True)
        check_range("price_per_wh", price_per_wh, 0.0, 1e6)
        check_range("margin_m", margin_m, 0.0, 1e5)
        check_range("reserve", reserve, 0.0, 1.0)
        check_choice("through", through, THROUGH)
        self.batch = batch
        self.settings = make_settings(
            batch, lookahead_s=lookahead_s, margin_m=margin_m, price_per_wh=price_per_wh, reserve=reserve
        )
        lengths = _STEERED if c.steered else _HOPS
        self.fan = make_fan(self.settings, headings=_HEADINGS, lengths=lengths)
        #: Paths that are assigned lie behind those of the fan.
        self.places = len(self.fan)
        self.paths = Paths.allocate(self.places + 2, self.settings.decisions)
        self.beliefs = Beliefs.allocate(c.states, self.settings.decisions)
        self.routes = None
        if through == "dr-rrt-star" and not c.steered:
            from baselines.hdop_optimal_routes import Routes

            self.routes = Routes(batch, self.settings)

    def reset(self, seeds: np.ndarray) -> None:
        """Begin an episode in every world."""
        if self.routes is not None:
            self.routes.reset(seeds)

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, vehicles, 2)."""
        actions = np.zeros((len(worlds), self.batch.num_agents, 2), dtype=np.float32)
        for k in np.flatnonzero(worlds["outcome"] == RUNNING):
            self._decide(worlds[k], actions[k])
            if self.routes is not None:
                self.routes.redirect(int(k), worlds[k], self._goals(), actions[k])
        return actions

    def _goals(self) -> np.ndarray:
        """The place of each vehicle, (vehicles, 2), m; NaN where it drifts."""
        everybody = np.arange(self.batch.num_agents)
        chosen = self.beliefs.chosen[everybody]
        goes = self.paths.goes[everybody, chosen]
        return np.where(goes[:, None], self.paths.place[everybody, chosen], np.nan)

    def _decide(self, world: Any, actions: np.ndarray) -> None:
        ocean, c = self.batch.ocean, self.batch.constants
        settings, paths, beliefs = self.settings, self.paths, self.beliefs
        left = round((c.horizon - world["time_s"]) / c.action_period)
        decisions = int(np.clip(left, 1, settings.decisions))
        _believe(world, decisions, ocean, c, settings, self.fan, paths, beliefs)
        safest = beliefs.chosen.copy()
        found = descend(world, self.places, decisions, paths, beliefs, c, settings)
        best, chosen = found, beliefs.chosen.copy()
        if self._take_places(world, self._spread(world), safest, self.places):
            found = descend(world, self.places, decisions, paths, beliefs, c, settings)
            if found < best:
                best, chosen = found, beliefs.chosen.copy()
        goes = paths.goes[np.arange(len(chosen)), chosen]
        places = paths.place[np.arange(len(chosen)), chosen][goes & (world["agent_outcome"] == RUNNING)]
        movers = np.flatnonzero(goes & (world["agent_outcome"] == RUNNING))
        if len(places) > 1 and self._take_places(world, places, chosen, self.places + 1, movers):
            found = cost(world, decisions, best, paths, beliefs, c, settings)
            if found < best:
                best, chosen = found, beliefs.chosen.copy()
        beliefs.chosen[:] = chosen
        _act(world, c, settings, paths, beliefs, actions)

    def _spread(self, world: Any) -> np.ndarray:
        """Places for all vehicles, (vehicles, 2), m: evenly along the fence, else about the targets."""
        c, count = self.batch.constants, self.batch.num_agents
        if c.fence:
            later = np.array([world["fence_u"], world["fence_v"]]) * c.action_period
            shares = (np.arange(count) + 0.5) / count
            return np.array([fence_point(world, share) for share in shares]) + later
        targets = self.beliefs.track[: c.num_targets, 0]
        middle = targets.mean(0)
        apart = np.hypot(*(targets - middle).T).max() if c.num_targets > 1 else 0.0
        radius = max((_NEAR if c.kind == BEARING else _WIDE) * self.settings.reach, 0.7 * apart)
        here = np.stack([world["x"], world["y"]], -1)[:count]
        turns = 2.0 * np.pi / count * np.arange(_ROTATIONS) / _ROTATIONS
        rings = [
            middle + radius * np.stack([np.cos(turn + _angles(count)), np.sin(turn + _angles(count))], -1)
            for turn in turns
        ]
        half = c.half_width - self.settings.margin
        rings = [np.clip(ring, -half, half) for ring in rings]
        return min(rings, key=lambda ring: assign(_distances(here, ring))[1])

    def _take_places(
        self,
        world: Any,
        places: np.ndarray,
        fallback: np.ndarray,
        slot: int,
        vehicles: np.ndarray | None = None,
    ) -> bool:
        """Send ``vehicles`` to ``places`` for the least distance; others, and those that cannot, keep ``fallback``.

        Paths go to ``slot``. False if nothing changed.
        """
        beliefs, paths = self.beliefs, self.paths
        beliefs.chosen[:] = fallback
        count = self.batch.num_agents
        if vehicles is None:
            vehicles = np.flatnonzero(world["agent_outcome"][:count] == RUNNING)
        here = np.stack([world["x"], world["y"]], -1)[vehicles]
        chosen, _ = assign(_distances(here, places))
        if slot > self.places and np.array_equal(chosen, np.arange(len(vehicles))):
            return False
        for i, place in zip(vehicles, chosen, strict=True):
            paths.place[i, slot] = places[place]
            paths.goes[i, slot] = True
            find_path(i, slot, world, self.batch.ocean, self.batch.constants, self.settings, paths)
            if paths.usable[i, slot]:
                beliefs.chosen[i] = slot
        return True


def assign(distances: np.ndarray) -> tuple[np.ndarray, float]:
    """Place of each vehicle for the least sum of ``distances`` (vehicles, places), and that sum."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(distances)
    return columns, float(distances[rows, columns].sum())


def _distances(here: np.ndarray, places: np.ndarray) -> np.ndarray:
    return np.hypot(*np.moveaxis(here[:, None] - places[None], -1, 0))


def _angles(count: int) -> np.ndarray:
    return 2.0 * np.pi * np.arange(count) / count


@loop_kernel
def _believe(w, decisions, ocean, c, settings, fan, paths, beliefs):
    """Expected tracks of the targets and paths of all vehicles; chosen: drifting on, or what is safest."""
    state = np.empty(c.states)
    for j in range(c.num_targets):
        for k in range(c.states):
            state[k] = w.estimate[j, k]
        for d in range(decisions):
            predict_state(state, c.action_period, c.motion)
            beliefs.track[j, d, 0] = state[0]
            beliefs.track[j, d, 1] = state[1]
    for i in range(c.num_vehicles):
        beliefs.chosen[i] = 0
        if w.agent_outcome[i] != RUNNING:
            paths.goes[i, :] = False
            continue
        heading_x = 1.0
        heading_y = 0.0
        nearest = np.inf
        for j in range(c.num_targets):
            dx = beliefs.track[j, 0, 0] - w.x[i]
            dy = beliefs.track[j, 0, 1] - w.y[i]
            away = np.sqrt(dx * dx + dy * dy)
            if 0.0 < away < nearest:
                nearest = away
                heading_x = dx / away
                heading_y = dy / away
        safest = find_fan(i, heading_x, heading_y, w, ocean, c, settings, fan, paths)
        if not paths.usable[i, 0]:
            beliefs.chosen[i] = safest


@loop_kernel
def _act(w, c, settings, paths, beliefs, actions):
    for i in range(c.num_vehicles):
        k = beliefs.chosen[i]
        if w.agent_outcome[i] == RUNNING and paths.goes[i, k]:
            to_x = paths.place[i, k, 0]
            to_y = paths.place[i, k, 1]
            dx, dy = first_step(w.x[i], w.y[i], to_x, to_y, settings)
            scale = settings.reach if c.steered else c.max_hop
            if not c.steered or (to_x - w.x[i]) ** 2 + (to_y - w.y[i]) ** 2 > 0.0:
                actions[i, 0] = dx / scale
                actions[i, 1] = dy / scale


class KnownTargets(HdopOptimal):
    """``hdop-optimal`` that is told the targets' true states and pays nothing for flight.

    It plans from the posterior Cramér–Rao bound instead of the tracker's covariance. The bound along its
    tracks is the end of the score.
    """

    information = "the targets' true positions and velocities, the bound, the forecast, all obstacles"

    def __init__(self, batch: Any) -> None:
        super().__init__(batch, price_per_wh=0.0)

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, vehicles, 2)."""
        told = worlds.copy()
        for k, name in enumerate(("target_x", "target_y", "target_u", "target_v")):
            told["estimate"][:, :, k] = worlds[name]
        told["estimate"][:, :, 4:] = 0.0
        known = worlds["bound"].shape[-1]
        told["covariance"][:, :, :known, :known] = worlds["bound"]
        return super().act(observations, told)

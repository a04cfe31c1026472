"""The trajectory that would localize transponders best if one knew where they are: the bound of the task's score.

All actions u_1 ... u_{N-1} of an episode at once maximise Σ_m ln det(P0⁻¹ + σ⁻² Σ_n h_mn h_mnᵀ), h taken at the
*true* positions, in the *true* currents, every reply expected (:func:`~baselines.omlp_value.value_and_slope` with the
horizon of the whole episode; hops are free as far as the battery carries). The vehicle follows it open loop.

The problem has many local optima, and no method here proves the global one. Climbs start from receding-horizon plans
with known transponders, from the tree of :mod:`baselines.omlp_search` over the whole horizon, and from sequences of
random and of constant steps; the best ones go on until they stand still, and are then shaken and climbed again. What
is returned is a lower estimate of the bound, :attr:`KnownTransponders.spread` what the starts differed by. The draws
are the same for every world: the plan of a world depends on nothing else.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.symmetric3 import add_line_of_sight
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks.transponder_localization_data import AQUAQUAD, MAX_TRANSPONDERS, YAW_RATE
from aquaquad_envs.tasks.transponder_localization_truth import true_information
from baselines.omlp import worth_of
from baselines.omlp_search import affordable, best_plan, make_grids, make_tree, search_leaves, write_leaf
from baselines.omlp_value import Scene, Worth, advance, climb, feasible, make_trail
from baselines.problem import require_continuous_actions

_SEED = 0x424E44
#: Random starts by their number of equal pieces, and constant ones.
_PIECES = (1, 2, 3, 4, 6, 10, 15)
_EACH = 4
#: Longest horizon of the receding plans that climbs start from.
_RECEDING = 3
#: Steps of a climb from a start, from the best starts, and of the last one; how many starts are the best.
_FIRST, _SECOND, _LAST = 80, 300, 3000
_BEST = 4
#: Rounds of shaking the best plan, and how much, as a share of a full action.
_SHAKES, _SHAKEN = 24, 0.4
_TOLERANCE = 1e-7


class KnownTransponders:
    """Follows the best trajectory of all that climbs found from known transponders, open loop.

    ``memory``: plans by problem, which may be shared by instances for worlds of equal parameters; equal problems are
    solved once. Raises ``InvalidParameterError`` for worlds with discrete actions or of another task.
    """

    information = "the transponders' true positions and the true currents"

    def __init__(
        self,
        batch: Any,
        *,
        shakes: int = _SHAKES,
        memory: dict[bytes, tuple[np.ndarray, float, float]] | None = None,
    ) -> None:
        if batch.task.name != "transponder-localization":
            raise InvalidParameterError("task", batch.task.name, "transponder-localization")
        require_continuous_actions(batch)
        check_range("shakes", shakes, 0, 10_000)
        self.batch = batch
        self.steps = batch.constants.num_measurements - 1
        self.memory = {} if memory is None else memory
        self.starts, self.noise = _draws(self.steps, int(shakes))
        #: Of each world: actions (num_worlds, steps, 2), Σ ln det at the end, and what the climbs' ends differ by.
        self.plans = np.zeros((batch.num_worlds, self.steps, 2))
        self.values = np.full(batch.num_worlds, np.nan)
        self.spread = np.full(batch.num_worlds, np.nan)
        self._planned = np.zeros(batch.num_worlds, dtype=bool)

    def reset(self, seeds: np.ndarray) -> None:
        """Forget the plans."""
        self._planned[:] = False

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, size)."""
        fresh = (worlds["count"] == 1) & ~self._planned
        for k in np.flatnonzero(fresh):
            self.plans[k], self.values[k], self.spread[k] = self._solve(worlds[k : k + 1])
            self._planned[k] = True
        due = np.clip(worlds["count"] - 1, 0, self.steps - 1)
        actions = self.plans[np.arange(len(worlds)), due]
        return actions[:, : self.batch.action_spec.size].astype(np.float32)

    def _solve(self, world: np.ndarray) -> tuple[np.ndarray, float, float]:
        key = self._key(world[0])
        if key not in self.memory:
            self.memory[key] = self._best(world)
        return self.memory[key]

    def _key(self, w: np.ndarray) -> bytes:
        c = self.batch.constants
        parts = [w[name].tobytes() for name in ("x", "y", "heading", "num_transponders", "target")]
        # Misses and outliers are not foreseen, but the first reply has been.
        parts.append(np.isfinite(w["ranges"][:, 0]).tobytes())
        if not c.still_water or c.vehicle == AQUAQUAD:
            parts += [w[name].tobytes() for name in ("truth", "obstacle", "clock_s", "battery_wh")]
        return repr((self.batch.params, parts)).encode()

    def _best(self, world: np.ndarray) -> tuple[np.ndarray, float, float]:
        batch = self.batch
        plan, ends = np.zeros((self.steps, 2)), np.zeros(2)
        turning = batch.constants.vehicle == YAW_RATE
        worth = worth_of(batch, priced=False)
        for attempt in range(20):
            full_plan(
                world, make_grids(_RECEDING, turning=turning), make_grids(self.steps, turning=turning), self.starts,
                self.noise, plan, ends, batch.ocean, batch.constants, worth,
            )  # fmt: skip
            if self._flies(world[0], plan):
                break
            # Flight must cost something for the battery to last.
            worth = Worth(worth.weight, 0.02 * 2.0**attempt, worth.margin)
        return plan, float(ends[0]), float(ends[0] - ends[1])

    def _flies(self, w: np.ndarray, plan: np.ndarray) -> bool:
        """Whether the battery lasts, without the sun's help."""
        c = self.batch.constants
        if c.vehicle != AQUAQUAD:
            return True
        hops = c.max_hop * np.hypot(*plan.T).sum()
        spent = (
            flight_energy_wh(hops, c.airspeed, c.flight_power) + c.base_power * c.period * self.steps / 3600.0
        )
        return bool(spent < w["battery_wh"])


def _draws(steps: int, shakes: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts (n, steps, 2) and shakes (shakes, steps, 2): the same whatever the world."""
    draw = np.random.default_rng([_SEED, steps])
    rows = []
    for pieces in _PIECES:
        for _ in range(_EACH):
            values = draw.uniform(-1.0, 1.0, (min(pieces, steps), 2))
            rows.append(values[np.arange(steps) * len(values) // steps])
    for turn in (-1.0, -0.5, 0.5, 1.0):
        rows.append(np.full((steps, 2), turn))
    return np.array(rows), _SHAKEN * draw.normal(size=(shakes, steps, 2))


@kernel
def _known_scene(w, x, y, heading, time, targets, information, share, c):
    return Scene(
        x,
        y,
        heading,
        time,
        w.truth,
        w.obstacle,
        affordable(w, c),
        w.num_transponders,
        w.num_transponders,
        targets,
        information,
        share,
        0.0,
    )


@loop_kernel
def _recede(w, steps, ahead, grids, tree, targets, information, share, plan, ocean, c, worth):
    """The receding-horizon plan of ``ahead`` steps with known transponders into ``plan``; changes ``information``."""
    x, y, heading = w.x, w.y, w.heading
    for j in range(steps):
        time = w.clock_s + w.time_s + j * c.period
        scene = _known_scene(w, x, y, heading, time, targets, information, share, c)
        best_plan(scene, min(ahead, steps - j), grids, tree, ocean, c, worth)
        plan[j, 0], plan[j, 1] = tree.best[0, 0], tree.best[0, 1]
        x, y, heading = advance(x, y, heading, time, w.truth, plan[j, 0], plan[j, 1], ocean, c)
        for m in range(w.num_transponders):
            add_line_of_sight(
                information[m], w.target[m, 0] - x, w.target[m, 1] - y, w.target[m, 2], worth.weight
            )


@loop_kernel
def _first_information(w, targets, information, c, worth):
    for m in range(w.num_transponders):
        for i in range(3):
            targets[m, i] = w.target[m, i]
        true_information(w, m, c.prior_information, worth.weight, information[m])


@loop_kernel
def _copy(a, b):
    for j in range(b.shape[0]):
        b[j, 0] = a[j, 0]
        b[j, 1] = a[j, 1]


@loop_kernel
def full_plan(worlds, short, long, starts, noise, plan, ends, ocean, c, worth):
    """The best trajectory of the first of ``worlds`` into ``plan``; ``ends``: its value, the worst best start's."""
    w = worlds[0]
    steps = plan.shape[0]
    targets = np.zeros((MAX_TRANSPONDERS, 3))
    share = np.ones(MAX_TRANSPONDERS)
    information = np.zeros((MAX_TRANSPONDERS, 6))
    tree = make_tree(steps, long.points.shape[1], MAX_TRANSPONDERS)
    near = make_tree(short.points.shape[0], short.points.shape[1], MAX_TRANSPONDERS)
    trail = make_trail(steps)
    receding = short.points.shape[0]
    count = receding + 1 + starts.shape[0]
    plans = np.zeros((count, steps, 2))
    values = np.full(count, -np.inf)
    for k in range(receding):
        _first_information(w, targets, information, c, worth)
        _recede(w, steps, k + 1, short, near, targets, information, share, plans[k], ocean, c, worth)
    _first_information(w, targets, information, c, worth)
    scene = _known_scene(w, w.x, w.y, w.heading, w.clock_s + w.time_s, targets, information, share, c)
    search_leaves(scene, long, steps, tree, ocean, c, worth)
    pick = 0
    for g in range(long.sizes[steps - 1]):
        if tree.leaf_value[g] > tree.leaf_value[pick]:
            pick = g
    write_leaf(long, steps, pick, tree)
    _copy(tree.plan, plans[receding])
    for k in range(starts.shape[0]):
        for j in range(steps):
            ux, uy = starts[k, j, 0], starts[k, j, 1]
            plans[receding + 1 + k, j, 0], plans[receding + 1 + k, j, 1] = feasible(
                scene, 1.0, 1.0, ux, uy, c
            )
    for k in range(count):
        values[k] = climb(scene, plans[k], steps, _FIRST, _TOLERANCE, trail, ocean, c, worth)
    best = -np.inf
    ends[1] = np.inf
    for _ in range(_BEST):
        pick = 0
        for k in range(count):
            if values[k] > values[pick]:
                pick = k
        found = climb(scene, plans[pick], steps, _SECOND, _TOLERANCE, trail, ocean, c, worth)
        values[pick] = -np.inf
        ends[1] = min(ends[1], found)
        if found > best:
            best = found
            _copy(plans[pick], plan)
    shaken = np.zeros((steps, 2))
    for k in range(noise.shape[0]):
        # Small and large shakes in turn.
        size = 0.5 ** (k % 3)
        for j in range(steps):
            ux, uy = plan[j, 0] + size * noise[k, j, 0], plan[j, 1] + size * noise[k, j, 1]
            shaken[j, 0], shaken[j, 1] = feasible(scene, 1.0, 1.0, ux, uy, c)
        found = climb(scene, shaken, steps, _SECOND, _TOLERANCE, trail, ocean, c, worth)
        if found > best:
            best = found
            _copy(shaken, plan)
    ends[0] = climb(scene, plan, steps, _LAST, _TOLERANCE, trail, ocean, c, worth)

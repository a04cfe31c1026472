"""The ocean that worlds of all tasks lie in: its data as kernels read them, and how an episode is drawn from it."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics import current_formulas
from aquaquad_envs.physics.currents import CurrentAxes
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap
from aquaquad_envs.physics.randomness import WORDS, uniform
from aquaquad_envs.tasks.scenarios import SCENARIO_RECORD, ScenarioBank, ScenarioSpec, build_bank
from aquaquad_envs.tasks.solar import solar_table

#: The last fields of every world's record: the scenario drawn (indices into the ocean), and the random streams.
EPISODE_FIELDS = [
    ("steps", np.int64), ("scenario", np.int64), ("truth", np.int64), ("forecast", np.int64),
    ("obstacle", np.int64), ("outcome", np.int64),
    ("rng_initial", np.uint64, (WORDS,)), ("rng_field", np.uint64, (WORDS,)),
    ("rng_sensor", np.uint64, (WORDS,)), ("rng_target", np.uint64, (WORDS,)),
]  # fmt: skip


class Ocean(NamedTuple):
    """Everything immutable that kernels and planners read: currents, obstacles, sun."""

    velocity: np.ndarray  # (F, T, rows, columns, 2) m/s
    axes: CurrentAxes
    clearance: np.ndarray  # (O, rows, columns) m
    clearance_grid: Grid
    scenarios: np.ndarray  # records of SCENARIO_RECORD
    collected_wh: np.ndarray  # (n,) Wh since the clock's start
    solar_step: float  # s


@lru_cache(maxsize=8)
def _still_bank(spec: ScenarioSpec) -> ScenarioBank:
    """No current, and no obstacles but those asked for."""
    field = current_formulas.uniform(0.0, 0.0, half_width_m=spec.half_width_m)
    grid, side = Grid.square(spec.half_width_m, spec.half_width_m / 40)
    obstacles = ObstacleMap.from_rectangles(
        spec.obstacles or (), grid=grid, side=side, margin_m=spec.obstacle_margin_m
    )
    return ScenarioBank(
        velocity=field.velocity[None], axes=field.axes, clearance=obstacles.distance[None], clearance_grid=grid,
        scenarios=np.zeros(1, dtype=SCENARIO_RECORD),
    )  # fmt: skip


def build_ocean(params: Any, *, still: bool = False) -> tuple[Ocean, float, tuple[str, ...]]:
    """The ocean of ``params``, seconds of local solar time at clock 0, and notes on what was assumed in reading a file.

    ``params``: a :class:`~aquaquad_envs.tasks.vehicle_params.VehicleParams` with ``scenario_spec()``,
    ``horizon_s`` and ``action_period_s``; ``still``: no current, nor any obstacle but ``params.obstacles``,
    whatever the scenario. Raises ``CurrentFileError`` or ``InvalidParameterError``.
    """
    spec = params.scenario_spec()
    bank = _still_bank(spec) if still else build_bank(spec)
    charge, clock_offset = solar_table(params, bank)
    ocean = Ocean(
        velocity=bank.velocity, axes=bank.axes, clearance=bank.clearance,
        clearance_grid=Grid(*map(float, bank.clearance_grid)), scenarios=bank.scenarios,
        collected_wh=charge.collected_wh, solar_step=float(charge.time_step_s),
    )  # fmt: skip
    return ocean, clock_offset, bank.notes


@kernel
def draw_scenario(w, ocean):
    """Draw the scenario of a new episode into record ``w``: its index, and those of currents and obstacles."""
    k = int(uniform(w.rng_field) * ocean.scenarios.size)
    scenario = ocean.scenarios[k]
    w.scenario = k
    w.truth = scenario.truth
    w.forecast = scenario.forecast
    w.obstacle = scenario.obstacle


@kernel
def draw_clock(w, c):
    """Time 0 of the mission, and how late after ``start_time`` it is, s; draws only where there is a spread."""
    w.time_s = 0.0
    w.clock_s = c.start_time_spread * uniform(w.rng_initial) if c.start_time_spread > 0.0 else 0.0

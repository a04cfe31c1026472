"""Scenario banks: the currents, obstacles, starts and goals that episodes are drawn from.

A bank is built once from a frozen :class:`ScenarioSpec`, is immutable, and is shared by all
worlds: a world's record holds only indices into it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics import current_formulas
from aquaquad_envs.physics.currents import CurrentAxes, CurrentField
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap, clearance_at

Rectangle = tuple[float, float, float, float]

#: Published geometry of the vortex, m (Dillard 2014, App. C). The obstacle set is not published.
VORTEX_START, VORTEX_GOAL = (-4000.0, 4000.0), (3000.0, -3000.0)
VORTEX_OBSTACLE: Rectangle = (-1000.0, -1000.0, 1000.0, 1000.0)
VORTEX_TEAM = ((5000.0, 5000.0), (5000.0, -5000.0), (-5000.0, -5000.0))

SCENARIOS = {
    "vortex": "the published vortex, start and goal, with one 2 km square obstacle at the centre",
    "vortex-perturbed": "the same, start and goal each anywhere within 500 m of the published ones",
    "gyres": "random divergence-free fields that change with time, random starts, goals and obstacles",
    "forecast-error": "as gyres, but the policy sees a forecast that differs from the truth",
    "double-gyre": "the time-dependent double gyre, random starts and goals",
    "tide": "a uniform tidal ellipse, random starts and goals",
    "file": "real currents from a NetCDF file, land as obstacles, random starts and goals",
}

SCENARIO_RECORD = np.dtype(
    [
        ("truth", np.int64), ("forecast", np.int64), ("obstacle", np.int64),
        ("start_x", np.float64), ("start_y", np.float64), ("start_spread", np.float64),
        ("goal_x", np.float64), ("goal_y", np.float64), ("goal_spread", np.float64),
    ]
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ScenarioSpec:
    """Everything that decides a bank; hashable, so that equal specs share one bank."""

    scenario: str
    half_width_m: float
    obstacles: tuple[Rectangle, ...] | None
    obstacle_margin_m: float
    interpolation: str
    num_fields: int
    field_seed: int
    duration_s: float
    currents_file: str | tuple[str, ...] | None
    currents_center: tuple[float, float] | None
    currents_start: str | None
    forecast_error: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioBank:
    """Stacks that worlds index into: currents (F, T, rows, columns, 2), clearances (O, rows, columns)."""

    velocity: np.ndarray
    axes: CurrentAxes
    clearance: np.ndarray
    clearance_grid: Grid
    scenarios: np.ndarray
    notes: tuple[str, ...] = ()
    center: tuple[float, float] | None = None
    start_time: str | None = None

    def __post_init__(self) -> None:
        # Banks are shared; and one kind of array everywhere spares compiling the kernels twice.
        for array in (self.velocity, self.clearance, self.scenarios):
            array.setflags(write=False)


@lru_cache(maxsize=8)
def build_bank(spec: ScenarioSpec) -> ScenarioBank:
    """The bank of ``spec``. Raises ``CurrentFileError`` or ``InvalidParameterError``."""
    if spec.scenario in ("vortex", "vortex-perturbed"):
        return _vortex(spec)
    if spec.scenario == "file":
        return _file(spec)
    return _random(spec)


def _obstacles(spec: ScenarioSpec, rectangles: tuple[Rectangle, ...], grid: Grid, side: int) -> ObstacleMap:
    chosen = rectangles if spec.obstacles is None else spec.obstacles
    return ObstacleMap.from_rectangles(chosen, grid=grid, side=side, margin_m=spec.obstacle_margin_m)


def _vortex(spec: ScenarioSpec) -> ScenarioBank:
    field = current_formulas.published_vortex(interpolation=spec.interpolation)
    grid, side = Grid.square(spec.half_width_m, 100.0)
    obstacles = _obstacles(spec, (VORTEX_OBSTACLE,), grid, side)
    for name, (x, y) in (("start", VORTEX_START), ("goal", VORTEX_GOAL)):
        clearance = clearance_at(obstacles.distance[None], 0, grid, x, y)
        if clearance < 0:
            raise InvalidParameterError(
                "obstacles", f"one that covers the vortex {name} ({x:g}, {y:g}) by {-clearance:.0f} m",
                f"open water at the {name}", "Move it, or reduce obstacle_margin_m.",
            )  # fmt: skip
    spread = 500.0 if spec.scenario == "vortex-perturbed" else 0.0
    scenarios = np.array([(0, 0, 0, *VORTEX_START, spread, *VORTEX_GOAL, spread)], dtype=SCENARIO_RECORD)
    return ScenarioBank(
        velocity=field.velocity[None], axes=field.axes, clearance=obstacles.distance[None],
        clearance_grid=grid, scenarios=scenarios,
    )  # fmt: skip


def _random(spec: ScenarioSpec) -> ScenarioBank:
    grid, side = Grid.square(spec.half_width_m, spec.half_width_m / 40)
    truths: list[CurrentField] = []
    forecasts: list[CurrentField] = []
    layers: list[np.ndarray] = []
    scenarios = np.zeros(spec.num_fields, dtype=SCENARIO_RECORD)
    for k in range(spec.num_fields):
        # One generator per scenario: a larger bank begins with the scenarios of a smaller one.
        rng = np.random.default_rng(np.random.SeedSequence([spec.field_seed, k]))
        truth = _random_field(spec, rng)
        start, goal = _start_and_goal(spec, rng, None, None)
        rectangles = _random_rectangles(spec, rng, start, goal)
        obstacles = _obstacles(spec, rectangles, grid, side)
        if spec.obstacles is not None:
            start, goal = _start_and_goal(spec, rng, obstacles.distance, grid)
        truths.append(truth)
        layers.append(obstacles.distance)
        if spec.scenario == "forecast-error":
            forecasts.append(_forecast(spec, rng, truth))
        spread = 0.05 * spec.half_width_m
        shift = spec.num_fields if forecasts else 0
        scenarios[k] = (k, k + shift, k, *start, spread, *goal, 0.0)
    velocity = np.stack([field.velocity for field in truths + forecasts])
    return ScenarioBank(
        velocity=velocity, axes=truths[0].axes, clearance=np.stack(layers), clearance_grid=grid, scenarios=scenarios
    )  # fmt: skip


def _random_field(spec: ScenarioSpec, rng: np.random.Generator) -> CurrentField:
    size = spec.half_width_m
    if spec.scenario == "double-gyre":
        return current_formulas.double_gyre(
            half_width_m=size, speed_m_s=rng.uniform(0.2, 0.7), wobble=rng.uniform(0.05, 0.3),
            period_s=6 * 3600.0, duration_s=spec.duration_s, spacing_m=size / 20,
        )  # fmt: skip
    if spec.scenario == "tide":
        major = rng.uniform(0.2, 0.7)
        return current_formulas.rotating_tide(
            half_width_m=size, major_m_s=major, minor_m_s=major * rng.uniform(-0.5, 0.5),
            orientation_rad=rng.uniform(0, 2 * np.pi), duration_s=spec.duration_s,
        )  # fmt: skip
    return current_formulas.random_gyres(
        rng, half_width_m=size, speed_m_s=rng.uniform(0.15, 0.6), mean_flow_m_s=0.2,
        eddy_scale_m=size * rng.uniform(0.4, 0.8), turnover_s=24 * 3600.0,
        duration_s=spec.duration_s, spacing_m=size / 10,
    )  # fmt: skip


def _forecast(spec: ScenarioSpec, rng: np.random.Generator, truth: CurrentField) -> CurrentField:
    """The truth plus an independent divergence-free error of relative root-mean-square ``forecast_error``."""
    speed = float(np.sqrt(np.mean(np.sum(truth.velocity**2, -1))))
    error = current_formulas.random_gyres(
        rng, half_width_m=spec.half_width_m, speed_m_s=spec.forecast_error * speed, mean_flow_m_s=0.0,
        eddy_scale_m=spec.half_width_m * 0.4, turnover_s=24 * 3600.0, duration_s=spec.duration_s,
        spacing_m=spec.half_width_m / 10,
    )  # fmt: skip
    return CurrentField(
        velocity=truth.velocity + error.velocity, grid=truth.grid, time_step_s=truth.time_step_s
    )


def _start_and_goal(
    spec: ScenarioSpec, rng: np.random.Generator, distance: np.ndarray | None, grid: Grid | None
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Two points of open water, 0.8 to 1.6 half-widths apart, away from edges and obstacles."""
    size = spec.half_width_m
    for _ in range(10_000):
        start, goal = rng.uniform(-0.85, 0.85, (2, 2)) * size
        if not 0.8 * size <= np.hypot(*(goal - start)) <= 1.6 * size:
            continue
        if distance is not None and grid is not None:
            room = [clearance_at(distance[None], 0, grid, *point) for point in (start, goal)]
            if min(room) < 0.06 * size:
                continue
        return (float(start[0]), float(start[1])), (float(goal[0]), float(goal[1]))
    raise InvalidParameterError(
        "obstacles", "too much land or too many obstacles", "room for a start and a goal in open water",
        "Choose another centre, a larger half_width_m, or a smaller obstacle_margin_m.",
    )  # fmt: skip


def _random_rectangles(
    spec: ScenarioSpec, rng: np.random.Generator, start: tuple[float, float], goal: tuple[float, float]
) -> tuple[Rectangle, ...]:
    """One to four rectangles that leave room around start and goal."""
    size = spec.half_width_m
    rectangles: list[Rectangle] = []
    for _ in range(int(rng.integers(1, 5))):
        cx, cy = rng.uniform(-0.8, 0.8, 2) * size
        half_x, half_y = rng.uniform(0.05, 0.2, 2) * size
        room = 0.06 * size + spec.obstacle_margin_m
        near = any(abs(x - cx) < half_x + room and abs(y - cy) < half_y + room for x, y in (start, goal))
        if not near:
            rectangles.append((cx - half_x, cy - half_y, cx + half_x, cy + half_y))
    return tuple(rectangles)


def _file(spec: ScenarioSpec) -> ScenarioBank:
    from aquaquad_envs.physics.current_files import load_current_file

    if spec.currents_file is None:
        raise InvalidParameterError(
            "currents_file", None, "the path of a NetCDF file", "scenario='file' reads real currents."
        )
    loaded = load_current_file(
        spec.currents_file, half_width_m=spec.half_width_m, center=spec.currents_center,
        start_time=spec.currents_start, duration_s=spec.duration_s,
    )  # fmt: skip
    field = loaded.field
    obstacles = ObstacleMap.from_mask(loaded.land, grid=field.grid, margin_m=spec.obstacle_margin_m)
    scenarios = np.zeros(spec.num_fields, dtype=SCENARIO_RECORD)
    for k in range(spec.num_fields):
        rng = np.random.default_rng(np.random.SeedSequence([spec.field_seed, k]))
        start, goal = _start_and_goal(spec, rng, obstacles.distance, field.grid)
        scenarios[k] = (0, 0, 0, *start, 0.0, *goal, 0.0)
    return ScenarioBank(
        velocity=field.velocity[None], axes=field.axes, clearance=obstacles.distance[None],
        clearance_grid=field.grid, scenarios=scenarios, notes=loaded.notes, center=loaded.center,
        start_time=loaded.start_time,
    )  # fmt: skip

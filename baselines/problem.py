"""What a drift/hop planner is given: one world's forecast, obstacles, start, goal and vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, PlanningError
from aquaquad_envs.physics.currents import CurrentAxes, CurrentField
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap, clearance_at


@dataclass(frozen=True, kw_only=True, eq=False)
class DriftHopProblem:
    """One drift/hop planning problem, checked on construction.

    Parameters
    ----------
    velocity: stack of current fields, shape (fields, frames, rows, columns, 2), m/s.
    field_index: which field of the stack is this problem's forecast.
    axes: axes of the stack.
    clearance: stack of signed distances, shape (layers, rows, columns), m.
    obstacle_index: which layer; clearance_grid: its nodes.
    start, goal: (x, y), m. half_width_m: the mission box is [-half_width, half_width]².
    goal_radius_m: arrival distance. max_hop_m: longest single hop.
    airspeed_m_s, flight_power_w: flight. time_s: field time at the start; horizon_s: time allowed.
    drift_step_s: integration step of the drift, s.
    team: positions of the other sensors, shape (n, 2), m (may be empty); target: (x, y) listened for.

    Raises
    ------
    PlanningError: for a field that is not finite, a start or goal outside the box or in an
        obstacle, or a vehicle that cannot fly.
    """

    velocity: np.ndarray
    axes: CurrentAxes
    clearance: np.ndarray
    clearance_grid: Grid
    start: tuple[float, float]
    goal: tuple[float, float]
    field_index: int = 0
    obstacle_index: int = 0
    half_width_m: float = 5000.0
    goal_radius_m: float = 100.0
    max_hop_m: float = 4000.0 / 3.0
    airspeed_m_s: float = 100.0 / 9.0
    flight_power_w: float = 200.0
    time_s: float = 0.0
    horizon_s: float = 43200.0
    drift_step_s: float = 60.0
    team: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    target: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.isfinite(self.velocity[self.field_index]).all():
            raise PlanningError(
                "current field: it holds NaN or infinite values, expected finite velocities. "
                "Fill land and gaps with 0 and mark them as obstacles."
            )
        for name in ("start", "goal"):
            x, y = getattr(self, name)
            if not (abs(x) <= self.half_width_m and abs(y) <= self.half_width_m):
                raise PlanningError(
                    f"{name}: got ({x:g}, {y:g}) m, expected a point in the box of half-width "
                    f"{self.half_width_m:g} m. Move it inside, or enlarge half_width_m."
                )
            clearance = clearance_at(self.clearance, self.obstacle_index, self.clearance_grid, x, y)
            if clearance < 0:
                raise PlanningError(
                    f"{name}: ({x:g}, {y:g}) m lies {-clearance:.0f} m inside an obstacle, expected open "
                    "water. Move it, or reduce the obstacle's margin."
                )
        for name in (
            "goal_radius_m",
            "max_hop_m",
            "airspeed_m_s",
            "flight_power_w",
            "drift_step_s",
            "horizon_s",
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise PlanningError(f"{name}: got {value!r}, expected a positive number.")

    @staticmethod
    def of(
        currents: CurrentField,
        obstacles: ObstacleMap,
        *,
        start: tuple[float, float],
        goal: tuple[float, float],
        **settings: Any,
    ) -> DriftHopProblem:
        """The problem on one field and one obstacle map; ``settings`` as the class's own."""
        return DriftHopProblem(
            velocity=currents.velocity[None],
            axes=currents.axes,
            clearance=obstacles.distance[None],
            clearance_grid=obstacles.grid,
            start=start,
            goal=goal,
            **settings,
        )

    def flight_energy_wh(self, distance_m: float) -> float:
        """Energy, Wh, to fly ``distance_m``."""
        return self.flight_power_w * distance_m / self.airspeed_m_s / 3600.0

    @property
    def direct_energy_wh(self) -> float:
        """Energy, Wh, of the straight flight from start to goal."""
        return self.flight_energy_wh(float(np.hypot(*np.subtract(self.goal, self.start))))


def require_continuous_actions(batch: Any) -> None:
    """Raise ``InvalidParameterError`` if ``batch`` takes discrete actions: planners fly any hop vector."""
    if batch.action_spec.table is not None:
        raise InvalidParameterError(
            "action_type", "discrete", "continuous actions", "Make the batch with action_type='continuous'."
        )

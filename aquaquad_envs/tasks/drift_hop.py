"""Drift/hop: bring an air-water quadcopter to a goal with the least flight energy.

Each decision is a *drift* of one action period (free, carried by the current) or a *hop*
(a straight flight, over obstacles, that lasts only its own flight time; hops in a row are one
longer flight). See ``docs/drift_hop.md`` for the tables of observation, action and reward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks import drift_hop_kernels as kernels
from aquaquad_envs.tasks.discrete_hops import hop_actions
from aquaquad_envs.tasks.drift_hop_observation import OBSERVATION_NAMES
from aquaquad_envs.tasks.ocean import EPISODE_FIELDS, Ocean, build_ocean
from aquaquad_envs.tasks.scenarios import SCENARIOS, VORTEX_TEAM, ScenarioSpec
from aquaquad_envs.tasks.task import Task
from aquaquad_envs.tasks.vehicle_params import BOUNDS, VehicleParams

_DEFAULTS = {"half_width_m": 5000.0, "horizon_s": 12 * 3600.0}
_SCENARIO_DEFAULTS = {"file": {"half_width_m": 20_000.0, "horizon_s": 48 * 3600.0}}


@dataclass(frozen=True, kw_only=True)
class Params(VehicleParams):
    """Parameters of the drift/hop world; every one can be passed to ``gymnasium.make``.

    ``half_width_m`` is 5000 by default (Dillard 2014), 20 000 in ``file``. Raises ``InvalidParameterError`` for a
    value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "vortex"
    #: s of mission before truncation. Default 12 h, file 48 h.
    horizon_s: float | None = None
    #: s that one drift decision lasts.
    action_period_s: float = 600.0
    #: integration steps a drift; 600 s / 10 is the published 60 s.
    sub_steps: int = 10
    #: m; arrival distance (Dillard 2014, App. C).
    goal_radius_m: float = 100.0
    #: positions of the other sensors, m; None: the published three in the vortex, else none.
    team: tuple[tuple[float, float], ...] | None = None
    #: m; what the team listens for, relative to the goal (Dillard 2014, App. C).
    target_offset: tuple[float, float] = (100.0, 100.0)
    #: share of episodes that start anywhere on open water instead (a lever for training).
    start_anywhere: float = 0.0
    #: relative root-mean-square error of the forecast in ``forecast-error``.
    forecast_error: float = 0.4
    #: weights of the reward terms (see docs/drift_hop.md).
    progress_weight: float = 1.0
    arrival_bonus: float = 1.0
    failure_penalty: float = 5.0

    def __post_init__(self) -> None:
        self._complete(SCENARIOS, _DEFAULTS, _SCENARIO_DEFAULTS, bounds=_BOUNDS, whole=("sub_steps",))
        self._fill({"team": VORTEX_TEAM if self.scenario.startswith("vortex") else ()})
        self._freeze_points("team", 2)
        self._freeze_pair("target_offset")
        if self.scenario.startswith("vortex") and not 4500 <= self.half_width_m <= 50_000:
            raise InvalidParameterError(
                "half_width_m", self.half_width_m, "4500 to 50 000 m in the vortex",
                "Its start lies 4 km out, and its obstacle grid has a node every 100 m.",
            )  # fmt: skip

    def scenario_spec(self) -> ScenarioSpec:
        """The part of the parameters that decides the scenario bank."""
        return self._scenario_spec(self.horizon_s, forecast_error=self.forecast_error)


_BOUNDS = (
    *BOUNDS, ("horizon_s", 60, 1e8, False), ("action_period_s", 1, 1e5, False), ("sub_steps", 1, 10_000, False),
    ("goal_radius_m", 0, 1e5, True), ("start_anywhere", 0, 1, False), ("forecast_error", 0, 5, False),
    ("progress_weight", 0, 1e6, False), ("arrival_bonus", 0, 1e6, False), ("failure_penalty", 0, 1e6, False),
)  # fmt: skip

#: One record is one world. Energies in Wh, positions in m, times in s.
WORLD = np.dtype(
    [
        ("x", np.float64), ("y", np.float64), ("goal_x", np.float64), ("goal_y", np.float64),
        ("start_x", np.float64), ("start_y", np.float64),
        ("time_s", np.float64), ("clock_s", np.float64),
        ("battery_wh", np.float64), ("flight_wh", np.float64), ("solar_wh", np.float64),
        ("spent_wh", np.float64), ("clipped_wh", np.float64),
        ("drift_s", np.float64), ("flight_s", np.float64), ("hdop_s", np.float64),
        ("hops", np.int64), *EPISODE_FIELDS,
    ]
)  # fmt: skip


def metrics(worlds: np.ndarray, params: Params) -> dict[str, np.ndarray]:
    """Metrics of the episodes so far, each of shape (num_worlds,); meaningful once an episode is over.

    ``mean_hdop`` is time-weighted, in m/rad, and NaN where no team listens.
    """
    direct = flight_energy_wh(
        np.hypot(worlds["goal_x"] - worlds["start_x"], worlds["goal_y"] - worlds["start_y"]),
        params.airspeed_m_s,
        params.flight_power_w,
    )
    time_s = worlds["time_s"]
    hdop = np.divide(worlds["hdop_s"], time_s, out=np.full(len(worlds), np.nan), where=time_s > 0)
    return {
        "success": (worlds["outcome"] == kernels.GOAL).astype(np.float64),
        "flight_energy_wh": worlds["flight_wh"].copy(),
        "saving_vs_direct": 1.0 - worlds["flight_wh"] / np.maximum(direct, 1e-9),
        "duration_s": time_s.copy(),
        "mean_hdop": hdop if params.team else np.full(len(worlds), np.nan),
        "solar_wh": worlds["solar_wh"].copy(),
    }


def build(params: Params) -> tuple[Ocean, kernels.Constants, tuple[str, ...]]:
    """Immutable data and scalars for the kernels, and notes on what was assumed in reading a file."""
    ocean, clock_offset, notes = build_ocean(params)
    constants = kernels.Constants(
        **params.vehicle_constants(), clock_offset=clock_offset,
        team=np.array(params.team, dtype=np.float64).reshape(-1, 2), horizon=float(params.horizon_s),
        action_period=float(params.action_period_s), sub_steps=int(params.sub_steps),
        goal_radius=float(params.goal_radius_m), target_dx=float(params.target_offset[0]),
        target_dy=float(params.target_offset[1]), start_anywhere=float(params.start_anywhere),
        progress_weight=float(params.progress_weight), arrival_bonus=float(params.arrival_bonus),
        failure_penalty=float(params.failure_penalty),
    )  # fmt: skip
    return ocean, constants, notes


TASK = Task(
    name="drift-hop",
    params=Params,
    world=WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=kernels.REWARD_TERMS,
    outcomes=kernels.OUTCOMES,
    build=build,
    action_spec=hop_actions,
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
)

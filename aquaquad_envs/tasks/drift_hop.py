"""Drift/hop: bring an air-water quadcopter to a goal with the least flight energy.

Each decision is a *drift* of one action period (free, carried by the current) or a *hop*
(a straight flight, over obstacles, that lasts only its own flight time; hops in a row are one
longer flight). See ``docs/drift_hop.md`` for the tables of observation, action and reward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.physics import energy
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.randomness import WORDS
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks import drift_hop_kernels as kernels
from aquaquad_envs.tasks.discrete_hops import discrete_hops
from aquaquad_envs.tasks.drift_hop_observation import OBSERVATION_NAMES
from aquaquad_envs.tasks.scenarios import (
    SCENARIOS,
    VORTEX_TEAM,
    Rectangle,
    ScenarioBank,
    ScenarioSpec,
    build_bank,
)
from aquaquad_envs.tasks.solar import solar_table
from aquaquad_envs.tasks.task import ActionSpec, Task

_SCENARIO_DEFAULTS = {"file": {"half_width_m": 20_000.0, "horizon_s": 48 * 3600.0}}


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the drift/hop world; every one can be passed to ``gymnasium.make``.

    Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "vortex"
    #: m; the mission box is [-half_width, half_width]². Default 5000 (Dillard 2014), file 20 000.
    half_width_m: float | None = None
    #: s of mission before truncation. Default 12 h, file 48 h.
    horizon_s: float | None = None
    #: s that one drift decision lasts.
    action_period_s: float = 600.0
    #: integration steps a drift; 600 s / 10 is the published 60 s.
    sub_steps: int = 10
    #: "rk4", or "euler" (published).
    integrator: str = "rk4"
    #: space interpolation of the vortex: "bilinear", or "cell" (published).
    interpolation: str = "bilinear"
    #: m; arrival distance (Dillard 2014, App. C).
    goal_radius_m: float = 100.0
    #: m; longest single hop: 2 min at the air speed (Dillard 2014, App. C).
    max_hop_m: float = 4000.0 / 3.0
    #: m/s; 20 knots of the source's 2000 m mile.
    airspeed_m_s: float = 40_000.0 / 3600.0
    #: action norm below which the vehicle drifts.
    drift_threshold: float = 0.1
    #: published energy budget, "2014" or "2016" (SPEC §2); the fields below override it.
    energy: str = "2014"
    #: W; None: the preset's.
    flight_power_w: float | None = None
    #: W, sensing and communication included; None: the preset's.
    base_power_w: float | None = None
    #: Wh; None: the preset's.
    battery_wh: float | None = None
    #: share of the capacity at the start.
    initial_charge: float = 1.0
    #: "clear-sky" (pvlib), "constant" (the published day-average), or "file" (``solar_file``).
    solar: str = "clear-sky"
    #: TMY3 or NSRDB CSV for ``solar="file"``.
    solar_file: str | None = None
    #: degrees north and east; Monterey, where the vehicle was developed.
    latitude: float = 36.6
    longitude: float = -121.867
    #: UTC; 08:00 local summer time at the default place. Real currents with dates bring their own.
    start_time: str = "2014-06-21T15:00"
    #: s; the clock at the start is uniform in [0, this] after ``start_time``.
    start_time_spread_s: float = 0.0
    #: rectangles (x_min, y_min, x_max, y_max), m, in place of the scenario's own; None: the scenario's.
    obstacles: tuple[Rectangle, ...] | None = None
    #: m by which obstacles and land are grown.
    obstacle_margin_m: float = 0.0
    #: positions of the other sensors, m; None: the published three in the vortex, else none.
    team: tuple[tuple[float, float], ...] | None = None
    #: m; what the team listens for, relative to the goal (Dillard 2014, App. C).
    target_offset: tuple[float, float] = (100.0, 100.0)
    #: m/s; standard deviation of the measured local current, 0 for none.
    current_noise_m_s: float = 0.0
    #: share of episodes that start anywhere on open water instead (a lever for training).
    start_anywhere: float = 0.0
    #: scenarios in a random bank, and the seed that decides them.
    num_fields: int = 256
    field_seed: int = 0
    #: relative root-mean-square error of the forecast in ``forecast-error``.
    forecast_error: float = 0.4
    #: NetCDF path (or two: u and v) for ``scenario="file"``, its centre (latitude, longitude) and first time.
    currents_file: str | tuple[str, ...] | None = None
    currents_center: tuple[float, float] | None = None
    currents_start: str | None = None
    #: "continuous", or "discrete": drift, or one of 16 headings at half or full length.
    action_type: str = "continuous"
    #: weights of the reward terms (see docs/drift_hop.md).
    progress_weight: float = 1.0
    arrival_bonus: float = 1.0
    failure_penalty: float = 5.0

    def __post_init__(self) -> None:
        check_choice("scenario", self.scenario, SCENARIOS)
        check_choice("energy", self.energy, energy.PRESETS)
        preset = energy.PRESETS[self.energy]
        defaults = {
            "half_width_m": 5000.0, "horizon_s": 12 * 3600.0, "flight_power_w": preset.flight_power_w,
            "base_power_w": preset.base_power_w, "battery_wh": preset.battery_wh,
            "team": VORTEX_TEAM if self.scenario.startswith("vortex") else (),
            **_SCENARIO_DEFAULTS.get(self.scenario, {}),
        }  # fmt: skip
        for name, value in defaults.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name in ("obstacles", "team"):
            self._freeze_points(name, 4 if name == "obstacles" else 2)
        for name in ("target_offset", "currents_center"):
            self._freeze_pair(name)
        check_choice("integrator", self.integrator, ("rk4", "euler"))
        check_choice("interpolation", self.interpolation, ("bilinear", "cell"))
        check_choice("solar", self.solar, ("clear-sky", "constant", "file"))
        check_choice("action_type", self.action_type, ("continuous", "discrete"))
        for name, low, high, open_low in _BOUNDS:
            check_range(name, getattr(self, name), low, high, open_low=open_low)
        for name in ("sub_steps", "num_fields", "field_seed"):
            if not isinstance(getattr(self, name), int | np.integer):
                raise InvalidParameterError(name, getattr(self, name), "a whole number")
        if self.solar == "file" and self.solar_file is None:
            raise InvalidParameterError("solar_file", None, "the path of a TMY3 or NSRDB file")
        if self.scenario.startswith("vortex") and not 4500 <= self.half_width_m <= 50_000:
            raise InvalidParameterError(
                "half_width_m", self.half_width_m, "4500 to 50 000 m in the vortex",
                "Its start lies 4 km out, and its obstacle grid has a node every 100 m.",
            )  # fmt: skip

    def _freeze_points(self, name: str, width: int) -> None:
        value = getattr(self, name)
        if value is None:
            return
        try:
            points = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            points = np.full(1, np.nan)
        if points.size and (points.ndim != 2 or points.shape[1] != width or not np.isfinite(points).all()):
            raise InvalidParameterError(name, value, f"a sequence of {width} finite numbers each")
        object.__setattr__(self, name, tuple(tuple(map(float, row)) for row in points.reshape(-1, width)))

    def _freeze_pair(self, name: str) -> None:
        value = getattr(self, name)
        if value is None and name == "currents_center":
            return
        try:
            pair = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            pair = np.empty(0)
        if pair.shape != (2,) or not np.isfinite(pair).all():
            raise InvalidParameterError(name, value, "two finite numbers")
        object.__setattr__(self, name, tuple(pair.tolist()))

    def scenario_spec(self) -> ScenarioSpec:
        """The part of the parameters that decides the scenario bank."""
        return ScenarioSpec(
            duration_s=self.horizon_s + self.start_time_spread_s,
            **{
                name: getattr(self, name)
                for name in ScenarioSpec.__dataclass_fields__
                if name != "duration_s"
            },
        )


_BOUNDS = (
    ("half_width_m", 100, 1e6, False), ("horizon_s", 60, 1e8, False), ("action_period_s", 1, 1e5, False),
    ("sub_steps", 1, 10_000, False), ("goal_radius_m", 0, 1e5, True), ("max_hop_m", 1, 1e6, False),
    ("airspeed_m_s", 0.1, 100, False), ("drift_threshold", 0, 1, False), ("flight_power_w", 0, 1e5, True),
    ("base_power_w", 0, 1e4, False), ("battery_wh", 0, 1e6, True), ("initial_charge", 0, 1, True),
    ("latitude", -90, 90, False), ("longitude", -180, 360, False), ("start_time_spread_s", 0, 1e8, False),
    ("obstacle_margin_m", 0, 1e5, False), ("current_noise_m_s", 0, 10, False), ("start_anywhere", 0, 1, False),
    ("num_fields", 1, 100_000, False), ("field_seed", 0, 2**63, False), ("forecast_error", 0, 5, False),
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
        ("hops", np.int64), ("steps", np.int64), ("scenario", np.int64), ("truth", np.int64),
        ("forecast", np.int64), ("obstacle", np.int64), ("outcome", np.int64),
        ("rng_initial", np.uint64, (WORDS,)), ("rng_field", np.uint64, (WORDS,)),
        ("rng_sensor", np.uint64, (WORDS,)), ("rng_target", np.uint64, (WORDS,)),
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


def build(params: Params) -> tuple[kernels.Ocean, kernels.Constants, tuple[str, ...]]:
    """Immutable data and scalars for the kernels, and notes on what was assumed in reading a file."""
    bank: ScenarioBank = build_bank(params.scenario_spec())
    charge, clock_offset = solar_table(params, bank)
    ocean = kernels.Ocean(
        velocity=bank.velocity, axes=bank.axes, clearance=bank.clearance,
        clearance_grid=Grid(*map(float, bank.clearance_grid)), scenarios=bank.scenarios,
        collected_wh=charge.collected_wh, solar_step=float(charge.time_step_s),
        team=np.array(params.team, dtype=np.float64).reshape(-1, 2),
    )  # fmt: skip
    constants = kernels.Constants(
        half_width=float(params.half_width_m), horizon=float(params.horizon_s),
        action_period=float(params.action_period_s), sub_steps=int(params.sub_steps),
        euler=params.integrator == "euler", goal_radius=float(params.goal_radius_m),
        max_hop=float(params.max_hop_m), airspeed=float(params.airspeed_m_s),
        drift_threshold=float(params.drift_threshold), flight_power=float(params.flight_power_w),
        base_power=float(params.base_power_w), capacity=float(params.battery_wh),
        initial_charge=float(params.initial_charge), start_time_spread=float(params.start_time_spread_s),
        clock_offset=clock_offset, target_dx=float(params.target_offset[0]),
        target_dy=float(params.target_offset[1]), current_noise=float(params.current_noise_m_s),
        start_anywhere=float(params.start_anywhere), progress_weight=float(params.progress_weight),
        arrival_bonus=float(params.arrival_bonus), failure_penalty=float(params.failure_penalty),
    )  # fmt: skip
    return ocean, constants, bank.notes


TASK = Task(
    name="drift-hop",
    params=Params,
    world=WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=kernels.REWARD_TERMS,
    outcomes=kernels.OUTCOMES,
    build=build,
    action_spec=lambda params: ActionSpec(
        size=2, table=discrete_hops() if params.action_type == "discrete" else None
    ),
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
)

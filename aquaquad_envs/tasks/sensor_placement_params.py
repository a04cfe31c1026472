"""Parameters of sensor placement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.physics import energy
from aquaquad_envs.sensing.emissions import KINDS as EMISSIONS
from aquaquad_envs.sensing.measurements import KINDS
from aquaquad_envs.tasks.scenarios import Rectangle, ScenarioSpec
from aquaquad_envs.tasks.sensor_placement_data import MAX_TARGETS, MAX_VEHICLES, TARGET_MOTIONS

SCENARIOS = {
    "calm": "no current",
    "vortex": "the published vortex, with one 2 km square obstacle at the centre",
    "gyres": "random divergence-free fields that change with time, random obstacles",
    "file": "real currents from a NetCDF file, land as obstacles",
    "fence": "hold a slowly moving line in the currents of gyres",
    "grid": "range-only tracking by vehicles steered at 1 m/s, without current, energy or flight",
}

_DEFAULTS: dict[str, object] = {
    "num_vehicles": 4, "num_targets": 1, "measurement": "tdoa", "half_width_m": 5000.0, "horizon_s": 6 * 3600.0,
    "action_period_s": 300.0, "sub_steps": 5, "target_speed_m_s": 0.3, "range_std_m": 50.0,
}  # fmt: skip
_SCENARIO_DEFAULTS: dict[str, dict[str, object]] = {
    "file": {"half_width_m": 20_000.0},
    "fence": {"num_targets": 0},
    "grid": {
        "num_vehicles": 3, "num_targets": 3, "measurement": "range", "half_width_m": 1000.0, "horizon_s": 3840.0,
        "action_period_s": 30.0, "sub_steps": 1, "target_speed_m_s": 1.0 / 3.0, "range_std_m": 5.0,
    },
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the sensor placement world; every one is a keyword of the environments.

    Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "vortex"
    #: 3 to 8, from 1 in ``grid``. Default 4, grid 3.
    num_vehicles: int | None = None
    #: 1 to 5, 0 in ``fence`` only. Default 1, fence 0, grid 3.
    num_targets: int | None = None
    #: "bearing", "range" or "tdoa". Default tdoa; grid is range only.
    measurement: str | None = None
    #: m; the mission box is [-half_width, half_width]². Default 5000, file 20 000, grid 1000.
    half_width_m: float | None = None
    #: s of mission before truncation. Default 6 h, grid 3840 s.
    horizon_s: float | None = None
    #: s of one decision of the whole team. Default 300, grid 30.
    action_period_s: float | None = None
    #: steps a decision, of motion and of the tracker. Default 5, grid 1.
    sub_steps: int | None = None
    #: "rk4", or "euler" (published).
    integrator: str = "rk4"
    #: space interpolation of the vortex: "bilinear", or "cell" (published).
    interpolation: str = "bilinear"
    #: m; longest single hop: 2 min at the air speed (Dillard 2014, App. C).
    max_hop_m: float = 4000.0 / 3.0
    #: m/s; 20 knots of the source's 2000 m mile.
    airspeed_m_s: float = 40_000.0 / 3600.0
    #: action norm below which a vehicle drifts.
    drift_threshold: float = 0.1
    #: m/s; speed of full action in ``grid``.
    vehicle_speed_m_s: float = 1.0
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
    #: "spread": vehicles start anywhere on open water; "cluster": all in one disc.
    start_layout: str = "spread"
    #: m; radius of that disc.
    cluster_radius_m: float = 500.0
    #: m/s; standard deviation of the measured local current, 0 for none.
    current_noise_m_s: float = 0.0
    #: "constant-velocity", "manoeuvring" or "stop-and-go".
    target_motion: str = "constant-velocity"
    #: m/s. Default 0.3, a glider's; grid 1/3.
    target_speed_m_s: float | None = None
    #: m²/s³; white acceleration of a constant-velocity target.
    target_noise_m2_s3: float = 1e-7
    #: s; mean time between manoeuvres, and of going in stop-and-go.
    manoeuvre_interval_s: float = 1800.0
    #: s; mean time of standing still in stop-and-go.
    stop_time_s: float = 900.0
    #: standard deviations of the measurements: rad and s as published (Dillard 2014, III.E, V.C); m, grid 5.
    bearing_std_rad: float = float(np.sqrt(1e-4 / 0.005))
    range_std_m: float | None = None
    tdoa_std_s: float = float(np.sqrt(1e-8 / 0.005))
    #: growth of that with range: σ √(1 + (level · r / reference)²); 0 for none.
    noise_level: float = 0.0
    #: m
    noise_reference_m: float = 1000.0
    #: m/s, as published.
    sound_speed_m_s: float = 1500.0
    #: "reference": with the vehicle nearest to the target; "all": every pair (published, with three vehicles).
    tdoa_pairs: str = "reference"
    #: share of the transmission loss in the passive sonar equation; 0: all is heard.
    detection_level: float = 0.0
    #: dB re 1 µPa at 1 m.
    source_level_db: float = 150.0
    #: when targets are heard: "always", "periodic" or "random".
    emissions: str = "always"
    #: s; period of pings, and their jitter as a share of it.
    emission_period_s: float = 600.0
    emission_jitter: float = 0.0
    #: s; mean times on and off of random emissions.
    emission_on_s: float = 600.0
    emission_off_s: float = 600.0
    #: share of the sound's true travel time by which measurements come late; 0: at once.
    travel_time_level: float = 0.0
    #: s; mean of the exponential delay at which each vehicle shares what it heard; 0: at once.
    sharing_delay_s: float = 0.0
    #: share of time that a vehicle's link is down; 0: never.
    dropout: float = 0.0
    #: s; mean time that a link stays down.
    dropout_burst_s: float = 600.0
    #: "ukf" or "ekf".
    tracker: str = "ukf"
    #: the tracker's motion: "constant-velocity" or "constant-acceleration".
    track_model: str = "constant-velocity"
    #: process noise of the tracker, m²/s³ or m²/s⁵; None: that of the target's motion.
    process_noise: float | None = None
    #: m and m/s; deviation of the first estimate from the truth.
    initial_position_std_m: float = 100.0
    initial_velocity_std_m_s: float = 0.2
    #: a track is lost when its mean NIS per measurement passes this,
    lost_nis: float = 5.0
    #: or its standard deviation this many m. Default half of half_width.
    lost_std_m: float | None = None
    #: nodes a km of fence; the fence is num_vehicles / density long. None: 1.2 half widths of fence.
    fence_density_per_km: float | None = None
    #: m/s
    fence_speed_m_s: float = 0.05
    #: m from a vehicle that count as covered. None: 0.6 of the spacing of nodes.
    fence_cover_m: float | None = None
    #: scenarios in a random bank, and the seed that decides them.
    num_fields: int = 256
    field_seed: int = 0
    #: NetCDF path (or two: u and v) for ``scenario="file"``, its centre (latitude, longitude) and first time.
    currents_file: str | tuple[str, ...] | None = None
    currents_center: tuple[float, float] | None = None
    currents_start: str | None = None
    #: "continuous", or "discrete": drift, or one of 16 headings at half or full length.
    action_type: str = "continuous"
    #: weights of the reward terms (see docs/sensor_placement.md).
    tracking_weight: float = 1.0
    bound_weight: float = 1.0
    hdop_weight: float = 0.5
    coverage_weight: float = 1.0
    energy_weight: float = 0.5
    failure_penalty: float = 5.0

    def __post_init__(self) -> None:
        check_choice("scenario", self.scenario, SCENARIOS)
        check_choice("energy", self.energy, energy.PRESETS)
        preset = energy.PRESETS[self.energy]
        self._fill(
            {
                "flight_power_w": preset.flight_power_w, "base_power_w": preset.base_power_w,
                "battery_wh": preset.battery_wh, **_DEFAULTS, **_SCENARIO_DEFAULTS.get(self.scenario, {}),
            }
        )  # fmt: skip
        for name, choices in _CHOICES.items():
            check_choice(name, getattr(self, name), choices)
        for name, low, high, open_low in _BOUNDS:
            if getattr(self, name) is not None or name not in _LATER:
                check_range(name, getattr(self, name), low, high, open_low=open_low)
        for name in _WHOLE:
            if not isinstance(getattr(self, name), int | np.integer):
                raise InvalidParameterError(name, getattr(self, name), "a whole number")
        self._freeze_obstacles()
        self._freeze_center()
        self._fill({"lost_std_m": 0.5 * self.half_width_m})
        self._fill({"fence_density_per_km": 1000.0 * self.num_vehicles / (1.2 * self.half_width_m)})
        self._fill({"fence_cover_m": 600.0 / self.fence_density_per_km})
        self._check_together()

    def _fill(self, defaults: dict[str, object]) -> None:
        for name, value in defaults.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)

    def _check_together(self) -> None:
        """What parameters ask of each other."""
        grid, fence = self.scenario == "grid", self.scenario == "fence"
        if not grid and self.num_vehicles < 3:
            raise InvalidParameterError("num_vehicles", self.num_vehicles, "3 to 8", "Only grid takes fewer.")
        if not fence and self.num_targets < 1:
            raise InvalidParameterError("num_targets", self.num_targets, "1 to 5", "Only fence goes without.")
        if grid and self.measurement != "range":
            raise InvalidParameterError("measurement", self.measurement, "'range' in the scenario grid")
        if self.solar == "file" and self.solar_file is None:
            raise InvalidParameterError("solar_file", None, "the path of a TMY3 or NSRDB file")
        longest = self.action_period_s * self.airspeed_m_s
        if not grid and self.max_hop_m > longest * (1 + 1e-9):
            raise InvalidParameterError(
                "max_hop_m", self.max_hop_m, f"at most {longest:g} m, a flight of one action period",
                "Decisions of a team are synchronous: lengthen action_period_s or shorten the hop.",
            )  # fmt: skip
        if self.scenario == "vortex" and not 4500 <= self.half_width_m <= 50_000:
            raise InvalidParameterError(
                "half_width_m", self.half_width_m, "4500 to 50 000 m in the vortex",
                "The published start lies 4 km out, and the obstacle grid has a node every 100 m.",
            )  # fmt: skip
        if fence and self.fence_length_m > 1.6 * self.half_width_m:
            raise InvalidParameterError(
                "fence_density_per_km", self.fence_density_per_km,
                f"at least {self.num_vehicles / (1.6e-3 * self.half_width_m):g}, a fence that fits the box",
                "It is num_vehicles / density long: enlarge half_width_m, or send fewer vehicles.",
            )  # fmt: skip

    def _freeze_obstacles(self) -> None:
        if self.obstacles is None:
            return
        try:
            rows = np.asarray(self.obstacles, dtype=np.float64)
        except (TypeError, ValueError):
            rows = np.full(1, np.nan)
        if rows.size and (rows.ndim != 2 or rows.shape[1] != 4 or not np.isfinite(rows).all()):
            raise InvalidParameterError("obstacles", self.obstacles, "a sequence of 4 finite numbers each")
        object.__setattr__(self, "obstacles", tuple(tuple(map(float, row)) for row in rows.reshape(-1, 4)))

    def _freeze_center(self) -> None:
        if self.currents_center is None:
            return
        try:
            pair = np.asarray(self.currents_center, dtype=np.float64)
        except (TypeError, ValueError):
            pair = np.empty(0)
        if pair.shape != (2,) or not np.isfinite(pair).all():
            raise InvalidParameterError("currents_center", self.currents_center, "two finite numbers")
        object.__setattr__(self, "currents_center", tuple(pair.tolist()))

    @property
    def fence_length_m(self) -> float:
        """Length of the fence, m: the nodes of all vehicles at the stated density."""
        return 1000.0 * self.num_vehicles / self.fence_density_per_km

    @property
    def measurement_std(self) -> float:
        """Standard deviation of the chosen measurement at zero range: rad, m or s."""
        return {"bearing": self.bearing_std_rad, "range": self.range_std_m, "tdoa": self.tdoa_std_s}[
            self.measurement
        ]

    def scenario_spec(self) -> ScenarioSpec:
        """The part of the parameters that decides the scenario bank; the fence lies in open gyres."""
        fence = self.scenario == "fence"
        return ScenarioSpec(
            scenario="gyres" if fence else self.scenario, half_width_m=self.half_width_m,
            obstacles=() if fence and self.obstacles is None else self.obstacles,
            obstacle_margin_m=self.obstacle_margin_m, interpolation=self.interpolation,
            num_fields=self.num_fields, field_seed=self.field_seed, forecast_error=0.0,
            duration_s=self.horizon_s + self.start_time_spread_s, currents_file=self.currents_file,
            currents_center=self.currents_center, currents_start=self.currents_start,
        )  # fmt: skip


_CHOICES = {
    "measurement": KINDS, "integrator": ("rk4", "euler"), "interpolation": ("bilinear", "cell"),
    "solar": ("clear-sky", "constant", "file"), "start_layout": ("spread", "cluster"),
    "target_motion": TARGET_MOTIONS, "tdoa_pairs": ("reference", "all"), "emissions": EMISSIONS,
    "tracker": ("ukf", "ekf"), "track_model": ("constant-velocity", "constant-acceleration"),
    "action_type": ("continuous", "discrete"),
}  # fmt: skip
_WHOLE = ("num_vehicles", "num_targets", "sub_steps", "num_fields", "field_seed")
#: Left at None where the rest of the parameters decides.
_LATER = ("process_noise", "lost_std_m", "fence_density_per_km", "fence_cover_m")
_BOUNDS = (
    ("num_vehicles", 1, MAX_VEHICLES, False), ("num_targets", 0, MAX_TARGETS, False),
    ("half_width_m", 100, 1e6, False), ("horizon_s", 60, 1e8, False), ("action_period_s", 1, 1e5, False),
    ("sub_steps", 1, 1000, False), ("max_hop_m", 1, 1e6, False), ("airspeed_m_s", 0.1, 100, False),
    ("drift_threshold", 0, 1, False), ("vehicle_speed_m_s", 0, 100, True), ("flight_power_w", 0, 1e5, True),
    ("base_power_w", 0, 1e4, False), ("battery_wh", 0, 1e6, True), ("initial_charge", 0, 1, True),
    ("latitude", -90, 90, False), ("longitude", -180, 360, False), ("start_time_spread_s", 0, 1e8, False),
    ("obstacle_margin_m", 0, 1e5, False), ("cluster_radius_m", 0, 1e6, True), ("current_noise_m_s", 0, 10, False),
    ("target_speed_m_s", 0, 100, False), ("target_noise_m2_s3", 0, 1, False),
    ("manoeuvre_interval_s", 1, 1e8, False), ("stop_time_s", 1, 1e8, False),
    ("bearing_std_rad", 1e-6, 3, False), ("range_std_m", 1e-3, 1e5, False), ("tdoa_std_s", 1e-7, 10, False),
    ("noise_level", 0, 100, False), ("noise_reference_m", 1, 1e6, False), ("sound_speed_m_s", 1, 1e5, False),
    ("detection_level", 0, 1, False), ("source_level_db", -300, 300, False),
    ("emission_period_s", 1, 1e8, False), ("emission_jitter", 0, 1, False), ("emission_on_s", 1, 1e8, False),
    ("emission_off_s", 0, 1e8, False), ("travel_time_level", 0, 1, False), ("sharing_delay_s", 0, 3600, False),
    ("dropout", 0, 0.99, False), ("dropout_burst_s", 1, 1e8, False), ("process_noise", 0, 1e3, False),
    ("initial_position_std_m", 1e-3, 1e5, False), ("initial_velocity_std_m_s", 1e-6, 100, False),
    ("lost_nis", 1, 1e6, True), ("lost_std_m", 1e-3, 1e6, False), ("fence_density_per_km", 0, 1e3, True),
    ("fence_speed_m_s", 0, 10, False), ("fence_cover_m", 0, 1e5, True), ("num_fields", 1, 100_000, False),
    ("field_seed", 0, 2**63, False), ("tracking_weight", 0, 1e6, False), ("bound_weight", 0, 1e6, False),
    ("hdop_weight", 0, 1e6, False), ("coverage_weight", 0, 1e6, False), ("energy_weight", 0, 1e6, False),
    ("failure_penalty", 0, 1e6, False),
)  # fmt: skip

"""Parameters of sensor placement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.sensing.emissions import KINDS as EMISSIONS
from aquaquad_envs.sensing.measurements import KINDS
from aquaquad_envs.tasks.scenarios import ScenarioSpec
from aquaquad_envs.tasks.sensor_placement_data import MAX_TARGETS, MAX_VEHICLES, TARGET_MOTIONS
from aquaquad_envs.tasks.vehicle_params import BOUNDS, VehicleParams

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
class Params(VehicleParams):
    """Parameters of the sensor placement world; every one is a keyword of the environments.

    ``half_width_m`` is 5000 by default, 20 000 in ``file``, 1000 in ``grid``. Raises ``InvalidParameterError`` for a
    value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "vortex"
    #: 3 to 8, from 1 in ``grid``. Default 4, grid 3.
    num_vehicles: int | None = None
    #: 1 to 5, 0 in ``fence`` only. Default 1, fence 0, grid 3.
    num_targets: int | None = None
    #: "bearing", "range" or "tdoa". Default tdoa; grid is range only.
    measurement: str | None = None
    #: s of mission before truncation. Default 6 h, grid 3840 s.
    horizon_s: float | None = None
    #: s of one decision of the whole team. Default 300, grid 30.
    action_period_s: float | None = None
    #: steps a decision, of motion and of the tracker. Default 5, grid 1.
    sub_steps: int | None = None
    #: m/s; speed of full action in ``grid``.
    vehicle_speed_m_s: float = 1.0
    #: "spread": vehicles start anywhere on open water; "cluster": all in one disc.
    start_layout: str = "spread"
    #: m; radius of that disc.
    cluster_radius_m: float = 500.0
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
    #: weights of the reward terms (see docs/sensor_placement.md).
    tracking_weight: float = 1.0
    bound_weight: float = 1.0
    hdop_weight: float = 0.5
    coverage_weight: float = 1.0
    energy_weight: float = 0.5
    failure_penalty: float = 5.0
    #: 0 by default: pays for a quick first fix, which decides the RMSE of a mission that starts badly placed.
    acquisition_weight: float = 0.0

    def __post_init__(self) -> None:
        self._complete(
            SCENARIOS, _DEFAULTS, _SCENARIO_DEFAULTS, bounds=_BOUNDS, choices=_CHOICES, whole=_WHOLE, later=_LATER
        )  # fmt: skip
        self._fill({"lost_std_m": 0.5 * self.half_width_m})
        self._fill({"fence_density_per_km": 1000.0 * self.num_vehicles / (1.2 * self.half_width_m)})
        self._fill({"fence_cover_m": 600.0 / self.fence_density_per_km})
        self._check_together()

    def _check_together(self) -> None:
        """What parameters ask of each other."""
        grid, fence = self.scenario == "grid", self.scenario == "fence"
        if not grid and self.num_vehicles < 3:
            raise InvalidParameterError("num_vehicles", self.num_vehicles, "3 to 8", "Only grid takes fewer.")
        if not fence and self.num_targets < 1:
            raise InvalidParameterError("num_targets", self.num_targets, "1 to 5", "Only fence goes without.")
        if grid and self.measurement != "range":
            raise InvalidParameterError("measurement", self.measurement, "'range' in the scenario grid")
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
        fence = {"scenario": "gyres", "obstacles": self.obstacles or ()} if self.scenario == "fence" else {}
        return self._scenario_spec(self.horizon_s, **fence)


_CHOICES = {
    "measurement": KINDS, "start_layout": ("spread", "cluster"), "target_motion": TARGET_MOTIONS,
    "tdoa_pairs": ("reference", "all"), "emissions": EMISSIONS, "tracker": ("ukf", "ekf"),
    "track_model": ("constant-velocity", "constant-acceleration"),
}  # fmt: skip
_WHOLE = ("num_vehicles", "num_targets", "sub_steps")
#: Left at None where the rest of the parameters decides.
_LATER = ("process_noise", "lost_std_m", "fence_density_per_km", "fence_cover_m")
_BOUNDS = (
    *BOUNDS, ("num_vehicles", 1, MAX_VEHICLES, False), ("num_targets", 0, MAX_TARGETS, False),
    ("horizon_s", 60, 1e8, False), ("action_period_s", 1, 1e5, False), ("sub_steps", 1, 1000, False),
    ("vehicle_speed_m_s", 0, 100, True), ("cluster_radius_m", 0, 1e6, True), ("target_speed_m_s", 0, 100, False),
    ("target_noise_m2_s3", 0, 1, False), ("manoeuvre_interval_s", 1, 1e8, False), ("stop_time_s", 1, 1e8, False),
    ("bearing_std_rad", 1e-6, 3, False), ("range_std_m", 1e-3, 1e5, False), ("tdoa_std_s", 1e-7, 10, False),
    ("noise_level", 0, 100, False), ("noise_reference_m", 1, 1e6, False), ("sound_speed_m_s", 1, 1e5, False),
    ("detection_level", 0, 1, False), ("source_level_db", -300, 300, False),
    ("emission_period_s", 1, 1e8, False), ("emission_jitter", 0, 1, False), ("emission_on_s", 1, 1e8, False),
    ("emission_off_s", 0, 1e8, False), ("travel_time_level", 0, 1, False), ("sharing_delay_s", 0, 3600, False),
    ("dropout", 0, 0.99, False), ("dropout_burst_s", 1, 1e8, False), ("process_noise", 0, 1e3, False),
    ("initial_position_std_m", 1e-3, 1e5, False), ("initial_velocity_std_m_s", 1e-6, 100, False),
    ("lost_nis", 1, 1e6, True), ("lost_std_m", 1e-3, 1e6, False), ("fence_density_per_km", 0, 1e3, True),
    ("fence_speed_m_s", 0, 10, False), ("fence_cover_m", 0, 1e5, True),
    ("tracking_weight", 0, 1e6, False), ("bound_weight", 0, 1e6, False),
    ("hdop_weight", 0, 1e6, False), ("coverage_weight", 0, 1e6, False), ("energy_weight", 0, 1e6, False),
    ("failure_penalty", 0, 1e6, False), ("acquisition_weight", 0, 1e6, False),
)  # fmt: skip

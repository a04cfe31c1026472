"""Parameters that every world of the AquaQuad shares: its hops and energy, the sun, the place, and the water."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.physics import energy
from aquaquad_envs.tasks.scenarios import Rectangle, ScenarioSpec

#: Name, lowest and highest value of a number, and whether the lowest itself is refused.
Bound = tuple[str, float, float, bool]


@dataclass(frozen=True, kw_only=True)
class VehicleParams:
    """Base of a task's ``Params``, which adds its own fields and calls :meth:`_complete` first on construction.

    :func:`~aquaquad_envs.tasks.ocean.build_ocean` reads, besides, the task's ``horizon_s`` and
    ``action_period_s`` (fields or properties). Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: What an episode is drawn from; the task names the scenarios and the default.
    scenario: str
    #: m; the mission box is [-half_width, half_width]². None: the scenario's, as the task has it.
    half_width_m: float | None = None
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
    #: m/s; standard deviation of the measured local current, 0 for none.
    current_noise_m_s: float = 0.0
    #: scenarios in a random bank, and the seed that decides them.
    num_fields: int = 256
    field_seed: int = 0
    #: NetCDF path (or two: u and v) for ``scenario="file"``, its centre (latitude, longitude) and first time.
    currents_file: str | tuple[str, ...] | None = None
    currents_center: tuple[float, float] | None = None
    currents_start: str | None = None
    #: "continuous", or "discrete": drift, or one of 16 headings at half or full length.
    action_type: str = "continuous"

    def _complete(
        self,
        scenarios: Collection[str],
        defaults: Mapping[str, Any],
        scenario_defaults: Mapping[str, Mapping[str, Any]],
        *,
        bounds: Collection[Bound],
        choices: Mapping[str, Collection[str]] | None = None,
        whole: Collection[str] = (),
        later: Collection[str] = (),
    ) -> None:
        """Fill what is None, check every field that a table names, and freeze what is shared here.

        ``bounds``: of all numbers, :data:`BOUNDS` included; ``choices`` and ``whole``: the task's own, besides
        those here; ``later``: numbers that may stay None, because the rest of the parameters decides them.
        """
        check_choice("scenario", self.scenario, scenarios)
        check_choice("energy", self.energy, energy.PRESETS)
        preset = energy.PRESETS[self.energy]
        budget = {name: getattr(preset, name) for name in ("flight_power_w", "base_power_w", "battery_wh")}
        self._fill({**budget, **defaults, **scenario_defaults.get(self.scenario, {})})
        for name, known in {**_CHOICES, **(choices or {})}.items():
            check_choice(name, getattr(self, name), known)
        for name, low, high, open_low in bounds:
            if getattr(self, name) is not None or name not in later:
                check_range(name, getattr(self, name), low, high, open_low=open_low)
        for name in ("num_fields", "field_seed", *whole):
            if not isinstance(getattr(self, name), int | np.integer):
                raise InvalidParameterError(name, getattr(self, name), "a whole number")
        if self.obstacles is not None:
            self._freeze_points("obstacles", 4)
        if self.currents_center is not None:
            self._freeze_pair("currents_center")
        if self.solar == "file" and self.solar_file is None:
            raise InvalidParameterError("solar_file", None, "the path of a TMY3 or NSRDB file")

    def _fill(self, defaults: Mapping[str, Any]) -> None:
        for name, value in defaults.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)

    def _freeze_points(self, name: str, width: int) -> None:
        value = getattr(self, name)
        try:
            points = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            points = np.full(1, np.nan)
        if points.size and (points.ndim != 2 or points.shape[1] != width or not np.isfinite(points).all()):
            raise InvalidParameterError(name, value, f"a sequence of {width} finite numbers each")
        object.__setattr__(self, name, tuple(tuple(map(float, row)) for row in points.reshape(-1, width)))

    def _freeze_pair(self, name: str) -> None:
        value = getattr(self, name)
        try:
            pair = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            pair = np.empty(0)
        if pair.shape != (2,) or not np.isfinite(pair).all():
            raise InvalidParameterError(name, value, "two finite numbers")
        object.__setattr__(self, name, tuple(pair.tolist()))

    def _scenario_spec(self, horizon_s: float, **changes: Any) -> ScenarioSpec:
        """What decides the scenario bank of a mission of ``horizon_s``; ``changes`` replace fields of the spec."""
        names = set(ScenarioSpec.__dataclass_fields__) & set(VehicleParams.__dataclass_fields__)
        values = {name: getattr(self, name) for name in names}
        return ScenarioSpec(**{**values, "duration_s": horizon_s + self.start_time_spread_s, **changes})

    def vehicle_constants(self) -> dict[str, Any]:
        """Scalars as kernels name them: keywords of a task's ``Constants``."""
        return {
            "half_width": float(self.half_width_m), "euler": self.integrator == "euler",
            "max_hop": float(self.max_hop_m), "airspeed": float(self.airspeed_m_s),
            "drift_threshold": float(self.drift_threshold), "flight_power": float(self.flight_power_w),
            "base_power": float(self.base_power_w), "capacity": float(self.battery_wh),
            "initial_charge": float(self.initial_charge), "start_time_spread": float(self.start_time_spread_s),
            "current_noise": float(self.current_noise_m_s),
        }  # fmt: skip


_CHOICES = {
    "integrator": ("rk4", "euler"), "interpolation": ("bilinear", "cell"),
    "solar": ("clear-sky", "constant", "file"), "action_type": ("continuous", "discrete"),
}  # fmt: skip
#: Bounds of the numbers above: the first rows of a task's own table.
BOUNDS: tuple[Bound, ...] = (
    ("half_width_m", 100, 1e6, False), ("max_hop_m", 1, 1e6, False), ("airspeed_m_s", 0.1, 100, False),
    ("drift_threshold", 0, 1, False), ("flight_power_w", 0, 1e5, True), ("base_power_w", 0, 1e4, False),
    ("battery_wh", 0, 1e6, True), ("initial_charge", 0, 1, True), ("latitude", -90, 90, False),
    ("longitude", -180, 360, False), ("start_time_spread_s", 0, 1e8, False), ("obstacle_margin_m", 0, 1e5, False),
    ("current_noise_m_s", 0, 10, False), ("num_fields", 1, 100_000, False), ("field_seed", 0, 2**63, False),
)  # fmt: skip

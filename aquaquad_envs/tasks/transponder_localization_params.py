"""Parameters of transponder localization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice
from aquaquad_envs.tasks.scenarios import ScenarioSpec
from aquaquad_envs.tasks.transponder_localization_data import MAX_MEASUREMENTS, MAX_TRANSPONDERS, VEHICLES
from aquaquad_envs.tasks.vehicle_params import BOUNDS, VehicleParams

SCENARIOS = {
    "single": "the published transponder, start and noise, still water",
    "four": "the published four transponders, still water",
    "field": "the two transponders of the published field trial, its start and noise, still water",
    "random": "one to six transponders at random places and depths, random start, still water",
    "current": "as random, in random divergence-free currents",
    "deep": "as current, hundreds of times larger: a box of 10 km, transponders 500 to 2000 m deep",
    "file": "as deep, in real currents from a NetCDF file, land as obstacles",
}

#: Published places (east, north, depth), m (Garcia 2018, Tables 5.8 and 6.7; z there is up).
PUBLISHED = ((17.0, 15.0, 6.0), (-2.0, -1.0, 7.0), (5.0, 5.0, 10.0), (-9.0, 13.0, 8.0))
PUBLISHED_FIELD = ((9.21, 1.68, 1.15), (2.79, 0.44, 1.15))
#: Those of kilometres.
LARGE = ("deep", "file")

#: s; the aquaquad decides as often as the team of sensor placement does.
AQUAQUAD_PERIOD_S = 300.0
#: Degrees that the yaw-rate vehicle turns in a period at most (published: 30 degrees/s for 1 s).
TURN_DEG = 30.0
#: Greatest deviation of a first estimate over that of a range: beyond, double precision runs short.
MOST_RATIO = 2000.0

Place = tuple[float, float, float]

_DEFAULTS: dict[str, object] = {
    "half_width_m": 60.0, "depth_m": (3.0, 15.0), "spread_m": 30.0, "period_s": 1.0, "max_step_m": 5.0,
    "range_std_m": 0.12, "prior_std_m": (100.0, 100.0, 2.0), "outlier_scale_m": 10.0, "transponders": (),
}  # fmt: skip
_LARGE_DEFAULTS: dict[str, object] = {
    "half_width_m": 5000.0, "depth_m": (500.0, 2000.0), "spread_m": 3000.0, "period_s": 100.0, "max_step_m": 500.0,
    "range_std_m": 5.0, "prior_std_m": (1000.0, 1000.0, 50.0), "outlier_scale_m": 300.0,
}  # fmt: skip
_SCENARIO_DEFAULTS: dict[str, dict[str, object]] = {
    "single": {"transponders": PUBLISHED[:1], "start": (-3.0, 9.0), "start_heading_deg": -30.0},
    "four": {"transponders": PUBLISHED, "start": (-3.0, 9.0), "start_heading_deg": -30.0},
    "field": {
        "transponders": PUBLISHED_FIELD, "start": (8.62, -6.77), "start_heading_deg": 13.0, "range_std_m": 1.006,
        "max_step_m": 10.0,
    },
    "deep": _LARGE_DEFAULTS,
    "file": {**_LARGE_DEFAULTS, "half_width_m": 20_000.0},
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Params(VehicleParams):
    """Parameters of the transponder localization world; every one can be passed to ``gymnasium.make``.

    Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "single"
    #: "yaw-rate" (published, holds its speed and turns), "greedy" (published, a free step) or "aquaquad".
    vehicle: str = "yaw-rate"
    #: 1 to 6; of places that are given, the first so many. None: all given, or one to six drawn each episode.
    num_transponders: int | None = None
    #: (east, north, depth), m, of up to six; None: the scenario's, or drawn each episode.
    transponders: tuple[Place, ...] | None = None
    #: m; depths of drawn transponders are uniform in this. Default 3 to 15, large scenarios 500 to 2000.
    depth_m: tuple[float, float] | None = None
    #: m; radius of the disc that drawn transponders and starts lie in. Default 30, large 3000.
    spread_m: float | None = None
    #: (east, north), m; place of the first measurement. None: the scenario's, or drawn.
    start: tuple[float, float] | None = None
    #: degrees from east, anticlockwise; None: the scenario's, or drawn. The yaw-rate vehicle alone has one.
    start_heading_deg: float | None = None
    #: measurements an episode, the first at its start.
    num_measurements: int = 30
    #: s between measurements. Default 1 (published), large 100, aquaquad 300.
    period_s: float | None = None
    #: m/s through the water, of the yaw-rate vehicle (published).
    speed_m_s: float = 3.0
    #: degrees/s of full action. Default 30 degrees a period (published).
    yaw_rate_limit_deg_s: float | None = None
    #: m; full step of the greedy vehicle. Default 5 (published), field 10 (published), large 500.
    max_step_m: float | None = None
    #: m; standard deviation of a range. Default 0.12 and field 1.006 (published), large 5.
    range_std_m: float | None = None
    #: m, east, north, down: of the first estimate, which is drawn about the truth. Default 100, 100, 2 (published).
    prior_std_m: Place | None = None
    #: share of ranges that are outliers: an echo, late by a half-normal excess,
    outlier_share: float = 0.0
    #: of this scale, m. Default 10, large 300.
    outlier_scale_m: float | None = None
    #: share of ranges without a reply.
    miss_share: float = 0.0
    #: standard deviation of the relative error of the assumed speed of sound, drawn once an episode; 0: none.
    sound_speed_error: float = 0.0
    #: standard deviations beyond which a range counts less (Huber's loss); 0: least squares (published).
    robust_threshold: float = 0.0
    #: factor of the scenario's currents; 0: still water.
    current_level: float = 1.0
    #: integration steps a drift of the aquaquad.
    sub_steps: int = 5
    #: weights of the reward terms (see docs/transponder_localization.md).
    information_weight: float = 1.0
    error_weight: float = 0.0
    energy_weight: float = 0.5
    failure_penalty: float = 5.0

    def __post_init__(self) -> None:
        check_choice("vehicle", self.vehicle, VEHICLES)
        check_choice("scenario", self.scenario, SCENARIOS)
        theirs = dict(_SCENARIO_DEFAULTS.get(self.scenario, {}))
        if self.vehicle == "aquaquad":
            theirs["period_s"] = AQUAQUAD_PERIOD_S
        self._complete(
            SCENARIOS, _DEFAULTS, {self.scenario: theirs}, bounds=_BOUNDS, whole=("num_measurements", "sub_steps"),
            later=_LATER,
        )  # fmt: skip
        self._fill({"yaw_rate_limit_deg_s": TURN_DEG / self.period_s})
        self._freeze_points("transponders", 3)
        self._freeze_numbers("depth_m", 2)
        self._freeze_numbers("prior_std_m", 3)
        if self.start is not None:
            self._freeze_pair("start")
        self._check_together()

    def _freeze_numbers(self, name: str, size: int) -> None:
        try:
            values = np.asarray(getattr(self, name), dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape != (size,) or not np.isfinite(values).all():
            raise InvalidParameterError(name, getattr(self, name), f"{size} finite numbers")
        object.__setattr__(self, name, tuple(values.tolist()))

    def _check_together(self) -> None:
        """What parameters ask of each other."""
        given, wanted = len(self.transponders), self.num_transponders
        most = given or MAX_TRANSPONDERS
        if given > MAX_TRANSPONDERS:
            raise InvalidParameterError("transponders", f"{given} of them", f"at most {MAX_TRANSPONDERS}")
        if wanted is not None and not (isinstance(wanted, int | np.integer) and wanted <= most):
            raise InvalidParameterError(
                "num_transponders", wanted, f"a whole number, 1 to {most}",
                "Only so many places are given." if given else "",
            )  # fmt: skip
        if any(depth < 0 for *_, depth in self.transponders):
            raise InvalidParameterError(
                "transponders", self.transponders, "depths of 0 m or more, positive down"
            )
        if not 0 <= self.depth_m[0] <= self.depth_m[1] <= 1e5:
            raise InvalidParameterError("depth_m", self.depth_m, "0 <= least <= greatest <= 100 000 m")
        low, high = min(self.prior_std_m), max(self.prior_std_m)
        if not 1e-3 <= low <= high <= MOST_RATIO * self.range_std_m:
            raise InvalidParameterError(
                "prior_std_m", self.prior_std_m, f"numbers in [0.001, {MOST_RATIO * self.range_std_m:g}]",
                "A first estimate may be so many times worse than a range (range_std_m).",
            )  # fmt: skip
        if self.vehicle == "aquaquad":
            self._check_hop()

    def _check_hop(self) -> None:
        longest = self.period_s * self.airspeed_m_s
        if self.max_hop_m > longest * (1 + 1e-9):
            raise InvalidParameterError(
                "max_hop_m", self.max_hop_m, f"at most {longest:g} m, a flight of one period",
                "Lengthen period_s or shorten the hop.",
            )  # fmt: skip
        if self.max_hop_m > 2 * self.half_width_m:
            raise InvalidParameterError(
                "max_hop_m", self.max_hop_m, f"at most {2 * self.half_width_m:g} m, the width of the box",
                'The aquaquad is at home in scenario="deep"; elsewhere shorten the hop.',
            )  # fmt: skip

    def scenario_spec(self) -> ScenarioSpec:
        """The part of the parameters that decides the scenario bank: random currents lie in open water."""
        real = self.scenario == "file"
        return self._scenario_spec(
            self.horizon_s, scenario="file" if real else "gyres", forecast_error=0.0,
            obstacles=() if self.obstacles is None and not real else self.obstacles,
        )  # fmt: skip

    @property
    def horizon_s(self) -> float:
        """Length of an episode, s: a period between any two measurements."""
        return (self.num_measurements - 1) * self.period_s

    @property
    def action_period_s(self) -> float:
        """One decision lasts from measurement to measurement, s."""
        return self.period_s

    @property
    def still(self) -> bool:
        """Whether the water stands still everywhere."""
        return self.scenario not in ("current", *LARGE) or self.current_level == 0.0


#: Left at None where the rest of the parameters, or the draw of an episode, decides.
_LATER = ("num_transponders", "start_heading_deg", "yaw_rate_limit_deg_s")
_BOUNDS = (
    # Ten metres are a world here.
    ("half_width_m", 1, 1e6, False), *(bound for bound in BOUNDS if bound[0] != "half_width_m"),
    ("num_transponders", 1, MAX_TRANSPONDERS, False), ("spread_m", 0, 1e6, False),
    ("start_heading_deg", -360, 360, False), ("num_measurements", 2, MAX_MEASUREMENTS, False),
    ("period_s", 1e-3, 1e5, False), ("speed_m_s", 0, 100, False), ("yaw_rate_limit_deg_s", 0, 1e6, False),
    ("max_step_m", 0, 1e5, True), ("range_std_m", 1e-6, 1e5, False), ("outlier_share", 0, 1, False),
    ("outlier_scale_m", 0, 1e5, False), ("miss_share", 0, 1, False), ("sound_speed_error", 0, 0.5, False),
    ("robust_threshold", 0, 1e3, False), ("current_level", 0, 100, False), ("sub_steps", 1, 1000, False),
    ("information_weight", 0, 1e6, False), ("error_weight", 0, 1e6, False), ("energy_weight", 0, 1e6, False),
    ("failure_penalty", 0, 1e6, False),
)  # fmt: skip

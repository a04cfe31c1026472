"""Parameters of plume tracing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.sensing.plume import KINDS
from aquaquad_envs.sensing.plume_puffs import MAX_PUFFS
from aquaquad_envs.tasks.plume_tracing_data import LAYOUTS, MAX_ROBOTS, MEMORY

SCENARIOS = {
    "surround": "the published study: a lamp below a ring of robots, still water",
    "corner": "the same, the robots on an arc to one side",
    "advected": "a smooth plume carried by a stream that varies, the robots downstream",
    "turbulent": "a meandering plume of filaments in such a stream: intermittent whiffs",
}
CURRENTS = ("still", "stream", "gyres", "double-gyre", "tide")

_LAMP: dict[str, object] = {
    "field": "oriented-light", "current": "still", "half_width_m": 50.0, "water_depth_m": 20.0,
    "source_depth_m": 10.0, "horizon_updates": 50, "start_radius_m": 20.0, "start_radius_spread": 0.001,
    "start_height_m": 8.0, "start_height_spread": 0.1, "stop_at_source": False, "detection_floor": 0.0,
    "memory_age_s": 1e9,
}  # fmt: skip
_PLUME: dict[str, object] = {
    "layout": "downstream", "field": "plume", "current": "stream", "half_width_m": 40.0, "water_depth_m": 10.0,
    "source_depth_m": -1.0, "horizon_updates": 300, "start_radius_m": 40.0, "start_radius_spread": 0.2,
    "start_height_m": 0.0, "start_height_spread": 0.0, "stop_at_source": True, "detection_floor": 0.05,
    "memory_age_s": 60.0,
}  # fmt: skip
_SCENARIO_DEFAULTS: dict[str, dict[str, object]] = {
    "surround": {**_LAMP, "layout": "surround"},
    "corner": {**_LAMP, "layout": "corner"},
    "advected": {
        **_PLUME, "puff_growth_m2_s": 0.04, "dispersion_m2_s": 0.0, "meander_std_m_s": 0.0, "detection_floor": 0.005,
        "memory_age_s": 1e9,
    },
    "turbulent": {**_PLUME, "puff_growth_m2_s": 0.01, "dispersion_m2_s": 0.01, "meander_std_m_s": 0.06},
}  # fmt: skip
#: Where the scenario says nothing.
_DEFAULTS: dict[str, object] = {
    "puff_growth_m2_s": 0.01,
    "dispersion_m2_s": 0.0,
    "meander_std_m_s": 0.0,
}


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the plume tracing world; every one is a keyword of the environments.

    Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: What an episode is drawn from, one of ``SCENARIOS``.
    scenario: str = "turbulent"
    #: 2 to 30; ten as published.
    num_robots: int = 10
    #: m; the box is [-half_width, half_width]². Default 50, plumes 40.
    half_width_m: float | None = None
    #: m; depth of the water, from the surface (0) down. Default 20, plumes 10.
    water_depth_m: float | None = None
    #: robots stay at the surface: the third component of actions is ignored, distances are horizontal.
    surface_bound: bool = False
    #: "simultaneous": all robots move in each step; "sequential" (published): one in each step, in turn.
    updates: str = "simultaneous"
    #: updates of the whole team before truncation. Default 50, plumes 300.
    horizon_updates: int | None = None
    #: s of one update of the whole team.
    update_period_s: float = 1.0
    #: m; longest move along each axis (published).
    step_limit_m: float = 0.5
    #: m; robots keep so far apart (published).
    spacing_m: float = 0.5
    #: m from the source,
    reach_radius_m: float = 1.0
    #: and s without a break there, by which the closest robot has reached it.
    reach_time_s: float = 3.0
    #: whether reaching the source ends the episode. Default false, plumes true.
    stop_at_source: bool | None = None
    #: where the team begins: "surround", "corner", "downstream" or "scattered". Default the scenario's.
    layout: str | None = None
    #: m; ring and arc have this radius about the source, downstream it is the distance. Default 20, plumes 40.
    start_radius_m: float | None = None
    #: share of that by which it varies, uniformly. Default 0.001, plumes 0.2.
    start_radius_spread: float | None = None
    #: m above the source, on ring and arc, and the share by which it varies. Default 8 and 0.1.
    start_height_m: float | None = None
    start_height_spread: float | None = None
    #: m; radius of the disc in which a team begins downstream; its centre is as far off the axis at most.
    cluster_radius_m: float = 6.0
    #: m; negative: anywhere between 20 and 80 % of the water's depth. Default 10, plumes -1.
    source_depth_m: float | None = None
    #: m; the source of ring, arc and scattered teams is within this of the origin.
    source_spread_m: float = 0.0
    #: "light", "oriented-light" (published), "rational" or "plume". Default the scenario's.
    field: str | None = None
    #: k of light, unit of reading times m²; amount that a plume's source gives off a second.
    source_strength: float = 1.0
    #: m²; K2 of the rational form.
    rational_offset_m2: float = 1.0
    #: "still", "stream" (a mean flow with eddies), "gyres", "double-gyre" or "tide". Default the scenario's.
    current: str | None = None
    #: m/s; the mean flow of a stream is uniform in 0.5 to 1.5 times this, in any direction.
    current_speed_m_s: float = 0.2
    #: root-mean-square speed of the eddies of a stream, as a share of its mean flow.
    current_variation: float = 0.25
    #: current fields, and the seed that decides them.
    num_fields: int = 32
    field_seed: int = 0
    #: s; the clock of the currents at the start is uniform in [0, this].
    start_time_spread_s: float = 600.0
    #: s between puffs, and how many are followed at once: 2 to 256.
    release_period_s: float = 2.0
    num_puffs: int = 192
    #: s; age of the plume at the start. None: the time to release all puffs.
    plume_age_s: float | None = None
    #: m; standard deviation of a new puff.
    puff_size_m: float = 0.3
    #: m²/s by which its square grows. Default 0.01, advected 0.04.
    puff_growth_m2_s: float | None = None
    #: m²/s; dispersion of puffs, horizontally, and the share of it vertically. Default 0, turbulent 0.01.
    dispersion_m2_s: float | None = None
    vertical_dispersion_share: float = 0.1
    #: m/s; standard deviation of the meander velocity, and its memory in s. Default 0, turbulent 0.06.
    meander_std_m_s: float | None = None
    meander_time_s: float = 30.0
    #: "euler", or "rk4": how puffs follow the current.
    integrator: str = "euler"
    #: sensor noise, a share of the reading: uniform within ± this (published in per cent).
    sensor_noise: float = 0.0
    #: readings below are 0. Default 0, advected 0.005, turbulent 0.05.
    detection_floor: float | None = None
    #: m; error of believed positions, uniform within ± this in x and y.
    position_error_m: float = 0.0
    #: "measurement", or "random-walk" (published): added to the true positions at every step.
    position_error_kind: str = "measurement"
    #: degrees; error of the course steered, uniform within ± this.
    heading_error_deg: float = 0.0
    #: "constant" for each robot and episode, or drawn anew at "each-move".
    heading_error_kind: str = "constant"
    #: m/s; standard deviation of the measured current.
    current_noise_m_s: float = 0.0
    #: m; robots further apart do not hear each other. None: all do.
    comm_radius_m: float | None = None
    #: share of messages that are lost.
    comm_loss: float = 0.0
    #: readings remembered, 1 to 20; the best 20 as published.
    memory_rows: int = MEMORY
    #: s after which a reading is forgotten. Default 1e9, turbulent 60.
    memory_age_s: float | None = None
    #: m; a reading nearer than this to a remembered one replaces it.
    memory_spacing_m: float = 0.05
    #: weights of the reward terms (see docs/plume_tracing.md).
    closest_weight: float = 0.1
    mean_weight: float = 0.05
    own_weight: float = 0.0
    reached_bonus: float = 10.0
    blocked_weight: float = 0.02
    time_weight: float = 0.02

    def __post_init__(self) -> None:
        check_choice("scenario", self.scenario, SCENARIOS)
        for name, value in {**_DEFAULTS, **_SCENARIO_DEFAULTS[self.scenario]}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name, choices in _CHOICES.items():
            check_choice(name, getattr(self, name), choices)
        for name in ("surface_bound", "stop_at_source"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise InvalidParameterError(name, getattr(self, name), "True or False")
        for name, low, high, open_low in _BOUNDS:
            if getattr(self, name) is not None or name not in _LATER:
                check_range(name, getattr(self, name), low, high, open_low=open_low)
        for name in _WHOLE:
            if not isinstance(getattr(self, name), int | np.integer):
                raise InvalidParameterError(name, getattr(self, name), "a whole number")
        if self.plume_age_s is None:
            object.__setattr__(self, "plume_age_s", self.num_puffs * self.release_period_s)
        self._check_together()

    def _check_together(self) -> None:
        """What parameters ask of each other."""
        assert self.half_width_m is not None and self.water_depth_m is not None
        assert self.source_depth_m is not None and self.start_radius_m is not None
        assert self.start_radius_spread is not None and self.start_height_m is not None
        assert self.start_height_spread is not None
        if self.source_depth_m > self.water_depth_m:
            raise InvalidParameterError(
                "source_depth_m", self.source_depth_m, f"at most water_depth_m, {self.water_depth_m:g} m"
            )
        around = self.layout in ("surround", "corner")
        if around and not self.surface_bound and self.source_depth_m >= 0.0:
            least = self.start_height_m * (1.0 + self.start_height_spread)
            if least > self.source_depth_m:
                raise InvalidParameterError(
                    "start_height_m", self.start_height_m, f"robots below the surface: at most source_depth_m, "
                    f"{self.source_depth_m:g} m, with its spread", "Deepen the source, or use surface_bound=True.",
                )  # fmt: skip
        reach = self.start_radius_m * (1.0 + self.start_radius_spread)
        if around and reach + self.source_spread_m > self.half_width_m:
            raise InvalidParameterError(
                "start_radius_m",
                self.start_radius_m,
                f"a ring inside the box of half width {self.half_width_m:g} m",
            )
        if self.layout == "downstream":
            if self.current == "still":
                raise InvalidParameterError("layout", self.layout, "a current, for teams to begin downstream")
            if 0.5 * reach + 2.0 * self.cluster_radius_m > self.half_width_m:
                raise InvalidParameterError(
                    "start_radius_m", self.start_radius_m, "source and team inside the box: half of it, with its "
                    f"spread, and twice cluster_radius_m at most half_width_m, {self.half_width_m:g} m",
                )  # fmt: skip
        if self.source_spread_m > self.half_width_m:
            raise InvalidParameterError(
                "source_spread_m", self.source_spread_m, f"at most half_width_m, {self.half_width_m:g} m"
            )


_CHOICES = {
    "layout": LAYOUTS, "field": KINDS, "current": CURRENTS, "updates": ("simultaneous", "sequential"),
    "integrator": ("euler", "rk4"), "position_error_kind": ("measurement", "random-walk"),
    "heading_error_kind": ("constant", "each-move"),
}  # fmt: skip
_WHOLE = ("num_robots", "horizon_updates", "num_fields", "field_seed", "num_puffs", "memory_rows")
#: Left at None where the rest of the parameters decides.
_LATER = ("plume_age_s", "comm_radius_m")
_BOUNDS = (
    ("num_robots", 2, MAX_ROBOTS, False), ("half_width_m", 5, 1e4, False), ("water_depth_m", 1, 1e4, False),
    ("horizon_updates", 1, 1e6, False), ("update_period_s", 1e-2, 1e4, False), ("step_limit_m", 1e-3, 1e3, False),
    ("spacing_m", 0, 100, False), ("reach_radius_m", 1e-3, 1e4, False), ("reach_time_s", 0, 1e6, False),
    ("start_radius_m", 0, 1e4, False), ("start_radius_spread", 0, 1, False), ("start_height_m", 0, 1e4, False),
    ("start_height_spread", 0, 1, False), ("cluster_radius_m", 0, 1e4, False), ("source_depth_m", -1, 1e4, False),
    ("source_spread_m", 0, 1e4, False), ("source_strength", 0, 1e12, True), ("rational_offset_m2", 0, 1e8, True),
    ("current_speed_m_s", 0, 5, True), ("current_variation", 0, 2, False), ("num_fields", 1, 100_000, False),
    ("field_seed", 0, 2**63, False), ("start_time_spread_s", 0, 1e6, False), ("release_period_s", 1e-2, 1e4, False),
    ("num_puffs", 2, MAX_PUFFS, False), ("plume_age_s", 0, 1e6, False), ("puff_size_m", 1e-2, 1e3, False),
    ("puff_growth_m2_s", 0, 1e3, False), ("dispersion_m2_s", 0, 1e3, False),
    ("vertical_dispersion_share", 0, 1, False), ("meander_std_m_s", 0, 5, False), ("meander_time_s", 1e-2, 1e6, False),
    ("sensor_noise", 0, 1, False), ("detection_floor", 0, 1e12, False), ("position_error_m", 0, 1e3, False),
    ("heading_error_deg", 0, 180, False), ("current_noise_m_s", 0, 10, False), ("comm_radius_m", 0, 1e6, False),
    ("comm_loss", 0, 1, False), ("memory_rows", 1, MEMORY, False), ("memory_age_s", 0, 1e9, True),
    ("memory_spacing_m", 0, 1e3, False), ("closest_weight", 0, 1e6, False), ("mean_weight", 0, 1e6, False),
    ("own_weight", 0, 1e6, False), ("reached_bonus", 0, 1e6, False), ("blocked_weight", 0, 1e6, False),
    ("time_weight", 0, 1e6, False),
)  # fmt: skip

"""Parameters of laser tracking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.sensing.laser import PROFILES, Beam, make_beam
from aquaquad_envs.tasks.laser_tracking_data import SCENARIOS


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of the laser tracking world; every one can be passed to ``gymnasium.make``.

    Raises ``InvalidParameterError`` for a value outside its bound.
    """

    #: Motion of the submerged vehicle, one of ``SCENARIOS``.
    scenario: str = "moving"
    #: horizontal axes: 2, or 1 (published).
    axes: int = 2
    #: s of mission before truncation.
    horizon_s: float = 120.0
    #: s between velocity commands; dynamics and controllers run ``sub_steps`` times in that.
    action_period_s: float = 0.1
    sub_steps: int = 10
    #: m/s; speed of a full action.
    max_speed_m_s: float = 1.0
    #: m above the water; None for the start: the altitude that is held. Published: from the ground, 0.
    altitude_m: float = 4.0
    start_altitude_m: float | None = None
    #: m below the water of the submerged vehicle.
    depth_m: float = 4.0
    #: m; the light's centre starts at 0.6 to 1 of this from the quadrotor ("several metres" published).
    start_distance_m: float = 5.0
    #: m; standard deviation of the first guess along each axis.
    guess_std_m: float = 1.5
    #: m/s; greatest speed of the submerged vehicle.
    rov_speed_m_s: float = 0.3
    #: s; of a whole turn, in the mean.
    turn_period_s: float = 60.0
    #: s; correlation time of a wandering velocity.
    wander_time_s: float = 10.0
    #: "flat-top", or "gaussian".
    profile: str = "flat-top"
    #: even order of a flat-top; None: 10, as published.
    order: int | None = None
    #: W, and full angles of laser and receiver, degrees (Toombs 2022, ch. 2, 6).
    power_w: float = 0.045
    divergence_deg: float = 20.0
    field_of_view_deg: float = 10.0
    #: 1/m in water, and refractive index of the water; 0 and 1 neglect both, as published.
    attenuation_per_m: float = 0.0
    refractive_index: float = 1.0
    #: multiplies the standard deviation of every sensor; 0: perfect sensors.
    noise_level: float = 1.0
    #: W/m²; standard deviation of a reading (3 % of the light on the default flat top).
    noise_std_w_m2: float = 5e-4
    #: bits of the converter (Arduino; published testbed), 0: none.
    adc_bits: int = 10
    #: W/m² at which it saturates; None: 1.5 times the greatest light at the held altitude, ambient light included.
    full_scale_w_m2: float | None = None
    #: W/m² of ambient light that the receiver sees, and the relative standard deviation of its slow variation.
    ambient_w_m2: float = 0.0
    ambient_variation: float = 0.0
    #: s; correlation time of that.
    ambient_time_s: float = 20.0
    #: light counts as detected from this share of the light on the axis on.
    detection_share: float = 0.25
    #: m and m/s; standard deviations of own position and velocity.
    position_std_m: float = 0.02
    velocity_std_m_s: float = 0.02
    #: "measured" (Doppler log or optical flow), or "unknown": taken for 0.
    rov_velocity: str = "measured"
    #: m/s
    rov_velocity_std_m_s: float = 0.05
    #: m and s; standard deviation of an acoustic fix of the submerged vehicle along each axis, and its period.
    fix_std_m: float = 0.5
    fix_period_s: float = 1.0
    #: weights of the reward terms (see docs/laser_tracking.md).
    light_weight: float = 1.0
    area_weight: float = 0.0
    center_weight: float = 0.2
    effort_weight: float = 0.02

    def __post_init__(self) -> None:
        check_choice("scenario", self.scenario, SCENARIOS)
        check_choice("profile", self.profile, PROFILES)
        check_choice("rov_velocity", self.rov_velocity, ("measured", "unknown"))
        for name in ("axes", "sub_steps", "adc_bits"):
            value = getattr(self, name)
            if not isinstance(value, int | np.integer) or isinstance(value, bool):
                raise InvalidParameterError(name, value, "a whole number")
        if self.start_altitude_m is None:
            object.__setattr__(self, "start_altitude_m", self.altitude_m)
        for name, low, high, open_low in _BOUNDS:
            if self.full_scale_w_m2 is not None or name != "full_scale_w_m2":
                check_range(name, getattr(self, name), low, high, open_low=open_low)
        if self.action_period_s / self.sub_steps > 0.02 * (1 + 1e-9):
            raise InvalidParameterError(
                "sub_steps", self.sub_steps, f"at least {np.ceil(self.action_period_s / 0.02):.0f}",
                "The attitude controller needs 50 Hz or more.",
            )  # fmt: skip
        self.beam()

    def beam(self) -> Beam:
        """The light, for the kernels of ``sensing.laser``."""
        return make_beam(
            power_w=self.power_w, divergence_rad=float(np.radians(self.divergence_deg)),
            field_of_view_rad=float(np.radians(self.field_of_view_deg)), order=self.order, profile=self.profile,
            ambient_w_m2=self.ambient_w_m2, water_depth_m=self.depth_m, attenuation_per_m=self.attenuation_per_m,
            refractive_index=self.refractive_index,
        )  # fmt: skip


_BOUNDS = (
    ("axes", 1, 2, False), ("horizon_s", 1e-3, 1e6, False), ("action_period_s", 1e-3, 10, False),
    ("sub_steps", 1, 10_000, False), ("max_speed_m_s", 0, 2, True), ("altitude_m", 0.5, 1000, False),
    ("start_altitude_m", 0, 1000, False), ("depth_m", 0.1, 1000, False), ("start_distance_m", 0, 1e4, False),
    ("guess_std_m", 0, 1e4, False), ("rov_speed_m_s", 0, 1, False), ("turn_period_s", 1, 1e6, False),
    ("wander_time_s", 0.1, 1e6, False), ("power_w", 0, 1e6, True), ("divergence_deg", 0, 90, True),
    ("field_of_view_deg", 0, 180, True), ("attenuation_per_m", 0, 100, False), ("refractive_index", 1, 1.41, False),
    ("noise_level", 0, 100, False), ("noise_std_w_m2", 0, 1e6, False), ("adc_bits", 0, 32, False),
    ("full_scale_w_m2", 0, 1e9, True), ("ambient_w_m2", 0, 1e6, False), ("ambient_variation", 0, 1, False),
    ("ambient_time_s", 0.1, 1e6, False), ("detection_share", 0, 1, True), ("position_std_m", 0, 100, False),
    ("velocity_std_m_s", 0, 100, False), ("rov_velocity_std_m_s", 0, 100, False), ("fix_std_m", 0, 1e4, False),
    ("fix_period_s", 1e-3, 1e6, False), ("light_weight", 0, 1e6, False), ("area_weight", 0, 1e6, False),
    ("center_weight", 0, 1e6, False),
    ("effort_weight", 0, 1e6, False),
)  # fmt: skip

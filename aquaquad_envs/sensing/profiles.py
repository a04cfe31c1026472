"""Profiles of sound speed over depth, and the surface duct that a mixed layer makes of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.sensing.acoustics import sound_speed


class SoundSpeedProfile:
    """Speed of sound against depth, linear between nodes: ``speeds_m_s[i]`` at ``depths_m[i]``.

    Depth in m, positive down; the first node is the surface (0), the last the bottom; at least
    two nodes, strictly deeper one after the other, and speeds in 200–5000 m/s. Raises
    ``InvalidParameterError`` otherwise.
    """

    def __init__(self, depths_m: npt.ArrayLike, speeds_m_s: npt.ArrayLike) -> None:
        depths = np.array(depths_m, dtype=np.float64)
        speeds = np.array(speeds_m_s, dtype=np.float64)
        if depths.ndim != 1 or depths.size < 2 or depths[0] != 0 or not (np.diff(depths) > 0).all():
            raise InvalidParameterError(
                "depths_m", depths_m, "two or more rising depths, m, of which the first is 0 (the surface)"
            )
        if not np.isfinite(depths).all() or speeds.shape != depths.shape:
            raise InvalidParameterError(
                "speeds_m_s", speeds_m_s, f"one speed for each of {depths.size} depths"
            )
        if not ((speeds >= 200) & (speeds <= 5000)).all():
            raise InvalidParameterError("speeds_m_s", speeds_m_s, "speeds in [200, 5000] m/s")
        depths.flags.writeable = speeds.flags.writeable = False
        self.depths_m = depths
        self.speeds_m_s = speeds
        self.gradients = np.diff(speeds) / np.diff(depths)  # 1/s, one for each layer

    @classmethod
    def from_water(
        cls, depths_m: npt.ArrayLike, temperatures_c: npt.ArrayLike, salinities_ppt: npt.ArrayLike
    ) -> SoundSpeedProfile:
        """Profile of water of given temperature and salinity (one number, or one a depth)."""
        depths = np.asarray(depths_m, dtype=np.float64)
        speeds = sound_speed(temperatures_c, salinities_ppt, depths)
        return cls(depths, np.broadcast_to(speeds, depths.shape))

    @classmethod
    def mixed_layer(
        cls,
        *,
        mixed_depth_m: float = 40.0,
        bottom_depth_m: float = 400.0,
        surface_temperature_c: float = 20.0,
        deep_temperature_c: float = 10.0,
        thermocline_m: float = 60.0,
        salinity_ppt: float = 35.0,
    ) -> SoundSpeedProfile:
        """Water of one temperature to ``mixed_depth_m``, then a thermocline, then colder water to the bottom.

        In the mixed layer the speed rises by 0.016 1/s, from pressure alone, and falls in the
        thermocline: a surface duct. The depth of 40 m is the one on the map of the South China Sea
        in Dillard 2014, fig. 7; the temperatures are made up. Raises ``InvalidParameterError`` unless the
        layers fit above the bottom.
        """
        check_range("mixed_depth_m", mixed_depth_m, 0, 12_000, open_low=True)
        check_range("thermocline_m", thermocline_m, 0, 12_000, open_low=True)
        above = mixed_depth_m + thermocline_m
        check_range("bottom_depth_m", bottom_depth_m, above, 12_000, open_low=True)
        warm, cold = surface_temperature_c, deep_temperature_c
        return cls.from_water(
            [0.0, mixed_depth_m, above, bottom_depth_m], [warm, warm, cold, cold], salinity_ppt
        )

    def speed(self, depth_m: npt.ArrayLike) -> Any:
        """Speed of sound, m/s, at each depth, m; held beyond the surface and the bottom."""
        speed = np.interp(np.asarray(depth_m, dtype=np.float64), self.depths_m, self.speeds_m_s)
        return float(speed) if np.ndim(depth_m) == 0 else speed

    @property
    def bottom_m(self) -> float:
        """Depth of the bottom, m."""
        return float(self.depths_m[-1])

    def duct_depth(self) -> float:
        """Depth, m, of the first maximum of speed: the base of the surface duct; 0 where there is none.

        A speed that rises all the way makes the whole water a duct, down to the bottom.
        """
        falling = np.flatnonzero(self.gradients <= 0)
        return float(self.depths_m[falling[0]] if falling.size else self.bottom_m)

    def limiting_angle(self, source_depth_m: float) -> float:
        """Launch angle, rad from the vertical, of the ray that just turns at the base of the surface duct.

        θ_lim = asin(c_source / c_base): Snell's law with θ = 90° at the base. Rays launched between θ_lim
        and π - θ_lim are trapped: they never leave the duct. π/2 where there is no duct or the
        source lies at or below its base: no ray is trapped. Raises ``InvalidParameterError`` for a source
        outside the water.
        """
        check_range("source_depth_m", source_depth_m, 0, self.bottom_m)
        base = self.duct_depth()
        if source_depth_m >= base:
            return math.pi / 2
        return math.asin(self.speed(source_depth_m) / self.speed(base))

    def transition_range(self, source_depth_m: float) -> float:
        """Range, m, at which sound has filled the surface duct: spherical spreading turns cylindrical.

        r_t = H / (2 sin ε), H the depth of the duct and ε = π/2 - θ_lim the steepest angle of
        trapped rays to the horizontal (Urick 1983, ch. 6). ``inf`` where nothing is trapped. For the sonar
        equation's ``transition_range_m``.
        """
        angle = self.limiting_angle(source_depth_m)
        return self.duct_depth() / (2.0 * math.cos(angle)) if angle < math.pi / 2 else math.inf

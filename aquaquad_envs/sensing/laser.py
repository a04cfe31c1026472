"""Light of a laser that points upward from under water, on a level plane above it, and what a photodiode reads.

With r the horizontal distance from the axis, z the height above the source, and

    w(z) = z sin(Θ/2)        half-width of the beam,

the two profiles of Toombs (2022), eqs. 4.5, 4.9, 4.12 and 4.14, are one equation,

    I(r, z) = I₀ exp(-½ (r/σ)ⁿ),     I₀ = n P / (2π 4^(1/n) σ² Γ(2/n)),

with σ = w/2 and n = 2 for a Gaussian beam (w is where I falls to 1/e² of I₀) and σ = 0.1^(-1/n) w for a
flat-top of even order n (w is where I falls to 0.95 I₀). The plane receives P for every n. Angle Θ is the *effective*
divergence: the lesser of the laser's own and of the receiver's field of view, both full angles; the
receiver looks straight down, the laser straight up. The disc of radius z sin(Θ_laser/2) is illuminated (LIA),
the one of radius w is detectable (LDA).

What the paper neglects and this module offers, off by default: of the height z the first ``water_depth`` m are
water; there the power decays by Beer–Lambert, P exp(-c · water_depth), and at the level surface rays bend by
Snell's law, sin(angle in air) = m · sin(angle in water). The laser's angle counts in water, the view's in air:

    LIA radius = (d + m h) sin(Θ_laser/2),   radius seen = (d/m + h) sin(Θ_view/2),   w = the lesser,

d and h the heights in water and in air. The paper's sine in place of a tangent is kept: 0.4 % at 5°. Not
modelled: waves, scattering, the 2 % that a level surface reflects. As published, all of P is taken to fall
inside the effective divergence: where the field of view is the narrower, the true beam's light on the axis is
fainter by (sin(Θ_view/2) / sin(Θ_laser/2))².
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range

PROFILES = ("gaussian", "flat-top")
#: Order of a flat-top that was not given one: the published comparison with a real diffuser.
FLAT_TOP_ORDER = 10
#: Share of the peak that is left at the half-width of a flat-top, as -2 ln: exp(-0.05) = 0.95.
_FLAT_TOP_EXPONENT = 0.1


class Beam(NamedTuple):
    """What kernels need of a laser and its receiver; made by :func:`make_beam`. Angles enter by their half's sine."""

    power: float  # W, at the source
    laser_sine: float
    view_sine: float
    half_order: int  # n/2
    sigma_ratio: float  # σ / w
    peak_ratio: float  # I₀ σ² / P
    ambient: float  # W/m², light that is not the laser's
    water_depth: float  # m, of the source below the surface
    attenuation: float  # 1/m
    refractive_index: float


def make_beam(
    *,
    power_w: float = 0.045,
    divergence_rad: float = math.radians(20.0),
    field_of_view_rad: float = math.radians(10.0),
    order: int | None = None,
    profile: str = "flat-top",
    ambient_w_m2: float = 0.0,
    water_depth_m: float = 0.0,
    attenuation_per_m: float = 0.0,
    refractive_index: float = 1.0,
) -> Beam:
    """A beam for the kernels of this module; defaults are the published simulation's (Toombs 2022, ch. 4 and 6).

    ``order`` is even, 2 or more; 10 for a flat-top without one, always 2 for a Gaussian. Water counts
    only where ``water_depth_m`` is above 0; a refractive index of 1.34 is sea water's. Raises
    ``InvalidParameterError`` outside the bounds.
    """
    check_choice("profile", profile, PROFILES)
    if order is None:
        order = 2 if profile == "gaussian" else FLAT_TOP_ORDER
    check_range("order", order, 2, 100)
    if order != int(order) or int(order) % 2:
        raise InvalidParameterError("order", order, "an even whole number")
    if profile == "gaussian" and order != 2:
        raise InvalidParameterError("order", order, "2 for a Gaussian", "Choose profile='flat-top'.")
    check_range("power_w", power_w, 0, 1e6, open_low=True)
    check_range("divergence_rad", divergence_rad, 0, math.pi / 2, open_low=True)
    check_range("field_of_view_rad", field_of_view_rad, 0, math.pi, open_low=True)
    check_range("ambient_w_m2", ambient_w_m2, 0, 1e6)
    check_range("water_depth_m", water_depth_m, 0, 1e4)
    check_range("attenuation_per_m", attenuation_per_m, 0, 100)
    # Up to √2: rays of the widest divergence, 45° from the axis, still leave the water.
    check_range("refractive_index", refractive_index, 1, 1.41)
    n = float(order)
    return Beam(
        power=float(power_w),
        laser_sine=math.sin(0.5 * divergence_rad),
        view_sine=math.sin(0.5 * field_of_view_rad),
        half_order=int(order) // 2,
        sigma_ratio=0.5 if profile == "gaussian" else _FLAT_TOP_EXPONENT ** (-1.0 / n),
        peak_ratio=n / (2.0 * math.pi * 4.0 ** (1.0 / n) * math.gamma(2.0 / n)),
        ambient=float(ambient_w_m2),
        water_depth=float(water_depth_m),
        attenuation=float(attenuation_per_m),
        refractive_index=float(refractive_index),
    )


@kernel
def illuminated_radius(beam, z):
    """Radius, m, of the laser-illuminated area at height ``z`` m above the source."""
    water = min(z, beam.water_depth)
    return (water + beam.refractive_index * (z - water)) * beam.laser_sine


@kernel
def detectable_radius(beam, z):
    """Radius w, m, of the laser-detectable area at height ``z`` m: illuminated and inside the field of view."""
    water = min(z, beam.water_depth)
    seen = (water / beam.refractive_index + (z - water)) * beam.view_sine
    return min(seen, illuminated_radius(beam, z))


@kernel
def effective_divergence(beam, z):
    """Full angle Θ, rad, with w = z sin(Θ/2): without water the lesser of divergence and field of view."""
    return 2.0 * np.arcsin(detectable_radius(beam, z) / z)


@kernel
def beam_sigma(beam, z):
    """σ, m, at height ``z`` m above the source."""
    return beam.sigma_ratio * detectable_radius(beam, z)


@kernel
def peak_intensity(beam, z):
    """I₀, W/m²: intensity on the axis at height ``z`` > 0 m above the source."""
    sigma = beam_sigma(beam, z)
    left = np.exp(-beam.attenuation * min(z, beam.water_depth))
    return beam.peak_ratio * beam.power * left / (sigma * sigma)


@kernel
def profile_intensity(peak, sigma, half_order, r):
    """I, W/m², at ``r`` m from the axis of a profile with I₀ = ``peak`` and n = 2 ``half_order``."""
    square = (r / sigma) * (r / sigma)
    exponent = 1.0
    for _ in range(half_order):
        exponent *= square
    return peak * np.exp(-0.5 * exponent)


@kernel
def profile_slope(peak, sigma, half_order, r):
    """I and ∂I/∂r = -(n/2) (r/σ)ⁿ⁻¹ I/σ of the same profile, W/m² and W/m³; even, respectively odd in r."""
    ratio = r / sigma
    square = ratio * ratio
    lower = 1.0
    for _ in range(half_order - 1):
        lower *= square
    exponent = -0.5 * lower * square
    if exponent < -700.0:  # exp() underflows there, and zero times infinity is not a slope
        return 0.0, 0.0
    intensity = peak * np.exp(exponent)
    return intensity, -half_order * lower * ratio * intensity / sigma


@kernel
def intensity(beam, r, z):
    """Intensity I, W/m², at horizontal distance ``r`` m from the axis, ``z`` > 0 m above the source."""
    return profile_intensity(peak_intensity(beam, z), beam_sigma(beam, z), beam.half_order, r)


@kernel
def intensity_gradient(beam, r, z):
    """∂I/∂r, W/m³: 0 on the axis, negative beside it."""
    return profile_slope(peak_intensity(beam, z), beam_sigma(beam, z), beam.half_order, r)[1]


@kernel
def radius_of_intensity(beam, level, z):
    """The distance r, m, at which I(r, z) falls to ``level`` W/m²: 0 where the axis is no brighter, ∞ at level 0."""
    ratio = level / peak_intensity(beam, z)
    if ratio >= 1.0:
        return 0.0
    return beam_sigma(beam, z) * (-2.0 * np.log(ratio)) ** (0.5 / beam.half_order)


@kernel
def reading(intensity, ambient, noise_std, levels, full_scale, normal_draw):
    """Reading, W/m², of a photodiode and its converter: light plus ambient plus noise, clipped and rounded.

    ``normal_draw`` is a standard normal number, scaled by ``noise_std`` W/m² (may be 0). The
    converter has ``levels`` evenly spaced values from 0 to ``full_scale`` W/m², both included (2ᵇ of b bits)
    and saturates at its ends; ``levels`` 0 or 1 rounds nothing, an infinite ``full_scale`` neither rounds nor clips.
    """
    value = intensity + ambient + noise_std * normal_draw
    if full_scale == np.inf:
        return value
    value = min(max(value, 0.0), full_scale)
    if levels < 2:
        return value
    step = full_scale / (levels - 1)
    return step * np.floor(value / step + 0.5)

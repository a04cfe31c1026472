"""Currents given by a formula or a seeded random draw, each as a :class:`CurrentField`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid

Formula = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


def from_formula(
    formula: Formula,
    *,
    half_width_m: float,
    spacing_m: float,
    duration_s: float = 0.0,
    time_step_s: float = 1800.0,
    interpolation: str = "bilinear",
) -> CurrentField:
    """Sample ``formula(x, y, t) -> (u, v)`` (m, s, m/s) on a grid.

    ``duration_s = 0`` makes a steady field of one frame; otherwise frames every
    ``time_step_s`` (adjusted to divide the duration) span [0, duration].
    """
    check_range("half_width_m", half_width_m, 0, 1e7, open_low=True)
    check_range("spacing_m", spacing_m, 0, 2 * half_width_m, open_low=True)
    check_range("duration_s", duration_s, 0, 1e9)
    check_range("time_step_s", time_step_s, 0, 1e9, open_low=True)
    grid, side = Grid.square(half_width_m, spacing_m)
    x, y = grid.nodes(side, side)
    frames = 1 + int(np.ceil(duration_s / time_step_s))
    step = duration_s / (frames - 1) if frames > 1 else time_step_s
    velocity = np.stack([np.stack(np.broadcast_arrays(*formula(x, y, i * step)), -1) for i in range(frames)])
    return CurrentField(velocity=velocity, grid=grid, time_step_s=step, interpolation=interpolation)


def published_vortex(*, interpolation: str = "bilinear", spacing_m: float = 500.0) -> CurrentField:
    """The published vortex on its 21 × 21 grid (Dillard 2014, App. C).

    u = -a - 2 b a² + b, v = -a - b, m/s, with (a, b) = (x, y) / 10 km in [-0.5, 0.5].
    ``interpolation="cell"`` holds it constant per cell, as the source does.
    """

    def formula(x: np.ndarray, y: np.ndarray, _: float) -> tuple[np.ndarray, np.ndarray]:
        a, b = x / 10_000.0, y / 10_000.0
        return -a - 2 * b * a**2 + b, -a - b

    return from_formula(formula, half_width_m=5000.0, spacing_m=spacing_m, interpolation=interpolation)


def uniform(u_m_s: float, v_m_s: float, *, half_width_m: float = 5000.0) -> CurrentField:
    """The same current (u east, v north), m/s, everywhere and always."""
    return from_formula(
        lambda x, y, t: (np.full_like(x, u_m_s), np.full_like(y, v_m_s)),
        half_width_m=half_width_m,
        spacing_m=half_width_m,
    )


def double_gyre(
    *,
    half_width_m: float = 5000.0,
    speed_m_s: float = 0.5,
    wobble: float = 0.25,
    period_s: float = 6 * 3600.0,
    duration_s: float = 12 * 3600.0,
    spacing_m: float = 250.0,
) -> CurrentField:
    """The time-dependent double gyre of Shadden, Lekien and Marsden (Physica D 212, 2005).

    ψ = A sin(π f(X, t)) sin(π Y), f = ε sin(ωt) X² + (1 - 2 ε sin ωt) X, X in [0, 2], Y in [0, 1],
    u = -∂ψ/∂Y, v = ∂ψ/∂X, scaled so that the greatest steady speed is ``speed_m_s``. Their
    rectangle of 2 × 1 is stretched onto the square box, both axes by the same streamfunction,
    so the field stays free of divergence. ``wobble`` is ε; 0 makes it steady.
    """
    check_range("speed_m_s", speed_m_s, 0, 10)
    check_range("wobble", wobble, 0, 0.5)
    check_range("period_s", period_s, 0, 1e9, open_low=True)

    def formula(x: np.ndarray, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        across, along = x / half_width_m + 1, (y / half_width_m + 1) / 2
        epsilon = wobble * np.sin(2 * np.pi * t / period_s)
        f = epsilon * across**2 + (1 - 2 * epsilon) * across
        slope = 2 * epsilon * across + 1 - 2 * epsilon
        # d/dx = d/dX / L and d/dy = d/dY / 2L; with A = speed 2L/π the greatest |v| is 2 speed, |u| speed.
        u = -np.sin(np.pi * f) * np.cos(np.pi * along)
        v = 2 * np.cos(np.pi * f) * np.sin(np.pi * along) * slope
        return speed_m_s * u / 2, speed_m_s * v / 2

    return from_formula(
        formula,
        half_width_m=half_width_m,
        spacing_m=spacing_m,
        duration_s=duration_s if wobble > 0 else 0.0,
    )


def rotating_tide(
    *,
    half_width_m: float = 5000.0,
    major_m_s: float = 0.5,
    minor_m_s: float = 0.2,
    orientation_rad: float = 0.0,
    period_s: float = 44714.16,
    duration_s: float = 24 * 3600.0,
) -> CurrentField:
    """A uniform tidal ellipse: the velocity turns once (anticlockwise) per ``period_s`` (M2 by default).

    (u, v) = R(orientation) (major cos ωt, minor sin ωt), m/s; a negative ``minor_m_s`` turns clockwise.
    """
    check_range("major_m_s", major_m_s, 0, 10)
    check_range("minor_m_s", minor_m_s, -major_m_s, major_m_s)
    check_range("period_s", period_s, 0, 1e9, open_low=True)

    def formula(x: np.ndarray, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        phase = 2 * np.pi * t / period_s
        along, across = major_m_s * np.cos(phase), minor_m_s * np.sin(phase)
        c, s = np.cos(orientation_rad), np.sin(orientation_rad)
        return np.full_like(x, c * along - s * across), np.full_like(y, s * along + c * across)

    return from_formula(
        formula,
        half_width_m=half_width_m,
        spacing_m=half_width_m,
        duration_s=duration_s,
        time_step_s=period_s / 48,
    )


def random_gyres(
    rng: np.random.Generator,
    *,
    half_width_m: float = 5000.0,
    speed_m_s: float = 0.4,
    mean_flow_m_s: float = 0.15,
    eddy_scale_m: float = 2500.0,
    modes: int = 12,
    turnover_s: float = 0.0,
    duration_s: float = 0.0,
    time_step_s: float = 7200.0,
    spacing_m: float = 500.0,
) -> CurrentField:
    """A seeded random field free of divergence: a sum of random Fourier modes of a streamfunction.

    ψ(x, y, t) = Σ_m c_m cos(k_m·x + φ_m + ω_m t), (u, v) = (-∂ψ/∂y, ∂ψ/∂x), plus a uniform mean flow.
    Wave numbers scatter about 2π / (2 · eddy_scale), directions are uniform, and the sum is scaled
    to a root-mean-square eddy speed of ``speed_m_s``. ``turnover_s > 0`` lets modes travel with
    angular speeds of order 2π / turnover (a time-varying field over ``duration_s``). The field is
    analytically free of divergence; between nodes, bilinear interpolation leaves a residue of the
    order of (k · spacing)².
    """
    check_range("speed_m_s", speed_m_s, 0, 10)
    check_range("mean_flow_m_s", mean_flow_m_s, 0, 10)
    check_range("eddy_scale_m", eddy_scale_m, 0, 1e7, open_low=True)
    check_range("modes", modes, 1, 1000)
    check_range("turnover_s", turnover_s, 0, 1e9)
    wave = np.pi / eddy_scale_m * rng.uniform(0.5, 1.5, modes)
    heading = rng.uniform(0, 2 * np.pi, modes)
    phase = rng.uniform(0, 2 * np.pi, modes)
    weight = rng.normal(size=modes)
    omega = 2 * np.pi / turnover_s * rng.uniform(-1, 1, modes) if turnover_s > 0 else np.zeros(modes)
    direction = rng.uniform(0, 2 * np.pi)
    mean = mean_flow_m_s * rng.uniform(0, 1)
    kx, ky = wave * np.cos(heading), wave * np.sin(heading)
    # Each mode has speed amplitude |c| k; the mean square of a sum of modes is half the sum of squares.
    amplitude = weight / wave * speed_m_s / np.sqrt(0.5 * np.sum(weight**2))

    def formula(x: np.ndarray, y: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        slope = -amplitude * np.sin(kx * x[..., None] + ky * y[..., None] + phase + omega * t)
        u = mean * np.cos(direction) - np.sum(slope * ky, -1)
        v = mean * np.sin(direction) + np.sum(slope * kx, -1)
        return u, v

    return from_formula(
        formula,
        half_width_m=half_width_m,
        spacing_m=spacing_m,
        duration_s=duration_s if turnover_s > 0 else 0.0,
        time_step_s=time_step_s,
    )

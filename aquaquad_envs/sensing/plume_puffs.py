"""A plume as puffs: released at the source, carried by the current, scattered by turbulence, growing.

A puff of amount q and standard deviation σ about (x_p, y_p, z_p) holds the concentration

    C = q / ((2π)^{3/2} σ³) exp(-r² / 2σ²),    σ² = σ₀² + g · age,

and the plume is the sum of its puffs, with the mirror images of each at the surface and at the bottom, which let
nothing through. Three scales of turbulence move and widen them, after Farrell et al., "Filament-based atmospheric
dispersion model to achieve short time-scale structure of odor plumes", Environmental Fluid Mechanics 2, 2002:

- the current, gridded and changing with time, carries each puff;
- a *meander* velocity, one for the whole plume, wanders as an Ornstein-Uhlenbeck process (standard deviation,
  memory): it is what bends the plume (Farrell colours the noise at the edges of his wind field);
- *dispersion* D scatters puffs apart: each coordinate wanders with variance 2 D dt in a step dt. Increments are
  uniform, not normal: their sums agree in distribution at the order of the step, at a third of the cost;
- growth g widens a puff. Farrell's R is √2 σ, his γ is 2 g.

Without meander and dispersion, and with puffs released densely, this is the advected Gaussian plume of diffusivity
K = g / 2: in a steady uniform current U along x, C = Q / (4π K r) exp(-U (r - x) / 2K) without boundaries.

Puffs live in a ring inside the world's record: the k-th lies in slot k mod size, the oldest make room for new ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.grids import locate
from aquaquad_envs.physics.randomness import normal, random_bits
from aquaquad_envs.physics.vehicle import drift_step

#: Puffs that a record has room for.
MAX_PUFFS = 256
#: Squared distance, in units of 2σ², beyond which a puff counts for nothing: 5.3 σ, 1e-6 of its peak.
_FAR = 14.0
_THIRD = 1.0 / 2097152.0  # 2⁻²¹


class PuffTerms(NamedTuple):
    """What kernels need to move and to sum puffs."""

    size: int  # slots in use, at most MAX_PUFFS
    period: float  # s between releases
    amount: float  # q of each
    first_spread2: float  # σ₀², m²
    growth: float  # g, m²/s
    scatter: float  # horizontal D, m²/s
    vertical_scatter: float  # m²/s
    meander_std: float  # m/s
    meander_time: float  # s
    depth: float  # m of water


@kernel
def folded(z, depth):
    """Depth ``z`` reflected into [0, ``depth``]."""
    z = abs(z)
    z = z if z <= depth else 2.0 * depth - z
    return min(max(z, 0.0), depth)


@kernel
def advance_meander(u, v, dt, terms, state):
    """Meander velocity (u, v), m/s, after ``dt`` s: exact for any step. Nothing is drawn where there is none."""
    if terms.meander_std <= 0.0:
        return 0.0, 0.0
    keep = np.exp(-dt / terms.meander_time)
    kick = terms.meander_std * np.sqrt(1.0 - keep * keep)
    return keep * u + kick * normal(state), keep * v + kick * normal(state)


@kernel
def released_by(t, begin, period):
    """Puffs released in [``begin``, ``t``], the first at ``begin``."""
    return np.int64(np.floor((t - begin) / period + 1e-9)) + 1


@lane_kernel
def _blend(earlier, later, share, out):
    for k in range(out.size):
        out[k] = earlier[k] + share * (later[k] - earlier[k])


@kernel
def present_frame(velocity, k, axes, t, frame):
    """Field ``k`` of currents at time ``t`` s into ``frame`` (1, 1, rows, columns, 2).

    All puffs move at one time: :func:`current_at` need not look at two frames for each of them.
    """
    out = frame.reshape(-1)
    if velocity.shape[1] == 1:
        out[:] = velocity[k, 0].reshape(-1)
        return
    earlier, share = locate(axes.time0, axes.time_step, velocity.shape[1], t)
    _blend(velocity[k, earlier].reshape(-1), velocity[k, earlier + np.uint64(1)].reshape(-1), share, out)


@kernel
def carry(x, y, now, dt, velocity, k, axes, u, v, euler):
    """A point carried for ``dt`` s from (x, y) at time ``now`` by current field ``k`` and the meander (u, v)."""
    x, y = drift_step(velocity, k, axes, now, x, y, dt, euler)
    return x + dt * u, y + dt * v


@kernel
def scatter(x, y, z, dt, terms, state):
    """A point after ``dt`` s of dispersion: uniform increments of variance 2 D dt, reflected at surface and bottom."""
    bits = random_bits(state)
    wide = np.sqrt(6.0 * terms.scatter * dt)
    deep = np.sqrt(6.0 * terms.vertical_scatter * dt)
    mask = np.uint64(2097151)
    x += wide * (2.0 * _THIRD * np.float64(bits & mask) - 1.0)
    y += wide * (2.0 * _THIRD * np.float64((bits >> np.uint64(21)) & mask) - 1.0)
    z += deep * (2.0 * _THIRD * np.float64((bits >> np.uint64(42)) & mask) - 1.0)
    return x, y, folded(z, terms.depth)


@lane_kernel
def puff_widths(birth, now, terms, inverse, peak, count):
    """1 / 2σ² and peak concentration of the first ``count`` puffs at time ``now``."""
    scale = terms.amount / (2.0 * np.pi) ** 1.5
    for k in range(count):
        spread2 = terms.first_spread2 + terms.growth * (now - birth[k])
        inverse[k] = 0.5 / spread2
        peak[k] = scale / (spread2 * np.sqrt(spread2))


@lane_kernel
def _exponents(px, py, x, y, inverse, out, count):
    for k in range(count):
        dx = x - px[k]
        dy = y - py[k]
        out[k] = (dx * dx + dy * dy) * inverse[k]


@kernel
def _fading(exponent):
    """exp(-``exponent``), 0 from ``_FAR`` on, to 1e-7 of itself: a power series of a sixteenth, which makes SIMD."""
    t = (-1.0 / 16.0) * (exponent if exponent < _FAR else _FAR)
    series = 1.0 + t * (1.0 / 10.0)
    series = 1.0 + t * (1.0 / 9.0) * series
    series = 1.0 + t * (1.0 / 8.0) * series
    series = 1.0 + t * (1.0 / 7.0) * series
    series = 1.0 + t * (1.0 / 6.0) * series
    series = 1.0 + t * (1.0 / 5.0) * series
    series = 1.0 + t * (1.0 / 4.0) * series
    series = 1.0 + t * (1.0 / 3.0) * series
    series = 1.0 + t * (1.0 / 2.0) * series
    series = 1.0 + t * series
    series = series * series
    series = series * series
    series = series * series
    series = series * series
    return series if exponent < _FAR else 0.0


@kernel
def _gather(work, pz, inverse, peak, near, count):
    """Columns of the puffs that are not far, side by side in ``near`` (4, n); returns how many."""
    found = 0
    for k in range(count):
        near[0, found] = work[k]
        near[1, found] = pz[k]
        near[2, found] = inverse[k]
        near[3, found] = peak[k]
        found += 1 if work[k] < _FAR else 0
    return found


@lane_kernel
def _layers(across, pz, inverse, peak, z, depth, out, count):
    """Concentration that each puff and its two images make."""
    for k in range(count):
        direct = z - pz[k]
        above = z + pz[k]
        below = 2.0 * depth - z - pz[k]
        layers = _fading(across[k] + direct * direct * inverse[k])
        layers += _fading(across[k] + above * above * inverse[k])
        layers += _fading(across[k] + below * below * inverse[k])
        out[k] = peak[k] * layers


@kernel
def concentration_at(px, py, pz, inverse, peak, count, work, near, depth, x, y, z):
    """Concentration at (x, y, z) of ``count`` puffs at (px, py, pz); ``inverse`` and ``peak`` of :func:`puff_widths`.

    ``work`` (n,) and ``near`` (4, n + 1) are scratch memory for at least ``count`` puffs.
    """
    _exponents(px, py, x, y, inverse, work, count)
    found = _gather(work, pz, inverse, peak, near, count)
    _layers(near[0], near[1], near[2], near[3], z, depth, work, found)
    total = 0.0
    for k in range(found):
        total += work[k]
    return total


@loop_kernel
def _concentrations(puffs, now, terms, places, out):
    count = puffs.shape[1]
    inverse, peak, work = np.empty(count), np.empty(count), np.empty(count)
    near = np.empty((4, count + 1))
    puff_widths(puffs[3], now, terms, inverse, peak, count)
    for i in range(out.size):
        out[i] = concentration_at(
            puffs[0], puffs[1], puffs[2], inverse, peak, count, work, near, terms.depth, places[0, i], places[1, i],
            places[2, i],
        )  # fmt: skip


def plume_concentration(
    terms: PuffTerms, puffs: np.ndarray, places_m: np.ndarray, time_s: float
) -> np.ndarray:
    """Concentration at ``places_m`` (..., 3), m, and time ``time_s`` of ``puffs``: shape (...).

    ``puffs`` (n, 4): x, y, z (m) and time of birth (s, none after ``time_s``). Raises ``InvalidParameterError`` for
    wrong shapes, values that are not finite, and puffs that are not born yet.
    """
    found, places = np.asarray(puffs, dtype=np.float64), np.asarray(places_m, dtype=np.float64)
    if found.ndim != 2 or found.shape[1] != 4 or not np.isfinite(found).all():
        raise InvalidParameterError("puffs", found.shape, "finite rows of x, y, z and birth, shape (n, 4)")
    if found.size and found[:, 3].max() > time_s:
        raise InvalidParameterError(
            "puffs", f"one born at {found[:, 3].max():g} s", f"none after {time_s:g} s"
        )
    if places.ndim < 1 or places.shape[-1] != 3 or not np.isfinite(places).all():
        raise InvalidParameterError("places_m", places.shape, "finite places, shape (..., 3)")
    out = np.empty(places[..., 0].size)
    flat = np.ascontiguousarray(places.reshape(-1, 3).T)
    _concentrations(np.ascontiguousarray(found.T), float(time_s), terms, flat, out)
    return out.reshape(places.shape[:-1])

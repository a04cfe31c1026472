"""What a scalar source makes of a place, and what a sensor there reads.

(dx, dy, dz) is the place relative to the source, m; R² = dx² + dy² + dz². G is the reading, in the unit of k.

============== ==== ==============================================================================
kind           code field
============== ==== ==============================================================================
light          0    G = k / R²
oriented-light 1    G = k |sin γ| / R², γ = atan2(dz, √(dx² + dy²)): a vehicle that keeps its pitch at
                    zero sees the part of the light that falls from above or below
rational       2    G = k / (R² + K₂), the pseudo-plume of the field tests
plume          3    a sum of puffs, see ``sensing/plume_puffs.py``
============== ==== ==============================================================================

Byrne, Eskridge, Hurtado and Savage, SAND2003-2643, sections 1, 3 and 5 (SPEC §9). The sources there are points, whose
light grows beyond all bounds; ours have a radius of :data:`LEAST_M`, within which R² is held.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.physics.randomness import uniform

LIGHT, ORIENTED_LIGHT, RATIONAL, PLUME = range(4)
#: Code of each kind by the name that users write.
KINDS = {"light": LIGHT, "oriented-light": ORIENTED_LIGHT, "rational": RATIONAL, "plume": PLUME}
#: m; radius of a lamp.
LEAST_M = 0.01


class SourceTerms(NamedTuple):
    """What kernels need of a steady source: kind, k (unit of the reading times m²), K₂ (m²)."""

    kind: int
    strength: float
    offset: float


@kernel
def source_reading(source, dx, dy, dz):
    """G of a steady source (all kinds but ``plume``) at (dx, dy, dz) m from it."""
    square = dx * dx + dy * dy + dz * dz
    if source.kind == RATIONAL:
        return source.strength / (square + source.offset)
    held = max(square, LEAST_M * LEAST_M)
    # |sin γ| = |dz| / R: no angle is needed. On the source itself light comes from everywhere.
    facing = abs(dz) / np.sqrt(square) if source.kind == ORIENTED_LIGHT and square > 0.0 else 1.0
    return source.strength * facing / held


@kernel
def sensor_reading(value, noise, floor, state):
    """What a sensor makes of ``value``: an error uniform within ± ``noise`` (a share), and 0 below ``floor``.

    The published noise of p per cent lies anywhere within ± p per cent of the true value (SAND2003-2643, section 6).
    Without noise nothing is drawn.
    """
    if noise > 0.0:
        value *= 1.0 + noise * (2.0 * uniform(state) - 1.0)
    return value if value >= floor else 0.0


@loop_kernel
def _read_all(source, dx, dy, dz, out):
    for i in range(out.size):
        out[i] = source_reading(source, dx[i], dy[i], dz[i])


def steady_field(
    kind: str, places_m: np.ndarray, *, strength: float = 1.0, offset_m2: float = 1.0
) -> np.ndarray:
    """G of a steady source at ``places_m`` (..., 3), m relative to it: shape (...).

    ``kind`` is "light", "oriented-light" or "rational"; ``strength`` k > 0; ``offset_m2`` K₂ > 0 of the last. Raises
    ``InvalidParameterError`` for anything else, and for places that are not finite.
    """
    check_choice("kind", kind, [name for name in KINDS if name != "plume"])
    check_range("strength", strength, 0.0, 1e12, open_low=True)
    check_range("offset_m2", offset_m2, 0.0, 1e12, open_low=True)
    places = np.asarray(places_m, dtype=np.float64)
    if places.ndim < 1 or places.shape[-1] != 3 or not np.isfinite(places).all():
        raise InvalidParameterError("places_m", places.shape, "finite places, shape (..., 3)")
    flat = np.ascontiguousarray(places.reshape(-1, 3).T)
    out = np.empty(flat.shape[1])
    _read_all(SourceTerms(KINDS[kind], float(strength), float(offset_m2)), *flat, out)
    return out.reshape(places.shape[:-1])

"""Gradient of a field met along a path: finite differences once moved far enough, low-passed, decaying at rest.

With ΔI and Δx since the last point that counted, once |Δx| ≥ d_min,

    published:    ∂I/∂x ← β ΔI/Δx + (1 - β) ∂I/∂x   and the same in y,
    directional:  ∇I ← ∇I + β (ΔI - ∇I·Δx) Δx / |Δx|²,

and until then ∇I ← (1 - γ) ∇I at every call (Toombs 2022, algorithm 2; SPEC §10). The published form credits
the whole of ΔI to each axis and cannot be taken along an axis on which the vehicle stood still: there the
old value is kept. The directional form changes only what the move could tell. Along one axis the two are equal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range

FORMS = ("directional", "published")
#: Numbers that one estimate remembers: gradient x, y; last point x, y; intensity there; 1 once it has begun.
MEMORY = 6
#: Published form: an axis whose share of the move is less than this stood still.
_STILL = 1e-3


class GradientSettings(NamedTuple):
    """Algorithm 2's constants as kernels read them; made by :func:`make_gradient_settings`."""

    min_move: float  # d_min, m
    smoothing: float  # β
    decay: float  # γ, a call
    published: bool


def make_gradient_settings(
    *, min_move_m: float = 0.05, smoothing: float = 0.5, decay: float = 0.02, form: str = "directional"
) -> GradientSettings:
    """d_min > 0 m, β in (0, 1], γ in [0, 1] a call (the source gives no values); ``form`` is one of ``FORMS``.

    Raises ``InvalidParameterError``.
    """
    check_range("min_move_m", min_move_m, 0, 1e3, open_low=True)
    check_range("smoothing", smoothing, 0, 1, open_low=True)
    check_range("decay", decay, 0, 1)
    check_choice("form", form, FORMS)
    return GradientSettings(float(min_move_m), float(smoothing), float(decay), form == "published")


@kernel
def gradient_step(memory, x, y, intensity, settings):
    """Take in one ``intensity`` (W/m²) at ``x``, ``y`` (m); ``memory`` (6,) is changed, its first two are ∇I, W/m³.

    An all-zero ``memory`` begins with this point. Where the field itself moves, give the
    position relative to it.
    """
    if memory[5] == 0.0:
        memory[2] = x
        memory[3] = y
        memory[4] = intensity
        memory[5] = 1.0
        return
    dx = x - memory[2]
    dy = y - memory[3]
    moved = dx * dx + dy * dy
    if moved < settings.min_move * settings.min_move:
        memory[0] *= 1.0 - settings.decay
        memory[1] *= 1.0 - settings.decay
        return
    rise = intensity - memory[4]
    if settings.published:
        least = _STILL * np.sqrt(moved)
        if abs(dx) > least:
            memory[0] += settings.smoothing * (rise / dx - memory[0])
        if abs(dy) > least:
            memory[1] += settings.smoothing * (rise / dy - memory[1])
    else:
        step = settings.smoothing * (rise - memory[0] * dx - memory[1] * dy) / moved
        memory[0] += step * dx
        memory[1] += step * dy
    memory[2] = x
    memory[3] = y
    memory[4] = intensity


@kernel
def gradient_command(gradient_x, gradient_y, gain, greatest):
    """Velocity α ∇I, m/s, shortened to ``greatest`` m/s (algorithm 4); ``gain`` α in m⁴/(W s)."""
    vx = gain * gradient_x
    vy = gain * gradient_y
    speed = np.sqrt(vx * vx + vy * vy)
    scale = greatest / speed if speed > greatest else 1.0
    return scale * vx, scale * vy


@loop_kernel
def _step_all(memories, positions, intensities, settings):
    for i in range(memories.shape[0]):
        gradient_step(memories[i], positions[i, 0], positions[i, 1], intensities[i], settings)


class GradientBatch:
    """Algorithm 2 in ``num_worlds`` worlds. ``gradients``: (num_worlds, 2), W/m³, a view that changes in place."""

    def __init__(self, num_worlds: int, settings: GradientSettings | None = None) -> None:
        if not isinstance(num_worlds, int | np.integer) or num_worlds < 1:
            raise InvalidParameterError("num_worlds", num_worlds, "a whole number of at least 1")
        self.settings = settings or make_gradient_settings()
        self._memories = np.zeros((int(num_worlds), MEMORY))
        self.gradients = self._memories[:, :2]

    def update(self, positions: npt.ArrayLike, intensities: npt.ArrayLike) -> np.ndarray:
        """One reading in every world: ``positions`` (num_worlds, 2) m, ``intensities`` (num_worlds,) W/m², finite."""
        count = len(self._memories)
        places = np.ascontiguousarray(positions, dtype=np.float64)
        values = np.ascontiguousarray(intensities, dtype=np.float64)
        for name, array, shape in (("positions", places, (count, 2)), ("intensities", values, (count,))):
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidParameterError(name, array.shape, f"finite numbers of shape {shape}")
        _step_all(self._memories, places, values, self.settings)
        return self.gradients

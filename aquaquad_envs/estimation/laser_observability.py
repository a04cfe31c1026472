"""What a laser's readings can tell of its centre: ranks of linearised observability.

Published (Toombs 2022, eq. 5.19): O = [C; CA; CA²; CA³] of the polar filter, C the gradient of (I, v_x, v_y) at the
state, A the transition of constant rates. On a pass over the axis (θ̇ = 0) it has rank 4 only where ∂I/∂r ≠ 0 and
ṙ ≠ 0: in the sloped ring and in motion. With θ̇ ≠ 0 it has rank 4 even in the dark: constant polar rates then
tie range to velocity, a relation that no straight line obeys and an artefact of that model.

So :func:`path_rank` asks the same of a path: the information Σ Φᵀ Cᵀ R⁻¹ C Φ of the Cartesian form about its
first state, whose two directions of position need the ring from two sides.

Ranks are of finite numbers: rows are taken in standard deviations of the reading, columns in ``scales``
of the state, and a direction counts from a singular value of ``least`` on: the readings tell it to 1/``least`` scales.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.laser_ekf import STATES, LaserModel
from aquaquad_envs.sensing.laser import profile_slope


def transition(dt_s: float) -> np.ndarray:
    """A of both forms over ``dt_s``: positions (or r, θ) move by their rates."""
    return np.eye(STATES) + dt_s * np.eye(STATES, k=2)


def polar_jacobian(model: LaserModel, state: Any) -> np.ndarray:
    """C of (I, v_x, v_y), eq. 5.10, at a polar ``state`` (r, θ, ṙ, θ̇): (3, 4)."""
    r, angle, along, rate = (float(value) for value in state)
    c, s = np.cos(angle), np.sin(angle)
    slope = profile_slope(model.peak, model.sigma, model.half_order, r)[1]
    return np.array(
        [
            [slope, 0.0, 0.0, 0.0],
            [-rate * s, -along * s - r * rate * c, c, -r * s],
            [rate * c, along * c - r * rate * s, s, r * c],
        ]
    )


def polar_observability(model: LaserModel, state: Any, dt_s: float) -> np.ndarray:
    """O of eq. 5.19 at a polar ``state`` (4,), rows in standard deviations of the readings: (12, 4)."""
    check_range("dt_s", dt_s, 0, 1e6, open_low=True)
    stds = np.array([model.std, model.velocity_std, model.velocity_std])
    gradient = polar_jacobian(model, state) / stds[:, None]
    step = transition(dt_s)
    return np.concatenate([gradient @ np.linalg.matrix_power(step, k) for k in range(STATES)])


def rank(matrix: np.ndarray, scales: Any, least: float = 1.0) -> int:
    """Singular values of ``matrix`` (m, n), columns times ``scales`` (n,), that are at least ``least`` > 0."""
    check_range("least", least, 0, 1e12, open_low=True)
    values = np.linalg.svd(matrix * np.asarray(scales, dtype=float), compute_uv=False)
    return int((values >= least).sum())


def polar_rank(
    model: LaserModel, state: Any, dt_s: float = 0.1, *, scales: Any = None, least: float = 1.0
) -> int:
    """Rank of :func:`polar_observability`; default ``scales`` (σ of the beam, 1 rad, 1 m/s, 1 rad/s)."""
    return rank(
        polar_observability(model, state, dt_s),
        (model.sigma, 1.0, 1.0, 1.0) if scales is None else scales,
        least,
    )


def path_rank(
    model: LaserModel,
    offsets: Any,
    dt_s: float,
    *,
    velocities: bool = False,
    scales: Any = None,
    least: float = 1.0,
) -> int:
    """Directions of (d_x, d_y, u, v) at the start that intensities along a path tell.

    ``offsets`` (steps, 2), m: the centre seen from the receiver at times ``dt_s`` apart; ``velocities``:
    the centre's velocity is measured too. Default ``scales``: (σ, σ, σ/T, σ/T) with T the path's duration. Raises
    ``InvalidParameterError``.
    """
    check_range("dt_s", dt_s, 0, 1e6, open_low=True)
    path = np.asarray(offsets, dtype=float)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2 or not np.isfinite(path).all():
        raise InvalidParameterError("offsets", path.shape, "finite positions, m, of shape (steps, 2)")
    rows = []
    for k, (x, y) in enumerate(path):
        r = float(np.hypot(x, y))
        slope = profile_slope(model.peak, model.sigma, model.half_order, r)[1] / model.std
        toward = np.array([x, y]) / r if r > 0 else np.zeros(2)
        rows.append(slope * np.concatenate([toward, k * dt_s * toward]))
        if velocities:
            rows.extend(np.eye(STATES)[2:] / model.velocity_std)
    whole = dt_s * (len(path) - 1)
    spread = (
        (model.sigma, model.sigma, model.sigma / whole, model.sigma / whole) if scales is None else scales
    )
    return rank(np.array(rows), spread, least)

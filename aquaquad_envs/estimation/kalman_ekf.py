"""Extended Kalman filter of one track: all measurements at once, or one after another.

x⁺ = x + K (z - h(x)), K = P Hᵀ (H P Hᵀ + R)⁻¹, P⁺ = (I - K H) P, with H the gradient of h at the
predicted state (Dillard 2014, III.C), computed in the square-root form of
:mod:`~aquaquad_envs.estimation.kalman_update`. Predict with
:func:`~aquaquad_envs.estimation.kalman_motion.predict`.
"""

from __future__ import annotations

from aquaquad_envs.compilation import kernel
from aquaquad_envs.estimation.kalman_update import factorize, square_root_update
from aquaquad_envs.sensing.measurements import (
    BEARING,
    measurement_gradient,
    predicted_measurement,
    wrap_angle,
)


@kernel
def _ekf_row(state, work, row, kind, sensors, others, i, value, sigma, sound_speed, wrap):
    """Whitened response and residual of measurement ``i`` into ``work[row]``."""
    x = state[0]
    y = state[1]
    gx, gy = measurement_gradient(
        kind, x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
    )
    residual = value - predicted_measurement(
        kind, x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
    )
    if wrap and kind == BEARING:
        residual = wrap_angle(residual)
    inverse = 1.0 / sigma
    work[row, 0] = (gx * work[0, 0] + gy * work[1, 0]) * inverse
    work[row, 1] = gy * work[1, 1] * inverse
    work[row, 2] = residual * inverse


@kernel
def ekf_update(
    state, covariance, work, kinds, sensors, others, values, sigmas, mask, count, sound_speed, wrap
):
    """Update one track by the first ``count`` measurements together; returns ``(used, nis, repaired)``.

    state: (n,), covariance: (n, n), n = 4 or 6, updated in place; work: scratch of
    :func:`~aquaquad_envs.estimation.kalman_update.work_shape`, its contents do not matter.
    kinds: (m,) codes BEARING, RANGE, TDOA; sensors, others: (m, 2), m (others: sensor j of a TDOA, ignored
    else); values, sigmas: (m,) measurement and its standard deviation > 0 in rad, m or s; mask: (m,) True
    where there is a measurement; count ≤ m; sound_speed in m/s. ``wrap``: bearing residuals taken in
    [-π, π) (as published: False). All finite where ``mask`` is True.

    used: measurements used (with 0 nothing is changed); nis: νᵀ S⁻¹ ν, χ² with ``used`` degrees of freedom
    if the model is matched; repaired: 1 where the covariance had lost positive definiteness.
    """
    n = state.shape[0]
    repaired = factorize(covariance, work)
    row = n
    for i in range(count):
        if mask[i]:
            _ekf_row(state, work, row, kinds[i], sensors, others, i, values[i], sigmas[i], sound_speed, wrap)
            row += 1
    if row == n:
        return 0, 0.0, 0
    return row - n, square_root_update(state, covariance, work, row - n, 2, 2), repaired


@kernel
def ekf_update_one(state, covariance, work, kind, sensors, others, i, value, sigma, sound_speed, wrap):
    """Update one track by measurement ``i`` alone; returns ``(nis, repaired)``. Arguments as :func:`ekf_update`."""
    repaired = factorize(covariance, work)
    _ekf_row(state, work, state.shape[0], kind, sensors, others, i, value, sigma, sound_speed, wrap)
    return square_root_update(state, covariance, work, 1, 2, 2), repaired


@kernel
def ekf_update_sequential(
    state, covariance, work, kinds, sensors, others, values, sigmas, mask, count, sound_speed, wrap
):
    """As :func:`ekf_update`, one measurement after another, each linearised about the latest state.

    ``nis`` is the sum of the single ones; ``repaired`` counts repairs.
    """
    used = 0
    nis = 0.0
    repaired = 0
    for i in range(count):
        if mask[i]:
            one, mended = ekf_update_one(
                state, covariance, work, kinds[i], sensors, others, i, values[i], sigmas[i], sound_speed, wrap
            )
            used += 1
            nis += one
            repaired += mended
    return used, nis, repaired

"""Unscented Kalman filter of one track, in deviations from the centre point.

Sigma points x and x ± c d_k, d_k the columns of a square root of P, c² = α²(n + κ); weights
1/(2c²), for the mean of the centre λ/(n + λ), λ = c² - n, for its covariance 1 - α² + β more (Wan & van der
Merwe 2000; Dillard 2014, III.D). At α = 1e-3 these weights are ±1e6 and cancel. Written with

    a_k = (h(x + c d_k) - h(x - c d_k)) / 2c,   s_k = (h(x + c d_k) + h(x - c d_k) - 2 h(x)) / 2c²,   μ = Σ s_k

the same transform is

    ẑ = h(x) + μ,   S = Σ a_k a_kᵀ + c² Σ s_k s_kᵀ + (β - α²) μ μᵀ + R,   P_xz = Σ d_k a_kᵀ,

free of large weights: a_k tends to the gradient along d_k and s_k to half the curvature. The
differences of h are computed as such (:func:`measurement_difference`), not by subtracting two
values of h, so that no digits go with α; bearing differences come out wrapped by themselves.

The curvature terms of S are S̃ᵀS̃ with S̃_k = c s_k + γ μ, γ = (√(c² + q(β - α²)) - c)/q, for q points
pairs that move the measurement.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.kalman_motion import add_process_noise, move_rows, predict_state
from aquaquad_envs.estimation.kalman_update import divide_deviations, factorize, square_root_update
from aquaquad_envs.estimation.small_matrices import triangularize
from aquaquad_envs.sensing.measurements import (
    BEARING,
    RANGE,
    bearing_to,
    predicted_measurement,
    wrap_angle,
)


class SigmaPoints(NamedTuple):
    """Sigma points as kernels read them; make one with :func:`make_sigma_points`."""

    spread: float  # c = α √(n + κ)
    blend: float  # γ for points drawn from the predicted covariance (q = 2)
    blend_carried: float  # γ for points carried through the prediction (q = n)


def make_sigma_points(
    states: int, *, alpha: float = 1e-3, beta: float = 2.0, kappa: float = 0.0
) -> SigmaPoints:
    """Sigma points of α in (0, 10], β ≥ 0 and κ for ``states`` states; the defaults are the published ones.

    Requires n + κ > 0 and an innovation covariance that is positive definite for every
    measurement: α²(n + κ - q) + q β ≥ 0 for q = 2 and q = n, true for β = 2 at any usual κ. Raises
    ``InvalidParameterError`` otherwise.
    """
    if states not in (4, 6):
        raise InvalidParameterError("states", states, "4 or 6")
    check_range("alpha", alpha, 0, 10, open_low=True)
    check_range("beta", beta, 0, 1e6)
    check_range("kappa", kappa, -states, 1e6, open_low=True)
    spread = alpha * np.sqrt(states + kappa)
    blends = []
    for q in (2, states):
        square = spread**2 + q * (beta - alpha**2)
        # κ = 0 and β = 0 lies on the bound: let rounding pass.
        if square < -1e-12 * spread**2:
            raise InvalidParameterError(
                "beta", beta, f"at least {alpha**2 - spread**2 / q:g} at alpha {alpha:g}, kappa {kappa:g}",
                "The innovation covariance could lose positive definiteness; beta = 2 suits normal noise.",
            )  # fmt: skip
        blends.append((np.sqrt(max(square, 0.0)) - spread) / q)
    return SigmaPoints(float(spread), float(blends[0]), float(blends[1]))


@kernel
def _range_difference(ax, ay, dx, dy):
    """|a + d| - |a| without cancellation."""
    total = np.sqrt(ax * ax + ay * ay) + np.sqrt((ax + dx) * (ax + dx) + (ay + dy) * (ay + dy))
    return (dx * (2.0 * ax + dx) + dy * (2.0 * ay + dy)) / total if total > 0.0 else 0.0


@kernel
def measurement_difference(kind, x, y, dx, dy, sensor_x, sensor_y, other_x, other_y, sound_speed, wrap):
    """h(x + dx, y + dy) - h(x, y) of a measurement, to full accuracy also for small (dx, dy): rad, m or s.

    Bearing: the angle atan2(a × d, a · (a + d)) between a = (x, y) - sensor and a + d, in (-π, π]; where not
    ``wrap``, whole turns are added so that it is the difference of the two bearings as atan2 gives them.
    Range: d · (2a + d) / (|a| + |a + d|). TDOA: the difference of two of these over the sound speed.
    """
    ax = x - sensor_x
    ay = y - sensor_y
    if kind == BEARING:
        # Adding 0 turns a negative zero into a positive one, for which atan2 would turn half round.
        turned = np.arctan2(ax * dy - ay * dx + 0.0, ax * (ax + dx) + ay * (ay + dy) + 0.0)
        if wrap:
            return turned
        raw = bearing_to(x + dx, y + dy, sensor_x, sensor_y) - bearing_to(x, y, sensor_x, sensor_y)
        return turned + 2.0 * np.pi * np.rint((raw - turned) / (2.0 * np.pi))
    difference = _range_difference(ax, ay, dx, dy)
    if kind == RANGE:
        return difference
    return (difference - _range_difference(x - other_x, y - other_y, dx, dy)) / sound_speed


@kernel
def _ukf_row(state, work, row, kind, sensors, others, i, value, sigma, sound_speed, wrap, spread, blend, q):
    """Whitened curvature, response and residual of measurement ``i`` into ``work[row]``."""
    x = state[0]
    y = state[1]
    half = 0.5 / spread
    mean = 0.0
    for k in range(q):
        dx = spread * work[0, k]
        dy = spread * work[1, k]
        ahead = measurement_difference(
            kind, x, y, dx, dy, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed, wrap
        )
        behind = measurement_difference(
            kind, x, y, -dx, -dy, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed, wrap
        )
        curvature = (ahead + behind) * half
        work[row, k] = curvature
        work[row, q + k] = (ahead - behind) * half
        mean += curvature
    mean /= spread
    residual = (
        value
        - mean
        - predicted_measurement(
            kind, x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
        )
    )
    if wrap and kind == BEARING:
        residual = wrap_angle(residual)
    inverse = 1.0 / sigma
    for k in range(q):
        work[row, k] = (work[row, k] + blend * mean) * inverse
        work[row, q + k] *= inverse
    work[row, 2 * q] = residual * inverse


@kernel
def ukf_update(
    state, covariance, work, kinds, sensors, others, values, sigmas, mask, count, sound_speed, wrap, points
):
    """Update one track by the first ``count`` measurements together; returns ``(used, nis, repaired)``.

    Sigma points are drawn from the predicted covariance. Arguments and results as
    :func:`~aquaquad_envs.estimation.kalman_ekf.ekf_update`; ``points``: :class:`SigmaPoints`. Without
    ``wrap`` bearings are averaged and subtracted as plain numbers, as published.
    """
    n = state.shape[0]
    repaired = factorize(covariance, work)
    row = n
    for i in range(count):
        if mask[i]:
            _ukf_row(
                state, work, row, kinds[i], sensors, others, i, values[i], sigmas[i], sound_speed, wrap,
                points.spread, points.blend, 2,
            )  # fmt: skip
            row += 1
    if row == n:
        return 0, 0.0, 0
    return row - n, square_root_update(state, covariance, work, row - n, 4, 2), repaired


@kernel
def ukf_cycle_carried(
    state, covariance, work, dt, motion, kinds, sensors, others, values, sigmas, mask, count, sound_speed,
    wrap, points,
):  # fmt: skip
    """Predict by ``dt`` s and update with the same sigma points, as published; returns ``(used, nis, repaired)``.

    The points drawn before the prediction are carried through it and measured, so that the
    process noise spreads P but not the points (Dillard 2014, App. B; filterpy before 2.0). Arguments
    as :func:`ukf_update` and :func:`~aquaquad_envs.estimation.kalman_motion.predict`.
    """
    n = state.shape[0]
    repaired = factorize(covariance, work)
    for i in range(n):
        for j in range(i + 1, n):
            work[i, j] = 0.0
    predict_state(state, dt, motion)
    move_rows(work, n, dt, motion)
    used = 0
    row = n
    for i in range(count):
        if mask[i]:
            _ukf_row(
                state, work, row, kinds[i], sensors, others, i, values[i], sigmas[i], sound_speed, wrap,
                points.spread, points.blend_carried, n,
            )  # fmt: skip
            used += 1
            row += 1
    nis = 0.0
    if used > 0:
        nis = triangularize(work, n, used, 2 * n, n + used, n)
        divide_deviations(state, work, n + used, n)
    # P⁺ = E Eᵀ + Q: what the points do not span is the process noise.
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(n):
                total += work[i, k] * work[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
    add_process_noise(covariance, dt, motion)
    return used, nis, repaired

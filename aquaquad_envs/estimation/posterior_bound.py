"""Posterior Cramér–Rao bound of tracking: no filter's mean square error can lie below it.

For x_{k+1} = Φ x_k + w, w ~ N(0, Q), and measurements with normal noise, the information matrix
of any estimate of x_k from all measurements up to k obeys (Tichavský, Muravchik & Nehorai, IEEE Trans.
Signal Processing 46(5), 1998, eq. 21 for linear motion)

    J_{k+1} = (Q + Φ J_k⁻¹ Φᵀ)⁻¹ + E[Hᵀ R⁻¹ H],   E (x̂ - x)(x̂ - x)ᵀ ≥ J⁻¹,

H the gradient of the measurements at the **true** state, E over the target's and the sensors' tracks. Kernels
carry C = J⁻¹, which exists for Q = 0 and singular Q too: its prediction is that of the filters, its
update theirs with the gradient at the truth. With the information of each world's own tracks
the recursion gives the bound given those tracks; averaged over worlds it gives the bound over the
scenario. By convexity the second is the lower (weaker) one.

Valid for linear motion with the stated noise: a target that manoeuvres otherwise, or stands still, is
bounded only as far as ``motion`` describes it. Measurements that a detection threshold drops
are left out by ``mask``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.hdop import position_information
from aquaquad_envs.estimation.kalman_motion import Motion, predict_covariance, states_of
from aquaquad_envs.estimation.kalman_update import factorize, square_root_update, work_shape
from aquaquad_envs.estimation.small_matrices import cholesky, inverse_from_cholesky
from aquaquad_envs.sensing.measurements import KINDS, TDOA


@kernel
def bound_update(nowhere, bound, work, a, b, d):
    """C ← (C⁻¹ + J_p)⁻¹ with J_p = [[a, b], [b, d]] on the position; returns 1 if C was repaired, else 0.

    bound: C (n, n), in place; nowhere: (n,) scratch; work: scratch of ``work_shape(n, 2)``; a, b, d from
    :func:`~aquaquad_envs.estimation.hdop.position_information`. J_p's own Cholesky rows stand for
    two measurements of unit deviation.
    """
    n = bound.shape[0]
    repaired = factorize(bound, work)
    first = np.sqrt(a)
    mixed = b / first if first > 0.0 else 0.0
    second = np.sqrt(max(d - mixed * mixed, 0.0))
    work[n, 0] = first * work[0, 0] + mixed * work[1, 0]
    work[n, 1] = mixed * work[1, 1]
    work[n, 2] = 0.0
    work[n + 1, 0] = second * work[1, 0]
    work[n + 1, 1] = second * work[1, 1]
    work[n + 1, 2] = 0.0
    square_root_update(nowhere, bound, work, 2, 2, 2)
    return repaired


@kernel
def bound_position_rmse(bound):
    """Bound on the root mean square error of position, m: sqrt(C_xx + C_yy)."""
    return np.sqrt(bound[0, 0] + bound[1, 1])


@loop_kernel
def _gather(kinds, sensors, others, sigmas, mask, positions, sound_speed, out):
    for w in range(kinds.shape[0]):
        for k in range(kinds.shape[1]):
            out[w, k, 0], out[w, k, 1], out[w, k, 2] = position_information(
                kinds[w, k], sensors[w, k], others[w, k], sigmas[w, k], mask[w, k], kinds.shape[2],
                positions[w, k, 0], positions[w, k, 1], sound_speed,
            )  # fmt: skip


@loop_kernel
def _recur(gathered, steps, motion, bound, nowhere, work, informations, rmse):
    n = bound.shape[1]
    for w in range(gathered.shape[0]):
        for k in range(gathered.shape[1]):
            predict_covariance(bound[w], steps[k], motion)
            bound_update(nowhere, bound[w], work, gathered[w, k, 0], gathered[w, k, 1], gathered[w, k, 2])
            cholesky(bound[w], work)
            inverse_from_cholesky(work, informations[w, k], n)
            rmse[w, k] = bound_position_rmse(bound[w])


class PosteriorBound(NamedTuple):
    """Bound along a scenario of K steps, for each of W worlds (W = 1 where averaged)."""

    information: np.ndarray  # (W, K, n, n), J after each step's measurements
    position_rmse_m: np.ndarray  # (W, K), sqrt of the trace of J⁻¹'s position block


def posterior_bound(
    motion: Motion,
    prior: Any,
    steps_s: Any,
    positions: Any,
    kinds: Any,
    sensors: Any,
    stds: Any,
    *,
    others: Any = None,
    mask: Any = None,
    average: bool = False,
    sound_speed_m_s: float = 1500.0,
) -> PosteriorBound:
    """Posterior Cramér–Rao bound of ``W`` worlds over ``K`` steps, each a prediction and its measurements.

    prior: (n, n) covariance of the first state, before the first step; steps_s: a number or (K,), s before each
    measurement; positions: (W, K, 2) true target, m, or (K, 2) for one world; kinds: name or codes, stds, mask:
    broadcast to (W, K, M); sensors, others: (W, K, M, 2) or what broadcasts to it, m (others: sensor j of a TDOA).
    M is the length before last of ``sensors``. ``average``: the scenario's bound from information averaged over
    worlds (W = 1 in the result), instead of one bound a world. Raises ``InvalidParameterError``.
    """
    n = states_of(motion)
    check_range("sound_speed_m_s", sound_speed_m_s, 1, 1e5)
    tracks = np.asarray(positions, dtype=np.float64)
    tracks = tracks[None] if tracks.ndim == 2 else tracks
    if tracks.ndim != 3 or tracks.shape[2] != 2 or not np.isfinite(tracks).all():
        raise InvalidParameterError("positions", tracks.shape, "finite positions, m, of shape (W, K, 2)")
    if np.ndim(sensors) < 2:
        raise InvalidParameterError("sensors", np.shape(sensors), "shape (..., M, 2)")
    shape = (*tracks.shape[:2], np.shape(sensors)[-2])
    if isinstance(kinds, str):
        check_choice("kinds", kinds, KINDS)
        kinds = KINDS[kinds]
    codes = _spread("kinds", kinds, shape, np.int64)
    if codes.size and not (codes.min() >= 0 and codes.max() <= TDOA):
        raise InvalidParameterError(
            "kinds", [int(codes.min()), int(codes.max())], f"codes in {sorted(KINDS.values())}"
        )
    if others is None:
        if (codes == TDOA).any():
            raise InvalidParameterError("others", None, "the second sensor of every TDOA", "Shape (M, 2).")
        others = sensors
    present = _spread("mask", True if mask is None else mask, shape, bool)
    here = _spread("sensors", sensors, (*shape, 2))
    there = _spread("others", others, (*shape, 2))
    sigmas = _spread("stds", stds, shape)
    if not ((sigmas > 0) & (sigmas < np.inf) | ~present).all():
        raise InvalidParameterError("stds", stds, "positive finite standard deviations")
    if not (np.isfinite(here).all(-1) & np.isfinite(there).all(-1) | ~present).all():
        raise InvalidParameterError("sensors", "NaN or infinite", "finite positions of sensors that measure")
    steps = _spread("steps_s", steps_s, shape[1:2])
    if not (np.isfinite(steps).all() and (steps >= 0).all()):
        raise InvalidParameterError("steps_s", steps_s, "finite seconds of at least 0")
    first = _spread("prior", prior, (n, n))
    try:
        np.linalg.cholesky(first)
    except np.linalg.LinAlgError:
        raise InvalidParameterError(
            "prior", "not positive definite", "a positive definite covariance"
        ) from None

    gathered = np.zeros((*shape[:2], 3))
    _gather(
        codes, here, there, sigmas, present, np.ascontiguousarray(tracks), float(sound_speed_m_s), gathered
    )
    if average:
        gathered = gathered.mean(axis=0, keepdims=True)
    bound = np.tile(first, (len(gathered), 1, 1))
    informations = np.zeros((*gathered.shape[:2], n, n))
    rmse = np.zeros(gathered.shape[:2])
    _recur(gathered, steps, motion, bound, np.zeros(n), np.zeros(work_shape(n, 2)), informations, rmse)
    return PosteriorBound(informations, rmse)


def _spread(name: str, values: Any, shape: tuple[int, ...], dtype: Any = np.float64) -> np.ndarray:
    try:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(values, dtype=dtype), shape))
    except (TypeError, ValueError):
        raise InvalidParameterError(
            name, np.shape(values), f"numbers of a shape that broadcasts to {shape}"
        ) from None

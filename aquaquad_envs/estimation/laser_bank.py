"""A bank of extended Kalman filters for a laser's disc: the first light says how far its centre is, not where.

A reading fixes r = |d| and leaves the direction open: the posterior is an arc, which one Gaussian cannot hold
(a single filter becomes sure of a wrong point on it, by σ²/2r of bias at each reading). So it is cut into
hypotheses, each a filter of :mod:`~aquaquad_envs.estimation.laser_ekf` in Cartesian form with a weight that follows the
likelihood of what it predicted (Alspach and Sorenson, IEEE TAC 17(4), 1972). Those that have become unlikely are
dropped, those that have met are merged, mean and covariance kept; mostly one is left within a second or two,
and the bank costs no more than the filter.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.laser_ekf import STATES, cartesian_predict, cartesian_update

#: Hypotheses that a bank begins with: directions 30° apart.
HYPOTHESES = 12
#: Weight of all directions together that do not lie ahead: the disc may have come from behind.
_BEHIND = 0.1
#: A hypothesis of less than this share of the likeliest one's weight is dropped.
_DROPPED = 1e-3
#: Variance, m² or m²/s², of what is known to be 0.
_PINNED = 1e-8
#: Two whose positions are within this many standard deviations squared are merged.
_MERGED = 1.0

BANK = np.dtype(
    [
        ("count", np.int64),
        ("weights", np.float64, HYPOTHESES),  # sum to 1 over the first ``count``
        ("states", np.float64, (HYPOTHESES, STATES)),
        ("covariances", np.float64, (HYPOTHESES, STATES, STATES)),
    ]
)


@loop_kernel
def bank_begin(bank, r, r_std, course_x, course_y, u, v, speed_std):
    """Begin where light was met: the centre is ``r`` m away, ± ``r_std``, most likely ahead.

    ``course_x``, ``course_y``: velocity of the receiver over the disc, any length. ``u``, ``v``: the disc's, m/s,
    ± ``speed_std`` in each axis. Entered at random along its width, a disc's centre is off the course
    by ψ with density ½ cos ψ.
    """
    bank.count = HYPOTHESES
    half = np.pi / HYPOTHESES
    ahead = np.arctan2(course_y, course_x)
    for k in range(HYPOTHESES):
        angle = (2 * k + 1) * half
        angle = angle if angle < np.pi else angle - 2.0 * np.pi
        c = np.cos(ahead + angle)
        s = np.sin(ahead + angle)
        # ½ cos ψ over the hypothesis' sector, none behind.
        low = min(max(angle - half, -0.5 * np.pi), 0.5 * np.pi)
        high = min(max(angle + half, -0.5 * np.pi), 0.5 * np.pi)
        bank.weights[k] = (1.0 - _BEHIND) * 0.5 * (np.sin(high) - np.sin(low)) + _BEHIND / HYPOTHESES
        bank.states[k, 0] = r * c
        bank.states[k, 1] = r * s
        bank.states[k, 2] = u
        bank.states[k, 3] = v
        along = r_std * r_std
        # Of a uniform sector: its width over √12.
        across = (2.0 * half * r) ** 2 / 12.0
        covariance = bank.covariances[k]
        for i in range(STATES):
            for j in range(STATES):
                covariance[i, j] = speed_std * speed_std if i == j else 0.0
        covariance[0, 0] = along * c * c + across * s * s
        covariance[0, 1] = (along - across) * c * s
        covariance[1, 0] = covariance[0, 1]
        covariance[1, 1] = along * s * s + across * c * c


@loop_kernel
def bank_begin_line(bank, r, r_std, course_x, u, speed_std):
    """As :func:`bank_begin` where all motion is in x: the centre is ahead or behind."""
    bank.count = 2
    for k in range(2):
        sign = (1.0 if k == 0 else -1.0) * (1.0 if course_x >= 0.0 else -1.0)
        bank.weights[k] = 1.0 - _BEHIND if k == 0 else _BEHIND
        bank.states[k, 0] = sign * r
        bank.states[k, 1] = 0.0
        bank.states[k, 2] = u
        bank.states[k, 3] = 0.0
        for i in range(STATES):
            for j in range(STATES):
                bank.covariances[k, i, j] = 0.0
        bank.covariances[k, 0, 0] = r_std * r_std
        bank.covariances[k, 2, 2] = speed_std * speed_std
    bank_pin(bank)


@kernel
def bank_pin(bank):
    """Where all motion is in x: nothing is unknown in y, whatever noise a cycle added there."""
    for k in range(bank.count):
        for i in (1, 3):
            bank.states[k, i] = 0.0
            for j in range(STATES):
                bank.covariances[k, i, j] = 0.0
                bank.covariances[k, j, i] = 0.0
            bank.covariances[k, i, i] = _PINNED


@kernel
def _move(bank, source, target):
    bank.weights[target] = bank.weights[source]
    for i in range(STATES):
        bank.states[target, i] = bank.states[source, i]
        for j in range(STATES):
            bank.covariances[target, i, j] = bank.covariances[source, i, j]


@kernel
def _merge(bank, i, j):
    """Hypothesis ``i`` becomes both: mean and covariance of the pair."""
    total = bank.weights[i] + bank.weights[j]
    a = bank.weights[i] / total
    b = bank.weights[j] / total
    for k in range(STATES):
        for m in range(STATES):
            apart = (bank.states[i, k] - bank.states[j, k]) * (bank.states[i, m] - bank.states[j, m])
            bank.covariances[i, k, m] = (
                a * bank.covariances[i, k, m] + b * bank.covariances[j, k, m] + a * b * apart
            )
    for k in range(STATES):
        bank.states[i, k] = a * bank.states[i, k] + b * bank.states[j, k]
    bank.weights[i] = total


@kernel
def _have_met(bank, i, j):
    dx = bank.states[i, 0] - bank.states[j, 0]
    dy = bank.states[i, 1] - bank.states[j, 1]
    a = bank.covariances[i, 0, 0] + bank.covariances[j, 0, 0]
    b = bank.covariances[i, 0, 1] + bank.covariances[j, 0, 1]
    d = bank.covariances[i, 1, 1] + bank.covariances[j, 1, 1]
    return d * dx * dx - 2.0 * b * dx * dy + a * dy * dy < _MERGED * (a * d - b * b)


@kernel
def _reduce(bank):
    """Normalise the weights; drop the unlikely and merge those that have met."""
    greatest = 0.0
    for k in range(bank.count):
        greatest = max(greatest, bank.weights[k])
    kept = 0
    for k in range(bank.count):
        if bank.weights[k] >= _DROPPED * greatest:
            if k != kept:
                _move(bank, k, kept)
            kept += 1
    i = 0
    while i < kept:
        j = i + 1
        while j < kept:
            if _have_met(bank, i, j):
                _merge(bank, i, j)
                kept -= 1
                if j != kept:
                    _move(bank, kept, j)
            else:
                j += 1
        i += 1
    total = 0.0
    for k in range(kept):
        total += bank.weights[k]
    for k in range(kept):
        bank.weights[k] /= total
    bank.count = kept


@loop_kernel
def bank_cycle(bank, work, dt, moved_x, moved_y, motion, model, reading):
    """Predict ``dt`` s, the receiver having moved, and update by one intensity ``reading``, W/m²; in place.

    ``work``: scratch of :data:`~aquaquad_envs.estimation.laser_ekf.WORK`.
    """
    least = np.inf
    for k in range(bank.count):
        cartesian_predict(bank.states[k], bank.covariances[k], dt, moved_x, moved_y, motion)
        nis, _ = cartesian_update(bank.states[k], bank.covariances[k], work, model, reading)
        # The triangular factor that the update leaves: its determinant squared is S/R.
        root = work[STATES + 1, 0] * work[STATES + 2, 1]
        fit = 0.5 * nis + np.log(root) - np.log(bank.weights[k])
        least = min(least, fit)
        bank.weights[k] = fit
    if bank.count == 1:
        bank.weights[0] = 1.0
        return
    for k in range(bank.count):
        bank.weights[k] = np.exp(least - bank.weights[k])
    _reduce(bank)


@kernel
def bank_likeliest(bank):
    """Index of the hypothesis of the greatest weight."""
    best = 0
    for k in range(1, bank.count):
        if bank.weights[k] > bank.weights[best]:
            best = k
    return best


@kernel
def bank_mean(bank, mean):
    """Weighted mean (d_x, d_y, u, v) into ``mean`` (4,); returns the position's variance, m², both axes' sum."""
    for i in range(STATES):
        mean[i] = 0.0
        for k in range(bank.count):
            mean[i] += bank.weights[k] * bank.states[k, i]
    total = 0.0
    for i in range(2):
        for k in range(bank.count):
            apart = bank.states[k, i] - mean[i]
            total += bank.weights[k] * (bank.covariances[k, i, i] + apart * apart)
    return total

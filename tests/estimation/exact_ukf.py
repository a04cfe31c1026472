"""The textbook UKF in 60 decimal digits: which digits of a double-precision filter are right."""

import mpmath
import numpy as np

from tests.estimation.kalman_reference import C, process_noise, transition

mpmath.mp.dps = 60


def exact_ukf_cycle(motion, state, covariance, dt, rows, values, *, alpha, beta=2.0, kappa=0.0, carry=False):
    """One predict and update by sigma points and weights as published; float64 in, mpmath matrices out."""
    mp, n = mpmath, len(state)
    kinds, sensors, others, stds = rows
    m = len(kinds)
    alpha, kappa = mp.mpf(alpha), mp.mpf(kappa)
    lam = alpha**2 * (n + kappa) - n
    weights = [lam / (n + lam)] + [1 / (2 * (n + lam))] * (2 * n)
    spread = [weights[0] + 1 - alpha**2 + mp.mpf(beta), *weights[1:]]

    def points(x, p):
        root = mp.cholesky((n + lam) * p)
        columns = [root[:, k] for k in range(n)]
        return [x, *(x + c for c in columns), *(x - c for c in columns)]

    def mean(vectors):
        total = vectors[0] * weights[0]
        for w, v in zip(weights[1:], vectors[1:], strict=True):
            total += v * w
        return total

    def cross(first, second):
        total = first[0] * second[0].T * spread[0]
        for w, a, b in zip(spread[1:], first[1:], second[1:], strict=True):
            total += a * b.T * w
        return total

    def h(x):
        out = mp.matrix(m, 1)
        for i in range(m):
            dx, dy = x[0] - mp.mpf(sensors[i, 0]), x[1] - mp.mpf(sensors[i, 1])
            ex, ey = x[0] - mp.mpf(others[i, 0]), x[1] - mp.mpf(others[i, 1])
            r = mp.sqrt(dx**2 + dy**2)
            out[i] = [mp.atan2(dy, dx), r, (r - mp.sqrt(ex**2 + ey**2)) / mp.mpf(C)][kinds[i]]
        return out

    phi, q = mp.matrix(transition(motion, dt)), mp.matrix(process_noise(motion, dt))
    sigmas = [phi * x for x in points(mp.matrix(state), mp.matrix(covariance))]
    x = mean(sigmas)
    p = cross([s - x for s in sigmas], [s - x for s in sigmas]) + q
    if not carry:
        sigmas = points(x, p)
    measured = [h(s) for s in sigmas]
    z = mean(measured)
    away = [one - z for one in measured]
    s = cross(away, away) + mp.matrix(np.diag(stds**2))
    gain = cross([one - x for one in sigmas], away) * s**-1
    residual = mp.matrix(values) - z
    nis = (residual.T * s**-1 * residual)[0]
    return x + gain * residual, p - gain * s * gain.T, nis


def as_array(matrix):
    return np.array(matrix.tolist(), dtype=float)

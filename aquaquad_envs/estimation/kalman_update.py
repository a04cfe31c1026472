"""The step that every filter here shares: a measurement update in square-root form.

Notation: P = L Lᵀ the predicted covariance (n, n), D (n, q) the deviations along which the
measurement model was sampled (the first q columns of L, or the carried ones), A (q, m) its response
to them, R = diag(σ²), ν the residual, S̃ (q, m) the scaled curvature of the unscented transform
(absent in the EKF). The innovation covariance is S = AᵀA + S̃ᵀS̃ + R and the cross covariance D A. With
B = [S̃; A] R^(-1/2) and an orthogonal triangularisation I + B Bᵀ = UᵀU, U's last q rows and
columns U_a and the rotated residual c,

    x⁺ = x + E c,   P⁺ = P - D Dᵀ + E Eᵀ,   E = D U_a⁻¹,   NIS = νᵀ S⁻¹ ν = |rest of the residual|².

This equals x + K ν and P - K S Kᵀ in exact arithmetic, but no m × m matrix is formed, nothing
positive is made by subtraction, and no digits are lost where R is small beside P. Since a
measurement depends on position only and L is lower triangular, only the first two columns of L
move it: q = 2, exactly, whatever n.

Scratch ``work`` of :func:`work_shape`: rows [0, n) hold the factor, rows [n, n + m) the
measurements, the next q rows U_a and c.
"""

from __future__ import annotations

from aquaquad_envs.compilation import kernel
from aquaquad_envs.estimation.small_matrices import cholesky, triangularize


def work_shape(states: int, measurements: int) -> tuple[int, int]:
    """Shape of the float64 scratch that filters of ``states`` states and up to ``measurements`` rows need."""
    return 2 * states + measurements, 2 * states + 1


@kernel
def factorize(covariance, work):
    """L of ``covariance`` into ``work``'s first rows, zeros above its diagonal; returns 1 if repaired, else 0."""
    repaired = cholesky(covariance, work)
    work[0, 1] = 0.0
    return repaired


@kernel
def square_root_update(state, covariance, work, rows, columns, q):
    """Update ``state`` (n,) and ``covariance`` (n, n) by ``rows`` whitened measurements; returns the NIS.

    Expects L of the predicted covariance (:func:`factorize`) in ``work[:n]``, and in
    ``work[n : n + rows]`` the rows of Bᵀ (``columns`` of them, A last) followed by ν/σ. q is 2.
    """
    n = state.shape[0]
    top = n + rows
    nis = triangularize(work, n, rows, columns, top, q)
    divide_deviations(state, work, top, q)
    # P⁺ = E Eᵀ + the rest of L's columns.
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(q):
                total += work[i, k] * work[j, k]
            for k in range(q, i + 1):
                total += work[i, k] * work[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
    return nis


@kernel
def divide_deviations(state, work, top, q):
    """D, the first ``q`` columns of ``work``'s first n rows, becomes E = D U_a⁻¹; ``state`` moves by E c."""
    for i in range(state.shape[0]):
        for k in range(q):
            value = work[i, k]
            for j in range(k):
                value -= work[i, j] * work[top + j, k]
            value /= work[top + k, k]
            work[i, k] = value
            state[i] += value * work[top + k, q]

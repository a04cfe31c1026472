"""Consistency and confidence of estimated positions (SPEC §8)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_range


class ConfidenceRegion(NamedTuple):
    """Ellipse (d = 2) or ellipsoid (d = 3) about an estimate, for a batch of shape (...)."""

    semi_axes_m: np.ndarray  # (..., d), greatest first
    directions: np.ndarray  # (..., d, d), unit columns
    probability: float


def nees(estimates: Any, truths: Any, covariances: Any) -> np.ndarray:
    """Normalised estimation error squared ε = (p̂ - p)ᵀ P⁻¹ (p̂ - p), (...), of (..., d), (..., d) and (..., d, d).

    χ² with d degrees of freedom for a consistent estimator; summed over M transponders with d M. Raises
    ``InvalidParameterError`` for covariances that are singular or not finite.
    """
    covariance = _covariances(covariances)
    error = np.asarray(estimates, dtype=np.float64) - np.asarray(truths, dtype=np.float64)
    if error.shape[-1] != covariance.shape[-1]:
        raise InvalidParameterError("covariances", covariance.shape, f"(..., {error.shape[-1]}, ...)")
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.sum(error * solved, axis=-1)


def confidence_ellipse(covariances: Any, probability: float = 0.95) -> ConfidenceRegion:
    """Horizontal ellipse of normal errors with covariances (..., 2, 2) or (..., 3, 3), whose x and y it takes.

    Semi-axes √(-2 ln(1 - probability) λ), λ the eigenvalues: 2.4477 √λ at 95 %. It holds the horizontal error with
    that probability, whatever the depth. Raises ``InvalidParameterError``.
    """
    return _region(_covariances(covariances)[..., :2, :2], probability)


def confidence_ellipsoid(covariances: Any, probability: float = 0.95) -> ConfidenceRegion:
    """Ellipsoid of normal errors with covariances (..., 3, 3): semi-axes √(χ²₃ λ), 2.7955 √λ at 95 %."""
    covariance = _covariances(covariances)
    if covariance.shape[-1] != 3:
        raise InvalidParameterError("covariances", covariance.shape, "(..., 3, 3)")
    return _region(covariance, probability)


def _region(covariance: np.ndarray, probability: float) -> ConfidenceRegion:
    from scipy.stats import chi2

    check_range("probability", probability, 0, 1 - 1e-12, open_low=True)
    values, vectors = np.linalg.eigh(covariance)
    scale = chi2.ppf(probability, covariance.shape[-1])
    # eigh sorts upwards.
    axes = np.sqrt(scale * np.maximum(values[..., ::-1], 0.0))
    return ConfidenceRegion(axes, vectors[..., ::-1], float(probability))


def _covariances(values: Any) -> np.ndarray:
    covariance = np.asarray(values, dtype=np.float64)
    if (
        covariance.ndim < 2
        or covariance.shape[-1] != covariance.shape[-2]
        or covariance.shape[-1] not in (2, 3)
    ):
        raise InvalidParameterError("covariances", covariance.shape, "(..., 2, 2) or (..., 3, 3)")
    if not np.isfinite(covariance).all():
        raise InvalidParameterError(
            "covariances", "infinite or NaN", "finite covariances", "Select those that converged."
        )
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise InvalidParameterError(
            "covariances", "not positive definite", "positive definite matrices"
        ) from None
    return covariance

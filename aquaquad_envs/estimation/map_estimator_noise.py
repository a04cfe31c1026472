"""Noise of ranges that is not known beforehand: the receiver's position error, and the rest from the residuals.

An error of the position where range i was taken acts along the line of sight h_i alone. Standard deviations (σ_N, σ_E,
σ_D) of a position fix therefore add to the variance of the range (SPEC §8, field trial)

    σ_i² = σ² + Σ_k h_ik² σ_ik².

σ, the ranging itself, is that at which the normalised residuals u_i = e_i / σ_i are as large as they should be:
Σ min(u_i², k²) = (n - m) E min(χ²₁, k²), n ranges, m unknowns (Huber's proposal 2; k = ∞: Σ u² = n - m). It breaks
down at a share E min(χ²₁, k²) / k² of gross outliers: a half at k = 1, 39 % at k = 1.345, none at k = ∞.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_range

Solution = TypeVar("Solution")


class Adapted(NamedTuple):
    """Outcome of :func:`adapt_noise`."""

    solution: Any
    std: float  # of the ranging alone, the unit of the residuals
    rounds: int
    settled: bool  # False: the last round still changed it


def line_of_sight_std(positions: Any, estimate: Any, position_stds: Any) -> np.ndarray:
    """Standard deviation (n,), m, that errors of ``positions`` (n, 3) with ``position_stds`` (n, 3), m, give a range.

    estimate: (3,), the transponder. A place on the transponder counts with its greatest deviation.
    """
    arms = np.asarray(estimate, dtype=np.float64) - np.asarray(positions, dtype=np.float64)
    stds = np.broadcast_to(np.asarray(position_stds, dtype=np.float64), arms.shape)
    distance = np.linalg.norm(arms, axis=-1)
    along = np.sqrt(np.sum(np.square(arms * stds), axis=-1))
    return np.where(
        distance > 0.0, along / np.where(distance > 0.0, distance, 1.0), stds.max(axis=-1, initial=0.0)
    )


def expected_square(bound: float) -> float:
    """E min(u², bound²) of a standard normal u; 1 for an infinite bound."""
    if not bound < math.inf:
        return 1.0
    inside = math.erf(bound / math.sqrt(2.0))
    density = math.exp(-0.5 * bound * bound) / math.sqrt(2.0 * math.pi)
    return inside - 2.0 * bound * density + bound * bound * (1.0 - inside)


def residual_std(residuals: Any, extra_std: Any, unknowns: int, *, huber: float = 0.0) -> float:
    """σ of the module's equation from ``residuals`` (n,), NaN where missing, whose variances are σ² + ``extra_std``².

    0 where the extra deviations alone explain the residuals. huber: the bound k; 0: none. Raises
    ``InvalidParameterError`` where there are no more residuals than unknowns.
    """
    errors = np.asarray(residuals, dtype=np.float64)
    extra = np.broadcast_to(np.asarray(extra_std, dtype=np.float64), errors.shape)
    heard = np.isfinite(errors)
    squares, extra = np.square(errors[heard]), np.square(extra[heard])
    spare = squares.size - unknowns
    if spare < 1:
        raise InvalidParameterError(
            "residuals", squares.size, f"more than the {unknowns} unknowns", "Give the noise instead."
        )
    check_range("huber", huber, 0, 1e9)
    bound = huber if huber > 0.0 else math.inf
    wanted = spare * expected_square(bound)

    def excess(variance: float) -> float:
        total = variance + extra
        known = total > 0.0
        ratios = np.full(squares.size, np.inf)
        ratios[known] = squares[known] / total[known]
        ratios[squares == 0.0] = 0.0
        return float(np.minimum(ratios, bound * bound).sum()) - wanted

    if excess(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, float(squares.max()) * squares.size
    for _ in range(200):  # bisection: the excess falls with the variance
        middle = 0.5 * (low + high) if low > 0.0 else 1e-3 * high
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
        if high - low <= 1e-12 * high or high < 1e-300:
            break
    return math.sqrt(high)


def adapt_noise(
    solve: Callable[[float], tuple[Solution, Any, Any, int]],
    start_std: float,
    *,
    huber: float = 0.0,
    floor_std: float = 1e-6,
    max_rounds: int = 50,
) -> Adapted:
    """Alternate solution and noise until the noise settles to 1 in 1000.

    ``solve(std)`` returns a solution, its residuals (n,), the extra standard deviations (n,) and the number of
    unknowns. With gross outliers start with a great ``start_std`` and a bound. floor_std: the least std ever tried.
    """
    check_range("start_std", start_std, 0, 1e9, open_low=True)
    check_range("floor_std", floor_std, 0, start_std, open_low=True)
    std = start_std
    for done in range(1, max_rounds + 1):
        solution, residuals, extra, unknowns = solve(std)
        found = max(residual_std(residuals, extra, unknowns, huber=huber), floor_std)
        if abs(found - std) <= 1e-3 * std:
            return Adapted(solution, found, done, True)
        std = found
    return Adapted(solution, std, max_rounds, False)

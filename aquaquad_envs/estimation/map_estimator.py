"""Places of acoustic transponders from ranges, maximum a-posteriori (SPEC §8; equations in ``map_estimator_kernels``).

:func:`estimate_transponders` is the interface for Python; compiled worlds call :func:`solve_point`, one transponder
at a time. Two-way times with unknown sound speed and delay: :mod:`map_estimator_times`. Unknown noise:
:mod:`map_estimator_noise`. Consistency and ellipses: :mod:`map_estimator_statistics`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.map_estimator_kernels import (
    CONVERGED,
    ITERATIONS,
    NOT_FINITE,
    SINGULAR,
    STATUSES,
    MapSettings,
    solve,
    solve_point,
)
from aquaquad_envs.estimation.map_estimator_lanes import LANES

__all__ = [
    "CONVERGED",
    "ITERATIONS",
    "NOT_FINITE",
    "SINGULAR",
    "STATUSES",
    "MapSettings",
    "PointEstimates",
    "estimate_transponders",
    "map_settings",
    "numbers",
    "pack",
    "prior_information",
    "solve_point",
    "unpack",
]

_ROWS, _COLUMNS = np.triu_indices(3)


class PointEstimates(NamedTuple):
    """Solutions of a batch of any shape (...)."""

    estimate: np.ndarray  # (..., 3) m
    covariance: np.ndarray  # (..., 3, 3) m²; inf on the diagonal where singular
    information: np.ndarray  # (..., 3, 3) m⁻²
    status: np.ndarray  # (...) index into STATUSES
    iterations: np.ndarray  # (...) steps, those of the mirror images included
    cost: np.ndarray  # (...) J

    @property
    def converged(self) -> np.ndarray:
        """(...) True where the solution is a minimum of J, to the tolerance."""
        return self.status == CONVERGED

    @property
    def reasons(self) -> list[str]:
        """Why the others are not: the distinct reasons."""
        return [STATUSES[code] for code in np.unique(self.status) if code != CONVERGED]


def map_settings(
    *,
    std_m: float,
    tolerance_m: float = 1e-4,
    max_iterations: int = 100,
    huber: float = 0.0,
    mirror: bool = True,
) -> MapSettings:
    """Checked settings of the kernels.

    std_m: standard deviation of a range, m. tolerance_m: step below which a descent has converged, m. huber: residual,
    in standard deviations, beyond which the loss is linear (1.345 costs 5 % of the efficiency with normal noise), 0
    for the plain square. mirror: look on the other side of the track, too. Raises ``InvalidParameterError``.
    """
    check_range("std_m", std_m, 0, 1e9, open_low=True)
    check_range("tolerance_m", tolerance_m, 0, 1e6, open_low=True)
    check_range("max_iterations", max_iterations, 1, 1e9)
    check_range("huber", huber, 0, 1e9, remedy="0 turns it off; 1.345 is usual.")
    return MapSettings(float(std_m), float(tolerance_m), int(max_iterations), float(huber), bool(mirror))


def pack(matrices: Any) -> np.ndarray:
    """Symmetric (..., 3, 3) as (..., 6): xx, xy, xz, yy, yz, zz."""
    return np.asarray(matrices, dtype=np.float64)[..., _ROWS, _COLUMNS]


def unpack(packed: Any) -> np.ndarray:
    """Inverse of :func:`pack`."""
    packed = np.asarray(packed, dtype=np.float64)
    matrices = np.empty((*packed.shape[:-1], 3, 3))
    matrices[..., _ROWS, _COLUMNS] = packed
    matrices[..., _COLUMNS, _ROWS] = packed
    return matrices


@loop_kernel
def _solve_all(
    count, px, py, pz, ranges, weights, means, priors, settings, estimates, information, status, iterations, costs
):  # fmt: skip
    for i in range(estimates.shape[0]):
        # Two calls: the kernel is compiled for None and for depths, and never asks.
        if pz is None:
            status[i], iterations[i], costs[i] = solve(
                count, px[i], py[i], None, ranges[i], weights[i], means[i], priors[i], settings,
                estimates[i], information[i],
            )  # fmt: skip
        else:
            status[i], iterations[i], costs[i] = solve(
                count, px[i], py[i], pz[i], ranges[i], weights[i], means[i], priors[i], settings,
                estimates[i], information[i],
            )  # fmt: skip


def estimate_transponders(
    positions: Any,
    ranges: Any,
    prior_mean: Any,
    prior_covariance: Any = None,
    *,
    std_m: Any,
    start: Any = None,
    huber: float = 0.0,
    mirror: bool = True,
    tolerance_m: float = 1e-6,
    max_iterations: int = 1000,
) -> PointEstimates:
    """Maximum a-posteriori place of every transponder of a batch of shape (...).

    positions: (..., n, 2) or (..., n, 3), m, where the ranges were taken, depth positive, 0 where not given; ranges:
    (..., n), m, not finite where there was no reply; prior_mean: (..., 3), m; prior_covariance: (..., 3, 3), m²,
    positive definite, or None: no prior, the mean is but the start. std_m: standard deviations, m, one or (..., n).
    start: (..., 3), a warm start (default: the prior mean). Others as :func:`map_settings`. n may be 0.

    Where all positions are at the surface, a solution above it is left for its image below (``mirror``). A
    solution that is not a converged minimum says so in ``status``. Raises ``InvalidParameterError``.
    """
    settings = map_settings(
        std_m=1.0, tolerance_m=tolerance_m, max_iterations=max_iterations, huber=huber, mirror=mirror
    )
    measured = numbers("ranges", ranges)
    places = numbers("positions", positions)
    mean = numbers("prior_mean", prior_mean)
    stds = numbers("std_m", std_m)
    if measured.ndim < 1:
        raise InvalidParameterError("ranges", ranges, "an array, its last axis the measurements")
    count = measured.shape[-1]
    if places.ndim < 2 or places.shape[-2] != count or places.shape[-1] not in (2, 3):
        raise InvalidParameterError("positions", places.shape, f"(..., {count}, 2) or (..., {count}, 3)")
    if mean.ndim < 1 or mean.shape[-1] != 3:
        raise InvalidParameterError("prior_mean", mean.shape, "(..., 3)")
    precision = prior_information(prior_covariance)
    first = mean if start is None else numbers("start", start)
    if first.ndim < 1 or first.shape[-1] != 3:
        raise InvalidParameterError("start", first.shape, "(..., 3)")
    try:
        shape = np.broadcast_shapes(
            measured.shape[:-1], places.shape[:-2], mean.shape[:-1], precision.shape[:-1], first.shape[:-1]
        )
        stds = np.broadcast_to(stds, (*shape, count))
    except ValueError:
        shapes = measured.shape, places.shape, mean.shape, precision.shape, stds.shape, first.shape
        raise InvalidParameterError("shapes", shapes, "shapes that broadcast to one batch") from None
    heard = np.broadcast_to(np.isfinite(measured), (*shape, count))
    if not ((stds > 0) & (stds < np.inf))[heard].all():
        raise InvalidParameterError("std_m", std_m, "positive finite standard deviations, m")
    if not np.isfinite(np.broadcast_to(places, (*shape, *places.shape[-2:]))[heard]).all():
        raise InvalidParameterError("positions", "NaN or infinite", "finite positions of the replies")
    if not (np.isfinite(mean).all() and np.isfinite(first).all()):
        raise InvalidParameterError("prior_mean or start", "NaN or infinite", "finite positions, m")

    batch = int(np.prod(shape, dtype=np.int64))
    padded = -(-max(count, 1) // LANES) * LANES

    def spread(values: np.ndarray, width: int, filling: float = 0.0) -> np.ndarray:
        """(batch, width) of values (..., m), m ≤ width."""
        rows = np.full((batch, width), filling)
        rows[:, : values.shape[-1]] = np.broadcast_to(values, (*shape, values.shape[-1])).reshape(batch, -1)
        return rows

    coordinates: list[np.ndarray | None] = [
        spread(np.where(np.isfinite(places[..., k]), places[..., k], 0.0), padded)
        for k in range(places.shape[-1])
    ]
    if places.shape[-1] < 3 or not np.any(coordinates[2]):
        coordinates[2:] = [None]  # all at the surface: as in worlds
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.where(heard, 1.0 / np.square(stds), 0.0)
    problems = (
        *coordinates, spread(np.where(heard, measured, np.nan), padded, np.nan), spread(weights, padded),
        spread(mean, 3), spread(precision, 6),
    )  # fmt: skip
    best = _solutions(count, problems, settings, spread(first, 3))
    if start is None and huber > 0.0:
        # Far from the solution every range is an outlier: the loss's linear part has minima that the square has not.
        plain = _solutions(count, problems, settings._replace(huber=0.0), spread(first, 3))
        other = _solutions(count, problems, settings, plain.estimate)
        lower = other.cost < best.cost
        for kept, found in zip(best, other, strict=True):
            kept[lower] = found[lower]
    matrices = unpack(best.information)
    return PointEstimates(
        *(
            values.reshape((*shape, *values.shape[1:]))
            for values in (best.estimate, _inverse(matrices, best.status), matrices, *best[2:])
        )
    )


class _Solutions(NamedTuple):
    """What :func:`_solve_all` writes, a row a problem."""

    estimate: np.ndarray
    information: np.ndarray  # packed
    status: np.ndarray
    iterations: np.ndarray
    cost: np.ndarray


def _solutions(count: int, problems: tuple[Any, ...], settings: MapSettings, start: np.ndarray) -> _Solutions:
    batch = len(start)
    found = _Solutions(
        start.copy(),
        np.zeros((batch, 6)),
        np.zeros(batch, np.int64),
        np.zeros(batch, np.int64),
        np.zeros(batch),
    )
    _solve_all(count, *problems, settings, *found)
    return found


def _inverse(information: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Covariances; infinite variances where there is none."""
    regular = (status != SINGULAR) & (status != NOT_FINITE)
    covariance = np.zeros(information.shape)
    covariance[..., [0, 1, 2], [0, 1, 2]] = np.inf
    covariance[regular] = np.linalg.inv(information[regular])
    return covariance


def prior_information(covariance: Any) -> np.ndarray:
    """Packed inverse (..., 6) of a prior's covariance; zero where there is none."""
    if covariance is None:
        return np.zeros(6)
    matrices = numbers("prior_covariance", covariance)
    if matrices.ndim < 2 or matrices.shape[-2:] != (3, 3) or not np.isfinite(matrices).all():
        raise InvalidParameterError("prior_covariance", matrices.shape, "finite matrices (..., 3, 3), m²")
    scale = np.abs(matrices).max(initial=0.0)
    if not np.allclose(matrices, matrices.swapaxes(-1, -2), rtol=1e-9, atol=1e-12 * scale):
        raise InvalidParameterError("prior_covariance", "not symmetric", "symmetric matrices")
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        raise InvalidParameterError(
            "prior_covariance", "not positive definite", "positive definite matrices, m²",
            "Give what is known exactly a small positive variance, what is unknown a great one.",
        ) from None  # fmt: skip
    return pack(np.linalg.inv(matrices))


def numbers(name: str, values: Any) -> np.ndarray:
    """``values`` as an array of float64; raises ``InvalidParameterError``."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidParameterError(name, values, "an array of numbers") from None

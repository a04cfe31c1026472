"""Place of a transponder from two-way travel times, with unknown sound speed and constant delay on request.

Times t_i of a signal sent at a_i and received at b_i, by a vehicle that moves meanwhile, from a transponder at p:

    t_i = (‖p - a_i‖ + ‖p - b_i‖) / c + τ + noise,

c the mean speed of sound along the path (rays are straight), τ by what the turn-around differs from the delay that
is already taken off. Up to five unknowns u = (p, c, τ), with a normal prior on each, minimise the same cost as
``map_estimator_kernels`` with residuals in seconds. c and τ are told apart, and from the depth, by ranges
of different lengths only; given as known they are left out of the solution. For surveys, not for hot loops.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.map_estimator import map_settings, numbers, prior_information, unpack
from aquaquad_envs.estimation.map_estimator_kernels import CONVERGED, STATUSES
from aquaquad_envs.estimation.map_estimator_times_kernels import DELAY, SIZE, SPEED, solve_times, two_way_time


class TimeEstimates(NamedTuple):
    """Solutions of a batch of any shape (...)."""

    unknowns: np.ndarray  # (..., 5): x, y, z (m), c (m/s), τ (s)
    covariance: np.ndarray  # (..., 5, 5); 0 for what is known, inf on the diagonal where singular
    residuals_s: np.ndarray  # (..., n) measured minus modelled time; NaN where there was none
    status: np.ndarray  # (...) index into STATUSES
    iterations: np.ndarray  # (...)
    cost: np.ndarray  # (...)

    @property
    def position_m(self) -> np.ndarray:
        """(..., 3)."""
        return self.unknowns[..., :3]

    @property
    def sound_speed_m_s(self) -> np.ndarray:
        """(...)."""
        return self.unknowns[..., SPEED]

    @property
    def delay_s(self) -> np.ndarray:
        """(...)."""
        return self.unknowns[..., DELAY]

    @property
    def converged(self) -> np.ndarray:
        """(...) True where the solution is a minimum of the cost, to the tolerance."""
        return self.status == CONVERGED

    @property
    def reasons(self) -> list[str]:
        """Why the others are not: the distinct reasons."""
        return [STATUSES[code] for code in np.unique(self.status) if code != CONVERGED]


@loop_kernel
def _solve_all(
    transmit, receive, times, weights, means, prior, free, settings, unknowns, covariances, residuals, status,
    iterations, costs,
):  # fmt: skip
    for i in range(times.shape[0]):
        u = unknowns[i]
        status[i], iterations[i], costs[i], covariance = solve_times(
            transmit[i], receive[i], times[i], weights[i], means[i], prior[i], free, settings, u
        )
        for j in range(SIZE):
            for k in range(SIZE):
                covariances[i, j, k] = covariance[j, k]
        for j in range(times.shape[1]):
            residuals[i, j] = times[i, j] - two_way_time(transmit[i, j], receive[i, j], u)


def estimate_from_times(
    transmit: Any,
    receive: Any,
    times_s: Any,
    prior_mean: Any,
    prior_covariance: Any = None,
    *,
    time_std_s: Any,
    sound_speed_m_s: float = 1500.0,
    sound_speed_std_m_s: float = 0.0,
    delay_s: float = 0.0,
    delay_std_s: float = 0.0,
    start: Any = None,
    huber: float = 0.0,
    mirror: bool = True,
    tolerance_m: float = 1e-6,
    max_iterations: int = 500,
) -> TimeEstimates:
    """Place of every transponder of a batch of shape (...) from two-way times.

    times_s: (..., n), s, not finite where missing, of signals sent at ``transmit`` and received at ``receive``
    (..., n, 3), m. prior_mean: (..., 3), m; prior_covariance: (..., 3, 3), m², or None: none. time_std_s: standard
    deviations of the times, one or (..., n). sound_speed_std_m_s, delay_std_s: those of the prior about
    ``sound_speed_m_s`` and ``delay_s``; 0: known; inf: unknown. start: (..., 5), former ``unknowns``. Others as
    :func:`~aquaquad_envs.estimation.map_estimator.map_settings`; a tolerance of 1 m in position counts as 1000 m/s in
    speed and 1 m of path in delay. What is not a minimum says so in ``status``. Raises ``InvalidParameterError``.
    """
    settings = map_settings(
        std_m=1.0, tolerance_m=tolerance_m, max_iterations=max_iterations, huber=huber, mirror=mirror
    )
    check_range("sound_speed_m_s", sound_speed_m_s, 1, 1e5)
    check_range("sound_speed_std_m_s", sound_speed_std_m_s, 0, np.inf, remedy="0: known; inf: unknown.")
    check_range("delay_s", delay_s, -1e6, 1e6)
    check_range("delay_std_s", delay_std_s, 0, np.inf, remedy="0: known; inf: unknown.")
    times = numbers("times_s", times_s)
    if times.ndim < 1:
        raise InvalidParameterError("times_s", times_s, "an array, its last axis the measurements")
    count = times.shape[-1]
    sent, received = numbers("transmit", transmit), numbers("receive", receive)
    place = numbers("prior_mean", prior_mean)
    stds = numbers("time_std_s", time_std_s)
    packed = prior_information(prior_covariance)
    for name, array, tail in (
        ("transmit", sent, (count, 3)),
        ("receive", received, (count, 3)),
        ("prior_mean", place, (3,)),
    ):
        if array.shape[-len(tail) :] != tail:
            raise InvalidParameterError(name, array.shape, f"(..., {', '.join(map(str, tail))})")
    fixed = [sound_speed_m_s, delay_s]
    first = np.concatenate([place, np.broadcast_to(fixed, (*place.shape[:-1], 2))], axis=-1)
    if start is not None:
        first = numbers("start", start).copy()
        if first.shape[-1:] != (SIZE,) or not (first[..., SPEED] > 0).all():
            raise InvalidParameterError("start", first.shape, f"(..., {SIZE}), its fourth > 0 m/s")
    free = np.array([True, True, True, sound_speed_std_m_s > 0.0, delay_std_s > 0.0])
    first[..., ~free] = np.array([0.0, 0.0, 0.0, *fixed])[~free]
    try:
        shape = np.broadcast_shapes(
            times.shape[:-1], sent.shape[:-2], received.shape[:-2], place.shape[:-1], packed.shape[:-1],
            first.shape[:-1],
        )  # fmt: skip
        stds = np.broadcast_to(stds, (*shape, count))
    except ValueError:
        shapes = times.shape, sent.shape, received.shape, place.shape, packed.shape, stds.shape, first.shape
        raise InvalidParameterError("shapes", shapes, "shapes that broadcast to one batch") from None
    heard = np.broadcast_to(np.isfinite(times), (*shape, count))
    if not ((stds > 0) & (stds < np.inf))[heard].all():
        raise InvalidParameterError("time_std_s", time_std_s, "positive finite standard deviations, s")
    for name, array in (("transmit", sent), ("receive", received)):
        if not np.isfinite(np.broadcast_to(array, (*shape, count, 3))[heard]).all():
            raise InvalidParameterError(name, "NaN or infinite", "finite positions of the replies, m")
    if not (np.isfinite(place).all() and np.isfinite(first).all()):
        raise InvalidParameterError("prior_mean or start", "NaN or infinite", "finite numbers")

    batch = int(np.prod(shape, dtype=np.int64))

    def spread(values: np.ndarray, *tail: int) -> np.ndarray:
        return np.broadcast_to(values, (*shape, *tail)).reshape(batch, *tail).copy()

    means = np.zeros((batch, SIZE))
    means[:, :3] = spread(place, 3)
    means[:, 3:] = fixed
    prior = np.zeros((batch, SIZE, SIZE))
    prior[:, :3, :3] = unpack(spread(packed, 6))
    for k, std in ((SPEED, sound_speed_std_m_s), (DELAY, delay_std_s)):
        prior[:, k, k] = std**-2.0 if std > 0.0 else 0.0
    unknowns = spread(first, SIZE)
    covariances = np.zeros((batch, SIZE, SIZE))
    residuals = np.zeros((batch, count))
    status = np.zeros(batch, dtype=np.int64)
    iterations = np.zeros(batch, dtype=np.int64)
    costs = np.zeros(batch)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.where(heard, 1.0 / np.square(stds), 0.0)
    _solve_all(
        spread(sent, count, 3), spread(received, count, 3), spread(np.where(heard, times, np.nan), count),
        spread(weights, count), means, prior, free, settings, unknowns, covariances, residuals, status,
        iterations, costs,
    )  # fmt: skip
    return TimeEstimates(
        unknowns.reshape(*shape, SIZE),
        covariances.reshape(*shape, SIZE, SIZE),
        residuals.reshape(*shape, count),
        status.reshape(shape),
        iterations.reshape(shape),
        costs.reshape(shape),
    )

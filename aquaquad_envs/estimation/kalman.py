"""Kalman filters for batches of tracks: bearing, range and TDOA in any mix, with measurements missing.

:class:`TrackerBatch` is the interface for Python; inside compiled worlds call the scalar kernels of
:mod:`kalman_motion`, :mod:`kalman_ekf` and :mod:`kalman_ukf` on one track at a time. Both run the same code.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.kalman_ekf import ekf_update, ekf_update_sequential
from aquaquad_envs.estimation.kalman_motion import Motion, predict, states_of
from aquaquad_envs.estimation.kalman_ukf import (
    make_sigma_points,
    ukf_cycle_carried,
    ukf_update,
)
from aquaquad_envs.estimation.kalman_update import work_shape
from aquaquad_envs.estimation.small_matrices import cholesky, mahalanobis_squared
from aquaquad_envs.sensing.measurements import KINDS, TDOA

EKF = 0
EKF_SEQUENTIAL = 1
UKF = 2
#: Code of each filter by the name that users write.
METHODS = {"ekf": EKF, "ekf-sequential": EKF_SEQUENTIAL, "ukf": UKF}


@kernel
def state_nees(state, covariance, truth, work):
    """(x - x̂)ᵀ P⁻¹ (x - x̂) of one track: ``state``, ``truth`` (n,), ``covariance`` (n, n).

    χ² with n degrees of freedom for a consistent filter. ``work``: scratch as for an update.
    """
    n = state.shape[0]
    cholesky(covariance, work)
    for i in range(n):
        work[n, i] = truth[i] - state[i]
    return mahalanobis_squared(work, work[n], n)


@kernel
def position_nees(state, covariance, x, y):
    """NEES of the position alone (χ² with two degrees of freedom); ``inf`` for a singular covariance."""
    dx = x - state[0]
    dy = y - state[1]
    a = covariance[0, 0]
    b = covariance[0, 1]
    d = covariance[1, 1]
    determinant = a * d - b * b
    if not determinant > 0.0:
        return np.inf
    return (d * dx * dx - 2.0 * b * dx * dy + a * dy * dy) / determinant


@loop_kernel
def _predict_all(states, covariances, dts, motion):
    for i in range(states.shape[0]):
        predict(states[i], covariances[i], dts[i], motion)


@loop_kernel
def _update_all(
    method, states, covariances, work, kinds, sensors, others, values, sigmas, mask, sound_speed, wrap, points,
    used, nis, repairs,
):  # fmt: skip
    count = kinds.shape[1]
    for i in range(states.shape[0]):
        if method == UKF:
            used[i], nis[i], repaired = ukf_update(
                states[i], covariances[i], work, kinds[i], sensors[i], others[i], values[i], sigmas[i],
                mask[i], count, sound_speed, wrap, points,
            )  # fmt: skip
        elif method == EKF_SEQUENTIAL:
            used[i], nis[i], repaired = ekf_update_sequential(
                states[i], covariances[i], work, kinds[i], sensors[i], others[i], values[i], sigmas[i],
                mask[i], count, sound_speed, wrap,
            )  # fmt: skip
        else:
            used[i], nis[i], repaired = ekf_update(
                states[i], covariances[i], work, kinds[i], sensors[i], others[i], values[i], sigmas[i],
                mask[i], count, sound_speed, wrap,
            )  # fmt: skip
        repairs[i] += repaired


@loop_kernel
def _cycle_carried_all(
    states, covariances, work, dts, motion, kinds, sensors, others, values, sigmas, mask, sound_speed, wrap,
    points, used, nis, repairs,
):  # fmt: skip
    count = kinds.shape[1]
    for i in range(states.shape[0]):
        used[i], nis[i], repaired = ukf_cycle_carried(
            states[i], covariances[i], work, dts[i], motion, kinds[i], sensors[i], others[i], values[i],
            sigmas[i], mask[i], count, sound_speed, wrap, points,
        )  # fmt: skip
        repairs[i] += repaired


@loop_kernel
def _nees_all(states, covariances, truths, work, out):
    for i in range(states.shape[0]):
        out[i] = state_nees(states[i], covariances[i], truths[i], work)


class TrackerBatch:
    """``num_worlds`` × ``num_tracks`` independent Kalman filters.

    Attributes
    ----------
    states: (num_worlds, num_tracks, n), n = 4 or 6: x, y (m), u, v (m/s), ax, ay (m/s²).
    covariances: (num_worlds, num_tracks, n, n), symmetric positive definite.
    used: (num_worlds, num_tracks) measurements used by the last update; nis: their normalised
        innovation squared, χ² with ``used`` degrees of freedom if the model is matched.
    repairs: (num_worlds, num_tracks) how often a covariance had lost positive definiteness and was repaired.

    The arrays are updated in place: copy what you keep. Results do not depend on the size of the batch.
    """

    def __init__(
        self,
        num_worlds: int,
        motion: Motion,
        *,
        num_tracks: int = 1,
        method: str = "ukf",
        alpha: float = 1e-3,
        beta: float = 2.0,
        kappa: float = 0.0,
        sound_speed_m_s: float = 1500.0,
        wrap: bool = True,
        carry_sigma_points: bool = False,
    ) -> None:
        """Filters at the origin with unit covariance, to be placed by :meth:`place`.

        motion: from :func:`~aquaquad_envs.estimation.kalman_motion.make_motion`. method: ``"ukf"``,
        ``"ekf"`` (all measurements of an update together) or ``"ekf-sequential"``. alpha, beta, kappa: sigma
        points of the UKF (defaults as published). wrap: bearing residuals and means are taken on
        the circle; False: as plain numbers, as published. carry_sigma_points: :meth:`cycle` measures
        with the points that went through the prediction (published, filterpy 1.4) instead of points
        drawn from the predicted covariance (default, filterpy 2). Raises ``InvalidParameterError``.
        """
        for name, value in (("num_worlds", num_worlds), ("num_tracks", num_tracks)):
            if not isinstance(value, int | np.integer) or value < 1:
                raise InvalidParameterError(name, value, "a whole number of at least 1")
        check_choice("method", method, METHODS)
        check_range("sound_speed_m_s", sound_speed_m_s, 1, 1e5)
        if carry_sigma_points and method != "ukf":
            raise InvalidParameterError("carry_sigma_points", True, "False where method is not 'ukf'")
        self.motion = motion
        self.method = method
        self.points = make_sigma_points(states_of(motion), alpha=alpha, beta=beta, kappa=kappa)
        self.sound_speed_m_s = float(sound_speed_m_s)
        self.wrap = bool(wrap)
        self.carry_sigma_points = bool(carry_sigma_points)
        n = states_of(motion)
        self._shape = (int(num_worlds), int(num_tracks))
        self.states = np.zeros((*self._shape, n))
        self.covariances = np.tile(np.eye(n), (*self._shape, 1, 1))
        self.used = np.zeros(self._shape, dtype=np.int64)
        self.nis = np.zeros(self._shape)
        self.repairs = np.zeros(self._shape, dtype=np.int64)

    def place(self, states: Any, covariances: Any, *, mask: Any = None) -> None:
        """Start tracks at ``states`` (..., n) with ``covariances`` (..., n, n), both broadcast to the batch.

        mask: (num_worlds, num_tracks), True where to do so (default everywhere); repairs are set to
        0 there. Raises ``InvalidParameterError`` for values that are not finite and covariances
        that are not symmetric positive definite.
        """
        n = self.states.shape[-1]
        states = self._spread("states", states, n)
        covariances = self._spread("covariances", covariances, n, n)
        chosen = np.ones(self._shape, dtype=bool) if mask is None else self._spread("mask", mask, dtype=bool)
        for name, values in (("states", states), ("covariances", covariances)):
            if not np.isfinite(values[chosen]).all():
                raise InvalidParameterError(name, "NaN or infinite", "finite values")
        matrices = covariances[chosen]
        scale = np.abs(matrices).max(initial=0.0)
        if not np.allclose(matrices, matrices.swapaxes(-1, -2), rtol=1e-9, atol=1e-12 * scale):
            raise InvalidParameterError("covariances", "not symmetric", "symmetric matrices")
        try:
            np.linalg.cholesky(matrices)
        except np.linalg.LinAlgError:
            raise InvalidParameterError(
                "covariances", "not positive definite", "positive definite matrices",
                "Give what is known exactly a small positive variance.",
            ) from None  # fmt: skip
        self.states[chosen] = states[chosen]
        self.covariances[chosen] = 0.5 * (matrices + matrices.swapaxes(-1, -2))
        self.repairs[chosen] = 0

    def predict(self, dt_s: Any) -> None:
        """Move all tracks ``dt_s`` ≥ 0 seconds on: a number, or an array that broadcasts to the batch."""
        _predict_all(*self._flat(self.states, self.covariances, self._checked_steps(dt_s)), self.motion)

    def update(
        self, kinds: Any, sensors: Any, values: Any, stds: Any, *, others: Any = None, mask: Any = None
    ) -> None:
        """Update all tracks by up to M measurements each.

        kinds: ``"bearing"``, ``"range"``, ``"tdoa"``, or an array of their codes; values: measurement in
        rad, m or s; stds: its standard deviation > 0, same unit; mask: False where a measurement is
        missing, as is one whose value is not finite. Each broadcasts to (num_worlds, num_tracks, M).
        sensors, others: (..., M, 2) positions, m; ``others`` is sensor j of a TDOA (r_i - r_j)/c. M is
        the last length of ``values``. Raises ``InvalidParameterError``; the tracks are then untouched.
        """
        rows = self._checked_rows(kinds, sensors, values, stds, others, mask)
        _update_all(
            METHODS[self.method], *self._flat(self.states, self.covariances), self._work(rows), *rows,
            self.sound_speed_m_s, self.wrap, self.points, *self._flat(self.used, self.nis, self.repairs),
        )  # fmt: skip

    def cycle(
        self,
        dt_s: Any,
        kinds: Any,
        sensors: Any,
        values: Any,
        stds: Any,
        *,
        others: Any = None,
        mask: Any = None,
    ) -> None:
        """:meth:`predict` and :meth:`update` in one call; sigma points are carried through if so chosen."""
        rows = self._checked_rows(kinds, sensors, values, stds, others, mask)
        steps = self._checked_steps(dt_s)
        if not self.carry_sigma_points:
            _predict_all(*self._flat(self.states, self.covariances, steps), self.motion)
            _update_all(
                METHODS[self.method], *self._flat(self.states, self.covariances), self._work(rows), *rows,
                self.sound_speed_m_s, self.wrap, self.points, *self._flat(self.used, self.nis, self.repairs),
            )  # fmt: skip
            return
        _cycle_carried_all(
            *self._flat(self.states, self.covariances), self._work(rows), *self._flat(steps), self.motion,
            *rows, self.sound_speed_m_s, self.wrap, self.points,
            *self._flat(self.used, self.nis, self.repairs),
        )  # fmt: skip

    def nees(self, truths: Any) -> np.ndarray:
        """Normalised estimation error squared of the whole state against ``truths`` (..., n): (worlds, tracks)."""
        n = self.states.shape[-1]
        out = np.zeros(self._shape)
        _nees_all(
            *self._flat(self.states, self.covariances, self._spread("truths", truths, n)),
            np.zeros(work_shape(n, 1)), out.reshape(-1),
        )  # fmt: skip
        return out

    def _flat(self, *arrays: np.ndarray) -> list[np.ndarray]:
        """Views with worlds and tracks as one axis."""
        return [array.reshape(self._shape[0] * self._shape[1], *array.shape[2:]) for array in arrays]

    def _work(self, rows: list[np.ndarray]) -> np.ndarray:
        return np.empty(work_shape(self.states.shape[-1], rows[0].shape[1]))

    def _spread(self, name: str, values: Any, *tail: int, dtype: Any = np.float64) -> np.ndarray:
        """``values`` as a contiguous array of shape (worlds, tracks, *tail)."""
        shape = (*self._shape, *tail)
        try:
            array = np.asarray(values, dtype=dtype)
            return np.ascontiguousarray(np.broadcast_to(array, shape))
        except (TypeError, ValueError):
            raise InvalidParameterError(
                name, np.shape(values), f"numbers of a shape that broadcasts to {shape}"
            ) from None

    def _checked_steps(self, dt_s: Any) -> np.ndarray:
        steps = self._spread("dt_s", dt_s)
        if not (np.isfinite(steps).all() and (steps >= 0).all()):
            raise InvalidParameterError("dt_s", dt_s, "finite seconds of at least 0")
        return steps

    def _checked_rows(
        self, kinds: Any, sensors: Any, values: Any, stds: Any, others: Any, mask: Any
    ) -> list[np.ndarray]:
        """Kinds, sensors, others, values, standard deviations and mask of every track, flat and clean."""
        if np.ndim(values) < 1:
            raise InvalidParameterError("values", values, "an array, its last axis the measurements")
        count = np.shape(values)[-1]
        if isinstance(kinds, str):
            check_choice("kinds", kinds, KINDS)
            kinds = KINDS[kinds]
        codes = self._spread("kinds", kinds, count, dtype=np.int64)
        if count and not (codes.min() >= 0 and codes.max() <= TDOA):
            raise InvalidParameterError(
                "kinds", [int(codes.min()), int(codes.max())], f"codes in {sorted(KINDS.values())}"
            )
        if others is None:
            if (codes == TDOA).any():
                raise InvalidParameterError(
                    "others", None, "the second sensor of every TDOA", "Shape (M, 2)."
                )
            others = sensors
        measured = self._spread("values", values, count)
        deviations = self._spread("stds", stds, count)
        here = self._spread("sensors", sensors, count, 2)
        there = self._spread("others", others, count, 2)
        present = np.isfinite(measured)
        if mask is not None:
            present &= self._spread("mask", mask, count, dtype=bool)
        # Whole arrays first: sums along short axes cost more than the filters.
        fine = (deviations > 0) & (deviations < np.inf)
        if not (fine.all() or (fine | ~present).all()):
            raise InvalidParameterError("stds", stds, "positive finite standard deviations")
        known = np.isfinite(here) & np.isfinite(there)
        if not (known.all() or known[present].all()):
            raise InvalidParameterError(
                "sensors", "NaN or infinite", "finite positions of sensors that measure"
            )
        return self._flat(codes, here, there, measured, deviations, present)

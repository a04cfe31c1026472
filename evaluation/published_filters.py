"""One track, simulated once and filtered by ours and by filterpy's filters: the same noise for every filter."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.estimation.kalman import EKF, METHODS
from aquaquad_envs.estimation.kalman_ekf import ekf_update
from aquaquad_envs.estimation.kalman_motion import (
    PUBLISHED_STEP_VARIANCES,
    Motion,
    add_process_noise,
    make_motion,
    move_rows,
    predict,
)
from aquaquad_envs.estimation.kalman_ukf import make_sigma_points, ukf_cycle_carried, ukf_update
from aquaquad_envs.estimation.kalman_update import work_shape
from aquaquad_envs.physics.randomness import SOURCES, seed_streams
from aquaquad_envs.sensing.measurements import (
    BEARING,
    KINDS,
    measurement_gradient,
    noisy_measurement,
    predicted_measurement,
    wrap_angle,
)
from evaluation.published_values import ASSUMED_STD, DT_S, SOUND_SPEED_M_S

#: Components of the error that the source tabulates, in the order of the state.
COMPONENTS = ("x", "y", "u", "v")
#: The UKF that measures with the points it carried through the prediction, as App. B does.
_CARRIED = len(METHODS)


@dataclass(frozen=True, kw_only=True)
class Track:
    """A target's true track with what the sensors do, and what a filter is told: K steps, M measurements each."""

    kind: str
    truth: np.ndarray  # (K, 4): x, y, m, and u, v, m/s, at the measurements
    sensors: np.ndarray  # (K, M, 2), m
    others: np.ndarray  # (K, M, 2), m: sensor j of a TDOA, else as ``sensors``
    noise_std: float  # rad, m or s
    start: np.ndarray  # (6,) first estimate
    prior: np.ndarray  # (6,) variances of its error
    assumed_std: float = ASSUMED_STD
    dt_s: float = DT_S

    @property
    def times(self) -> np.ndarray:
        """When it is measured, s."""
        return self.dt_s * np.arange(1, len(self.truth) + 1)


class Setting(NamedTuple):
    """A filter: ``"ekf"`` or ``"ukf"``, its motion model, and whether angles are wrapped."""

    method: str
    model: str
    wrap: bool
    carried: bool = False

    @property
    def motion(self) -> Motion:
        """The motion with the published process noise."""
        return make_motion(self.model, step_variances=PUBLISHED_STEP_VARIANCES)


class Run(NamedTuple):
    """What one run of a filter gives."""

    mse: np.ndarray  # (4,) mean square error of x, y, u, v over all steps
    errors: np.ndarray  # (S, 4) estimate minus truth at every n-th step
    seconds: float  # of processor time inside the filter, which other work on the machine hardly changes


@loop_kernel
def _simulate(kind, truth, sensors, others, std, sound_speed, stream, values):
    for k in range(values.shape[0]):
        for i in range(values.shape[1]):
            exact = predicted_measurement(
                kind, truth[k, 0], truth[k, 1], sensors[k, i, 0], sensors[k, i, 1], others[k, i, 0],
                others[k, i, 1], sound_speed,
            )  # fmt: skip
            values[k, i] = noisy_measurement(kind, exact, std, stream)


@loop_kernel
def _filter(
    method, state, covariance, work, dt, motion, kinds, sensors, others, values, sigmas, mask, sound_speed,
    wrap, points, truth, squares, every, errors,
):  # fmt: skip
    count = values.shape[1]
    for k in range(values.shape[0]):
        if method == _CARRIED:
            ukf_cycle_carried(
                state, covariance, work, dt, motion, kinds, sensors[k], others[k], values[k], sigmas, mask,
                count, sound_speed, wrap, points,
            )  # fmt: skip
        else:
            predict(state, covariance, dt, motion)
            if method == EKF:
                ekf_update(
                    state, covariance, work, kinds, sensors[k], others[k], values[k], sigmas, mask, count,
                    sound_speed, wrap,
                )  # fmt: skip
            else:
                ukf_update(
                    state, covariance, work, kinds, sensors[k], others[k], values[k], sigmas, mask, count,
                    sound_speed, wrap, points,
                )  # fmt: skip
        for i in range(4):
            error = state[i] - truth[k, i]
            squares[i] += error * error
            if (k + 1) % every == 0:
                errors[(k + 1) // every - 1, i] = error


@loop_kernel
def _measure(kind, sensors, others, x, y, sound_speed, values, gradients):
    for i in range(values.shape[0]):
        values[i] = predicted_measurement(
            kind, x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
        )
        gradients[i, 0], gradients[i, 1] = measurement_gradient(
            kind, x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
        )


@loop_kernel
def _wrapped(angles, out):
    for i in range(angles.size):
        out.flat[i] = wrap_angle(angles.flat[i])


@loop_kernel
def _linear_motion(dt, motion, transition, noise):
    move_rows(transition, transition.shape[0], dt, motion)
    add_process_noise(noise, dt, motion)


def measurements(track: Track, seed: int) -> np.ndarray:
    """Noisy measurements of ``track`` (K, M), drawn from ``seed`` alone."""
    stream = seed_streams(seed)[SOURCES.index("sensor")].copy()
    values = np.empty(track.sensors.shape[:2])
    _simulate(
        KINDS[track.kind], track.truth, track.sensors, track.others, track.noise_std, SOUND_SPEED_M_S, stream,
        values,
    )  # fmt: skip
    return values


def run_ours(track: Track, setting: Setting, values: np.ndarray, *, every: int = 1) -> Run:
    """Our filter over ``values`` (the first steps of ``track``); errors are kept at every ``every``-th step."""
    steps, count = values.shape
    squares, errors = np.zeros(4), np.empty((steps // every, 4))
    method = _CARRIED if setting.carried else METHODS[setting.method]
    arguments = (
        method, track.start.copy(), np.diag(track.prior), np.zeros(work_shape(6, count)), track.dt_s,
        setting.motion, np.full(count, KINDS[track.kind]), track.sensors, track.others, values,
        np.full(count, track.assumed_std), np.ones(count, dtype=bool), SOUND_SPEED_M_S, setting.wrap,
        make_sigma_points(6), track.truth, squares, every, errors,
    )  # fmt: skip
    begun = time.thread_time()
    _filter(*arguments)
    return Run(squares / steps, errors, time.thread_time() - begun)


def filterpy_version() -> str | None:
    """The version of filterpy, None where it is not installed."""
    try:
        return metadata.version("filterpy")
    except metadata.PackageNotFoundError:
        return None


def run_filterpy(track: Track, setting: Setting, values: np.ndarray) -> Run:
    """As :func:`run_ours` by filterpy's filter of the same model; errors at every step.

    Only the filter is theirs: motion, noise, measurement and Jacobian are our kernels'. Raises ``ImportError`` where it
    is not installed.
    """
    step = _filterpy_step(track, setting, values.shape[1])
    errors = np.empty((len(values), 4))
    begun = time.thread_time()
    for k, value in enumerate(values):
        errors[k] = step(track.sensors[k], track.others[k], value)[:4]
    seconds = time.thread_time() - begun
    errors -= track.truth[: len(values)]
    return Run((errors**2).mean(axis=0), errors, seconds)


def _filterpy_step(track: Track, setting: Setting, count: int) -> Callable[..., np.ndarray]:
    """A function that predicts, updates by ``(sensors, others, values)`` and returns filterpy's estimate."""
    library = importlib.import_module("filterpy.kalman")
    kind = KINDS[track.kind]
    transition, noise = np.eye(6), np.zeros((6, 6))
    _linear_motion(track.dt_s, setting.motion, transition, noise)
    here: dict[str, Any] = {}
    predicted, gradients, turned = np.empty(count), np.empty((count, 2)), np.empty(count)

    def measure(state: np.ndarray) -> np.ndarray:
        _measure(
            kind, here["sensors"], here["others"], state[0], state[1], SOUND_SPEED_M_S, predicted, gradients
        )
        return predicted.copy()

    def jacobian(state: np.ndarray) -> np.ndarray:
        measure(state)
        return np.concatenate([gradients, np.zeros((count, 4))], axis=1)

    def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        _wrapped(np.subtract(a, b), turned)
        return turned.copy()

    wraps = setting.wrap and kind == BEARING
    if setting.method == "ekf":
        found = library.ExtendedKalmanFilter(6, count)
        found.F = transition
        options: dict[str, Any] = {"residual": difference} if wraps else {}

        def update(value: np.ndarray) -> None:
            found.update(value, jacobian, measure, **options)

    else:
        # Their sigma points, at the values that ours have by default.
        points = library.MerweScaledSigmaPoints(6, alpha=1e-3, beta=2.0, kappa=0.0)
        found = library.UnscentedKalmanFilter(
            6, count, track.dt_s, hx=measure, fx=lambda state, _: transition @ state, points=points
        )
        if wraps:
            found.residual_z = difference
            # About the centre point, where the wrapped differences are small.
            found.z_mean = lambda z, weights: z[0] + weights @ np.array([difference(row, z[0]) for row in z])
        update = found.update
    found.x, found.P = track.start.copy(), np.diag(track.prior)
    found.Q, found.R = noise, track.assumed_std**2 * np.eye(count)

    def step(sensors: np.ndarray, others: np.ndarray, value: np.ndarray) -> np.ndarray:
        here.update(sensors=sensors, others=others)
        found.predict()
        update(value)
        return np.asarray(found.x)

    return step


def settled_s(errors: np.ndarray, times: np.ndarray, first: np.ndarray, share: float = 0.1) -> float:
    """When the mean error over runs first is at most ``share`` of ``first``; NaN if it never is.

    errors: (runs, S, d), d components of one kind; times: (S,), s; first: (d,) error of the first estimate. The mean
    over runs shows how a filter forgets its start; noise averages out, so it says nothing of the error that stays.
    """
    bias = np.linalg.norm(errors.mean(axis=0), axis=-1)
    below = np.flatnonzero(bias <= share * np.linalg.norm(first))
    return float(times[below[0]]) if len(below) else float("nan")


def mean_and_error(values: Any) -> dict[str, float]:
    """Mean, standard error of it and number of ``values``."""
    array = np.asarray(values, dtype=float)
    count = len(array)
    error = float(np.std(array, ddof=1) / np.sqrt(count)) if count > 1 else float("nan")
    return {"mean": float(np.mean(array)), "se": error, "n": count}

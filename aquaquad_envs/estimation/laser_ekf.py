"""Where the centre of a laser's disc is, from intensity and motion: the extended Kalman filter in two forms.

Position d of the centre seen from the receiver, r = |d|, and the reading's model I(r) of
:mod:`~aquaquad_envs.sensing.laser` at a fixed height.

Polar, as published (Toombs 2022, 5.2.2): state (r, θ, ṙ, θ̇), constant rates, readings (I, v_x, v_y), the
last two the centre's velocity relative to the receiver,

    v_x = ṙ cos θ - r θ̇ sin θ,   v_y = ṙ sin θ + r θ̇ cos θ.

It is singular at r = 0, where one wants to be, and constant polar rates are no straight line.

Cartesian, the default: state (d_x, d_y, u, v) with (u, v) the centre's velocity over ground; the receiver's
own displacement is known and taken off d. So the submerged vehicle's velocity need not be known: it is
estimated. With a displacement of zero (u, v) is the relative velocity, and the same readings may be given.

Both are ill served by a flat top: where ∂I/∂r vanishes at the estimate, a reading changes nothing, even one that
says plainly that the estimate is wrong. Where it is off by more than ``gate`` standard deviations the *secant* is
taken for the tangent: the slope (z - I(r̂)) / (r_z - r̂) towards the radius r_z at which I would be the reading, held
``gate`` deviations off dark and peak. And r curves across its own direction: the Cartesian update by intensity alone
takes the mean ½ ∂I/∂r P_t / r of that, P_t the variance across, off the residual and adds twice its square to the
reading's variance (the second-order filter of Jazwinski 1970, 9.3, in that one term). ``gate = inf`` is the published
filter, without both.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.kalman_motion import Motion, make_motion, predict
from aquaquad_envs.estimation.kalman_update import factorize, square_root_update, work_shape
from aquaquad_envs.sensing.laser import Beam, beam_sigma, peak_intensity, profile_slope

FORMS = ("cartesian", "polar")
STATES = 4
#: Intensity, and two velocities.
READINGS = 3
WORK = work_shape(STATES, READINGS)
#: A centre nearer than this, m, has no direction.
_NO_DIRECTION = 1e-9


class LaserModel(NamedTuple):
    """What a filter assumes of a reading; made by :func:`make_laser_model`."""

    peak: float  # I₀, W/m²
    sigma: float  # m
    half_order: int
    ambient: float  # W/m²
    std: float  # of the intensity, W/m²
    velocity_std: float  # m/s
    gate: float


def make_laser_model(
    beam: Beam, height_m: float, *, intensity_std: float, velocity_std: float = 0.05, gate: float = 3.0
) -> LaserModel:
    """A model of the readings ``height_m`` above the source, with their standard deviations > 0 (W/m², m/s).

    ``gate`` ≥ 1, inf for the tangent always. Raises ``InvalidParameterError``.
    """
    check_range("height_m", height_m, 0, 1e5, open_low=True)
    check_range("intensity_std", intensity_std, 0, 1e9, open_low=True)
    check_range("velocity_std", velocity_std, 0, 1e9, open_low=True)
    check_range("gate", gate, 1, math.inf)
    return LaserModel(
        peak=float(peak_intensity(beam, float(height_m))),
        sigma=float(beam_sigma(beam, float(height_m))),
        half_order=beam.half_order,
        ambient=beam.ambient,
        std=float(intensity_std),
        velocity_std=float(velocity_std),
        gate=float(gate),
    )


@kernel
def slope_and_residual(model, r, reading):
    """∂I/∂r at ``r``, or the secant, W/m³, and the residual of ``reading`` that goes with it, W/m²."""
    expected, slope = profile_slope(model.peak, model.sigma, model.half_order, r)
    value = reading - model.ambient
    residual = value - expected
    margin = model.gate * model.std
    if abs(residual) > margin and model.peak > 2.0 * margin:
        held = min(max(value, margin), model.peak - margin)
        there = model.sigma * (-2.0 * np.log(held / model.peak)) ** (0.5 / model.half_order)
        # Not where holding it off dark or peak has turned the residual, or the two radii are one.
        if (held - expected) * residual > 0.0 and abs(there - abs(r)) > 1e-3 * model.sigma:
            chord = (held - expected) / (there - abs(r))
            return (chord if r >= 0.0 else -chord), held - expected
    return slope, residual


@kernel
def _whiten_row(work, row, h0, h1, h2, h3, residual, inverse_std):
    """Row ``row`` of the update: gradient (h0 … h3) through the factor in ``work``, and the residual, over σ."""
    work[row, 0] = (h0 * work[0, 0] + h1 * work[1, 0] + h2 * work[2, 0] + h3 * work[3, 0]) * inverse_std
    work[row, 1] = (h1 * work[1, 1] + h2 * work[2, 1] + h3 * work[3, 1]) * inverse_std
    work[row, 2] = (h2 * work[2, 2] + h3 * work[3, 2]) * inverse_std
    work[row, 3] = h3 * work[3, 3] * inverse_std
    work[row, 4] = residual * inverse_std


@kernel
def _factorize(covariance, work):
    """L of ``covariance`` into the first rows of ``work``, with all zeros above its diagonal."""
    repaired = factorize(covariance, work)
    for i in range(STATES):
        for j in range(i + 1, STATES):
            work[i, j] = 0.0
    return repaired


@loop_kernel
def _joint_update(state, covariance, work):
    """The update by all three whitened rows; not inlined, since two forms share it. Returns the NIS."""
    return square_root_update(state, covariance, work, READINGS, STATES, STATES)


@kernel
def cartesian_predict(state, covariance, dt, moved_x, moved_y, motion):
    """``dt`` s later, the receiver having moved by (``moved_x``, ``moved_y``) m over ground; in place."""
    predict(state, covariance, dt, motion)
    state[0] -= moved_x
    state[1] -= moved_y


@kernel
def cartesian_update(state, covariance, work, model, reading):
    """Update by one intensity ``reading``, W/m²; returns ``(nis, repaired)``. Scratch ``work`` of shape ``WORK``."""
    r = np.sqrt(state[0] * state[0] + state[1] * state[1])
    slope, residual = slope_and_residual(model, r, reading)
    repaired = factorize(covariance, work)
    along_x = state[0] / r if r > _NO_DIRECTION else 1.0
    along_y = state[1] / r if r > _NO_DIRECTION else 0.0
    variance = model.std * model.std
    if model.gate < np.inf:
        # r curves across its own direction: mean and variance of that, to second order.
        least = max(r, 0.1 * model.sigma)
        b0 = along_x * work[1, 0] - along_y * work[0, 0]
        b1 = along_x * work[1, 1]
        bend = 0.5 * slope * (b0 * b0 + b1 * b1) / least
        residual -= bend
        variance += 2.0 * bend * bend
    inverse = 1.0 / np.sqrt(variance)
    # Only the first two columns of L move a position.
    work[STATES, 0] = slope * (along_x * work[0, 0] + along_y * work[1, 0]) * inverse
    work[STATES, 1] = slope * along_y * work[1, 1] * inverse
    work[STATES, 2] = residual * inverse
    return square_root_update(state, covariance, work, 1, 2, 2), repaired


@kernel
def cartesian_update_with_velocity(state, covariance, work, model, reading, vx, vy):
    """As :func:`cartesian_update`, together with a measured velocity (``vx``, ``vy``) of the centre, m/s."""
    r = np.sqrt(state[0] * state[0] + state[1] * state[1])
    slope, residual = slope_and_residual(model, r, reading)
    repaired = _factorize(covariance, work)
    along_x = state[0] / r if r > _NO_DIRECTION else 1.0
    along_y = state[1] / r if r > _NO_DIRECTION else 0.0
    inverse = 1.0 / model.velocity_std
    _whiten_row(work, STATES, slope * along_x, slope * along_y, 0.0, 0.0, residual, 1.0 / model.std)
    _whiten_row(work, STATES + 1, 0.0, 0.0, 1.0, 0.0, vx - state[2], inverse)
    _whiten_row(work, STATES + 2, 0.0, 0.0, 0.0, 1.0, vy - state[3], inverse)
    return _joint_update(state, covariance, work), repaired


@kernel
def polar_velocity(state):
    """(v_x, v_y), m/s, of a polar ``state``."""
    cos = np.cos(state[1])
    sin = np.sin(state[1])
    across = state[0] * state[3]
    return state[2] * cos - across * sin, state[2] * sin + across * cos


@kernel
def polar_update(state, covariance, work, model, reading, vx, vy):
    """Published update of a polar ``state`` by (I, v_x, v_y) together; returns ``(nis, repaired)``."""
    r = state[0]
    slope, residual = slope_and_residual(model, r, reading)
    repaired = _factorize(covariance, work)
    cos = np.cos(state[1])
    sin = np.sin(state[1])
    rate = state[3]
    expected_x, expected_y = polar_velocity(state)
    inverse = 1.0 / model.velocity_std
    _whiten_row(work, STATES, slope, 0.0, 0.0, 0.0, residual, 1.0 / model.std)
    _whiten_row(work, STATES + 1, -rate * sin, -expected_y, cos, -r * sin, vx - expected_x, inverse)
    _whiten_row(work, STATES + 2, rate * cos, expected_x, sin, r * cos, vy - expected_y, inverse)
    return _joint_update(state, covariance, work), repaired


@kernel
def polar_predict(state, covariance, dt, motion, noise):
    """``dt`` s later at constant rates, with ``noise`` (4,) the variances of r, θ, ṙ, θ̇ added a second; in place."""
    predict(state, covariance, dt, motion)
    for i in range(STATES):
        covariance[i, i] += noise[i] * dt


@loop_kernel
def _cycle_all(
    polar, states, covariances, work, dt, motion, noise, model, readings, moved, velocities, measured, mask,
    nis, repairs,
):  # fmt: skip
    for i in range(states.shape[0]):
        if polar:
            polar_predict(states[i], covariances[i], dt, motion, noise)
        else:
            cartesian_predict(states[i], covariances[i], dt, moved[i, 0], moved[i, 1], motion)
        nis[i] = 0.0
        if not mask[i]:
            continue
        if polar:
            nis[i], repaired = polar_update(
                states[i], covariances[i], work, model, readings[i], velocities[i, 0], velocities[i, 1]
            )
        elif measured:
            nis[i], repaired = cartesian_update_with_velocity(
                states[i], covariances[i], work, model, readings[i], velocities[i, 0], velocities[i, 1]
            )
        else:
            nis[i], repaired = cartesian_update(states[i], covariances[i], work, model, readings[i])
        repairs[i] += repaired


def polar_from_cartesian(states: np.ndarray, covariances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative Cartesian ``states`` (..., 4) and ``covariances`` (..., 4, 4) in polar form, these to first order."""
    x, y, u, v = np.moveaxis(states, -1, 0)
    square = x * x + y * y
    if not (square > 0).all():
        raise InvalidParameterError(
            "states", "a centre at the receiver", "r > 0 in polar form", "Use form='cartesian'."
        )
    r = np.sqrt(square)
    outward, turn = x * u + y * v, x * v - y * u
    nothing = np.zeros_like(r)
    jacobian = [
        [x / r, y / r, nothing, nothing],
        [-y / square, x / square, nothing, nothing],
        [u / r - x * outward / r**3, v / r - y * outward / r**3, x / r, y / r],
        [
            v / square - 2 * x * turn / square**2,
            -u / square - 2 * y * turn / square**2,
            -y / square,
            x / square,
        ],
    ]
    matrix = np.moveaxis(np.array(jacobian), (0, 1), (-2, -1))
    polar = np.stack([r, np.arctan2(y, x), outward / r, turn / square], axis=-1)
    return polar, matrix @ covariances @ matrix.swapaxes(-1, -2)


class LaserEkf:
    """One filter in each of ``num_worlds`` worlds.

    Attributes
    ----------
    states: (num_worlds, 4), Cartesian (d_x, d_y, u, v) in m, m/s or polar (r, θ, ṙ, θ̇) in m, rad, m/s, rad/s.
    covariances: (num_worlds, 4, 4). nis: (num_worlds,) normalised innovation squared of the last update, χ² with one
        degree of freedom (three where velocities are given) for a matched model. repairs: (num_worlds,) how
        often a covariance had lost positive definiteness.
    """

    def __init__(
        self,
        num_worlds: int,
        model: LaserModel,
        *,
        form: str = "cartesian",
        motion: Motion | None = None,
        polar_noise: tuple[float, float, float, float] = (1e-4, 1e-4, 1e-3, 1e-3),
    ) -> None:
        """Filters at 1 m east with unit covariance, to be placed by :meth:`place`.

        ``motion``: constant velocity with its white acceleration, of the Cartesian form (default 0.01 m²/s³).
        ``polar_noise``: variances of r, θ, ṙ, θ̇ (m², rad², m²/s², rad²/s²) added a second, of the polar; the
        source does not give them. Raises ``InvalidParameterError``.
        """
        if not isinstance(num_worlds, int | np.integer) or num_worlds < 1:
            raise InvalidParameterError("num_worlds", num_worlds, "a whole number of at least 1")
        check_choice("form", form, FORMS)
        if len(polar_noise) != STATES:
            raise InvalidParameterError("polar_noise", polar_noise, "four variances")
        for value in polar_noise:
            check_range("polar_noise", value, 0, 1e6)
        plain = make_motion("constant-velocity")
        self.motion = motion or make_motion("constant-velocity", density=0.01)
        if self.motion.model != plain.model:
            raise InvalidParameterError("motion", motion, "a constant-velocity motion")
        self.model, self.form = model, form
        self._noise = np.array(polar_noise, dtype=float)
        if form == "polar":
            self.motion = plain
        count = int(num_worlds)
        self.states = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        self.covariances = np.tile(np.eye(STATES), (count, 1, 1))
        self.nis = np.zeros(count)
        self.repairs = np.zeros(count, dtype=np.int64)
        self._work = np.zeros(WORK)

    def place(self, states: Any, covariances: Any) -> None:
        """Start at Cartesian ``states`` (..., 4) with ``covariances`` (..., 4, 4).

        The polar form converts them; their (u, v) is then relative to the receiver. Raises
        ``InvalidParameterError`` for what is not finite, not positive definite, or r = 0 in polar form.
        """
        first = np.array(np.broadcast_to(states, self.states.shape), dtype=float)
        spread = np.array(np.broadcast_to(covariances, self.covariances.shape), dtype=float)
        if not (np.isfinite(first).all() and np.isfinite(spread).all()):
            raise InvalidParameterError("states", "NaN or infinite", "finite states and covariances")
        if (np.linalg.eigvalsh(spread) <= 0).any():
            raise InvalidParameterError("covariances", "not positive definite", "positive definite matrices")
        if self.form == "polar":
            first, spread = polar_from_cartesian(first, spread)
        self.states[:], self.covariances[:] = first, spread
        self.nis[:], self.repairs[:] = 0.0, 0

    def cycle(
        self, dt_s: float, readings: Any, *, moved: Any = 0.0, velocities: Any = None, mask: Any = True
    ) -> None:
        """Predict ``dt_s`` ≥ 0 s and update by intensity ``readings`` (num_worlds,), W/m².

        ``moved`` (num_worlds, 2), m: the receiver's displacement since, of the Cartesian form. ``velocities``
        (num_worlds, 2), m/s, the centre's: relative to the receiver and required in polar form, over
        ground (or relative, where nothing is ``moved``) and optional in Cartesian. ``mask``: False where there is no
        reading. Raises ``InvalidParameterError``.
        """
        check_range("dt_s", dt_s, 0, 1e6)
        polar, measured = self.form == "polar", velocities is not None
        if polar and not measured:
            raise InvalidParameterError("velocities", None, "relative velocities, m/s, in polar form")
        count = len(self.states)
        chosen = np.array(np.broadcast_to(mask, count), dtype=bool)
        values = self._checked("readings", readings, (count,))
        steps = self._checked("moved", moved, (count, 2))
        speeds = self._checked("velocities", velocities if measured else 0.0, (count, 2))
        _cycle_all(
            polar, self.states, self.covariances, self._work, float(dt_s), self.motion, self._noise, self.model,
            values, steps, speeds, measured, chosen, self.nis, self.repairs,
        )  # fmt: skip

    def positions(self) -> np.ndarray:
        """The centre's position seen from the receiver, (num_worlds, 2), m."""
        if self.form == "cartesian":
            return self.states[:, :2].copy()
        r, angle = self.states[:, 0], self.states[:, 1]
        return np.stack([r * np.cos(angle), r * np.sin(angle)], axis=-1)

    @staticmethod
    def _checked(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
        try:
            array = np.array(np.broadcast_to(values, shape), dtype=float)
        except (TypeError, ValueError):
            raise InvalidParameterError(name, np.shape(values), f"numbers of shape {shape}") from None
        if not np.isfinite(array).all():
            raise InvalidParameterError(name, "NaN or infinite", "finite numbers")
        return array

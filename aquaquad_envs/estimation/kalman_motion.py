"""How a track moves between measurements: linear motion with process noise, one step in place.

States: (x, y, u, v) or (x, y, u, v, ax, ay) in m, m/s, m/s², x east, y north. Prediction is
x ← Φ x, P ← Φ P Φᵀ + Q. For linear motion the unscented transform gives exactly this for every
choice of sigma points, hence one prediction serves all filters and the posterior bound.
"""

from __future__ import annotations

from typing import NamedTuple

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range

CONSTANT_VELOCITY = 0
CONSTANT_ACCELERATION = 1
PUBLISHED = 2
#: Code of each model by the name that users write.
MODELS = {
    "constant-velocity": CONSTANT_VELOCITY,
    "constant-acceleration": CONSTANT_ACCELERATION,
    "published": PUBLISHED,
}


class Motion(NamedTuple):
    """Motion as kernels read it; make one with :func:`make_motion`."""

    model: int
    density: float  # power spectral density of white acceleration, m²/s³, or white jerk, m²/s⁵, in each axis
    position_variance: float  # m², added to each axis at every step whatever its length
    velocity_variance: float  # m²/s², the same
    acceleration_variance: float  # m²/s⁴, the same


#: Process noise of Dillard 2014, App. B: 1e-6 diag(10, 10, 1, 1, 1, 1) a step.
PUBLISHED_STEP_VARIANCES = (1e-5, 1e-6, 1e-6)


def states_of(motion: Motion) -> int:
    """Length of the state: 4 for constant velocity, else 6."""
    return 4 if motion.model == CONSTANT_VELOCITY else 6


def make_motion(
    model: str = "constant-acceleration",
    *,
    density: float = 0.0,
    step_variances: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Motion:
    """Motion with its process noise, checked.

    ``"constant-velocity"``: x ← x + u Δt; ``"constant-acceleration"``: Φ = exp(A Δt), that is
    x ← x + u Δt + a Δt²/2, u ← u + a Δt; ``"published"``: six states of which the acceleration moves nothing
    (x ← x + u Δt, Dillard 2014, App. B; the text of III.B has the exponential: an erratum of the code).
    ``density`` q ≥ 0: white noise driving the highest derivative, discretised exactly. Per axis for
    constant velocity, q in m²/s³: q [[Δt³/3, Δt²/2], [Δt²/2, Δt]]; for constant acceleration, q in m²/s⁵:
    q [[Δt⁵/20, Δt⁴/8, Δt³/6], [Δt⁴/8, Δt³/3, Δt²/2], [Δt³/6, Δt²/2, Δt]] (Bar-Shalom, Li & Kirubarajan 2001,
    6.2). ``step_variances`` ≥ 0: variances of position, velocity and acceleration (m², m²/s²,
    m²/s⁴) added at every step. Raises ``InvalidParameterError``.
    """
    check_choice("model", model, MODELS)
    check_range("density", density, 0, 1e12)
    if len(step_variances) != 3:
        raise InvalidParameterError(
            "step_variances", step_variances, "three variances: of position, velocity and acceleration"
        )
    for value in step_variances:
        check_range("step_variances", value, 0, 1e12)
    if model == "published" and density:
        raise InvalidParameterError(
            "density", density, "0 with the published model", "Its noise is given by step_variances."
        )
    if model == "constant-velocity" and step_variances[2]:
        raise InvalidParameterError(
            "step_variances", step_variances, "no variance of acceleration with constant velocity"
        )
    return Motion(MODELS[model], float(density), *(float(value) for value in step_variances))


@kernel
def predict_state(state, dt, motion):
    """``state`` (4,) or (6,) ``dt`` ≥ 0 seconds later, in place."""
    for axis in range(2):
        if motion.model == CONSTANT_ACCELERATION:
            state[axis] += dt * (state[2 + axis] + 0.5 * dt * state[4 + axis])
            state[2 + axis] += dt * state[4 + axis]
        else:
            state[axis] += dt * state[2 + axis]


@kernel
def move_rows(matrix, columns, dt, motion):
    """``matrix`` ← Φ ``matrix``, in place, for the leading ``columns`` columns."""
    for axis in range(2):
        if motion.model == CONSTANT_ACCELERATION:
            half = 0.5 * dt * dt
            for j in range(columns):
                matrix[axis, j] += dt * matrix[2 + axis, j] + half * matrix[4 + axis, j]
                matrix[2 + axis, j] += dt * matrix[4 + axis, j]
        else:
            for j in range(columns):
                matrix[axis, j] += dt * matrix[2 + axis, j]


@kernel
def add_process_noise(covariance, dt, motion):
    """``covariance`` ← ``covariance`` + Q(dt), in place."""
    q = motion.density
    for axis in range(2):
        u = 2 + axis
        covariance[axis, axis] += motion.position_variance
        covariance[u, u] += motion.velocity_variance
        if motion.model == CONSTANT_VELOCITY:
            cross = 0.5 * q * dt * dt
            covariance[axis, axis] += q * dt * dt * dt / 3.0
            covariance[axis, u] += cross
            covariance[u, axis] += cross
            covariance[u, u] += q * dt
        else:
            a = 4 + axis
            covariance[a, a] += motion.acceleration_variance
            if q > 0.0:
                dt2 = dt * dt
                x_u = q * dt2 * dt2 / 8.0
                x_a = q * dt2 * dt / 6.0
                u_a = q * dt2 / 2.0
                covariance[axis, axis] += q * dt2 * dt2 * dt / 20.0
                covariance[axis, u] += x_u
                covariance[u, axis] += x_u
                covariance[axis, a] += x_a
                covariance[a, axis] += x_a
                covariance[u, u] += q * dt2 * dt / 3.0
                covariance[u, a] += u_a
                covariance[a, u] += u_a
                covariance[a, a] += q * dt


@kernel
def predict_covariance(covariance, dt, motion):
    """P ← Φ P Φᵀ + Q(dt), in place and exactly symmetric; ``covariance`` is (4, 4) or (6, 6)."""
    n = covariance.shape[0]
    move_rows(covariance, n, dt, motion)
    half = 0.5 * dt * dt
    for i in range(n):
        for axis in range(2):
            if motion.model == CONSTANT_ACCELERATION:
                covariance[i, axis] += dt * covariance[i, 2 + axis] + half * covariance[i, 4 + axis]
                covariance[i, 2 + axis] += dt * covariance[i, 4 + axis]
            else:
                covariance[i, axis] += dt * covariance[i, 2 + axis]
    # The two orders of summation round differently.
    for i in range(1, n):
        for j in range(i):
            covariance[i, j] = covariance[j, i]
    add_process_noise(covariance, dt, motion)


@kernel
def predict(state, covariance, dt, motion):
    """One prediction of the EKF and of the UKF, in place: ``state`` (n,), ``covariance`` (n, n), ``dt`` ≥ 0 s.

    n = 4 for constant velocity, else 6 (:func:`states_of`).
    """
    predict_state(state, dt, motion)
    predict_covariance(covariance, dt, motion)

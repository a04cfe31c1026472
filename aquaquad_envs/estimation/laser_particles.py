"""Where the centre of a laser's disc is, by particles: the posterior in full, rings and all, at a price.

The alternative that the source names to its Kalman filter (Toombs 2022, 7.2). Each particle is a centre seen from the
receiver and its velocity over ground, (d_x, d_y, u, v), moved like the Cartesian filter of
:mod:`~aquaquad_envs.estimation.laser_ekf` with its process noise drawn, and weighted by the normal likelihood
of the reading, w ← w exp(-(z - I(|d|))² / 2σ²). Where the effective number 1/Σw² falls below half of them they are
redrawn systematically (Arulampalam et al., IEEE TSP 50(2), 2002) and spread by a Gaussian kernel of ``spread`` times
the cloud's deviations, so that copies part. No linearisation: a dark reading or a bright one says what it says.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.estimation.kalman_motion import CONSTANT_VELOCITY, Motion, make_motion
from aquaquad_envs.estimation.laser_ekf import STATES, LaserModel
from aquaquad_envs.physics.randomness import SOURCES, normal, seed_streams, uniform
from aquaquad_envs.sensing.laser import profile_intensity


@kernel
def _move_particle(particle, dt, moved, noise, stream):
    """One particle ``dt`` s on; ``noise`` as of :func:`process_noise`."""
    for axis in range(2):
        kick = noise[1] * normal(stream)
        particle[axis] += dt * particle[2 + axis] + noise[2] * kick + noise[0] * normal(stream) - moved[axis]
        particle[2 + axis] += kick


@kernel
def _resample(particles, weights, spare, spread, stream):
    """Systematic redrawing in place, then a kernel of ``spread`` times the cloud's deviation in each axis."""
    count = weights.size
    at = uniform(stream) / count
    total = weights[0]
    k = 0
    for i in range(count):
        while total < at and k < count - 1:
            k += 1
            total += weights[k]
        for j in range(STATES):
            spare[i, j] = particles[k, j]
        at += 1.0 / count
    for j in range(STATES):
        mean = 0.0
        for i in range(count):
            mean += spare[i, j]
        mean /= count
        square = 0.0
        for i in range(count):
            square += (spare[i, j] - mean) * (spare[i, j] - mean)
        width = spread * np.sqrt(square / count)
        for i in range(count):
            particles[i, j] = spare[i, j] + width * normal(stream)
    for i in range(count):
        weights[i] = 1.0 / count


@loop_kernel
def particle_cycle(particles, weights, spare, dt, moved, noise, model, reading, spread, stream):
    """Move and weigh one cloud: ``particles`` (n, 4), ``weights`` (n,) of sum 1, in place; returns 1 if redrawn.

    moved: (2,) m of the receiver; noise: (3,) of :func:`process_noise`; reading in W/m²; stream: (4,) uint64 words.
    """
    count = weights.size
    value = reading - model.ambient
    for i in range(count):
        _move_particle(particles[i], dt, moved, noise, stream)
    least = np.inf
    for i in range(count):
        r = np.sqrt(particles[i, 0] * particles[i, 0] + particles[i, 1] * particles[i, 1])
        miss = (value - profile_intensity(model.peak, model.sigma, model.half_order, r)) / model.std
        spare[i, 0] = 0.5 * miss * miss
        least = min(least, spare[i, 0] if weights[i] > 0.0 else np.inf)
    total = 0.0
    for i in range(count):
        weights[i] *= np.exp(least - spare[i, 0])
        total += weights[i]
    squares = 0.0
    for i in range(count):
        weights[i] /= total
        squares += weights[i] * weights[i]
    if squares * count > 2.0:
        _resample(particles, weights, spare, spread, stream)
        return 1
    return 0


@loop_kernel
def _cycle_all(particles, weights, spare, dt, moved, noise, model, readings, mask, spread, streams, redrawn):
    for i in range(weights.shape[0]):
        if mask[i]:
            redrawn[i] += particle_cycle(
                particles[i], weights[i], spare, dt, moved[i], noise, model, readings[i], spread, streams[i]
            )


def process_noise(motion: Motion, dt_s: float) -> np.ndarray:
    """What :func:`particle_cycle` draws over ``dt_s``: three numbers.

    The deviation of position beyond what velocity's explains (m), that of velocity (m/s), and how far a velocity's
    kick also displaces (s). Exact for white acceleration: variance q Δt³/3 = (Δt/2)² q Δt + q Δt³/12.
    """
    if motion.model != CONSTANT_VELOCITY:
        raise InvalidParameterError("motion", motion, "a constant-velocity motion")
    white = motion.density * dt_s
    kick = white + motion.velocity_variance
    along = 0.5 * dt_s * white / kick if kick > 0.0 else 0.0
    rest = motion.position_variance + white * dt_s**2 / 3.0 - along * along * kick
    return np.array([math.sqrt(max(rest, 0.0)), math.sqrt(kick), along])


class LaserParticles:
    """One cloud in each of ``num_worlds`` worlds.

    Attributes
    ----------
    particles: (num_worlds, particles, 4): d_x, d_y (m), u, v (m/s). weights: (num_worlds, particles), sums 1.
    redrawn: (num_worlds,) how often a cloud was redrawn.
    """

    def __init__(
        self,
        num_worlds: int,
        model: LaserModel,
        *,
        particles: int = 512,
        motion: Motion | None = None,
        spread: float = 0.1,
        seed: int = 0,
    ) -> None:
        """Clouds at the receiver, to be placed by :meth:`place`.

        ``motion`` as of :class:`~aquaquad_envs.estimation.laser_ekf.LaserEkf`; ``spread`` ≥ 0 of the kernel in
        deviations of the cloud; world i draws from its own stream of ``seed`` + i. Raises ``InvalidParameterError``.
        """
        for name, value, low in (("num_worlds", num_worlds, 1), ("particles", particles, 2)):
            if not isinstance(value, int | np.integer) or value < low:
                raise InvalidParameterError(name, value, f"a whole number of at least {low}")
        check_range("spread", spread, 0, 1)
        self.model, self.spread = model, float(spread)
        self.motion = motion or make_motion("constant-velocity", density=0.01)
        process_noise(self.motion, 0.0)
        shape = int(num_worlds), int(particles)
        self.particles = np.zeros((*shape, STATES))
        self.weights = np.full(shape, 1.0 / shape[1])
        self.redrawn = np.zeros(shape[0], dtype=np.int64)
        sensor = SOURCES.index("sensor")
        self.streams = np.stack([seed_streams(int(seed) + i)[sensor] for i in range(shape[0])])
        self._spare = np.empty((shape[1], STATES))

    def place(self, particles: Any) -> None:
        """Equal weights on ``particles`` (..., particles, 4), finite, broadcast to the batch."""
        values = np.array(np.broadcast_to(particles, self.particles.shape), dtype=float)
        if not np.isfinite(values).all():
            raise InvalidParameterError("particles", "NaN or infinite", "finite numbers")
        self.particles[:] = values
        self.weights[:] = 1.0 / self.weights.shape[1]

    def cycle(self, dt_s: float, readings: Any, *, moved: Any = 0.0, mask: Any = True) -> None:
        """Predict ``dt_s`` ≥ 0 s, the receiver having ``moved`` (num_worlds, 2) m, and weigh by ``readings``, W/m²."""
        check_range("dt_s", dt_s, 0, 1e6)
        count = len(self.weights)
        values = np.array(np.broadcast_to(readings, count), dtype=float)
        steps = np.array(np.broadcast_to(moved, (count, 2)), dtype=float)
        if not (np.isfinite(values).all() and np.isfinite(steps).all()):
            raise InvalidParameterError("readings", "NaN or infinite", "finite readings and displacements")
        chosen = np.array(np.broadcast_to(mask, count), dtype=bool)
        _cycle_all(
            self.particles, self.weights, self._spare, float(dt_s), steps, process_noise(self.motion, dt_s),
            self.model, values, chosen, self.spread, self.streams, self.redrawn,
        )  # fmt: skip

    def means(self) -> np.ndarray:
        """Weighted means (d_x, d_y, u, v): (num_worlds, 4)."""
        return (self.weights[..., None] * self.particles).sum(axis=1)

    def covariances(self) -> np.ndarray:
        """Weighted covariances: (num_worlds, 4, 4)."""
        apart = self.particles - self.means()[:, None]
        return np.einsum("wp,wpi,wpj->wij", self.weights, apart, apart)

"""Bearing, range and time difference of arrival (TDOA) of a target, their gradients and noise.

Target (x, y), sensors (x_i, y_i), all in m, x east, y north; c the speed of sound in m/s
(Dillard 2014, II.E, eq. II.3–II.7):

======= ==== ======================================= ==========================================
kind    code measurement                             gradient with respect to (x, y)
======= ==== ======================================= ==========================================
bearing 0    θ = atan2(y - y_i, x - x_i), rad        [-(y - y_i), x - x_i] / r_i², rad/m
range   1    r_i = √((x - x_i)² + (y - y_i)²), m     [x - x_i, y - y_i] / r_i
TDOA    2    τ_ij = (r_i - r_j) / c, s               ([x - x_i, y - y_i]/r_i - [...]_j/r_j) / c, s/m
======= ==== ======================================= ==========================================

All are exact in the plane (source and receivers at one depth, straight rays). Where a sensor
stands on the target its direction is undefined: bearing 0 and gradient (0, 0), so that
nothing infinite enters a filter. Differences between pairs of one team are dependent: of
(τ_12, τ_23, τ_13) only two are free, hence they have a regular covariance only if the noise is
drawn per pair, as published, and not per arrival.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import check_range
from aquaquad_envs.physics.randomness import normal

BEARING = 0
RANGE = 1
TDOA = 2
#: Code of each kind by the name that users write.
KINDS = {"bearing": BEARING, "range": RANGE, "tdoa": TDOA}


@kernel
def wrap_angle(angle):
    """``angle``, rad, brought into [-π, π) by whole turns; an angle already there is returned bit for bit."""
    if -np.pi <= angle < np.pi:
        return angle
    wrapped = angle - 2.0 * np.pi * np.floor((angle + np.pi) / (2.0 * np.pi))
    # The floor is rounded: an angle beside a seam may land just across it.
    if wrapped >= np.pi:
        wrapped -= 2.0 * np.pi
    if wrapped < -np.pi:
        wrapped += 2.0 * np.pi
    return wrapped


@kernel
def bearing_to(x, y, sensor_x, sensor_y):
    """Bearing, rad in (-π, π], counter-clockwise from east, of (x, y) seen from the sensor; 0 where they coincide."""
    # Adding 0 turns a negative zero into a positive one, for which atan2 would turn half round.
    angle = np.arctan2(y - sensor_y + 0.0, x - sensor_x + 0.0)
    return angle if angle > -np.pi else np.pi


@kernel
def distance_to(x, y, sensor_x, sensor_y):
    """Horizontal range, m, between (x, y) and the sensor."""
    dx = x - sensor_x
    dy = y - sensor_y
    return np.sqrt(dx * dx + dy * dy)


@kernel
def direction_to(x, y, sensor_x, sensor_y):
    """Unit vector from the sensor to (x, y), the gradient of the range; (0, 0) where they coincide."""
    dx = x - sensor_x
    dy = y - sensor_y
    r = np.sqrt(dx * dx + dy * dy)
    inverse = 1.0 / r if r > 0.0 else 0.0
    return dx * inverse, dy * inverse


@kernel
def predicted_measurement(kind, x, y, sensor_x, sensor_y, other_x, other_y, sound_speed):
    """Noise-free measurement of ``kind`` of a target at (x, y): rad, m or s (table above).

    ``other_x, other_y`` (sensor j) and ``sound_speed`` matter to TDOA only.
    """
    if kind == BEARING:
        return bearing_to(x, y, sensor_x, sensor_y)
    r = distance_to(x, y, sensor_x, sensor_y)
    if kind == RANGE:
        return r
    return (r - distance_to(x, y, other_x, other_y)) / sound_speed


@kernel
def measurement_gradient(kind, x, y, sensor_x, sensor_y, other_x, other_y, sound_speed):
    """Derivatives (d/dx, d/dy) of :func:`predicted_measurement`: one row of the Jacobian H."""
    if kind == BEARING:
        dx = x - sensor_x
        dy = y - sensor_y
        r2 = dx * dx + dy * dy
        # A bearing's gradient is 1/r: below 1e-150 m it would overflow.
        inverse = 1.0 / r2 if r2 > 1e-300 else 0.0
        return -dy * inverse, dx * inverse
    gx, gy = direction_to(x, y, sensor_x, sensor_y)
    if kind == RANGE:
        return gx, gy
    hx, hy = direction_to(x, y, other_x, other_y)
    return (gx - hx) / sound_speed, (gy - hy) / sound_speed


@kernel
def measurement_residual(kind, measured, predicted):
    """``measured - predicted``, wrapped into [-π, π) for bearings."""
    difference = measured - predicted
    return wrap_angle(difference) if kind == BEARING else difference


@kernel
def measurement_std(kind, std, level, reference_range, x, y, sensor_x, sensor_y, other_x, other_y):
    """Standard deviation of the noise: σ √(1 + (level · r / r_ref)²); ``std`` itself at ``level`` 0.

    ``std`` in the measurement's unit at zero range, r and ``reference_range`` (> 0) in m, ``level``
    ≥ 0 and free of units. A TDOA takes the mean square of its two arrivals: r² = (r_i² + r_j²)/2.
    At long range and r_ref = σ, ``level`` is the error of a range as a share of it, for
    instance 0.25 for the waveguide-invariant ranges quoted in Dillard 2014, II.E. A model of our
    own: the source has constant noise only.
    """
    r = distance_to(x, y, sensor_x, sensor_y)
    r2 = r * r
    if kind == TDOA:
        other = distance_to(x, y, other_x, other_y)
        r2 = 0.5 * (r2 + other * other)
    scale = level / reference_range
    return std * np.sqrt(1.0 + scale * scale * r2)


@kernel
def noisy_measurement(kind, exact, std, stream):
    """``exact`` plus normal noise of deviation ``std`` from ``stream``; bearings wrapped into [-π, π).

    One draw a call, also at ``std`` 0, so that a change of level does not shift the stream. Noise
    of a range may make it negative: it is not cut off, which would bias it.
    """
    measured = exact + std * normal(stream)
    return wrap_angle(measured) if kind == BEARING else measured


def std_from_noise_power(power: float, sample_time_s: float) -> float:
    """Standard deviation √(power / sample time) of sampled band-limited white noise of a given "power".

    The unit of ``power`` is (unit of the measurement)² · s. Published: 1e-8 at 0.005 s is 1.414 ms
    (TDOA), 1e-4 at 0.005 s is 0.141 rad (bearing) (Dillard 2014, V.C and III.E). Raises
    ``InvalidParameterError`` for a negative power or a sample time that is not positive.
    """
    check_range("power", power, 0, 1e12)
    check_range("sample_time_s", sample_time_s, 0, 1e9, open_low=True)
    return float(np.sqrt(power / sample_time_s))

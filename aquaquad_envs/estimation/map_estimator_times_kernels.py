"""Kernels of the position from two-way travel times: equations in :mod:`map_estimator_times`."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.map_estimator_kernels import (
    CONVERGED,
    ITERATIONS,
    NOT_FINITE,
    SINGULAR,
    across_the_track,
)
from aquaquad_envs.estimation.small_matrices import cholesky, inverse_from_cholesky

UNKNOWNS = ("x", "y", "z", "sound speed", "delay")
SIZE = len(UNKNOWNS)
SPEED, DELAY = 3, 4
#: How often a descent leaves a saddle point, and which way: deeper, and along no axis.
_NUDGES = 3
_OBLIQUE = (0.6, -0.5, 0.62)


@kernel
def two_way_time(transmit, receive, u):
    """(‖p - a‖ + ‖p - b‖) / c + τ, s, of u = (p, c, τ); positions (3,), m."""
    there = 0.0
    back = 0.0
    for k in range(3):
        there += (u[k] - transmit[k]) ** 2
        back += (u[k] - receive[k]) ** 2
    return (np.sqrt(there) + np.sqrt(back)) / u[SPEED] + u[DELAY]


@kernel
def _direction(place, u, row, weight):
    """Add ``weight`` times the unit vector from ``place`` to p to ``row``; returns the distance."""
    square = 0.0
    for k in range(3):
        square += (u[k] - place[k]) ** 2
    distance = np.sqrt(square)
    if distance > 0.0:
        for k in range(3):
            row[k] += weight * (u[k] - place[k]) / distance
    return distance


@loop_kernel
def _equations(transmit, receive, times, weights, mean, prior, free, huber, u, row, matrix, vector):
    """Information into ``matrix`` (5, 5), minus the gradient into ``vector``; returns cost and curvature left out."""
    cost = 0.0
    for j in range(SIZE):
        total = 0.0
        for k in range(SIZE):
            matrix[j, k] = prior[j, k]
            total += prior[j, k] * (u[k] - mean[k])
        vector[j] = -total
        cost += 0.5 * total * (u[j] - mean[j])
    bend = 0.0
    for i in range(times.shape[0]):
        e = times[i] - two_way_time(transmit[i], receive[i], u)
        if e != e:
            continue
        w = weights[i]
        square = w * e * e
        if huber > 0.0 and square > huber * huber:
            root = np.sqrt(square)
            cost += huber * (root - 0.5 * huber)
            w *= huber / root
        else:
            cost += 0.5 * square
        for k in range(SIZE):
            row[k] = 0.0
        there = _direction(transmit[i], u, row, 1.0 / u[SPEED])
        back = _direction(receive[i], u, row, 1.0 / u[SPEED])
        row[SPEED] = -(there + back) / (u[SPEED] * u[SPEED])
        row[DELAY] = 1.0
        if there > 0.0 and back > 0.0:
            bend += w * e * (1.0 / there + 1.0 / back) / u[SPEED]
        for j in range(SIZE):
            vector[j] += w * e * row[j]
            for k in range(SIZE):
                matrix[j, k] += w * row[j] * row[k]
    for j in range(SIZE):
        if not free[j]:
            for k in range(SIZE):
                matrix[j, k] = 0.0
                matrix[k, j] = 0.0
            matrix[j, j] = 1.0
            vector[j] = 0.0
    return cost, bend


@loop_kernel
def _step(matrix, vector, free, damping, bend, trial, factor, step):
    """Step of the damped equations into ``step``; returns whether they are positive definite."""
    for j in range(SIZE):
        for k in range(SIZE):
            trial[j, k] = matrix[j, k]
        trial[j, j] *= 1.0 + damping
        if j < 3:
            trial[j, j] -= bend
    if cholesky(trial, factor):
        return False
    for j in range(SIZE):
        total = vector[j]
        for k in range(j):
            total -= factor[j, k] * step[k]
        step[j] = total / factor[j, j]
    for j in range(SIZE - 1, -1, -1):
        total = step[j]
        for k in range(j + 1, SIZE):
            total -= factor[k, j] * step[k]
        step[j] = total / factor[j, j]
    return True


@loop_kernel
def _descend(transmit, receive, times, weights, mean, prior, free, settings, u):
    """Damped descent (Marquardt) from ``u``, in place: status, iterations, cost, information (5, 5)."""
    row = np.zeros(SIZE)
    matrix = np.zeros((SIZE, SIZE))
    vector = np.zeros(SIZE)
    trial = np.zeros((SIZE, SIZE))
    factor = np.zeros((SIZE, SIZE))
    step = np.zeros(SIZE)
    ahead = np.zeros(SIZE)
    next_matrix = np.zeros((SIZE, SIZE))
    next_vector = np.zeros(SIZE)
    cost, bend = _equations(
        transmit, receive, times, weights, mean, prior, free, settings.huber, u, row, matrix, vector
    )
    if not cost < np.inf:
        return NOT_FINITE, 0, cost, matrix
    damping = 0.0
    nudges = 0
    for iteration in range(settings.max_iterations):
        convex = _step(matrix, vector, free, damping, bend, trial, factor, step)
        if not convex and not _step(matrix, vector, free, damping, 0.0, trial, factor, step):
            if damping > 1e6:
                return SINGULAR, iteration, cost, matrix
            damping = max(10.0 * damping, 1e-9)
            continue
        length = step[0] ** 2 + step[1] ** 2 + step[2] ** 2 + (step[SPEED] * 1e-3) ** 2
        length += (step[DELAY] * u[SPEED]) ** 2
        small = length <= settings.tolerance**2
        if small and damping == 0.0 and convex:
            return CONVERGED, iteration, cost, matrix
        for j in range(SIZE):
            ahead[j] = u[j] + step[j]
        new_cost = np.inf
        new_bend = 0.0
        if ahead[SPEED] > 0.0:
            new_cost, new_bend = _equations(
                transmit, receive, times, weights, mean, prior, free, settings.huber,
                ahead, row, next_matrix, next_vector,
            )  # fmt: skip
        if new_cost <= cost * (1.0 + 1e-12):
            cost = new_cost
            bend = new_bend
            for j in range(SIZE):
                u[j] = ahead[j]
            vector, next_vector = next_vector, vector
            matrix, next_matrix = next_matrix, matrix
            damping = 0.1 * damping if damping > 1e-6 else 0.0
            if small and not convex and nudges < _NUDGES:
                # A saddle point: the start lay on a plane of symmetry.
                nudges += 1
                for j in range(3):
                    u[j] += 1e3 * settings.tolerance * _OBLIQUE[j]
                cost, bend = _equations(
                    transmit, receive, times, weights, mean, prior, free, settings.huber,
                    u, row, matrix, vector,
                )  # fmt: skip
        else:
            damping = max(10.0 * damping, 1e-4)
    return ITERATIONS, settings.max_iterations, cost, matrix


@loop_kernel
def solve_times(transmit, receive, times, weights, mean, prior, free, settings, u):
    """:func:`_descend` from ``u`` and from the images of its end below the vehicle's depth and across its track."""
    status, iterations, cost, matrix = _descend(
        transmit, receive, times, weights, mean, prior, free, settings, u
    )
    if settings.mirror and times.shape[0] > 0 and status != NOT_FINITE:
        for side in range(2):
            image = u.copy()
            if side == 0:
                image[2] = 2.0 * np.mean(transmit[:, 2]) - u[2]
            else:
                image[0], image[1] = across_the_track(
                    times.shape[0], transmit[:, 0], transmit[:, 1], times, u[0], u[1]
                )
            other, more, image_cost, image_matrix = _descend(
                transmit, receive, times, weights, mean, prior, free, settings, image
            )
            iterations += more
            if other <= SINGULAR and image_cost < cost:
                status, cost = other, image_cost
                matrix = image_matrix
                for j in range(SIZE):
                    u[j] = image[j]
    covariance = np.zeros((SIZE, SIZE))
    factor = np.zeros((SIZE, SIZE))
    if status == NOT_FINITE or cholesky(matrix, factor):
        for j in range(SIZE):
            covariance[j, j] = np.inf if free[j] else 0.0
        return status if status == NOT_FINITE else SINGULAR, iterations, cost, covariance
    inverse_from_cholesky(factor, covariance, SIZE)
    for j in range(SIZE):
        if not free[j]:
            covariance[j, j] = 0.0
    return status, iterations, cost, covariance

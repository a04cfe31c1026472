"""Kernels of the maximum a-posteriori position of a transponder from ranges: see :mod:`map_estimator`.

Minimised over the place p of one transponder, with prior N(p0, Y0⁻¹), ranges z_i from places q_i, e_i = z_i - ‖p - q_i‖
and variances 1/w_i (SPEC §8):

    J(p) = ½ (p - p0)ᵀ Y0 (p - p0) + Σ ρ(w_i e_i²),   ρ(u²) = ½ u², or Huber's loss.

Gauss and Newton's step solves Y δ = b with Y = Y0 + Σ w_i h_i h_iᵀ and b = -∇J, h_i the unit vector from q_i to p. The
term that it leaves out of the curvature is -s I with s = Σ w_i e_i / r_i, but for a part e_i / r_i of Y. It decides
how the step converges along the circle on which few ranges leave the transponder: with the prior mean D away from
the vehicle and a range r the plain step overshoots D / r-fold there, and runs away beyond 2. The step is therefore
damped by -s (which makes it Newton's, to e / r), by more after a step that would raise the cost, and never
accepted if it does (Levenberg).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.map_estimator_lanes import normal_equations
from aquaquad_envs.estimation.symmetric3 import determinant3, quadratic3, solve3

#: Meaning of a status, by its code.
STATUSES = (
    "converged",
    "iterations exhausted",
    "singular: the ranges and the prior do not fix a point",
    "not finite: the start, the prior or the cost",
)
CONVERGED, ITERATIONS, SINGULAR, NOT_FINITE = range(4)
#: A descent that was given up because it cannot end below the bar; never leaves this module.
_ABANDONED = 4
#: Where the vehicle's depth varies: rise of twice the prior's cost up to which the image above or below is tried.
_UNEVEN = 40.0


class MapSettings(NamedTuple):
    """Scalars of the estimator as kernels read them."""

    sigma: float  # standard deviation of a range, m, where no weights are given
    tolerance: float  # step at which the descent has converged, m
    max_iterations: int
    huber: float  # residual, in standard deviations, beyond which the loss is linear; 0: never
    mirror: bool  # look on the other side of the track, too


@kernel
def _damped_step(n, damping):
    """Solution of (Y + damping I) δ = b for the normal equations ``n``; NaN where not positive definite."""
    return solve3((n[4] + damping, n[5], n[6], n[7] + damping, n[8], n[9] + damping), n[1], n[2], n[3])


@kernel
def _regular(n):
    """Whether Y fixes a point, to rounding."""
    return determinant3((n[4], n[5], n[6], n[7], n[8], n[9])) > 1e-14 * n[4] * n[7] * n[9]


@loop_kernel
def _leave_saddle(count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x, y, z, n):
    """A point of lower cost along the direction of least information, from a saddle point with equations ``n``.

    Such is a start on the plane of symmetry of the track. Where both ways lead down, deeper is taken.
    """
    slight = 1e-9 * (n[4] + n[7] + n[9])
    vx, vy, vz = 0.9, -1.1, 1.0
    for _ in range(10):  # inverse iteration
        vx, vy, vz = solve3((n[4] + slight, n[5], n[6], n[7] + slight, n[8], n[9] + slight), vx, vy, vz)
        scale = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
        vx *= scale
        vy *= scale
        vz *= scale
    if vz < 0.0:
        vx, vy, vz = -vx, -vy, -vz
    length = 100.0 * settings.tolerance
    best = n[0]
    gone = 0.0
    for _ in range(60):
        cost = normal_equations(
            count, px, py, pz, ranges, weights, prior_mean, prior_information, settings,
            x + length * vx, y + length * vy, z + length * vz,
        )[0]  # fmt: skip
        if not cost < best:
            break
        best = cost
        gone = length
        length *= 2.0
    return x + gone * vx, y + gone * vy, z + gone * vz, gone > 0.0


@kernel
def _nearer(x, y, z, a, b):
    """Whether (x, y, z) is nearer to ``a`` than to ``b``."""
    ax, ay, az = x - a[0], y - a[1], z - a[2]
    bx, by, bz = x - b[0], y - b[1], z - b[2]
    return ax * ax + ay * ay + az * az < bx * bx + by * by + bz * bz


@loop_kernel
def _descend(
    count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x, y, z, bar, solution
):
    """Damped descent from (x, y, z): status, iterations, the point and its normal equations.

    Given up (from an image of a ``solution`` with cost ``bar``) once it has come nearer to the solution than to
    the image, or once not even four times the decrease that the equations promise would end below the bar.
    """
    n = normal_equations(count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x, y, z)
    if not n[0] < np.inf:
        return NOT_FINITE, 0, x, y, z, n
    start = (x, y, z)
    damping = 0.0
    escapes = 0
    for iteration in range(settings.max_iterations):
        dx, dy, dz = _damped_step(n, damping - n[10])
        convex = abs(dx + dy + dz) < np.inf
        if not convex:
            dx, dy, dz = _damped_step(n, damping)
            if not abs(dx + dy + dz) < np.inf:
                trace = n[4] + n[7] + n[9]
                if not trace > 0.0:
                    return SINGULAR, iteration, x, y, z, n
                damping = max(10.0 * damping, 1e-9 * trace)
                continue
        length = dx * dx + dy * dy + dz * dz
        promise = n[1] * dx + n[2] * dy + n[3] * dz
        if length <= settings.tolerance * settings.tolerance:
            if not _regular(n):
                return SINGULAR, iteration, x, y, z, n
            if convex and damping == 0.0:
                return CONVERGED, iteration, x, y, z, n
            if not convex:
                x, y, z, left = _leave_saddle(
                    count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x, y, z, n
                )
                escapes += 1
                if not left or escapes > 3:
                    return (CONVERGED if not left else ITERATIONS), iteration, x, y, z, n
                n = normal_equations(
                    count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x, y, z
                )
                damping = 0.0
                continue
        if bar < np.inf and (n[0] - 2.0 * promise > bar or _nearer(x, y, z, solution, start)):
            return _ABANDONED, iteration, x, y, z, n
        trial = normal_equations(
            count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, x + dx, y + dy, z + dz
        )  # fmt: skip
        # Curvature met along the step: the scale on which damping acts.
        met = promise / length
        if trial[0] <= n[0] * (1.0 + 1e-12):
            x += dx
            y += dy
            z += dz
            n = trial
            damping = 0.1 * damping if damping > 0.1 * met else 0.0
        else:
            damping = max(4.0 * damping, met)
    return ITERATIONS, settings.max_iterations, x, y, z, n


@kernel
def across_the_track(count, px, py, ranges, x, y):
    """Image of (x, y) across the straight line that fits the places of the ranges best; of a point, through it."""
    m = 0.0
    sx = 0.0
    sy = 0.0
    sxx = 0.0
    sxy = 0.0
    syy = 0.0
    x0 = px[0]
    y0 = py[0]
    for i in range(count):
        if ranges[i] == ranges[i]:
            # From the first place, so that large coordinates keep their digits.
            dx = px[i] - x0
            dy = py[i] - y0
            m += 1.0
            sx += dx
            sy += dy
            sxx += dx * dx
            sxy += dx * dy
            syy += dy * dy
    if m == 0.0:
        return x, y
    sx /= m
    sy /= m
    # The line's direction θ by its double: no angles are needed to reflect.
    even = sxx - syy - m * (sx * sx - sy * sy)
    odd = 2.0 * (sxy - m * sx * sy)
    size = np.sqrt(even * even + odd * odd)
    dx = x - x0 - sx
    dy = y - y0 - sy
    if not size > 0.0:
        return x0 + sx - dx, y0 + sy - dy
    return x0 + sx + (even * dx + odd * dy) / size, y0 + sy + (odd * dx - even * dy) / size


@loop_kernel
def solve(count, px, py, pz, ranges, weights, prior_mean, prior_information, settings, estimate, information):
    """Minimum of J from ``estimate`` (3,) into it, Y there into ``information`` (6,): status, iterations, cost.

    Arguments as :func:`normal_equations`. Two symmetries give minima of their own:

    - Ranges taken at one depth do not tell above from below. A vehicle at the surface (``pz`` None) has nothing above:
      a solution there is left for the one below, whatever the prior (a prior mean in the air is an error of its
      draw, not knowledge). At depth the prior decides.
    - Ranges taken on a straight line do not tell its sides apart; on a bent one they do by as much as their residuals
      grow. The image is tried each time, for the next measurement may turn the balance. Mostly it is given up
      after one or two looks at the ranges: a third of a solution from a warm start.

    With ``pz`` given neither symmetry is exact, and no image is given up.
    """
    x, y, z = estimate[0], estimate[1], estimate[2]
    if not abs(x + y + z) < np.inf:
        x, y, z = prior_mean[0], prior_mean[1], prior_mean[2]
    status, iterations, x, y, z, n = _descend(
        count, px, py, pz, ranges, weights, prior_mean, prior_information, settings,
        x, y, z, np.inf, (x, y, z),
    )  # fmt: skip
    if settings.mirror and count > 0 and status != NOT_FINITE:
        for side in range(2):
            ix, iy, iz = x, y, z
            bar = n[0] if pz is None else np.inf
            if side == 0:
                bar = np.inf
                if pz is None:
                    if z >= 0.0:
                        continue
                    iz = -z
                else:
                    iz = 2.0 * np.mean(pz[:count]) - z
                    dx = x - prior_mean[0]
                    dy = y - prior_mean[1]
                    here = quadratic3(prior_information, dx, dy, z - prior_mean[2])
                    there = quadratic3(prior_information, dx, dy, iz - prior_mean[2])
                    if there >= here + _UNEVEN:
                        continue
            else:
                ix, iy = across_the_track(count, px, py, ranges, x, y)
            other, more, ix, iy, iz, image = _descend(
                count, px, py, pz, ranges, weights, prior_mean, prior_information, settings,
                ix, iy, iz, bar, (x, y, z),
            )  # fmt: skip
            iterations += more
            better = image[0] < n[0]
            if pz is None and (z < 0.0) != (iz < 0.0):
                better = z < 0.0
            if other <= SINGULAR and better:
                status, x, y, z, n = other, ix, iy, iz, image
    estimate[0] = x
    estimate[1] = y
    estimate[2] = z
    for k in range(6):
        information[k] = n[4 + k]
    return status, iterations, n[0]


@loop_kernel
def solve_point(count, px, py, ranges, prior_mean, prior_information, settings, estimate, information):
    """Maximum a-posteriori place of one transponder by a vehicle at the surface; returns its status (``STATUSES``).

    px, py (n,): places of the vehicle, m; ranges (n,), m, NaN where there was no reply; the first ``count`` are read.
    prior_mean (3,), m; prior_information (6,), m⁻², packed. estimate (3,): the start, then the solution (a start
    that is not finite: from the prior mean). information (6,): Y = P0⁻¹ + σ⁻² Σ h hᵀ there (with Huber's weights).
    """
    return solve(
        count, px, py, None, ranges, None, prior_mean, prior_information, settings, estimate, information
    )[0]

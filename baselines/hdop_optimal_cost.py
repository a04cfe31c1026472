"""What ``hdop-optimal`` minimises, and the descent over vehicles; compiled.

The tracker's covariance P is carried on over the look-ahead, decision by decision: P ← Φ P Φᵀ + Q, then
P ← (P⁻¹ + J)⁻¹ with the position information J that the team would gather where its paths lead (the sum that
HDOP inverts). The cost is

    ½ ln(mean of trace P_position) + 3 · mean of (1 - coverage of the fence) + price · flight energy,

the logarithm of the predicted RMSE: a price of 0.01 a Wh asks a hop of 5 Wh for 5 % of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.kalman_motion import predict_covariance
from aquaquad_envs.sensing.emissions import PERIODIC, RANDOM
from aquaquad_envs.sensing.measurements import TDOA, distance_to, measurement_gradient, measurement_std
from aquaquad_envs.sensing.sonar import detection_probability
from aquaquad_envs.tasks.sensor_placement_coverage import SAMPLES
from aquaquad_envs.tasks.sensor_placement_data import MAX_TARGETS, MAX_VEHICLES, RUNNING
from aquaquad_envs.tasks.sensor_placement_targets import fence_point

#: Sweeps over all vehicles at most.
_SWEEPS = 6
#: A measurement from within so many standard deviations (squared) of the target counts half.
CAUTION = 4.0
#: The whole fence against a factor of e in the predicted RMSE.
FENCE_WEIGHT = 3.0
#: What a change must gain.
_LEAST_GAIN = 1e-9


class Beliefs(NamedTuple):
    """Scratch memory of one world's prediction."""

    track: np.ndarray  # (targets, decisions, 2) m, where targets are expected
    covariance: np.ndarray  # (n, n)
    columns: np.ndarray  # (n, 2)
    weight: np.ndarray  # (vehicles,) expected share of measurements
    chosen: np.ndarray  # (vehicles,) path of each

    @staticmethod
    def allocate(states: int, decisions: int) -> Beliefs:
        """Memory for a tracker of ``states`` states."""
        return Beliefs(
            np.zeros((MAX_TARGETS, decisions, 2)), np.zeros((states, states)), np.zeros((states, 2)),
            np.zeros(MAX_VEHICLES), np.zeros(MAX_VEHICLES, np.int64),
        )  # fmt: skip


@kernel
def add_information(covariance, columns, a, b, d):
    """P ← (P⁻¹ + J)⁻¹ with J = [[a, b], [b, d]] on the position, in place; ``columns`` (n, 2) is scratch.

    By the matrix inversion lemma P ← P - P_·p M P_p·, M = (1 + J P_pp)⁻¹ J, which takes a singular J too. For
    plans: the filters and the bound keep to square roots.
    """
    n = covariance.shape[0]
    p, q, r = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    m00 = 1.0 + a * p + b * q
    m01 = a * q + b * r
    m10 = b * p + d * q
    m11 = 1.0 + b * q + d * r
    scale = 1.0 / (m00 * m11 - m01 * m10)
    xx = scale * (m11 * a - m01 * b)
    xy = scale * (m11 * b - m01 * d)
    yy = scale * (m00 * d - m10 * b)
    for k in range(n):
        columns[k, 0] = covariance[k, 0]
        columns[k, 1] = covariance[k, 1]
    for k in range(n):
        left_x = columns[k, 0] * xx + columns[k, 1] * xy
        left_y = columns[k, 0] * xy + columns[k, 1] * yy
        for m in range(n):
            covariance[k, m] -= left_x * columns[m, 0] + left_y * columns[m, 1]


@kernel
def heard_share(c):
    """Expected share of sub-steps in which a target is heard by a vehicle whose link works."""
    share = 1.0 - c.dropout
    if c.emissions.kind == PERIODIC:
        share *= min(1.0, c.action_period / c.sub_steps / c.emissions.period)
    elif c.emissions.kind == RANDOM:
        share *= c.emissions.mean_on / (c.emissions.mean_on + c.emissions.mean_off)
    return share


@kernel
def _add_row(i, k, x, y, d, spread2, paths, beliefs, c):
    """Information about (x, y) of the measurement of vehicle ``i`` (TDOA: with ``k``) in one sub-step."""
    ix, iy = paths.x[i, beliefs.chosen[i], d], paths.y[i, beliefs.chosen[i], d]
    kx, ky = paths.x[k, beliefs.chosen[k], d], paths.y[k, beliefs.chosen[k], d]
    gx, gy = measurement_gradient(c.kind, x, y, ix, iy, kx, ky, c.sound_speed)
    sigma = c.std
    if c.noise_level > 0.0:
        sigma = measurement_std(c.kind, c.std, c.noise_level, c.noise_reference, x, y, ix, iy, kx, ky)
    r2 = (x - ix) * (x - ix) + (y - iy) * (y - iy)
    # The direction to a target that is known less well than its distance is not known.
    weight = min(beliefs.weight[i], beliefs.weight[k]) * r2 / (r2 + CAUTION * spread2) / (sigma * sigma)
    return weight * gx * gx, weight * gx * gy, weight * gy * gy


@loop_kernel
def expected_information(w, x, y, d, begin, spread2, paths, beliefs, c):
    """(J_xx, J_xy, J_yy), 1/m², that the team's paths gather about (x, y) in one sub-step of decision ``d``.

    ``begin``: the share of the decision that is over when the sub-step ends; negative for the mean of all sub-steps.
    ``spread2``, m²: variance of the target's position, by which measurements from near it count less.
    """
    a = 0.0
    b = 0.0
    e = 0.0
    nearest = -1
    least = np.inf
    for i in range(c.num_vehicles):
        k = beliefs.chosen[i]
        share = paths.share[i, k, d]
        if begin >= 0.0:
            # Its measurements are the decision's last.
            share = 1.0 if share > 0.0 and begin + share > 1.0 - 1e-9 else 0.0
        beliefs.weight[i] = share if w.agent_outcome[i] == RUNNING else 0.0
        if beliefs.weight[i] > 0.0:
            away = distance_to(x, y, paths.x[i, k, d], paths.y[i, k, d])
            beliefs.weight[i] *= detection_probability(c.sonar, away)
            if away < least:
                least = away
                nearest = i
    for i in range(c.num_vehicles):
        if beliefs.weight[i] <= 0.0:
            continue
        if c.kind != TDOA:
            p, q, r = _add_row(i, i, x, y, d, spread2, paths, beliefs, c)
            a += p
            b += q
            e += r
        elif c.all_pairs:
            for k in range(i):
                if beliefs.weight[k] > 0.0:
                    p, q, r = _add_row(i, k, x, y, d, spread2, paths, beliefs, c)
                    a += p
                    b += q
                    e += r
        elif i != nearest:
            p, q, r = _add_row(i, nearest, x, y, d, spread2, paths, beliefs, c)
            a += p
            b += q
            e += r
    return a, b, e


@kernel
def _advance(w, j, d, dt, begin, measurements, paths, beliefs, c):
    """Carry the covariance of track ``j`` on by ``dt`` s and the information of ``measurements`` sub-steps."""
    covariance = beliefs.covariance
    predict_covariance(covariance, dt, c.motion)
    a, b, e = expected_information(
        w, beliefs.track[j, d, 0], beliefs.track[j, d, 1], d, begin, covariance[0, 0] + covariance[1, 1], paths,
        beliefs, c,
    )  # fmt: skip
    add_information(covariance, beliefs.columns, measurements * a, measurements * b, measurements * e)
    return covariance[0, 0] + covariance[1, 1]


@loop_kernel
def predicted_mean_square(w, decisions, most, paths, beliefs, c):
    """Mean over targets and decisions of the tracker's predicted variance of position, m²; inf if over ``most``.

    The first decision is followed sub-step by sub-step: whoever flies does not hear, and a whole team in the
    air loses a track that is still wide.
    """
    total = 0.0
    heard = heard_share(c)
    covariance = beliefs.covariance
    n = covariance.shape[0]
    step = c.action_period / c.sub_steps
    for j in range(c.num_targets):
        for k in range(n):
            for m in range(n):
                covariance[k, m] = w.covariance[j, k, m]
        for part in range(c.sub_steps):
            begin = part / c.sub_steps
            total += _advance(w, j, 0, step, begin, heard, paths, beliefs, c) / c.sub_steps
        for d in range(1, decisions):
            total += _advance(w, j, d, c.action_period, -1.0, heard * c.sub_steps, paths, beliefs, c)
            if total > most * decisions * c.num_targets:
                return np.inf
    return total / (decisions * c.num_targets)


@loop_kernel
def predicted_coverage(w, decisions, paths, beliefs, c):
    """Mean over decisions of the share of the moving fence that the paths cover."""
    count = SAMPLES * c.num_vehicles
    total = 0.0
    for d in range(decisions):
        later = (d + 0.5) * c.action_period
        for k in range(count):
            x, y = fence_point(w, (k + 0.5) / count)
            x += later * w.fence_u
            y += later * w.fence_v
            best = 0.0
            for i in range(c.num_vehicles):
                at = beliefs.chosen[i]
                near = distance_to(x, y, paths.x[i, at, d], paths.y[i, at, d]) <= c.fence_cover
                if near and w.agent_outcome[i] == RUNNING:
                    best = max(best, paths.share[i, at, d])
            total += best
    return total / (count * decisions)


@loop_kernel
def cost(w, decisions, most, paths, beliefs, c, settings):
    """The cost, without unit, of the paths ``beliefs.chosen``; infinite if it is over ``most``."""
    value = 0.0
    for i in range(c.num_vehicles):
        if w.agent_outcome[i] == RUNNING:
            value += settings.price * paths.energy[i, beliefs.chosen[i]]
    if c.fence:
        value += FENCE_WEIGHT * (1.0 - predicted_coverage(w, decisions, paths, beliefs, c))
    if c.num_targets > 0:
        # Most changes cost more, and show it early.
        limit = np.exp(2.0 * min(most - value, 100.0))
        square = predicted_mean_square(w, decisions, limit, paths, beliefs, c)
        value += 0.5 * np.log(max(square, 1e-12))
    return value


@loop_kernel
def descend(w, places, decisions, paths, beliefs, c, settings):
    """Change one vehicle's path after another to the best of its usable ones until none gains; the cost.

    Paths from ``places`` on (those assigned) are left out. Starts from ``beliefs.chosen`` and leaves the best there.
    """
    best = cost(w, decisions, np.inf, paths, beliefs, c, settings)
    for _ in range(_SWEEPS):
        before = best
        for i in range(c.num_vehicles):
            if w.agent_outcome[i] != RUNNING:
                continue
            kept = beliefs.chosen[i]
            for k in range(places):
                if paths.usable[i, k] and k != kept:
                    beliefs.chosen[i] = k
                    value = cost(w, decisions, best, paths, beliefs, c, settings)
                    if value < best - _LEAST_GAIN:
                        best = value
                        kept = k
            beliefs.chosen[i] = kept
        if not best < before:
            break
    return best

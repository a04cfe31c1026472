"""Transponders, their ranges, and what is believed of them; compiled."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.map_estimator_kernels import CONVERGED, solve_point
from aquaquad_envs.estimation.symmetric3 import log_determinant3
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.tasks.open_water import open_water_near
from aquaquad_envs.tasks.transponder_localization_data import MAX_TRANSPONDERS


@kernel
def start_transponders(w, middle_x, middle_y, ocean, c):
    """Place the transponders, given or drawn about the middle, and draw the first estimates about them."""
    w.num_transponders = c.fewest + int(uniform(w.rng_target) * (c.most - c.fewest + 1))
    for m in range(MAX_TRANSPONDERS):
        w.status[m] = CONVERGED
        w.replies[m] = 0
        for k in range(6):
            w.information[m, k] = 0.0
        for k in range(3):
            w.target[m, k] = 0.0
            w.prior_mean[m, k] = 0.0
            w.estimate[m, k] = 0.0
        for k in range(w.ranges.shape[1]):
            w.ranges[m, k] = 0.0
    for m in range(w.num_transponders):
        if m < c.transponders.shape[0]:
            for k in range(3):
                w.target[m, k] = c.transponders[m, k]
        else:
            x, y = open_water_near(w.rng_target, ocean, c, w.obstacle, middle_x, middle_y, c.spread)
            w.target[m, 0] = x
            w.target[m, 1] = y
            w.target[m, 2] = c.depth_low + (c.depth_high - c.depth_low) * uniform(w.rng_target)
        w.prior_mean[m, 0] = w.target[m, 0] + c.prior_std_x * normal(w.rng_initial)
        w.prior_mean[m, 1] = w.target[m, 1] + c.prior_std_y * normal(w.rng_initial)
        # Nobody takes a transponder for a thing in the air: an estimate above the water is its image below.
        w.prior_mean[m, 2] = abs(w.target[m, 2] + c.prior_std_z * normal(w.rng_initial))
        for k in range(3):
            w.estimate[m, k] = w.prior_mean[m, k]
        for k in range(6):
            w.information[m, k] = c.prior_information[k]
    for k in range(w.place_x.size):
        w.place_x[k] = 0.0
        w.place_y[k] = 0.0
    w.count = 0
    w.diverged = 0
    w.range_scale = 1.0
    if c.sound_speed_error > 0.0:
        w.range_scale = max(1.0 + c.sound_speed_error * normal(w.rng_sensor), 0.1)


@kernel
def _measured(w, m, c):
    """One range to transponder ``m``, m, with all that may be wrong with it; NaN where there is no reply."""
    dx = w.target[m, 0] - w.x
    dy = w.target[m, 1] - w.y
    dz = w.target[m, 2]
    value = w.range_scale * np.sqrt(dx * dx + dy * dy + dz * dz) + c.sigma * normal(w.rng_sensor)
    if c.outlier_share > 0.0:
        late = c.outlier_scale * abs(normal(w.rng_sensor))
        value += late if uniform(w.rng_sensor) < c.outlier_share else 0.0
    if c.miss_share > 0.0 and uniform(w.rng_sensor) < c.miss_share:
        value = np.nan
    return value


@loop_kernel
def measure(w, c):
    """Measure all ranges at the vehicle's place, and estimate every transponder that replied anew."""
    epoch = w.count
    w.place_x[epoch] = w.x
    w.place_y[epoch] = w.y
    w.count = epoch + 1
    for m in range(w.num_transponders):
        value = _measured(w, m, c)
        w.ranges[m, epoch] = value
        if value == value:
            w.replies[m] += 1
            w.status[m] = solve_point(
                w.count, w.place_x, w.place_y, w.ranges[m], w.prior_mean[m], c.prior_information, c.settings,
                w.estimate[m], w.information[m],
            )  # fmt: skip
            w.diverged += 1 if w.status[m] != CONVERGED else 0
    w.log_det = 0.0
    for m in range(w.num_transponders):
        w.log_det += log_determinant3(w.information[m])


@kernel
def squared_error(w):
    """Mean square, m², of the distance from estimate to transponder."""
    total = 0.0
    for m in range(w.num_transponders):
        for k in range(3):
            total += (w.estimate[m, k] - w.target[m, k]) ** 2
    return total / w.num_transponders

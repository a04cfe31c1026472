"""Where a transponder may be besides its estimate: images of it that the ranges fit as well.

Ranges from one place leave a circle about it, ranges from two leave two sides. The estimate is one point of those; a
plan that trusts it plans for a direction that chance chose. Here the images are found and weighted:

- from one place: the estimate turned about it by eighths of a circle;
- from two: its image across the line that joins them.

An image at p weighs exp(J(p*) - J(p)) against the estimate p*, J the estimator's cost (prior and ranges,
:mod:`aquaquad_envs.estimation.map_estimator_kernels`). What the ranges tell at p is linearised there. From the third
reply on the estimate stands alone: a bend of the track tells its side. Ours; Garcia (UC Riverside 2018) plans about the
estimate alone.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.map_estimator_kernels import across_the_track
from aquaquad_envs.estimation.map_estimator_lanes import normal_equations
from aquaquad_envs.estimation.symmetric3 import PACKED
from aquaquad_envs.tasks.transponder_localization_data import MAX_TRANSPONDERS

#: Places on a circle.
AROUND = 8
MAX_PLACES = AROUND * MAX_TRANSPONDERS
#: From more replies than this a bend of the track tells the side.
MOST_REPLIES = 2
#: An image that weighs less, against the estimate, is left out.
_LEAST = 0.01
_COS, _SIN = (
    np.cos(2.0 * np.pi * np.arange(AROUND) / AROUND),
    np.sin(2.0 * np.pi * np.arange(AROUND) / AROUND),
)


@kernel
def _reply_places(w, m):
    """Replies of ``m``, index of the first place it replied at, and the greatest distance, m, of another from it."""
    replies = 0
    first = -1
    farthest = 0.0
    for i in range(w.count):
        if w.ranges[m, i] == w.ranges[m, i]:
            replies += 1
            if first < 0:
                first = i
            dx = w.place_x[i] - w.place_x[first]
            dy = w.place_y[i] - w.place_y[first]
            farthest = max(farthest, np.sqrt(dx * dx + dy * dy))
    return replies, first, farthest


@loop_kernel
def _weigh(w, m, x, y, z, c, information):
    """Cost J of transponder ``m`` at (x, y, z), and what the ranges tell of it there into ``information`` (6,)."""
    n = normal_equations(
        w.count, w.place_x, w.place_y, None, w.ranges[m], None, w.prior_mean[m], c.prior_information, c.settings,
        x, y, z,
    )  # fmt: skip
    for k in range(PACKED):
        information[k] = n[4 + k]
    return n[0]


@loop_kernel
def possible_places(w, c, targets, information, share):
    """Estimates of world ``w`` and their images: ``targets`` (P, 3), ``information`` (P, 6), ``share`` (P,).

    Shares of a transponder add up to 1. Returns how many there are, and the greatest share, over transponders, that
    images have.
    """
    count = 0
    unsure = 0.0
    for m in range(w.num_transponders):
        x, y, z = w.estimate[m, 0], w.estimate[m, 1], w.estimate[m, 2]
        own = count
        for k in range(3):
            targets[own, k] = w.estimate[m, k]
        for k in range(PACKED):
            information[own, k] = w.information[m, k]
        share[own] = 1.0
        count += 1
        replies, first, farthest = _reply_places(w, m)
        circle = farthest < c.sigma
        if replies == 0 or not (circle or replies <= MOST_REPLIES):
            continue
        # The estimate's own information is the world's: that of its last reply.
        cost = _weigh(w, m, x, y, z, c, information[count])
        total = 1.0
        for k in range(1, AROUND if circle else 2):
            if circle:
                dx = x - w.place_x[first]
                dy = y - w.place_y[first]
                ix = w.place_x[first] + _COS[k] * dx - _SIN[k] * dy
                iy = w.place_y[first] + _SIN[k] * dx + _COS[k] * dy
            else:
                ix, iy = across_the_track(w.count, w.place_x, w.place_y, w.ranges[m], x, y)
            weight = np.exp(min(cost - _weigh(w, m, ix, iy, z, c, information[count]), 0.0))
            # Written so that NaN counts as nothing.
            if weight >= _LEAST:
                targets[count, 0] = ix
                targets[count, 1] = iy
                targets[count, 2] = z
                share[count] = weight
                total += weight
                count += 1
        for k in range(own, count):
            share[k] /= total
        unsure = max(unsure, 1.0 - share[own])
    return count, unsure

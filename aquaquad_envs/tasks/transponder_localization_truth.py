"""What the places of an episode are worth to transponders at their true positions: no part of any decision."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.symmetric3 import PACKED, add_line_of_sight, log_determinant3


@kernel
def true_information(w, m, prior_information, weight, y):
    """Y_m = P0⁻¹ + σ⁻² Σ h hᵀ into ``y``, h at the true position, of the ranges that transponder ``m`` replied to.

    In nominal noise: neither outliers nor a robust loss change it.
    """
    for i in range(PACKED):
        y[i] = prior_information[i]
    for j in range(w.count):
        if w.ranges[m, j] == w.ranges[m, j]:
            add_line_of_sight(
                y, w.target[m, 0] - w.place_x[j], w.target[m, 1] - w.place_y[j], w.target[m, 2], weight
            )


@loop_kernel
def true_log_det(worlds, prior_information, weight, out):
    """Σ_m ln det Y_m at the true positions, (n,), into ``out``; ``weight`` is σ⁻², 1/m².

    The published Σ ln det is taken at the estimates, where an error can make it greater than any at the truth.
    """
    y = np.zeros(PACKED)
    for k in range(worlds.size):
        w = worlds[k]
        out[k] = 0.0
        for m in range(w.num_transponders):
            true_information(w, m, prior_information, weight, y)
            out[k] += log_determinant3(y)

"""Horizontal dilution of precision (HDOP) of a team of sensors about a target.

HDOP = sqrt(trace((HᵀH)⁻¹)), H the Jacobian of the measurements with respect to the target's
(x, y), one row a sensor (Dillard 2014, IV.A). Singular geometry is ``inf``.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel


@kernel
def bearing_hdop(x, y, team, target_x, target_y):
    """HDOP, m/rad, of bearings from a sensor at (x, y) and from ``team`` (n, 2), m, to the target.

    Row of sensor i: [-(y_t - y_i), x_t - x_i] / r_i². ``inf`` where fewer than two sensors
    bear, all bearings are collinear, or a sensor stands on the target.
    """
    a = 0.0
    b = 0.0
    d = 0.0
    for i in range(team.shape[0] + 1):
        if i < team.shape[0]:
            dx = target_x - team[i, 0]
            dy = target_y - team[i, 1]
        else:
            dx = target_x - x
            dy = target_y - y
        r2 = dx * dx + dy * dy
        if r2 <= 0.0:
            return np.inf
        a += dy * dy / (r2 * r2)
        b -= dx * dy / (r2 * r2)
        d += dx * dx / (r2 * r2)
    determinant = a * d - b * b
    # Written so that NaN (weights that overflow, a sensor all but on the target) is singular too.
    if not determinant > 1e-12 * a * d:
        return np.inf
    return np.sqrt((a + d) / determinant)

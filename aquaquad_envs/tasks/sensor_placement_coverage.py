"""How well a team covers the fence, compiled.

The fence is judged at ``SAMPLES`` places a vehicle, evenly along it. A place is covered while a vehicle lies on the
water within ``fence_cover`` of it.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.tasks.sensor_placement_targets import fence_point

#: Places of the fence a vehicle.
SAMPLES = 8


@kernel
def _covered(w, x, y, afloat, c):
    for i in range(c.num_vehicles):
        if afloat[i]:
            dx = w.x[i] - x
            dy = w.y[i] - y
            if dx * dx + dy * dy <= c.fence_cover * c.fence_cover:
                return True
    return False


@kernel
def coverage(w, afloat, c):
    """Share of the fence that vehicles with ``afloat`` (8,) cover."""
    count = SAMPLES * c.num_vehicles
    total = 0
    for k in range(count):
        x, y = fence_point(w, (k + 0.5) / count)
        if _covered(w, x, y, afloat, c):
            total += 1
    return total / count


@kernel
def nearest_gap(w, afloat, x, y, c):
    """The nearest place of the fence that vehicles with ``afloat`` leave uncovered; (x, y) itself if there is none."""
    count = SAMPLES * c.num_vehicles
    best_x = x
    best_y = y
    least = np.inf
    for k in range(count):
        a, b = fence_point(w, (k + 0.5) / count)
        away = (a - x) * (a - x) + (b - y) * (b - y)
        if away < least and not _covered(w, a, b, afloat, c):
            least = away
            best_x = a
            best_y = b
    return best_x, best_y


@kernel
def nearest_on_fence(w, x, y, c):
    """The nearest place of the fence, whoever covers it."""
    count = SAMPLES * c.num_vehicles
    best_x = x
    best_y = y
    least = np.inf
    for k in range(count):
        a, b = fence_point(w, (k + 0.5) / count)
        away = (a - x) * (a - x) + (b - y) * (b - y)
        if away < least:
            least = away
            best_x = a
            best_y = b
    return best_x, best_y

"""HDOP of a team as it believes it to be, and as it would be after hops: many formations at once, one a lane; compiled.

A lane is a formation: all vehicles' places with a weight of 1 or 0. Gradients and deviations are those of
:mod:`aquaquad_envs.sensing.measurements`; pairs as :mod:`~aquaquad_envs.tasks.sensor_placement_sensing` forms them.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.estimation.hdop import hdop_of_information
from aquaquad_envs.sensing.measurements import TDOA, measurement_gradient, measurement_std
from aquaquad_envs.tasks.sensor_placement_data import FORMATIONS, HEADINGS_DEG

#: Of the headings of hops that are looked at.
COS = np.cos(np.radians(HEADINGS_DEG))
SIN = np.sin(np.radians(HEADINGS_DEG))


@kernel
def squash(value, scale):
    """``value`` ≥ 0 brought into [0, 1]: a half at ``scale``."""
    return value / (value + scale)


@lane_kernel
def _find_nearest(px, py, weight, least, rx, ry, x, y):
    """Keep the place of the nearest vehicle to (x, y) so far, and its squared distance, in every lane."""
    for k in range(least.size):
        dx = px[k] - x
        dy = py[k] - y
        away = dx * dx + dy * dy if weight[k] > 0.0 else np.inf
        nearer = away < least[k]
        least[k] = away if nearer else least[k]
        rx[k] = px[k] if nearer else rx[k]
        ry[k] = py[k] if nearer else ry[k]


@lane_kernel
def _add_row(px, py, weight, ox, oy, other, a, b, d, x, y, kind, std, level, reference, sound_speed):
    """Add the information of one row, J += w g gᵀ / σ², in every lane."""
    for k in range(a.size):
        gx, gy = measurement_gradient(kind, x, y, px[k], py[k], ox[k], oy[k], sound_speed)
        sigma = measurement_std(kind, std, level, reference, x, y, px[k], py[k], ox[k], oy[k])
        scale = weight[k] * other[k] / (sigma * sigma)
        a[k] += scale * gx * gx
        b[k] += scale * gx * gy
        d[k] += scale * gy * gy


@lane_kernel
def _add_squashed(a, b, d, total, cap, scale):
    for k in range(a.size):
        total[k] += squash(min(hdop_of_information(a[k], b[k], d[k]), cap), scale)


@loop_kernel
def formation_information(w, j, lanes, c, s):
    """Information of ``lanes`` formations about target ``j`` where it is believed, 1/m².

    xx, xy and yy into ``s.lane_a``, ``s.lane_b`` and ``s.lane_d``.
    """
    x = w.estimate[j, 0]
    y = w.estimate[j, 1]
    a, b, d = s.lane_a[:lanes], s.lane_b[:lanes], s.lane_d[:lanes]
    rx, ry, least = s.lane_rx[:lanes], s.lane_ry[:lanes], s.lane_least[:lanes]
    ones = s.lane_one[:lanes]
    a[:] = 0.0
    b[:] = 0.0
    d[:] = 0.0
    if c.kind == TDOA and not c.all_pairs:
        least[:] = np.inf
        rx[:] = x
        ry[:] = y
        for i in range(c.num_vehicles):
            _find_nearest(
                s.lane_x[i, :lanes], s.lane_y[i, :lanes], s.lane_weight[i, :lanes], least, rx, ry, x, y
            )
    for i in range(c.num_vehicles):
        px, py, weight = s.lane_x[i, :lanes], s.lane_y[i, :lanes], s.lane_weight[i, :lanes]
        if c.kind == TDOA and c.all_pairs:
            for m in range(i + 1, c.num_vehicles):
                _add_row(
                    px, py, weight, s.lane_x[m, :lanes], s.lane_y[m, :lanes], s.lane_weight[m, :lanes], a, b, d,
                    x, y, c.kind, c.std, c.noise_level, c.noise_reference, c.sound_speed,
                )  # fmt: skip
        else:
            _add_row(
                px, py, weight, rx, ry, ones, a, b, d, x, y, c.kind, c.std, c.noise_level, c.noise_reference,
                c.sound_speed,
            )  # fmt: skip


@loop_kernel
def believed_hdops(w, lanes, scale, c, s):
    """``s.lane_hdop`` of ``lanes`` formations: mean over targets of the believed HDOP, squashed at ``scale``."""
    total = s.lane_hdop[:lanes]
    total[:] = 0.0
    for j in range(c.num_targets):
        formation_information(w, j, lanes, c, s)
        _add_squashed(s.lane_a[:lanes], s.lane_b[:lanes], s.lane_d[:lanes], total, c.hdop_cap, scale)
    for k in range(lanes):
        total[k] /= max(c.num_targets, 1)


@kernel
def present_formation(w, lanes, c, s):
    """The first ``lanes`` formations become the present one: who is afloat, where it is."""
    for i in range(c.num_vehicles):
        weight = 1.0 if s.afloat[i] else 0.0
        for k in range(lanes):
            s.lane_x[i, k] = w.x[i]
            s.lane_y[i, k] = w.y[i]
            s.lane_weight[i, k] = weight
    for k in range(lanes):
        s.lane_one[k] = 1.0


@kernel
def direction_of_nearest(w, i, c):
    """Unit vector from vehicle ``i`` to the nearest estimate."""
    least = np.inf
    ux = 1.0
    uy = 0.0
    for j in range(c.num_targets):
        dx = w.estimate[j, 0] - w.x[i]
        dy = w.estimate[j, 1] - w.y[i]
        away = np.sqrt(dx * dx + dy * dy)
        if away < least and away > 0.0:
            least = away
            ux = dx / away
            uy = dy / away
    return ux, uy


@kernel
def end_of_hop(w, i, k, ux, uy, c):
    """Where a short hop of vehicle ``i`` on heading ``k`` from (ux, uy), the nearest estimate's direction, ends."""
    x = w.x[i] + c.short_hop * (COS[k] * ux - SIN[k] * uy)
    return x, w.y[i] + c.short_hop * (SIN[k] * ux + COS[k] * uy)


@loop_kernel
def hdops_of_changes(w, c, s):
    """HDOP now and after each change of one vehicle alone, into ``s.lane_hdop``.

    Lane 0 is the present formation. Vehicle i has lanes 1 + ``FORMATIONS`` i and on: the team without it, then
    with it a short hop away on each heading from the direction of the nearest estimate.
    """
    lanes = 1 + FORMATIONS * c.num_vehicles
    present_formation(w, lanes, c, s)
    for i in range(c.num_vehicles):
        first = 1 + FORMATIONS * i
        s.lane_weight[i, first] = 0.0
        ux, uy = direction_of_nearest(w, i, c)
        for k in range(COS.size):
            x, y = end_of_hop(w, i, k, ux, uy, c)
            s.lane_x[i, first + 1 + k] = x
            s.lane_y[i, first + 1 + k] = y
    believed_hdops(w, lanes, c.fix_scale, c, s)


@kernel
def sort_keys(count, s):
    """Indices ``s.order`` of the first ``count`` keys ``s.key``, least first; ties in the order of indices."""
    for k in range(count):
        at = k
        while at > 0 and s.key[s.order[at - 1]] > s.key[k]:
            s.order[at] = s.order[at - 1]
            at -= 1
        s.order[at] = k

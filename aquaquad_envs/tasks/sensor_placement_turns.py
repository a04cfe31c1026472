"""What a team would agree on if it hopped in turn, and what it does instead while it is badly placed; compiled.

In turn: each vehicle makes the short hop after which the believed HDOP is least, knowing the hops before its own.
Where the track will not be good after that, the team *regroups*: its hops are changed, one vehicle after another, to
long ones or none, for the least predicted error of the track. A long hop misses the tracker's next step, so it is not
for a team that already hears well, nor for all vehicles at once: the prediction knows both.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, lane_kernel, loop_kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks.sensor_placement_data import FORMATIONS, ROUGH_FIX
from aquaquad_envs.tasks.sensor_placement_hdop import (
    COS,
    believed_hdops,
    direction_of_nearest,
    end_of_hop,
    formation_information,
    present_formation,
    sort_keys,
)

#: Share of the longest step that hops in turn keep from edges and obstacles, and from which a vehicle must leave.
KEEP_CLEAR = 0.15
#: What room, as a share of the longest step, is worth in HDOP to a vehicle that must leave, and how much is enough.
ROOM_WORTH, ROOM_ENOUGH = 0.3, 0.5
#: Predicted error, in errors of a good fix, beyond which a team regroups.
BADLY_PLACED = 1.4
#: Steps of the tracker that are predicted, and what a step leaves of earlier information: the target moves on.
AHEAD, KEPT = 20, 0.9
#: What a Wh of flight must gain, as a share of the predicted error (as ``hdop-optimal`` asks), and any change.
PRICE_PER_WH, LEAST_CHANGE = 0.01, 1e-3
#: Headings of the long hops that are looked at: not away from the target.
_TOWARDS = np.flatnonzero(COS > -0.5)
#: Plans of a vehicle, no hop or one of those, and formations that they are judged by: theirs, and in the first step
#: those without who is in the air, this one among them or not.
_PLANS = 1 + _TOWARDS.size
_LANES = _PLANS + 2
#: Greatest predicted error at an HDOP of 1 m, m.
_MOST_PREDICTED = float(np.sqrt(np.mean((1.0 - KEPT) / (1.0 - KEPT ** np.arange(1, AHEAD + 1)))))


@kernel
def room_at(x, y, w, ocean, c):
    """Distance, m, to what ends a vehicle at (x, y): the nearest obstacle or edge of the box; negative beyond."""
    clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y)
    return min(clear, c.half_width - max(abs(x), abs(y)))


@kernel
def _best_hop(i, hdops, c, s):
    """Index of the least of ``hdops`` (FORMATIONS,), 0: no hop, among the hops that have room to land.

    A vehicle that has none where it is goes where there is more, for the least HDOP and the most room.
    """
    keep = KEEP_CLEAR * c.longest_step
    best = 0
    if s.room[i, 0] >= keep:
        for k in range(1, FORMATIONS):
            if s.room[i, k] > keep and hdops[k] < hdops[best]:
                best = k
        return best
    least = np.inf
    for k in range(1, FORMATIONS):
        cost = hdops[k] - ROOM_WORTH * min(s.room[i, k] / c.longest_step, ROOM_ENOUGH)
        if s.room[i, k] > s.room[i, 0] and cost < least:
            least = cost
            best = k
    return best


@loop_kernel
def hop_in_turn(w, c, s):
    """HDOP, squashed at a rough fix, as the vehicles afloat hop one after another, each where it gains most.

    The one whose best hop alone leaves the least HDOP comes first; all know what those before them do. ``s.turn[i]``
    is the vehicle's turn, 0 first; ``s.turn_hdop[i]`` the HDOP before its turn, and after its hop on each heading;
    (``s.turn_x[i]``, ``s.turn_y[i]``) where those after it count on it, ``s.turn_gain[i]`` what that takes from
    the HDOP.
    Needs the lanes of :func:`~aquaquad_envs.tasks.sensor_placement_hdop.hdops_of_changes` and ``s.room``.
    """
    for i in range(c.num_vehicles):
        first = 1 + FORMATIONS * i
        # The lane without the vehicle stands for no hop here.
        s.lane_hdop[first] = s.lane_hdop[0]
        hdops = s.lane_hdop[first : first + FORMATIONS]
        s.key[i] = hdops[_best_hop(i, hdops, c, s)] if s.afloat[i] else np.inf
        s.turn_hdop[i, :] = 0.0
    sort_keys(c.num_vehicles, s)
    present_formation(w, FORMATIONS, c, s)
    for turn in range(c.num_vehicles):
        i = s.order[turn]
        s.turn[i] = turn
        # Of a vehicle that is not afloat too: scratch memory holds anything.
        s.turn_x[i] = w.x[i]
        s.turn_y[i] = w.y[i]
        s.turn_gain[i] = 0.0
        if not s.afloat[i]:
            continue
        ux, uy = direction_of_nearest(w, i, c)
        for k in range(COS.size):
            x, y = end_of_hop(w, i, k, ux, uy, c)
            s.lane_x[i, 1 + k] = x
            s.lane_y[i, 1 + k] = y
        believed_hdops(w, FORMATIONS, ROUGH_FIX * c.fix_scale, c, s)
        for k in range(FORMATIONS):
            s.turn_hdop[i, k] = s.lane_hdop[k]
        best = _best_hop(i, s.turn_hdop[i], c, s)
        s.turn_gain[i] = s.turn_hdop[i, 0] - s.turn_hdop[i, best]
        s.turn_x[i] = s.lane_x[i, best]
        s.turn_y[i] = s.lane_y[i, best]
        for k in range(FORMATIONS):
            s.lane_x[i, k] = s.turn_x[i]
            s.lane_y[i, k] = s.turn_y[i]


@lane_kernel
def _add_predicted_squares(first_a, first_b, first_d, a, b, d, ya, yb, yd, total, steps, kept):
    """Add Σ trace Y⁻¹ over ``steps`` steps of Y ← kept Y + J in every lane; J is ``first_`` in the first step."""
    for step in range(steps):
        for k in range(total.size):
            ya[k] = kept * ya[k] + (first_a[k] if step == 0 else a[k])
            yb[k] = kept * yb[k] + (first_b[k] if step == 0 else b[k])
            yd[k] = kept * yd[k] + (first_d[k] if step == 0 else d[k])
            total[k] += (ya[k] + yd[k]) / (ya[k] * yd[k] - yb[k] * yb[k])


@loop_kernel
def predicted_log_error(w, count, lanes, c, s):
    """Logarithm of the RMS error, m, predicted for each of ``count`` plans into ``s.lane_hdop``; inf without a track.

    A track's position information Y begins as the inverse of its covariance and is carried on, Y ← 0.9 Y + J, for
    20 steps of the tracker: ½ ln of the mean of trace Y⁻¹ over steps and targets. J is that of formation k for plan
    k, and in the first step that of formation ``s.lane_first[k]``, of the ``lanes`` that there are: whoever is still
    in the air is missing there.
    """
    total = s.lane_hdop[:count]
    fa, fb, fd = s.lane_fa[:count], s.lane_fb[:count], s.lane_fd[:count]
    # Who is nearest is known by then: its memory serves for Y.
    ya, yb, yd = s.lane_rx[:count], s.lane_ry[:count], s.lane_least[:count]
    total[:] = 0.0
    for j in range(c.num_targets):
        formation_information(w, j, lanes, c, s)
        p, q, r = w.covariance[j, 0, 0], w.covariance[j, 0, 1], w.covariance[j, 1, 1]
        determinant = p * r - q * q
        if not determinant > 0.0:
            total[:] = np.inf
            return
        for k in range(count):
            fa[k] = s.lane_a[s.lane_first[k]]
            fb[k] = s.lane_b[s.lane_first[k]]
            fd[k] = s.lane_d[s.lane_first[k]]
        ya[:] = r / determinant
        yb[:] = -q / determinant
        yd[:] = p / determinant
        _add_predicted_squares(
            fa, fb, fd, s.lane_a[:count], s.lane_b[:count], s.lane_d[:count], ya, yb, yd, total, AHEAD, KEPT
        )
    for k in range(count):
        total[k] = 0.5 * np.log(total[k] / (AHEAD * c.num_targets))


@kernel
def _price(w, i, x, y, c):
    """What the hop of vehicle ``i`` to (x, y) costs, as a share of the predicted error."""
    distance = np.sqrt((x - w.x[i]) * (x - w.x[i]) + (y - w.y[i]) * (y - w.y[i]))
    return PRICE_PER_WH * flight_energy_wh(distance, c.airspeed, c.flight_power)


@kernel
def _place(i, k, x, y, weight, s):
    s.lane_x[i, k] = x
    s.lane_y[i, k] = y
    s.lane_weight[i, k] = weight


@kernel
def _consider_hops(w, i, c, s):
    """Formations without a hop of vehicle ``i`` and with long ones, and those of the first step.

    The others are where they are counted on.
    """
    for m in range(c.num_vehicles):
        if m != i:
            weight = 1.0 if s.afloat[m] else 0.0
            for k in range(_LANES):
                _place(m, k, s.turn_x[m], s.turn_y[m], weight if k < _PLANS or not s.turn_far[m] else 0.0, s)
    _place(i, 0, w.x[i], w.y[i], 1.0, s)
    _place(i, _PLANS, w.x[i], w.y[i], 1.0, s)
    _place(i, _PLANS + 1, w.x[i], w.y[i], 0.0, s)
    ux, uy = direction_of_nearest(w, i, c)
    # Twice a short hop, over before the tracker's second step.
    far = min(2.0 * c.short_hop, c.longest_step) / c.short_hop
    for k in range(_PLANS):
        s.lane_first[k] = _PLANS if k == 0 else _PLANS + 1
        if k > 0:
            x, y = end_of_hop(w, i, _TOWARDS[k - 1], ux, uy, c)
            _place(i, k, w.x[i] + far * (x - w.x[i]), w.y[i] + far * (y - w.y[i]), 1.0, s)


@kernel
def _may_be_badly_placed(hdop, c):
    """Whether the error predicted at this HDOP, squashed at a rough fix, can be too great.

    Of one target it is at most 0.48 times the HDOP: the root of the mean of 0.1 / (1 - 0.9ⁿ), n = 1 ... 20, of a track
    without earlier information.
    """
    return (
        c.num_targets > 1 or hdop >= 1.0 or _MOST_PREDICTED * hdop / (1.0 - hdop) * ROUGH_FIX > BADLY_PLACED
    )


@loop_kernel
def regroup(w, ocean, c, s):
    """Change the hops that :func:`hop_in_turn` found, if the track will not be good after them.

    Once more in turn each vehicle stays, or makes a long hop that has room to land, if that gains more than the hop it
    was told, of the predicted error less the price of flight. ``s.turn_x``, ``s.turn_y`` become the places,
    ``s.turn_gain`` what the hop alone takes from the logarithm of the predicted error. Steered vehicles do not hop, and
    do not regroup.
    """
    last = s.order[0]
    for i in range(c.num_vehicles):
        s.turn_far[i] = 0
        last = i if s.afloat[i] and s.turn[i] > s.turn[last] else last
    if c.steered or not (
        s.afloat[last] and _may_be_badly_placed(s.turn_hdop[last, 0] - s.turn_gain[last], c)
    ):
        return
    for i in range(c.num_vehicles):
        _place(i, 0, s.turn_x[i], s.turn_y[i], 1.0 if s.afloat[i] else 0.0, s)
    s.lane_first[0] = 0
    predicted_log_error(w, 1, 1, c, s)
    best = s.lane_hdop[0]
    if not best > np.log(BADLY_PLACED * c.fix_scale) or best == np.inf:
        return
    keep = KEEP_CLEAR * c.longest_step
    for turn in range(c.num_vehicles):
        i = s.order[turn]
        # Who must leave goes where it was told.
        if not s.afloat[i] or s.room[i, 0] < keep:
            continue
        _consider_hops(w, i, c, s)
        predicted_log_error(w, _PLANS, _LANES, c, s)
        least = best + _price(w, i, s.turn_x[i], s.turn_y[i], c) - LEAST_CHANGE
        found = -1
        for k in range(_PLANS):
            x, y = s.lane_x[i, k], s.lane_y[i, k]
            value = s.lane_hdop[k] + _price(w, i, x, y, c)
            if value < least and (k == 0 or room_at(x, y, w, ocean, c) > keep):
                least = value
                found = k
        if found >= 0:
            s.turn_x[i] = s.lane_x[i, found]
            s.turn_y[i] = s.lane_y[i, found]
            s.turn_far[i] = 1 if found > 0 else 0
            best = s.lane_hdop[found]
        s.turn_gain[i] = s.lane_hdop[0] - best

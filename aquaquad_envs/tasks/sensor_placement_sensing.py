"""What the team of sensor placement hears, what of it is shared, and when; compiled.

A row is one measurement: of each hearing vehicle (bearing, range), or of a pair (TDOA). Pairs are those with the
vehicle nearest to the target, the first to hear it, or all of them; the noise is drawn for each pair, as published.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.hdop import hdop_of_information, position_information
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.sensing.measurements import (
    TDOA,
    distance_to,
    measurement_std,
    noisy_measurement,
    predicted_measurement,
)
from aquaquad_envs.sensing.sonar import detects
from aquaquad_envs.tasks.sensor_placement_data import (
    DUE,
    HEARD,
    MAX_VEHICLES,
    OTHER_X,
    OTHER_Y,
    PENDING,
    RUNNING,
    SENSOR_X,
    SENSOR_Y,
    SIGMA,
    VALUE,
    WHOSE,
)
from aquaquad_envs.tasks.sensor_placement_targets import _waiting_time


@kernel
def find_afloat(w, c, s):
    """Which vehicles are alive and on the water, into ``s.afloat``; returns how many are alive."""
    alive = 0
    for i in range(c.num_vehicles):
        runs = w.agent_outcome[i] == RUNNING
        s.afloat[i] = runs and s.flight_left_s[i] == 0.0
        alive += 1 if runs else 0
    return alive


@kernel
def _put_row(w, row, i, j, x, y, c, s):
    s.sensors[row, 0] = w.x[i]
    s.sensors[row, 1] = w.y[i]
    s.others[row, 0] = w.x[j]
    s.others[row, 1] = w.y[j]
    s.first[row] = i
    s.second[row] = j
    if c.noise_level > 0.0:
        s.sigmas[row] = measurement_std(
            c.kind, c.std, c.noise_level, c.noise_reference, x, y, w.x[i], w.y[i], w.x[j], w.y[j]
        )
    else:
        s.sigmas[row] = c.std


@loop_kernel
def fill_rows(w, hears, x, y, c, s):
    """Rows of what vehicles with ``hears`` (8,) measure of a target at (x, y), without values; returns how many."""
    count = 0
    if c.kind != TDOA:
        for i in range(c.num_vehicles):
            if hears[i]:
                _put_row(w, count, i, i, x, y, c, s)
                count += 1
    elif c.all_pairs:
        for i in range(c.num_vehicles):
            for j in range(i + 1, c.num_vehicles):
                if hears[i] and hears[j]:
                    _put_row(w, count, i, j, x, y, c, s)
                    count += 1
    else:
        nearest = -1
        least = np.inf
        for i in range(c.num_vehicles):
            if hears[i]:
                away = distance_to(x, y, w.x[i], w.y[i])
                if away < least:
                    least = away
                    nearest = i
        for i in range(c.num_vehicles):
            if hears[i] and i != nearest:
                _put_row(w, count, i, nearest, x, y, c, s)
                count += 1
    return count


@kernel
def information_of_rows(s, count, x, y, c):
    """(J_xx, J_xy, J_yy) of the first ``count`` rows about (x, y), 1/m²."""
    return position_information(s.kinds, s.sensors, s.others, s.sigmas, s.mask, count, x, y, c.sound_speed)


@loop_kernel
def team_hdop_at(w, hears, x, y, c, s):
    """HDOP with R, m, of vehicles with ``hears`` about (x, y); at most ``c.hdop_cap``, which stands for singular."""
    count = fill_rows(w, hears, x, y, c, s)
    a, b, d = information_of_rows(s, count, x, y, c)
    return min(hdop_of_information(a, b, d), c.hdop_cap)


@kernel
def advance_links(w, dt, now, c, s):
    """Each vehicle's link: up or down (Gilbert and Elliott), and when the team gets what is heard at ``now``."""
    for i in range(c.num_vehicles):
        s.shared_s[i] = now
        if c.dropout > 0.0:
            # Two states, exactly over the step: down for a mean time of dropout_burst, a share dropout in all.
            decay = np.exp(-dt / (c.dropout_burst * (1.0 - c.dropout)))
            down = 1.0 if w.link_down[i] else 0.0
            w.link_down[i] = 1 if uniform(w.rng_sensor) < c.dropout + (down - c.dropout) * decay else 0
        if c.sharing_delay > 0.0:
            s.shared_s[i] += _waiting_time(c.sharing_delay, w.rng_sensor)


@kernel
def listen(w, j, c, s):
    """Rows of target ``j`` with their noisy values, by vehicles afloat that detect it and can share; how many.

    ``s.silent`` counts the vehicles afloat that do not.
    """
    x = w.target_x[j]
    y = w.target_y[j]
    s.silent = 0
    for i in range(c.num_vehicles):
        s.hears[i] = False
        if s.afloat[i]:
            # One draw a vehicle afloat, at every level.
            heard = detects(c.sonar, distance_to(x, y, w.x[i], w.y[i]), w.rng_sensor)
            s.hears[i] = heard and w.link_down[i] == 0
            s.silent += 0 if s.hears[i] else 1
    count = fill_rows(w, s.hears, x, y, c, s)
    for row in range(count):
        exact = predicted_measurement(
            c.kind,
            x,
            y,
            s.sensors[row, 0],
            s.sensors[row, 1],
            s.others[row, 0],
            s.others[row, 1],
            c.sound_speed,
        )
        s.values[row] = noisy_measurement(c.kind, exact, s.sigmas[row], w.rng_sensor)
    return count


@kernel
def send(w, j, count, now, c, s):
    """Put the rows of target ``j``, emitted at ``now``, under way to the tracker; what finds no room is lost."""
    for row in range(count):
        if w.pending_count == PENDING:
            w.pending_lost += 1
            continue
        p = w.pending[w.pending_count]
        w.pending_count += 1
        i = s.first[row]
        k = s.second[row]
        slowness = c.travel_level / c.sound_speed
        travel = slowness * distance_to(w.target_x[j], w.target_y[j], w.x[i], w.y[i])
        other = slowness * distance_to(w.target_x[j], w.target_y[j], w.x[k], w.y[k])
        p[HEARD] = now + travel
        p[DUE] = max(s.shared_s[i] + travel, s.shared_s[k] + other)
        p[WHOSE] = j
        p[SENSOR_X] = s.sensors[row, 0]
        p[SENSOR_Y] = s.sensors[row, 1]
        p[OTHER_X] = s.others[row, 0]
        p[OTHER_Y] = s.others[row, 1]
        p[VALUE] = s.values[row]
        p[SIGMA] = s.sigmas[row]


@kernel
def is_due(w, k, j, now):
    """Whether measurement ``k`` under way is of target ``j`` and has arrived by ``now``."""
    return w.pending[k, WHOSE] == j and w.pending[k, DUE] <= now


@kernel
def take_row(w, k, row, s):
    """Copy measurement ``k`` under way into row ``row``."""
    p = w.pending[k]
    s.sensors[row, 0] = p[SENSOR_X]
    s.sensors[row, 1] = p[SENSOR_Y]
    s.others[row, 0] = p[OTHER_X]
    s.others[row, 1] = p[OTHER_Y]
    s.values[row] = p[VALUE]
    s.sigmas[row] = p[SIGMA]


@kernel
def forget_delivered(w, now):
    """Drop all measurements that have arrived by ``now``; the others keep their order."""
    kept = 0
    for k in range(w.pending_count):
        if w.pending[k, DUE] > now:
            if kept < k:
                for column in range(w.pending.shape[1]):
                    w.pending[kept, column] = w.pending[k, column]
            kept += 1
    w.pending_count = kept


@kernel
def without(hears, i, s):
    """``hears`` but for vehicle ``i``, into ``s.hears``."""
    for k in range(MAX_VEHICLES):
        s.hears[k] = hears[k] and k != i

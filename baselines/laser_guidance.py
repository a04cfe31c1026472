"""How scripted policies follow a laser's light once they have it: on the rim of the disc, or after acoustic fixes.

The inside of a flat top tells nothing, so a vehicle at the centre loses it. Hence the *edge ride*: fly round the
estimated centre, near the rim but inside it, where each reading says how far the rim is, and a round shows every side,
like the conical scan of a tracking radar. The radius grows with the estimate's deviation: sure of the
centre the vehicle stays well inside.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.kalman_motion import predict
from aquaquad_envs.estimation.kalman_update import factorize, square_root_update
from aquaquad_envs.estimation.laser_bank import (
    bank_begin,
    bank_begin_line,
    bank_cycle,
    bank_likeliest,
    bank_mean,
    bank_pin,
)
from aquaquad_envs.estimation.laser_ekf import STATES
from aquaquad_envs.sensing.laser import profile_intensity, radius_of_intensity

#: Deviation of the distance to the centre that the first light tells, in detectable radii.
_FIRST_STD = 0.1


@kernel
def shortened(vx, vy, greatest):
    """(vx, vy), m/s, no longer than ``greatest``."""
    speed = np.sqrt(vx * vx + vy * vy)
    scale = greatest / speed if speed > greatest else 1.0
    return scale * vx, scale * vy


@kernel
def begin_filter(m, w, model, s):
    """First hypotheses where light was met: the centre as far off as the reading says, most likely ahead."""
    value = min(max(w.reading - model.ambient, 0.1 * model.peak), 0.9 * model.peak)
    r = radius_of_intensity(s.beam, value, w.altitude + w.depth)
    # Course over the disc, which moves itself.
    course_x = w.own_u - m.drift[0] - m.state[2]
    course_y = w.own_v - m.drift[1] - m.state[3]
    if s.planar:
        bank_begin_line(m.bank, r, _FIRST_STD * s.radius, course_x, m.state[2], s.speed_std)
    else:
        bank_begin(m.bank, r, _FIRST_STD * s.radius, course_x, course_y, m.state[2], m.state[3], s.speed_std)
    m.scan = np.arctan2(-course_y, -course_x)
    _believe(m, s)


@kernel
def run_filter(m, moved_x, moved_y, reading, model, s):
    """One cycle of the bank of filters, the vehicle having moved over the drifting frame."""
    bank_cycle(m.bank, m.work, s.dt, moved_x, moved_y, s.motion, model, reading)
    if s.planar:
        bank_pin(m.bank)
    _believe(m, s)
    # Slow changes of all readings alike are not the disc's: its errors come and go with each round.
    r = np.sqrt(m.state[0] * m.state[0] + m.state[1] * m.state[1])
    surprise = reading - m.ambient - profile_intensity(model.peak, model.sigma, model.half_order, r)
    if abs(surprise) < model.gate * model.std:
        m.ambient += s.ambient_share * surprise


@kernel
def _believe(m, s):
    """Believe the likeliest hypothesis: between two discs there is no light. Their variance is that of all."""
    m.variance = bank_mean(m.bank, m.state)
    best = bank_likeliest(m.bank)
    for i in range(2):
        m.state[i] = m.bank.states[best, i]
    m.state[2], m.state[3] = shortened(m.bank.states[best, 2], m.bank.states[best, 3], s.greatest_speed)


@kernel
def edge_ride(m, s):
    """Velocity, m/s, beyond ``drift``: round the believed centre, at it while little is known."""
    std = np.sqrt(m.variance if s.planar else 0.5 * m.variance)
    # While it may be one of several discs, go there first.
    radius = min(s.scan_low + s.scan_slope * std, s.scan_high) if m.bank.count == 1 else 0.0
    x = radius * np.cos(m.scan)
    y = radius * np.sin(m.scan)
    rate = s.scan_rate
    m.scan += rate * s.dt
    if m.scan > np.pi:
        m.scan -= 2.0 * np.pi
    # First derivative of the place on the ring, and the second as far as the vehicle lags its command.
    return (
        m.state[2] - rate * y - s.lag * rate * rate * x + s.gain * (m.state[0] + x),
        m.state[3] + rate * x - s.lag * rate * rate * y + s.gain * (m.state[1] + y),
    )


@loop_kernel
def follow_fixes(m, w, moved_x, moved_y, s):
    """Kalman filter of acoustic fixes in ``m.state``, ``m.covariance``: the centre from here, constant velocity."""
    if m.fix_s > -1e9:
        predict(m.state, m.covariance, s.dt, s.motion)
        m.state[0] -= moved_x
        m.state[1] -= moved_y
    if w.fix_s == m.fix_s:
        return
    x = w.fix_x - w.own_x
    y = w.fix_y - w.own_y
    if m.fix_s == -1e9:
        m.state[0] = x
        m.state[1] = y
        for i in range(STATES):
            for j in range(STATES):
                m.covariance[i, j] = 0.0
            std = s.fix_std if i < 2 else s.speed_std
            m.covariance[i, i] = std * std
    else:
        factorize(m.covariance, m.work)
        inverse = 1.0 / s.fix_std
        m.work[STATES, 0] = m.work[0, 0] * inverse
        m.work[STATES, 1] = 0.0
        m.work[STATES, 2] = (x - m.state[0]) * inverse
        m.work[STATES + 1, 0] = m.work[1, 0] * inverse
        m.work[STATES + 1, 1] = m.work[1, 1] * inverse
        m.work[STATES + 1, 2] = (y - m.state[1]) * inverse
        square_root_update(m.state, m.covariance, m.work, 2, 2, 2)
    m.fix_s = w.fix_s

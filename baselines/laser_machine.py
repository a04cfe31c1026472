"""Search, track, lost: the state machine behind the scripted policies of laser tracking, compiled, one world at a time.

Search is the concentric pattern of Toombs 2022, algorithm 3: circles of radius s, 2s, ... about a centre, first the
guess, at constant speed, until the reading shows light. Then a policy tracks in its own way
(:mod:`baselines.laser_guidance`). Darkness while tracking means lost; after ``patience`` s of it the search begins
again where the policy believes the centre to be. All but ``search-hold`` move with the submerged vehicle as far as its
velocity is measured.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.gradient import MEMORY, GradientSettings, gradient_command, gradient_step
from aquaquad_envs.estimation.kalman_motion import Motion
from aquaquad_envs.estimation.laser_bank import BANK
from aquaquad_envs.estimation.laser_ekf import STATES, WORK, LaserModel
from aquaquad_envs.sensing.laser import Beam, beam_sigma, peak_intensity
from aquaquad_envs.tasks.laser_tracking_data import RUNNING
from baselines.laser_guidance import begin_filter, edge_ride, follow_fixes, run_filter, shortened

SEARCH, TRACK, LOST = range(3)
#: How a policy tracks once it has light.
HOLD, GRADIENT, EKF, FIX, TRUTH = range(5)
#: Light counts as seen from this many standard deviations of the reading on, and at least from the world's own share.
_SEEN_STDS = 5.0
#: The first circle begins once nearer to its centre than this share of the spacing.
_ARRIVED = 0.2

#: What a policy remembers of one world. Lengths in m, in the frame that moves as the submerged vehicle is measured to.
MACHINE = np.dtype(
    [
        ("mode", np.int64),
        ("begun", np.int64),
        ("place", np.float64, 2),  # own position, smoothed
        ("drift", np.float64, 2),  # measured velocity of the submerged vehicle, m/s; 0 where unknown
        ("center", np.float64, 2),  # of the search, or where to hold
        ("center_speed", np.float64, 2),  # of that centre beyond ``drift``, m/s
        ("radius", np.float64),  # of the circle being flown, 0 on the way to the centre
        ("arc", np.float64),  # rad flown of it
        ("dark_s", np.float64),
        ("ambient", np.float64),  # believed light that is not the laser's, W/m²
        ("gradient", np.float64, MEMORY),
        ("bank", BANK),
        (
            "state",
            np.float64,
            STATES,
        ),  # what is believed of the centre: (d_x, d_y) from here, (u, v) beyond ``drift``
        ("variance", np.float64),  # of (d_x, d_y), both axes, m²
        ("covariance", np.float64, (STATES, STATES)),  # of the filter of acoustic fixes
        ("work", np.float64, WORK),
        ("scan", np.float64),  # angle on the edge ride, rad
        ("fix_s", np.float64),  # time of the last fix that was used
    ]
)


class MachineSettings(NamedTuple):
    """Numbers that :func:`decide` reads; lengths in m, times in s."""

    kind: int
    dt: float
    max_speed: float
    planar: bool  # motion in x only
    smoothing: float  # share of the measured position against the measured velocity
    spacing: float  # s of algorithm 3
    search_speed: float
    farthest: float  # radius at which the circles begin anew
    gain: float  # 1/s, velocity per metre of error
    lag: float  # of the vehicle behind its velocity command
    threshold: float  # W/m² above ambient light
    patience: float
    gradient_gain: float  # m⁴/(W s)
    gradient: GradientSettings
    beam: Beam
    std: float  # W/m², of the reading
    ambient_share: float  # of a reading's surprise that is taken for a change of ambient light
    gate: float
    radius: float  # w, of the detectable area
    motion: Motion
    speed_std: float  # m/s, of the centre's velocity beyond what is measured
    greatest_speed: float  # m/s, of the same
    scan_low: float  # radius of the edge ride, for a sure estimate
    scan_slope: float  # its growth with the estimate's deviation
    scan_high: float  # and its bound
    scan_rate: float  # rad/s
    fix_std: float


@kernel
def _begin_search(m, x, y, u, v):
    m.mode = SEARCH
    m.center[0] = x
    m.center[1] = y
    m.center_speed[0] = u
    m.center_speed[1] = v
    m.radius = 0.0
    m.arc = 0.0


@kernel
def _search(m, s):
    """Velocity, m/s, beyond ``drift``, on the concentric pattern."""
    m.center[0] += m.center_speed[0] * s.dt
    m.center[1] += m.center_speed[1] * s.dt
    ex = m.center[0] - m.place[0]
    ey = m.center[1] - m.place[1]
    along = 0.0
    ahead = 0.0
    if m.radius == 0.0:
        if ex * ex + ey * ey < (_ARRIVED * s.spacing) ** 2:
            m.radius = s.spacing
    else:
        along = s.search_speed
        m.arc += along * s.dt / m.radius
        if m.arc >= 2.0 * np.pi:
            m.arc -= 2.0 * np.pi
            m.radius += s.spacing
            if m.radius > s.farthest:
                m.radius = s.spacing
        # The vehicle answers late: its course is that of where the pattern will be.
        ahead = m.arc + along * s.lag / m.radius
        ex += m.radius * np.sin(m.arc)
        ey += m.radius * np.cos(m.arc)
    return (
        m.center_speed[0] + along * np.cos(ahead) + s.gain * ex,
        m.center_speed[1] - along * np.sin(ahead) + s.gain * ey,
    )


@kernel
def _locate(m, w, s):
    """Own motion: place in the frame that drifts with the submerged vehicle, and the move since the last decision."""
    u = 0.0 if s.kind == HOLD else w.seen_u
    v = 0.0 if s.kind == HOLD else w.seen_v
    moved_x = 0.0
    moved_y = 0.0
    if m.begun == 0:
        m.place[0] = w.own_x
        m.place[1] = w.own_y
    else:
        # Position and velocity are two measurements of one motion; what the frame has drifted is in neither.
        carried_x = 0.0 if s.kind == HOLD else w.carried_x
        carried_y = 0.0 if s.kind == HOLD else w.carried_y
        moved_x = (w.own_u - u) * s.dt
        moved_y = (w.own_v - v) * s.dt
        moved_x += s.smoothing * (w.own_x - carried_x - m.place[0] - moved_x)
        moved_y += s.smoothing * (w.own_y - carried_y - m.place[1] - moved_y)
        m.place[0] += moved_x
        m.place[1] += moved_y
    m.drift[0] = u
    m.drift[1] = v
    return moved_x, moved_y


@kernel
def _begin(m, w, s):
    m.begun = 1
    m.dark_s = 0.0
    m.ambient = s.beam.ambient
    m.scan = 0.0
    m.fix_s = -1e9
    for i in range(MEMORY):
        m.gradient[i] = 0.0
    for i in range(STATES):
        m.state[i] = 0.0
    _begin_search(m, w.guess_x, w.guess_y, 0.0, 0.0)


@loop_kernel
def decide(m, w, s):
    """Velocity command (m/s, m/s) of one world from its memory ``m`` and what its record ``w`` says is measured."""
    if s.kind == TRUTH:
        # The bound: true place and velocity of centre and vehicle.
        cx = w.rov_u + s.gain * (w.rov_x - w.x)
        cy = w.rov_v + s.gain * (w.rov_y - w.y)
        return shortened(cx, 0.0 if s.planar else cy, s.max_speed)
    moved_x, moved_y = _locate(m, w, s)
    if m.begun == 0:
        _begin(m, w, s)
    height = w.altitude + w.depth
    peak = peak_intensity(s.beam, height)
    model = LaserModel(peak, beam_sigma(s.beam, height), s.beam.half_order, m.ambient, s.std, 1.0, s.gate)
    lit = w.reading - m.ambient >= s.threshold
    m.dark_s = 0.0 if lit else m.dark_s + s.dt
    if m.mode == SEARCH and not lit and s.ambient_share > 0.0:
        # At first the mean of all readings in the dark.
        m.ambient += max(s.ambient_share, s.dt / m.dark_s) * (w.reading - m.ambient)
    if s.kind == GRADIENT:
        gradient_step(m.gradient, m.place[0], m.place[1], w.reading, s.gradient)
    elif s.kind == EKF:
        if m.mode == SEARCH:
            if lit:
                begin_filter(m, w, model, s)
        else:
            run_filter(m, moved_x, moved_y, w.reading, model, s)
    elif s.kind == FIX:
        follow_fixes(m, w, moved_x, moved_y, s)
        if m.mode == SEARCH and m.fix_s > -1e9:
            m.center[0] = m.place[0] + m.state[0]
            m.center[1] = m.place[1] + m.state[1]
    if lit and m.mode != TRACK:
        if m.mode == SEARCH and s.kind == HOLD:
            # Where it can stop.
            m.center[0] = m.place[0] + s.lag * w.own_u
            m.center[1] = m.place[1] + s.lag * w.own_v
        m.mode = TRACK
    elif not lit and m.mode == TRACK:
        m.mode = LOST
    if m.mode == LOST and m.dark_s >= s.patience:
        if s.kind == EKF:
            _begin_search(m, m.place[0] + m.state[0], m.place[1] + m.state[1], m.state[2], m.state[3])
        else:
            _begin_search(m, m.place[0], m.place[1], 0.0, 0.0)
    if m.mode == SEARCH:
        cx, cy = _search(m, s)
    elif s.kind == EKF:
        cx, cy = edge_ride(m, s)
    elif s.kind == GRADIENT:
        cx, cy = gradient_command(m.gradient[0], m.gradient[1], s.gradient_gain, s.max_speed)
    elif s.kind == FIX:
        cx = m.state[2] + s.gain * m.state[0]
        cy = m.state[3] + s.gain * m.state[1]
    else:
        cx = s.gain * (m.center[0] - m.place[0])
        cy = s.gain * (m.center[1] - m.place[1])
    return shortened(m.drift[0] + cx, 0.0 if s.planar else m.drift[1] + cy, s.max_speed)


@loop_kernel
def decide_all(machines, worlds, s, actions):
    """Actions, shares of the greatest speed, of all running worlds: ``actions`` (worlds, axes), written in place."""
    for k in range(worlds.size):
        if worlds[k].outcome != RUNNING:
            continue
        u, v = decide(machines[k], worlds[k], s)
        actions[k, 0] = u / s.max_speed
        if not s.planar:
            actions[k, 1] = v / s.max_speed

"""The tracker that the team of sensor placement shares, and the bound on its error; compiled.

One Kalman filter a target (:mod:`aquaquad_envs.estimation.kalman_ukf`, :mod:`~aquaquad_envs.estimation.kalman_ekf`) and
one posterior Cramér–Rao recursion (:mod:`aquaquad_envs.estimation.posterior_bound`), one cycle a sub-step.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.hdop import hdop_of_information
from aquaquad_envs.estimation.kalman import UKF, position_nees
from aquaquad_envs.estimation.kalman_ekf import ekf_update
from aquaquad_envs.estimation.kalman_motion import Motion, predict, predict_covariance
from aquaquad_envs.estimation.kalman_ukf import ukf_update
from aquaquad_envs.estimation.posterior_bound import bound_update
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.sensing.emissions import advance_emission
from aquaquad_envs.sensing.measurements import (
    BEARING,
    distance_to,
    measurement_gradient,
    measurement_residual,
    predicted_measurement,
)
from aquaquad_envs.tasks.sensor_placement_data import BOUND_STATES, HEARD, MAX_ROWS
from aquaquad_envs.tasks.sensor_placement_hdop import squash
from aquaquad_envs.tasks.sensor_placement_sensing import (
    information_of_rows,
    is_due,
    listen,
    send,
    take_row,
    team_hdop_at,
)

#: Share of the newest value in the running mean of NIS per measurement.
FORGETTING = 0.3
#: A search for a lost target: nodes an axis of the first grid over the box and of each finer one, and how many.
FIRST_NODES, NODES, ZOOMS = 17, 7, 9


@kernel
def start_track(w, j, c):
    """An estimate of target ``j`` drawn about the truth with the stated deviations; the bound starts likewise."""
    w.estimate[j] = 0.0
    w.covariance[j] = 0.0
    w.bound[j] = 0.0
    truths = (w.target_x[j], w.target_y[j], w.target_u[j], w.target_v[j], 0.0, 0.0)
    for k in range(6):
        std = c.initial_acceleration_std
        if k < 2:
            std = c.initial_position_std
        elif k < 4:
            std = c.initial_velocity_std
        draw = normal(w.rng_initial)
        if k < c.states:
            w.estimate[j, k] = truths[k] + std * draw
            w.covariance[j, k, k] = std * std
        if k < BOUND_STATES:
            w.bound[j, k, k] = std * std
    w.measured_s[j] = 0.0
    w.innovation[j] = 1.0
    w.lost[j] = 0
    w.times_lost[j] = 0


@kernel
def load_track(w, j, state, covariance, s):
    """Copy track and bound of target ``j`` into scratch memory of their size."""
    n = state.shape[0]
    for a in range(n):
        state[a] = w.estimate[j, a]
        for b in range(n):
            covariance[a, b] = w.covariance[j, a, b]
    for a in range(BOUND_STATES):
        for b in range(BOUND_STATES):
            s.bound[j, a, b] = w.bound[j, a, b]


@kernel
def store_track(w, j, state, covariance, s):
    """The way back of :func:`load_track`."""
    n = state.shape[0]
    for a in range(n):
        w.estimate[j, a] = state[a]
        for b in range(n):
            w.covariance[j, a, b] = covariance[a, b]
    for a in range(BOUND_STATES):
        for b in range(BOUND_STATES):
            w.bound[j, a, b] = s.bound[j, a, b]


@loop_kernel
def _update(state, covariance, method, first, count, points, sound_speed, s):
    """One update by rows ``first`` to ``count``; (used, nis, repaired)."""
    kinds, sensors, others = s.kinds[first:], s.sensors[first:], s.others[first:]
    values, sigmas, mask = s.values[first:], s.sigmas[first:], s.mask[first:]
    if method == UKF:
        return ukf_update(
            state, covariance, s.work, kinds, sensors, others, values, sigmas, mask, count - first,
            sound_speed, True, points,
        )  # fmt: skip
    return ekf_update(
        state,
        covariance,
        s.work,
        kinds,
        sensors,
        others,
        values,
        sigmas,
        mask,
        count - first,
        sound_speed,
        True,
    )


@kernel
def _predict(state, covariance, dt, motion):
    predict(state, covariance, dt, motion)


@kernel
def _advance_bound(bound, dt, a, b, d, motion, s):
    """Prediction and, where there is information, update of one bound; 1 if it was repaired."""
    predict_covariance(bound, dt, motion)
    return bound_update(s.nowhere, bound, s.work, a, b, d) if a + d > 0.0 else 0


@loop_kernel
def _update_late(w, j, now, state, covariance, c, s):
    """Update by what has arrived, in the order of emission, each at its own time; (rows, nis).

    Retrodiction: the track goes back to the stamp by Φ(-τ), is updated there and comes forward again. The process
    noise of those τ seconds is charged to the measurement, σ² + |∇h|² q τ³/3, as if independent of the
    track's error. The stamp is when the sound was heard, less its travel time from the estimate.
    """
    coasting = Motion(c.motion.model, 0.0, 0.0, 0.0, 0.0)
    row = 0
    total = 0.0
    for k in range(w.pending_count):
        if row < MAX_ROWS and is_due(w, k, j, now):
            take_row(w, k, row, s)
            travel = (
                c.travel_level
                / c.sound_speed
                * distance_to(state[0], state[1], s.sensors[row, 0], s.sensors[row, 1])
            )
            age = max(now - w.pending[k, HEARD] + travel, 0.0)
            _predict(state, covariance, -age, coasting)
            gx, gy = measurement_gradient(
                c.kind, state[0], state[1], s.sensors[row, 0], s.sensors[row, 1], s.others[row, 0],
                s.others[row, 1], c.sound_speed,
            )  # fmt: skip
            moved = c.truth_motion.density * age * age * age / 3.0
            s.sigmas[row] = np.sqrt(s.sigmas[row] * s.sigmas[row] + (gx * gx + gy * gy) * moved)
            _, nis, repaired = _update(state, covariance, c.method, row, row + 1, c.points, c.sound_speed, s)
            _predict(state, covariance, age, coasting)
            total += nis
            w.repairs += repaired
            row += 1
    return row, total


@kernel
def _misfit(count, x, y, c, s):
    """Sum of squared residuals, in standard deviations, of the first ``count`` rows for a target at (x, y)."""
    total = 0.0
    for i in range(count):
        predicted = predicted_measurement(
            c.kind, x, y, s.sensors[i, 0], s.sensors[i, 1], s.others[i, 0], s.others[i, 1], c.sound_speed
        )
        e = measurement_residual(c.kind, s.values[i], predicted) / s.sigmas[i]
        total += e * e
    return total


@loop_kernel
def _best_on_grid(count, centre_x, centre_y, spacing, nodes, c, s):
    """The node (x, y) of a square grid about a centre where the rows fit best, and its misfit."""
    best_x = centre_x
    best_y = centre_y
    least = np.inf
    for k in range(nodes * nodes):
        x = centre_x + spacing * (k // nodes - 0.5 * (nodes - 1))
        y = centre_y + spacing * (k % nodes - 0.5 * (nodes - 1))
        misfit = _misfit(count, x, y, c, s)
        if misfit < least:
            least = misfit
            best_x = x
            best_y = y
    return best_x, best_y, least


@loop_kernel
def _search(count, old_x, old_y, c, s):
    """Where the rows fit best: (x, y), m, and the last grid's spacing.

    Ever finer grids, first over the whole box and then also about the old estimate, where a track that has
    merely slipped will be; the better end of the two. Each grid reaches well beyond the nodes beside the last best.
    """
    first = 2.0 * c.half_width / (FIRST_NODES - 1)
    found_x = 0.0
    found_y = 0.0
    least = np.inf
    spacing = first
    for attempt in range(2):
        spacing = first
        x, y, misfit = old_x, old_y, np.inf
        if attempt == 0:
            x, y, misfit = _best_on_grid(count, 0.0, 0.0, first, FIRST_NODES, c, s)
        for _ in range(ZOOMS):
            spacing *= 0.5
            x, y, misfit = _best_on_grid(count, x, y, spacing, NODES, c, s)
        if misfit < least:
            least = misfit
            found_x = x
            found_y = y
    return found_x, found_y, spacing


@loop_kernel
def _restart(count, state, covariance, c, s):
    """A lost track begins anew: at the fix of this moment's rows where they give one, else wide about where it was."""
    variance = c.lost_std * c.lost_std / 8.0
    xx = variance
    xy = 0.0
    yy = variance
    for axis in range(2):
        # Written so that NaN becomes the centre.
        inside = abs(state[axis]) <= c.half_width
        state[axis] = state[axis] if inside else 0.0
    if count >= (2 if c.kind == BEARING else 3):
        x, y, spacing = _search(count, state[0], state[1], c, s)
        a, b, d = information_of_rows(s, count, x, y, c)
        determinant = a * d - b * b
        if determinant > 1e-12 * a * d and (a + d) / determinant < variance:
            state[0] = x
            state[1] = y
            xx = d / determinant + spacing * spacing
            xy = -b / determinant
            yy = a / determinant + spacing * spacing
    n = state.shape[0]
    for i in range(n):
        for k in range(n):
            covariance[i, k] = 0.0
    covariance[0, 0] = xx
    covariance[0, 1] = xy
    covariance[1, 0] = xy
    covariance[1, 1] = yy
    speed = max(c.target_speed, c.initial_velocity_std)
    for i in range(2, n):
        state[i] = 0.0
        std = speed if i < 4 else c.initial_acceleration_std
        covariance[i, i] = std * std


@kernel
def _loosen(covariance, c):
    """Give a track that has slipped the spread of a first estimate again, where it is."""
    for i in range(covariance.shape[0]):
        std = c.initial_acceleration_std
        if i < 2:
            std = c.initial_position_std
        elif i < 4:
            std = max(c.target_speed, c.initial_velocity_std)
        covariance[i, i] += std * std


@kernel
def _watch(w, j, count, nis, state, covariance, c, s):
    """Whether the track is lost, by its covariance or its innovations; a lost one begins anew."""
    if count > 0:
        newest = min(nis / count, 100.0)
        # Written so that NaN counts as the worst.
        newest = newest if newest >= 0.0 else 100.0
        w.innovation[j] += FORGETTING * (newest - w.innovation[j])
    spread2 = covariance[0, 0] + covariance[1, 1]
    near = abs(state[0]) <= 2.0 * c.half_width and abs(state[1]) <= 2.0 * c.half_width
    sound = near and spread2 >= 0.0
    if sound and spread2 <= c.lost_std * c.lost_std and w.innovation[j] <= c.lost_nis:
        # Found again once it has held for a while at less than half the limit.
        if w.lost[j] and count > 0 and w.innovation[j] < 2.0 and spread2 < 0.25 * c.lost_std * c.lost_std:
            w.lost[j] = 0
        return
    if sound and spread2 > c.lost_std * c.lost_std and w.lost[j] and count == 0:
        return  # nothing heard: it stays lost, as wide as it has grown
    slipped = sound and spread2 <= c.lost_std * c.lost_std and not w.lost[j]
    if not w.lost[j]:
        w.times_lost[j] += 1
    w.lost[j] = 1
    w.innovation[j] = 1.0
    if slipped:
        _loosen(covariance, c)
    else:
        _restart(count, state, covariance, c, s)


@loop_kernel
def track_target(w, j, now, dt, c, s):
    """One tracker cycle of target ``j``, ``dt`` s long, that ends at ``now``; sums of errors go to ``s`` and ``w``."""
    state, covariance = s.state4[j], s.covariance4[j]
    if c.states == 6:
        state, covariance = s.state6[j], s.covariance6[j]
    _predict(state, covariance, dt, c.motion)
    emitted, _, w.emission_nominal[j], w.emission_next[j], w.emission_on[j] = advance_emission(
        c.emissions, now, w.emission_nominal[j], w.emission_next[j], w.emission_on[j], w.rng_target
    )
    count = listen(w, j, c, s) if emitted else 0
    together = count > 0 and s.silent == 0
    a, b, d = information_of_rows(s, count, w.target_x[j], w.target_y[j], c)
    bound = s.bound[j]
    w.repairs += _advance_bound(bound, dt, a, b, d, c.truth_motion, s)
    if c.travel_level > 0.0 or c.sharing_delay > 0.0:
        send(w, j, count, now, c, s)
        count, nis = _update_late(w, j, now, state, covariance, c, s)
    else:
        _, nis, repaired = _update(state, covariance, c.method, 0, count, c.points, c.sound_speed, s)
        w.repairs += repaired
    if count > 0:
        w.measured_s[j] = now
    _watch(w, j, count, nis, state, covariance, c, s)
    dx = state[0] - w.target_x[j]
    dy = state[1] - w.target_y[j]
    s.error2 += dx * dx + dy * dy
    s.bound2 += bound[0, 0] + bound[1, 1]
    w.nees_sum += min(position_nees(state, covariance, w.target_x[j], w.target_y[j]), 1e6)
    w.cycles += 1
    # Where all vehicles afloat heard it their information is at hand.
    if together:
        hdop = min(hdop_of_information(a, b, d), c.hdop_cap)
    else:
        hdop = team_hdop_at(w, s.afloat, w.target_x[j], w.target_y[j], c, s)
    s.hdop += hdop
    s.squashed_hdop += squash(hdop, c.fix_scale)

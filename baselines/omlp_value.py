"""What a sequence of steps is worth to transponder localization, its slope, and the climb to the nearest best one.

A plan is k actions, ``u`` (k, 2), as the world takes them: u[j, 0] in [-1, 1] the yaw rate as a share of its limit
(the second column is not used), or u[j] in the unit disc a free step, or hop, as a share of the longest. Its value is

    J(u) = Σ_m s_m ln det(Y_m + σ⁻² Σ_j h_jm h_jmᵀ) - Σ_j (price ‖u_j‖ + fence(p_j)),
    h_jm = (p_m - p_j) / ‖p_m - p_j‖,

p_j the place of the measurement after step j, p_m and Y_m estimate and information of transponder m (SPEC §8; Garcia,
UC Riverside 2018, eq. 4.20 to 4.26). Its share s_m is 1; where ranges leave images of it, each counts for itself, with
its share (ours, :mod:`baselines.omlp_images`). Price and fence are ours: what the reward charges for a hop, and what
keeps an AquaQuad off the edges of the box and off obstacles. The water carries the vehicle as the forecast says, where
it is.

The slope: ∂J/∂p_j from :func:`~aquaquad_envs.estimation.range_information.gain_slope`, carried back through the steps,
and through the drift by central differences. It leaves out the fence, and that a longer flight leaves less time to
drift; no step of the climb is taken on its word alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.range_information import gain_slope
from aquaquad_envs.estimation.symmetric3 import PACKED, add_line_of_sight, invert3, log_determinant3
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step
from aquaquad_envs.tasks.transponder_localization_data import AQUAQUAD, YAW_RATE
from aquaquad_envs.tasks.transponder_localization_vehicles import own_step
from aquaquad_envs.tasks.vehicle_motion import take_off

#: A step of the climb is taken if it gains this share of what the slope promises, and is halved this often at most.
_PROMISE, _HALVINGS = 1e-4, 20
#: Bounds of the climb's scale, in units of u per unit of slope.
_SHORTEST, _LONGEST = 1e-8, 1e4
#: What it costs, in ln det, to be a full step too near to an edge or an obstacle.
_FENCE = 100.0
#: Displacement by which the drift is differentiated, as a share of the box's half-width.
_NUDGE = 1e-4
#: A hop that is meant as one is longer than the world's least by this share.
_SPARE = 1e-3


class Worth(NamedTuple):
    """What plans are judged by, besides the world's constants."""

    #: σ⁻², 1/m².
    weight: float
    #: What a longest hop costs, in ln det of one transponder.
    price: float
    #: Distance kept from edges and obstacles, m.
    margin: float


class Scene(NamedTuple):
    """Where the vehicle is, and what it believes."""

    x: float
    y: float
    heading: float
    #: Time of the fields, s, and the indices of the currents and of the obstacles that are planned with.
    time: float
    field: int
    obstacle: int
    #: Greatest action that the battery allows, at most 1.
    most: float
    #: Transponders.
    transponders: int
    #: Places that count, one a transponder or more: how many, (P, 3) m, information (P, 6), and share (P,) of each.
    number: int
    targets: np.ndarray
    information: np.ndarray
    share: np.ndarray
    #: Share that images have, of the transponder whose place is least certain.
    unsure: float


class Trail(NamedTuple):
    """Scratch of one climb of at most k steps: places (k + 1, 2), ∂ of drifts (k, 2, 2), slopes, plans, matrices."""

    places: np.ndarray
    stretch: np.ndarray
    headings: np.ndarray
    pull: np.ndarray
    slope: np.ndarray
    trial: np.ndarray
    trial_slope: np.ndarray
    matrix: np.ndarray
    inverse: np.ndarray


@loop_kernel
def make_trail(steps):
    """Scratch for plans of ``steps`` steps."""
    return Trail(
        np.zeros((steps + 1, 2)), np.zeros((steps, 2, 2)), np.zeros(steps + 1), np.zeros((steps, 2)),
        np.zeros((steps, 2)), np.zeros((steps, 2)), np.zeros((steps, 2)), np.zeros(PACKED), np.zeros(PACKED),
    )  # fmt: skip


@loop_kernel
def _drifted(x, y, field, time, dt, velocity, axes, euler):
    """Apart from its callers, which mostly plan for still water."""
    return drift_step(velocity, field, axes, time, x, y, dt, euler)


@loop_kernel
def _stretch_of_drift(x, y, field, time, dt, velocity, axes, euler, nudge, out):
    """∂(x', y')/∂(x, y) of a drift, into ``out`` (2, 2)."""
    for i in range(2):
        dx = nudge if i == 0 else 0.0
        dy = nudge - dx
        ax, ay = _drifted(x + dx, y + dy, field, time, dt, velocity, axes, euler)
        bx, by = _drifted(x - dx, y - dy, field, time, dt, velocity, axes, euler)
        out[0, i] = (ax - bx) / (2.0 * nudge)
        out[1, i] = (ay - by) / (2.0 * nudge)


@kernel
def _hop(x, y, ux, uy, c):
    """Where the drift of a step begins, m, and after how many seconds."""
    flown = 0.0
    if c.vehicle == AQUAQUAD:
        flown, u, v = take_off(ux, uy, c)
        x += flown * u
        y += flown * v
    return x, y, flown


@kernel
def advance(x, y, heading, time, field, ux, uy, ocean, c):
    """Place, m, and heading, rad, one period after (x, y) at field time ``time``, with action (ux, uy)."""
    x, y, flown = _hop(x, y, ux, uy, c)
    if not c.still_water:
        x, y = _drifted(x, y, field, time + flown, c.period - flown, ocean.velocity, ocean.axes, c.euler)
    if c.vehicle != AQUAQUAD:
        x, y, heading = own_step(x, y, heading, ux, uy, c)
    return x, y, heading


@kernel
def fence(x, y, obstacle, ocean, c, worth):
    """What it costs an AquaQuad, which alone can be lost, to be at (x, y), in ln det.

    0 in open water, growing with the distance beyond the margin.
    """
    if c.vehicle != AQUAQUAD:
        return 0.0
    edge = max(abs(x), abs(y)) - c.half_width + worth.margin
    near = worth.margin - clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y)
    return _FENCE * max(edge, near, 0.0) / c.step_length


@kernel
def _carried_back(stretch, px, py):
    """A slope by the place after a drift as a slope by the place before it."""
    return stretch[0, 0] * px + stretch[1, 0] * py, stretch[0, 1] * px + stretch[1, 1] * py


@kernel
def step_price(scene, ux, uy, c, worth):
    """What step (ux, uy) costs, in ln det."""
    if c.vehicle != AQUAQUAD:
        return 0.0
    return scene.transponders * worth.price * np.sqrt(ux * ux + uy * uy)


@loop_kernel
def value_and_slope(scene, u, steps, slope, trail, ocean, c, worth):
    """J of the first ``steps`` steps of ``u``, and ∂J/∂u into ``slope``."""
    places, headings, pull = trail.places, trail.headings, trail.pull
    places[0, 0] = scene.x
    places[0, 1] = scene.y
    headings[0] = scene.heading
    value = 0.0
    for j in range(steps):
        x, y, headings[j + 1] = advance(
            places[j, 0],
            places[j, 1],
            headings[j],
            scene.time + j * c.period,
            scene.field,
            u[j, 0],
            u[j, 1],
            ocean,
            c,
        )
        value -= fence(x, y, scene.obstacle, ocean, c, worth) + step_price(scene, u[j, 0], u[j, 1], c, worth)
        places[j + 1, 0] = x
        places[j + 1, 1] = y
        pull[j, 0] = 0.0
        pull[j, 1] = 0.0
        if not c.still_water:
            x, y, flown = _hop(places[j, 0], places[j, 1], u[j, 0], u[j, 1], c)
            _stretch_of_drift(
                x, y, scene.field, scene.time + j * c.period + flown, c.period - flown, ocean.velocity, ocean.axes,
                c.euler, _NUDGE * c.half_width, trail.stretch[j],
            )  # fmt: skip
    matrix, inverse = trail.matrix, trail.inverse
    for m in range(scene.number):
        tx, ty, tz = scene.targets[m, 0], scene.targets[m, 1], scene.targets[m, 2]
        for i in range(PACKED):
            matrix[i] = scene.information[m, i]
        for j in range(1, steps + 1):
            add_line_of_sight(matrix, tx - places[j, 0], ty - places[j, 1], tz, worth.weight)
        share = scene.share[m]
        value += share * log_determinant3(matrix)
        invert3(matrix, inverse)
        for j in range(steps):
            gx, gy = gain_slope(inverse, tx - places[j + 1, 0], ty - places[j + 1, 1], tz, worth.weight)
            pull[j, 0] += share * gx
            pull[j, 1] += share * gy
    # Backwards: a step moves all later places, a turn swings them too.
    px = 0.0
    py = 0.0
    swing = 0.0
    for j in range(steps - 1, -1, -1):
        if not c.still_water and j < steps - 1 and c.vehicle != AQUAQUAD:
            px, py = _carried_back(trail.stretch[j + 1], px, py)
        px += pull[j, 0]
        py += pull[j, 1]
        if not c.still_water and c.vehicle == AQUAQUAD:
            # The hop comes before the drift.
            px, py = _carried_back(trail.stretch[j], px, py)
        if c.vehicle == YAW_RATE:
            way = c.speed * c.period
            swing += way * (np.cos(headings[j + 1]) * py - np.sin(headings[j + 1]) * px)
            slope[j, 0] = c.yaw_limit * c.period * swing
            slope[j, 1] = 0.0
        else:
            slope[j, 0] = c.step_length * px
            slope[j, 1] = c.step_length * py
            length = np.sqrt(u[j, 0] ** 2 + u[j, 1] ** 2)
            if length > 0.0:
                price = step_price(scene, u[j, 0], u[j, 1], c, worth)
                slope[j, 0] -= price * u[j, 0] / length**2
                slope[j, 1] -= price * u[j, 1] / length**2
    return value


@kernel
def feasible(scene, was_x, was_y, ux, uy, c):
    """The step nearest to (ux, uy) that the vehicle can make; an aquaquad that does not hop is not made to."""
    if c.vehicle == YAW_RATE:
        return min(max(ux, -1.0), 1.0), 0.0
    length = np.sqrt(ux * ux + uy * uy)
    scale = 1.0
    if length > scene.most:
        scale = scene.most / length
    if c.vehicle == AQUAQUAD:
        least = (1.0 + _SPARE) * c.drift_threshold
        if (was_x == 0.0 and was_y == 0.0) or least > scene.most:
            return 0.0, 0.0
        if 0.0 < length < least:
            scale = least / length
    return scale * ux, scale * uy


@loop_kernel
def climb(scene, u, steps, most, tolerance, trail, ocean, c, worth):
    """Move ``u`` uphill to where J is greatest nearby, in place; returns J, never less than at the start.

    Spectral projected gradient (Birgin, Martínez and Raydan, SIAM J. Optim. 2000), monotone: at most ``most`` steps,
    or until a step along the slope changes no number of ``u`` by more than ``tolerance``.
    """
    slope, trial, trial_slope = trail.slope, trail.trial, trail.trial_slope
    value = value_and_slope(scene, u, steps, slope, trail, ocean, c, worth)
    scale = 0.0
    for j in range(steps):
        scale = max(scale, abs(slope[j, 0]), abs(slope[j, 1]))
    scale = min(max(0.1 / scale if scale > 0.0 else 1.0, _SHORTEST), _LONGEST)
    for _ in range(most):
        farthest = 0.0
        promise = 0.0
        for j in range(steps):
            nx, ny = feasible(
                scene, u[j, 0], u[j, 1], u[j, 0] + scale * slope[j, 0], u[j, 1] + scale * slope[j, 1], c
            )
            trial[j, 0] = nx - u[j, 0]
            trial[j, 1] = ny - u[j, 1]
            promise += trial[j, 0] * slope[j, 0] + trial[j, 1] * slope[j, 1]
            ex, ey = feasible(scene, u[j, 0], u[j, 1], u[j, 0] + slope[j, 0], u[j, 1] + slope[j, 1], c)
            farthest = max(farthest, abs(ex - u[j, 0]), abs(ey - u[j, 1]))
        if not farthest > tolerance or not promise > 0.0:
            break
        share = 1.0
        found = value
        for _ in range(_HALVINGS):
            # Between two feasible steps of a hop with a least length may lie ones that are not.
            for j in range(steps):
                trial[j, 0], trial[j, 1] = feasible(
                    scene, u[j, 0], u[j, 1], u[j, 0] + trial[j, 0], u[j, 1] + trial[j, 1], c
                )
            found = value_and_slope(scene, trial, steps, trial_slope, trail, ocean, c, worth)
            if found >= value + _PROMISE * share * promise:
                break
            share *= 0.5
            for j in range(steps):
                trial[j, 0] = 0.5 * (trial[j, 0] - u[j, 0])
                trial[j, 1] = 0.5 * (trial[j, 1] - u[j, 1])
        if not found > value:
            break
        moved = 0.0
        bent = 0.0
        for j in range(steps):
            for i in range(2):
                dx = trial[j, i] - u[j, i]
                moved += dx * dx
                bent -= dx * (trial_slope[j, i] - slope[j, i])
                u[j, i] = trial[j, i]
                slope[j, i] = trial_slope[j, i]
        value = found
        scale = min(max(moved / bent, _SHORTEST), _LONGEST) if bent > 0.0 else min(10.0 * scale, _LONGEST)
    return value

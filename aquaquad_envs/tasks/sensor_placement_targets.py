"""How targets and the fence move, compiled."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.sensing.emissions import start_emission
from aquaquad_envs.tasks.sensor_placement_data import CONSTANT_VELOCITY, CORNERS, MANOEUVRING

#: Shares of the half width: targets begin within the first and turn back at the second, as does the fence.
START_SHARE = 0.8
EDGE_SHARE = 0.95
#: A manoeuvre changes the course by up to this, rad, either way.
MOST_TURN = 0.5 * np.pi
#: Slowest speed of a manoeuvring target, as a share of ``target_speed_m_s``.
SLOWEST = 0.5
_TRIES = 100


@kernel
def _on_land(x, y, w, ocean, c):
    return c.land and clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y) <= 0.0


@kernel
def _waiting_time(mean, stream):
    """Exponentially distributed, mean ``mean`` s."""
    return -mean * np.log(1.0 - uniform(stream))


@kernel
def start_target(w, j, ocean, c):
    """Place target ``j`` and set it on a course; one of constant velocity stays in the box if any course can."""
    room = START_SHARE * c.half_width
    ahead = c.horizon if c.target_motion == CONSTANT_VELOCITY else 0.0
    for _ in range(_TRIES):
        w.target_x[j] = room * (2.0 * uniform(w.rng_target) - 1.0)
        w.target_y[j] = room * (2.0 * uniform(w.rng_target) - 1.0)
        course = 2.0 * np.pi * uniform(w.rng_target)
        w.target_u[j] = c.target_speed * np.cos(course)
        w.target_v[j] = c.target_speed * np.sin(course)
        x = w.target_x[j] + ahead * w.target_u[j]
        y = w.target_y[j] + ahead * w.target_v[j]
        free = not _on_land(w.target_x[j], w.target_y[j], w, ocean, c) and not _on_land(x, y, w, ocean, c)
        if free and abs(x) <= room and abs(y) <= room:
            break
    w.target_next[j] = np.inf
    if c.target_motion != CONSTANT_VELOCITY:
        w.target_next[j] = _waiting_time(c.manoeuvre_interval, w.rng_target)
    start = start_emission(c.emissions, 0.0, w.rng_target)
    w.emission_nominal[j], w.emission_next[j], w.emission_on[j] = start


@kernel
def _manoeuvre(w, j, c):
    """A new course and speed; or a stop, or the end of one."""
    u = w.target_u[j]
    v = w.target_v[j]
    pause = c.manoeuvre_interval
    if c.target_motion == MANOEUVRING:
        course = np.arctan2(v, u) + MOST_TURN * (2.0 * uniform(w.rng_target) - 1.0)
        speed = c.target_speed * (SLOWEST + (1.0 - SLOWEST) * uniform(w.rng_target))
    else:
        goes = u == 0.0 and v == 0.0
        course = 2.0 * np.pi * uniform(w.rng_target)
        speed = c.target_speed if goes else 0.0
        pause = c.manoeuvre_interval if goes else c.stop_time
    w.target_u[j] = speed * np.cos(course)
    w.target_v[j] = speed * np.sin(course)
    w.target_next[j] += _waiting_time(pause, w.rng_target)


@kernel
def move_target(w, j, end, dt, ocean, c):
    """Move target ``j`` by ``dt`` s to time ``end``; manoeuvres due by then take effect at ``end``."""
    x = w.target_x[j] + dt * w.target_u[j]
    y = w.target_y[j] + dt * w.target_v[j]
    if c.target_motion == CONSTANT_VELOCITY and c.target_density > 0.0:
        # White acceleration, integrated exactly over the step (the filters' process noise).
        root = np.sqrt(c.target_density * dt)
        jolt_u = root * normal(w.rng_target)
        jolt_v = root * normal(w.rng_target)
        spread = root * dt / np.sqrt(12.0)
        x += 0.5 * dt * jolt_u + spread * normal(w.rng_target)
        y += 0.5 * dt * jolt_v + spread * normal(w.rng_target)
        w.target_u[j] += jolt_u
        w.target_v[j] += jolt_v
    if _on_land(x, y, w, ocean, c):
        w.target_u[j] = -w.target_u[j]
        w.target_v[j] = -w.target_v[j]
    else:
        w.target_x[j] = x
        w.target_y[j] = y
    while w.target_next[j] <= end:
        _manoeuvre(w, j, c)
    edge = EDGE_SHARE * c.half_width
    if abs(w.target_x[j]) > edge and w.target_x[j] * w.target_u[j] > 0.0:
        w.target_u[j] = -w.target_u[j]
    if abs(w.target_y[j]) > edge and w.target_y[j] * w.target_v[j] > 0.0:
        w.target_v[j] = -w.target_v[j]


@kernel
def start_fence(w, c):
    """Lay the fence: three equal stretches at bends of up to 45°, inside the box if it will go; and its course."""
    piece = c.fence_length / (CORNERS - 1)
    for _ in range(_TRIES):
        heading = 2.0 * np.pi * uniform(w.rng_initial)
        w.fence[0, 0] = 0.0
        w.fence[0, 1] = 0.0
        for k in range(1, CORNERS):
            w.fence[k, 0] = w.fence[k - 1, 0] + piece * np.cos(heading)
            w.fence[k, 1] = w.fence[k - 1, 1] + piece * np.sin(heading)
            heading += 0.25 * np.pi * (2.0 * uniform(w.rng_initial) - 1.0)
        fits = True
        for axis in range(2):
            low = w.fence[:, axis].min()
            high = w.fence[:, axis].max()
            room = max(EDGE_SHARE * c.half_width - 0.5 * (high - low), 0.0)
            fits = fits and high - low <= 2.0 * EDGE_SHARE * c.half_width
            shift = 0.5 * room * (2.0 * uniform(w.rng_initial) - 1.0) - 0.5 * (low + high)
            for k in range(CORNERS):
                w.fence[k, axis] += shift
        if fits:
            break
    course = 2.0 * np.pi * uniform(w.rng_initial)
    w.fence_u = c.fence_speed * np.cos(course)
    w.fence_v = c.fence_speed * np.sin(course)


@kernel
def move_fence(w, dt, c):
    """Move the whole fence by ``dt`` s; where a corner would leave the box it turns back."""
    edge = EDGE_SHARE * c.half_width
    for k in range(CORNERS):
        if abs(w.fence[k, 0]) > edge and w.fence[k, 0] * w.fence_u > 0.0:
            w.fence_u = -w.fence_u
        if abs(w.fence[k, 1]) > edge and w.fence[k, 1] * w.fence_v > 0.0:
            w.fence_v = -w.fence_v
    for k in range(CORNERS):
        w.fence[k, 0] += dt * w.fence_u
        w.fence[k, 1] += dt * w.fence_v


@kernel
def fence_point(w, share):
    """The point (x, y) at ``share`` in [0, 1] of the fence's length."""
    along = share * (CORNERS - 1)
    k = min(int(along), CORNERS - 2)
    part = along - k
    x = w.fence[k, 0] + part * (w.fence[k + 1, 0] - w.fence[k, 0])
    return x, w.fence[k, 1] + part * (w.fence[k + 1, 1] - w.fence[k, 1])


def equivalent_density(motion: str, speed: float, density: float, interval: float, stop: float) -> float:
    """White acceleration, m²/s³, with a target's mean square change of velocity: what a filter should assume.

    Manoeuvres are a jump process of rate λ; its increments have the covariance of white noise of density
    λ E|Δv|²/2 an axis. Constant velocity: ``density`` itself. Manoeuvring: λ = 1/``interval``, and with the speeds
    s, s' uniform in [1/2, 1] of ``speed`` and the turn δ uniform in ±90°, E|Δv|² = 2 E s² - 2 (E s)² E cos δ.
    Stop-and-go: every change is of the whole speed, two of them in ``interval`` + ``stop``.
    """
    if motion == "constant-velocity":
        return density
    if motion == "stop-and-go":
        return speed**2 / (interval + stop)
    mean = 0.5 * (1.0 + SLOWEST)
    square = mean**2 + (1.0 - SLOWEST) ** 2 / 12.0
    change = 2.0 * square - 2.0 * mean**2 * np.sin(MOST_TURN) / MOST_TURN
    return float(0.5 * change * speed**2 / interval)

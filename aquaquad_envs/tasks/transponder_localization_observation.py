"""What a vehicle of transponder localization observes, compiled.

Nothing here depends on how the map is turned, nor, at equal ratios of lengths, on its scale: vectors are in the frame
of the vehicle's heading (east for vehicles without one), lengths in units of its full step, information in units of
one range. Transponders stand least certain first: the first rows are those with the most to gain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.estimation.range_information import take_range
from aquaquad_envs.estimation.symmetric3 import determinant3, eigen3, invert3
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.obstacles import clearance_at, nearest_direction
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.physics.vehicle import flight_time
from aquaquad_envs.tasks.observing import local_time, unit
from aquaquad_envs.tasks.transponder_localization_data import AQUAQUAD, MAX_TRANSPONDERS, YAW_RATE
from aquaquad_envs.tasks.transponder_localization_vehicles import own_step

#: Actions whose gains are predicted: of the yaw-rate vehicle nine turn rates from -1 to 1; of the others a full step at
#: 0°, 45°, ... from east, anticlockwise, and none.
FAN = 9
#: Looks ahead: one step, and then on without turning to three and eight; and three steps with the same turn in each.
STEPS = (1, 3, 8)
LOOKS = ("1 step", "3 steps", "8 steps", "3 turns")
_TURNS = 3

_OWN = (
    "time left", "measurements left", "transponders", "step over noise", "greatest turn", "current ahead",
    "current left", "x", "y", "battery", "sin local time", "cos local time", "obstacle distance",
    "obstacle direction x", "obstacle direction y",
)  # fmt: skip
_TRANSPONDER = (
    "mask", "direction ahead", "direction left", "distance", "depth", "information 1", "information 2",
    "information 3",
    *(f"{axis} axis {part}" for axis in ("best", "worst")
      for part in ("along", "diagonal", "down", "ahead down", "left down")),
    "replies",
)  # fmt: skip
OBSERVATION_NAMES = (
    *_OWN,
    *(f"{what} in {look}" for look in LOOKS for what in ("gain", "choice")),
    *(f"action {a} in {look}" for look in LOOKS for a in range(1, FAN + 1)),
    *(f"transponder {m} {name}" for m in range(1, MAX_TRANSPONDERS + 1) for name in _TRANSPONDER),
)
SIZE = len(OBSERVATION_NAMES)
_GAIN = len(_OWN)
_ACTION = _GAIN + 2 * len(LOOKS)
_ROWS = _ACTION + FAN * len(LOOKS)
_WIDTH = len(_TRANSPONDER)
_CURRENT, _PLACE, _BATTERY, _OBSTACLE = (
    _OWN.index(name) for name in ("current ahead", "x", "battery", "obstacle distance")
)
_FAN_COS = np.array([*np.cos(np.arange(FAN - 1) * np.pi / 4), 0.0])
_FAN_SIN = np.array([*np.sin(np.arange(FAN - 1) * np.pi / 4), 0.0])


class Scratch(NamedTuple):
    """Memory of one call, used by one world after another."""

    covariance: np.ndarray  # (MAX_TRANSPONDERS, 6)
    after: np.ndarray  # (6,)
    turned: np.ndarray  # (6,)
    path: np.ndarray  # (2, steps + turns)
    gains: np.ndarray  # (looks, FAN)
    work: np.ndarray  # (3, 3)
    values: np.ndarray  # (3,)
    vectors: np.ndarray  # (3, 3)
    order: np.ndarray  # (MAX_TRANSPONDERS,)


@loop_kernel
def make_scratch():
    """Fresh scratch memory."""
    return Scratch(
        np.empty((MAX_TRANSPONDERS, 6)), np.empty(6), np.empty(6), np.empty((2, STEPS[-1] + _TURNS)),
        np.empty((len(LOOKS), FAN)), np.empty((3, 3)), np.empty(3), np.empty((3, 3)),
        np.empty(MAX_TRANSPONDERS, dtype=np.int64),
    )  # fmt: skip


@kernel
def _share(value, scale):
    """``value`` brought into (-1, 1), a half at ``scale``."""
    return value / (abs(value) + scale)


@kernel
def _length(value, c):
    """A length of any size: ln(1 + steps), brought into [0, 1), a half at about six steps."""
    return _share(np.log(1.0 + abs(value) / c.step_length), 2.0)


@kernel
def _path(w, a, u, v, s, c):
    """Places after 1, 2, ... steps from now by action ``a``, then without turning; and after further equal turns.

    The current is taken to stay (u, v).
    """
    drift = c.period
    step_x = 0.0
    step_y = 0.0
    if c.vehicle != YAW_RATE:
        step_x = c.step_length * _FAN_COS[a]
        step_y = c.step_length * _FAN_SIN[a]
        if c.vehicle == AQUAQUAD and a < FAN - 1:
            drift -= flight_time(c.step_length, c.airspeed)
    drift_x = drift * u
    drift_y = drift * v
    x = w.x
    y = w.y
    heading = w.heading
    for k in range(_TURNS):
        if c.vehicle == YAW_RATE:
            new_x, new_y, heading = own_step(x, y, heading, -1.0 + 2.0 * a / (FAN - 1), 0.0, c)
            if k == 0:
                step_x = new_x - x
                step_y = new_y - y
            x = new_x + drift_x
            y = new_y + drift_y
            s.path[0, STEPS[-1] + k] = x
            s.path[1, STEPS[-1] + k] = y
    for k in range(STEPS[-1]):
        s.path[0, k] = w.x + (k + 1) * (step_x + drift_x)
        s.path[1, k] = w.y + (k + 1) * (step_y + drift_y)


@kernel
def _walk(w, m, first, last, before, after, s, weight):
    """Factor by which ranges at places ``first`` to ``last`` of the path raise det Y of transponder ``m``."""
    factor = 1.0
    for k in range(first, last):
        factor *= take_range(
            before if k == first else after, w.estimate[m, 0] - s.path[0, k], w.estimate[m, 1] - s.path[1, k],
            w.estimate[m, 2], weight, after,
        )  # fmt: skip
    return factor


@loop_kernel
def predict_gains(w, u, v, s, c):
    """Gains in Σ ln det Y that every action of the fan promises, by looks, into ``s.gains``, to the last measurement.

    As the planners have it: at the present estimates, every range replied to.
    """
    left = c.num_measurements - w.count
    weight = 1.0 / (c.sigma * c.sigma)
    one = min(STEPS[0], left)
    three = min(STEPS[1], left)
    eight = min(STEPS[2], left)
    turns = min(_TURNS, left) if c.vehicle == YAW_RATE else 0
    for m in range(w.num_transponders):
        invert3(w.information[m], s.covariance[m])
    for a in range(FAN):
        _path(w, a, u, v, s, c)
        first = 1.0
        second = 1.0
        third = 1.0
        fourth = 1.0
        for m in range(w.num_transponders):
            c0 = s.covariance[m]
            factor = _walk(w, m, 0, one, c0, s.after, s, weight)
            first *= factor
            fourth *= _walk(w, m, STEPS[2], STEPS[2] + turns, c0, s.turned, s, weight)
            factor *= _walk(w, m, one, three, s.after, s.after, s, weight)
            second *= factor
            factor *= _walk(w, m, three, eight, s.after, s.after, s, weight)
            third *= factor
        s.gains[0, a] = np.log(first)
        s.gains[1, a] = np.log(second)
        s.gains[2, a] = np.log(third)
        s.gains[3, a] = np.log(fourth)


@kernel
def _gain_part(w, out, s):
    """Every look's gains: the best, a transponder, how much the choice matters, and each action's share of that."""
    for look in range(len(LOOKS)):
        low = s.gains[look, 0]
        high = low
        for a in range(1, FAN):
            low = min(low, s.gains[look, a])
            high = max(high, s.gains[look, a])
        out[_GAIN + 2 * look] = _share(high / w.num_transponders, 1.0)
        out[_GAIN + 2 * look + 1] = _share((high - low) / w.num_transponders, 0.1)
        scale = 1.0 / (high - low) if high - low > 1e-12 else 0.0
        for a in range(FAN):
            out[_ACTION + FAN * look + a] = unit(scale * (s.gains[look, a] - low))


@kernel
def _sort(w, s):
    """Indices of the transponders into ``s.order``, least certain first; ties in the order of their numbers."""
    for m in range(w.num_transponders):
        certainty = determinant3(w.information[m])
        at = m
        while at > 0 and determinant3(w.information[s.order[at - 1]]) > certainty:
            s.order[at] = s.order[at - 1]
            at -= 1
        s.order[at] = m


@kernel
def _axis(out, at, s, k, cos, sin):
    """Axis ``k`` of the ellipsoid as the independent parts of e eᵀ in the vehicle's frame: its sign does not matter."""
    ahead = cos * s.vectors[0, k] + sin * s.vectors[1, k]
    aside = cos * s.vectors[1, k] - sin * s.vectors[0, k]
    down = s.vectors[2, k]
    out[at] = unit(ahead * ahead - aside * aside)
    out[at + 1] = unit(2.0 * ahead * aside)
    out[at + 2] = unit(down * down)
    out[at + 3] = unit(2.0 * ahead * down)
    out[at + 4] = unit(2.0 * aside * down)


@loop_kernel
def _transponder_rows(w, out, cos, sin, s, c):
    _sort(w, s)
    variance = c.sigma * c.sigma
    for row in range(w.num_transponders):
        m = s.order[row]
        at = _ROWS + row * _WIDTH
        dx = w.estimate[m, 0] - w.x
        dy = w.estimate[m, 1] - w.y
        away = np.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / away if away > 0.0 else 0.0
        out[at] = 1.0
        out[at + 1] = unit(inverse * (cos * dx + sin * dy))
        out[at + 2] = unit(inverse * (cos * dy - sin * dx))
        out[at + 3] = _length(away, c)
        depth = w.estimate[m, 2]
        out[at + 4] = _length(depth, c) if depth >= 0.0 else -_length(depth, c)
        eigen3(w.information[m], s.work, s.values, s.vectors)
        for k in range(3):
            out[at + 5 + k] = _share(np.log(max(variance * s.values[k], 1e-300)), 8.0)
        _axis(out, at + 8, s, 0, cos, sin)
        _axis(out, at + 13, s, 2, cos, sin)
        out[at + 18] = w.replies[m] / w.count


@kernel
def _own_part(w, out, u, v, cos, sin, c):
    left = c.num_measurements - w.count
    out[0] = left / (c.num_measurements - 1.0)
    out[1] = _share(1.0 * left, 10.0)
    out[2] = w.num_transponders / MAX_TRANSPONDERS
    out[3] = _share(np.log(c.step_length / c.sigma), 4.0)
    out[4] = unit(c.yaw_limit * c.period / np.pi) if c.vehicle == YAW_RATE else 0.0
    scale = c.period / c.step_length
    out[_CURRENT] = _share(scale * (cos * u + sin * v), 1.0)
    out[_CURRENT + 1] = _share(scale * (cos * v - sin * u), 1.0)


@kernel
def _aquaquad_part(w, out, ocean, c):
    """What concerns the aquaquad alone: the box, its battery, the sun, obstacles."""
    out[_PLACE] = unit(w.x / c.half_width)
    out[_PLACE + 1] = unit(w.y / c.half_width)
    out[_BATTERY] = unit(w.battery_wh / c.capacity)
    out[_BATTERY + 1], out[_BATTERY + 2] = local_time(w.clock_s + w.time_s, c)
    clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, w.x, w.y)
    dx, dy = nearest_direction(ocean.clearance, w.obstacle, ocean.clearance_grid, w.x, w.y)
    out[_OBSTACLE] = unit(clear / c.step_length)
    out[_OBSTACLE + 1] = unit(dx)
    out[_OBSTACLE + 2] = unit(dy)


@loop_kernel
def observe_world(w, out, ocean, c, s):
    """Write the observation (SIZE,), in [-1, 1], of one world; ``s`` is scratch memory."""
    for k in range(SIZE):
        out[k] = 0.0
    cos = np.cos(w.heading)
    sin = np.sin(w.heading)
    u = 0.0
    v = 0.0
    if not c.still_water:
        u, v = current_at(ocean.velocity, w.truth, ocean.axes, w.clock_s + w.time_s, w.x, w.y)
    if c.current_noise > 0.0:
        u += c.current_noise * normal(w.rng_sensor)
        v += c.current_noise * normal(w.rng_sensor)
    _own_part(w, out, u, v, cos, sin, c)
    if c.vehicle == AQUAQUAD:
        _aquaquad_part(w, out, ocean, c)
    predict_gains(w, u, v, s, c)
    _gain_part(w, out, s)
    _transponder_rows(w, out, cos, sin, s, c)

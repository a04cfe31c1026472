"""Where a vehicle of ``hdop-optimal`` would be, decision by decision, were it to make for a place; compiled.

Each decision the vehicle hops towards the place, at most the longest hop, and drifts on the forecast for the
rest of the period; once it has landed on the place it only drifts. A steered vehicle goes there and stays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.energy import charge_between
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh, flight_time, inside_box
from aquaquad_envs.tasks.sensor_placement_data import MAX_VEHICLES

#: Decisions for which a path must stay in open water; from there on there is time to leave.
SAFE_DECISIONS = 2
#: Share of the longest hop that is flown: rounding must not cost the measurement at the end of the flight.
_SHORT_OF_LONGEST = 0.999
#: Shortest hop as a multiple of the world's threshold, for the same reason.
_ABOVE_THRESHOLD = 1.001
#: Share of the forecast charge that is counted on.
_SURE_CHARGE = 0.9


class Settings(NamedTuple):
    """What of the policy's parameters the kernels read."""

    decisions: int  # of look-ahead
    margin: float  # m of clearance
    price: float  # of a Wh
    reserve: float  # Wh that stay in the battery
    reach: float  # m, the longest step of a decision
    least: float  # m, the shortest


class Paths(NamedTuple):
    """Paths of every vehicle by place: the fan's, and one more for a place that is assigned."""

    x: np.ndarray  # (vehicles, places, decisions) m, where the vehicle drifts in each decision
    y: np.ndarray
    share: np.ndarray  # (vehicles, places, decisions) of the decision's measurements that it can make
    place: np.ndarray  # (vehicles, places, 2) m
    goes: np.ndarray  # (vehicles, places) bool: towards the place, or drifts
    energy: np.ndarray  # (vehicles, places) Wh of flight
    safe: np.ndarray  # (vehicles, places) decisions in open water
    usable: np.ndarray  # (vehicles, places) bool

    @staticmethod
    def allocate(places: int, decisions: int) -> Paths:
        """Room for the paths of one team."""
        steps, one = (MAX_VEHICLES, places, decisions), (MAX_VEHICLES, places)
        return Paths(
            np.zeros(steps), np.zeros(steps), np.zeros(steps), np.zeros((*one, 2)), np.zeros(one, bool),
            np.zeros(one), np.zeros(one, np.int64), np.zeros(one, bool),
        )  # fmt: skip


def make_settings(
    batch, *, lookahead_s: float, margin_m: float, price_per_wh: float, reserve: float
) -> Settings:
    """Settings for the worlds of ``batch``."""
    c = batch.constants
    decisions = max(round(lookahead_s / c.action_period), 1)
    if c.steered:
        return Settings(decisions, 0.0, 0.0, 0.0, c.vehicle_speed * c.action_period, 0.0)
    return Settings(
        decisions, float(margin_m), float(price_per_wh), float(reserve) * c.capacity, _SHORT_OF_LONGEST * c.max_hop,
        min(_ABOVE_THRESHOLD * max(c.drift_threshold, 1e-6), _SHORT_OF_LONGEST) * c.max_hop,
    )  # fmt: skip


def make_fan(settings: Settings, *, headings: int, lengths: tuple[float, ...]) -> np.ndarray:
    """Displacements (places, 2), m: none, then ``headings`` directions at ``lengths``, in longest steps."""
    angles = 2.0 * np.pi * np.arange(headings) / headings
    ring = np.stack([np.cos(angles), np.sin(angles)], -1)
    reaches = np.maximum(np.array(lengths) * settings.reach, settings.least)
    return np.concatenate([np.zeros((1, 2)), (reaches[:, None, None] * ring).reshape(-1, 2)])


@kernel
def is_open(x, y, w, ocean, c, margin):
    """Whether (x, y) is open water, ``margin`` m clear of obstacles and of the box's edge."""
    clear = clearance_at(ocean.clearance, w.obstacle, ocean.clearance_grid, x, y)
    return clear >= margin and inside_box(x, y, c.half_width - margin)


@kernel
def first_step(x, y, to_x, to_y, settings):
    """The step (dx, dy), m, of the first decision from (x, y) towards a place."""
    dx = to_x - x
    dy = to_y - y
    distance = np.sqrt(dx * dx + dy * dy)
    if distance <= 0.0:
        return settings.least, 0.0
    length = min(max(distance, settings.least), settings.reach)
    return dx * length / distance, dy * length / distance


@kernel
def _afloat_share(flying, c):
    """Share of a decision's sub-steps at whose end a vehicle that flies for ``flying`` s first is on the water."""
    step = c.action_period / c.sub_steps
    missed = max(int(np.ceil(flying / step - 1e-9)) - 1, 0)
    return max(c.sub_steps - missed, 0) / c.sub_steps


@kernel
def _steer(i, k, w, c, settings, paths):
    x = w.x[i]
    y = w.y[i]
    for d in range(settings.decisions):
        if paths.goes[i, k]:
            dx = paths.place[i, k, 0] - x
            dy = paths.place[i, k, 1] - y
            distance = np.sqrt(dx * dx + dy * dy)
            part = min(1.0, settings.reach / distance) if distance > 0.0 else 0.0
            x += part * dx
            y += part * dy
        paths.x[i, k, d] = x
        paths.y[i, k, d] = y
        paths.share[i, k, d] = 1.0


@loop_kernel
def _hop_and_drift(i, k, w, ocean, c, settings, paths):
    """Fills path ``k`` of vehicle ``i``: (energy, Wh; decisions in open water)."""
    x = w.x[i]
    y = w.y[i]
    now = w.clock_s + w.time_s
    goes = paths.goes[i, k]
    energy = 0.0
    paths.share[i, k, :] = 0.0
    for d in range(settings.decisions):
        flying = 0.0
        if goes:
            to_x = paths.place[i, k, 0]
            to_y = paths.place[i, k, 1]
            dx, dy = first_step(x, y, to_x, to_y, settings)
            x += dx
            y += dy
            length = np.sqrt(dx * dx + dy * dy)
            flying = flight_time(length, c.airspeed)
            energy += flight_energy_wh(length, c.airspeed, c.flight_power)
            goes = np.sqrt((to_x - x) * (to_x - x) + (to_y - y) * (to_y - y)) > settings.least
            if not is_open(x, y, w, ocean, c, settings.margin):
                return energy, d
        half = 0.5 * (c.action_period - flying)
        for part in range(2):
            if not c.still_water:
                begin = now + d * c.action_period + flying + part * half
                x, y = drift_step(ocean.velocity, w.forecast, ocean.axes, begin, x, y, half, c.euler)
                if not is_open(x, y, w, ocean, c, settings.margin):
                    return energy, d
            if part == 0:
                paths.x[i, k, d] = x
                paths.y[i, k, d] = y
        paths.share[i, k, d] = _afloat_share(flying, c)
    return energy, settings.decisions


@kernel
def _affordable(i, energy, w, ocean, c, settings):
    """Whether the battery keeps its reserve after ``energy`` Wh, now and to the end of the mission."""
    now = w.clock_s + w.time_s
    left = c.horizon - w.time_s
    charge = charge_between(ocean.collected_wh, ocean.solar_step, now, now + left)
    after = w.battery_wh[i] - energy - settings.reserve
    return after > c.base_power * c.action_period / 3600.0 and (
        min(after, c.capacity) + _SURE_CHARGE * charge > c.base_power * left / 3600.0
    )


@loop_kernel
def find_path(i, k, w, ocean, c, settings, paths):
    """Path ``k`` of vehicle ``i``, whose ``place`` and ``goes`` are set, and whether it is usable."""
    if c.steered:
        _steer(i, k, w, c, settings, paths)
        paths.energy[i, k] = 0.0
        paths.safe[i, k] = settings.decisions
        paths.usable[i, k] = True
        return
    energy, safe = _hop_and_drift(i, k, w, ocean, c, settings, paths)
    paths.energy[i, k] = energy
    paths.safe[i, k] = safe
    usable = safe >= min(SAFE_DECISIONS, settings.decisions)
    paths.usable[i, k] = usable and (not paths.goes[i, k] or _affordable(i, energy, w, ocean, c, settings))


@loop_kernel
def find_fan(i, heading_x, heading_y, w, ocean, c, settings, fan, paths):
    """All paths of vehicle ``i`` over the ``fan``, turned to the unit vector ``heading``; returns the safest's index.

    That is what is left to a vehicle without a usable path: the longest in open water, of those the cheapest.
    """
    safest = 0
    for k in range(fan.shape[0]):
        paths.goes[i, k] = k > 0
        paths.place[i, k, 0] = w.x[i] + fan[k, 0] * heading_x - fan[k, 1] * heading_y
        paths.place[i, k, 1] = w.y[i] + fan[k, 0] * heading_y + fan[k, 1] * heading_x
        find_path(i, k, w, ocean, c, settings, paths)
        more = paths.safe[i, k] - paths.safe[i, safest]
        if more > 0 or (more == 0 and paths.energy[i, k] < paths.energy[i, safest]):
            safest = k
    return safest

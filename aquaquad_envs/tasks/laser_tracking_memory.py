"""What the quadrotor of laser tracking remembers of its readings: edges, where the light must be, where it is not.

Places are own position less ``carried``: relative to the submerged vehicle as far as its motion is known, and to
where it was at the start.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.sensing.laser import intensity, radius_of_intensity
from aquaquad_envs.tasks.laser_tracking_data import HISTORY, SECTORS
from aquaquad_envs.tasks.laser_tracking_sensing import height_of

#: So many edges count in their mean.
_RIM_MEMORY = 4.0
#: Share of a contradiction between the present reading and the believed centre that moves the centre, and of an
#: earlier one; so many earlier ones are recalled a decision, and all of them so often where light is found.
_CENTER_GAIN, _RECALL_GAIN = 0.2, 0.05
_RECALLED, _FOUND_PASSES, _STRIDE = 16, 1, 37
#: Contradiction, in squared detectable radii, that two directions of first light may differ by.
_SLACK = 0.5
#: Weight of a direction of first light abeam or astern; 1 more ahead.
_LEAST_WEIGHT = 0.05
#: Share of the peak below which nothing is told from darkness.
_LEAST_LIGHT = 1e-3
#: s; in which the believed ambient light follows the readings.
_AMBIENT_TIME_S = 3.0
#: Within this share of the detectable radius the light is as bright as on the axis, on a flat top.
_PLATEAU = 0.7
#: m/s; dark ground counts as unseen again at this rate, since what is known of the relative motion is not exact.
_FORGET_M_S = 0.02
_COS = np.cos(np.arange(SECTORS) * 2.0 * np.pi / SECTORS)
_SIN = np.sin(np.arange(SECTORS) * 2.0 * np.pi / SECTORS)


@kernel
def signal_of(world):
    """The reading less the believed ambient light, W/m²."""
    return world.reading - world.ambient_seen


@kernel
def start_memory(world, c):
    """Nothing to remember but the first reading."""
    world.detected = 0
    world.light_s = -1.0
    world.light_x = 0.0
    world.light_y = 0.0
    world.edge_s = -1.0
    world.edge_x = 0.0
    world.edge_y = 0.0
    world.edge_kind = 0
    world.rim_x = 0.0
    world.rim_y = 0.0
    world.rim_count = 0.0
    world.center_x = world.guess_x
    world.center_y = world.guess_y
    world.search_x = world.guess_x
    world.search_y = world.guess_y
    world.swept[:] = 0.0
    # A reading far brighter than ambient light may be is the laser.
    spread = 2.0 * c.ambient_variation * c.beam.ambient
    surplus = world.reading - c.beam.ambient
    world.ambient_seen = c.beam.ambient + min(max(surplus, -spread), spread)
    remember(world, c)


@kernel
def _follow_ambient(world, r, c):
    """Ambient light varies slowly: follow it in the dark, and where the light is as bright as it gets.

    ``r``: distance to the believed centre, m.
    """
    if world.detected == 0:
        expected = 0.0
    elif r < _PLATEAU * c.radius:
        expected = intensity(c.beam, r, height_of(world))
    else:
        return
    share = min(c.action_period / _AMBIENT_TIME_S, 1.0)
    followed = world.ambient_seen + share * (signal_of(world) - expected)
    spread = 3.0 * c.ambient_variation * c.beam.ambient
    world.ambient_seen = min(max(followed, c.beam.ambient - spread), c.beam.ambient + spread)


@kernel
def _pull(world, entry, gain):
    """Move the believed centre by ``gain`` times what the remembered reading ``entry`` contradicts."""
    dx = world.center_x - entry[1]
    dy = world.center_y - entry[2]
    r = np.sqrt(dx * dx + dy * dy)
    missing = entry[3] - r if r < entry[3] else min(entry[4] - r, 0.0)
    if missing != 0.0 and r > 1e-9:
        world.center_x += gain * missing * dx / r
        world.center_y += gain * missing * dy / r


@kernel
def _believe_center(world, found):
    """Reconcile the believed centre with the present reading and with some of those before, with all if just found."""
    passes = _FOUND_PASSES * HISTORY if found else _RECALLED
    for k in range(passes):
        # A stride that visits all readings in turn.
        back = (world.steps * _RECALLED + k) * _STRIDE % HISTORY
        if back <= world.steps:
            _pull(world, world.history[(world.steps - back) % HISTORY], _RECALL_GAIN)
    _pull(world, world.history[world.steps % HISTORY], _CENTER_GAIN)


@loop_kernel
def _contradiction(world, radius, x, y):
    """How much a centre at (x, y) contradicts what is swept and the history: the sum of squares, m²."""
    px = x - world.search_x
    py = y - world.search_y
    sector = int(np.floor(np.arctan2(py, px) / (2.0 * np.pi) * SECTORS + 0.5)) % SECTORS
    missing = max(world.swept[sector] - radius - np.sqrt(px * px + py * py), 0.0)
    total = HISTORY * missing * missing
    for back in range(min(world.steps + 1, HISTORY)):
        entry = world.history[(world.steps - back) % HISTORY]
        dx = x - entry[1]
        dy = y - entry[2]
        r = np.sqrt(dx * dx + dy * dy)
        missing = max(entry[3] - r, r - entry[4], 0.0)
        total += missing * missing
    return total


@loop_kernel
def _first_light(world, x, y, c):
    """Light found, or found anew: the centre lies around, on the side that contradicts dark places least."""
    reach = radius_of_intensity(c.beam, c.detection, height_of(world))
    most = np.inf
    for k in range(SECTORS):
        most = min(most, _contradiction(world, c.radius, x + reach * _COS[k], y + reach * _SIN[k]))
    most += _SLACK * c.radius * c.radius
    # A disc is met head on more often than at its flank.
    u = world.own_u - world.seen_u
    v = world.own_v - world.seen_v
    speed = max(np.sqrt(u * u + v * v), 1e-9)
    mean_x = 0.0
    mean_y = 0.0
    for k in range(SECTORS):
        if _contradiction(world, c.radius, x + reach * _COS[k], y + reach * _SIN[k]) <= most:
            weight = _LEAST_WEIGHT + max((u * _COS[k] + v * _SIN[k]) / speed, 0.0)
            mean_x += weight * _COS[k]
            mean_y += weight * _SIN[k]
    length = max(np.sqrt(mean_x * mean_x + mean_y * mean_y), 1e-9)
    world.center_x = x + reach * mean_x / length
    world.center_y = y + reach * mean_y / length


@kernel
def _sweep(world, x, y, c):
    """From the centre of the search outwards, dark ground that adjoins what is swept already."""
    x -= world.search_x
    y -= world.search_y
    for k in range(SECTORS):
        along = x * _COS[k] + y * _SIN[k]
        across = x * _SIN[k] - y * _COS[k]
        swept = max(world.swept[k] - _FORGET_M_S * c.action_period, 0.0)
        square = c.sweep * c.sweep - across * across
        if square > 0.0:
            half = np.sqrt(square)
            if along - half <= swept and along + half > swept:
                swept = along + half
        world.swept[k] = swept


@kernel
def _write_down(world, x, y, c):
    """The present reading into the history.

    One that is off by at most ``c.margin`` tells a least and a greatest distance to the centre.
    """
    signal = signal_of(world)
    height = height_of(world)
    entry = world.history[world.steps % HISTORY]
    entry[0] = signal / c.peak
    entry[1] = x
    entry[2] = y
    entry[3] = radius_of_intensity(c.beam, max(signal + c.margin, _LEAST_LIGHT * c.peak), height)
    # Among hundreds of readings in the dark noise lets some look like faint light: they tell no greatest distance.
    lit = signal >= c.detection and signal > c.margin
    entry[4] = radius_of_intensity(c.beam, signal - c.margin, height) if lit else np.inf


@kernel
def remember(world, c):
    """Take the present reading into memory, at the place where it was made."""
    x = world.own_x - world.carried_x
    y = world.own_y - world.carried_y
    _write_down(world, x, y, c)
    detected = 1 if signal_of(world) >= c.detection else 0
    if detected == 1:
        found = world.light_s < 0.0 or world.time_s - world.light_s > c.lost_after
        if found:
            _first_light(world, x, y, c)
        _believe_center(world, found)
        world.light_s = world.time_s
        world.light_x = x
        world.light_y = y
        world.search_x = world.center_x
        world.search_y = world.center_y
        world.swept[:] = 0.0
    else:
        if world.light_s >= 0.0:
            _believe_center(world, False)
        _sweep(world, x, y, c)
    if detected != world.detected and world.steps > 0:
        last = world.history[(world.steps - 1) % HISTORY]
        world.edge_x = 0.5 * (x + last[1])
        world.edge_y = 0.5 * (y + last[2])
        world.edge_s = world.time_s
        world.edge_kind = 1 if detected == 1 else -1
        world.rim_count = min(world.rim_count + 1.0, _RIM_MEMORY)
        world.rim_x += (world.edge_x - world.rim_x) / world.rim_count
        world.rim_y += (world.edge_y - world.rim_y) / world.rim_count
    world.detected = detected
    if c.ambient_variation > 0.0:
        dx = world.center_x - x
        dy = world.center_y - y
        _follow_ambient(world, np.sqrt(dx * dx + dy * dy), c)

"""What an agent of laser tracking observes.

Places and motions are relative to the submerged vehicle as far as its velocity is known. Vectors are squashed by
their length, d / (|d| + s), so that they turn with the map and never saturate.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.tasks.laser_tracking_data import HISTORY, SECTORS
from aquaquad_envs.tasks.laser_tracking_memory import signal_of
from aquaquad_envs.tasks.laser_tracking_sensing import height_of

#: Decisions ago whose reading, and motion since, are observed.
LAGS = (1, 2, 4, 8, 16, 32)
#: Scale of times since, s, and of heights, m; scale of vectors as a multiple of the detectable radius.
TIME_SCALE_S = 5.0
HEIGHT_SCALE_M = 8.0
REACH = 2.0

OBSERVATION_NAMES = (
    "intensity", "detected", "time since light", "time left", "height",
    "goal dx", "goal dy", "goal distance", "goal direction x", "goal direction y",
    "search dx", "search dy", "moved dx", "moved dy", "velocity u", "velocity v",
    "relative velocity u", "relative velocity v", "command u", "command v",
    "last light dx", "last light dy", "edge dx", "edge dy", "edge kind", "time since edge", "rim dx", "rim dy",
    *(f"swept {360 * k / SECTORS:g}°" for k in range(SECTORS)),
    *(f"{what} {lag} ago" for lag in LAGS for what in ("intensity", "moved dx since", "moved dy since")),
)  # fmt: skip
_SWEPT = OBSERVATION_NAMES.index("swept 0°")
_HISTORY = OBSERVATION_NAMES.index("intensity 1 ago")


@kernel
def _unit(value):
    value = value if value > -1.0 else -1.0
    return value if value < 1.0 else 1.0


@kernel
def _squash(value, scale):
    return value / (abs(value) + scale)


@kernel
def _vector(out, k, dx, dy, scale):
    """Write the squashed vector (dx, dy) to ``out[k : k + 2]``."""
    factor = 1.0 / (np.sqrt(dx * dx + dy * dy) + scale)
    out[k] = dx * factor
    out[k + 1] = dy * factor


@kernel
def _since(now, then):
    """Squashed time since ``then``; 1 for never (negative)."""
    return 1.0 if then < 0.0 else _squash(now - then, TIME_SCALE_S)


@kernel
def _swept_part(world, x, y, out, scale):
    """How far the ground is swept on either side of the vehicle's own bearing from the centre of the search."""
    bearing = np.arctan2(y - world.search_y, x - world.search_x) / (2.0 * np.pi) * SECTORS
    sector = np.floor(bearing)
    share = bearing - sector
    first = int(sector) + SECTORS
    for k in range(SECTORS):
        low = world.swept[(first + k) % SECTORS]
        high = world.swept[(first + k + 1) % SECTORS]
        out[_SWEPT + k] = _squash((1.0 - share) * low + share * high, scale)


@kernel
def observe_world(world, out, c):
    """Write the observation of ``world``, all within [-1, 1], into ``out``."""
    x = world.own_x - world.carried_x
    y = world.own_y - world.carried_y
    scale = REACH * c.radius
    out[0] = _squash(signal_of(world) / c.peak, 1.0)
    out[1] = world.detected
    out[2] = _since(world.time_s, world.light_s)
    out[3] = _unit(1.0 - world.time_s / c.horizon)
    out[4] = _squash(height_of(world), HEIGHT_SCALE_M)
    goal_x = world.center_x - x
    goal_y = world.center_y - y
    away = np.sqrt(goal_x * goal_x + goal_y * goal_y)
    _vector(out, 5, goal_x, goal_y, scale)
    out[7] = _squash(away, scale)
    nonzero = away if away > 1e-9 else 1e-9
    out[8] = _unit(goal_x / nonzero)
    out[9] = _unit(goal_y / nonzero)
    _vector(out, 10, world.search_x - x, world.search_y - y, scale)
    _vector(out, 12, x, y, scale)
    _vector(out, 14, world.own_u, world.own_v, c.max_speed)
    _vector(out, 16, world.own_u - world.seen_u, world.own_v - world.seen_v, c.max_speed)
    out[18] = _unit(world.command_u / c.max_speed)
    out[19] = _unit(world.command_v / c.max_speed)
    for k in range(20, 28):
        out[k] = 0.0
    if world.light_s >= 0.0:
        _vector(out, 20, world.light_x - x, world.light_y - y, scale)
    if world.rim_count > 0.0:
        _vector(out, 22, world.edge_x - x, world.edge_y - y, scale)
        out[24] = world.edge_kind
        _vector(out, 26, world.rim_x - x, world.rim_y - y, scale)
    out[25] = _since(world.time_s, world.edge_s)
    _swept_part(world, x, y, out, scale)
    for k in range(len(LAGS)):
        # Before so many decisions were made: the first.
        then = world.history[max(world.steps - LAGS[k], 0) % HISTORY]
        out[_HISTORY + 3 * k] = _squash(then[0], 1.0)
        _vector(out, _HISTORY + 3 * k + 1, x - then[1], y - then[2], scale)

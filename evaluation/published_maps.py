"""The published HDOP maps (Dillard, NPS 2014, figs. 32, 47, 48): one vehicle moves, the others and the target stay.

TDOA of three sensors, bearings of four, and the distance to the goal that the planner weighs beside HDOP; for
completeness also ranges of the same four, which the source does not draw. Assumed: where the two fixed sensors of the
TDOA map stand (HDOP depends on directions only), and the target of the bearing map at the centre, where the ridge lies
as published; the goal's own target (App. C) would turn it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.hdop import hdop
from evaluation.published_values import MAPS, SOUND_SPEED_M_S

#: The fixed sensors of the TDOA map, m: 45° on either side of north.
TDOA_PAIR = ((-2500.0, 2500.0), (2500.0, 2500.0))
TARGET = (0.0, 0.0)
#: Offset from the goal of App. C's target, m.
_APP_C_OFFSET = 100.0
CELLS = 80
_RING_M = 3000.0


def moving_map(kind: str, fixed: Any, target: Any, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """HDOP about ``target`` where the moving sensor is at (x, y), the others ``fixed`` (n, 2), m: shape of x and y."""
    out = np.empty(np.broadcast_shapes(x.shape, y.shape))
    for index, here in zip(
        np.ndindex(out.shape), np.stack(np.broadcast_arrays(x, y), -1).reshape(-1, 2), strict=True
    ):
        team = np.vstack([fixed, here])
        out[index] = hdop(kind, team, target, sound_speed_m_s=SOUND_SPEED_M_S)
    return out


def reproduce_maps() -> tuple[dict[str, Any], dict[str, Any]]:
    """What the maps show, in numbers, and the maps for the figure."""
    half, team = MAPS["half_width_m"], np.array(MAPS["team"])
    axis = np.linspace(-half, half, CELLS + 1)
    x, y = np.meshgrid(axis, axis)
    goal = np.array(MAPS["goal"])
    drawn = {
        "axis": axis,
        "tdoa": moving_map("tdoa", TDOA_PAIR, TARGET, x, y),
        "bearing": moving_map("bearing", team, TARGET, x, y),
        "range": moving_map("range", team, TARGET, x, y),
        "distance": np.hypot(x - goal[0], y - goal[1]),
    }
    ring = np.radians(np.arange(360.0))
    directions = np.stack([np.cos(ring), np.sin(ring)])
    tdoa = moving_map("tdoa", TDOA_PAIR, TARGET, *(_RING_M * directions))
    ridges = {}
    for name, target in (("centre", np.array(TARGET)), ("goal", goal + _APP_C_OFFSET)):
        around = moving_map("bearing", team, target, *(target[:, None] + _RING_M * directions))
        ridges[name] = {"from_north_east_deg": _axis_apart(int(np.argmax(around)), 45.0)}
        ridges[name]["towards_vehicle_2_deg"] = _axis_apart(
            int(np.argmax(around)), float(np.degrees(np.arctan2(*(team[1] - target)[::-1])))
        )
    finite = {
        name: drawn[name][np.isfinite(drawn[name])] for name in ("tdoa", "bearing", "range", "distance")
    }
    north, south = 90, 270
    found = {
        "published": {"source": MAPS["source"], "said": MAPS["said"]},
        "assumed": {"tdoa_pair": TDOA_PAIR, "target": TARGET},
        "tdoa": {
            "least": float(tdoa.min()),
            "least_towards_deg": int(np.argmin(tdoa)),
            "north": float(tdoa[north]),
            "south": float(tdoa[south]),
            "north_is_a_dip": bool(tdoa[north] < min(tdoa[north - 10], tdoa[north + 10])),
            "greatest_towards_deg": sorted(int(k) for k in np.argsort(tdoa)[-4:]),
            "range_free": _range_free(),
        },
        "bearing": {
            "least": float(finite["bearing"].min()),
            "greatest": float(finite["bearing"].max()),
            "published_greatest": MAPS["max_bearing_hdop"],
            "without_it": float(hdop("bearing", team, TARGET)),
            "ridge": ridges,
        },
        "range": {"least": float(finite["range"].min()), "greatest": float(finite["range"].max())},
        "distance": {"greatest_m": float(finite["distance"].max())},
    }
    return found, drawn


def _axis_apart(degrees: float, axis: float) -> float:
    """Angle, degrees in [0, 90], between a direction and an axis (a line, not an arrow)."""
    return float(abs((degrees - axis + 90.0) % 180.0 - 90.0))


def _range_free() -> float:
    """Greatest relative change of TDOA HDOP as the moving sensor goes from 1 to 4 km on bearings of every 7°."""
    angles = np.radians(np.arange(3.0, 360.0, 7.0))
    near, far = (
        moving_map("tdoa", TDOA_PAIR, TARGET, r * np.cos(angles), r * np.sin(angles)) for r in (1e3, 4e3)
    )
    regular = np.isfinite(near)
    if not np.array_equal(regular, np.isfinite(far)):
        return np.inf
    return float(np.max(np.abs(far[regular] / near[regular] - 1.0)))

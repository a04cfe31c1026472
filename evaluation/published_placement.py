"""The published placement experiment (Dillard, NPS 2014, IV.A.4): eight sensors, two starts, two measurements.

Published as figures without numbers. Assumed: the scale (HDOP of ranges does not depend on it, that of bearings is
proportional to it) and how the five tries of a start differ: positions drawn about the nominal ones. A third
part is ours: bearings with a least distance to the target, without which there is no optimum to find.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.hdop import even_spread_hdop, hdop
from evaluation.placement import Placement, largest_gap, least_hdop, place
from evaluation.published_filters import mean_and_error
from evaluation.published_values import PLACEMENT

#: What the source does not say, m: radius of the even start; where the cluster is, east and north of the target; how
#: far a try's sensors stray from the nominal places, even and clustered; the least distance of the third part.
EVEN_RADIUS_M = 1000.0
CLUSTER_M = (200.0, 200.0)
STRAY_M = {"even": 100.0, "clustered": 80.0}
STANDOFF_M = 100.0
#: A sensor nearer than this share of where it began has run at the target.
_ON_TARGET = 0.01
PARTS = (("range", 0.0), ("bearing", 0.0), ("bearing", STANDOFF_M))


def start_of(name: str, draw: np.random.Generator) -> np.ndarray:
    """A try's first places (8, 2), m, about the target at the origin: ``"even"`` or ``"clustered"``."""
    count = PLACEMENT["sensors"]
    if name == "even":
        angles = 2.0 * np.pi * np.arange(count) / count
        nominal = EVEN_RADIUS_M * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    else:
        nominal = np.tile(CLUSTER_M, (count, 1))
    return nominal + draw.normal(0.0, STRAY_M[name], nominal.shape)


def reproduce_placement(seed: int) -> tuple[dict[str, Any], dict[str, list[Placement]]]:
    """The table, and all ways for the figure by ``"kind start standoff"``."""
    count = PLACEMENT["sensors"]
    rows, ways = [], {}
    for kind, standoff in PARTS:
        for name in STRAY_M:
            # The same starts for every part.
            draws = [np.random.default_rng([seed, i]) for i in range(PLACEMENT["tries"])]
            tries = [place(kind, start_of(name, draw), standoff_m=standoff) for draw in draws]
            ways[f"{kind} {name} {standoff:g}"] = tries
            rows.append(
                {
                    "kind": kind, "start": name, "standoff_m": standoff, **_summary(kind, tries),
                    "global": _global(kind, count, standoff),
                    "said": None if standoff else PLACEMENT["said"][kind, name],
                }
            )  # fmt: skip
    found = {
        "tries": PLACEMENT["tries"],
        "published": {"source": PLACEMENT["source"], "sensors": count},
        "assumed": {"even_radius_m": EVEN_RADIUS_M, "cluster_m": CLUSTER_M, "stray_m": STRAY_M},
        "even_bearing_hdop": even_spread_hdop("bearing", count, range_m=EVEN_RADIUS_M),
        "rows": rows,
    }
    return found, ways


def _global(kind: str, count: int, standoff: float) -> float:
    """The least HDOP of any placement: 0, on the target, for bearings that may come as near as they like."""
    if kind == "bearing":
        return even_spread_hdop(kind, count, range_m=standoff) if standoff else 0.0
    return even_spread_hdop(kind, count)


def _summary(kind: str, tries: list[Placement]) -> dict[str, Any]:
    """What the tries of one start came to; arrays have one value a try."""
    origin = np.zeros(2)
    before = np.array([np.hypot(*one.path[0].T) for one in tries])
    after = np.array([np.hypot(*one.sensors.T) for one in tries])
    return {
        "begin": [float(hdop(kind, one.path[0], origin)) for one in tries],
        "end": [one.hdop for one in tries],
        # What the best directions would have given at the ranges of the start and of the end.
        "least_at_first_ranges": [least_hdop(kind, row) for row in before],
        "least_at_last_ranges": [least_hdop(kind, row) for row in after],
        "iterations": [len(one.path) - 1 for one in tries],
        "range_growth": mean_and_error((after / before).mean(axis=1)),
        "farther": float((after > before).mean()),
        "on_target": [
            int((row < _ON_TARGET * first).sum()) for row, first in zip(after, before, strict=True)
        ],
        "largest_gap_deg": [float(np.degrees(largest_gap(one.sensors))) for one in tries],
        "first_gap_deg": [float(np.degrees(largest_gap(one.path[0]))) for one in tries],
        "converged": int(sum(one.converged for one in tries)),
    }

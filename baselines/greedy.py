"""Greedy: the hop, or none, after which free drift brings the vehicle nearest to the goal.

One decision of look-ahead, the classical planner's simplest use of a forecast. For every hop h of a
fan of headings and lengths (and for no hop) the forecast drift from its landing is followed for
``lookahead_h``; of these the hop with the least |h| + d is made, d the least distance to the goal along
that drift, which a straight flight would have to cover. Where no hop is best, the vehicle drifts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import check_range
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step, flight_time, inside_box
from baselines.problem import require_continuous_actions

#: Headings from the goal's direction, and lengths as parts of the longest hop, that are tried.
_HEADINGS, _LENGTHS = 16, 5
#: m; costs that differ by less are equal.
_TIE_M = 1e-3
#: s; integration step of the forecast drift.
_STEP_S = 300.0
#: s; time in hand for the rest of the flight when drifting is given up for it.
_RESERVE_S = 1800.0


class Greedy:
    """Hops so that hop and remaining distance, after the best of ``lookahead_h`` hours' drift, are shortest.

    ``margin_m`` is the clearance that landings and drifts keep. It sees no further than that: it can
    stall in an eddy until its time runs short, and then flies. Seeds of :meth:`reset` change nothing.
    """

    information = "the forecast and all obstacles, its own position and the goal"

    def __init__(self, batch: Any, *, lookahead_h: float = 4.0, margin_m: float = 50.0) -> None:
        require_continuous_actions(batch)
        check_range("lookahead_h", lookahead_h, 0.0, 1000.0)
        check_range("margin_m", margin_m, 0.0, 1e5)
        self.batch = batch
        self.lookahead_s = 3600.0 * lookahead_h
        self.margin_m = float(margin_m)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: the policy has no memory."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, 2): the best hop as a fraction of the longest, 0 to drift."""
        actions = np.zeros((len(worlds), 2), dtype=np.float32)
        _decide(worlds, self.batch.ocean, self.batch.constants, self.lookahead_s, self.margin_m, actions)
        return actions


@kernel
def _open(x, y, obstacle, ocean, c, margin):
    clear = clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y)
    return clear >= margin and inside_box(x, y, c.half_width - margin)


@loop_kernel
def _nearest(x, y, w, ocean, c, now, lookahead, margin):
    """Least distance, m, to the goal on the forecast drift from (x, y), as far as that is safe."""
    least = np.hypot(w.goal_x - x, w.goal_y - y)
    for i in range(int(lookahead / _STEP_S)):
        x, y = drift_step(ocean.velocity, w.forecast, ocean.axes, now + i * _STEP_S, x, y, _STEP_S, c.euler)
        if not _open(x, y, w.obstacle, ocean, c, margin):
            break
        least = min(least, np.hypot(w.goal_x - x, w.goal_y - y))
    return least


@loop_kernel
def _decide(worlds, ocean, c, lookahead, margin, actions):
    for i in range(worlds.size):
        w = worlds[i]
        if w.outcome != 0:
            continue
        now = w.clock_s + w.time_s
        away_x = w.goal_x - w.x
        away_y = w.goal_y - w.y
        away = np.hypot(away_x, away_y)
        time_left = c.horizon - w.time_s - _RESERVE_S - flight_time(away, c.airspeed)
        ahead = max(min(lookahead, time_left), 0.0)
        # Drifting on counts only if it brings the vehicle nearer.
        best = _nearest(w.x, w.y, w, ocean, c, now, ahead, margin)
        best = best if best < away - 1e-6 else np.inf
        hop_x = 0.0
        hop_y = 0.0
        heading = np.arctan2(away_y, away_x)
        for k in range(_HEADINGS):
            angle = heading + k * 2.0 * np.pi / _HEADINGS
            # Of equal hops the longest, found first, stays.
            for length in range(_LENGTHS, 0, -1):
                hop = c.max_hop * length / _LENGTHS
                # The world takes a hop below its threshold for a drift: overshoot instead.
                hop = max(min(hop, away), 1.001 * c.drift_threshold * c.max_hop) if k == 0 else hop
                x = w.x + hop * np.cos(angle)
                y = w.y + hop * np.sin(angle)
                arrives = np.hypot(w.goal_x - x, w.goal_y - y) <= 0.9 * c.goal_radius
                if arrives or _open(x, y, w.obstacle, ocean, c, margin):
                    cost = hop + _nearest(x, y, w, ocean, c, now, ahead, margin)
                    if cost < best - _TIE_M:
                        best = cost
                        hop_x = x - w.x
                        hop_y = y - w.y
        actions[i, 0] = hop_x / c.max_hop
        actions[i, 1] = hop_y / c.max_hop

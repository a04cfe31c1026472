"""Kernels that improve a drift/hop plan locally: move, insert and remove its landings.

A draft is the list of intermediate landings. Between two of them lies one drift and one
flight; how many periods to drift is not searched but chosen on the chain itself, as the
departure from which the next landing is cheapest. The last drift is followed by the flight to the
goal. In a steady current a change touches two drifts only; where the current changes
with time everything after the change is simulated again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.physics.vehicle import drift_step
from baselines.dr_rrt_star_tree import clear, drift_period, flight_clear, last_landing
from baselines.plan import DRIFT, HOP

MAX_LANDINGS = 40
LOOK_AHEAD = 10  # periods that a drift is followed beyond its best departure so far
LEAST_GAIN_WH = 1e-4
FRUITLESS_ROUNDS = 3  # of changes that gain nothing, after which a plan counts as good


class Draft(NamedTuple):
    """Landings of a plan and what holds when each drift begins; row i is the i-th drift, row 0 the start."""

    x: np.ndarray  # where the drift begins: the start or a landing, m
    y: np.ndarray
    time: np.ndarray  # s since the start
    cost: np.ndarray  # Wh so far
    takeoff: np.ndarray  # periods adrift before the flight to the next landing (or to the goal)
    landings: np.ndarray  # (1,) how many: the last row that counts
    total: np.ndarray  # (2,) cost of the whole plan, Wh, and its duration, s

    @staticmethod
    def allocate() -> Draft:
        """Room for the longest draft."""
        rows = MAX_LANDINGS + 1
        return Draft(
            np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(rows), np.zeros(rows, np.int64),
            np.zeros(1, np.int64), np.full(2, np.inf),
        )  # fmt: skip


@loop_kernel
def copy_draft(source, target):
    """Copy ``source`` over ``target``."""
    rows = source.landings[0] + 1
    target.landings[0] = source.landings[0]
    target.total[0] = source.total[0]
    target.total[1] = source.total[1]
    for i in range(rows):
        target.x[i] = source.x[i]
        target.y[i] = source.y[i]
        target.time[i] = source.time[i]
        target.cost[i] = source.cost[i]
        target.takeoff[i] = source.takeoff[i]


@loop_kernel
def _depart(m, draft, i):
    """Choose how long to drift from row ``i``: returns (cost, time) at the next landing or the arrival.

    Looks beyond the departure that the row held before, and writes the one chosen.
    """
    x = draft.x[i]
    y = draft.y[i]
    t = draft.time[i]
    last = i == draft.landings[0]
    best = np.inf
    best_time = np.inf
    look = draft.takeoff[i] + LOOK_AHEAD
    step = 0
    while True:
        if last:
            gx, gy, length = last_landing(m, x, y)
        else:
            gx = draft.x[i + 1]
            gy = draft.y[i + 1]
            length = np.sqrt((gx - x) ** 2 + (gy - y) ** 2)
        cost = draft.cost[i] + m.drift_price * step * m.period + m.wh_per_m * length
        cost += m.hop_price if length > 0.0 else 0.0
        arrival = t + length / m.airspeed
        allowed = length >= m.min_hop or (last and length == 0.0)
        if cost < best and allowed and arrival <= m.horizon and flight_clear(m, x, y, gx, gy):
            best = cost
            best_time = arrival
            draft.takeoff[i] = step
            look = max(look, step + LOOK_AHEAD)
        if step >= look or t + m.period > m.horizon:
            break
        x, y, outcome, done = drift_period(m, t, x, y)
        step += 1
        t = draft.time[i] + step * m.period
        if outcome == 1 and last:
            cost = draft.cost[i] + m.drift_price * step * m.period
            if cost < best:
                best = cost
                best_time = t - m.period * (1.0 - done / m.steps)
                draft.takeoff[i] = step
        if outcome != 0:
            break
    return best, best_time


@loop_kernel
def complete(m, draft, begin, changed, known, bound, steady):
    """Simulate ``draft`` from row ``begin`` on; fills its rows and total, returns the total cost, Wh.

    Rows beyond ``changed`` are the same landings as the last rows of ``known``, so that in a
    ``steady`` current the rest of the plan costs what it cost there. Gives up above ``bound``.
    """
    n = draft.landings[0]
    shift = known.landings[0] - n
    for i in range(begin, n + 1):
        cost, time = _depart(m, draft, i)
        if not cost < bound:
            draft.total[0] = np.inf
            return np.inf
        if i == n:
            draft.total[0] = cost
            draft.total[1] = time
            return cost
        draft.cost[i + 1] = cost
        draft.time[i + 1] = time
        if steady and i + 1 > changed:
            later = time - known.time[i + 1 + shift]
            cost += known.total[0] - known.cost[i + 1 + shift]
            duration = known.total[1] + later
            if not (cost < bound and duration <= m.horizon):
                draft.total[0] = np.inf
                return np.inf
            for j in range(i + 1, n + 1):
                draft.time[j] = known.time[j + shift] + later
                draft.cost[j] = known.cost[j + shift] + cost - known.total[0]
                draft.takeoff[j] = known.takeoff[j + shift]
            draft.total[0] = cost
            draft.total[1] = duration
            return cost
    return np.inf


@loop_kernel
def _search_landing(m, best, trial, row, step, least_step, steady, budget):
    """Pattern search on one landing of ``best``; returns the evaluations left."""
    copy_draft(best, trial)
    while step >= least_step and budget > 0:
        moved = False
        for direction in range(8):
            angle = direction * np.pi / 4.0
            dx = step * np.cos(angle)
            dy = step * np.sin(angle)
            while budget > 0:
                trial.x[row] = best.x[row] + dx
                trial.y[row] = best.y[row] + dy
                if not clear(m, trial.x[row], trial.y[row]):
                    break
                budget -= 1
                total = complete(m, trial, row - 1, row, best, best.total[0] - LEAST_GAIN_WH, steady)
                if not total < best.total[0]:
                    break
                copy_draft(trial, best)
                moved = True
            copy_draft(best, trial)
        if not moved:
            step *= 0.5
    return budget


@loop_kernel
def _search_all(m, best, trial, step, least_step, steady, budget):
    """Sweep the pattern search over all landings until a sweep gains nothing."""
    while budget > 0:
        before = best.total[0]
        for row in range(1, best.landings[0] + 1):
            budget = _search_landing(m, best, trial, row, step, least_step, steady, budget)
        if best.total[0] > before - 10.0 * LEAST_GAIN_WH:
            break
        step = max(0.5 * step, least_step)
    return budget


@loop_kernel
def _insert(draft, row, x, y):
    """Put a landing (x, y) before row ``row``."""
    for j in range(draft.landings[0], row - 1, -1):
        draft.x[j + 1] = draft.x[j]
        draft.y[j + 1] = draft.y[j]
        draft.takeoff[j + 1] = draft.takeoff[j]
    draft.landings[0] += 1
    draft.x[row] = x
    draft.y[row] = y
    draft.takeoff[row] = 0


@loop_kernel
def _remove(draft, row):
    """Take landing ``row`` out."""
    for j in range(row, draft.landings[0]):
        draft.x[j] = draft.x[j + 1]
        draft.y[j] = draft.y[j + 1]
        draft.takeoff[j] = draft.takeoff[j + 1]
    draft.landings[0] -= 1


@loop_kernel
def _departure(m, draft, row):
    """Where the flight after drift ``row`` takes off, and where it lands: (x0, y0, x1, y1)."""
    x = draft.x[row]
    y = draft.y[row]
    for step in range(draft.takeoff[row]):
        x, y, _, _ = drift_period(m, draft.time[row] + step * m.period, x, y)
    if row < draft.landings[0]:
        return x, y, draft.x[row + 1], draft.y[row + 1]
    gx, gy, _ = last_landing(m, x, y)
    return x, y, gx, gy


@loop_kernel
def _restructure(m, best, trial, other, step, least_step, steady, budget, state):
    """Try to split every flight by a drift and to leave out every landing; returns the evaluations left."""
    row = 0
    while row <= best.landings[0] and best.landings[0] < MAX_LANDINGS and budget > 0:
        x0, y0, x1, y1 = _departure(m, best, row)
        length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
        if length >= 2.0 * m.min_hop:
            share = 0.2 + 0.6 * uniform(state)
            aside = 0.2 * normal(state)
            copy_draft(best, other)
            x = x0 + share * (x1 - x0) - aside * (y1 - y0)
            y = y0 + share * (y1 - y0) + aside * (x1 - x0)
            if clear(m, x, y):
                _insert(other, row + 1, x, y)
                budget -= 1
                # The split alone need not pay: give its landing a search before judging it.
                if np.isfinite(complete(m, other, row, row + 1, best, np.inf, steady)):
                    budget = _search_landing(m, other, trial, row + 1, step, 4.0 * least_step, steady, budget)
                    if other.total[0] < best.total[0] - 10.0 * LEAST_GAIN_WH:
                        copy_draft(other, best)
        row += 1
    row = 1
    while row <= best.landings[0] and budget > 0:
        copy_draft(best, other)
        _remove(other, row)
        budget -= 1
        if complete(m, other, row - 1, row - 1, best, best.total[0], steady) < best.total[0]:
            copy_draft(other, best)
        else:
            row += 1
    return budget


@loop_kernel
def improve(m, best, trial, other, steady, budget, state):
    """Improve ``best`` with at most about ``budget`` simulated changes drawn from ``state``."""
    widest = 0.5 * m.max_hop
    finest = widest / 64.0
    budget = _search_all(m, best, trial, widest, finest, steady, budget)
    fruitless = 0
    while budget > 0 and fruitless < FRUITLESS_ROUNDS:
        before = best.total[0]
        budget = _restructure(m, best, trial, other, 0.5 * widest, finest, steady, budget, state)
        if best.total[0] < before:
            budget = _search_all(m, best, trial, 0.25 * widest, finest, steady, budget)
        fruitless = 0 if best.total[0] < before - 10.0 * LEAST_GAIN_WH else fruitless + 1
    return best.total[0]


@loop_kernel
def draft_from_tree(tree, m, node, draft):
    """Make ``draft`` of the landings that lead to ``node``, simulated; returns its cost, Wh."""
    n = 0
    at = node
    while tree.parent[at] >= 0:
        at = tree.parent[at]
        n += 1
    if n > MAX_LANDINGS:
        draft.total[0] = np.inf
        return np.inf
    draft.landings[0] = n
    at = node
    takeoff = tree.arrival_takeoff[node]
    for row in range(n, -1, -1):
        draft.x[row] = tree.x[tree.first[at]]
        draft.y[row] = tree.y[tree.first[at]]
        draft.takeoff[row] = takeoff
        takeoff = tree.takeoff[at]
        at = tree.parent[at]
    draft.time[0] = 0.0
    draft.cost[0] = 0.0
    return complete(m, draft, 0, n + 1, draft, np.inf, False)


@loop_kernel
def draft_legs(m, draft, legs, track):
    """Write the legs and the track (t, x, y) of a draft; returns (legs, track points, distance flown, m)."""
    n = 0
    points = 1
    flown = 0.0
    t = 0.0
    x = draft.x[0]
    y = draft.y[0]
    track[0] = t, x, y
    dt = m.period / m.steps
    for row in range(draft.landings[0] + 1):
        if draft.takeoff[row] > 0:
            legs[n]["kind"] = DRIFT
            legs[n]["x0"] = x
            legs[n]["y0"] = y
            legs[n]["t0"] = t
            begin = t
            for step in range(draft.takeoff[row] * m.steps):
                x, y = drift_step(m.velocity, m.field, m.axes, m.time + t, x, y, dt, m.euler)
                t = begin + (step + 1) * dt
                track[points] = t, x, y
                points += 1
                if (m.goal_x - x) ** 2 + (m.goal_y - y) ** 2 <= m.goal_radius**2:
                    break
            legs[n]["x1"] = x
            legs[n]["y1"] = y
            legs[n]["t1"] = t
            n += 1
        gx, gy, length = last_landing(m, x, y)
        if row < draft.landings[0]:
            gx = draft.x[row + 1]
            gy = draft.y[row + 1]
            length = np.sqrt((gx - x) ** 2 + (gy - y) ** 2)
        elif length == 0.0:
            break
        legs[n]["kind"] = HOP
        legs[n]["x0"] = x
        legs[n]["y0"] = y
        legs[n]["t0"] = t
        t += length / m.airspeed
        flown += length
        x = gx
        y = gy
        legs[n]["x1"] = x
        legs[n]["y1"] = y
        legs[n]["t1"] = t
        n += 1
        track[points] = t, x, y
        points += 1
    return n, points, flown


@loop_kernel
def improve_candidates(tree, m, nodes, draft, trial, other, best, steady, candidates, budget, state):
    """Improve the ``candidates`` most promising plans of the tree a little and the best of them well."""
    apart = 0.1 * m.half_width
    chosen = np.empty(candidates, np.int64)
    n = 0
    best.total[0] = np.inf
    order = np.argsort(tree.arrival[:nodes])
    for node in order:
        if n == candidates or not np.isfinite(tree.arrival[node]):
            break
        near = False
        for i in range(n):
            dx = tree.x[tree.first[node]] - tree.x[tree.first[chosen[i]]]
            dy = tree.y[tree.first[node]] - tree.y[tree.first[chosen[i]]]
            near = near or (dx * dx + dy * dy < apart * apart)
        if near:
            continue
        chosen[n] = node
        n += 1
        if np.isfinite(draft_from_tree(tree, m, node, draft)):
            improve(m, draft, trial, other, steady, budget // (2 * candidates), state)
            if draft.total[0] < best.total[0]:
                copy_draft(draft, best)
    if np.isfinite(best.total[0]):
        improve(m, best, trial, other, steady, budget // 2, state)
    return best.total[0]

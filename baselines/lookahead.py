"""Kernels that act on a drift/hop value function: one-step look-ahead with the world's own dynamics.

Drift as long as the drift ahead, simulated to the end of the mission, holds a place from which the
rest is cheaper than every hop now; else hop to the best landing place, refined off the grid by the
same simulation. Costs are m of flight.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import flight_time
from baselines.value_function import (
    GOAL,
    NOWHERE,
    Chart,
    Sea,
    best_flight,
    crosses_goal,
    drift_for,
    drifts_on,
    meet,
    open_water,
)

#: Aim inside the goal disc by this share of its radius.
_INSIDE = 0.01
#: Landings keep this far from edges and obstacles, m.
_SPARE_M = 0.5
#: Pattern search for a landing place: halvings of the grid spacing, and moves tried at each.
_LEVELS, _MOVES = 4, 3


@kernel
def best_drift(sea, values, landings, floats, k, chart, x, y, t, period, periods, pieces):
    """Least cost of drifting 1 ... ``periods`` periods and then flying, and that number of periods (0: none)."""
    best = np.inf
    wait = 0
    piece = period / pieces
    for i in range(1, periods + 1):
        price = chart.price * period * i
        if price >= best:
            break
        for j in range(pieces):
            x0, y0 = x, y
            start = t + (i - 1) * period + j * piece
            x, y, safe = drift_for(sea, x, y, start, piece)
            if crosses_goal(chart, x0, y0, x, y) and start + piece <= chart.end:
                if price < best:
                    best = price
                    wait = i
                return best, wait
            if not safe:
                return best, wait
        cost, _ = best_flight(values, landings, floats, k, chart, x, y, t + i * period)
        if cost + price < best:
            best = cost + price
            wait = i
    return best, wait


@kernel
def value_at(sea, values, landings, floats, k, chart, x, y, t, period, periods, pieces):
    """V at any place and time: the better of flying at once and of drifting first; inf outside open water."""
    if not open_water(sea, x, y):
        return np.inf
    fly, _ = best_flight(values, landings, floats, k, chart, x, y, t)
    drift, _ = best_drift(sea, values, landings, floats, k, chart, x, y, t, period, periods, pieces)
    return min(fly, drift)


@kernel
def values_at(sea, values, landings, floats, k, chart, x, y, t, period, horizon, out):
    """:func:`value_at` of many places and times."""
    for i in range(x.size):
        periods = max(int((horizon - t[i]) / period + 1e-9), 0)
        out[i] = value_at(sea, values, landings, floats, k, chart, x[i], y[i], t[i], period, periods, 2)


@kernel
def follow(sea, values, landings, floats, k, chart, x, y, t, period, periods):
    """Follow the plan from (x, y) at ``t``: metres flown and time of arrival, both inf without one."""
    flown = 0.0
    for _ in range(1000):
        fly, landing = best_flight(values, landings, floats, k, chart, x, y, t)
        drift, wait = best_drift(sea, values, landings, floats, k, chart, x, y, t, period, periods, 2)
        if fly == np.inf and drift == np.inf:
            break
        if drift <= fly + 0.01:
            for _ in range(2 * wait):
                x0, y0 = x, y
                x, y, _ = drift_for(sea, x, y, t, 0.5 * period)
                t += 0.5 * period
                if crosses_goal(chart, x0, y0, x, y):
                    return flown, t
            continue
        if landing == GOAL:
            distance = max(
                np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2) - chart.goal_radius, 0.0
            )
            return flown + distance, t + flight_time(distance, chart.airspeed)
        zx, zy, _ = meet(values, floats, k, landing, chart, x, y, t)
        distance = np.sqrt((zx - x) ** 2 + (zy - y) ** 2)
        flown += distance
        t += flight_time(distance, chart.airspeed)
        x, y = zx, zy
    return np.inf, np.inf


@kernel
def _safe_landing(sea, x, y):
    """Open water with a little to spare, for actions are rounded to single precision."""
    edge = sea.half_width - _SPARE_M
    clear = clearance_at(sea.clearance, sea.layer, sea.clearance_grid, x, y)
    return max(abs(x), abs(y)) <= edge and clear >= _SPARE_M


@kernel
def _nudged(sea, x, y):
    """(x, y), or a safe landing place a few metres away where that lies on an edge."""
    if not _safe_landing(sea, x, y):
        for i in range(8):
            nx = x + 3.0 * _SPARE_M * np.cos(i * np.pi / 4)
            ny = y + 3.0 * _SPARE_M * np.sin(i * np.pi / 4)
            if _safe_landing(sea, nx, ny):
                return nx, ny
    return x, y


@kernel
def _cost_of_landing(sea, values, landings, floats, k, chart, x, y, t, zx, zy, min_hop, period, periods):
    """Cost of flying from (x, y) to (zx, zy) and drifting on from there; inf for a hop that is too short."""
    distance = np.sqrt((zx - x) ** 2 + (zy - y) ** 2)
    if distance < min_hop or not _safe_landing(sea, zx, zy):
        return np.inf, 0
    arrival = t + flight_time(distance, chart.airspeed)
    cost, wait = best_drift(sea, values, landings, floats, k, chart, zx, zy, arrival, period, periods, 2)
    return distance + cost, wait


@kernel
def refine_landing(sea, values, landings, floats, k, chart, x, y, t, zx, zy, min_hop, period, periods):
    """Pattern search for the landing place of least cost about (zx, zy): the place and its cost."""
    distance = np.sqrt((zx - x) ** 2 + (zy - y) ** 2)
    best = np.inf
    wait = periods
    if distance < min_hop:
        # The landing place is too near: search the circle of shortest hops.
        for i in range(16):
            cx = x + 1.001 * min_hop * np.cos(i * np.pi / 8)
            cy = y + 1.001 * min_hop * np.sin(i * np.pi / 8)
            cost, w = _cost_of_landing(
                sea, values, landings, floats, k, chart, x, y, t, cx, cy, min_hop, period, periods
            )
            if cost < best:
                best, wait, zx, zy = cost, w, cx, cy
    else:
        best, wait = _cost_of_landing(
            sea, values, landings, floats, k, chart, x, y, t, zx, zy, min_hop, period, periods
        )
        wait = wait if best < np.inf else periods
    step = chart.grid.spacing
    for _ in range(_LEVELS):
        step *= 0.5
        for _ in range(_MOVES):
            moved = False
            ox, oy = zx, zy
            for i in range(8):
                cx = ox + step * np.cos(i * np.pi / 4)
                cy = oy + step * np.sin(i * np.pi / 4)
                cost, w = _cost_of_landing(
                    sea,
                    values,
                    landings,
                    floats,
                    k,
                    chart,
                    x,
                    y,
                    t,
                    cx,
                    cy,
                    min_hop,
                    period,
                    min(wait + 3, periods),
                )
                if cost < best:
                    best, wait, zx, zy = cost, w, cx, cy
                    moved = True
            if not moved:
                break
    return zx, zy, best


@kernel
def _hop_along(sea, chart, x, y, zx, zy, min_hop, shortest, longest, out):
    """Write a hop towards (zx, zy) that lands in open water; ``shortest`` ... ``longest`` m end the flight.

    A flight longer than one hop is split evenly, so that its last hop is not too short to fly.
    Returns whether there is such a hop.
    """
    distance = np.sqrt((zx - x) ** 2 + (zy - y) ** 2)
    ux, uy = (zx - x) / distance, (zy - y) / distance
    tries = 40
    if longest >= min_hop and shortest <= chart.max_hop:
        for i in range(tries + 1):
            length = shortest + (longest - shortest) * i / tries
            if min_hop <= length <= chart.max_hop and _safe_landing(sea, x + length * ux, y + length * uy):
                out[0], out[1] = length * ux / chart.max_hop, length * uy / chart.max_hop
                return True
    even = shortest / max(np.ceil(shortest / chart.max_hop), 1.0)
    for i in range(tries + 2):
        # First the even split, then the farthest free landing place on the way.
        length = even if i == 0 else chart.max_hop - (chart.max_hop - min_hop) * (i - 1) / tries
        fits = min_hop <= length <= longest and (i == 0 or shortest - length >= min_hop)
        if fits and _safe_landing(sea, x + length * ux, y + length * uy):
            out[0], out[1] = length * ux / chart.max_hop, length * uy / chart.max_hop
            return True
    return False


@kernel
def _hop_anywhere(sea, values, landings, floats, k, chart, x, y, t, min_hop, late, out):
    """The hop, of 32 headings and 4 lengths, cheapest to go on from; by distance where V is inf or it is late."""
    best = np.inf
    for i in range(128):
        length = min_hop + (chart.max_hop - min_hop) * (i % 4) / 3.0
        dx = length * np.cos((i // 4) * np.pi / 16)
        dy = length * np.sin((i // 4) * np.pi / 16)
        if not _safe_landing(sea, x + dx, y + dy):
            continue
        arrival = t + flight_time(length, chart.airspeed)
        cost, _ = best_flight(values, landings, floats, k, chart, x + dx, y + dy, arrival)
        if late or cost == np.inf:
            cost = 1e9 + np.sqrt((x + dx - chart.goal_x) ** 2 + (y + dy - chart.goal_y) ** 2)
        if length + cost < best:
            best = length + cost
            out[0], out[1] = dx / chart.max_hop, dy / chart.max_hop


@kernel
def decide(sea, values, landings, floats, k, chart, x, y, t, period, sub_steps, horizon, min_hop, out):
    """Write the decision at (x, y) and mission time ``t`` into ``out``: (0, 0) to drift, else the hop."""
    out[:] = 0.0
    to_goal = np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2)
    near = max(to_goal - (1.0 - _INSIDE) * chart.goal_radius, min_hop)
    far = to_goal + (1.0 - _INSIDE) * chart.goal_radius
    periods = max(int((horizon - t) / period + 1e-9), 0)
    fly, landing = best_flight(values, landings, floats, k, chart, x, y, t)
    drift, wait = best_drift(sea, values, landings, floats, k, chart, x, y, t, period, periods, sub_steps)
    # With the deadline at hand no more drifting: a steady value function knows of no deadline.
    late = horizon - t < flight_time(to_goal, chart.airspeed) + 2.0 * period
    if late and wait != 1:
        drift, landing = np.inf, GOAL
    if drift <= fly and drift < np.inf:
        return
    zx, zy = chart.goal_x, chart.goal_y
    if landing >= 0:
        zx, zy, _ = meet(values, floats, k, landing, chart, x, y, t)
        zx, zy = _nudged(sea, zx, zy)
        if drifts_on(values, landings, floats, k, landing):
            zx, zy, cost = refine_landing(
                sea, values, landings, floats, k, chart, x, y, t, zx, zy, min_hop, period, periods
            )
            if drift <= cost and drift < np.inf:
                return
        near = far = np.sqrt((zx - x) ** 2 + (zy - y) ** 2)
    elif drift < near or (landing == NOWHERE and drift < np.inf):
        return
    if far < 1e-6 or not _hop_along(sea, chart, x, y, zx, zy, min_hop, near, far, out):
        _hop_anywhere(sea, values, landings, floats, k, chart, x, y, t, min_hop, late, out)


@kernel
def decide_all(worlds, fields, slots, values, landings, floats, scalars, ocean, vehicle, actions):
    """Decide for every running world; ``slots`` says which value function is a world's own.

    ``scalars``: a Chart (its goal is not read); ``vehicle``: (half width, period, sub-steps, horizon,
    shortest hop, euler).
    """
    half_width, period, sub_steps, horizon, min_hop, euler = vehicle
    for i in range(worlds.size):
        w = worlds[i]
        actions[i] = 0.0
        if w.outcome != 0:
            continue
        step = period / sub_steps
        sea = Sea(
            ocean.velocity, fields[i], ocean.axes, ocean.clearance, w.obstacle, ocean.clearance_grid,
            half_width, w.clock_s, euler, step, step,
        )  # fmt: skip
        chart = Chart(
            scalars.grid, w.goal_x, w.goal_y, scalars.goal_radius, scalars.max_hop, scalars.airspeed,
            scalars.time_step, scalars.end, scalars.price,
        )  # fmt: skip
        decide(
            sea, values, landings, floats, slots[i], chart, w.x, w.y, w.time_s, period, sub_steps, horizon, min_hop,
            actions[i],
        )  # fmt: skip

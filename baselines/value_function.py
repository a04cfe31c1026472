"""Kernels of the drift/hop value function on a grid (see ``docs/optimal.md``).

V(x, t) is the least flight distance, m, that brings the vehicle from (x, t) into the goal disc. The
kernels never interpolate V in a cell: a node keeps the *landing place* of its best flight (a node,
or the goal itself), and a point between nodes flies to the best of its four corners' landing
places. A value in the table is therefore the cost of a plan that exists, approached from above
as the grid is refined, and kinks of V (where two routes tie) are not smeared.

Times in these kernels count from the start of the value function, s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.grids import Grid, locate
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.vehicle import drift_step, flight_time, inside_box

#: A landing place is the goal disc (-1), none known (-2), a node (row << 15 | column) or a float (FLOAT + i).
GOAL, NOWHERE, FLOAT = -1, -2, 1 << 30


class Sea(NamedTuple):
    """What drifting needs: one current field, one obstacle layer and the box, of their stacks."""

    velocity: np.ndarray  # (fields, frames, rows, columns, 2), m/s
    field: int
    axes: tuple
    clearance: np.ndarray  # (layers, rows, columns), m
    layer: int
    clearance_grid: Grid
    half_width: float  # m
    time0: float  # s, field time at the start of the value function
    euler: bool  # integrator of the world
    fine_step: float  # s, the world's integration step
    longest_step: float  # s, taken far from obstacles and edges


class Chart(NamedTuple):
    """Scalars of one value function."""

    grid: Grid  # nodes of the value function
    goal_x: float  # m
    goal_y: float
    goal_radius: float
    max_hop: float
    airspeed: float  # m/s
    time_step: float  # s between slices
    end: float  # s; arrival after this does not count (inf: no limit)
    price: float  # m of flight that a second of drift costs, to break ties


class Tables(NamedTuple):
    """Stacks of value functions, the leading axis k counting them.

    Steady fields have one frame and no floats. In fields that change with time ``floats`` drift from
    slice to slice and serve as landing places that need no interpolation.
    """

    values: np.ndarray  # float32 (k, frames, rows, columns): V at the nodes, m
    landings: np.ndarray  # int32, same shape: landing place of the best flight
    floats: np.ndarray  # float32 (k, frames, floats, 3): x, y, m, and V of a float that drifts on (inf: none)


@kernel
def pack(row, column):
    """A node as one number, as the tables of landing places (int32) hold it."""
    return (row << 15) | column


@kernel
def open_water(sea, x, y):
    """Whether (x, y) is in the box and outside obstacles."""
    return inside_box(x, y, sea.half_width) and (
        clearance_at(sea.clearance, sea.layer, sea.clearance_grid, x, y) >= 0.0
    )


@kernel
def blocked_nodes(sea, grid, blocked):
    """Mark the nodes (rows, columns) that are not open water; returns whether there are any."""
    found = False
    for row in range(blocked.shape[0]):
        for column in range(blocked.shape[1]):
            x, y = grid.x0 + grid.spacing * column, grid.y0 + grid.spacing * row
            blocked[row, column] = not open_water(sea, x, y)
            found = found or blocked[row, column]
    return found


@kernel
def drift_for(sea, x, y, t, duration):
    """Drift for ``duration`` s: the new place and whether the way there stayed in open water.

    Steps of ``sea.longest_step``, and of ``sea.fine_step`` where an obstacle or the edge is within reach,
    so that each is noticed as the world notices it.
    """
    done = 0.0
    while done < duration - 1e-6:
        u, v = current_at(sea.velocity, sea.field, sea.axes, sea.time0 + t + done, x, y)
        reach = 2.0 * sea.longest_step * np.sqrt(u * u + v * v) + 1.0
        near = clearance_at(sea.clearance, sea.layer, sea.clearance_grid, x, y) < reach
        near = near or max(abs(x), abs(y)) > sea.half_width - reach
        dt = min(sea.fine_step if near else sea.longest_step, duration - done)
        x, y = drift_step(sea.velocity, sea.field, sea.axes, sea.time0 + t + done, x, y, dt, sea.euler)
        if near and not open_water(sea, x, y):
            return x, y, False
        done += dt
    return x, y, True


@kernel
def meet(values, floats, k, landing, chart, x, y, t):
    """Where a flight that leaves (x, y) at ``t`` meets its landing place (a node or float): (x, y, V there).

    V is inf where there is nothing to meet. A float moves while the vehicle flies to it, and keeps its
    V until it is left, at the end of its slice or later.
    """
    frames = values.shape[1]
    row, column = (landing >> 15) & 0x7FFF, landing & 0x7FFF
    i = landing - FLOAT
    zx = chart.grid.x0 + chart.grid.spacing * column
    zy = chart.grid.y0 + chart.grid.spacing * row
    if frames == 1:
        return zx, zy, np.float64(values[k, 0, row, column])
    arrival = t
    for attempt in range(2):
        if attempt == 1 or landing < FLOAT:
            arrival = t + flight_time(np.sqrt((zx - x) ** 2 + (zy - y) ** 2), chart.airspeed)
        if arrival > chart.time_step * (frames - 1) + 1e-6:
            return zx, zy, np.inf
        # Rounding must not look into the slice before, which a backward sweep has not filled yet.
        frame = min(int(arrival / chart.time_step + 1e-6), frames - 1)
        f = max(arrival / chart.time_step - frame, 0.0)
        if landing < FLOAT:
            value = np.float64(values[k, frame, row, column])
            if f > 0.0:
                # An infinite neighbour makes the result infinite: never optimistic about a deadline.
                value = (1.0 - f) * value + f * values[k, frame + 1, row, column]
            return zx, zy, value
        worth = np.float64(floats[k, frame, i, 2])
        if worth == np.inf:
            return zx, zy, np.inf
        zx, zy = np.float64(floats[k, frame, i, 0]), np.float64(floats[k, frame, i, 1])
        zx += f * (floats[k, frame + 1, i, 0] - zx)
        zy += f * (floats[k, frame + 1, i, 1] - zy)
    return zx, zy, worth


@kernel
def _value_with_deadline(values, floats, k, landing, chart, x, y, t):
    if landing == GOAL:
        distance = max(np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2) - chart.goal_radius, 0.0)
        return distance if t + flight_time(distance, chart.airspeed) <= chart.end else np.inf
    zx, zy, value = meet(values, floats, k, landing, chart, x, y, t)
    return np.sqrt((zx - x) ** 2 + (zy - y) ** 2) + value


@kernel
def value_without_deadline(frame_values, landing, chart, x, y):
    """:func:`value_of_flight` in a steady field, which knows neither deadline nor floats (short, to be inlined)."""
    if landing == GOAL:
        dx, dy = chart.goal_x - x, chart.goal_y - y
        return max(np.sqrt(dx * dx + dy * dy) - chart.goal_radius, 0.0)
    row, column = landing >> 15, landing & 0x7FFF
    dx = chart.grid.x0 + chart.grid.spacing * column - x
    dy = chart.grid.y0 + chart.grid.spacing * row - y
    return np.sqrt(dx * dx + dy * dy) + frame_values[row, column]


@kernel
def value_of_flight(values, floats, k, landing, chart, x, y, t):
    """Cost, m, of flying at time ``t`` from (x, y) to ``landing`` and going on from there."""
    if landing == NOWHERE:
        return np.inf
    if values.shape[1] > 1:
        return _value_with_deadline(values, floats, k, landing, chart, x, y, t)
    return value_without_deadline(values[k, 0], landing, chart, x, y)


@kernel
def cell_of(grid, rows, columns, x, y):
    """Lower-left node (row, column) of the cell that holds (x, y), and the fractions (fx, fy) in it."""
    column, fx = locate(grid.x0, grid.spacing, columns, x)
    row, fy = locate(grid.y0, grid.spacing, rows, y)
    return np.int64(row), np.int64(column), fx, fy


@kernel
def drifts_on(values, landings, floats, k, landing):
    """Whether the plan drifts from a landing place (a node or a float) on, and does not fly on at once."""
    if landing >= FLOAT or values.shape[1] > 1:
        return landing >= FLOAT
    return landings[k, 0, landing >> 15, landing & 0x7FFF] == landing


@kernel
def best_flight(values, landings, floats, k, chart, x, y, t):
    """Least cost of a flight from (x, y) at ``t`` and its landing place, over the four corners' own."""
    _, frames, rows, columns = values.shape
    row, column, _, _ = cell_of(chart.grid, rows, columns, x, y)
    first = last = 0
    if frames > 1:
        # Between two slices the landing places of both are looked at: one's float may have ended.
        first = min(int(t / chart.time_step + 1e-6), frames - 1)
        last = first if t < chart.time_step * first + 1e-3 else min(first + 1, frames - 1)
    best = np.inf
    chosen = NOWHERE
    for frame in range(first, last + 1):
        for corner in range(4):
            landing = landings[k, frame, row + corner // 2, column + corner % 2]
            if landing != chosen:
                cost = value_of_flight(values, floats, k, landing, chart, x, y, t)
                if cost < best:
                    best = cost
                    chosen = landing
    return best, chosen


@kernel
def can_fly(sea, max_hop, x0, y0, x1, y1):
    """Whether hops of at most ``max_hop`` carry the vehicle straight to (x1, y1): no longer stretch is blocked.

    Walks the line by the clearance, so open water costs little.
    """
    dx, dy = x1 - x0, y1 - y0
    length = np.sqrt(dx * dx + dy * dy)
    if length <= max_hop:
        return True
    least = 0.25 * sea.clearance_grid.spacing
    walked = 0.0
    blocked = 0.0
    while walked < length:
        x, y = x0 + dx * walked / length, y0 + dy * walked / length
        clear = clearance_at(sea.clearance, sea.layer, sea.clearance_grid, x, y)
        step = max(abs(clear), least)
        blocked = blocked + step if clear < 0.0 else 0.0
        if blocked > max_hop:
            return False
        walked += step
    return True


@kernel
def _can_reach(sea, values, floats, k, landing, chart, x, y, t):
    if landing == GOAL:
        return can_fly(sea, chart.max_hop, x, y, chart.goal_x, chart.goal_y)
    zx, zy, _ = meet(values, floats, k, landing, chart, x, y, t)
    return can_fly(sea, chart.max_hop, x, y, zx, zy)


@kernel
def offer(sea, values, landings, floats, k, frame, chart, any_blocked, row, column, landing, t):
    """Take ``landing`` for a node if it is cheaper and can be flown to."""
    x = chart.grid.x0 + chart.grid.spacing * column
    y = chart.grid.y0 + chart.grid.spacing * row
    cost = value_of_flight(values, floats, k, landing, chart, x, y, t)
    if cost < values[k, frame, row, column] - 1e-3:
        if any_blocked and not _can_reach(sea, values, floats, k, landing, chart, x, y, t):
            return
        values[k, frame, row, column] = cost
        landings[k, frame, row, column] = landing


@kernel
def spread_flights(sea, values, landings, floats, k, frame, chart, blocked, any_blocked, rounds):
    """Propagate landing places from node to node until ``rounds`` sweeps in four directions are done.

    A flight may pass over an obstacle, but lands in open water every ``max_hop`` at the latest. Nodes in
    obstacles only pass landing places on; they are none themselves (their value is not V).
    """
    V, L = values[k, frame], landings[k, frame]
    rows, columns = V.shape
    t = frame * chart.time_step
    size = chart.grid.spacing
    for sweep in range(4 * rounds):
        up = 1 if sweep % 4 < 2 else -1
        right = 1 if sweep % 2 == 0 else -1
        for i in range(rows):
            row = i if up == 1 else rows - 1 - i
            y = chart.grid.y0 + size * row
            for j in range(columns):
                column = j if right == 1 else columns - 1 - j
                x = chart.grid.x0 + size * column
                own = L[row, column]
                best = np.float64(V[row, column])
                if sweep == 0 and own >= 0 and own != pack(row, column):
                    # The landing place may have become cheaper since it was chosen.
                    best = min(value_of_flight(values, floats, k, own, chart, x, y, t), best)
                for n in range(4):
                    # The row already swept (three neighbours) and the node just swept.
                    r = row if n == 3 else row - up
                    c = column - right if n == 3 else column + n - 1
                    if r < 0 or r >= rows or c < 0 or c >= columns:
                        continue
                    landing = L[r, c]
                    apart = size if n == 1 or n == 3 else np.sqrt(2.0) * size
                    if landing == NOWHERE or V[r, c] - apart > best:
                        continue
                    if landing != own:
                        cost = value_of_flight(values, floats, k, landing, chart, x, y, t)
                        if cost < best - 1e-3 and (
                            not any_blocked or _can_reach(sea, values, floats, k, landing, chart, x, y, t)
                        ):
                            best, own = cost, landing
                    if any_blocked and not blocked[r, c] and V[r, c] + apart < best - 1e-3:
                        # Round a corner: land at the neighbour and fly on from there.
                        best, own = V[r, c] + apart, pack(r, c)
                V[row, column] = best
                L[row, column] = own


@kernel
def seed_goal(sea, values, landings, floats, k, frame, chart, blocked, t):
    """Nodes within one hop of the goal fly to it directly."""
    for row in range(values.shape[2]):
        for column in range(values.shape[3]):
            x = chart.grid.x0 + chart.grid.spacing * column
            y = chart.grid.y0 + chart.grid.spacing * row
            distance = np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2)
            if distance <= chart.max_hop and not blocked[row, column]:
                offer(sea, values, landings, floats, k, frame, chart, False, row, column, GOAL, t)


@kernel
def crosses_goal(chart, x0, y0, x1, y1):
    """Whether the straight piece from (x0, y0) to (x1, y1) touches the goal disc."""
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    along = 0.0
    if length2 > 0.0:
        along = min(max(((chart.goal_x - x0) * dx + (chart.goal_y - y0) * dy) / length2, 0.0), 1.0)
    gap_x = x0 + along * dx - chart.goal_x
    gap_y = y0 + along * dy - chart.goal_y
    return gap_x * gap_x + gap_y * gap_y <= chart.goal_radius * chart.goal_radius

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

#: Landing place of a node: the goal disc itself, or none known.
GOAL, NOWHERE = -1, -2


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


@kernel
def pack(row, column):
    """A node as one number, as the tables of landing places (int32) hold it."""
    return (row << 16) | column


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
def block_of(sea, x, y):
    """The bit that stands for the part of the box (8 × 8 parts) that holds (x, y)."""
    size = 0.25 * sea.half_width
    i = min(max(int((x + sea.half_width) / size), 0), 7)
    j = min(max(int((y + sea.half_width) / size), 0), 7)
    return np.uint64(1) << np.uint64(8 * j + i)


@kernel
def changed_blocks(sea, grid, before, after, k):
    """Blocks in reach of a node whose value fell from ``before`` to ``after[k, 0]`` (both float32)."""
    blocks = np.uint64(0)
    for row in range(before.shape[0]):
        for column in range(before.shape[1]):
            if after[k, 0, row, column] != before[row, column]:
                x = grid.x0 + grid.spacing * column
                y = grid.y0 + grid.spacing * row
                for corner in range(4):
                    dx = grid.spacing * (2 * (corner % 2) - 1)
                    dy = grid.spacing * (2 * (corner // 2) - 1)
                    blocks |= block_of(sea, x + dx, y + dy)
                before[row, column] = after[k, 0, row, column]
    return blocks


@kernel
def drift_paths(sea, grid, sample_s, paths, counts, visits):
    """Drift from every node through a steady field.

    ``paths`` (rows, columns, samples, 2) receives the places every ``sample_s``, ``counts`` how many
    of them there are before an obstacle, the edge, or still water, ``visits`` the blocks they lie in.
    """
    for row in range(paths.shape[0]):
        for column in range(paths.shape[1]):
            x = grid.x0 + grid.spacing * column
            y = grid.y0 + grid.spacing * row
            counts[row, column] = 0
            visits[row, column] = 0
            if not open_water(sea, x, y):
                continue
            for i in range(paths.shape[2]):
                x0, y0 = x, y
                x, y, safe = drift_for(sea, x, y, 0.0, sample_s)
                if not safe or abs(x - x0) + abs(y - y0) < 1e-4 * grid.spacing:
                    break
                paths[row, column, i, 0] = x
                paths[row, column, i, 1] = y
                counts[row, column] = i + 1
                visits[row, column] |= block_of(sea, x, y)


@kernel
def landed_value(values, k, row, column, t, chart):
    """V at a node at time ``t``: linear between slices, infinite after the last."""
    frames = values.shape[1]
    if frames == 1:
        return np.float64(values[k, 0, row, column])
    place = t / chart.time_step
    if place > frames - 1 + 1e-9:
        return np.inf
    frame, f = locate(0.0, chart.time_step, frames, t)
    if f == 0.0:
        return np.float64(values[k, frame, row, column])
    if f == 1.0:
        return np.float64(values[k, frame + 1, row, column])
    # An infinite neighbour makes the result infinite: never optimistic about a deadline.
    return (1.0 - f) * values[k, frame, row, column] + f * values[k, frame + 1, row, column]


@kernel
def value_of_flight(values, k, landing, chart, x, y, t):
    """Cost, m, of flying at time ``t`` from (x, y) to ``landing`` and going on from there."""
    if landing == NOWHERE:
        return np.inf
    if landing == GOAL:
        distance = max(np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2) - chart.goal_radius, 0.0)
        return distance if t + flight_time(distance, chart.airspeed) <= chart.end else np.inf
    row, column = landing >> 16, landing & 0xFFFF
    dx = chart.grid.x0 + chart.grid.spacing * column - x
    dy = chart.grid.y0 + chart.grid.spacing * row - y
    distance = np.sqrt(dx * dx + dy * dy)
    return distance + landed_value(values, k, row, column, t + flight_time(distance, chart.airspeed), chart)


@kernel
def best_flight(values, landings, k, chart, x, y, t):
    """Least cost of a flight from (x, y) at ``t`` and its landing place, over the four corners' own."""
    frame = min(int(t / chart.time_step), values.shape[1] - 1) if values.shape[1] > 1 else 0
    column, _ = locate(chart.grid.x0, chart.grid.spacing, values.shape[3], x)
    row, _ = locate(chart.grid.y0, chart.grid.spacing, values.shape[2], y)
    best = np.inf
    chosen = NOWHERE
    last = NOWHERE
    for corner in range(4):
        landing = landings[k, frame, row + corner // 2, column + corner % 2]
        if landing != last:
            cost = value_of_flight(values, k, landing, chart, x, y, t)
            if cost < best:
                best = cost
                chosen = landing
            last = landing
    return best, chosen


@kernel
def _offer(values, landings, k, frame, chart, blocked, over, row, column, landing, run, t):
    """Take ``landing`` for a node if it is cheaper; ``run`` is the blocked stretch flown over to get here."""
    if run > chart.max_hop:
        return
    x = chart.grid.x0 + chart.grid.spacing * column
    y = chart.grid.y0 + chart.grid.spacing * row
    cost = value_of_flight(values, k, landing, chart, x, y, t)
    if cost < values[k, frame, row, column] - 1e-3:
        values[k, frame, row, column] = cost
        landings[k, frame, row, column] = landing
        over[row, column] = run if blocked[row, column] else 0.0


@kernel
def spread_flights(values, landings, k, frame, chart, blocked, any_blocked, over, rounds):
    """Propagate landing places from node to node until ``rounds`` sweeps in four directions are done.

    A flight may pass over an obstacle, but lands every ``max_hop`` at the latest: ``over`` carries the
    length of the blocked stretch under a node, and a longer stretch ends the propagation. Nodes in
    obstacles only pass flights on; they are no landing places (their value is not V).
    """
    rows, columns = values.shape[2], values.shape[3]
    t = frame * chart.time_step if values.shape[1] > 1 else 0.0
    for sweep in range(4 * rounds):
        up = 1 if sweep % 4 < 2 else -1
        right = 1 if sweep % 2 == 0 else -1
        for i in range(rows):
            row = i if up == 1 else rows - 1 - i
            for j in range(columns):
                column = j if right == 1 else columns - 1 - j
                own = landings[k, frame, row, column]
                if sweep == 0 and own >= 0 and own != pack(row, column):
                    # The landing place may have become cheaper since it was chosen.
                    _offer(values, landings, k, frame, chart, blocked, over, row, column, own, 0.0, t)
                for n in range(4):
                    # The row already swept (three neighbours) and the node just swept.
                    r = row if n == 3 else row - up
                    c = column - right if n == 3 else column + n - 1
                    if r < 0 or r >= rows or c < 0 or c >= columns:
                        continue
                    landing = landings[k, frame, r, c]
                    if landing == NOWHERE:
                        continue
                    run = 0.0
                    if any_blocked and (blocked[row, column] or blocked[r, c]):
                        run = over[r, c] + chart.grid.spacing * np.sqrt(
                            (row - r) ** 2.0 + (column - c) ** 2.0
                        )
                    if landing != own:
                        _offer(values, landings, k, frame, chart, blocked, over, row, column, landing, run, t)
                    if any_blocked and not blocked[r, c]:
                        # Round a corner: land at the neighbour and fly on from there.
                        _offer(
                            values, landings, k, frame, chart, blocked, over, row, column, pack(r, c), run, t
                        )
                    own = landings[k, frame, row, column]


@kernel
def seed_goal(values, landings, k, frame, chart, blocked, over, t):
    """Nodes within one hop of the goal fly to it directly."""
    for row in range(values.shape[2]):
        for column in range(values.shape[3]):
            x = chart.grid.x0 + chart.grid.spacing * column
            y = chart.grid.y0 + chart.grid.spacing * row
            distance = np.sqrt((x - chart.goal_x) ** 2 + (y - chart.goal_y) ** 2)
            if distance <= chart.max_hop and not blocked[row, column]:
                _offer(values, landings, k, frame, chart, blocked, over, row, column, GOAL, 0.0, t)


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


@kernel
def at_least(values, k, chart, x, y):
    """A lower estimate of V of a steady field at (x, y): V has slope 1 at most."""
    column, fx = locate(chart.grid.x0, chart.grid.spacing, values.shape[3], x)
    row, fy = locate(chart.grid.y0, chart.grid.spacing, values.shape[2], y)
    right, up = int(fx > 0.5), int(fy > 0.5)
    value = np.float64(values[k, 0, row + up, column + right])
    if value == np.inf:
        return -np.inf
    return value - chart.grid.spacing * np.sqrt((fx - right) ** 2 + (fy - up) ** 2)


@kernel
def relax_drift(values, landings, k, chart, over, paths, counts, sample_s, stride, visits, changed):
    """Steady field: let every node drift, then fly (or arrive); returns the greatest decrease of V, m.

    A node whose drift pays becomes its own landing place. ``stride`` is the longest way between two
    samples, m: V has slope 1 at most, so samples that cannot pay are skipped, and so are nodes
    whose drift visits no block of the box where V ``changed`` since the last time.
    """
    greatest = 0.0
    for row in range(values.shape[2]):
        for column in range(values.shape[3]):
            if visits[row, column] & changed == 0:
                continue
            best = np.float64(values[k, 0, row, column])
            before = best
            i = 0
            while i < counts[row, column]:
                x, y = np.float64(paths[row, column, i, 0]), np.float64(paths[row, column, i, 1])
                x0 = (
                    np.float64(paths[row, column, i - 1, 0])
                    if i
                    else chart.grid.x0 + chart.grid.spacing * column
                )
                y0 = (
                    np.float64(paths[row, column, i - 1, 1])
                    if i
                    else chart.grid.y0 + chart.grid.spacing * row
                )
                price = chart.price * sample_s * (i + 1)
                if price >= best:
                    break
                if crosses_goal(chart, x0, y0, x, y):
                    best = price
                    break
                # One look-up settles most samples: V here is at least V at the next node less the way there.
                gap = at_least(values, k, chart, x, y) + price - best
                if gap >= 0.0:
                    i += 1 + int(min(gap / stride, 1e6))
                    continue
                cost, _ = best_flight(values, landings, k, chart, x, y, 0.0)
                if cost + price < best - 1e-3:
                    best = cost + price
                    i += 1
                else:
                    i += 1 + int(min((cost + price - best) / stride, 1e6))
            if best < before - 1e-3:
                greatest = max(greatest, before - best)
                values[k, 0, row, column] = best
                landings[k, 0, row, column] = pack(row, column)
                over[row, column] = 0.0
    return greatest


@kernel
def interpolated_drift(values, landings, k, frame, chart, x, y):
    """V where all four corners go on drifting, bilinear; infinite elsewhere (flights are never smeared)."""
    rows, columns = values.shape[2], values.shape[3]
    column, fx = locate(chart.grid.x0, chart.grid.spacing, columns, x)
    row, fy = locate(chart.grid.y0, chart.grid.spacing, rows, y)
    total = 0.0
    for corner in range(4):
        r, c = row + corner // 2, column + corner % 2
        if landings[k, frame, r, c] != pack(r, c):
            return np.inf
        wx = fx if corner % 2 else 1.0 - fx
        wy = fy if corner // 2 else 1.0 - fy
        total += wx * wy * values[k, frame, r, c]
    return total


@kernel
def sweep_back(sea, values, landings, k, chart, blocked, any_blocked, over, look_ahead):
    """Field that changes with time: fill all slices from the last to the first.

    At each slice a node may drift 1 ... ``look_ahead`` slices and then fly, or drift on from there
    (interpolated), or fly at once.
    """
    rows, columns = values.shape[2], values.shape[3]
    last = values.shape[1] - 1
    for back in range(last + 1):
        frame = last - back
        t = frame * chart.time_step
        values[k, frame] = np.inf
        landings[k, frame] = NOWHERE
        seed_goal(values, landings, k, frame, chart, blocked, over, t)
        for row in range(rows):
            for column in range(columns):
                if back == 0:
                    continue
                # Slices resemble each other: begin with the landing place of the next one.
                earlier = landings[k, frame + 1, row, column]
                if earlier != NOWHERE and earlier != pack(row, column):
                    run = over[row, column]
                    _offer(values, landings, k, frame, chart, blocked, over, row, column, earlier, run, t)
                if blocked[row, column]:
                    continue
                x = chart.grid.x0 + chart.grid.spacing * column
                y = chart.grid.y0 + chart.grid.spacing * row
                best = np.float64(values[k, frame, row, column])
                drifts = False
                ahead = min(look_ahead, back)
                for m in range(1, ahead + 1):
                    x0, y0 = x, y
                    start = t + (m - 1) * chart.time_step
                    x, y, safe = drift_for(sea, x, y, start, chart.time_step)
                    price = chart.price * chart.time_step * m
                    if crosses_goal(chart, x0, y0, x, y):
                        cost = 0.0
                    elif not safe:
                        break
                    else:
                        cost, _ = best_flight(values, landings, k, chart, x, y, t + m * chart.time_step)
                        if m == ahead:
                            on = interpolated_drift(values, landings, k, frame + m, chart, x, y)
                            cost = min(cost, on)
                    if cost + price < best - 1e-3:
                        best = cost + price
                        drifts = True
                    if cost == 0.0:
                        break
                if drifts:
                    values[k, frame, row, column] = best
                    landings[k, frame, row, column] = pack(row, column)
                    over[row, column] = 0.0
        spread_flights(values, landings, k, frame, chart, blocked, any_blocked, over, 1)

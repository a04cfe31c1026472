"""Kernels of the value function in a steady field: a fixed point of drifting and flying.

Drift from every node is tabulated once for a field and its obstacles; for each goal, rounds of
"every node drifts, then flies" and "landing places spread from node to node" lower V from
the direct flight until it no longer changes.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from baselines.value_function import (
    NOWHERE,
    cell_of,
    crosses_goal,
    drift_for,
    open_water,
    pack,
    value_without_deadline,
)


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
def relax_drift(values, landings, k, chart, paths, counts, sample_s, stride, visits, changed):
    """Steady field: let every node drift, then fly (or arrive); returns the greatest decrease of V, m.

    A node whose drift pays becomes its own landing place. ``stride`` is the longest way between two
    samples, m: V has slope 1 at most, so samples that cannot pay are skipped, and so are nodes
    whose drift visits no block of the box where V ``changed`` since the last time.
    """
    V, L = values[k, 0], landings[k, 0]
    rows, columns = V.shape
    grid = chart.grid
    reach = stride + chart.goal_radius
    greatest = 0.0
    for row in range(rows):
        for column in range(columns):
            if visits[row, column] & changed == 0:
                continue
            before = best = np.float64(V[row, column])
            i = 0
            while i < counts[row, column]:
                x, y = np.float64(paths[row, column, i, 0]), np.float64(paths[row, column, i, 1])
                price = chart.price * sample_s * (i + 1)
                if price >= best:
                    break
                if abs(x - chart.goal_x) < reach and abs(y - chart.goal_y) < reach:
                    x0, y0 = grid.x0 + grid.spacing * column, grid.y0 + grid.spacing * row
                    if i > 0:
                        x0, y0 = (
                            np.float64(paths[row, column, i - 1, 0]),
                            np.float64(paths[row, column, i - 1, 1]),
                        )
                    if crosses_goal(chart, x0, y0, x, y):
                        best = price
                        break
                r, c, fx, fy = cell_of(grid, rows, columns, x, y)
                # One look-up settles most samples: V is at least V at the nearest node less the way there.
                right, up = int(fx > 0.5), int(fy > 0.5)
                nearest = np.float64(V[r + up, c + right])
                cost = nearest - grid.spacing * np.sqrt((fx - right) ** 2 + (fy - up) ** 2)
                if cost + price < best or nearest == np.inf:
                    cost = np.inf
                    for corner in range(4):
                        landing = L[r + corner // 2, c + corner % 2]
                        if landing != NOWHERE:
                            cost = min(cost, value_without_deadline(V, landing, chart, x, y))
                if cost + price < best - 1e-3:
                    best = cost + price
                    i += 1
                else:
                    i += 1 + int(min(max(cost + price - best, 0.0) / stride, 1e6))
            if best < before - 1e-3:
                greatest = max(greatest, before - best)
                V[row, column] = best
                L[row, column] = pack(row, column)
    return greatest

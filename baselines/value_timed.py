"""Kernels of the value function in a field that changes with time: swept back over slices of time.

Interpolating V between nodes at every slice smears it by a cell every few slices, far too much over
half a day. Landing places here are therefore *floats*: released once on every node, they drift
forward in time, and a node that runs dry gets a new one. Swept backward, a float's V is passed from
slice to slice along its own path, exactly; only the choice of landing places is discrete.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from baselines.value_function import (
    ARRIVES,
    DRIFTS,
    EMPTY,
    ENDS,
    FLOAT,
    NOWHERE,
    best_flight,
    cell_of,
    crosses_goal,
    drift_for,
    offer,
    seed_goal,
    spread_flights,
)

#: Floats about one node above which further ones are given up.
_CROWDED = 3
#: Straight pieces that a slice of drift is looked at in when the goal is near.
_PIECES = 2


@kernel
def release_floats(sea, tables, k, chart, blocked, near):
    """Drift floats forward through all slices; ``near`` (rows, columns) int32 is scratch.

    Fills ``spots`` and ``states``. A float ends where it leaves the box or meets an obstacle.
    """
    rows, columns = blocked.shape
    frames, floats = tables.states.shape[1], tables.states.shape[2]
    states, spots = tables.states[k], tables.spots[k]
    grid = chart.grid
    states[:] = EMPTY
    for frame in range(frames):
        near[:] = 0
        for i in range(floats):
            if states[frame, i] == ENDS and frame > 0 and states[frame - 1, i] == DRIFTS:
                column = int(np.floor((spots[frame, i, 0] - grid.x0) / grid.spacing + 0.5))
                row = int(np.floor((spots[frame, i, 1] - grid.y0) / grid.spacing + 0.5))
                near[row, column] += 1
                if near[row, column] <= _CROWDED:
                    states[frame, i] = DRIFTS
        free = 0
        for row in range(rows):
            for column in range(columns):
                if near[row, column] or blocked[row, column]:
                    continue
                while free < floats and states[frame, free] != EMPTY:
                    free += 1
                if free < floats:
                    spots[frame, free, 0] = grid.x0 + grid.spacing * column
                    spots[frame, free, 1] = grid.y0 + grid.spacing * row
                    states[frame, free] = DRIFTS
        for i in range(floats):
            if states[frame, i] != DRIFTS:
                continue
            if frame == frames - 1:
                states[frame, i] = ENDS
                continue
            x, y = np.float64(spots[frame, i, 0]), np.float64(spots[frame, i, 1])
            safe = True
            piece = chart.time_step / _PIECES
            for j in range(_PIECES):
                x0, y0 = x, y
                x, y, safe = drift_for(sea, x, y, frame * chart.time_step + j * piece, piece)
                if crosses_goal(chart, x0, y0, x, y):
                    states[frame, i] = ARRIVES
                    break
                if not safe:
                    states[frame, i] = ENDS
                    break
            if states[frame, i] != ENDS:
                spots[frame + 1, i, 0] = x
                spots[frame + 1, i, 1] = y
                states[frame + 1, i] = ENDS


@kernel
def sweep_back(tables, k, chart, blocked, any_blocked, over):
    """Fill all slices from the last to the first (after :func:`release_floats`)."""
    rows, columns = blocked.shape
    values, landings = tables.values[k], tables.landings[k]
    states, spots, worths = tables.states[k], tables.spots[k], tables.worths[k]
    last = values.shape[0] - 1
    price = chart.price * chart.time_step
    for back in range(last + 1):
        frame = last - back
        t = frame * chart.time_step
        values[frame] = np.inf
        landings[frame] = NOWHERE
        worths[frame] = np.inf
        seed_goal(tables, k, frame, chart, blocked, over, t)
        if back > 0:
            # Slices resemble each other: begin with the landing places of the next one.
            for row in range(rows):
                for column in range(columns):
                    earlier = landings[frame + 1, row, column]
                    if earlier != NOWHERE:
                        run = over[row, column]
                        offer(tables, k, frame, chart, blocked, over, row, column, earlier, run, t)
        for i in range(states.shape[1]):
            if states[frame, i] == ARRIVES:
                worths[frame, i] = price
            elif states[frame, i] == DRIFTS:
                x, y = np.float64(spots[frame + 1, i, 0]), np.float64(spots[frame + 1, i, 1])
                cost, _ = best_flight(tables, k, chart, x, y, t + chart.time_step)
                worths[frame, i] = price + min(cost, np.float64(worths[frame + 1, i]))
            if worths[frame, i] == np.inf:
                continue
            x, y = np.float64(spots[frame, i, 0]), np.float64(spots[frame, i, 1])
            row, column, _, _ = cell_of(chart.grid, rows, columns, x, y)
            for corner in range(4):
                r, c = row + corner // 2, column + corner % 2
                run = chart.grid.spacing if blocked[r, c] else 0.0
                offer(tables, k, frame, chart, blocked, over, r, c, FLOAT + i, run, t)
        spread_flights(tables, k, frame, chart, blocked, any_blocked, over, 1)

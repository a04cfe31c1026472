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

#: A float in a slice: none; goes no further; drifts to the next slice; arrives on the way there.
EMPTY, ENDS, DRIFTS, ARRIVES = 0, 1, 2, 3
#: A float that is this much too dear before it has moved towards a vehicle in flight is not looked at, m.
_SLACK_M = 20.0
#: Floats about one node above which further ones are given up.
_CROWDED = 5
#: Straight pieces that a slice of drift is looked at in when the goal is near.
_PIECES = 2


@kernel
def release_floats(sea, floats, states, k, chart, blocked, near):
    """Drift floats forward through all slices; ``near`` (rows, columns) int32 is scratch.

    Fills the places in ``floats`` and ``states`` (frames, floats) int8. A float ends where it
    leaves the box or meets an obstacle.
    """
    rows, columns = blocked.shape
    frames, size = states.shape
    spots = floats[k]
    grid = chart.grid
    states[:] = EMPTY
    for frame in range(frames):
        near[:] = 0
        for i in range(size):
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
                while free < size and states[frame, free] != EMPTY:
                    free += 1
                if free < size:
                    spots[frame, free, 0] = grid.x0 + grid.spacing * column
                    spots[frame, free, 1] = grid.y0 + grid.spacing * row
                    states[frame, free] = DRIFTS
        for i in range(size):
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
def sweep_back(sea, values, landings, floats, states, k, chart, blocked, any_blocked):
    """Fill all slices from the last to the first (after :func:`release_floats`)."""
    rows, columns = blocked.shape
    last = values.shape[1] - 1
    spots = floats[k]
    price = chart.price * chart.time_step
    for back in range(last + 1):
        frame = last - back
        t = frame * chart.time_step
        values[k, frame] = np.inf
        landings[k, frame] = NOWHERE
        spots[frame, :, 2] = np.inf
        seed_goal(sea, values, landings, floats, k, frame, chart, blocked, t)
        if back > 0:
            # Slices resemble each other: begin with the landing places of the next one.
            for row in range(rows):
                for column in range(columns):
                    earlier = landings[k, frame + 1, row, column]
                    if earlier != NOWHERE:
                        offer(
                            sea,
                            values,
                            landings,
                            floats,
                            k,
                            frame,
                            chart,
                            any_blocked,
                            row,
                            column,
                            earlier,
                            t,
                        )
        for i in range(states.shape[1]):
            if states[frame, i] == ARRIVES:
                spots[frame, i, 2] = price
            elif states[frame, i] == DRIFTS:
                x, y = np.float64(spots[frame + 1, i, 0]), np.float64(spots[frame + 1, i, 1])
                cost, _ = best_flight(values, landings, floats, k, chart, x, y, t + chart.time_step)
                spots[frame, i, 2] = price + min(cost, np.float64(spots[frame + 1, i, 2]))
            if spots[frame, i, 2] == np.inf:
                continue
            x, y = np.float64(spots[frame, i, 0]), np.float64(spots[frame, i, 1])
            row, column, _, _ = cell_of(chart.grid, rows, columns, x, y)
            for corner in range(4):
                r, c = row + corner // 2, column + corner % 2
                dx = chart.grid.x0 + chart.grid.spacing * c - x
                dy = chart.grid.y0 + chart.grid.spacing * r - y
                if np.sqrt(dx * dx + dy * dy) + spots[frame, i, 2] > values[k, frame, r, c] + _SLACK_M:
                    continue
                offer(sea, values, landings, floats, k, frame, chart, any_blocked, r, c, FLOAT + i, t)
        spread_flights(sea, values, landings, floats, k, frame, chart, blocked, any_blocked, 1)

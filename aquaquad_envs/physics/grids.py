"""Regular square grids and their bilinear interpolation, shared by currents and obstacles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel


class Grid(NamedTuple):
    """A square grid: node ``[row, column]`` lies at ``(x0 + column * spacing, y0 + row * spacing)``, m."""

    x0: float
    y0: float
    spacing: float

    def nodes(self, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
        """Node coordinates ``(x, y)``, m, each of shape (rows, columns)."""
        x, y = np.meshgrid(
            self.x0 + self.spacing * np.arange(columns), self.y0 + self.spacing * np.arange(rows)
        )
        return x, y

    @staticmethod
    def square(half_width_m: float, spacing_m: float) -> tuple[Grid, int]:
        """The grid that covers ``[-half_width, half_width]²`` at about ``spacing_m``, and its side in nodes."""
        side = max(2, round(2 * half_width_m / spacing_m) + 1)
        return Grid(-half_width_m, -half_width_m, 2 * half_width_m / (side - 1)), side


@kernel
def locate(origin, spacing, size, position):
    """Lower node index in [0, size-2] (unsigned) and fraction in [0, 1] of ``position`` on one axis.

    Positions outside the axis (and NaN, which clean callers never pass) are held at its edge.
    Unsigned indices spare Numba's wrap-around of negative ones, without branches it makes SIMD.
    """
    scaled = (position - origin) * (1.0 / spacing)
    scaled = scaled if scaled > 0.0 else 0.0
    scaled = scaled if scaled < size - 1.0 else size - 1.0
    index = np.int64(scaled if scaled < size - 2.0 else size - 2.0)
    return np.uint64(index), scaled - index


@kernel
def bilinear(values, k, grid, x, y):
    """Value of layer ``k`` of ``values`` (layers, rows, columns) at (x, y), held at the edges."""
    column, fx = locate(grid.x0, grid.spacing, values.shape[2], x)
    row, fy = locate(grid.y0, grid.spacing, values.shape[1], y)
    k = np.uint64(k)
    one = np.uint64(1)
    lower = values[k, row, column] + fx * (values[k, row, column + one] - values[k, row, column])
    upper = values[k, row + one, column] + fx * (
        values[k, row + one, column + one] - values[k, row + one, column]
    )
    return lower + fy * (upper - lower)

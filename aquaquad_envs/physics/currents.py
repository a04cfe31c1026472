"""Ocean currents in one gridded form: bilinear in space, linear in time.

Every origin (a formula, a random draw, a NetCDF file) becomes a :class:`CurrentField`;
worlds and planners read it through the one kernel :func:`current_at`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice
from aquaquad_envs.physics.grids import Grid, locate


class CurrentAxes(NamedTuple):
    """Axes of a stack of current fields as kernels read them."""

    x0: float  # m, first column
    y0: float  # m, first row
    spacing: float  # m
    time0: float  # s, first frame
    time_step: float  # s between frames
    by_cell: bool  # True: constant per cell (published variant); False: bilinear


@dataclass(frozen=True, kw_only=True, eq=False)
class CurrentField:
    """A current on a regular grid in space and time.

    Parameters
    ----------
    velocity: shape (frames, rows, columns, 2), m/s, component 0 east (u), 1 north (v); finite.
    grid: position of the nodes, m, x east and y north.
    time0_s, time_step_s: mission time of the first frame and between frames, s.
    interpolation: ``"bilinear"`` (default), or ``"cell"``: each cell holds the value of its
        lower-left node, as the published planner has it (SPEC §1).

    Outside its box the field holds its edge value, before its first and after its last
    frame that frame. Raises ``InvalidParameterError`` for wrong shapes or non-finite values.
    """

    velocity: np.ndarray
    grid: Grid
    time0_s: float = 0.0
    time_step_s: float = 3600.0
    interpolation: str = "bilinear"

    def __post_init__(self) -> None:
        velocity = np.ascontiguousarray(self.velocity, dtype=np.float64)
        if velocity.ndim != 4 or velocity.shape[3] != 2 or min(velocity.shape[1:3]) < 2 or not len(velocity):
            raise InvalidParameterError(
                "velocity", velocity.shape, "shape (frames >= 1, rows >= 2, columns >= 2, 2)"
            )
        if not np.isfinite(velocity).all():
            bad = int(np.sum(~np.isfinite(velocity)))
            raise InvalidParameterError(
                "velocity", f"{bad} values that are NaN or infinite", "finite velocities",
                "Fill land and gaps with 0 and mark them as obstacles.",
            )  # fmt: skip
        for name in ("time_step_s",):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InvalidParameterError(name, getattr(self, name), "a positive number of seconds")
        if not (all(np.isfinite(self.grid)) and self.grid.spacing > 0):
            raise InvalidParameterError("grid", self.grid, "finite origin and positive spacing")
        check_choice("interpolation", self.interpolation, ("bilinear", "cell"))
        velocity.setflags(write=False)
        object.__setattr__(self, "velocity", velocity)

    @property
    def axes(self) -> CurrentAxes:
        """Axes in the form that :func:`current_at` reads."""
        return CurrentAxes(
            float(self.grid.x0), float(self.grid.y0), float(self.grid.spacing),
            float(self.time0_s), float(self.time_step_s), self.interpolation == "cell",
        )  # fmt: skip

    def sample(self, x: np.ndarray, y: np.ndarray, time_s: float = 0.0) -> np.ndarray:
        """Velocity at points ``x``, ``y`` (any equal shape, m) and one time: shape (..., 2), m/s."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        out = np.empty((x.size, 2))
        _sample(self.velocity[None], 0, self.axes, float(time_s), x.flatten(), y.flatten(), out)
        return out.reshape(*x.shape, 2)


@kernel
def _component(velocity, k, frame, row, column, component, fx, fy):
    c = np.uint64(component)
    one = np.uint64(1)
    west = velocity[k, frame, row, column, c]
    lower = west + fx * (velocity[k, frame, row, column + one, c] - west)
    west = velocity[k, frame, row + one, column, c]
    upper = west + fx * (velocity[k, frame, row + one, column + one, c] - west)
    return lower + fy * (upper - lower)


@kernel
def current_at(velocity, k, axes, t, x, y):
    """Current (u, v), m/s, of field ``k`` at time ``t`` (s) and position (x, y) (m).

    ``velocity`` has shape (fields, frames, rows, columns, 2). Space is bilinear (or
    constant per cell where ``axes.by_cell``), time linear; both are held at their ends.
    """
    column, fx = locate(axes.x0, axes.spacing, velocity.shape[3], x)
    row, fy = locate(axes.y0, axes.spacing, velocity.shape[2], y)
    if axes.by_cell:
        # A cell's value is that of its lower-left node; the last node is a cell of its own.
        fx = np.floor(fx)
        fy = np.floor(fy)
    k = np.uint64(k)
    first = np.uint64(0)
    if velocity.shape[1] == 1:
        u = _component(velocity, k, first, row, column, 0, fx, fy)
        return u, _component(velocity, k, first, row, column, 1, fx, fy)
    frame, ft = locate(axes.time0, axes.time_step, velocity.shape[1], t)
    later = frame + np.uint64(1)
    u0 = _component(velocity, k, frame, row, column, 0, fx, fy)
    v0 = _component(velocity, k, frame, row, column, 1, fx, fy)
    u1 = _component(velocity, k, later, row, column, 0, fx, fy)
    v1 = _component(velocity, k, later, row, column, 1, fx, fy)
    return u0 + ft * (u1 - u0), v0 + ft * (v1 - v0)


@loop_kernel
def _sample(velocity, k, axes, t, x, y, out):
    for i in range(x.size):
        out[i, 0], out[i, 1] = current_at(velocity, k, axes, t, x[i], y[i])

"""Local metres about a point of a file of currents: choosing the point, cropping, interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import CurrentFileError
from aquaquad_envs.physics.current_file_source import HorizontalGrid

#: Mean radius of the Earth, m (IUGG).
EARTH_RADIUS_M = 6_371_008.8
#: Beyond this latitude a box in x east, y north bends too much.
HIGHEST_LATITUDE = 85.0
_MOST_POINTS = 250_000


def wrap(degrees: Any) -> Any:
    """Angle in [-180, 180) degrees."""
    return (np.asarray(degrees) + 180.0) % 360.0 - 180.0


def to_metres(latitude: Any, longitude: Any, center: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Equirectangular projection about ``center``: x east, y north, m.

    x = R cos(lat0) (lon - lon0), y = R (lat - lat0). At distance d from the centre, x is
    off by a share of about tan(lat0) d / R: 0.3 % at 20 km and 45°.
    """
    scale = np.radians(1.0) * EARTH_RADIUS_M
    x = scale * np.cos(np.radians(center[0])) * wrap(longitude - center[1])
    return x, scale * (latitude - center[0])


def to_degrees(x: Any, y: Any, center: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of :func:`to_metres`; longitude relative to that of the centre."""
    scale = np.radians(1.0) * EARTH_RADIUS_M
    return center[0] + y / scale, x / (scale * np.cos(np.radians(center[0])))


def spacings(latitude: np.ndarray, longitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance to the next row and column, m, and angle from east to the column axis, rad, per point."""

    def steps(axis: int) -> tuple[np.ndarray, np.ndarray]:
        # One-sided where a neighbour lacks a position, the mean of both sides elsewhere.
        north = np.diff(latitude, axis=axis)
        east = wrap(np.diff(longitude, axis=axis)) * np.cos(np.radians(_middle(latitude, axis)))
        return _both_sides(east, axis), _both_sides(north, axis)

    scale = np.radians(1.0) * EARTH_RADIUS_M
    row_east, row_north = steps(0)
    column_east, column_north = steps(1)
    return (
        scale * np.hypot(row_east, row_north),
        scale * np.hypot(column_east, column_north),
        np.arctan2(column_north, column_east),
    )


def _middle(values: np.ndarray, axis: int) -> np.ndarray:
    count = values.shape[axis]
    return (np.take(values, range(count - 1), axis) + np.take(values, range(1, count), axis)) / 2


def _both_sides(steps: np.ndarray, axis: int) -> np.ndarray:
    pad = [(0, 0), (0, 0)]
    pad[axis] = (1, 0)
    before = np.pad(steps, pad, constant_values=np.nan)
    pad[axis] = (0, 1)
    after = np.pad(steps, pad, constant_values=np.nan)
    return np.where(np.isnan(before), after, np.where(np.isnan(after), before, (before + after) / 2))


def wettest_center(
    grid: HorizontalGrid, wet: np.ndarray, half_width_m: float, stride: int
) -> tuple[float, float]:
    """Position of the source point whose box has the most water; of equals the nearest to the middle.

    ``wet`` holds every ``stride``-th point. A point's box is taken as the index
    rectangle that covers it; whatever lies outside the data counts as dry.
    """
    latitude, longitude = grid.fields(stride)
    down, across, angle = spacings(latitude, longitude)
    turned = np.abs(np.cos(angle)) + np.abs(np.sin(angle))
    rows, columns = wet.shape
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = [np.ceil(half_width_m * turned / np.maximum(step, 1.0)) for step in (down, across)]
    reach_rows, reach_columns = (
        np.nan_to_num(np.clip(r, 1, n), nan=n).astype(np.int64) for r, n in zip(reach, wet.shape, strict=True)
    )
    total = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    total[1:, 1:] = np.cumsum(np.cumsum(wet, axis=0), axis=1)
    i, j = np.indices(wet.shape)
    top, bottom = np.maximum(i - reach_rows, 0), np.minimum(i + reach_rows + 1, rows)
    left, right = np.maximum(j - reach_columns, 0), np.minimum(j + reach_columns + 1, columns)
    water = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
    share = water / ((2 * reach_rows + 1) * (2 * reach_columns + 1))
    usable = wet & (np.abs(latitude) <= HIGHEST_LATITUDE - 1) & np.isfinite(longitude)
    if not usable.any():
        raise CurrentFileError(f"no water between {HIGHEST_LATITUDE - 1:g}° south and north in the file.")
    share = np.where(usable, share, -1.0)
    away = np.hypot((i - (rows - 1) / 2) * np.nanmedian(down), (j - (columns - 1) / 2) * np.nanmedian(across))
    away = np.where(share >= share.max() - 1e-9, away, np.inf)
    best = np.unravel_index(np.argmin(away), away.shape)
    return float(latitude[best]), float(wrap(longitude[best]))


def ordered_longitudes(longitude: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Columns from west to east without a jump: (degrees ascending, index in the file, all around).

    The axis starts after the widest gap of the circle, so that a seam at 0 or ±180 does not matter.
    """
    turned = longitude % 360.0
    order = np.argsort(turned, kind="stable")
    turned = turned[order]
    keep = np.concatenate([[True], np.diff(turned) > 1e-6])
    keep[-1] &= turned[-1] - turned[0] < 360.0 - 1e-6
    order, turned = order[keep], turned[keep]
    gaps = np.diff(np.append(turned, turned[0] + 360.0))
    start = int(np.argmax(gaps))
    around = bool(len(gaps) > 2 and gaps[start] <= 1.5 * np.median(gaps))
    if around:
        return turned, order, True
    shift = (start + 1) % len(turned)
    turned = np.concatenate([turned[shift:] - (360.0 if shift else 0.0), turned[:shift]])
    return turned, np.roll(order, -shift), False


def extent(grid: HorizontalGrid) -> str:
    """Where the data lie, in words."""
    latitude, longitude = grid.latitude, grid.longitude
    degrees, _, around = ordered_longitudes(np.unique(np.round(longitude[np.isfinite(longitude)], 6)))
    east_west = (
        "all longitudes" if around else f"longitudes {wrap(degrees[0]):.3f} to {wrap(degrees[-1]):.3f}"
    )
    return f"latitudes {np.nanmin(latitude):.3f} to {np.nanmax(latitude):.3f} and {east_west}"


@dataclass(eq=False)
class Sampler:
    """Interpolates the points of one grid to nodes ``x``, ``y`` (m, flat) about ``center``.

    ``rows`` and ``columns`` are what has to be read. Regular grids are interpolated
    bilinearly in latitude and longitude, others linearly on the triangles of their
    points. Nodes farther from every point than the data reach are ``outside``.
    """

    grid: HorizontalGrid
    center: tuple[float, float]
    x: np.ndarray
    y: np.ndarray

    def __post_init__(self) -> None:
        if self.grid.regular:
            self._crop_regular()
        else:
            self._crop_field()

    @property
    def resolution_m(self) -> float:
        """Distance between neighbouring points about the box, m."""
        return self._resolution

    def values(self, stored: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Interpolate ``stored`` (frames, rows, columns) where ``valid`` (rows, columns).

        Returns the values (frames, nodes) and which nodes are land: those outside the
        data or whose nearest point is not valid. Weights are renormalised over valid
        points, so that nothing is diluted beside a coast. Land nodes are 0.
        """
        if self.grid.regular:
            points, ok = np.moveaxis(stored, 0, -1), valid
        else:
            points, ok = stored[:, *self._select].T, valid[self._select]
        nearest = self._nearest(ok.astype(np.float64), points)
        land = self.outside | (nearest[:, -1] < 0.5)
        weighted = np.concatenate([np.where(ok[..., None], points, 0.0), ok[..., None]], axis=-1)
        mixed = self._linear(weighted)
        weight = mixed[:, -1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            out = mixed[:, :-1] / weight
        # Beyond the outermost points, and where no corner of a triangle is valid, the nearest point serves.
        out = np.where(weight > 1e-6, out, nearest[:, :-1])
        out[land] = 0.0
        return out.T, land

    def _crop_regular(self) -> None:
        latitude = self.grid.latitude
        order = np.argsort(latitude, kind="stable")
        latitude = latitude[order]
        fresh = np.concatenate([[True], np.diff(latitude) > 1e-9])
        latitude, order = latitude[fresh], order[fresh]
        east, column_order, around = ordered_longitudes(self.grid.longitude)
        if len(latitude) < 2 or len(east) < 2:
            raise CurrentFileError("latitude or longitude has the same value at every point.")
        node_latitude, node_longitude = to_degrees(self.x, self.y, self.center)
        if around:
            east = np.concatenate([east - 360.0, east, east + 360.0])
            column_order = np.tile(column_order, 3)
            middle = self.center[1] % 360.0
        else:
            # The turn of the circle on which the centre lies nearest to the data.
            middle = (east[0] + east[-1]) / 2
            middle += float(wrap(self.center[1] - middle))
        node_longitude = node_longitude + middle
        keep_rows = _window(latitude, node_latitude)
        keep_columns = _window(east, node_longitude)
        self._axes = (latitude[keep_rows], east[keep_columns])
        self.rows, self.columns = order[keep_rows], column_order[keep_columns]
        self._nodes = np.stack(
            [
                np.clip(node_latitude, *self._axes[0][[0, -1]]),
                np.clip(node_longitude, *self._axes[1][[0, -1]]),
            ],
            axis=-1,
        )
        self.outside = _beyond(latitude, node_latitude) | _beyond(east, node_longitude)
        scale = np.radians(1.0) * EARTH_RADIUS_M
        self._resolution = scale * min(
            float(np.median(np.diff(self._axes[0]))),
            float(np.median(np.diff(self._axes[1]))) * np.cos(np.radians(self.center[0])),
        )

    def _crop_field(self) -> None:
        from scipy.spatial import cKDTree

        latitude, longitude = self.grid.latitude, self.grid.longitude
        x, y = to_metres(latitude, longitude, self.center)
        half_x, half_y = np.abs(self.x).max(), np.abs(self.y).max()
        down, across, _ = spacings(latitude, longitude)
        cell = np.fmax(down, across)
        with np.errstate(invalid="ignore"):
            chosen = (np.abs(x) <= half_x + 3 * cell) & (np.abs(y) <= half_y + 3 * cell) & (cell > 0)
        stride = max(1, int(np.sqrt(np.count_nonzero(chosen) / _MOST_POINTS)))
        thin = np.zeros_like(chosen)
        thin[::stride, ::stride] = True
        chosen &= thin
        rows, columns = np.nonzero(chosen)
        if len(rows) < 3:
            self.rows = self.columns = np.zeros(0, dtype=np.int64)
            self.outside, self._resolution = np.ones(len(self.x), dtype=bool), np.nan
            return
        self.rows, self.columns = np.unique(rows), np.unique(columns)
        self._select = (np.searchsorted(self.rows, rows), np.searchsorted(self.columns, columns))
        self._positions = np.stack([x[rows, columns], y[rows, columns]], axis=-1)
        away, self._near = cKDTree(self._positions).query(np.stack([self.x, self.y], axis=-1))
        # Half the diagonal of a cell of sides a >= b is at most 0.71 a.
        self.outside = away > 0.75 * stride * cell[rows, columns][self._near]
        self._resolution = stride * float(np.median(np.fmin(down, across)[rows, columns]))
        self._triangles: Any = None

    def _nearest(self, ok: np.ndarray, points: np.ndarray) -> np.ndarray:
        stacked = np.concatenate([points, ok[..., None]], axis=-1)
        if not self.grid.regular:
            return stacked[self._near]
        indices = [
            np.clip(np.searchsorted((axis[1:] + axis[:-1]) / 2, nodes), 0, len(axis) - 1)
            for axis, nodes in zip(self._axes, self._nodes.T, strict=True)
        ]
        return stacked[indices[0], indices[1]]

    def _linear(self, points: np.ndarray) -> np.ndarray:
        from scipy.interpolate import LinearNDInterpolator, RegularGridInterpolator
        from scipy.spatial import Delaunay, QhullError

        if self.grid.regular:
            return RegularGridInterpolator(self._axes, points)(self._nodes)
        if self._triangles is None:
            try:
                self._triangles = Delaunay(self._positions)
            except QhullError as error:
                raise CurrentFileError(
                    "the positions of the points lie on one line or in one place."
                ) from error
        return LinearNDInterpolator(self._triangles, points, fill_value=0.0)(
            np.stack([self.x, self.y], axis=-1)
        )


def _window(axis: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Indices of an ascending axis that interpolation at ``nodes`` needs, at least two, thinned if very many."""
    low = max(0, int(np.searchsorted(axis, nodes.min(), side="right")) - 2)
    high = min(len(axis), int(np.searchsorted(axis, nodes.max())) + 2)
    low, high = min(low, len(axis) - 2), max(high, 2)
    indices = np.arange(low, max(high, low + 2))
    stride = max(1, int(len(indices) / np.sqrt(_MOST_POINTS)))
    return np.union1d(indices[::stride], indices[-1:])


def _beyond(axis: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Whether nodes lie more than half a cell beyond the ends of an ascending axis."""
    first, last = (axis[1] - axis[0]) / 2, (axis[-1] - axis[-2]) / 2
    return (nodes < axis[0] - first * 1.001) | (nodes > axis[-1] + last * 1.001)

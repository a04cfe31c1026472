"""Obstacles of every origin as one signed-distance grid (positive outside, negative inside, m)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.grids import Grid, bilinear

#: Distance that stands for "no obstacle anywhere", m.
FAR_M = 1.0e6


@dataclass(frozen=True, kw_only=True, eq=False)
class ObstacleMap:
    """Signed distance to the nearest obstacle on a regular grid.

    Parameters
    ----------
    distance: shape (rows, columns), m; positive outside obstacles, negative inside.
    grid: position of the nodes, m.

    Between nodes the distance is bilinear, so corners are rounded within one cell:
    choose ``margin_m`` at least of the order of the spacing where that matters.
    Build one with :meth:`empty`, :meth:`from_rectangles`, :meth:`from_polygons` or
    :meth:`from_mask`.
    """

    distance: np.ndarray
    grid: Grid

    def __post_init__(self) -> None:
        distance = np.ascontiguousarray(self.distance, dtype=np.float64)
        if distance.ndim != 2 or min(distance.shape) < 2 or not np.isfinite(distance).all():
            raise InvalidParameterError(
                "distance", distance.shape, "a finite array (rows >= 2, columns >= 2)"
            )
        distance.setflags(write=False)
        object.__setattr__(self, "distance", distance)

    @staticmethod
    def empty(grid: Grid, side: int = 2) -> ObstacleMap:
        """A map without obstacles."""
        return ObstacleMap(distance=np.full((side, side), FAR_M), grid=grid)

    @staticmethod
    def from_rectangles(
        rectangles: Sequence[Sequence[float]], *, grid: Grid, side: int, margin_m: float = 0.0
    ) -> ObstacleMap:
        """Axis-aligned rectangles ``(x_min, y_min, x_max, y_max)``, m, grown by ``margin_m``.

        The distance to one rectangle is exact; of several the least counts.
        """
        x, y = grid.nodes(side, side)
        distance = np.full((side, side), FAR_M)
        for number, rectangle in enumerate(rectangles):
            x_min, y_min, x_max, y_max = (float(value) for value in rectangle)
            if not (x_min < x_max and y_min < y_max):
                raise InvalidParameterError(
                    f"rectangles[{number}]", tuple(rectangle), "(x_min, y_min, x_max, y_max) with min < max"
                )
            dx = np.abs(x - (x_min + x_max) / 2) - (x_max - x_min) / 2
            dy = np.abs(y - (y_min + y_max) / 2) - (y_max - y_min) / 2
            outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
            distance = np.minimum(distance, outside + np.minimum(np.maximum(dx, dy), 0))
        return ObstacleMap(distance=distance - _margin(margin_m), grid=grid)

    @staticmethod
    def from_polygons(
        polygons: Sequence[Sequence[Sequence[float]]], *, grid: Grid, side: int, margin_m: float = 0.0
    ) -> ObstacleMap:
        """Simple polygons, each a sequence of at least three (x, y) corners in m, grown by ``margin_m``."""
        import shapely

        shapes = []
        for number, corners in enumerate(polygons):
            points = np.asarray(corners, dtype=np.float64)
            if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3 or not np.isfinite(points).all():
                raise InvalidParameterError(
                    f"polygons[{number}]", points.shape, "at least three finite (x, y) corners"
                )
            shape = shapely.Polygon(points)
            if not shape.is_valid or shape.area == 0:
                raise InvalidParameterError(
                    f"polygons[{number}]", shapely.is_valid_reason(shape), "a simple polygon with area",
                    "Order the corners around the edge and split shapes that cross themselves.",
                )  # fmt: skip
            shapes.append(shape)
        if not shapes:
            return ObstacleMap.empty(grid, side)
        union = shapely.unary_union(shapes)
        shapely.prepare(union)
        x, y = grid.nodes(side, side)
        points = shapely.points(x, y)
        outside = shapely.distance(points, union)
        inside = shapely.distance(points, union.boundary)
        distance = np.where(shapely.contains(union, points), -inside, outside)
        return ObstacleMap(distance=distance - _margin(margin_m), grid=grid)

    @staticmethod
    def from_mask(mask: np.ndarray, *, grid: Grid, margin_m: float = 0.0) -> ObstacleMap:
        """A boolean land mask on the grid's nodes, shape (rows, columns); True is land.

        The coast lies half a cell from the outermost land node.
        """
        from scipy.ndimage import distance_transform_edt

        land = np.asarray(mask, dtype=bool)
        if land.ndim != 2:
            raise InvalidParameterError("mask", land.shape, "a two-dimensional boolean array")
        margin = _margin(margin_m)
        if not land.any():
            return ObstacleMap(distance=np.full(land.shape, FAR_M), grid=grid)
        if land.all():
            raise InvalidParameterError("mask", "land everywhere", "at least one node of water")
        half = grid.spacing / 2
        outside = distance_transform_edt(~land) * grid.spacing - half
        inside = distance_transform_edt(land) * grid.spacing - half
        return ObstacleMap(distance=np.where(land, -inside, outside) - margin, grid=grid)


def _margin(margin_m: float) -> float:
    if not (np.isfinite(margin_m) and margin_m >= 0):
        raise InvalidParameterError("margin_m", margin_m, "a margin of 0 m or more")
    return float(margin_m)


@kernel
def clearance_at(distance, k, grid, x, y):
    """Signed distance, m, from (x, y) to the nearest obstacle of layer ``k`` of ``distance``."""
    return bilinear(distance, k, grid, x, y)


@kernel
def nearest_direction(distance, k, grid, x, y):
    """Unit vector towards the nearest obstacle (minus the gradient of the clearance); (0, 0) where flat."""
    h = 0.5 * grid.spacing
    gx = bilinear(distance, k, grid, x - h, y) - bilinear(distance, k, grid, x + h, y)
    gy = bilinear(distance, k, grid, x, y - h) - bilinear(distance, k, grid, x, y + h)
    norm = np.sqrt(gx * gx + gy * gy)
    # A weight, not a branch: lanes stay SIMD.
    scale = 1.0 / norm if norm >= 1e-9 else 0.0
    return gx * scale, gy * scale

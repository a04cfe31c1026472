"""Marks of what a picture shows as true and as believed: places of targets, estimates, and their ellipses."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.estimation.hdop import SCALE_95
from aquaquad_envs.rendering.canvas import Canvas, Color, Point
from aquaquad_envs.rendering.chart import View
from aquaquad_envs.rendering.sea import WHITE

TARGET: Color = (150, 0, 90)
BELIEF: Color = (204, 121, 167)
#: Points of an ellipse.
_ROUND = np.linspace(0.0, 2.0 * np.pi, 49)


def paint_ellipse(
    canvas: Canvas, view: View, center: tuple[float, float], covariance: np.ndarray, *,
    dash: tuple[float, float] | None = None,
) -> None:  # fmt: skip
    """The 95 % ellipse, of ``covariance`` (2, 2) in m², about ``center``, m."""
    spread, axes = np.linalg.eigh(covariance)
    radii = SCALE_95 * np.sqrt(np.maximum(spread, 0.0))
    outline = axes @ (radii[:, None] * np.stack([np.cos(_ROUND), np.sin(_ROUND)]))
    points = [view.pixel(center[0] + dx, center[1] + dy) for dx, dy in outline.T]
    if dash is None:
        canvas.lines(points, WHITE, 5)
    canvas.lines(points, BELIEF, 3 if dash is None else 1.5, dash=dash)


def target_mark(canvas: Canvas, center: Point) -> None:
    """A diamond."""
    x, y = center
    for size, color in ((9.0, WHITE), (7.0, TARGET)):
        canvas.polygon([(x, y - size), (x + size, y), (x, y + size), (x - size, y)], color)


def estimate_mark(canvas: Canvas, center: Point) -> None:
    """A cross."""
    x, y = center
    for width, color in ((4.5, WHITE), (2.5, BELIEF)):
        canvas.lines([(x - 6, y), (x + 6, y)], color, width)
        canvas.lines([(x, y - 6), (x, y + 6)], color, width)

"""The picture of a drift/hop world: current, obstacles, track, goal, vehicle, battery."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.rendering.canvas import Canvas, Point
from aquaquad_envs.rendering.chart import INK, QUIET
from aquaquad_envs.rendering.sea import (
    GOAL,
    HOP,
    MAP,
    MARGIN,
    WHITE,
    SeaPicture,
    Track,
    battery_bar,
    legend_track,
    listener,
    paint_track,
    start_mark,
    vehicle,
)  # fmt: skip

_GOAL_MIN_PX = 11.0


class Picture(SeaPicture):
    """Paints drift/hop worlds of ``batch``."""

    def __init__(self, batch: Any) -> None:
        super().__init__(batch)
        self.track = Track()

    def restart(self) -> None:
        """Forget the track."""
        self.track.restart()

    def paint_legend(self, canvas: Canvas, x: float, y: float) -> float:
        """Drift, hop, start, goal and, where there is one, the team."""
        x = legend_track(canvas, x, y)
        start_mark(canvas, (x + 6, y))
        x += 17 + canvas.text((x + 17, y), "start", 17, INK) + 18
        goal_mark(canvas, (x + 9, y), 9)
        x += 24 + canvas.text((x + 24, y), "goal", 17, INK) + 18
        if len(self._params.team):
            listener(canvas, (x + 7, y))
            x += 19 + canvas.text((x + 19, y), "team", 17, INK) + 18
        return x

    def paint_fixed(self, canvas: Canvas) -> None:
        """The listening team."""
        for x, y in self._params.team:
            listener(canvas, self.view.pixel(x, y))

    def paint_moving(self, canvas: Canvas, world: np.void) -> None:
        """Start, goal, track and vehicle."""
        self.track.add(world)
        start_mark(canvas, self.view.pixel(world["start_x"], world["start_y"]))
        radius = max(_GOAL_MIN_PX, float(self._params.goal_radius_m) * self.view.pixels_per_m)
        goal_mark(canvas, self.view.pixel(world["goal_x"], world["goal_y"]), radius)
        paint_track(canvas, self.view, self.track.segments)
        vehicle(canvas, self.view.held(self.view.pixel(world["x"], world["y"]), 11))

    def paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The header: time, energy, hops, battery, outcome."""
        battery, capacity = float(world["battery_wh"]), float(self._params.battery_wh)
        columns = (
            (0, "TIME", f"{world['time_s'] / 3600:.1f} h"),
            (88, "FLIGHT ENERGY", f"{world['flight_wh']:.1f} Wh"),
            (222, "HOPS", f"{world['hops']}"),
            (282, "BATTERY", f"{battery:.0f} of {capacity:.0f} Wh"),
        )
        for x, caption, value in columns:
            canvas.text((MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((MARGIN + x, 35), value, 22, INK)
        battery_bar(canvas, MARGIN + 282.0 + 62, 10.0, 150.0, 10.0, battery / capacity)
        outcome = self._outcomes[int(world["outcome"])]
        color = {"running": QUIET, "goal": GOAL}.get(outcome, HOP)
        canvas.text((MARGIN + MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((MARGIN + MAP, 35), outcome, 22, color, align=1)


def goal_mark(canvas: Canvas, center: Point, radius: float) -> None:
    """A ring of ``radius`` pixels about a dot."""
    canvas.circle(center, radius + 1.5, WHITE, line=5.5)
    canvas.circle(center, radius, GOAL, line=2.5)
    canvas.circle(center, 4, WHITE)
    canvas.circle(center, 2.5, GOAL)

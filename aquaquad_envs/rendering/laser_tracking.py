"""The picture of a laser tracking world: from above the light's discs, tracks and the guess; from the side the beam."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from aquaquad_envs.rendering.canvas import Canvas, Color, Point
from aquaquad_envs.rendering.chart import INK, PAPER, QUIET, View, scale_bar
from aquaquad_envs.rendering.sea import FORECAST, GOAL, HOP, MARGIN, WHITE, battery_bar, start_mark, vehicle
from aquaquad_envs.sensing.laser import detectable_radius, illuminated_radius
from aquaquad_envs.tasks.laser_tracking_sensing import LEAST_HEIGHT

HEADER, MAP, GAP, SIDE, FOOTER = 54, 540, 8, 128, 40
WATER: Color = (226, 239, 246)
DEEP: Color = (187, 214, 229)
GRID: Color = (205, 222, 232)
LIT: Color = (205, 232, 205)
DETECTABLE: Color = (150, 208, 160)
ROV: Color = (74, 68, 58)
#: Shown about the light, as a multiple of the greatest distance at the start, and of the detectable radius.
_REACH, _RADII = 1.4, 6.0
#: Pieces of tracks are no shorter.
_LEAST_PX = 3.0


class Picture:
    """Paints laser tracking worlds of ``batch``; the light stays in the middle, the grid of metres moves."""

    size = (MAP + 2 * MARGIN, HEADER + MAP + GAP + SIDE + FOOTER)

    def __init__(self, batch: Any) -> None:
        self._params, self._constants, self._outcomes = batch.params, batch.constants, batch.task.outcomes
        half_width = max(_REACH * batch.params.start_distance_m, _RADII * batch.constants.radius)
        self.view = View(MARGIN, HEADER, MAP, float(half_width))
        self._center = (0.0, 0.0)
        self.track: list[tuple[float, float, bool]] = []
        self.rov_track: list[tuple[float, float]] = []
        self._last_s = -1.0

    def restart(self) -> None:
        """Forget the tracks."""
        self.track, self.rov_track, self._last_s = [], [], -1.0

    def paint(self, canvas: Canvas, world: np.void) -> None:
        """Paint ``world`` on ``canvas``."""
        if float(world["time_s"]) < self._last_s:
            self.restart()
        if float(world["time_s"]) > self._last_s:
            self._follow(world)
            self._last_s = float(world["time_s"])
        self._center = float(world["rov_x"]), float(world["rov_y"])
        canvas.fill(PAPER)
        canvas.clip(self.view.rectangle)
        self._paint_top(canvas, world)
        canvas.clip((MARGIN, HEADER + MAP + GAP, MAP, SIDE))
        self._paint_side(canvas, world)
        canvas.clip(None)
        for top, height in ((HEADER, MAP), (HEADER + MAP + GAP, SIDE)):
            canvas.rectangle(MARGIN, top, MAP, height, INK, line=1)
        self._paint_legend(canvas)
        self._paint_state(canvas, world)

    def _follow(self, world: np.void) -> None:
        """Lengthen the tracks, by steps that can be seen; the last point is always where the vehicle is."""
        point = (float(world["x"]), float(world["y"]), bool(world["detected"]))
        least = _LEAST_PX / self.view.pixels_per_m
        if len(self.track) > 1 and self.track[-1][2] == point[2]:
            before = self.track[-2]
            if np.hypot(self.track[-1][0] - before[0], self.track[-1][1] - before[1]) < least:
                self.track.pop()
        self.track.append(point)
        below = (float(world["rov_x"]), float(world["rov_y"]))
        if len(self.rov_track) > 1:
            last, before_last = self.rov_track[-1], self.rov_track[-2]
            if np.hypot(last[0] - before_last[0], last[1] - before_last[1]) < least:
                self.rov_track.pop()
        self.rov_track.append(below)

    def pixel(self, x: float, y: float) -> Point:
        """Pixel position on the map of a point in metres."""
        return self.view.pixel(x - self._center[0], y - self._center[1])

    def _discs(self, height: float) -> tuple[float, float]:
        beam = self._constants.beam
        return float(illuminated_radius(beam, height)), float(detectable_radius(beam, height))

    def _paint_top(self, canvas: Canvas, world: np.void) -> None:
        view = self.view
        canvas.rectangle(*view.rectangle, WATER)
        step = 1.0 if view.half_width_m <= 10 else 10.0 ** np.floor(np.log10(view.half_width_m))
        for axis in (0, 1):
            first = np.ceil((self._center[axis] - view.half_width_m) / step)
            for k in range(int(2 * view.half_width_m / step) + 1):
                at = (first + k) * step
                x, y = self.pixel(at, 0.0) if axis == 0 else self.pixel(0.0, at)
                ends = [(x, HEADER), (x, HEADER + MAP)] if axis == 0 else [(MARGIN, y), (MARGIN + MAP, y)]
                canvas.lines(ends, GRID, 1)
        light = self.pixel(*self._center)
        height = max(float(world["altitude"] + world["depth"]), LEAST_HEIGHT)
        illuminated, detectable = (radius * view.pixels_per_m for radius in self._discs(height))
        canvas.circle(light, illuminated, LIT)
        canvas.circle(light, detectable, DETECTABLE)
        canvas.circle(light, illuminated, GOAL, line=1)
        canvas.circle(light, detectable, GOAL, line=2)
        canvas.lines([self.pixel(*point) for point in self.rov_track], ROV, 1.5, dash=(5, 4))
        rov_mark(canvas, light)
        guess_mark(canvas, view.held(self.pixel(world["guess_x"], world["guess_y"]), 9))
        start_mark(canvas, self.pixel(0.0, 0.0))
        for lit, pieces in itertools.groupby(itertools.pairwise(self.track), key=lambda piece: piece[1][2]):
            line = list(pieces)
            points = [line[0][0], *(end for _, end in line)]
            canvas.lines([self.pixel(x, y) for x, y, _ in points], GOAL if lit else HOP, 2.5)
        vehicle(canvas, view.held(self.pixel(world["x"], world["y"]), 11))
        scale_bar(canvas, view, MARGIN + MAP - 10, HEADER + MAP - 14)

    def _paint_side(self, canvas: Canvas, world: np.void) -> None:
        """Along x, to the right as on the map; heights have a scale of their own."""
        top, bottom = HEADER + MAP + GAP, HEADER + MAP + GAP + SIDE
        altitude, depth = float(world["altitude"]), float(world["depth"])
        above = 1.25 * max(self._params.altitude_m, self._params.start_altitude_m, altitude)
        below = 1.25 * max(self._params.depth_m, depth)
        scale = SIDE / (above + below)
        surface = top + above * scale
        canvas.rectangle(MARGIN, top, MAP, SIDE, PAPER)
        canvas.rectangle(MARGIN, surface, MAP, bottom - surface, DEEP)
        light, rov = self.pixel(*self._center)[0], surface + depth * scale
        highest = above + depth
        for radius, color in zip(self._discs(highest), (LIT, DETECTABLE), strict=True):
            reach = radius * self.view.pixels_per_m
            canvas.polygon([(light, rov), (light - reach, top), (light + reach, top)], color)
        canvas.lines([(MARGIN, surface), (MARGIN + MAP, surface)], INK, 1)
        rov_mark(canvas, (light, rov))
        x = self.view.held(self.pixel(float(world["x"]), self._center[1]), 11)[0]
        vehicle(canvas, (x, min(surface - altitude * scale, surface - 6)))
        canvas.text((MARGIN + 6, top + 10), "from the south, heights not to scale", 14, QUIET)

    def _paint_legend(self, canvas: Canvas) -> None:
        y = HEADER + MAP + GAP + SIDE + 20.0
        x = float(MARGIN)
        for color, name in ((DETECTABLE, "detectable"), (LIT, "lit")):
            canvas.circle((x + 7, y), 7, color)
            canvas.circle((x + 7, y), 7, GOAL, line=1)
            x += 19 + canvas.text((x + 19, y), name, 17, INK) + 14
        for color, name in ((GOAL, "light seen"), (HOP, "not seen")):
            canvas.lines([(x, y), (x + 18, y)], color, 2.5)
            x += 24 + canvas.text((x + 24, y), name, 17, INK) + 14
        guess_mark(canvas, (x + 7, y))
        x += 19 + canvas.text((x + 19, y), "first guess", 17, INK) + 14
        rov_mark(canvas, (x + 8, y))
        canvas.text((x + 20, y), "ROV", 17, INK)

    def _paint_state(self, canvas: Canvas, world: np.void) -> None:
        time_s = float(world["time_s"])
        share = float(world["lda_s"]) / time_s if time_s > 0 else 0.0
        columns = (
            (0, "TIME", f"{time_s:.1f} s"),
            (88, "TIME IN LDA", f"{100 * share:.0f} %"),
            (186, "OFF CENTRE", f"{world['range_m']:.2f} m"),
            (282, "READING", f"{1e3 * world['reading']:.1f} mW/m²"),
        )
        for x, caption, value in columns:
            canvas.text((MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((MARGIN + x, 35), value, 22, INK)
        full = float(self._constants.full_scale)
        battery_bar(canvas, MARGIN + 340.0, 10.0, 90.0, 10.0, float(world["reading"]) / full)
        canvas.text((MARGIN + MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((MARGIN + MAP, 35), self._outcomes[int(world["outcome"])], 22, QUIET, align=1)


def guess_mark(canvas: Canvas, center: Point) -> None:
    """An upright cross."""
    x, y = center
    for width, color in ((5.0, WHITE), (2.5, FORECAST)):
        canvas.lines([(x - 6, y), (x + 6, y)], color, width)
        canvas.lines([(x, y - 6), (x, y + 6)], color, width)


def rov_mark(canvas: Canvas, center: Point) -> None:
    """A box with a lamp."""
    x, y = center
    canvas.rectangle(x - 8, y - 5, 16, 10, WHITE, radius=3)
    canvas.rectangle(x - 7, y - 4, 14, 8, ROV, radius=2)
    canvas.circle((x, y), 2.2, (240, 228, 66))

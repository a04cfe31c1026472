"""The picture of a transponder localization world: track, ranges, transponders and what is believed of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.rendering.beliefs import BELIEF, estimate_mark, paint_ellipse, target_mark
from aquaquad_envs.rendering.canvas import Canvas, Point
from aquaquad_envs.rendering.chart import INK, QUIET
from aquaquad_envs.rendering.sea import (
    DRIFT,
    GOAL,
    HEADER,
    HOP,
    MAP,
    MARGIN,
    VEHICLE,
    WHITE,
    SeaPicture,
    Track,
    battery_bar,
    legend_track,
    paint_track,
    start_mark,
    vehicle,
)

#: Dash and gap of the prior's ellipse, pixels. One with deviations of more half widths than this is not drawn.
_DASH = (5.0, 5.0)
_LARGEST_PRIOR = 1.0


class Picture(SeaPicture):
    """Paints transponder localization worlds of ``batch``: estimates with their 95 % ellipses, the prior's dashed."""

    def __init__(self, batch: Any) -> None:
        super().__init__(batch)
        self._flies = batch.params.vehicle == "aquaquad"
        self._turns = batch.params.vehicle == "yaw-rate"
        east, north, _ = batch.params.prior_std_m
        self._prior = np.diag([east**2, north**2])
        self._shows_prior = max(east, north) < _LARGEST_PRIOR * self._half_width
        self.track = Track()

    def restart(self) -> None:
        """Forget the track."""
        self.track.restart()

    def paint_legend(self, canvas: Canvas, x: float, y: float) -> float:
        """Track, places of measurement, transponders, estimates and their priors."""
        if self._flies:
            x = legend_track(canvas, x, y)
        else:
            canvas.lines([(x + 1, y), (x + 25, y)], INK, 4.5)
            canvas.lines([(x + 2, y), (x + 24, y)], DRIFT, 2)
            x += 31 + canvas.text((x + 31, y), "track", 17, INK) + 14
        place_mark(canvas, (x + 5, y))
        x += 14 + canvas.text((x + 14, y), "ranges", 17, INK) + 14
        target_mark(canvas, (x + 8, y))
        x += 20 + canvas.text((x + 20, y), "transponder", 17, INK) + 14
        estimate_mark(canvas, (x + 7, y))
        x += 18 + canvas.text((x + 18, y), "estimate, 95 %", 17, INK) + 14
        if not self._flies:
            prior_mark(canvas, (x + 5, y))
            x += 14 + canvas.text((x + 14, y), "prior", 17, INK) + 14
        return x

    def paint_moving(self, canvas: Canvas, world: np.void) -> None:
        """Priors, track, places of measurement, transponders, estimates, and the vehicle."""
        self.track.add(world)
        count, number = int(world["count"]), int(world["num_transponders"])
        for m in range(number):
            x, y, _ = world["prior_mean"][m]
            if self._shows_prior:
                paint_ellipse(canvas, self.view, (x, y), self._prior, dash=_DASH)
            prior_mark(canvas, self.view.pixel(x, y))
        start_mark(canvas, self.view.pixel(world["start_x"], world["start_y"]))
        paint_track(canvas, self.view, self.track.segments)
        for place in zip(world["place_x"][:count], world["place_y"][:count], strict=True):
            place_mark(canvas, self.view.pixel(*place))
        for m in range(number):
            target_mark(canvas, self.view.pixel(*world["target"][m][:2]))
            self._paint_belief(canvas, world, m)
        place = self.view.held(self.view.pixel(world["x"], world["y"]), 11)
        if self._flies:
            vehicle(canvas, place)
        else:
            boat(canvas, place, float(world["heading"]) if self._turns else None)

    def _paint_belief(self, canvas: Canvas, world: np.void, m: int) -> None:
        xx, xy, xz, yy, yz, zz = world["information"][m]
        covariance = np.linalg.inv([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        x, y, _ = world["estimate"][m]
        paint_ellipse(canvas, self.view, (x, y), covariance[:2, :2])
        estimate_mark(canvas, self.view.pixel(x, y))

    def paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The header: time, ranges, information, error, the battery of the aquaquad, outcome."""
        number = int(world["num_transponders"])
        error = world["estimate"][:number] - world["target"][:number]
        time_s = float(world["time_s"])
        columns = [
            (0, "TIME", f"{time_s / 3600:.1f} h" if time_s >= 3600 else f"{time_s:.0f} s"),
            (70, "MEASUREMENTS", f"{world['count']} of {self._params.num_measurements}"),
            (184, "LN DET", f"{world['log_det']:.1f}"),
            (254, "ERROR", f"{np.sqrt(np.mean(np.sum(error**2, -1))):.3g} m"),
        ]
        for x, caption, value in columns:
            canvas.text((MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((MARGIN + x, 35), value, 22, INK)
        if self._flies:
            canvas.text((MARGIN + 350, 15), "BATTERY", 13, QUIET)
            share = float(world["battery_wh"]) / float(self._params.battery_wh)
            battery_bar(canvas, MARGIN + 350.0, 29.0, 110.0, 10.0, share)
        outcome = self._outcomes[int(world["outcome"])]
        color = {"running": QUIET, "time out": GOAL}.get(outcome, HOP)
        canvas.text((MARGIN + MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((MARGIN + MAP, HEADER - 19), outcome, 22, color, align=1)


def place_mark(canvas: Canvas, center: Point) -> None:
    """A dot: where ranges were measured."""
    canvas.circle(center, 3.2, WHITE)
    canvas.circle(center, 2.2, INK)


def prior_mark(canvas: Canvas, center: Point) -> None:
    """A ring: the first estimate."""
    canvas.circle(center, 5.0, WHITE, line=3.5)
    canvas.circle(center, 4.2, BELIEF, line=1.8)


def boat(canvas: Canvas, center: Point, heading: float | None) -> None:
    """A vehicle at the surface: an arrowhead along its heading, a disc where it has none."""
    if heading is None:
        canvas.circle(center, 7.5, INK)
        canvas.circle(center, 5.5, VEHICLE)
        return
    for size, color in ((11.0, INK), (7.0, VEHICLE)):
        points = []
        for angle, reach in ((0.0, 1.0), (2.5, 0.85), (np.pi, 0.35), (-2.5, 0.85)):
            turn = heading + angle
            points.append((center[0] + size * reach * np.cos(turn), center[1] - size * reach * np.sin(turn)))
        canvas.polygon(points, color)

"""The picture of a drift/hop world: current, obstacles, track, goal, vehicle, battery."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.rendering.canvas import OVERSAMPLING, Canvas, Color, Point
from aquaquad_envs.rendering.chart import INK, PAPER, QUIET, View, arrows, round_up, scale_bar, speed_colors

WHITE: Color = (255, 255, 255)
DRIFT: Color = WHITE
#: Okabe and Ito's vermillion, green (darkened) and yellow: told apart from blue water and from each other by every
#: kind of colour vision. Drift and hop differ in dash and weight too.
HOP: Color = (213, 94, 0)
GOAL: Color = (0, 112, 82)
VEHICLE: Color = (240, 228, 66)
LAND: Color = (150, 142, 128)
LAND_EDGE: Color = (74, 68, 58)
FORECAST: Color = (120, 70, 130)

_HEADER, _FOOTER, _MARGIN, _MAP = 54, 62, 18, 604
#: Share of the half-width that is shown beyond the box.
_BEYOND = 0.05
_ARROWS = 15
#: Samples a side of the speed map; fields are far coarser.
_SAMPLES = 302
#: s; a current that changes with time is drawn anew this often.
_TIME_BUCKET_S = 300.0
_GOAL_MIN_PX = 11.0
_FIELDS_KEPT = 16


class Segment(NamedTuple):
    """Part of a track flown in one go, or drifted: positions in m, (n, 2)."""

    is_hop: bool
    points: list[tuple[float, float]]


class Track:
    """Where the vehicle has been, learnt from the world records of successive draws.

    Between two draws the way is a straight line: a hop if the world's ``hops`` rose in between,
    else a drift. What came before the first draw is not known.
    """

    def __init__(self) -> None:
        self.segments: list[Segment] = []
        self._last: tuple[float, int] | None = None
        self._point = (0.0, 0.0)

    def restart(self) -> None:
        """Forget it all."""
        self.segments, self._last = [], None

    def add(self, world: np.void) -> None:
        """Go on to the position of ``world``; a clock that went back begins a new track."""
        point, time_s, hops = (
            (float(world["x"]), float(world["y"])),
            float(world["time_s"]),
            int(world["hops"]),
        )
        if self._last is not None and (time_s < self._last[0] or hops < self._last[1]):
            self.restart()
        if self._last is not None and time_s > self._last[0]:
            is_hop = hops > self._last[1]
            if not self.segments or self.segments[-1].is_hop != is_hop:
                self.segments.append(Segment(is_hop, [self._point]))
            self.segments[-1].points.append(point)
        self._last, self._point = (time_s, hops), point


class Picture:
    """Paints drift/hop worlds of ``batch``: the true current at the world's present time, and all the rest.

    The parts that seldom change (map, obstacles, arrows, legend) are kept until field, obstacles
    or, every 5 min of a current that changes, time make them stale.
    """

    size = (_MAP + 2 * _MARGIN, _HEADER + _MAP + _FOOTER)

    def __init__(self, batch: Any) -> None:
        self._params, self._ocean, self._outcomes = batch.params, batch.ocean, batch.task.outcomes
        self._half_width = float(batch.params.half_width_m)
        self.view = View(_MARGIN, _HEADER, _MAP, self._half_width * (1 + _BEYOND))
        self.track = Track()
        # What is kept, each with what it was painted for.
        self._frame: tuple[Any, Any] = (None, None)
        self._still: tuple[Any, Any] = (None, None)
        self._land: Any = None
        self._fields: dict[int, tuple[CurrentField, float]] = {}

    def restart(self) -> None:
        """Forget the track."""
        self.track.restart()

    def paint(self, canvas: Canvas, world: np.void) -> None:
        """Paint ``world`` on ``canvas``."""
        self.track.add(world)
        time_s = float(world["clock_s"] + world["time_s"])
        steady = self._ocean.velocity.shape[1] == 1
        bucket = 0 if steady else round(time_s / _TIME_BUCKET_S)
        fields = (int(world["truth"]), int(world["forecast"]), int(world["obstacle"]))
        if self._frame[0] != fields:
            self._paint_frame(canvas, *fields)
            self._frame, self._still = (fields, canvas.save()), (None, None)
        if self._still[0] != bucket:
            canvas.restore(self._frame[1])
            self._paint_sea(canvas, *fields, bucket * _TIME_BUCKET_S)
            self._still = (bucket, canvas.save())
        canvas.restore(self._still[1])
        canvas.clip(self.view.rectangle)
        self._paint_ends(canvas, world)
        self._paint_track(canvas)
        vehicle(canvas, self.view.held(self.view.pixel(world["x"], world["y"]), 11))
        canvas.clip(None)
        self._paint_state(canvas, world)

    # What seldom changes

    def _field(self, k: int) -> tuple[CurrentField, float]:
        """Current field ``k``, and the speed that is drawn darkest, m/s."""
        if k not in self._fields:
            axes = self._ocean.axes
            velocity = self._ocean.velocity[k]
            field = CurrentField(
                velocity=velocity, grid=Grid(axes.x0, axes.y0, axes.spacing), time0_s=axes.time0,
                time_step_s=axes.time_step, interpolation="cell" if axes.by_cell else "bilinear",
            )  # fmt: skip
            # A field may reach far beyond the box; one wild node must not make all else pale.
            rows, columns = velocity.shape[1:3]
            x, y = field.grid.nodes(rows, columns)
            inside = np.maximum(abs(x), abs(y)) <= self._half_width + axes.spacing
            speed = np.hypot(velocity[..., 0], velocity[..., 1])[:, inside]
            if len(self._fields) >= _FIELDS_KEPT:
                self._fields.clear()
            self._fields[k] = (field, round_up(float(np.quantile(speed, 0.995))))
        return self._fields[k]

    def _arrow_scale(self, truth: int) -> float:
        """Pixels per m/s: the darkest speed fills a cell of the arrows' lattice."""
        return 0.92 * self.view.side / (1 + _BEYOND) / _ARROWS / self._field(truth)[1]

    def _paint_frame(self, canvas: Canvas, truth: int, forecast: int, obstacle: int) -> None:
        """What does not change with time: the legend; the map of obstacles is prepared."""
        canvas.fill(PAPER)
        self._paint_legend(canvas, self._field(truth)[1], self._arrow_scale(truth), forecast != truth)
        self._land = canvas.image(self._land_colors(obstacle), _MAP, _MAP)

    def _paint_sea(self, canvas: Canvas, truth: int, forecast: int, obstacle: int, time_s: float) -> None:
        view, (field, top_speed) = self.view, self._field(truth)
        current = field.sample(*view.points(_SAMPLES), time_s)
        colors = speed_colors(np.hypot(current[..., 0], current[..., 1]) / top_speed)
        canvas.clip(view.rectangle)
        canvas.paste(canvas.image(colors, _MAP, _MAP), view.left, view.top)
        canvas.paste(self._land, view.left, view.top)
        scale = self._arrow_scale(truth)
        if forecast != truth:
            self._paint_arrows(canvas, forecast, obstacle, time_s, scale, FORECAST)
        self._paint_arrows(canvas, truth, obstacle, time_s, scale, INK)
        self._paint_box(canvas)
        canvas.clip(None)

    def _paint_arrows(
        self, canvas: Canvas, k: int, obstacle: int, time_s: float, pixels_per_m_s: float, color: Color
    ) -> None:
        x, y = (part.ravel() for part in View(0, 0, 1, self._half_width).points(_ARROWS))
        wet = self._clearance(obstacle, x, y) >= 0
        x, y = x[wet], y[wet]
        current = self._field(k)[0].sample(x, y, time_s)
        centers = np.stack([self.view.pixel(*point) for point in zip(x, y, strict=True)])
        slow = np.hypot(current[:, 0], current[:, 1]) * pixels_per_m_s < 2.5
        for center in centers[slow]:
            canvas.circle(center, 1.2, color)
        for corners in arrows(centers[~slow], current[~slow], pixels_per_m_s):
            canvas.polygon(corners, color)

    def _clearance(self, obstacle: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        out = np.empty(x.shape)
        ocean = self._ocean
        _sample_clearance(ocean.clearance, obstacle, ocean.clearance_grid, x.ravel(), y.ravel(), out.ravel())
        return out

    def _land_colors(self, obstacle: int) -> np.ndarray:
        """Colours with opacity of obstacles (solid, hatched), their margin (hatched) and its edge."""
        side = _MAP * OVERSAMPLING
        clear = self._clearance(obstacle, *self.view.points(side))
        margin = float(self._params.obstacle_margin_m)
        colors = np.zeros((side, side, 4), dtype=np.uint8)
        hatch = np.add.outer(np.arange(side), np.arange(side)) % 20 < 3
        edge = 2.2 / (self.view.pixels_per_m * OVERSAMPLING)
        colors[clear < 0] = (*LAND, 110)
        colors[(clear < 0) & hatch] = (*LAND_EDGE, 130)
        colors[clear < -margin] = (*LAND, 255)
        colors[(clear < -margin) & hatch] = (128, 120, 107, 255)
        colors[abs(clear + margin) < edge] = (*LAND_EDGE, 255)
        colors[abs(clear) < edge] = (*LAND_EDGE, 255)
        return colors

    def _paint_box(self, canvas: Canvas) -> None:
        """The mission box, and what lies beyond it veiled."""
        left, top, side, _ = self.view.rectangle
        beyond = side * _BEYOND / (1 + _BEYOND) / 2
        inner = side - 2 * beyond
        veil = (*PAPER, 150)
        canvas.rectangle(left, top, side, beyond, veil)
        canvas.rectangle(left, top + side - beyond, side, beyond, veil)
        canvas.rectangle(left, top + beyond, beyond, inner, veil)
        canvas.rectangle(left + side - beyond, top + beyond, beyond, inner, veil)
        canvas.rectangle(left + beyond, top + beyond, inner, inner, INK, line=1)
        for x, y in self._ocean.team:
            listener(canvas, self.view.pixel(x, y))

    def _paint_legend(self, canvas: Canvas, top_speed: float, pixels_per_m_s: float, forecast: bool) -> None:
        x, y = float(_MARGIN), _HEADER + _MAP + 18.0
        canvas.lines([(x + 1, y), (x + 29, y)], INK, 4.5)
        canvas.lines([(x + 2, y), (x + 28, y)], DRIFT, 2)
        x += 36 + canvas.text((x + 36, y), "drift", 17, INK) + 18
        _hop_line(canvas, [(x, y), (x + 32, y)])
        x += 40 + canvas.text((x + 40, y), "hop", 17, INK) + 18
        start_mark(canvas, (x + 6, y))
        x += 17 + canvas.text((x + 17, y), "start", 17, INK) + 18
        goal_mark(canvas, (x + 9, y), 9)
        x += 24 + canvas.text((x + 24, y), "goal", 17, INK) + 18
        if len(self._ocean.team):
            listener(canvas, (x + 7, y))
            x += 19 + canvas.text((x + 19, y), "team", 17, INK) + 18
        canvas.rectangle(x, y - 6, 18, 12, LAND)
        canvas.rectangle(x, y - 6, 18, 12, LAND_EDGE, line=1)
        canvas.text((x + 25, y), "obstacle or land", 17, INK)

        x, y = float(_MARGIN), y + 25
        x += canvas.text((x, y), "current", 17, INK) + 10
        x += canvas.text((x, y), "0", 17, INK) + 6
        canvas.paste(canvas.image(speed_colors(np.linspace(0, 1, 220))[None], 110, 12), x, y - 6)
        canvas.rectangle(x, y - 6, 110, 12, QUIET, line=0.5)
        x += 116
        x += canvas.text((x, y), f"{top_speed:g} m/s", 17, INK) + 18
        length = pixels_per_m_s * top_speed
        for color, name in ((INK, f"= {top_speed:g} m/s"), (FORECAST, "forecast"))[: 2 if forecast else 1]:
            canvas.polygon(arrows(np.array([(x + length / 2, y)]), np.array([(1.0, 0.0)]), length)[0], color)
            x += length + 7
            x += canvas.text((x, y), name, 17, INK) + 18
        scale_bar(canvas, self.view, _MARGIN + _MAP, y)

    # What changes with every step

    def _paint_ends(self, canvas: Canvas, world: np.void) -> None:
        start_mark(canvas, self.view.pixel(world["start_x"], world["start_y"]))
        radius = max(_GOAL_MIN_PX, float(self._params.goal_radius_m) * self.view.pixels_per_m)
        goal_mark(canvas, self.view.pixel(world["goal_x"], world["goal_y"]), radius)

    def _paint_track(self, canvas: Canvas) -> None:
        pixels = [[self.view.pixel(*point) for point in segment.points] for segment in self.track.segments]
        pairs = list(zip(self.track.segments, pixels, strict=True))
        for wanted in (False, True):
            for segment, line in pairs:
                if segment.is_hop == wanted and wanted:
                    _hop_line(canvas, line)
                elif segment.is_hop == wanted:
                    canvas.lines(line, INK, 4.5)
                    canvas.lines(line, DRIFT, 2)
        for segment, line in pairs:
            if segment.is_hop:
                for end in (line[0], line[-1]):
                    canvas.circle(end, 4, WHITE)
                    canvas.circle(end, 3, HOP)

    def _paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The header: time, energy, hops, battery, outcome."""
        battery, capacity = float(world["battery_wh"]), float(self._params.battery_wh)
        columns = (
            (0, "TIME", f"{world['time_s'] / 3600:.1f} h"),
            (88, "FLIGHT ENERGY", f"{world['flight_wh']:.1f} Wh"),
            (222, "HOPS", f"{world['hops']}"),
            (282, "BATTERY", f"{battery:.0f} of {capacity:.0f} Wh"),
        )
        for x, caption, value in columns:
            canvas.text((_MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((_MARGIN + x, 35), value, 22, INK)
        left, top, width, height = _MARGIN + 282.0 + 62, 10.0, 150.0, 10.0
        share = min(max(battery / capacity, 0.0), 1.0)
        canvas.rectangle(left, top, width, height, (218, 223, 229), radius=3)
        if share > 0:
            canvas.rectangle(left, top, max(share * width, 3), height, HOP if share < 0.2 else GOAL, radius=3)
        outcome = self._outcomes[int(world["outcome"])]
        color = {"running": QUIET, "goal": GOAL}.get(outcome, HOP)
        canvas.text((_MARGIN + _MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((_MARGIN + _MAP, 35), outcome, 22, color, align=1)


@loop_kernel
def _sample_clearance(distance, k, grid, x, y, out):
    for i in range(x.size):
        out[i] = clearance_at(distance, k, grid, x[i], y[i])


def _hop_line(canvas: Canvas, line: list[Point]) -> None:
    canvas.lines(line, WHITE, 6)
    canvas.lines(line, HOP, 3.5, dash=(9, 6))


def start_mark(canvas: Canvas, center: Point) -> None:
    """A white square."""
    x, y = center
    canvas.rectangle(x - 6, y - 6, 12, 12, INK)
    canvas.rectangle(x - 4, y - 4, 8, 8, WHITE)


def goal_mark(canvas: Canvas, center: Point, radius: float) -> None:
    """A ring of ``radius`` pixels about a dot."""
    canvas.circle(center, radius + 1.5, WHITE, line=5.5)
    canvas.circle(center, radius, GOAL, line=2.5)
    canvas.circle(center, 4, WHITE)
    canvas.circle(center, 2.5, GOAL)


def listener(canvas: Canvas, center: Point) -> None:
    """A triangle: a sensor of the team."""
    x, y = center
    canvas.polygon([(x, y - 8), (x + 8, y + 6), (x - 8, y + 6)], INK)
    canvas.polygon([(x, y - 4.5), (x + 5, y + 4), (x - 5, y + 4)], WHITE)


def vehicle(canvas: Canvas, center: Point) -> None:
    """A quadcopter seen from above."""
    x, y = center
    for dx, dy in itertools.product((-5.0, 5.0), repeat=2):
        canvas.lines([(x, y), (x + dx, y + dy)], INK, 3)
        canvas.circle((x + dx, y + dy), 4.2, INK)
        canvas.circle((x + dx, y + dy), 3, VEHICLE)
    canvas.circle((x, y), 4, INK)
    canvas.circle((x, y), 2.8, VEHICLE)

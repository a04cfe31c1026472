"""What pictures of every task at sea share: current, obstacles, the box, tracks, and what marks look like."""

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

HEADER, FOOTER, MARGIN, MAP = 54, 62, 18, 604
#: Share of the half-width that is shown beyond the box.
_BEYOND = 0.05
_ARROWS = 15
#: Samples a side of the speed map; fields are far coarser.
_SAMPLES = 302
#: s; a current that changes with time is drawn anew this often.
_TIME_BUCKET_S = 300.0
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

    def add(self, world: Any) -> None:
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


class SeaPicture:
    """Paints the sea of worlds of ``batch``: the true current at the world's present time, obstacles, the box.

    A task's picture adds the legend (``paint_legend``, the place up to which it reached), what does not move
    (``paint_fixed``), what does (``paint_moving``) and the header (``paint_state``). The parts that seldom change (map,
    obstacles, arrows, legend) are kept until field, obstacles or, every 5 min of a current that changes, time
    make them stale.
    """

    size = (MAP + 2 * MARGIN, HEADER + MAP + FOOTER)

    def __init__(self, batch: Any) -> None:
        self._params, self._ocean, self._outcomes = batch.params, batch.ocean, batch.task.outcomes
        self._half_width = float(batch.params.half_width_m)
        self.view = View(MARGIN, HEADER, MAP, self._half_width * (1 + _BEYOND))
        # What is kept, each with what it was painted for.
        self._frame: tuple[Any, Any] = (None, None)
        self._still: tuple[Any, Any] = (None, None)
        self._land: Any = None
        self._fields: dict[int, tuple[CurrentField, float]] = {}

    def restart(self) -> None:
        """A new episode begins."""

    def paint_legend(self, canvas: Canvas, x: float, y: float) -> float:
        """The task's marks from (x, y) on; returns where they end."""
        return x

    def paint_fixed(self, canvas: Canvas) -> None:
        """What never moves, under all that does."""

    def paint_moving(self, canvas: Canvas, world: np.void) -> None:
        """Everything on the map that moves."""

    def paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The header."""

    def paint(self, canvas: Canvas, world: np.void) -> None:
        """Paint ``world`` on ``canvas``."""
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
        self.paint_moving(canvas, world)
        canvas.clip(None)
        self.paint_state(canvas, world)

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
        self._land = canvas.image(self._land_colors(obstacle), MAP, MAP)

    def _paint_sea(self, canvas: Canvas, truth: int, forecast: int, obstacle: int, time_s: float) -> None:
        view, (field, top_speed) = self.view, self._field(truth)
        current = field.sample(*view.points(_SAMPLES), time_s)
        colors = speed_colors(np.hypot(current[..., 0], current[..., 1]) / top_speed)
        canvas.clip(view.rectangle)
        canvas.paste(canvas.image(colors, MAP, MAP), view.left, view.top)
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
        side = MAP * OVERSAMPLING
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
        self.paint_fixed(canvas)

    def _paint_legend(self, canvas: Canvas, top_speed: float, pixels_per_m_s: float, forecast: bool) -> None:
        y = HEADER + MAP + 18.0
        x = self.paint_legend(canvas, float(MARGIN), y)
        canvas.rectangle(x, y - 6, 18, 12, LAND)
        canvas.rectangle(x, y - 6, 18, 12, LAND_EDGE, line=1)
        canvas.text((x + 25, y), "obstacle or land", 17, INK)

        x, y = float(MARGIN), y + 25
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
        scale_bar(canvas, self.view, MARGIN + MAP, y)


@loop_kernel
def _sample_clearance(distance, k, grid, x, y, out):
    for i in range(x.size):
        out[i] = clearance_at(distance, k, grid, x[i], y[i])


def paint_track(canvas: Canvas, view: View, segments: list[Segment]) -> None:
    """A track: drifts under hops, whose ends are marked."""
    pixels = [[view.pixel(*point) for point in segment.points] for segment in segments]
    pairs = list(zip(segments, pixels, strict=True))
    for wanted in (False, True):
        for segment, line in pairs:
            if segment.is_hop == wanted and wanted:
                hop_line(canvas, line)
            elif segment.is_hop == wanted:
                canvas.lines(line, INK, 4.5)
                canvas.lines(line, DRIFT, 2)
    for segment, line in pairs:
        if segment.is_hop:
            for end in (line[0], line[-1]):
                canvas.circle(end, 4, WHITE)
                canvas.circle(end, 3, HOP)


def hop_line(canvas: Canvas, line: list[Point]) -> None:
    """A dashed line: a flight."""
    canvas.lines(line, WHITE, 6)
    canvas.lines(line, HOP, 3.5, dash=(9, 6))


def start_mark(canvas: Canvas, center: Point) -> None:
    """A white square."""
    x, y = center
    canvas.rectangle(x - 6, y - 6, 12, 12, INK)
    canvas.rectangle(x - 4, y - 4, 8, 8, WHITE)


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


def battery_bar(canvas: Canvas, left: float, top: float, width: float, height: float, share: float) -> None:
    """How full a battery is, 0 to 1."""
    share = min(max(share, 0.0), 1.0)
    canvas.rectangle(left, top, width, height, (218, 223, 229), radius=3)
    if share > 0:
        canvas.rectangle(left, top, max(share * width, 3), height, HOP if share < 0.2 else GOAL, radius=3)


def legend_track(canvas: Canvas, x: float, y: float) -> float:
    """The legend of drifts and hops; returns where it ends."""
    canvas.lines([(x + 1, y), (x + 29, y)], INK, 4.5)
    canvas.lines([(x + 2, y), (x + 28, y)], DRIFT, 2)
    x += 36 + canvas.text((x + 36, y), "drift", 17, INK) + 18
    hop_line(canvas, [(x, y), (x + 32, y)])
    x += 40 + canvas.text((x + 40, y), "hop", 17, INK) + 18
    return x

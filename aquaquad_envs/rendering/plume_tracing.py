"""The picture of a plume tracing world: plume, source and team from above, and from the south with their depths."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.rendering.canvas import Canvas, Color, Point
from aquaquad_envs.rendering.chart import INK, PAPER, QUIET, arrows, scale_bar, speed_colors
from aquaquad_envs.rendering.sea import GOAL, HEADER, HOP, MAP, MARGIN, VEHICLE, WHITE, SeaPicture
from aquaquad_envs.sensing.plume import KINDS, PLUME

PLUME_COLOR: Color = (122, 62, 20)
SOURCE: Color = (150, 0, 90)
DETECTS: Color = HOP
#: Height of the view from the south and what lies between it and the map, pixels.
DEPTH, GAP = 112, 10
_LEGEND = 62
#: Samples along a side of the plume's image.
_SAMPLES = 151
#: Share of the greatest opacity at the detection floor of a layer as thick as the puffs' first width.
_OPAQUE = 200.0


class Picture(SeaPicture):
    """Paints plume tracing worlds of ``batch``: robots, their tracks, puffs, source, and a view with depths."""

    size = (MAP + 2 * MARGIN, HEADER + MAP + GAP + DEPTH + _LEGEND)

    def __init__(self, batch: Any) -> None:
        super().__init__(batch)
        self._robots, self._depth = int(batch.params.num_robots), float(batch.params.water_depth_m)
        self._puffs = batch.constants.puffs if KINDS[batch.params.field] == PLUME else None
        self._floor = float(batch.params.detection_floor)
        self.tracks: list[list[tuple[float, float, float]]] = [[] for _ in range(self._robots)]
        self._time_s = -1.0

    def restart(self) -> None:
        """Forget all tracks."""
        self.tracks = [[] for _ in range(self._robots)]
        self._time_s = -1.0

    # Still water has no land, and its map no arrows.

    def _clearance(self, obstacle: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.ones(x.shape)

    def _land_colors(self, obstacle: int) -> np.ndarray:
        return np.zeros((2, 2, 4), dtype=np.uint8)

    def _paint_legend(self, canvas: Canvas, top_speed: float, pixels_per_m_s: float, forecast: bool) -> None:
        y = HEADER + MAP + GAP + DEPTH + 18.0
        x = float(MARGIN)
        for mark, name in ((_quiet_robot, "robot"), (_robot, "robot that detects"), (_source, "source")):
            mark(canvas, (x + 7, y))
            x += 19 + canvas.text((x + 19, y), name, 17, INK) + 18
        if self._puffs is not None:
            canvas.rectangle(x, y - 6, 18, 12, (*PLUME_COLOR[:3], 130))
            canvas.text((x + 25, y), "plume", 17, INK)
        x, y = float(MARGIN), y + 25
        if self._params.current == "still":
            canvas.text((x, y), "still water", 17, INK)
        else:
            x += canvas.text((x, y), "current", 17, INK) + 10
            x += canvas.text((x, y), "0", 17, INK) + 6
            canvas.paste(canvas.image(speed_colors(np.linspace(0, 1, 220))[None], 110, 12), x, y - 6)
            x += 116
            x += canvas.text((x, y), f"{top_speed:g} m/s", 17, INK) + 18
            length = pixels_per_m_s * top_speed
            tip = arrows(np.array([(x + length / 2, y)]), np.array([(1.0, 0.0)]), length)[0]
            canvas.polygon(tip, INK)
            canvas.text((x + length + 7, y), f"= {top_speed:g} m/s", 17, INK)
        scale_bar(canvas, self.view, MARGIN + MAP, y)

    def paint_moving(self, canvas: Canvas, world: np.void) -> None:
        """Plume, tracks, source and robots from above."""
        if float(world["time_s"]) < self._time_s:
            self.restart()
        self._time_s = float(world["time_s"])
        for i, track in enumerate(self.tracks):
            track.append((float(world["x"][i]), float(world["y"][i]), float(world["z"][i])))
        if self._puffs is not None:
            canvas.paste(canvas.image(self.plume_colors(world), MAP, MAP), self.view.left, self.view.top)
        for track in self.tracks:
            canvas.lines([self.view.pixel(x, y) for x, y, _ in track], INK, 1.5)
        _source(canvas, self.view.pixel(float(world["source_x"]), float(world["source_y"])))
        for i in range(self._robots):
            mark = _robot if world["reading"][i] > 0 else _quiet_robot
            mark(canvas, self.view.held(self.view.pixel(world["x"][i], world["y"][i]), 8))

    def plume_colors(self, world: np.void, *, from_south: bool = False) -> np.ndarray:
        """The plume with opacity, summed along the line of sight: uint8 (rows, columns, 4), top row first."""
        assert self._puffs is not None
        terms, alive = self._puffs, min(int(world["released"]), self._puffs.size)
        spread2 = terms.first_spread2 + terms.growth * (world["time_s"] - world["puff_birth"][:alive])
        half = self.view.half_width_m
        x = np.linspace(-half, half, _SAMPLES)
        across = _bells(x, world["puff_x"][:alive], spread2)
        if from_south:
            z = np.linspace(0.0, self._depth, 41)
            places = world["puff_z"][:alive]
            up = sum(_bells(z, image, spread2) for image in (places, -places, 2 * self._depth - places))
        else:
            up = _bells(x[::-1], world["puff_y"][:alive], spread2)
        density = terms.amount * (up @ across.T)
        # A layer as thick as a few puffs, at the floor of the sensors: the faintest that matters.
        least = max(self._floor, 1e-6) * np.sqrt(terms.first_spread2)
        opacity = _OPAQUE * (1.0 - np.exp(-density / (20.0 * least)))
        colors = np.empty((*density.shape, 4), dtype=np.uint8)
        colors[..., :3] = PLUME_COLOR[:3]
        colors[..., 3] = opacity
        return colors

    def side_pixel(self, x: float, z: float) -> Point:
        """Pixel of a place in the view from the south: ``x`` m east at depth ``z`` m."""
        left = self.view.left + (x + self.view.half_width_m) * self.view.pixels_per_m
        return left, HEADER + MAP + GAP + DEPTH * min(max(z / self._depth, 0.0), 1.0)

    def paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The view from the south, and the header: update, distances, detections, outcome."""
        self._paint_side(canvas, world)
        distance = world["distance"][: self._robots]
        detecting = int((world["reading"][: self._robots] > 0).sum())
        columns = (
            (0, "UPDATE", f"{int(world['updates'])}"), (80, "CLOSEST", f"{distance.min():.1f} m"),
            (180, "MEAN", f"{distance.mean():.1f} m"), (280, "FURTHEST", f"{distance.max():.1f} m"),
            (380, "DETECTING", f"{detecting} of {self._robots}"),
        )  # fmt: skip
        for x, caption, value in columns:
            canvas.text((MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((MARGIN + x, 35), value, 22, INK)
        outcome = self._outcomes[int(world["outcome"])]
        if outcome != "reached" and world["reached_at"] >= 0:
            outcome = f"reached at {int(world['reached_at'])}"
        color = GOAL if outcome.startswith("reached") else QUIET
        canvas.text((MARGIN + MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((MARGIN + MAP, HEADER - 19), outcome, 22, color, align=1)

    def _paint_side(self, canvas: Canvas, world: np.void) -> None:
        top = HEADER + MAP + GAP
        canvas.rectangle(MARGIN, top, MAP, DEPTH, PAPER)
        canvas.clip((MARGIN, top, MAP, DEPTH))
        if self._puffs is not None:
            image = canvas.image(self.plume_colors(world, from_south=True), MAP, DEPTH)
            canvas.paste(image, MARGIN, top)
        for track in self.tracks:
            canvas.lines([self.side_pixel(x, z) for x, _, z in track], INK, 1.5)
        canvas.clip(None)
        canvas.rectangle(MARGIN, top, MAP, DEPTH, INK, line=1)
        canvas.text((MARGIN + 6, top + 9), "from the south: surface", 14, QUIET)
        canvas.text((MARGIN + 6, top + DEPTH - 9), f"bottom, {self._depth:g} m", 14, QUIET)
        _source(canvas, self.side_pixel(float(world["source_x"]), float(world["source_z"])))
        for i in range(self._robots):
            mark = _robot if world["reading"][i] > 0 else _quiet_robot
            mark(canvas, self.side_pixel(float(world["x"][i]), float(world["z"][i])))


def _bells(places: np.ndarray, centers: np.ndarray, spread2: np.ndarray) -> np.ndarray:
    """Normal densities (places, puffs), 1/m."""
    square = (places[:, None] - centers) ** 2
    return np.exp(-0.5 * square / spread2) / np.sqrt(2.0 * np.pi * spread2)


def _disc(canvas: Canvas, center: Point, color: Color) -> None:
    canvas.circle(center, 6.0, WHITE)
    canvas.circle(center, 5.0, INK)
    canvas.circle(center, 3.6, color)


def _quiet_robot(canvas: Canvas, center: Point) -> None:
    """A robot that reads nothing: yellow."""
    _disc(canvas, center, VEHICLE)


def _robot(canvas: Canvas, center: Point) -> None:
    """A robot that reads something: vermillion, with a ring."""
    canvas.circle(center, 8.5, DETECTS, line=1.5)
    _disc(canvas, center, DETECTS)


def _source(canvas: Canvas, center: Point) -> None:
    """A diamond."""
    x, y = center
    for size, color in ((10.0, WHITE), (8.0, SOURCE)):
        canvas.polygon([(x, y - size), (x + size, y), (x, y + size), (x - size, y)], color)

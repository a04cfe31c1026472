"""A drawing surface with smooth lines and text, in memory: needs no screen and no video system."""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

#: Everything is drawn this much larger, then reduced: pygame's own thick lines are jagged.
OVERSAMPLING = 2

Color = tuple[int, int, int] | tuple[int, int, int, int]
Point = tuple[float, float]


def import_pygame() -> Any:
    """The pygame module, without its greeting. Raises ``ImportError`` with the remedy if it is missing."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "hide")
    try:
        with warnings.catch_warnings():
            # Some versions use setuptools' deprecated pkg_resources.
            warnings.simplefilter("ignore")
            import pygame
    except ImportError as error:
        raise ImportError('Rendering needs pygame: pip install "aquaquad-envs[render]"') from error
    return pygame


class Canvas:
    """A picture of ``width`` by ``height`` pixels; positions and sizes in pixels, y down, fractions allowed."""

    def __init__(self, width: int, height: int) -> None:
        self._pygame = import_pygame()
        self.width, self.height = width, height
        self._surface = self._pygame.Surface((width * OVERSAMPLING, height * OVERSAMPLING), 0, 32)

    def to_surface(self) -> Any:
        """The finished picture, a new pygame surface."""
        return self._pygame.transform.smoothscale(self._surface, (self.width, self.height))

    def to_array(self) -> np.ndarray:
        """The finished picture, a new uint8 array (height, width, 3)."""
        data = self._pygame.image.tobytes(self.to_surface(), "RGB")
        return np.frombuffer(data, dtype=np.uint8).reshape(self.height, self.width, 3).copy()

    def save(self) -> Any:
        """What is drawn so far, for :meth:`restore`."""
        return self._surface.copy()

    def restore(self, saved: Any) -> None:
        """Go back to what :meth:`save` kept."""
        self._surface.blit(saved, (0, 0))

    def clip(self, rectangle: tuple[float, float, float, float] | None) -> None:
        """Draw only within (left, top, width, height); None: anywhere."""
        self._surface.set_clip(None if rectangle is None else [round(v * OVERSAMPLING) for v in rectangle])

    def fill(self, color: Color) -> None:
        """Paint all of it."""
        self._surface.fill(color)

    def rectangle(
        self, left: float, top: float, width: float, height: float, color: Color, *,
        line: float = 0.0, radius: float = 0.0,
    ) -> None:  # fmt: skip
        """A rectangle, filled or drawn with a line inside its edge; a fourth colour component is opacity."""
        box = [round(value * OVERSAMPLING) for value in (left, top, width, height)]
        style = (round(line * OVERSAMPLING), round(radius * OVERSAMPLING))
        if len(color) == 3:
            self._pygame.draw.rect(self._surface, color, box, *style)
            return
        layer = self._pygame.Surface(box[2:], self._pygame.SRCALPHA, 32)
        self._pygame.draw.rect(layer, color, layer.get_rect(), *style)
        self._surface.blit(layer, box[:2])

    def polygon(self, points: Sequence[Point] | np.ndarray, color: Color) -> None:
        """A filled polygon."""
        self._pygame.draw.polygon(self._surface, color, [_scaled(point) for point in points])

    def circle(self, center: Point, radius: float, color: Color, *, line: float = 0.0) -> None:
        """A disc, or a ring whose line lies inside ``radius``."""
        self._pygame.draw.circle(
            self._surface, color, _scaled(center), radius * OVERSAMPLING, round(line * OVERSAMPLING)
        )

    def lines(
        self, points: Sequence[Point], color: Color, width: float, *, dash: tuple[float, float] | None = None
    ) -> None:
        """A line through ``points`` with round ends; ``dash`` gives lengths of (mark, gap)."""
        pieces = list(itertools.pairwise(points)) if dash is None else dashes(points, *dash)
        radius = width / 2
        for (x0, y0), (x1, y1) in pieces:
            length = float(np.hypot(x1 - x0, y1 - y0))
            if length > 0:
                nx, ny = radius * (y0 - y1) / length, radius * (x1 - x0) / length
                self.polygon(
                    [(x0 + nx, y0 + ny), (x1 + nx, y1 + ny), (x1 - nx, y1 - ny), (x0 - nx, y0 - ny)], color
                )
            if width > 1.5:
                self.circle((x0, y0), radius, color)
                self.circle((x1, y1), radius, color)

    def image(self, colors: np.ndarray, width: float, height: float) -> Any:
        """An image to :meth:`paste`: uint8 (rows, columns, 3 or 4 with opacity), top row first, stretched."""
        # In the byte order of the surface itself, which pygame copies several times faster.
        opacity = colors[..., 3:] if colors.shape[2] == 4 else np.full((*colors.shape[:2], 1), 255, np.uint8)
        ordered = np.concatenate([colors[..., 2::-1], opacity], axis=-1)
        image = self._pygame.image.frombuffer(ordered.tobytes(), colors.shape[1::-1], "BGRA")
        if colors.shape[2] == 3:
            image.set_alpha(None)
        size = (round(width * OVERSAMPLING), round(height * OVERSAMPLING))
        return image if image.get_size() == size else self._pygame.transform.smoothscale(image, size)

    def paste(self, image: Any, left: float, top: float) -> None:
        """Put an :meth:`image` with its upper left corner at (left, top)."""
        self._surface.blit(image, (round(left * OVERSAMPLING), round(top * OVERSAMPLING)))

    def text(self, position: Point, text: str, size: int, color: Color, *, align: float = 0.0) -> float:
        """One line of text, vertically centred at ``position``; ``align`` 0 left, 0.5 centre, 1 right.

        In pygame's own font, the same on every machine. Returns the width.
        """
        if not self._pygame.font.get_init():
            self._pygame.font.init()
        # Opened anew each time: whoever else uses pygame may have quit its fonts in between.
        drawn = self._pygame.font.Font(None, size * OVERSAMPLING).render(text, True, color)
        x, y = _scaled(position)
        self._surface.blit(drawn, (round(x - align * drawn.get_width()), round(y - drawn.get_height() / 2)))
        return drawn.get_width() / OVERSAMPLING


def _scaled(point: Any) -> tuple[float, float]:
    return float(point[0]) * OVERSAMPLING, float(point[1]) * OVERSAMPLING


def dashes(points: Sequence[Point], mark: float, gap: float) -> list[tuple[Point, Point]]:
    """The marks of a dashed line through ``points``; the pattern runs on around corners."""
    marks: list[tuple[Point, Point]] = []
    along = 0.0
    period = mark + gap
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        length = float(np.hypot(x1 - x0, y1 - y0))
        if length == 0:
            continue
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        first = int(np.floor(along / period))
        for k in range(first, int(np.floor((along + length) / period)) + 1):
            begin = max(k * period - along, 0.0)
            end = min(k * period + mark - along, length)
            if end > begin:
                marks.append(((x0 + ux * begin, y0 + uy * begin), (x0 + ux * end, y0 + uy * end)))
        along += length
    return marks

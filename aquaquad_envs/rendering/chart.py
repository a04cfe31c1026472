"""What charts of every task share: the view from metres to pixels, current arrows, colours of speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquaquad_envs.rendering.canvas import Canvas, Color, Point

INK: Color = (20, 33, 51)
PAPER: Color = (250, 251, 252)
QUIET: Color = (96, 108, 122)

#: Colours of speed from none to most: even steps of lightness in one blue (OKLab L 0.975 to 0.545), so that
#: order shows in grey and to every kind of colour vision, and dark arrows stay legible on the darkest.
_SPEED_ANCHORS = np.array(
    [(238, 249, 250), (187, 227, 234), (144, 201, 221), (107, 173, 208), (77, 144, 196), (58, 113, 181)],
    dtype=np.float64,
)


def speed_colors(share: np.ndarray) -> np.ndarray:
    """Colours, uint8 (..., 3), of speeds as a share of the greatest; held at 0 and 1."""
    table = np.stack(
        [
            np.interp(np.linspace(0, 1, 256), np.linspace(0, 1, len(_SPEED_ANCHORS)), component)
            for component in _SPEED_ANCHORS.T
        ],
        axis=-1,
    )
    index = np.rint(255 * np.clip(share, 0.0, 1.0)).astype(np.intp)
    return table.round().astype(np.uint8)[index]


def round_up(value: float) -> float:
    """The least of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten that is ``value`` or more; 1 for 0."""
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return next(
        float(step * power) for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * power >= value * (1 - 1e-9)
    )


@dataclass(frozen=True)
class View:
    """A square of the sea, ``half_width_m`` about the origin, on ``side`` pixels at (left, top).

    x is east and to the right, y north and up.
    """

    left: float
    top: float
    side: float
    half_width_m: float

    @property
    def rectangle(self) -> tuple[float, float, float, float]:
        """(left, top, width, height) in pixels."""
        return self.left, self.top, self.side, self.side

    @property
    def pixels_per_m(self) -> float:
        """Scale."""
        return self.side / (2 * self.half_width_m)

    def pixel(self, x: float, y: float) -> Point:
        """Pixel position of a point in metres."""
        scale = self.pixels_per_m
        return self.left + (x + self.half_width_m) * scale, self.top + (self.half_width_m - y) * scale

    def held(self, point: Point, margin: float) -> Point:
        """A pixel position moved into the view, ``margin`` from its edge."""
        low, high = margin, self.side - margin
        return (
            self.left + min(max(point[0] - self.left, low), high),
            self.top + min(max(point[1] - self.top, low), high),
        )

    def points(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Centres of ``count`` by ``count`` cells in metres, (rows, columns), top row first."""
        centers = ((np.arange(count) + 0.5) / count * 2 - 1) * self.half_width_m
        return np.meshgrid(centers, centers[::-1])


def arrows(centers: np.ndarray, velocities: np.ndarray, pixels_per_m_s: float) -> np.ndarray:
    """Corners, (n, 7, 2) pixels with y down, of arrows along velocities (n, 2) about ``centers`` (n, 2), tip first.

    Velocities have u to the right and v up. An arrow's length is ``pixels_per_m_s`` times its speed;
    heads of short arrows shrink with them.
    """
    centers, velocities = np.asarray(centers, dtype=np.float64), np.asarray(velocities, dtype=np.float64)
    speed = np.hypot(velocities[:, 0], velocities[:, 1])
    along = velocities * (1, -1) / np.maximum(speed, 1e-12)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], -1)
    length = pixels_per_m_s * speed
    head = np.minimum(8.0, 0.6 * length)
    shaft, wing = np.minimum(0.8, 0.2 * head), 0.42 * head
    tip, neck, barb = length / 2, length / 2 - 0.8 * head, length / 2 - head
    a = np.stack([tip, barb, neck, -tip, -tip, neck, barb], -1)
    b = np.stack([0 * tip, wing, shaft, shaft, -shaft, -shaft, -wing], -1)
    return centers[:, None] + a[..., None] * along[:, None] + b[..., None] * across[:, None]


def scale_bar(canvas: Canvas, view: View, right: float, y: float) -> None:
    """A bar of a round length in ``view``, its label ending at ``right``."""
    length_m = round_up(0.1 * 2 * view.half_width_m)
    length = length_m * view.pixels_per_m
    label = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    x = right - canvas.text((right, y), label, 17, INK, align=1) - 7 - length
    canvas.lines([(x, y - 4), (x, y + 4)], INK, 1.5)
    canvas.lines([(x + length, y - 4), (x + length, y + 4)], INK, 1.5)
    canvas.lines([(x, y), (x + length, y)], INK, 2)

"""A renderer turns world records into arrays, or shows them in a window."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice
from aquaquad_envs.rendering.canvas import Canvas, import_pygame

RENDER_MODES = ("rgb_array", "human")


class Renderer:
    """Draws the successive states of one world.

    ``picture`` has ``size`` (width, height), ``restart()`` and ``paint(canvas, world)``. Every
    array is fresh. In a window, closing it is the viewer's choice and never disturbs what is being
    shown: further draws do nothing, and only a new renderer opens a new window.
    """

    def __init__(self, picture: Any, render_mode: str, fps: float, title: str) -> None:
        self._picture = picture
        self._canvas = Canvas(*picture.size)
        self._window = _Window(picture.size, fps, title) if render_mode == "human" else None

    def draw(self, world: np.void) -> np.ndarray | None:
        """The picture of ``world`` as uint8 (height, width, 3); None in a window, where it is shown."""
        if self._window is not None and not self._window.is_open():
            return None
        self._picture.paint(self._canvas, world)
        if self._window is None:
            return self._canvas.to_array()
        self._window.show(self._canvas)
        return None

    def restart(self) -> None:
        """A new episode begins: forget the track."""
        self._picture.restart()

    def close(self) -> None:
        """Close the window, if any; an array renderer goes on working."""
        if self._window is not None:
            self._window.close()


class _Window:
    """A pygame window that keeps a frame rate; opened at the first look, closed by its viewer or ``close``."""

    def __init__(self, size: tuple[int, int], fps: float, title: str) -> None:
        self._size, self._fps, self._title = size, fps, title
        self._surface: Any = None
        self._clock: Any = None
        self._closed = False

    def is_open(self) -> bool:
        """Whether it can be drawn on, after the viewer's clicks so far."""
        if self._closed:
            return False
        pygame = import_pygame()
        if self._surface is None:
            self._open(pygame)
        # Another program part may have quit the display or made a window of its own.
        if pygame.display.get_surface() is not self._surface:
            self._closed = True
            return False
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
        return not self._closed

    def _open(self, pygame: Any) -> None:
        try:
            pygame.display.init()
            self._surface = pygame.display.set_mode(self._size)
        except pygame.error as error:
            raise InvalidParameterError(
                "render_mode", "human", f"a screen to open a window on ({error})",
                'Without one use render_mode="rgb_array".',
            ) from error  # fmt: skip
        pygame.display.set_caption(self._title)
        self._clock = pygame.time.Clock()

    def show(self, canvas: Canvas) -> None:
        """Put the picture on the screen, then wait for the rest of the frame."""
        pygame = import_pygame()
        self._surface.blit(canvas.to_surface(), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window for good."""
        if not self._closed and self._surface is not None:
            pygame = import_pygame()
            if pygame.display.get_surface() is self._surface:
                pygame.display.quit()
        self._closed = True


def make_renderer(batch: Any, render_mode: str, fps: float) -> Renderer:
    """A renderer of the worlds of ``batch``, ``render_mode`` "rgb_array" or "human" (``fps`` frames/s at most).

    The picture of task ``some-task`` is the class ``Picture`` in ``rendering/some_task.py``. Raises
    ``InvalidParameterError`` for another mode, a task without a picture, or no screen to open a window
    on, and ``ImportError`` without pygame.
    """
    check_choice("render_mode", render_mode, RENDER_MODES)
    import_pygame()
    name = f"aquaquad_envs.rendering.{batch.task.name.replace('-', '_')}"
    if importlib.util.find_spec(name) is None:
        raise InvalidParameterError("task", batch.task.name, "a task that has a picture")
    picture = importlib.import_module(name).Picture(batch)
    return Renderer(picture, render_mode, fps, f"AquaQuad Envs: {batch.task.name}")

"""The picture of the published laser simulations, flown again, as PNG bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from evaluation.figures import _figure, _png

_BLUE, _ORANGE, _GREEN = "#0072b2", "#d55e00", "#009e73"


def draw(
    searched: dict[str, np.ndarray], swung: dict[str, np.ndarray], flights: dict[str, dict[str, np.ndarray]]
) -> bytes:
    """A panel a figure: search, passes with the filter's band, and each case's first run."""
    figure, axes = _figure(12.0, 9.5, nrows=4, ncols=3)
    panels = axes.ravel()
    _flight(panels[0], searched, "6.2: concentric search, no light")
    _swings(panels[1], swung)
    for panel, (name, traces) in zip(panels[2:], flights.items(), strict=True):
        _flight(panel, traces, name)
    for panel in panels:
        panel.grid(color="#dddddd", linewidth=0.6)
        panel.tick_params(labelsize=7)
        panel.set_xlabel("time, s", fontsize=8)
    for panel in axes[:, 0]:
        panel.set_ylabel("north, m", fontsize=8)
    return _png(figure)


def _flight(panel: Any, traces: dict[str, np.ndarray], title: str) -> None:
    times = float(traces["dt"]) * np.arange(1, len(traces["x"]) + 1)
    centre, w = traces["centre"][:, 0], float(traces["radius"])
    panel.fill_between(times, centre - w, centre + w, color=_ORANGE, alpha=0.2, linewidth=0)
    panel.plot(times, centre, color=_ORANGE, linewidth=1.0)
    panel.plot(times, traces["x"][:, 0], color=_BLUE, linewidth=1.2)
    panel.set_title(title, fontsize=9)


def _swings(panel: Any, traces: dict[str, np.ndarray]) -> None:
    times, w = traces["times"], float(traces["radius"])
    error = traces["estimate"] - traces["x"]
    panel.fill_between(
        times, -2 * traces["std"] / w, 2 * traces["std"] / w, color=_GREEN, alpha=0.3, linewidth=0
    )
    panel.plot(times, error / w, color=_BLUE, linewidth=1.0)
    panel.plot(times, traces["light"], color=_ORANGE, linewidth=1.0)
    panel.set_ylim(-1.5, 1.5)
    panel.set_title("6.4: passes; error in w, ± 2 deviations, light (orange)", fontsize=9)

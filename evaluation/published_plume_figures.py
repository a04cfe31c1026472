"""Pictures of the published study of plume tracing, run again, as PNG bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from evaluation.figures import _figure, _png
from evaluation.published_plume_values import COLUMNS, STARTS

_BLUE, _ORANGE, _GREEN = "#0072b2", "#e69f00", "#009e73"
_COLOURS = dict(zip(COLUMNS, (_BLUE, _GREEN, _ORANGE), strict=True))
_AXES = {"noise": ("sensor noise, %", 100.0), "position": ("position error, m", 1.0)}
_RANGE_M = (0.01, 60.0)
#: Share of the axis between the marks of published and ours.
_ASIDE = 0.012


def draw(found: dict[str, Any], drawn: dict[str, Any]) -> dict[str, bytes]:
    """Both figures by name."""
    return {"plume": errors(found), "plume-orientation": orientation(drawn)}


def errors(found: dict[str, Any]) -> bytes:
    """Distances at the end against noise and position error, for both starts."""
    figure, axes = _figure(12.0, 7.0, nrows=2, ncols=2)
    for row, start in zip(axes, STARTS, strict=True):
        for axis, (name, (label, scale)) in zip(row, _AXES.items(), strict=True):
            for variant, shift, style in (
                ("published", 1.0, {}),
                ("product", 2.0, {"markerfacecolor": "white"}),
            ):
                chosen = [r for r in found[name] if r["start"] == start and r["variant"] == variant]
                levels = scale * np.array([r["level"] for r in chosen])
                aside = shift * _ASIDE * np.ptp(levels)
                for column, colour in _COLOURS.items():
                    mean, std = (
                        np.array([r["ours"][column][key] for r in chosen]) for key in ("mean", "std")
                    )
                    below = np.minimum(std, 0.999 * mean)
                    axis.errorbar(
                        levels + aside, mean, yerr=np.stack([below, std]), fmt="o", color=colour, markersize=5,
                        capsize=2, linewidth=1.0, **style,
                    )  # fmt: skip
                    if variant == "published":
                        theirs = [r["published"][column] for r in chosen]
                        axis.plot(levels, theirs, "x", color=colour, markersize=8, label=COLUMNS[column])
            axis.set_yscale("log")
            axis.set_ylim(*_RANGE_M)  # bars that reach down to nothing would take all the room
            axis.set(xlabel=label, ylabel="distance to the source, m", title=start)
            axis.grid(color="#dddddd", linewidth=0.6)
    axes[0, 0].legend(fontsize=8, title="published")
    return _png(figure)


def orientation(drawn: dict[str, Any]) -> bytes:
    """Tracks of the published starts under both lights, and the share of random teams that reach the lamp."""
    figure, axes = _figure(12.0, 4.2, nrows=1, ncols=3)
    for axis, (kind, places) in zip(axes, drawn["tracks"].items(), strict=False):
        axis.plot(places[..., 0], places[..., 1], linewidth=1.2)
        axis.plot(places[0, :, 0], places[0, :, 1], "o", color="white", markeredgecolor="black", markersize=5)
        axis.plot(0.0, 0.0, "*", color="#f0e442", markeredgecolor="black", markersize=11)
        axis.set(xlabel="x, m", ylabel="y, m", title=f"{kind}: {len(places) - 1} updates")
        axis.set_aspect("equal")
    for kind, colour in zip(drawn["tracks"], (_BLUE, _ORANGE), strict=True):
        squares = [square for square in drawn["squares"] if square["field"] == kind]
        axes[2].plot(
            [square["furthest_m"] for square in squares], [100 * square["reached"] for square in squares], "o-",
            color=colour, label=kind,
        )  # fmt: skip
    axes[2].set(
        xlabel="furthest robot at the start, m (mean)", ylabel="teams that reach the lamp, %", ylim=(-3, 103)
    )
    axes[2].grid(color="#dddddd", linewidth=0.6)
    axes[2].legend(fontsize=8)
    return _png(figure)

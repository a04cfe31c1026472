"""Pictures of the published tracking, HDOP and placement results, run again, as PNG bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from evaluation.figures import _figure, _png
from evaluation.placement import Placement
from evaluation.published_laboratory import STOPS_HALF_WIDTH_M, y_sensors
from evaluation.published_maps import TARGET, TDOA_PAIR
from evaluation.published_tracking import MODELS, PERIMETERS, Setting, comparison_track
from evaluation.published_values import FILTERS, LABORATORY, MAPS

_BLUE, _ORANGE, _GREEN, _RED = "#0072b2", "#e69f00", "#009e73", "#d55e00"
_SENSOR = {"marker": "^", "s": 45, "color": _RED, "edgecolors": "black", "linewidths": 0.6, "zorder": 4}
_TARGET = {"marker": "s", "s": 36, "color": "white", "edgecolors": "black", "linewidths": 1.0, "zorder": 5}


def filters(curves: dict[str, Any]) -> bytes:
    """The two perimeters, and each filter's RMS error of position over time."""
    figure, axes = _figure(12.0, 7.0, nrows=2, ncols=2, width_ratios=(1, 2.1))
    colours = dict(zip(MODELS, (_BLUE, _ORANGE), strict=True))
    for row, perimeter in zip(axes, PERIMETERS, strict=True):
        track = comparison_track(perimeter)
        sensors = track.sensors[::2000] / 1e3
        row[0].plot(track.truth[::2000, 0] / 1e3, track.truth[::2000, 1] / 1e3, color="black", linewidth=1.5)
        for i in range(sensors.shape[1]):
            row[0].plot(sensors[:, i, 0], sensors[:, i, 1], color=_RED, linewidth=1.5)
        row[0].scatter(*sensors[0].T, **_SENSOR)
        row[0].scatter(0, 0, **_TARGET)
        row[0].set_aspect("equal")
        row[0].set(xlabel="east, km", ylabel="north, km", title=f"perimeter: {perimeter}")
        for model, label in MODELS.items():
            for wrap, style in ((True, "-"), (False, (0, (1, 1.5)))):
                for method, width in (("ekf", 4.0), ("ukf", 1.3)):
                    row[1].semilogy(
                        curves["times"], curves[f"{perimeter} {Setting(method, model, wrap)}"], linestyle=style,
                        linewidth=width, alpha=0.45 if method == "ekf" else 1.0, color=colours[model],
                        label=f"{method.upper()}, {label}, {'wrapped' if wrap else 'not wrapped'}",
                    )  # fmt: skip
        row[1].axvline(FILTERS["ukf"]["converged_s"]["position"], color="grey", linewidth=0.8, linestyle="--")
        row[1].set(
            xlabel="time, s (dashed: published convergence of the UKF)", ylabel="RMS error of position, m"
        )
        row[1].grid(color="#dddddd", linewidth=0.6)
    axes[0, 1].legend(fontsize=7, ncols=2, loc="upper right")
    return _png(figure)


def laboratory(curves: dict[str, Any]) -> bytes:
    """The first run: the walk in the room, its error and its HDOP."""
    figure, axes = _figure(12.0, 3.8, nrows=1, ncols=2, width_ratios=(1, 2.4))
    half = LABORATORY["room_m"] / 2
    axes[0].plot(*curves["walk"].T, color="black", linewidth=1.0)
    axes[0].scatter(*y_sensors().T, **_SENSOR)
    axes[0].scatter(*LABORATORY["target"], **_TARGET)
    axes[0].add_patch(_square(STOPS_HALF_WIDTH_M))
    axes[0].set(
        xlim=(-half, half), ylim=(-half, half), xlabel="x, m", ylabel="y, m", title="the room, first run"
    )
    axes[0].set_aspect("equal")
    axes[1].plot(curves["times"], curves["error"], color=_BLUE, linewidth=1.2, label="error, m")
    axes[1].set(xlabel="time, s", ylabel="error of position, m")
    right = axes[1].twinx()
    right.semilogy(
        curves["times"],
        np.minimum(curves["hdop"], 1e6),
        color=_ORANGE,
        linewidth=1.0,
        label="HDOP at the target",
    )
    right.set_ylabel("HDOP, m/s")
    for key in ("rests_until_s", "centre_at_s"):
        axes[1].axvline(LABORATORY[key], color="grey", linewidth=0.8, linestyle="--")
    handles = [*axes[1].get_lines()[:1], *right.get_lines()]
    axes[1].legend(handles, [line.get_label() for line in handles], fontsize=8, loc="upper left")
    return _png(figure)


def _square(half: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((-half, -half), 2 * half, 2 * half, fill=False, edgecolor="grey", linestyle=":")


def maps(drawn: dict[str, Any]) -> bytes:
    """HDOP where one vehicle moves: TDOA, bearing, range; and the distance to the goal."""
    figure, axes = _figure(12.0, 10.0, nrows=2, ncols=2)
    team, goal = np.array(MAPS["team"]), np.array(MAPS["goal"])
    panels = (
        (
            "tdoa",
            "TDOA, third sensor moves",
            "HDOP, m/s (cut at 10 000)",
            np.array(TDOA_PAIR),
            np.array(TARGET),
        ),
        ("bearing", "bearings, fourth vehicle moves", "HDOP, m/rad", team, np.array(TARGET)),
        ("distance", "distance to the goal", "m", team, goal),
        ("range", "ranges, fourth vehicle moves (not published)", "HDOP", team, np.array(TARGET)),
    )
    axis = drawn["axis"] / 1e3
    for panel, (name, title, unit, sensors, target) in zip(axes.flat, panels, strict=True):
        values = np.minimum(drawn[name], 1e4) if name == "tdoa" else drawn[name]
        # Singular cells stay white.
        shown = np.ma.masked_invalid(np.where(np.isfinite(drawn[name]), values, np.nan))
        mesh = panel.pcolormesh(axis, axis, shown, cmap="viridis", shading="nearest", rasterized=True)
        finite = shown.compressed()
        levels = np.unique(np.quantile(finite, np.linspace(0.1, 0.9, 7)))
        panel.contour(axis, axis, shown, levels=levels, colors="white", linewidths=0.5, alpha=0.7)
        panel.scatter(*(sensors / 1e3).T, **_SENSOR)
        for number, place in enumerate(sensors / 1e3, 1):
            inward = -0.35 * np.sign(place)
            panel.text(
                *(place + inward), str(number), ha="center", va="center", fontsize=8,
                bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
            )  # fmt: skip
        panel.scatter(*(target / 1e3), **_TARGET)
        panel.set(title=title, xlabel="east, km", ylabel="north, km")
        panel.set_aspect("equal")
        figure.colorbar(mesh, ax=panel, label=unit, shrink=0.85)
    return _png(figure)


def placement(ways: dict[str, list[Placement]]) -> bytes:
    """The ways of all tries (dots) to their local optima (triangles), a panel for each start and measurement."""
    names = list(ways)
    figure, axes = _figure(11.0, 5.0 * len(names) / 2, nrows=len(names) // 2, ncols=2)
    colours = (_BLUE, _ORANGE, _GREEN, _RED, "#cc79a7")
    for panel, name in zip(axes.flat, names, strict=True):
        kind, start, standoff = name.split()
        for colour, one in zip(colours, ways[name], strict=False):
            for i in range(one.path.shape[1]):
                panel.plot(*one.path[:, i].T, ".-", color=colour, markersize=3, linewidth=0.5, alpha=0.55)
            panel.scatter(*one.path[0].T, marker="o", s=14, facecolors="none", edgecolors=colour)
            panel.scatter(*one.sensors.T, marker="^", s=34, color=colour, edgecolors="black", linewidths=0.5)
        panel.scatter(0, 0, marker="s", s=30, color="black", zorder=5)
        apart = f", at least {float(standoff):g} m away" if float(standoff) else ""
        panel.set(title=f"{kind}, {start} start{apart}", xlabel="east, m", ylabel="north, m")
        if float(standoff):
            angle = np.linspace(0, 2 * np.pi, 200)
            panel.plot(
                *(float(standoff) * np.array([np.cos(angle), np.sin(angle)])), color="black", linewidth=0.8
            )
        panel.set_aspect("equal", adjustable="datalim")
    return _png(figure)

"""Pictures of the published results of transponder localization, run again, as PNG bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.map_estimator_statistics import confidence_ellipse
from evaluation.figures import _figure, _png
from evaluation.published_localization_values import EPOCHS, TABLES

#: By steps ahead.
_COLOURS = ("#7f7f7f", "#56b4e9", "#009e73", "#0072b2")
_STAR = {"marker": "*", "color": "#f0e442", "markeredgecolor": "black", "markersize": 10, "linestyle": ""}


def evolution(courses: dict[tuple[str, int, int], Any]) -> bytes:
    """Σ ln det and RMS error over measurements: look-ahead and greedy, M = 1 and 4."""
    figure, axes = _figure(12.0, 8.0, nrows=4, ncols=2, sharex=True)
    for i, (name, M) in enumerate((name, M) for name in ("msla", "greedy") for M in (1, 4)):
        left, right = axes[i]
        for (m, k), cells in TABLES[name]["cells"].items():
            if m != M:
                continue
            course = courses[name, M, k]
            epochs = np.arange(1, len(course.log_det) + 1)
            left.plot(epochs, course.log_det.mean(1), color=_COLOURS[k], linewidth=1.5, label=f"k = {k}")
            right.semilogy(
                epochs,
                np.sqrt(course.square_error.mean(1)),
                color=_COLOURS[k],
                linewidth=1.5,
                label=f"k = {k}",
            )
            # Side by side, or they would hide each other.
            at = np.array(EPOCHS) + 0.3 * (k - 1.5)
            left.errorbar(
                at,
                [c[0] for c in cells],
                [c[1] for c in cells],
                fmt="o",
                markersize=3,
                color=_COLOURS[k],
                elinewidth=0.9,
            )
            right.plot(at, [c[2] for c in cells], "o", markersize=4, color=_COLOURS[k])
        left.set_ylabel(f"{'look-ahead' if name == 'msla' else name}, M = {M}\nΣ ln det Y", fontsize=8)
        right.set_ylabel("RMS error, m", fontsize=8)
        for axis in (left, right):
            axis.grid(color="#dddddd", linewidth=0.6)
            axis.tick_params(labelsize=7)
    axes[0, 0].legend(fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel("measurements (dots: published)", fontsize=8)
    return _png(figure)


def trajectories(courses: dict[tuple[str, int, int], Any]) -> bytes:
    """The first run of each row, one panel a table and number of transponders."""
    panels = [(name, M) for name, table in TABLES.items() if table["images"] for M in table["scenarios"]]
    figure, axes = _figure(13.0, 7.0, nrows=2, ncols=len(panels) // 2)
    for axis, (name, M) in zip(axes.flat, panels, strict=True):
        for m, k in TABLES[name]["cells"]:
            if m == M:
                course = courses[name, M, k]
                axis.plot(
                    *course.track.T, ".-", color=_COLOURS[k], linewidth=1.2, markersize=3.5, label=f"k = {k}"
                )
        axis.plot(*course.targets[:, :2].T, **_STAR)
        axis.plot(*course.track[0], "o", color="white", markeredgecolor="black", markersize=6)
        axis.set_title(f"{TABLES[name]['title'].lower()}, M = {M}", fontsize=8)
        axis.set_aspect("equal")
        axis.tick_params(labelsize=7)
        axis.set_xlabel("east, m", fontsize=7)
        axis.set_ylabel("north, m", fontsize=7)
    axes[0, 0].legend(fontsize=7)
    return _png(figure)


def consistency(found: dict[str, np.ndarray]) -> bytes:
    """Scatter with both ellipses, and NEES against χ² for one and four transponders."""
    from scipy.stats import chi2

    figure, axes = _figure(12.0, 4.0, nrows=1, ncols=3)
    first = axes[0]
    first.plot(*found["estimates"].T, ".", color="#56b4e9", markersize=3, label="estimates")
    for matrix, style, label in (
        (found["covariance"], "-", "95 %, estimator"),
        (found["sample"], "--", "95 %, scatter"),
    ):
        region = confidence_ellipse(matrix)
        angle = np.linspace(0.0, 2.0 * np.pi, 120)
        curve = region.directions @ (region.semi_axes_m[:, None] * np.stack([np.cos(angle), np.sin(angle)]))
        middle = found["target"] if style == "-" else found["estimates"].mean(0)
        first.plot(*(middle[:, None] + curve), style, color="black", linewidth=1.2, label=label)
    first.plot(*found["target"], **_STAR)
    first.set_aspect("equal")
    first.set(xlabel="east, m", ylabel="north, m")
    first.legend(fontsize=7)
    for axis, name, degrees in ((axes[1], "nees_1", 3), (axes[2], "nees_4", 12)):
        values = found[name]
        axis.hist(values, bins=30, density=True, color="#56b4e9")
        x = np.linspace(0.0, float(values.max()), 200)
        axis.plot(x, chi2.pdf(x, degrees), color="#d55e00", linewidth=1.5, label=f"χ²({degrees})")
        axis.set(xlabel=f"NEES, M = {degrees // 3}", ylabel="density")
        axis.legend(fontsize=8)
    return _png(figure)


def draw(drawn: dict[str, Any]) -> dict[str, bytes]:
    """All figures by name."""
    return {
        "localization": evolution(drawn["courses"]),
        "localization-tracks": trajectories(drawn["courses"]),
        "localization-consistency": consistency(drawn["fixed"]),
    }

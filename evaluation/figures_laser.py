"""The report's picture of one episode of laser tracking."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.sensing.laser import detectable_radius
from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults

_TRACK, _LIGHT = "#0072b2", "#f0e442"
#: m beyond what is drawn.
_MARGIN = 1.0


def draw_light(axis: Any, batch: WorldBatch, results: EpisodeResults, episode: int) -> str:
    """The quadrotor's track and the detectable area at the end; returns a title."""
    from matplotlib.patches import Circle

    assert results.track is not None
    world = results.worlds[episode]
    path = results.track[: int(results.decisions[episode]) + 1, episode]
    centre = np.array([world["rov_x"], world["rov_y"]])
    radius = detectable_radius(batch.constants.beam, float(world["altitude"] + world["depth"]))
    axis.add_patch(
        Circle((float(centre[0]), float(centre[1])), radius, facecolor=_LIGHT, edgecolor="none", alpha=0.5)
    )
    axis.plot(*path.T, color=_TRACK, linewidth=1.0)
    axis.plot(*path[0], "o", color="white", markeredgecolor="black", markersize=5)
    axis.plot(*centre, "*", color=_LIGHT, markeredgecolor="black", markersize=9, markeredgewidth=0.7)
    shown = np.vstack([path, centre - radius, centre + radius])
    middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
    half = 0.5 * float(np.ptp(shown, axis=0).max()) + _MARGIN
    axis.set_xlim(middle[0] - half, middle[0] + half)
    axis.set_ylim(middle[1] - half, middle[1] + half)
    axis.set_aspect("equal")
    return f"{100 * results.metrics['time_in_lda'][episode]:.0f} % in the light"

"""One episode of transponder localization: the track, its measurements, transponders and estimates."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.map_estimator import unpack
from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults
from evaluation.figures_team import ellipse

_TRACK, _ESTIMATE = "#0072b2", "#d55e00"
#: Room about what is drawn, as a share of its extent.
_ROOM = 0.12


def draw_localization(axis: Any, batch: WorldBatch, results: EpisodeResults, episode: int) -> None:
    """Draw ``episode`` of ``results`` on ``axis``, in km."""
    world = results.worlds[episode]
    places = np.stack([world["place_x"], world["place_y"]], -1)[: world["count"]] / 1e3
    axis.plot(*places.T, color=_TRACK, linewidth=1.2)
    axis.plot(*places.T, ".", color=_TRACK, markersize=3.5)
    axis.plot(*places[0], "o", color="white", markeredgecolor="black", markersize=5)
    number = int(world["num_transponders"])
    targets = world["target"][:number, :2] / 1e3
    for m in range(number):
        middle = world["estimate"][m, :2] / 1e3
        curve = ellipse(np.linalg.inv(unpack(world["information"][m]))[:2, :2]) / 1e3
        axis.plot(*(middle + curve).T, color=_ESTIMATE, linewidth=0.8)
        axis.plot(*middle, "+", color=_ESTIMATE, markersize=7)
    axis.plot(*targets.T, "*", color="#f0e442", markeredgecolor="black", markersize=8, markeredgewidth=0.6)
    if batch.task.outcomes[world["outcome"]] not in ("running", "time out"):
        axis.plot(*places[-1], "X", color="black", markersize=6, markeredgecolor="white")
    # Worlds are far larger than what happens in them.
    drawn = np.concatenate([places, targets])
    middle = 0.5 * (drawn.min(0) + drawn.max(0))
    half = (0.5 + _ROOM) * float(np.ptp(drawn, axis=0).max())
    axis.set_xlim(middle[0] - half, middle[0] + half)
    axis.set_ylim(middle[1] - half, middle[1] + half)


def localization_title(results: EpisodeResults, episode: int) -> str:
    """Error and information of an episode."""
    found = results.metrics
    return f"{found['rmse_m'][episode]:.3g} m, ln det {found['log_det'][episode]:.1f}"

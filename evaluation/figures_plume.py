"""One episode of plume tracing from above: robots, source, and the puffs at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.sensing.plume import PLUME
from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults

_SOURCE, _PUFF = "#f0e442", "#009e73"


def draw_plume(axis: Any, batch: WorldBatch, results: EpisodeResults, episode: int) -> None:
    """Draw ``episode`` of ``results`` on ``axis``, in km."""
    from matplotlib import colormaps

    assert results.track is not None
    steps = int(results.decisions[episode])
    world = results.worlds[episode]
    if batch.constants.source.kind == PLUME:
        alive = min(int(world["released"]), batch.constants.puffs.size)
        puffs = world["puff_x"][:alive] / 1e3, world["puff_y"][:alive] / 1e3
        axis.scatter(*puffs, s=6, color=_PUFF, alpha=0.35, linewidths=0)
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, batch.num_agents))
    for i, colour in enumerate(colours):
        path = results.track[: steps + 1, episode, i] / 1e3
        axis.plot(path[:, 0], path[:, 1], color=colour, linewidth=1.0)
        axis.plot(*path[0], "o", color="white", markeredgecolor=colour, markersize=3.5)
        axis.plot(*path[-1], "o", color=colour, markeredgecolor="black", markersize=4, markeredgewidth=0.5)
    axis.plot(
        world["source_x"] / 1e3, world["source_y"] / 1e3, "*", color=_SOURCE, markeredgecolor="black", markersize=9,
        markeredgewidth=0.7,
    )  # fmt: skip


def plume_title(results: EpisodeResults, episode: int) -> str:
    """Whether and when the source was reached, and how near the team ended."""
    found = {name: values[episode] for name, values in results.metrics.items()}
    if found["success"]:
        return f"{found['updates_to_source']:.0f} updates"
    return f"closest {found['closest_m']:.1f} m"

"""One episode of a team over the field: vehicles, targets, estimates, fence."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.hdop import SCALE_95
from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults
from aquaquad_envs.tasks.sensor_placement_data import RUNNING, TIME_OUT

#: Okabe and Ito's colours and three greys between: one a vehicle.
_VEHICLES = ("#0072b2", "#d55e00", "#cc79a7", "#56b4e9", "#e69f00", "#7f5f3f", "#5f5fbf", "#7f7f7f")
_TARGET, _ESTIMATE, _FENCE = "black", "#d55e00", "#009e73"


def target_tracks(batch: WorldBatch, seed: int, decisions: int) -> np.ndarray:
    """Where the targets of an episode go, (decisions + 1, targets, 2), m: no vehicle has a say in it.

    The vehicles are put back at every decision, so that the world does not end before its time.
    """
    batch.reset([seed])
    world = batch.worlds
    team = ("x", "y", "battery_wh", "agent_outcome", "outcome")
    start = {name: world[name].copy() for name in team}
    tracks = []
    for step in range(decisions + 1):
        tracks.append(np.stack([world["target_x"][0], world["target_y"][0]], -1)[: batch.params.num_targets])
        if step < decisions:
            for name, value in start.items():
                world[name] = value
            batch.step(np.zeros(batch.action_shape))
    return np.stack(tracks)


def ellipse(covariance: np.ndarray, points: int = 60) -> np.ndarray:
    """The curve (points, 2), m, about the origin that holds 95 % of a normal error of ``covariance`` (2, 2)."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return (SCALE_95 * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)).T


def draw_team(axis: Any, batch: WorldBatch, results: EpisodeResults, episode: int) -> None:
    """Draw ``episode`` of ``results`` on ``axis``, in km."""
    assert results.track is not None and results.flown is not None
    steps = int(results.decisions[episode])
    world = results.worlds[episode]
    for i in range(batch.num_agents):
        path = results.track[: steps + 1, episode, i] / 1e3
        colour = _VEHICLES[i]
        for flown, style in ((False, "-"), (True, (0, (2, 1)))):
            pieces = [
                np.vstack([path[k : k + 2], [[np.nan, np.nan]]])
                for k in range(steps)
                if bool(results.flown[k, episode, i]) == flown
            ]
            line = np.concatenate(pieces or [np.empty((0, 2))])
            axis.plot(line[:, 0], line[:, 1], color=colour, linewidth=1.2, linestyle=style)
        axis.plot(*path[0], "o", color="white", markeredgecolor=colour, markersize=4)
        alive = world["agent_outcome"][i] in (RUNNING, TIME_OUT)
        axis.plot(*path[-1], "o" if alive else "X", color=colour, markeredgecolor="black", markersize=5)
    if batch.params.num_targets:
        tracks = target_tracks(batch, int(results.seeds[episode]), steps) / 1e3
        for j in range(batch.params.num_targets):
            axis.plot(tracks[:, j, 0], tracks[:, j, 1], color=_TARGET, linewidth=1.4)
            axis.plot(*tracks[-1, j], "*", color=_TARGET, markersize=8, markeredgecolor="white")
            estimate = world["estimate"][j, :2] / 1e3
            curve = estimate + ellipse(world["covariance"][j, :2, :2]) / 1e3
            axis.plot(*estimate, "+", color=_ESTIMATE, markersize=7, markeredgewidth=1.5)
            axis.plot(curve[:, 0], curve[:, 1], color=_ESTIMATE, linewidth=1.0)
    if batch.constants.fence:
        axis.plot(*(world["fence"].T / 1e3), color=_FENCE, linewidth=2.5, alpha=0.8)


def team_title(batch: WorldBatch, results: EpisodeResults, episode: int) -> str:
    """What matters of an episode in a few words: error or coverage, and energy."""
    found = {name: values[episode] for name, values in results.metrics.items()}
    parts = []
    if np.isfinite(found["tracking_rmse_m"]):
        parts.append(f"RMSE {found['tracking_rmse_m']:.1f} m")
    if np.isfinite(found["coverage"]):
        parts.append(f"{100 * found['coverage']:.0f} % covered")
    if not batch.constants.steered:
        parts.append(f"{found['flight_energy_wh']:.0f} Wh")
    return ", ".join(parts)

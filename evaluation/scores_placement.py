"""The two ends of the score of sensor placement, computed on the very seeds that are scored.

0 is ``hold``, tracked in the same worlds; 1 the posterior Cramér–Rao bound along the tracks of a team that knows
where the targets are (``baselines.hdop_optimal.KnownTargets``). Of a fence without targets 1 is full coverage.
Nothing is typed in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from aquaquad_envs.tasks.sensor_placement_data import TEAM_LOST
from baselines import make_policy
from baselines.hdop_optimal import KnownTargets
from evaluation.scores import References


def scored_metric(metrics: dict[str, np.ndarray]) -> str:
    """What the score is made of: "tracking_rmse_m", or "coverage" where nothing is tracked."""
    return "tracking_rmse_m" if np.isfinite(metrics["tracking_rmse_m"]).any() else "coverage"


class ReferenceSolver:
    """Finds the references of episodes."""

    def solve(self, batch: WorldBatch, seeds: np.ndarray) -> References:
        """References of the episodes that ``seeds`` begin in ``batch``: RMSE, m, or coverage."""
        held = rollout(make_policy("hold", batch), batch, seeds).metrics
        metric = scored_metric(held)
        if metric == "coverage":
            return References(null=held[metric], bound=np.ones(len(seeds)))
        best = rollout(KnownTargets(batch), batch, seeds).metrics
        return References(null=held[metric], bound=best["bound_rmse_m"])


def metrics_of(results: EpisodeResults, references: References) -> dict[str, np.ndarray]:
    """All metrics, (episodes,), of the time until the team was lost; ``survived``: whether it was not.

    ``rmse_over_bound``: RMSE over the bound along the policy's own tracks.
    """
    lost = results.worlds["outcome"] == TEAM_LOST
    found = results.metrics
    ratio = np.divide(
        found["tracking_rmse_m"], found["bound_rmse_m"], out=np.full(len(lost), np.nan),
        where=found["bound_rmse_m"] > 0,
    )  # fmt: skip
    return {"survived": (~lost).astype(np.float64), **found, "rmse_over_bound": ratio}


def scores_of(results: EpisodeResults, references: References) -> np.ndarray:
    """Score of each episode.

    Tracking: ln(R_null / R) / mean of ln(R_null / R_bound), R the RMSE: errors are ratios, and one lost track must not
    outweigh all else. Coverage: (C - C_null) / mean of (1 - C_null). An episode that lost its team scores 0 at most.
    The mean over the suite divides, so that the mean score is a ratio of means; NaN where that is not positive. Not
    clipped: worse than ``hold`` is negative, and chance or a better placement can carry it over 1.
    """
    metric = scored_metric(results.metrics)
    value, null, bound = results.metrics[metric], references.null, references.bound
    if metric == "coverage":
        gain, span = value - null, bound - null
    else:
        gain, span = np.log(null) - np.log(value), np.log(null) - np.log(bound)
    usable = np.isfinite(span) & np.isfinite(gain)
    whole = span[usable].mean() if usable.any() else 0.0
    score = np.where(usable, gain / whole, np.nan) if whole > 0 else np.full(len(gain), np.nan)
    lost = results.worlds["outcome"] == TEAM_LOST
    return np.where(lost, np.minimum(score, 0.0), score)


def outcomes_of(results: EpisodeResults, batch: Any) -> dict[str, int]:
    """How often each outcome of a vehicle occurred."""
    ended = results.worlds["agent_outcome"][:, : batch.num_agents].ravel()
    counts = np.bincount(ended, minlength=len(batch.task.outcomes))
    return {name: int(count) for name, count in zip(batch.task.outcomes, counts, strict=True) if count}

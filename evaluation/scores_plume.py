"""The two ends of the score of plume tracing, computed on the very seeds that are scored.

What is scored is ``updates_to_source``, all of the horizon where the source is not reached: 0 is ``random`` in the same
worlds, 1 ``straight-line``, a team that knows where the source is. How near the rest of the team comes is reported
and not scored. Nothing is typed in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import make_policy
from evaluation.scores import References


class ReferenceSolver:
    """Finds the references of episodes."""

    def solve(self, batch: WorldBatch, seeds: np.ndarray) -> References:
        """References of the episodes that ``seeds`` begin in ``batch``: updates of the team."""
        null, bound = (
            rollout(make_policy(name, batch), batch, seeds).metrics["updates_to_source"]
            for name in ("random", "straight-line")
        )
        return References(null=null, bound=bound)


def metrics_of(results: EpisodeResults, references: References) -> dict[str, np.ndarray]:
    """All metrics, (episodes,); ``reached_after``: updates to the source of the episodes that reached it, else NaN."""
    found = results.metrics
    reached = found["success"] == 1.0
    return {**found, "reached_after": np.where(reached, found["updates_to_source"], np.nan)}


def scores_of(results: EpisodeResults, references: References) -> np.ndarray:
    """Score of each episode: (U_null - U) / mean of (U_null - U_bound), U the updates to the source.

    The mean over the suite divides, so that the mean score is a ratio of means; NaN where that is not positive. An
    episode that does not reach the source scores 0 unless ``random`` did, then less.
    """
    whole = (references.null - references.bound).mean() if len(references.null) else 0.0
    gain = references.null - results.metrics["updates_to_source"]
    return gain / whole if whole > 0 else np.full(len(gain), np.nan)


def outcomes_of(results: EpisodeResults, batch: Any) -> dict[str, int]:
    """How often each outcome occurred."""
    counts = np.bincount(results.worlds["outcome"], minlength=len(batch.task.outcomes))
    return {name: int(count) for name, count in zip(batch.task.outcomes, counts, strict=True) if count}

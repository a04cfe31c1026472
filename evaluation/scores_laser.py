"""The two ends of the score of laser tracking, computed on the very seeds that are scored.

0 is ``search-hold``, flown in the same worlds; 1 ``true-center``, which flies to the true centre at once. Nothing
is typed in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import make_policy
from evaluation.scores import References

METRIC = "time_in_lda"


class ReferenceSolver:
    """Finds the references of episodes."""

    def solve(self, batch: WorldBatch, seeds: np.ndarray) -> References:
        """Time in the detectable area of both ends, a share, in the episodes that ``seeds`` begin in ``batch``."""
        null, bound = (
            rollout(make_policy(name, batch), batch, seeds).metrics[METRIC]
            for name in ("search-hold", "true-center")
        )
        return References(null=null, bound=bound)


def metrics_of(results: EpisodeResults, references: References) -> dict[str, np.ndarray]:
    """All metrics, (episodes,); those of the time after acquisition are NaN where the light was never found."""
    return dict(results.metrics)


def scores_of(results: EpisodeResults, references: References) -> np.ndarray:
    """Score of each episode: (T - T_null) / mean of (T_bound - T_null), T the share of time in the detectable area.

    The mean over the suite divides, so that the mean score is a ratio of means; NaN where that is not positive. Not
    clipped: worse than ``search-hold`` is negative.
    """
    whole = float((references.bound - references.null).mean())
    gain = results.metrics[METRIC] - references.null
    return gain / whole if whole > 0 else np.full(len(gain), np.nan)


def outcomes_of(results: EpisodeResults, batch: Any) -> dict[str, int]:
    """How often the light was found, and how often not."""
    found = int((results.metrics["acquired"] == 1.0).sum())
    counts = {"light found": found, "never found": len(results.seeds) - found}
    return {name: count for name, count in counts.items() if count}

"""The two ends of the score of transponder localization, computed on the very seeds that are scored.

What is scored is Σ ln det of the information that the places of an episode give about the transponders *at their true
positions* (metric ``log_det_true``), a transponder. The published Σ ln det is taken at the estimates: an estimate
that errs to where the track looks better placed raises it, over any bound; it is reported, not scored. 0 is
``random``, run in the same worlds; 1 the best trajectory that was found with known transponders
(``baselines.known_transponders``), followed in the same worlds, where the same replies are missed. That is a bound up
to what its climbs did not find, and up to luck with missed replies, which it does not foresee. Nothing is typed in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from aquaquad_envs.tasks.transponder_localization_data import RUNNING, TIME_OUT
from baselines import make_policy
from baselines.known_transponders import KnownTransponders
from evaluation.scores import References


class ReferenceSolver:
    """Finds the references of episodes; a problem that several episodes share is solved once."""

    def __init__(self) -> None:
        self._plans: dict[bytes, tuple[np.ndarray, float, float]] = {}

    def solve(self, batch: WorldBatch, seeds: np.ndarray) -> References:
        """References of the episodes that ``seeds`` begin in ``batch``: Σ ln det at the truth over transponders."""
        null = rollout(make_policy("random", batch), batch, seeds)
        best = rollout(KnownTransponders(batch, memory=self._plans), batch, seeds)
        return References(null=_a_transponder(null), bound=_a_transponder(best))


def _a_transponder(results: EpisodeResults) -> np.ndarray:
    return results.metrics["log_det_true"] / results.worlds["num_transponders"]


def _lost(results: EpisodeResults) -> np.ndarray:
    return ~np.isin(results.worlds["outcome"], (RUNNING, TIME_OUT))


def metrics_of(results: EpisodeResults, references: References) -> dict[str, np.ndarray]:
    """All metrics, (episodes,). ``survived``: whether the vehicle did; ``below_bound``: ln det a transponder to it."""
    return {
        "survived": (~_lost(results)).astype(np.float64),
        **results.metrics,
        "below_bound": references.bound - _a_transponder(results),
    }


def scores_of(results: EpisodeResults, references: References) -> np.ndarray:
    """Score of each episode: (L - L_null) / mean of (L_bound - L_null), L Σ ln det at the truth over transponders.

    The mean over the suite divides, so that the mean score is a ratio of means; NaN where it is not positive. Not
    clipped: worse than ``random`` is negative. An episode that lost its vehicle scores 0 at most.
    """
    span = references.bound - references.null
    gain = _a_transponder(results) - references.null
    usable = np.isfinite(span) & np.isfinite(gain)
    whole = span[usable].mean() if usable.any() else 0.0
    score = np.where(usable, gain / whole, np.nan) if whole > 0 else np.full(len(gain), np.nan)
    return np.where(_lost(results), np.minimum(score, 0.0), score)


def outcomes_of(results: EpisodeResults, batch: Any) -> dict[str, int]:
    """How often each outcome occurred."""
    counts = np.bincount(results.worlds["outcome"], minlength=len(batch.task.outcomes))
    return {name: int(count) for name, count in zip(batch.task.outcomes, counts, strict=True) if count}

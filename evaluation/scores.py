"""The two ends of the score, computed on the very seeds that are scored.

For drift-hop 0 is direct flight, flown in the same worlds, and 1 the least flight energy on the
true field, solved on a grid. Nothing is typed in.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from baselines import make_policy

#: An episode whose two ends differ by less than this share of direct flight tells policies apart badly.
_LEAST_SPAN = 0.01


@dataclass(frozen=True, kw_only=True)
class References:
    """Energies at score 0 and score 1, Wh, (episodes,); NaN where one does not exist."""

    null: np.ndarray
    bound: np.ndarray

    @staticmethod
    def join(parts: list[References]) -> References:
        """Those of several chunks of episodes as one."""
        return References(
            null=np.concatenate([part.null for part in parts]),
            bound=np.concatenate([part.bound for part in parts]),
        )


class ReferenceSolver:
    """Finds the references of episodes, each distinct episode once.

    Two suites often share truths (``gyres`` and ``forecast-error``): episodes with equal currents,
    obstacles, starts, goals, clocks and vehicles share one bound.
    """

    def __init__(self) -> None:
        self._bounds: dict[bytes, float] = {}

    def solve(self, batch: WorldBatch, seeds: np.ndarray) -> References:
        """References of the episodes that ``seeds`` begin in ``batch``."""
        flown = rollout(make_policy("direct-flight", batch), batch, seeds)
        arrived = flown.metrics["success"] == 1.0
        batch.reset(seeds)
        keys = [_episode_key(batch, world) for world in batch.worlds]
        if any(key not in self._bounds for key in keys):
            bounds = make_policy("optimal", batch).bound_wh()  # type: ignore[attr-defined]
            for key, bound in zip(keys, bounds, strict=True):
                self._bounds[key] = float(bound) if np.isfinite(bound) else float("nan")
        return References(
            null=np.where(arrived, flown.metrics["flight_energy_wh"], np.nan),
            bound=np.array([self._bounds[key] for key in keys]),
        )


def _episode_key(batch: WorldBatch, world: np.ndarray) -> bytes:
    ocean = batch.ocean
    digest = hashlib.sha256()
    for array in (ocean.velocity[world["truth"]], ocean.clearance[world["obstacle"]]):
        digest.update(array.tobytes())
    places = [float(world[name]) for name in ("start_x", "start_y", "goal_x", "goal_y", "clock_s")]
    digest.update(repr((places, ocean.axes, ocean.clearance_grid, batch.constants)).encode())
    return digest.digest()


def metrics_of(results: EpisodeResults, references: References) -> dict[str, np.ndarray]:
    """All metrics, (episodes,), those of the way taken NaN where the episode failed."""
    arrived = results.metrics["success"] == 1.0
    metrics = {
        name: values if name == "success" else np.where(arrived, values, np.nan)
        for name, values in results.metrics.items()
    }
    # A bound of zero (drift alone arrives) has no relative gap.
    bound = np.where(references.bound > 0, references.bound, np.nan)
    metrics["optimality_gap"] = (metrics["flight_energy_wh"] - bound) / bound
    return metrics


def scores_of(results: EpisodeResults, references: References) -> np.ndarray:
    """Score of each episode: (E_null - E) / (E_null - E_bound), 0 where it failed.

    NaN, and left out of means, where a reference is missing or the two are closer than 1 % of the null's. It is
    not clipped: worse than direct flight is negative, and the grid's own error can carry it over 1.
    """
    span = references.null - references.bound
    usable = np.isfinite(span) & (span > _LEAST_SPAN * references.null)
    arrived = results.metrics["success"] == 1.0
    energy = results.metrics["flight_energy_wh"]
    score = np.divide(references.null - energy, span, out=np.full(len(span), np.nan), where=usable)
    return np.where(usable & ~arrived, 0.0, score)


def outcomes_of(results: EpisodeResults, batch: Any) -> dict[str, int]:
    """How often each outcome occurred."""
    counts = np.bincount(results.worlds["outcome"], minlength=len(batch.task.outcomes))
    return {name: int(count) for name, count in zip(batch.task.outcomes, counts, strict=True) if count}

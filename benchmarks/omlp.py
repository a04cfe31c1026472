"""How long a decision of look-ahead planning takes, beside the published time of a run.

``python benchmarks/omlp.py``. Processor time on one thread, best of repetitions, over worlds that are in the middle
of their episodes: 1 to 3 steps ahead, yaw-rate and greedy vehicle, one and four transponders, still water and
current. The published times (Garcia 2018, 5.3 and 5.5) are of a run of 50 measurements.
"""

from __future__ import annotations

import time

import numpy as np

from aquaquad_envs.tasks.batch import make_world_batch
from baselines import make_policy

WORLDS = 64
#: Decisions before the measured ones, that are spread over an episode.
MOVES = 12
REPETITIONS = 5
DECISIONS_A_RUN = 49
#: s a run, by transponders and steps ahead.
PUBLISHED = {(1, 1): 0.18, (1, 2): 0.43, (1, 3): 0.88, (4, 1): 0.24, (4, 2): 0.72, (4, 3): 1.62}
ROWS = (
    ("yaw-rate", "single", 1), ("yaw-rate", "four", 4), ("greedy", "single", 1), ("greedy", "four", 4),
    ("yaw-rate", "current", 4), ("aquaquad", "deep", 4),
)  # fmt: skip


def decision_us(vehicle: str, scenario: str, number: int, steps: int) -> float:
    """Processor time of a decision, µs."""
    batch = make_world_batch(
        "transponder-localization", WORLDS, scenario=scenario, vehicle=vehicle, num_transponders=number
    )
    seeds = np.arange(WORLDS)
    batch.reset(seeds)
    walk, policy = make_policy("random", batch), make_policy(f"omlp-{steps}", batch)
    walk.reset(seeds)
    for _ in range(MOVES):
        batch.step(walk.act(batch.observations, batch.worlds))
    running = int((~batch.finished).sum())
    policy.act(batch.observations, batch.worlds)
    best = np.inf
    for _ in range(REPETITIONS):
        begun = time.thread_time()
        policy.act(batch.observations, batch.worlds)
        best = min(best, time.thread_time() - begun)
    return 1e6 * best / running


def main() -> None:
    """Measure and print."""
    print(
        f"{'vehicle':10s}{'scenario':10s}{'M':>3s}{'k':>3s}{'µs a decision':>15s}{'published, ms':>15s}{'times':>8s}"
    )
    for vehicle, scenario, number in ROWS:
        for steps in (1, 2, 3):
            spent = decision_us(vehicle, scenario, number, steps)
            theirs = (
                PUBLISHED.get((number, steps)) if vehicle == "yaw-rate" and scenario != "current" else None
            )
            published = f"{1e3 * theirs / DECISIONS_A_RUN:15.1f}" if theirs else " " * 15
            faster = f"{1e6 * theirs / DECISIONS_A_RUN / spent:8.0f}" if theirs else ""
            print(f"{vehicle:10s}{scenario:10s}{number:3d}{steps:3d}{spent:15.1f}{published}{faster}")


if __name__ == "__main__":
    main()

"""Freeze the strata of difficulty of suite ``gyres``: ``python -m evaluation.strata`` rewrites strata_seeds.json.

Difficulty of a seed is what the baseline makes of it: flight energy of ``dr-rrt-star`` over that of the straight
flight, infinite where it does not arrive. The thirds of the candidates, by that number, are the strata.
Run it again only when episodes of given seeds change (the task's version then rises).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from rich.progress import Progress

from evaluation.benchmark import write_json
from evaluation.manifest import machine
from evaluation.rollouts import Workers, run_policy
from evaluation.suites import STRATA, STRATA_FILE, SUITES

CANDIDATES = 1200
BASELINE = "dr-rrt-star"


def split(difficulty: np.ndarray) -> list[np.ndarray]:
    """Indices of the thirds of ``difficulty``, easiest first, each in ascending order."""
    order = np.argsort(difficulty, kind="stable")
    return [np.sort(part) for part in np.array_split(order, len(STRATA))]


def main() -> int:
    """Run the baseline on all candidates and write the strata."""
    suite = next(suite for suite in SUITES["drift-hop"] if suite.name == "gyres")
    seeds = np.arange(CANDIDATES)
    begun = time.perf_counter()
    with Progress() as progress:
        bar = progress.add_task(BASELINE, total=CANDIDATES)
        results, _ = run_policy(suite, BASELINE, seeds, Workers(), lambda n: progress.advance(bar, n))
    arrived = results.metrics["success"] == 1.0
    difficulty = np.where(arrived, 1.0 - results.metrics["saving_vs_direct"], np.inf)
    parts = split(difficulty)
    bounds = [float(difficulty[part].min()) for part in parts[1:]]
    write_json(
        Path(__file__).with_name(STRATA_FILE),
        {
            "about": "seeds of suite gyres by the flight energy of the baseline over that of the straight flight",
            "made_by": "python -m evaluation.strata",
            "baseline": BASELINE,
            "params": suite.params,
            "candidates": [0, CANDIDATES],
            "terciles": bounds,
            "arrived": float(np.mean(arrived)),
            "versions": {"python": machine()["python"], **machine()["packages"]},
            "seeds": {name: seeds[part] for name, part in zip(STRATA, parts, strict=True)},
        },
    )
    print(
        f"{CANDIDATES} seeds in {time.perf_counter() - begun:.0f} s; {BASELINE} arrived in {np.mean(arrived):.1%}, "
        f"terciles of energy over direct flight {bounds[0]:.3f} and {bounds[1]:.3f}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Policies over a suite's seeds, in small chunks on a few threads.

An episode depends on its seed alone, so that chunks change nothing but memory and time. Kernels
hold no GIL; each thread has its own worlds and its own instance of the policy.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from aquaquad_envs.tasks.batch import WorldBatch, make_world_batch
from aquaquad_envs.tasks.rollout import EpisodeResults, rollout
from evaluation.policies import build_policy, description
from evaluation.scores import References, ReferenceSolver
from evaluation.suites import Suite

#: Episodes a chunk: bounds the memory of planners that keep a table a world, and how long Ctrl-C waits.
CHUNK = 8
#: Seed of the throw-away episode that loads compiled code before the clock runs.
_WARM_UP_SEED = 999_999

Part = TypeVar("Part")
Progress = Callable[[int], None]


class Interrupted(Exception):
    """The run was asked to stop."""


@dataclass
class Workers:
    """Threads that work through chunks of episodes, and the flag that stops them."""

    threads: int = min(2, os.cpu_count() or 1)

    def __post_init__(self) -> None:
        self.stop = threading.Event()

    def check(self, *_: Any) -> None:
        """Raise ``Interrupted`` once the run was asked to stop."""
        if self.stop.is_set():
            raise Interrupted

    def map(self, work: Callable[[np.ndarray], Part], seeds: np.ndarray, progress: Progress) -> list[Part]:
        """``work`` on chunks of ``seeds``, results in order; ``progress`` is told of every chunk's size."""
        chunks = np.array_split(seeds, max(1, -(-len(seeds) // CHUNK)))

        def one(chunk: np.ndarray) -> Part:
            self.check()
            part = work(chunk)
            progress(len(chunk))
            return part

        pool = ThreadPoolExecutor(self.threads, thread_name_prefix="evaluation")
        futures = [pool.submit(one, chunk) for chunk in chunks]
        try:
            return [future.result() for future in futures]
        except Exception:
            # The chunks in hand end at their next decision.
            self.stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
            self.stop.clear()
            raise
        except BaseException:
            # Ctrl-C waits for nobody.
            self.stop.set()
            raise
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


class _Mine(threading.local):
    """What one thread keeps: worlds and policy by the number of worlds."""

    def __init__(self) -> None:
        self.known: dict[int, tuple[WorldBatch, Any]] = {}


def run_policy(
    suite: Suite, name: str, seeds: np.ndarray, workers: Workers, progress: Progress
) -> tuple[EpisodeResults, dict[str, Any]]:
    """Episodes of policy ``name`` on ``seeds``, with tracks, and the policy's description."""
    described = _warm_up(suite, name)
    mine = _Mine()

    def work(chunk: np.ndarray) -> EpisodeResults:
        # A thread keeps its worlds and policies: what a planner knows of a field serves the next chunk too.
        known = mine.known
        if len(chunk) not in known:
            batch = make_batch(suite, len(chunk))
            known[len(chunk)] = batch, build_policy(name, batch)
        batch, policy = known[len(chunk)]
        return rollout(policy, batch, chunk, tracks=True, on_decision=workers.check)

    return EpisodeResults.join(workers.map(work, seeds, progress)), described


def find_references(
    suite: Suite, seeds: np.ndarray, solver: ReferenceSolver, workers: Workers, progress: Progress
) -> References:
    """The energies at score 0 and 1 on ``seeds``."""

    def work(chunk: np.ndarray) -> References:
        return solver.solve(make_batch(suite, len(chunk)), chunk)

    return References.join(workers.map(work, seeds, progress))


def make_batch(suite: Suite, num_worlds: int) -> WorldBatch:
    """Worlds of ``suite``."""
    return make_world_batch(suite.task, num_worlds, **suite.params)


def _warm_up(suite: Suite, name: str) -> dict[str, Any]:
    """Decide once in a world that does not count, so that loading code is not taken for planning."""
    batch = make_batch(suite, 1)
    policy = build_policy(name, batch)
    batch.reset(_WARM_UP_SEED)
    policy.reset(np.array([_WARM_UP_SEED]))
    policy.act(batch.observations, batch.worlds)
    return description(policy)

"""The benchmark's run: policies over suites, results kept after every one of them."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aquaquad_envs.errors import CheckpointError
from aquaquad_envs.tasks.rollout import EpisodeResults
from evaluation import manifest, statistics
from evaluation.policies import about
from evaluation.rollouts import Workers, find_references, make_batch, run_policy
from evaluation.scores import References
from evaluation.suites import Suite
from evaluation.tables import TABLES, TaskTable

SCHEMA = 1


@dataclass(eq=False)
class SuiteRun:
    """What became of one suite so far: seeds, references, and results by policy."""

    suite: Suite
    seeds: np.ndarray
    #: Stratum of each episode, "" where there are none.
    strata: np.ndarray
    notes: tuple[str, ...] = ()
    references: References | None = None
    #: Set where the suite itself cannot run, an unreadable NetCDF file for one.
    error: str | None = None
    runs: dict[str, EpisodeResults] = field(default_factory=dict)
    metrics: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    scores: dict[str, np.ndarray] = field(default_factory=dict)
    entries: list[dict[str, Any]] = field(default_factory=list)
    pairs: list[dict[str, Any]] = field(default_factory=list)

    @property
    def table(self) -> TaskTable:
        """What is shown of the suite's task."""
        return TABLES[self.suite.task]


@dataclass(eq=False)
class Benchmark:
    """One run of the benchmark; :meth:`run` fills ``suites`` and rewrites ``results.json`` as it goes.

    ``task`` heads the report. ``policies``: names for all suites, or by task where these are of several.
    ``advance(suite, policy, episodes)`` is told of progress; work on references counts as policy
    "score references".
    """

    task: str
    suites: list[Suite]
    policies: list[str] | dict[str, list[str]]
    seed: int
    output: Path
    arguments: list[str]
    episodes: int | None = None
    advance: Callable[[str, str, int], None] = lambda suite, policy, episodes: None
    runs: list[SuiteRun] = field(default_factory=list)
    complete: bool = False

    def __post_init__(self) -> None:
        self.machine = manifest.machine()
        self.manifest = manifest.run_manifest(self.arguments)
        self._begun = time.perf_counter()
        # Anything that the arguments ask for and that cannot be is said before the first minute is spent.
        self.strata = {
            (suite.task, suite.name): suite.strata_seeds(
                suite.episodes if self.episodes is None else self.episodes, self.seed
            )
            for suite in self.suites
        }
        for suite in self.suites:
            make_batch(suite, 1)

    @property
    def steps(self) -> int:
        """Episodes of work ahead, references included."""
        return sum(
            len(seeds) * (len(self.policies_of(task)) + 1)
            for (task, _), strata in self.strata.items()
            for seeds in strata.values()
        )

    def policies_of(self, task: str) -> list[str]:
        """Names of the policies that play ``task``."""
        return self.policies.get(task, []) if isinstance(self.policies, dict) else self.policies

    @property
    def tasks(self) -> list[str]:
        """Tasks of the suites, in their order."""
        return list(dict.fromkeys(suite.task for suite in self.suites))

    @property
    def crashed(self) -> list[dict[str, Any]]:
        """Entries of policies that raised an error of their own (not for want of a checkpoint)."""
        return [
            entry
            for run in self.runs
            for entry in run.entries
            if "error" in entry and entry["error"]["type"] != CheckpointError.__name__
        ]

    def run(self) -> None:
        """Run everything; what was finished is on disk whenever this ends."""
        workers = Workers()
        solvers = {task: TABLES[task].scores.ReferenceSolver() for task in self.tasks}
        self.write()
        for suite in self.suites:
            strata = self.strata[suite.task, suite.name]
            run = SuiteRun(
                suite=suite,
                seeds=np.concatenate(list(strata.values())),
                strata=np.repeat(list(strata), [len(seeds) for seeds in strata.values()]),
            )
            self.runs.append(run)
            self._run_suite(run, workers, solvers[suite.task])
        self.complete = True
        self.write()

    def _run_suite(self, run: SuiteRun, workers: Workers, solver: Any) -> None:
        suite = run.suite

        def progress(policy: str) -> Callable[[int], None]:
            return lambda episodes: self.advance(suite.name, policy, episodes)

        try:
            run.notes = make_batch(suite, 1).notes
            run.references = find_references(suite, run.seeds, solver, workers, progress("score references"))
        except Exception as error:
            run.error = f"{type(error).__name__}: {error}"
            run.entries = [self._failed(run, name, error, 0.0) for name in self.policies_of(suite.task)]
            self.write()
            return
        for name in self.policies_of(suite.task):
            begun = time.perf_counter()
            try:
                results, described = run_policy(suite, name, run.seeds, workers, progress(name))
                run.entries.append(self._entry(run, name, results, described, time.perf_counter() - begun))
            except Exception as error:
                run.entries.append(self._failed(run, name, error, time.perf_counter() - begun))
            self.write()

    def _head(self, run: SuiteRun, name: str) -> dict[str, Any]:
        return {
            "task": run.suite.task, "suite": run.suite.name, "policy": name, "episodes": len(run.seeds),
            "seed": self.seed,
        }  # fmt: skip

    def _failed(self, run: SuiteRun, name: str, error: Exception, wall_s: float) -> dict[str, Any]:
        last = traceback.extract_tb(error.__traceback__)[-1:]
        where = f"{Path(last[0].filename).name}:{last[0].lineno}" if last else ""
        return {
            **self._head(run, name), "metrics": {}, "score": None, "wall_s": wall_s,
            "error": {"type": type(error).__name__, "message": str(error), "where": where},
        }  # fmt: skip

    def _entry(
        self, run: SuiteRun, name: str, results: EpisodeResults, described: dict[str, Any], wall_s: float
    ) -> dict[str, Any]:
        assert run.references is not None
        scores = run.table.scores
        run.metrics[name] = scores.metrics_of(results, run.references)
        run.scores[name] = scores.scores_of(results, run.references)
        run.pairs += [_pair(run, other, name, self.several) for other in run.runs]
        run.runs[name] = results
        everything = np.ones(len(run.seeds), dtype=bool)
        entry = {
            **self._head(run, name), **_summaries(run, name, everything), "wall_s": wall_s,
            "about": about(name), **described,
            "planning_ms_per_decision": 1e3 * results.planning_s / max(int(results.decisions.sum()), 1),
            "decisions_per_episode": float(np.mean(results.decisions)),
            "outcomes": scores.outcomes_of(results, make_batch(run.suite, 1)),
        }  # fmt: skip
        if run.suite.stratified:
            entry["strata"] = {
                stratum: {"episodes": int(chosen.sum()), **_summaries(run, name, chosen)}
                for stratum in dict.fromkeys(run.strata.tolist())
                if (chosen := run.strata == stratum).any()
            }  # fmt: skip
        return entry

    def results(self) -> dict[str, Any]:
        """The content of ``results.json``."""
        return {
            "schema": SCHEMA,
            "machine": self.machine,
            "manifest": {**self.manifest, "wall_s": self.wall_s, "complete": self.complete},
            "suites": [_suite_record(run, self.several) for run in self.runs],
            "results": [entry for run in self.runs for entry in run.entries],
            "paired": [pair for run in self.runs for pair in run.pairs],
        }

    @property
    def several(self) -> bool:
        """Whether the suites are of several tasks."""
        return len(self.tasks) > 1

    @property
    def wall_s(self) -> float:
        """Seconds since the run began."""
        return time.perf_counter() - self._begun

    def write(self) -> None:
        """Write ``results.json``, whole or not at all."""
        write_json(self.output / "results.json", self.results())


def _summaries(run: SuiteRun, name: str, chosen: np.ndarray) -> dict[str, Any]:
    """Metrics and score of the ``chosen`` episodes."""
    score = statistics.summary(run.scores[name][chosen], robust=True)
    return {
        "metrics": {
            metric: statistics.summary(
                values[chosen], share=metric in run.table.shares, robust=metric in run.table.robust
            )
            for metric, values in run.metrics[name].items()
        },
        "score": score["mean"],
        "score_summary": score,
    }


def _suite_record(run: SuiteRun, several: bool) -> dict[str, Any]:
    record: dict[str, Any] = {
        **({"task": run.suite.task} if several else {}),
        "suite": run.suite.name, "about": run.suite.about, "params": run.suite.params, "notes": list(run.notes),
        "seeds": run.seeds.tolist(),
    }  # fmt: skip
    if run.error is not None:
        record["error"] = run.error
    if run.references is not None:
        null, bound = run.table.references
        record["references"] = {
            null: statistics.summary(run.references.null),
            bound: statistics.summary(run.references.bound),
        }
    return record


def _pair(run: SuiteRun, a: str, b: str, several: bool) -> dict[str, Any]:
    """Paired differences of two policies of a suite."""
    return {
        **({"task": run.suite.task} if several else {}),
        "suite": run.suite.name, "a": a, "b": b,
        **{
            pairing.metric: statistics.paired(
                run.metrics[a][pairing.metric], run.metrics[b][pairing.metric],
                less_is_better=pairing.less_is_better,
            )
            for pairing in run.table.pairings
        },
        "score": statistics.paired(run.scores[a], run.scores[b], less_is_better=False),
    }  # fmt: skip


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write ``content`` with null for NaN and infinity; the file is whole at every moment."""
    write_text(path, json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Replace ``path`` by ``text`` in one go."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)


def _plain(value: Any) -> Any:
    """What JSON can hold: no NumPy, no tuples, no NaN."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if (isinstance(value, Sequence) and not isinstance(value, str)) or isinstance(value, np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value if value is None or isinstance(value, str) else str(value)

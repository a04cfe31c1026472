"""Recorded surveys: where the transponder is, and how soon each policy would have found it.

``python evaluate.py --task transponder-localization --survey FILE`` calls :func:`run_survey` and shows what it returns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.map_estimator_statistics import confidence_ellipse
from evaluation.benchmark import write_json, write_text
from evaluation.manifest import machine, run_manifest
from evaluation.policies import find_policies
from evaluation.survey_file import Survey, read_survey
from evaluation.survey_replay import SURVEY_ORDER, TASK, Replay, Setup, prepare, replay
from evaluation.survey_solution import SurveySolution, solutions

SCHEMA = 1
#: Numbers of measurements that tables show, and the last.
SHOWN = (3, 5, 7, 10, 15, 20, 30, 50, 75, 100, 128)


@dataclass(frozen=True)
class SurveyRun:
    """All that came of a survey."""

    survey: Survey
    solutions: dict[str, SurveySolution]
    setup: Setup
    replays: list[Replay]
    seed: int
    wall_s: float
    manifest: dict[str, Any]

    @property
    def reference(self) -> SurveySolution:
        """The solution from all replies that errors are counted from."""
        return next(iter(self.solutions.values()))

    @property
    def counts(self) -> list[int]:
        """Numbers of measurements to show."""
        last = self.setup.measurements
        return [n for n in SHOWN if n < last] + [last]


def survey_policies(names: Sequence[str]) -> list[str]:
    """Policies of the replay: ``names``, checked, or all that ship and the order of the survey.

    Raises ``InvalidParameterError`` or ``CheckpointError``.
    """
    others = [name for name in names if name != SURVEY_ORDER]
    if names:
        find_policies(TASK, others)
        return list(dict.fromkeys(names))
    # With a free step omlp-greedy is omlp-1.
    known = [name for name in find_policies(TASK, ()) if name != "omlp-greedy"]
    return [known[0], SURVEY_ORDER, *known[1:]]


def run_survey(
    path: str | Path,
    *,
    policies: Sequence[str] = (),
    reach_m: float | None = None,
    measurements: int | None = None,
    sound_speed_m_s: float | None = None,
    runs: int = 20,
    seed: int = 0,
    arguments: Sequence[str] = (),
    advance: Callable[[str], None] = lambda what: None,
) -> SurveyRun:
    """Solve the survey in ``path`` and replay it; ``advance`` is told of each part that begins.

    reach_m: see :func:`~evaluation.survey_replay.prepare`; measurements: default 30, or as many as the survey has.
    Raises ``AquaQuadError`` (``SurveyFileError`` for what the file holds) and ``OSError``.
    """
    began = time.perf_counter()
    names = survey_policies(policies)
    if seed < 0:
        raise InvalidParameterError("seed", seed, "a whole number of 0 or more")
    survey = read_survey(path)
    advance("solution from all replies")
    found = solutions(survey, sound_speed_m_s)
    setup = prepare(
        survey, next(iter(found.values())), reach_m=reach_m, runs=runs, seed=seed,
        measurements=min(30, len(survey.two_way_s)) if measurements is None else measurements,
    )  # fmt: skip
    replays = []
    for name in names:
        advance(name)
        replays.append(replay(setup, name))
    return SurveyRun(
        survey, found, setup, replays, seed, time.perf_counter() - began, run_manifest(list(arguments))
    )


def summary(found: Replay, n: int) -> dict[str, float]:
    """Errors of ``found`` after ``n`` measurements: RMS and median over the runs, and what it took."""
    errors = found.errors_m[:, n - 1]
    return {
        "rms_error_m": float(np.sqrt(np.mean(errors**2))),
        "median_error_m": float(np.median(errors)),
        "log_det": float(np.mean(found.log_det[:, n - 1])),
        "sailed_m": float(np.mean(found.sailed_m[:, n - 1])),
    }


def content(run: SurveyRun) -> dict[str, Any]:
    """What ``survey.json`` holds."""
    survey = run.survey
    return {
        "schema": SCHEMA,
        "task": TASK,
        "machine": machine(),
        "run": {**run.manifest, "wall_s": run.wall_s, "seed": run.seed},
        "survey": {
            "file": survey.name,
            "comments": survey.comments,
            "replies": len(survey.two_way_s),
            "duration_s": float(np.ptp(survey.sent_s)),
            "extent_m": np.ptp(survey.places, axis=0),
            "ranges_m": [run.setup.ranges.min(), run.setup.ranges.max()],
        },
        "solutions": [_solution(found) for found in run.solutions.values()],
        "replay": {
            "runs": len(run.setup.first),
            "reach_m": run.setup.reach_m,
            "prior_std_m": run.setup.prior_std,
            "policies": [
                {
                    "policy": found.policy,
                    "vehicle": found.vehicle,
                    "information": found.information,
                    "beyond_reach": found.beyond,
                    "unconverged": found.unconverged,
                    "after": {str(n): summary(found, n) for n in range(1, run.setup.measurements + 1)},
                }
                for found in run.replays
            ],
        },
    }


def _solution(found: SurveySolution) -> dict[str, Any]:
    east, north, down = found.position_m
    ellipse = confidence_ellipse(found.covariance)
    return {
        "name": found.name,
        "north_east_up_m": [north, east, -down],
        "std_m": np.sqrt(np.diag(found.covariance))[[1, 0, 2]],
        "distance_from_origin_m": float(np.linalg.norm(found.position_m)),
        "ellipse95_m": ellipse.semi_axes_m,
        "sound_speed_m_s": found.sound_speed_m_s,
        "sound_speed_std_m_s": found.sound_speed_std_m_s,
        "range_std_m": found.range_std_m,
        "residual_rms_m": found.residual_rms_m,
        "residual_rms_all_m": float(np.sqrt(np.mean(found.residuals_m**2))),
        "outliers": int(found.outliers.sum()),
    }


def write_survey(run: SurveyRun, folder: Path) -> Path:
    """Write ``survey.json``, ``survey.html`` and ``survey.png`` into ``folder``; returns the page's path."""
    from evaluation.survey_report import figure, render

    found = content(run)
    png = figure(run)
    write_json(folder / "survey.json", found)
    (folder / "survey.png").write_bytes(png)
    write_text(folder / "survey.html", render(run, found, png))
    return folder / "survey.html"

"""The published results of transponder localization run again (Garcia, UC Riverside 2018, ch. 5 and 6; SPEC §8).

Look-ahead and greedy tables, the field trial's settings simulated, and the estimator's consistency from four fixed
places. Shown by :mod:`evaluation.published_localization_tables`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.estimation.map_estimator import estimate_transponders
from aquaquad_envs.estimation.map_estimator_statistics import confidence_ellipse, nees
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.transponder_localization_params import PUBLISHED
from baselines import make_policy
from evaluation.published_localization_values import EPOCHS, FIXED, PLANNING_S, TABLES

#: Resamples of the standard error of an RMS error.
_RESAMPLES = 400
#: Standard errors of the difference beyond which a cell is marked.
MARK = 3.0
_CONFIDENCE = 0.95


@dataclass
class Course:
    """What became of all runs of one row, epoch by epoch: (epochs, runs) unless said."""

    log_det: np.ndarray
    log_det_true: np.ndarray
    square_error: np.ndarray
    nees: np.ndarray  # (runs,), at the end, summed over transponders
    track: np.ndarray  # (epochs, 2) of the first run
    targets: np.ndarray  # (M, 3)
    diverged: int
    planning_s: float = 0.0
    decisions: int = 0
    name: tuple[str, int, int] = field(default=("", 0, 0))


def steps() -> int:
    """How often :func:`reproduce_localization` calls ``advance``."""
    return sum(len(table["cells"]) for table in TABLES.values()) + 1


def reproduce_localization(
    runs: int, seed: int, advance: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """All tables, as JSON can hold them, and what the figures are drawn from.

    ``runs`` of each row that has 1000 published ones; of the others in proportion. Seeds from ``seed``: rows of a table
    meet the same first estimates and noise.
    """
    check_range("runs", runs, 2, 1_000_000)
    jobs = [(name, M, k) for name, table in TABLES.items() for M, k in table["cells"]]
    # The long ones first, for two threads to end together.
    jobs.sort(key=lambda job: (job[2], job[1]), reverse=True)

    def one(job: tuple[str, int, int]) -> Course:
        course = run_course(*job, _runs_of(TABLES[job[0]]["runs"], runs), seed)
        advance()
        return course

    # Code is compiled or loaded before the clocks run.
    for vehicle in ("yaw-rate", "greedy"):
        batch = make_world_batch("transponder-localization", 1, vehicle=vehicle)
        batch.reset(0)
        make_policy("omlp-1", batch).act(batch.observations, batch.worlds)
    with ThreadPoolExecutor(2, thread_name_prefix="published") as pool:
        courses = {course.name: course for course in pool.map(one, jobs)}
    found: dict[str, Any] = {"runs": runs, "seed": seed, "tables": {}}
    for name, table in TABLES.items():
        found["tables"][name] = {
            "title": table["title"], "source": table["source"], "published_runs": table["runs"],
            "runs": _runs_of(table["runs"], runs), "error_of": {M: m + 1 for M, m in table["error_of"].items()},
            "rows": [_row(courses[name, M, k], table, M, k, seed) for M, k in table["cells"]],
        }  # fmt: skip
    fixed, scattered = reproduce_fixed(_runs_of(FIXED["runs"], runs), seed)
    found["fixed"] = fixed
    advance()
    return found, {"courses": courses, "fixed": scattered}


def _runs_of(published: int, runs: int) -> int:
    return max(2, round(published * runs / 1000))


def run_course(table: str, M: int, k: int, runs: int, seed: int) -> Course:
    """All runs of one row of ``table``: M transponders, k steps ahead (0: random)."""
    about = TABLES[table]
    batch = make_world_batch(
        "transponder-localization", runs, scenario=about["scenarios"][M], num_transponders=M,
        vehicle=about["vehicle"], num_measurements=max(EPOCHS),
    )  # fmt: skip
    policy = make_policy(f"omlp-{k}", batch, images=about["images"]) if k else make_policy("random", batch)
    seeds = seed + np.arange(runs)
    batch.reset(seeds)
    policy.reset(seeds)
    m = about["error_of"][M]
    log_det, truth, square, track = [], [], [], []
    planning = 0.0
    for epoch in range(1, max(EPOCHS) + 1):
        worlds = batch.worlds
        # A vehicle that is lost stays where it is, and its numbers with it.
        log_det.append(worlds["log_det"].copy())
        truth.append(batch.metrics()["log_det_true"])
        square.append(((worlds["estimate"][:, m] - worlds["target"][:, m]) ** 2).sum(-1))
        track.append((float(worlds["x"][0]), float(worlds["y"][0])))
        if epoch < max(EPOCHS):
            begun = time.thread_time()
            actions = policy.act(batch.observations, worlds)
            planning += time.thread_time() - begun
            batch.step(actions)
    return Course(
        log_det=np.array(log_det), log_det_true=np.array(truth), square_error=np.array(square),
        nees=M * batch.metrics()["nees"], track=np.array(track), targets=batch.worlds["target"][0, :M].copy(),
        diverged=int((batch.worlds["diverged"] > 0).sum()), planning_s=planning,
        decisions=runs * (max(EPOCHS) - 1), name=(table, M, k),
    )  # fmt: skip


def _row(course: Course, table: dict[str, Any], M: int, k: int, seed: int) -> dict[str, Any]:
    cells = []
    for epoch, (mean, std, rms) in zip(EPOCHS, table["cells"][M, k], strict=True):
        values = course.log_det[epoch - 1]
        ours, error = float(values.mean()), _standard_error(values)
        theirs_error = std / np.sqrt(table["runs"])
        found = np.sqrt(course.square_error[epoch - 1].mean())
        found_error = rms_error(course.square_error[epoch - 1], seed)
        cells.append(
            {
                "epoch": epoch,
                "published": {"log_det": mean, "std": std, "se": theirs_error, "rms_m": rms},
                "log_det": ours, "std": float(values.std(ddof=1)), "se": error,
                "log_det_true": float(course.log_det_true[epoch - 1].mean()),
                "rms_m": float(found), "rms_se": found_error,
                "median_m": float(np.sqrt(np.median(course.square_error[epoch - 1]))),
                # Of the published error no scatter is given: its standard error is taken for ours.
                "apart": {
                    "log_det": _apart(ours - mean, error, theirs_error),
                    "rms_m": _apart(found - rms, found_error, found_error),
                },
            }
        )  # fmt: skip
    return {
        "M": M, "k": k, "cells": cells, "diverged": course.diverged,
        "planning_us": 1e6 * course.planning_s / course.decisions,
        "planning_s_a_run": course.planning_s / course.nees.size,
        "published_planning_s_a_run": PLANNING_S[M][k - 1] if k and (M, k) in TABLES["msla"]["cells"] else None,
        "nees": consistency(course.nees, 3 * M),
    }  # fmt: skip


def _standard_error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / np.sqrt(values.size))


def rms_error(squares: np.ndarray, seed: int) -> float:
    """Standard error, by bootstrap, of the root of the mean of ``squares``."""
    draw = np.random.default_rng([seed, squares.size])
    chosen = draw.integers(squares.size, size=(_RESAMPLES, squares.size))
    return float(np.sqrt(squares[chosen].mean(axis=1)).std(ddof=1))


def _apart(difference: float, error: float, other: float) -> float | None:
    """Difference in standard errors of the difference; None where there is no scatter."""
    whole = float(np.hypot(error, other))
    return float(difference) / whole if whole > 0 else None


def consistency(values: np.ndarray, degrees: int) -> dict[str, Any]:
    """How NEES compares with χ² of so many ``degrees``: mean, Kolmogorov and Smirnov's distance, and its p-value."""
    from scipy.stats import kstest

    test = kstest(values, "chi2", args=(degrees,))
    return {
        "degrees": degrees, "mean": float(values.mean()), "se": _standard_error(values),
        "ks": float(test.statistic), "p": float(test.pvalue), "n": int(values.size),
    }  # fmt: skip


def reproduce_fixed(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Estimates from four fixed places: NEES against χ², and the 95 % ellipse; and the estimates for the figure."""
    draw = np.random.default_rng([seed, runs])
    targets = np.array(PUBLISHED)
    places = np.array(FIXED["places"])
    std = np.sqrt(FIXED["prior_variance"])
    arms = targets[:, None] - np.concatenate([places, np.zeros((len(places), 1))], axis=1)
    ranges = np.linalg.norm(arms, axis=-1) + FIXED["std_m"] * draw.normal(
        size=(runs, len(targets), len(places))
    )
    prior = targets + std * draw.normal(size=(runs, len(targets), 3))
    solved = estimate_transponders(
        places, ranges, prior, np.diag(FIXED["prior_variance"]), std_m=FIXED["std_m"]
    )
    errors = nees(solved.estimate, targets, solved.covariance)
    scattered = solved.estimate[:, 0, :2]
    sample = np.cov(scattered.T)
    # Each run's own ellipse, and one of all estimates' scatter, about the transponder.
    away = scattered - targets[0, :2]
    horizontal = nees(away, np.zeros(2), solved.covariance[:, 0, :2, :2])
    inside = horizontal <= -2.0 * np.log(1.0 - _CONFIDENCE)
    within_sample = nees(away, np.zeros(2), sample) <= -2.0 * np.log(1.0 - _CONFIDENCE)
    mean_covariance = solved.covariance[:, 0, :2, :2].mean(axis=0)
    found = {
        "runs": runs, "source": FIXED["source"], "diverged": int((~solved.converged).sum()),
        "nees": {"1": consistency(errors[:, 0], 3), "4": consistency(errors.sum(1), 12)},
        "inside_own_ellipse": _share(inside), "inside_sample_ellipse": _share(within_sample),
        "estimated_axes_m": confidence_ellipse(mean_covariance, _CONFIDENCE).semi_axes_m.tolist(),
        "actual_axes_m": confidence_ellipse(sample, _CONFIDENCE).semi_axes_m.tolist(),
    }  # fmt: skip
    return found, {
        "estimates": scattered, "target": targets[0, :2], "covariance": mean_covariance, "sample": sample,
        "nees_1": errors[:, 0], "nees_4": errors.sum(1),
    }  # fmt: skip


def _share(inside: np.ndarray) -> dict[str, float]:
    p = float(inside.mean())
    return {"mean": p, "se": float(np.sqrt(p * (1 - p) / inside.size))}

"""The published comparison of EKF and UKF by bearings (Dillard, NPS 2014, III.E; SPEC §4), run again.

Published are the filters' settings, the first estimate, the noise's power, the duration and about where the target
ends. Not published, and assumed here: the perimeter's radius and how fast it turns, the target's heading and
steadiness, the first covariance, and that the noise is sampled at the filter's 0.005 s. Two perimeters of
four sensors are run: ``diagonal``, in which no sensor looks west at the target, so that no bearing crosses ±π; and
``axes``, a sensor in each of east, north, west and south, of which the eastern one does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from aquaquad_envs.sensing.measurements import std_from_noise_power
from evaluation.published_filters import (
    COMPONENTS,
    Run,
    Setting,
    Track,
    filterpy_version,
    mean_and_error,
    measurements,
    run_filterpy,
    run_ours,
    settled_s,
)
from evaluation.published_values import BEARING_NOISE_POWER, DT_S, FILTERS

#: What the source does not say: radius, m, and speed, m/s, of the perimeter; where the target ends, m; the variances
#: of the first estimate, in SI units.
RADIUS_M = 2000.0
TURNING_M_S = 0.5
END_M = (FILTERS["reach_m"], 350.0)
PRIOR = (1.0,) * 6
#: Direction of the first sensor from the centre, rad.
PERIMETERS = {"diagonal": np.pi / 4, "axes": 0.0}
METHODS = ("ekf", "ukf")
MODELS = {"published": "App. B", "constant-acceleration": "Φ"}
#: filterpy is slow: how much of how many runs it is given.
FILTERPY_S = 20.0
FILTERPY_RUNS = 1
_KEEP_S = 1.0


def comparison_track(
    perimeter: str = "diagonal",
    *,
    radius_m: float = RADIUS_M,
    end_m: tuple[float, float] = END_M,
    dt_s: float = DT_S,
) -> Track:
    """The comparison's track: target from the centre to ``end_m`` at constant velocity in the published time."""
    times = dt_s * np.arange(1, round(FILTERS["duration_s"] / dt_s) + 1)
    velocity = np.array(end_m) / FILTERS["duration_s"]
    truth = np.concatenate([times[:, None] * velocity, np.tile(velocity, (len(times), 1))], axis=1)
    angles = PERIMETERS[perimeter] + np.arange(4) * np.pi / 2 + TURNING_M_S / radius_m * times[:, None]
    sensors = radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return Track(
        kind="bearing", truth=truth, sensors=sensors, others=sensors, dt_s=dt_s,
        noise_std=std_from_noise_power(BEARING_NOISE_POWER, dt_s),
        start=np.array(FILTERS["start"]), prior=np.array(PRIOR),
    )  # fmt: skip


def settings() -> Iterator[Setting]:
    """Every filter of the matrix."""
    for wrap, model, method in product((True, False), MODELS, METHODS):
        yield Setting(method, model, wrap)


def variations() -> dict[str, tuple[Track, tuple[Setting, ...]]]:
    """What the assumptions do: by what it changes, a track like ``diagonal`` and the filters that are run on it."""
    base = comparison_track()
    wide = replace(base, prior=np.array([1e4, 1e4, 1e2, 1e2, 1.0, 1.0]))
    far = float(np.hypot(*END_M)) / np.sqrt(2.0)
    both = tuple(Setting(method, "published", True) for method in METHODS)
    return {
        "as above": (base, both),
        "exactly App. B: points carried, plain": (base, (Setting("ukf", "published", False, True),)),
        "perimeter of 1 km": (comparison_track(radius_m=1000.0), both),
        "perimeter of 4 km": (comparison_track(radius_m=4000.0), both),
        "target north-east": (comparison_track(end_m=(far, far)), both),
        "noise sampled at 0.1 s, filter too": (comparison_track(dt_s=0.1), both),
        "first σ 100 m, 10 m/s": (wide, both),
        "the same, R as the noise is": (replace(wide, assumed_std=base.noise_std), both),
    }


def _summary(runs: list[Run], track: Track) -> dict[str, Any]:
    """Mean square errors, convergence and time of ``runs``."""
    errors = np.stack([run.errors for run in runs])
    keep = round(_KEEP_S / track.dt_s)
    times = track.times[keep - 1 :: keep]
    first = track.start[:4] - track.truth[0, :4]
    return {
        "mse": {name: mean_and_error([run.mse[i] for run in runs]) for i, name in enumerate(COMPONENTS)},
        "converged_s": {
            "position": settled_s(errors[..., :2], times, first[:2]),
            "velocity": settled_s(errors[..., 2:], times, first[2:]),
        },
        # The second half, long after the start is forgotten.
        "late_rms_m": float(np.sqrt((errors[:, len(times) // 2 :, :2] ** 2).sum(axis=-1).mean())),
        "time_s": mean_and_error([run.seconds for run in runs]),
    }


def reproduce_filters(
    runs: int, seed: int, advance: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The tables, and what the figure draws: RMS errors over time. ``advance`` is called :func:`steps` times."""
    chosen = list(settings())
    found: dict[str, Any] = {
        "runs": runs,
        "published": FILTERS,
        "assumed": {
            "radius_m": RADIUS_M, "turning_m_s": TURNING_M_S, "end_m": END_M, "prior": PRIOR, "dt_s": DT_S,
            "noise_std": comparison_track().noise_std,
        },
        "rows": [],
    }  # fmt: skip
    curves: dict[str, Any] = {}
    for perimeter in PERIMETERS:
        track = comparison_track(perimeter)
        every = round(_KEEP_S / track.dt_s)
        results: list[list[Run]] = [[] for _ in chosen]
        run_ours(track, chosen[0], measurements(track, seed)[:2])  # loads compiled code
        for run in range(runs):
            values = measurements(track, seed + run)
            for setting, done in zip(chosen, results, strict=True):
                done.append(run_ours(track, setting, values, every=every))
            advance()
        for setting, done in zip(chosen, results, strict=True):
            row = {"perimeter": perimeter, "library": "ours", **_named(setting), **_summary(done, track)}
            found["rows"].append(row)
            squares = np.stack([one.errors[:, :2] for one in done]) ** 2
            curves[f"{perimeter} {setting}"] = np.sqrt(squares.sum(axis=-1).mean(axis=0))
    found["filterpy"] = _filterpy_rows(seed, advance)
    found["variations"] = _variation_rows(max(2, runs // 4), seed, advance)
    curves["times"] = track.times[every - 1 :: every]
    return found, curves


def steps(runs: int) -> int:
    """How often :func:`reproduce_filters` calls ``advance``."""
    return runs * len(PERIMETERS) + len(PERIMETERS) * len(list(settings())) + len(variations())


def _named(setting: Setting) -> dict[str, Any]:
    return {"method": setting.method, "model": setting.model, "wrap": setting.wrap}


def _filterpy_rows(seed: int, advance: Callable[[], None]) -> dict[str, Any]:
    """Filters of filterpy on the first part of the first runs, and ours on the same measurements."""
    version = filterpy_version()
    table: dict[str, Any] = {"version": version, "runs": FILTERPY_RUNS, "of_s": FILTERPY_S, "rows": []}
    for perimeter, setting in product(PERIMETERS, settings()):
        if version is not None:
            track = comparison_track(perimeter)
            cut = round(FILTERPY_S / track.dt_s)
            pairs = []
            for run in range(FILTERPY_RUNS):
                values = measurements(track, seed + run)[:cut]
                pairs.append((run_filterpy(track, setting, values), run_ours(track, setting, values)))
            apart = [np.abs(theirs.errors - ours.errors).max(axis=0) for theirs, ours in pairs]
            table["rows"].append(
                {
                    "perimeter": perimeter, "library": "filterpy", **_named(setting),
                    "mse": _means([theirs.mse for theirs, _ in pairs]),
                    "ours_mse": _means([ours.mse for _, ours in pairs]),
                    "apart_m": float(np.max([row[:2] for row in apart])),
                    "cycle_us": 1e6 * float(np.mean([theirs.seconds for theirs, _ in pairs])) / cut,
                    "ours_cycle_us": 1e6 * float(np.mean([ours.seconds for _, ours in pairs])) / cut,
                }
            )  # fmt: skip
        advance()
    return table


def _means(rows: list[np.ndarray]) -> dict[str, float]:
    return dict(zip(COMPONENTS, np.mean(rows, axis=0).tolist(), strict=True))


def _variation_rows(runs: int, seed: int, advance: Callable[[], None]) -> dict[str, Any]:
    """The filters where the assumptions are others."""
    rows = []
    for title, (track, chosen) in variations().items():
        every = round(_KEEP_S / track.dt_s)
        values = [measurements(track, seed + run) for run in range(runs)]
        row: dict[str, Any] = {"title": title}
        for setting in chosen:
            row[setting.method] = _summary(
                [run_ours(track, setting, one, every=every) for one in values], track
            )
        rows.append(row)
        advance()
    return {"runs": runs, "rows": rows}

"""The published laboratory test of the UKF with three TDOA (Dillard, NPS 2014, V.C; SPEC §4), simulated.

Published: three sensors in a Y around the middle of a room of 8 × 8 m, the noise, the first estimate, a target
that rests until 13 s, is about the centre at 55 s, and then stops and goes as a person likes until 120 s. Assumed:
the Y's arms and how the person walks, drawn anew in each run; and the first covariance. The model is App. B's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.hdop import all_pairs, hdop
from aquaquad_envs.sensing.measurements import std_from_noise_power
from evaluation.published_filters import (
    Run,
    Setting,
    Track,
    mean_and_error,
    measurements,
    run_ours,
    settled_s,
)
from evaluation.published_values import DT_S, LABORATORY, SOUND_SPEED_M_S, TDOA_NOISE_POWER

#: What the source does not say: m, m/s, s, and variances in SI units. The target's random stops lie in a square.
ARM_M = 3.0
WALKING_M_S = 0.5
STOPS_HALF_WIDTH_M = 3.0
REST_S = (2.0, 10.0)
PRIOR = (1.0,) * 6
SETTING = Setting("ukf", "published", True, True)
#: Errors and HDOP are averaged over this time before their peaks are compared, s.
SMOOTH_S = 1.0
_EVERY_S = 0.1
#: HDOP is high in this share of a run; a peak of the error belongs to high HDOP if HDOP was high within this time
#: before it, s (the filter takes a while to be led astray).
HIGH_SHARE = 0.25
PEAK_DELAY_S = 2.0
#: HDOP, m/s, above which the geometry is as good as singular, for averages.
_HDOP_CAP = 1e6
_SHIFTS = 50


def y_sensors() -> np.ndarray:
    """The three sensors (3, 2), m: arms of a Y, 120° apart."""
    angles = np.radians([30.0, 150.0, 270.0])
    return ARM_M * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def laboratory_track(seed: int) -> Track:
    """The test's track; its third part is drawn from ``seed``."""
    draw = np.random.default_rng(seed)
    times = DT_S * np.arange(1, round(LABORATORY["duration_s"] / DT_S) + 1)
    knots = [(0.0, *LABORATORY["target"]), (LABORATORY["rests_until_s"], *LABORATORY["target"])]

    def walk_to(x: float, y: float) -> None:
        now, *here = knots[-1]
        knots.append((now + float(np.hypot(x - here[0], y - here[1])) / WALKING_M_S, x, y))

    walk_to(0.0, 0.0)
    knots.append((LABORATORY["centre_at_s"], 0.0, 0.0))
    while knots[-1][0] < times[-1]:
        walk_to(*draw.uniform(-STOPS_HALF_WIDTH_M, STOPS_HALF_WIDTH_M, 2))
        knots.append((knots[-1][0] + draw.uniform(*REST_S), *knots[-1][1:]))
    when, x, y = np.array(knots).T
    places = np.stack([np.interp(times, when, x), np.interp(times, when, y)], axis=-1)
    moves = np.diff(places, axis=0, prepend=places[:1]) / DT_S
    sensors, pairs = y_sensors(), all_pairs(3)
    shape = (len(times), len(pairs), 2)
    return Track(
        kind="tdoa", truth=np.concatenate([places, moves], axis=1),
        sensors=np.ascontiguousarray(np.broadcast_to(sensors[pairs[:, 0]], shape)),
        others=np.ascontiguousarray(np.broadcast_to(sensors[pairs[:, 1]], shape)),
        noise_std=std_from_noise_power(TDOA_NOISE_POWER, DT_S),
        start=np.array([*LABORATORY["start"], 0.0, 0.0, 0.0, 0.0]), prior=np.array(PRIOR),
    )  # fmt: skip


def _averaged(values: np.ndarray) -> np.ndarray:
    """Moving average over ``SMOOTH_S`` of a series sampled every ``_EVERY_S``, of the same length."""
    width = round(SMOOTH_S / _EVERY_S)
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def shared_peaks(dilution: np.ndarray, error: np.ndarray, seed: int = 0) -> dict[str, float]:
    """How the peaks of ``error`` go with high ``dilution``, both sampled every 0.1 s.

    ``rank_correlation``: Spearman's, of the two averaged over 1 s. ``peaks``: how many peaks the averaged error has
    that stand out by its own standard deviation; ``at_high_hdop``: the share of them within 2 s after HDOP was in
    its upper quartile; ``by_chance``: the same share where the error's series is turned by a random time. NaN
    without a peak.
    """
    from scipy.signal import find_peaks
    from scipy.stats import spearmanr

    level, smooth = _averaged(np.log10(np.minimum(dilution, _HDOP_CAP))), _averaged(error)
    high = level >= np.quantile(level, 1.0 - HIGH_SHARE)
    delay = round(PEAK_DELAY_S / _EVERY_S)
    recent = np.convolve(high, np.ones(delay + 1), mode="full")[: len(high)] > 0.5
    peaks = find_peaks(smooth, prominence=np.std(smooth))[0]
    shifts = np.random.default_rng(seed).integers(len(error), size=_SHIFTS)
    by_chance = [recent[(peaks + late) % len(error)].mean() for late in shifts if len(peaks)]
    nan = float("nan")
    return {
        "rank_correlation": float(spearmanr(level, smooth).statistic),
        "peaks": len(peaks),
        "at_high_hdop": float(recent[peaks].mean()) if len(peaks) else nan,
        "by_chance": float(np.mean(by_chance)) if len(peaks) else nan,
    }


def reproduce_laboratory(runs: int, seed: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """The table over ``runs`` runs, each with its own walk and noise, and the curves of the first for the figure."""
    done: list[Run] = []
    peaks: dict[str, list[dict[str, float]]] = {"truth": [], "estimate": []}
    dilutions = []
    every = round(_EVERY_S / DT_S)
    going = round(LABORATORY["centre_at_s"] / _EVERY_S)
    for run in range(runs):
        track = laboratory_track(seed + run)
        values = measurements(track, seed + run)
        if not done:
            run_ours(track, SETTING, values[:2])  # loads compiled code
        done.append(run_ours(track, SETTING, values, every=every))
        places = track.truth[every - 1 :: every, :2]
        error = np.hypot(*done[-1].errors[:, :2].T)
        # App. B takes HDOP at the estimate, where a filter that has gone astray sees a worse geometry.
        for name, seen in (("estimate", places + done[-1].errors[:, :2]), ("truth", places)):
            dilution = hdop("tdoa", y_sensors(), seen, sound_speed_m_s=SOUND_SPEED_M_S)
            peaks[name].append(shared_peaks(dilution[going:], error[going:], seed + run))
        dilutions.append(dilution)
    errors = np.stack([run.errors for run in done])[..., :2]
    times = track.times[every - 1 :: every]
    squares = np.array([run.mse[:2] for run in done])
    # A run whose error at the end is beyond the room is lost.
    lost = np.hypot(*errors[:, -1].T) > LABORATORY["room_m"]
    resting = times <= LABORATORY["rests_until_s"]
    found = {
        "runs": runs,
        "published": LABORATORY,
        "assumed": {
            "sensors": y_sensors(), "walking_m_s": WALKING_M_S, "stops_half_width_m": STOPS_HALF_WIDTH_M,
            "prior": PRIOR,
        },
        "noise_mean_abs_s": float(track.noise_std * np.sqrt(2.0 / np.pi)),
        "converged_s": settled_s(
            errors[:, resting], times[resting], track.start[:2] - np.array(LABORATORY["target"])
        ),
        "rms_then_m": float(np.sqrt(np.mean(
            np.sum(errors[:, np.searchsorted(times, LABORATORY["converged_s"])] ** 2, axis=-1)
        ))),
        "mse": {name: mean_and_error(squares[~lost, i]) for i, name in enumerate(("x", "y"))},
        "mse_quartiles": {
            name: np.percentile(squares[:, i], [25, 50, 75]) for i, name in enumerate(("x", "y"))
        },
        "lost": int(lost.sum()),
        "rms_m": {
            name: float(np.sqrt((errors[~lost][:, part] ** 2).sum(axis=-1).mean()))
            for name, part in _parts(times).items()
        },
        "centre_hdop": float(dilutions[0][np.searchsorted(times, LABORATORY["centre_at_s"]) - 1]),
        "least_hdop": float(min(one.min() for one in dilutions)),
        "peaks": {
            seen: {
                name: mean_and_error([row[name] for row in rows if np.isfinite(row[name])])
                for name in ("rank_correlation", "peaks", "at_high_hdop", "by_chance")
            }
            for seen, rows in peaks.items()
        },
    }  # fmt: skip
    error = np.hypot(*errors[0].T)
    curves = {"times": times, "hdop": dilutions[0], "error": error, "walk": track.truth[:: 10 * every, :2]}
    return found, curves


def _parts(times: np.ndarray) -> dict[str, np.ndarray]:
    """The test's three parts as the source cuts them, after convergence."""
    rest, centre = LABORATORY["rests_until_s"], LABORATORY["centre_at_s"]
    return {
        "resting": (times > LABORATORY["converged_s"]) & (times <= rest),
        "to the centre": (times > rest) & (times <= centre),
        "stop and go": times > centre,
    }

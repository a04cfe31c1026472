"""The published simulations of finding and holding a laser (Toombs 2022, figs. 6.2 to 6.10; SPEC §10), flown again.

With the step responses of both vehicles (:mod:`evaluation.published_vehicles`): all of ``evaluate.py published`` for
laser tracking.

The source shows figures of single runs and says in words what they tell; it gives no masses, gains, noise, distances
or speeds. So each statement is turned into a number over many runs, in worlds of one horizontal axis as published,
with this package's parameters: from the ground, 3 to 5 m beside the light, the first guess off by 1.5 m (standard
deviation), a laser of 20° under a view of 10°, a vehicle that stands still or moves steadily at up to 0.3 m/s. The
published guidance flies to the filter's estimate; ``ekf-tracking`` here rides the rim. Both are flown.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.estimation.kalman_motion import make_motion
from aquaquad_envs.estimation.laser_ekf import LaserEkf, make_laser_model
from aquaquad_envs.sensing.laser import intensity
from aquaquad_envs.tasks.batch import make_world_batch
from baselines import make_policy
from evaluation.markup import escape, number, percent, picture, table
from evaluation.published_vehicles import reproduce_vehicles

RUNS = 24
HORIZON_S = 60.0
#: The last of it, in which a state is called final, s.
FINAL_S = 5.0
_PLANAR: dict[str, Any] = {"axes": 1, "start_altitude_m": 0.0, "horizon_s": HORIZON_S}
_BESIDE: dict[str, Any] = {**_PLANAR, "start_altitude_m": None, "start_distance_m": 1.6, "guess_std_m": 0.0}
#: Slow enough that what carries the vehicle on is the gradient, not its own motion.
_SLOW: dict[str, Any] = {"climb": 0.2, "min_move": 0.1}
#: ``ekf-tracking`` made the published one: tangent only, and no ride round the rim.
_PUBLISHED_EKF: dict[str, Any] = {"gate": math.inf, "scan": (0.0, 0.0, 0.0)}


@dataclass(frozen=True, kw_only=True)
class Case:
    """One figure's scenario: world, policy, and what is said of it."""

    figure: str
    title: str
    policy: str
    said: str
    params: dict[str, Any]
    options: dict[str, Any] = field(default_factory=dict)


CASES = (
    Case(
        figure="6.3a", title="gradient ascent, Gaussian", policy="gradient-ascent",
        said="reaches the laser's axis", params={**_BESIDE, "scenario": "still", "profile": "gaussian"}, options=_SLOW,
    ),
    Case(
        figure="6.3b", title="gradient ascent, flat top", policy="gradient-ascent",
        said="stops at the edge of the flat top", params={**_BESIDE, "scenario": "still"}, options=_SLOW,
    ),
    Case(
        figure="6.5", title="filter's estimate followed inside the flat top", policy="ekf-tracking",
        said="the variance grows, and stays bounded", params={**_BESIDE, "scenario": "still"}, options=_PUBLISHED_EKF,
    ),
    Case(
        figure="6.6", title="search and hold, vehicle moving", policy="search-hold",
        said="very little time in the LDA", params={**_PLANAR, "scenario": "moving"},
    ),
    Case(
        figure="6.7", title="search and gradient ascent", policy="gradient-ascent",
        said="residual motion carries it into the flat top: a small error", params={**_PLANAR, "scenario": "still"},
    ),
    Case(
        figure="6.8", title="search and filter, vehicle still", policy="ekf-tracking",
        said="stays; the initial offset is reduced", params={**_PLANAR, "scenario": "still"}, options=_PUBLISHED_EKF,
    ),
    Case(
        figure="6.9", title="search and filter, vehicle moving", policy="ekf-tracking",
        said="stays, not much worse than over a still one", params={**_PLANAR, "scenario": "moving"},
        options=_PUBLISHED_EKF,
    ),
    Case(
        figure="6.8, ours", title="the same, riding the rim, still", policy="ekf-tracking", said="",
        params={**_PLANAR, "scenario": "still"},
    ),
    Case(
        figure="6.9, ours", title="the same, riding the rim, moving", policy="ekf-tracking", said="",
        params={**_PLANAR, "scenario": "moving"},
    ),
    Case(
        figure="6.10", title="acoustic position followed", policy="rov-tracking",
        said="limited only by the controller", params={**_PLANAR, "scenario": "moving"},
    ),
)  # fmt: skip


def fly(case: Case, runs: int, seed: int) -> dict[str, np.ndarray]:
    """Traces (steps, runs) of ``runs`` episodes: x, centre and the filter's deviation, m, light as a share.

    Also ``radius``, m, and the metrics at the end.
    """
    batch = make_world_batch("laser-tracking", runs, **case.params)
    policy = make_policy(case.policy, batch, **case.options)
    seeds = seed + np.arange(runs)
    batch.reset(seeds)
    policy.reset(seeds)
    machines = policy.machines  # type: ignore[attr-defined]
    rows = []
    while not batch.finished.all():
        batch.step(policy.act(batch.observations, batch.worlds))
        world = batch.worlds
        known = (case.policy == "ekf-tracking") & (machines["bank"]["count"] > 0)
        # One axis: all of the variance is its own.
        std = np.where(known, np.sqrt(machines["variance"]), np.nan)
        rows.append([world["x"].copy(), world["rov_x"].copy(), world["light"] / batch.constants.peak, std])
    x, centre, light, std = np.moveaxis(np.array(rows), 1, 0)
    return {
        "x": x, "centre": centre, "light": light, "std": std, "radius": np.float64(batch.constants.radius),
        "dt": np.float64(batch.constants.action_period), **batch.metrics(),
    }  # fmt: skip


def _summary(case: Case, traces: dict[str, np.ndarray]) -> dict[str, Any]:
    last = round(FINAL_S / float(traces["dt"]))
    w = float(traces["radius"])
    error = np.abs(traces["x"] - traces["centre"])
    found = traces["acquired"] == 1.0
    some = found if found.any() else np.ones(len(found), dtype=bool)
    std = traces["std"][:, some] / w
    known = np.isfinite(std).any()
    return {
        "figure": case.figure, "title": case.title, "policy": case.policy, "said": case.said,
        "acquired": float(found.mean()), "time_in_lda": float(traces["time_in_lda"].mean()),
        "time_in_lda_acquired": float(np.nanmean(traces["time_in_lda_acquired"])) if found.any() else None,
        "time_to_acquire_s": float(np.median(traces["time_to_acquire_s"])),
        "final_error_w": float(np.median(error[-last:, some])) / w,
        "final_std_w": float(np.nanmedian(std[-last:])) if known else None,
        "greatest_std_w": float(np.nanmedian(np.nanmax(std, axis=0))) if known else None,
        "least_std_w": float(np.nanmedian(np.nanmin(std, axis=0))) if known else None,
    }  # fmt: skip


def search_pattern(seed: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Fig. 6.2: turning points of the search along one axis, of a laser too faint to be found."""
    case = Case(
        figure="6.2", title="concentric search", policy="search-hold", said="",
        params={**_PLANAR, "scenario": "still", "power_w": 1e-12, "horizon_s": 2 * HORIZON_S},
        options={"spacing": 1.0},
    )  # fmt: skip
    traces = fly(case, 1, seed)
    x, dt = traces["x"][:, 0], float(traces["dt"])
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    # A circle shows as two turns: half their distance is its radius. Small ones on the way there do not count.
    turns = turns[1:][np.abs(np.diff(x[turns])) > 0.5 * float(traces["radius"])]
    pairs = turns[: len(turns) // 2 * 2].reshape(-1, 2)
    amplitude = 0.5 * np.abs(np.diff(x[pairs], axis=1)[:, 0])
    period = np.diff(pairs[:, 0]) * dt
    return {
        "circles": len(pairs),
        "amplitude_growth_w": float(np.diff(amplitude).mean() / float(traces["radius"])),
        "periods_grow": bool((np.diff(period) > 0).all()),
        "speed_m_s": float((2 * np.pi * amplitude[:-1] / period).mean()),
    }, traces


def passes(form: str, seed: int) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Fig. 6.4: a receiver swings over a flat top, and the filter's variance grows inside and shrinks on the slope.

    ``form``: "polar" or "cartesian". Numbers: mean rate of ln of the position's variance, 1/s, where r < 0.6 w
    and where w < r < 1.5 w.
    """
    batch = make_world_batch("laser-tracking", 1, axes=1)
    c = batch.constants
    w, dt, height = c.radius, c.action_period, c.altitude + c.depth
    rng = np.random.default_rng(seed)
    model = make_laser_model(
        c.beam, height, intensity_std=c.noise_std, velocity_std=c.rov_velocity_std, gate=math.inf
    )
    times = dt * np.arange(round(HORIZON_S / dt) + 1)
    swing = 2.0 * w
    offset = swing * np.cos(0.5 * times)
    speed = -0.5 * swing * np.sin(0.5 * times)
    ekf = LaserEkf(
        1, model, form=form, motion=make_motion("constant-velocity", density=1e-2),
        polar_noise=(1e-4, 1e-8, 1e-2, 1e-8),
    )  # fmt: skip
    ekf.place([offset[0] - 0.2 * w, 0.0, 0.0, 0.0], np.diag([(0.3 * w) ** 2, 1e-6, 0.01, 1e-6]))
    variance, estimate = [], []
    for k in range(1, len(times)):
        measured = intensity(c.beam, abs(offset[k]), height) + c.noise_std * rng.normal()
        velocity = [speed[k] + c.rov_velocity_std * rng.normal(), 0.0]
        ekf.cycle(dt, measured, velocities=velocity)
        variance.append(ekf.covariances[0, 0, 0])
        estimate.append(ekf.positions()[0, 0])
    r = np.abs(offset[1:]) / w
    rate = np.diff(np.log(variance)) / dt
    inside, slope = r[1:] < 0.6, (r[1:] > 1.0) & (r[1:] < 1.5)
    error = np.abs(np.array(estimate) - offset[1:])
    return {
        "form": form, "rate_inside": float(rate[inside].mean()), "rate_on_slope": float(rate[slope].mean()),
        "rms_error_w": float(np.sqrt((error[len(error) // 2 :] ** 2).mean()) / w),
    }, {
        "times": times[1:], "x": offset[1:], "estimate": np.array(estimate), "std": np.sqrt(np.array(variance)),
        "light": np.array([intensity(c.beam, abs(v), height) for v in offset[1:]]) / c.peak, "radius": np.float64(w),
    }  # fmt: skip


def steps(runs: int) -> int:
    """How often :func:`reproduce` calls ``advance``."""
    return len(CASES) + 3


def reproduce(runs: int, seed: int, advance: Callable[[], None]) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Every number, as JSON can hold it, and the figure as PNG; ``advance`` is called :func:`steps` times."""
    from evaluation.published_laser_figure import draw

    check_range("runs", runs, 1, 100_000)
    check_range("seed", seed, 0, 2**62)
    pattern, searched = search_pattern(seed)
    advance()
    swings, swung = zip(*(passes(form, seed) for form in ("polar", "cartesian")), strict=True)
    advance()
    rows, flights = [], {}
    for case in CASES:
        flights[case.figure] = fly(case, runs, seed)
        rows.append(_summary(case, flights[case.figure]))
        advance()
    found: dict[str, Any] = {
        "runs": runs, "seed": seed, "search": pattern, "passes": list(swings), "rows": rows,
    }  # fmt: skip
    found["statements"] = statements(found)
    found["vehicles"], drawn = reproduce_vehicles()
    advance()
    return found, {"laser": draw(searched, swung[0], flights), **drawn}


def statements(found: dict[str, Any]) -> list[dict[str, Any]]:
    """What the source says of each figure, the number that it comes down to here, and whether that agrees."""
    row = {entry["figure"]: entry for entry in found["rows"]}
    search, polar = found["search"], found["passes"][0]
    still, moving = row["6.8"]["time_in_lda_acquired"] or 0.0, row["6.9"]["time_in_lda_acquired"] or 0.0
    climbed, brim = row["6.3a"]["final_error_w"], row["6.3b"]["final_error_w"]
    inside = row["6.5"]
    listed = [
        (
            "6.2", "amplitude grows, frequency falls, speed is kept",
            f"{search['circles']} circles, {number(search['amplitude_growth_w'])} w wider each, at "
            f"{number(search['speed_m_s'])} m/s",
            search["amplitude_growth_w"] > 0 and search["periods_grow"],
        ),
        (
            "6.3", "ascent reaches a Gaussian's axis, and stops at a flat top's edge",
            f"final distance {number(climbed)} w and {number(brim)} w", climbed < 0.4 and brim > climbed,
        ),
        (
            "6.4", "variance grows inside the flat top, shrinks on its slope",
            f"ln of it by {number(polar['rate_inside'])} and {number(polar['rate_on_slope'])} a second",
            polar["rate_inside"] > 0 > polar["rate_on_slope"],
        ),
        (
            "6.5", "inside, variance grows to a maximum: the estimate drifts to the slope and is corrected",
            f"deviation from {number(inside['least_std_w'])} w to {number(inside['greatest_std_w'])} w at most",
            inside["least_std_w"] < inside["greatest_std_w"] < 1.5,
        ),
        (
            "6.6", row["6.6"]["said"], f"{percent(row['6.6']['time_in_lda'])} of the time",
            row["6.6"]["time_in_lda"] < 0.25,
        ),
        (
            "6.7", row["6.7"]["said"], f"final distance {number(row['6.7']['final_error_w'])} w",
            row["6.7"]["final_error_w"] < 1.0,
        ),
        ("6.8", row["6.8"]["said"], f"{percent(still, 1)} after acquisition", still > 0.9),
        ("6.9", row["6.9"]["said"], f"{percent(moving, 1)} after acquisition", moving > 0.9),
        (
            "6.10", row["6.10"]["said"], f"{percent(row['6.10']['time_in_lda_acquired'], 1)} after acquisition",
            (row["6.10"]["time_in_lda_acquired"] or 0.0) > 0.95,
        ),
    ]  # fmt: skip
    return [
        {"figure": figure, "said": said, "ours": ours, "agrees": bool(agrees)}
        for figure, said, ours, agrees in listed
    ]


def _vehicle_table(found: dict[str, Any]) -> tuple[str, str, list[str], list[list[str]]]:
    said = "; ".join(f"{name}: {'yes' if holds else 'no'}" for name, holds in found["statements"].items())
    rows = []
    for row in found["rows"]:
        unit, scale = ("°", 180.0 / math.pi) if row["axis"] == "pitch" else ("m", 1.0)
        rows.append(
            [
                f"{row['vehicle']}, {row['axis']}", f"{number(scale * row['step'], 1)} {unit}",
                number(row["delay_s"]), number(row["settling_s"], 1), percent(row["overshoot"], 1),
            ]
        )  # fmt: skip
    return (
        "Step responses of both vehicles",
        f"Published as figures 3.4 and 3.7 without numbers. Settled for good within 5 % of the step. {said}.",
        ["", "step", "delay, s", "settled, s", "overshoot"],
        rows,
    )


def tables(found: dict[str, Any]) -> list[tuple[str, str, list[str], list[list[str]]]]:
    """All tables: title, note, head and rows of plain text."""
    return [
        (
            "Finding and holding a laser: what is said of the figures",
            "Published: Toombs 2022, ch. 6, single runs, in words and figures. w: radius of the detectable area.",
            ["figure", "published", "ours", "agrees"],
            [
                [line["figure"], line["said"], line["ours"], "yes" if line["agrees"] else "no"]
                for line in found["statements"]
            ],
        ),
        (
            "The same in numbers",
            f"{found['runs']} runs of {number(HORIZON_S, 0)} s each, seeds from {found['seed']}; means, medians of "
            f"times and of the last {number(FINAL_S, 0)} s. Distances and deviations in w.",
            [
                "figure", "", "found", "in LDA", "after\nacquisition", "to acquire, s", "distance,\nfinal",
                "deviation,\nfinal", "deviation,\ngreatest",
            ],
            [
                [
                    row["figure"], row["title"], percent(row["acquired"]), percent(row["time_in_lda"], 1),
                    percent(row["time_in_lda_acquired"], 1), number(row["time_to_acquire_s"], 1),
                    number(row["final_error_w"]), number(row["final_std_w"]), number(row["greatest_std_w"]),
                ]
                for row in found["rows"]
            ],
        ),
        _vehicle_table(found["vehicles"]),
    ]  # fmt: skip


CAPTION = (
    "One axis, first run: quadrotor (blue), centre of the light (orange) and its detectable area (band)."
)


def section(found: dict[str, Any], pictures: dict[str, bytes] | None = None) -> str:
    """The tables as HTML, with the figure if ``pictures`` are given."""
    parts = []
    for title, note, head, rows in tables(found):
        cells = [[escape(cell) for cell in row] for row in rows]
        prose = (1, 2) if len(head) == 4 else (1,)
        parts.append(f'<h3>{escape(title)}</h3><p class="soft">{escape(note)}</p>')
        parts.append(table([escape(text).replace("\n", "<br>") for text in head], cells, text=prose))
    captions = {
        "laser": CAPTION, "quadrotor-steps": "Steps of the quadrotor.", "rov-steps": "Steps of the submerged vehicle.",
    }  # fmt: skip
    for name, caption in captions.items() if pictures is not None else ():
        parts.append(picture(pictures[name], caption, escape(caption)))  # type: ignore[index]
    return "\n".join(parts)


def print_tables(found: dict[str, Any], console: Any) -> None:
    """The tables on the terminal."""
    from rich.table import Table

    for title, note, head, rows in tables(found):
        shown = Table(title=title, title_justify="left", caption=note, caption_justify="left")
        for k, text in enumerate(head):
            shown.add_column(text, justify="left" if k < 2 or len(head) == 4 else "right")
        for row in rows:
            shown.add_row(*row)
        console.print(shown)

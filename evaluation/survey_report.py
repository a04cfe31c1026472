"""The page, the figure and the terminal's tables of a recorded survey."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.estimation.map_estimator_statistics import confidence_ellipse
from evaluation import figures
from evaluation.markup import definitions, escape, number, page, picture, table
from evaluation.survey import SurveyRun, summary
from evaluation.survey_replay import Replay, Setup
from evaluation.survey_solution import OUTLIER

_PLACES, _REFERENCE = "#b8c4ce", "#d55e00"
#: A survey's order has no colour of its own among the policies.
_ORDER = "#000000"
#: Points of an ellipse.
_POINTS = 100


def _colour(found: Replay) -> str:
    return figures.colour_of(found.policy) if found.vehicle != "–" else _ORDER


def _typical(found: Replay) -> int:
    """The run whose last error is the median one."""
    return int(np.argsort(found.errors_m[:, -1])[len(found.errors_m) // 2])


def figure(run: SurveyRun) -> bytes:
    """The places, the solution and each policy's median run; errors over measurements."""
    drawn, axes = figures._figure(12.5, 5.6, nrows=1, ncols=2, width_ratios=(1, 1.15))
    left, right = axes
    shift = run.setup.shift[:2]
    places = run.setup.places[:, :2] + shift
    left.plot(*places.T, ".", color=_PLACES, markersize=3, zorder=1, label="recorded places")
    for found in run.replays:
        track = places[found.chosen[_typical(found)]]
        left.plot(*track.T, color=_colour(found), linewidth=1.1, alpha=0.8, label=found.policy)
        left.plot(*track[0], "o", color="white", markeredgecolor=_colour(found), markersize=5)
    position = run.reference.position_m
    left.plot(*position[:2], "*", color=_REFERENCE, markeredgecolor="black", markersize=12, zorder=5)
    left.set(xlabel="east, m", ylabel="north, m", title="places, and the median run of each policy")
    left.set_aspect("equal")
    left.legend(fontsize=7, loc="best")
    counts = np.arange(1, run.setup.measurements + 1)
    for found in run.replays:
        low, middle, high = np.percentile(found.errors_m, [25, 50, 75], axis=0)
        right.semilogy(counts, middle, color=_colour(found), label=found.policy, linewidth=1.6)
        right.fill_between(counts, low, high, color=_colour(found), alpha=0.12, linewidth=0)
    right.axhline(_reference_std(run), color="grey", linewidth=0.8, linestyle="--")
    right.set(
        xlabel="measurements", ylabel="distance from the solution of the whole survey, m",
        title="median over the runs, and the middle half",
    )  # fmt: skip
    right.grid(color="#dddddd", linewidth=0.6)
    right.legend(fontsize=8)
    return figures._png(drawn)


def residual_figure(run: SurveyRun) -> bytes:
    """Residuals of the reference over time, and the solutions with their ellipses."""
    drawn, axes = figures._figure(12.5, 3.6, nrows=1, ncols=2, width_ratios=(1.7, 1))
    left, right = axes
    found = run.reference
    minutes = (run.survey.sent_s - run.survey.sent_s.min()) / 60
    bound = 1.5 * OUTLIER * float(np.median(found.stds_m))
    for chosen, colour, label in (
        (~found.outliers, "#0072b2", "replies"),
        (found.outliers, _REFERENCE, "outliers"),
    ):
        # What is beyond is drawn at the edge.
        shown = np.clip(found.residuals_m[chosen], -bound, bound)
        left.plot(minutes[chosen], shown, ".", color=colour, markersize=3, label=label)
    left.set(xlabel="time, min", ylabel="residual, m (one way)")
    left.grid(color="#dddddd", linewidth=0.6)
    left.legend(fontsize=8)
    around = np.linspace(0, 2 * np.pi, _POINTS)
    for solution, colour in zip(run.solutions.values(), ("#0072b2", "#009e73", "#e69f00"), strict=False):
        ellipse = confidence_ellipse(solution.covariance)
        curve = ellipse.directions @ (ellipse.semi_axes_m[:, None] * [np.cos(around), np.sin(around)])
        right.plot(*(solution.position_m[:2, None] + curve), color=colour, linewidth=1.3, label=solution.name)
        right.plot(*solution.position_m[:2], "+", color=colour)
    near = 10 * confidence_ellipse(found.covariance).semi_axes_m[0] + 0.1
    if np.linalg.norm(found.position_m[:2]) < near:
        right.plot(0, 0, "k*", markersize=8, label="origin of the file")
    right.set(xlabel="east, m", ylabel="north, m", title="95 % ellipses")
    right.set_aspect("equal", adjustable="datalim")
    right.legend(fontsize=7)
    return figures._png(drawn)


def _reference_std(run: SurveyRun) -> float:
    return float(np.sqrt(np.trace(run.reference.covariance)))


def render(run: SurveyRun, found: dict[str, Any], png: bytes) -> str:
    """The page; ``found`` is what ``survey.json`` holds."""
    survey, setup = found["survey"], run.setup
    title = f"Survey {run.survey.name}"
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="lead">{survey["replies"]} replies of one transponder at ranges of '
        f"{number(setup.ranges.min(), 0)} to {number(setup.ranges.max(), 0)} m, within "
        f"{number(survey['duration_s'] / 60, 0)} min. {escape(run.manifest['started'])}, {run.wall_s:.0f} s.</p>",
        "<h2>All replies</h2>",
        _solutions_table(found),
        '<p class="soft">Position in the frame of the file; where its origin is the published position, the distance '
        "from it is the difference. Standard deviations are of residuals that do not depend on each other, and of the "
        "stated errors of the receiver's positions along the line of sight: residuals that drift make them too small. "
        f"Outliers: beyond {OUTLIER:g} standard deviations; no reply is left out of a solution. The first solution is "
        "what replays are judged by.</p>",
        picture(
            residual_figure(run), "Residuals of the first solution over time, and the solutions",
            "Residuals of the first solution, those beyond the frame at its edge; 95 % ellipses.",
        ),
        "<h2>Replay</h2>",
        f"<p>{len(setup.first)} runs from random recorded places, the same for every policy. At each step a policy "
        f"chooses among the recorded places within {number(setup.reach_m, 1)} m that it has not used: the end of its "
        "step is matched to the nearest. First estimates are normal about the first solution, "
        f"{' × '.join(number(std, 1) for std in setup.prior_std)} m (east, north, depth). Error: distance from that "
        "solution.</p>",
        _replay_table(run),
        picture(
            png, "Recorded places with the median run of each policy, and errors over measurements",
            "Left: grey the recorded places, circles the starts, the star the solution. Right: dashed, the standard "
            "deviation of the solution itself.",
        ),
        "<h2>What each policy was allowed to know</h2>",
        table(
            ["policy", "vehicle", "what it knew"],
            [[_name(r), escape(r.vehicle), escape(r.information)] for r in run.replays], text=(1, 2),
        ),
        "<h2>This run</h2>",
        definitions({
            **run.manifest, "wall time": f"{run.wall_s:.1f} s", "seed": run.seed,
            **{k: v for k, v in found["machine"].items() if k != "packages"},
            **({"comments of the file": " / ".join(run.survey.comments)} if run.survey.comments else {}),
        }),
    ]  # fmt: skip
    return page(title, "\n".join(body))


def _name(found: Replay) -> str:
    return f'<i class="swatch" style="background:{_colour(found)}"></i>{escape(found.policy)}'


def _solutions_table(found: dict[str, Any]) -> str:
    rows = [
        [
            escape(one["name"]),
            *(
                f"{number(value, 3)} ± {number(std, 3)}"
                for value, std in zip(one["north_east_up_m"], one["std_m"], strict=True)
            ),
            number(one["distance_from_origin_m"], 3),
            _speed(one),
            number(one["range_std_m"], 3),
            number(one["residual_rms_m"], 3),
            number(one["residual_rms_all_m"], 3),
            str(one["outliers"]),
        ]
        for one in found["solutions"]
    ]
    head = [
        "solution", "north, m", "east, m", "up, m", "distance from<br>the origin, m", "speed of<br>sound, m/s",
        "noise of<br>ranging, m", "residual RMS,<br>m, one way", "with<br>outliers", "outliers",
    ]  # fmt: skip
    return table(head, rows)


def _speed(one: dict[str, Any]) -> str:
    text = number(one["sound_speed_m_s"], 2)
    return f"{text} ± {number(one['sound_speed_std_m_s'], 2)}" if one["sound_speed_std_m_s"] else text


def _replay_table(run: SurveyRun) -> str:
    rows = []
    best = {n: min(summary(found, n)["rms_error_m"] for found in run.replays) for n in run.counts}
    for found in run.replays:
        cells = [_name(found), escape(found.vehicle)]
        for n in run.counts:
            after = summary(found, n)
            text = number(after["rms_error_m"], 2)
            top = f'<span class="best">{text}</span>' if after["rms_error_m"] == best[n] else text
            cells.append(f'{top}<span class="range">median {number(after["median_error_m"], 2)}</span>')
        last = summary(found, run.setup.measurements)
        cells += [
            number(last["log_det"], 1),
            number(last["sailed_m"], 0),
            str(found.beyond),
            str(found.unconverged),
        ]
        rows.append(cells)
    head = [
        "policy", "vehicle", *(f"RMS error, m,<br>n = {n}" for n in run.counts), "ln det<br>at the end", "sailed, m",
        "steps beyond<br>reach", "not<br>converged",
    ]  # fmt: skip
    return table(head, rows, text=(1,))


def print_survey(run: SurveyRun, found: dict[str, Any], console: Any) -> None:
    """Both tables on the terminal."""
    from rich.table import Table

    shown = Table(title=f"{run.survey.name}, {len(run.survey.two_way_s)} replies", title_justify="left")
    for head in (
        "solution", "north, m", "east, m", "up, m", "from origin, m", "sound, m/s", "residual RMS, m", "outliers",
    ):  # fmt: skip
        shown.add_column(head, justify="left" if head == "solution" else "right")
    for one in found["solutions"]:
        shown.add_row(
            one["name"], *(number(value, 3) for value in one["north_east_up_m"]),
            number(one["distance_from_origin_m"], 3), number(one["sound_speed_m_s"], 2),
            number(one["residual_rms_m"], 3), str(one["outliers"]),
        )  # fmt: skip
    console.print(shown)
    setup: Setup = run.setup
    shown = Table(
        title=f"RMS error, m, after n replies; {len(setup.first)} runs, reach {setup.reach_m:.3g} m",
        title_justify="left",
    )
    shown.add_column("policy")
    for n in run.counts:
        shown.add_column(f"n = {n}", justify="right")
    for head in ("ln det", "sailed, m"):
        shown.add_column(head, justify="right")
    for replayed in run.replays:
        last = summary(replayed, setup.measurements)
        shown.add_row(
            replayed.policy, *(number(summary(replayed, n)["rms_error_m"]) for n in run.counts),
            number(last["log_det"], 1), number(last["sailed_m"], 0),
        )  # fmt: skip
    console.print(shown)

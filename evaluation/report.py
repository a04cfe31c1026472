"""The report: one self-contained page, and a summary for the terminal."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from evaluation import figures
from evaluation.benchmark import Benchmark, SuiteRun, write_text
from evaluation.markup import (
    DASH,
    definitions,
    escape,
    folded,
    number,
    page,
    percent,
    picture,
    table,
    with_range,
)  # fmt: skip
from evaluation.published import section_in
from evaluation.rollouts import CHUNK
from evaluation.statistics import RESAMPLES

#: A policy that arrives less often than this competes for no energy prize.
_RELIABLE = 0.9


def write_report(run: Benchmark) -> Path:
    """Write ``index.html`` beside ``results.json``; returns its path."""
    path = run.output / "index.html"
    write_text(path, render(run))
    return path


def render(run: Benchmark) -> str:
    """The page of ``run``, finished or not."""
    title = f"AquaQuad Envs: {run.task}"
    state = "" if run.complete else ' <b class="warn">Not complete: the run was interrupted.</b>'
    links = "".join(
        f'<a href="#{escape(part.suite.name)}">{escape(part.suite.name)}</a>' for part in run.runs
    )
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="lead">{_count(run.policies, "policy", "policies")} on {_count(run.runs, "suite", "suites")}, '
        f"{sum(len(part.seeds) for part in run.runs)} seeds, every policy on the same ones. "
        f"{escape(run.manifest['started'])}, {run.wall_s:.0f} s.{state}</p>",
        f'<nav>{links}<a href="#knowledge">what policies knew</a><a href="#method">method</a>'
        '<a href="#run">this run</a></nav>',
        "<h2>Scores</h2><p class='soft'>0 is direct flight, 1 the least flight energy on the true current.</p>",
        _overview(run),
        *(_suite(part) for part in run.runs),
        _published(run),
        '<h2 id="knowledge">What each policy was allowed to know</h2>',
        _knowledge(run),
        f'<h2 id="method">Units and method</h2>{_notes()}',
        '<h2 id="run">This run</h2>',
        _manifest(run),
    ]
    return page(title, "\n".join(body))


def _count(things: list[Any], one: str, many: str) -> str:
    return f"{len(things)} {one if len(things) == 1 else many}"


def _published(run: Benchmark) -> str:
    found = section_in(run.output)
    return "" if found is None else f'<h2 id="published">Published tables</h2>{found}'


def _notes() -> str:
    text = resources.files("evaluation").joinpath("notes.html").read_text(encoding="utf-8")
    return Template(text).substitute(RESAMPLES=RESAMPLES, CHUNK=CHUNK, RELIABLE=round(100 * _RELIABLE))


def _name(policy: str) -> str:
    colour = figures.colour_of(policy)
    return f'<i class="swatch" style="background:{colour}"></i>{escape(policy)}'


def _overview(run: Benchmark) -> str:
    entries = {(part.suite.name, entry["policy"]): entry for part in run.runs for entry in part.entries}
    suites = [part.suite.name for part in run.runs]
    top = {suite: _top([entries.get((suite, p), {}).get("score") for p in run.policies]) for suite in suites}
    rows = []
    for policy in run.policies:
        cells = [_name(policy)]
        for suite in suites:
            entry = entries.get((suite, policy))
            if entry is None or "error" in entry:
                cells.append('<span class="soft">did not run</span>' if entry else DASH)
                continue
            best = entry["score"] == top[suite]
            cells.append(with_range(number(entry["score"]), entry["score_summary"]["ci95"], best=best))
        rows.append(cells)
    return table(["policy", *map(escape, suites)], rows)


def _top(values: list[float | None]) -> float | None:
    """The greatest finite value."""
    return max((value for value in values if value is not None and value == value), default=None)


def _suite(run: SuiteRun) -> str:
    name = run.suite.name
    parts = [
        f'<h2 id="{escape(name)}">{escape(name)}</h2>',
        f"<p>{escape(run.suite.about[0].upper() + run.suite.about[1:])}.",
    ]
    parts.append(f' <span class="soft">{len(run.seeds)} episodes, seeds {_seed_range(run)}.</span></p>')
    parts += [f'<p class="soft">{escape(note)}</p>' for note in run.notes]
    if run.error is not None:
        return "".join(parts) + f'<p class="warn">This suite could not run: {escape(run.error)}</p>'
    finished = [entry for entry in run.entries if "error" not in entry]
    parts.append(_main_table(finished))
    for entry in run.entries:
        if "error" in entry:
            error = entry["error"]
            parts.append(
                f'<p class="warn"><b>{escape(entry["policy"])}</b> did not run: {escape(error["type"])}: '
                f'{escape(error["message"])} <span class="soft">({escape(error["where"])})</span></p>'
            )
    if not finished:
        return "\n".join(parts)
    parts.append(
        picture(
            figures.distributions(run),
            f"Flight energy and score of each policy on {name}",
            "A dot is an episode, the bar the middle half, the stroke the median, the diamond the mean. "
            "Scores below −1 are drawn at −1.",
        )
    )
    parts.append(
        picture(
            figures.tracks(run),
            f"Best and median track of each policy on {name}",
            "The best and the median episode of each policy by saving (failures last). Blue: drift, one piece a "
            "decision; orange dashes: flight. Circle: start; star: goal; cross: where a failed episode ended. Grey "
            "shade and arrows: the true current halfway through the episode; dark: obstacles.",
        )
    )
    if run.suite.stratified:
        parts += ["<h3>By difficulty</h3>", _strata_table(finished)]
    if run.pairs:
        title = "Paired differences between policies on the same seeds"
        parts.append(folded(title, _paired_table(run)))
    parts.append(folded("All metrics", _all_metrics(finished)))
    return "\n".join(parts)


def _seed_range(run: SuiteRun) -> str:
    if run.suite.stratified:
        counts = {
            stratum: int((run.strata == stratum).sum()) for stratum in dict.fromkeys(run.strata.tolist())
        }
        return "frozen in strata (" + ", ".join(f"{k}: {v}" for k, v in counts.items()) + ")"
    return f"{run.seeds.min()} to {run.seeds.max()}"


def _cells(entry: dict[str, Any], top: dict[str, float | None]) -> list[str]:
    """The columns that the main table and the strata share."""
    metrics = entry["metrics"]
    success, energy = metrics["success"], metrics["flight_energy_wh"]
    return [
        with_range(
            percent(success["mean"]), success["ci95"], percent, best=success["mean"] == top["success"]
        ),
        with_range(number(energy["mean"]), energy["ci95"], best=energy["mean"] == top["mean"]),
        with_range(number(energy["iqm"]), energy["iqm_ci95"], best=energy["iqm"] == top["iqm"]),
        percent(metrics["saving_vs_direct"]["mean"]),
        percent(metrics["optimality_gap"]["mean"]),
        with_range(
            number(entry["score"]), entry["score_summary"]["ci95"], best=entry["score"] == top["score"]
        ),
    ]


_HEAD = (
    "arrived",
    "flight energy, Wh<br>mean",
    "flight energy, Wh<br>IQM",
    "saving",
    "gap to<br>optimum",
    "score",
)


def _tops(entries: list[dict[str, Any]]) -> dict[str, float | None]:
    reliable = [entry for entry in entries if entry["metrics"]["success"]["mean"] >= _RELIABLE]
    least = {}
    for key in ("mean", "iqm"):
        low = _top([-entry["metrics"]["flight_energy_wh"][key] for entry in reliable])
        least[key] = None if low is None else -low
    return {
        **least,
        "success": _top([entry["metrics"]["success"]["mean"] for entry in entries]),
        "score": _top([entry["score"] for entry in entries]),
    }


def _main_table(entries: list[dict[str, Any]]) -> str:
    top = _tops(entries) if entries else {}
    rows = [
        [
            _name(entry["policy"]),
            *_cells(entry, top),
            number(entry["metrics"]["duration_s"]["mean"] / 3600, 1),
            number(entry["planning_ms_per_decision"], 3),
            number(entry["decisions_per_episode"], 0),
        ]
        for entry in entries
    ]
    return table(["policy", *_HEAD, "duration, h", "planning,<br>ms a decision", "decisions"], rows)


def _strata_table(entries: list[dict[str, Any]]) -> str:
    rows = []
    for stratum in entries[0]["strata"]:
        parts = [entry["strata"][stratum] for entry in entries]
        top = _tops(parts)
        for entry, part in zip(entries, parts, strict=True):
            rows.append(
                [f"{escape(stratum)}", _name(entry["policy"]), str(part["episodes"]), *_cells(part, top)]
            )
    return table(["stratum", "policy", "episodes", *_HEAD], rows, text=(1,))


def _paired_table(run: SuiteRun) -> str:
    rows = []
    for pair in run.pairs:
        energy, score = pair["flight_energy_wh"], pair["score"]
        rows.append(
            [
                f"{_name(pair['a'])} against {_name(pair['b'])}",
                str(energy["n"]),
                with_range(number(energy["difference"]), energy["ci95"]),
                with_range(
                    percent(energy["probability_of_improvement"]), energy["probability_ci95"], percent
                ),
                str(score["n"]),
                with_range(number(score["difference"]), score["ci95"]),
                with_range(percent(score["probability_of_improvement"]), score["probability_ci95"], percent),
            ]
        )
    head = [
        "first against second", "seeds both<br>arrived on", "energy, Wh:<br>first − second", "first flies<br>on less",
        "seeds", "score:<br>first − second", "first scores<br>higher",
    ]  # fmt: skip
    return table(head, rows)


def _all_metrics(entries: list[dict[str, Any]]) -> str:
    rows = []
    for entry in entries:
        for metric, found in entry["metrics"].items():
            digits = 0 if metric.endswith("_s") or metric == "mean_hdop" else 3
            rows.append(
                [
                    _name(entry["policy"]),
                    f"<code>{escape(metric)}</code>",
                    str(found["n"]),
                    *(number(found[key], digits) for key in ("mean", "std", "median", "iqm")),
                    " … ".join(number(bound, digits) for bound in found["ci95"]),
                ]
            )
    outcomes = table(
        ["policy", "how episodes ended"],
        [
            [_name(e["policy"]), escape(", ".join(f"{n} {k}" for k, n in e["outcomes"].items()))]
            for e in entries
        ],
        text=(1,),
    )
    head = ["policy", "metric", "n", "mean", "standard deviation", "median", "IQM", "95 % of the mean"]
    return outcomes + table(head, rows, text=(1,))


def _knowledge(run: Benchmark) -> str:
    found: dict[str, dict[str, Any]] = {}
    for part in run.runs:
        for entry in part.entries:
            if "information" in entry:
                found.setdefault(entry["policy"], entry)
    rows = [
        [
            _name(policy),
            escape(entry["about"]),
            escape(entry["information"]),
            escape("; ".join(f"{k}: {v}" for k, v in entry.get("checkpoint", {}).items())),
        ]
        for policy, entry in found.items()
    ]
    return table(["policy", "what it does", "what it knew", "checkpoint"], rows, text=(1, 2, 3))


def _manifest(run: Benchmark) -> str:
    machine = {key: value for key, value in run.machine.items() if key != "packages"}
    packages = {name: version or "not installed" for name, version in run.machine["packages"].items()}
    seeds = "".join(
        f"<h3>{escape(part.suite.name)}</h3><p><code>{escape(part.suite.params)}</code></p>"
        f"<p><code>{' '.join(map(str, part.seeds))}</code></p>"
        for part in run.runs
    )
    return (
        definitions({**run.manifest, "wall time": f"{run.wall_s:.1f} s", "seed set": run.seed, **machine})
        + folded("Versions", definitions(packages))
        + folded("Parameters and seeds of every suite", seeds)
    )


def print_summary(run: Benchmark, console: Any) -> None:
    """One table a suite on the terminal."""
    from rich.markup import escape as plain
    from rich.table import Table

    for part in run.runs:
        if part.error is not None:
            console.print(f"[red]{part.suite.name}: {plain(part.error)}[/red]", soft_wrap=True)
            continue
        shown = Table(title=f"{part.suite.name}, {len(part.seeds)} episodes", title_justify="left")
        shown.add_column("policy")
        for head in ("arrived", "energy Wh", "95 %", "IQM", "saving", "score", "ms/decision"):
            shown.add_column(head, justify="right")
        for entry in part.entries:
            if "error" in entry:
                shown.add_row(entry["policy"], "[red]did not run[/red]")
                continue
            energy, metrics = entry["metrics"]["flight_energy_wh"], entry["metrics"]
            shown.add_row(
                entry["policy"], percent(metrics["success"]["mean"]), number(energy["mean"]),
                f"{number(energy['ci95'][0])}…{number(energy['ci95'][1])}", number(energy["iqm"]),
                percent(metrics["saving_vs_direct"]["mean"]), number(entry["score"]),
                number(entry["planning_ms_per_decision"], 3),
            )  # fmt: skip
        console.print(shown)
        for entry in part.entries:
            if "error" in entry:
                error = entry["error"]
                message = f"{entry['policy']} did not run: {error['type']}: {error['message']}"
                console.print(f"[red]{plain(message)}[/red]", soft_wrap=True)

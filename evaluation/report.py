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
from evaluation.tables import TABLES, Column, Pairing, TaskTable

#: A policy that arrives (keeps its team) less often than this competes for no prize but that.
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
        f'<a href="#{escape(_anchor(part, run.several))}">{escape(_anchor(part, run.several))}</a>'
        for part in run.runs
    )
    policies = list(dict.fromkeys(name for task in run.tasks for name in run.policies_of(task)))
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="lead">{_count(policies, "policy", "policies")} on {_count(run.runs, "suite", "suites")}, '
        f"{sum(len(part.seeds) for part in run.runs)} seeds, every policy on the same ones. "
        f"{escape(run.manifest['started'])}, {run.wall_s:.0f} s.{state}</p>",
        f'<nav>{links}<a href="#knowledge">what policies knew</a><a href="#method">method</a>'
        '<a href="#run">this run</a></nav>',
        *(_overview(run, task) for task in run.tasks),
        *(_suite(part, run.several) for part in run.runs),
        _published(run),
        '<h2 id="knowledge">What each policy was allowed to know</h2>',
        _knowledge(run),
        f'<h2 id="method">Units and method</h2>{_notes(run)}',
        '<h2 id="run">This run</h2>',
        _manifest(run),
    ]
    return page(title, "\n".join(body))


def _count(things: list[Any], one: str, many: str) -> str:
    return f"{len(things)} {one if len(things) == 1 else many}"


def _published(run: Benchmark) -> str:
    found = section_in(run.output)
    return "" if found is None else f'<h2 id="published">Published tables</h2>{found}'


def _anchor(part: SuiteRun, several: bool) -> str:
    """A suite's name on the page: with its task's where there are several."""
    return f"{part.suite.task}-{part.suite.name}" if several else part.suite.name


def _notes(run: Benchmark) -> str:
    values = {"RESAMPLES": RESAMPLES, "CHUNK": CHUNK, "RELIABLE": round(100 * _RELIABLE)}
    parts = []
    for task in run.tasks:
        text = resources.files("evaluation").joinpath(TABLES[task].notes).read_text(encoding="utf-8")
        head = f"<h3>{escape(task)}</h3>" if run.several else ""
        parts.append(head + Template(text).substitute(values))
    return "\n".join(parts)


def _name(policy: str) -> str:
    colour = figures.colour_of(policy)
    return f'<i class="swatch" style="background:{colour}"></i>{escape(policy)}'


def _overview(run: Benchmark, task: str) -> str:
    parts = [part for part in run.runs if part.suite.task == task]
    entries = {(part.suite.name, entry["policy"]): entry for part in parts for entry in part.entries}
    suites = [part.suite.name for part in parts]
    policies = run.policies_of(task)
    top = {suite: _top([entries.get((suite, p), {}).get("score") for p in policies]) for suite in suites}
    rows = []
    for policy in policies:
        cells = [_name(policy)]
        for suite in suites:
            entry = entries.get((suite, policy))
            if entry is None or "error" in entry:
                cells.append('<span class="soft">did not run</span>' if entry else DASH)
                continue
            best = entry["score"] == top[suite]
            cells.append(with_range(number(entry["score"]), entry["score_summary"]["ci95"], best=best))
        rows.append(cells)
    title = f"Scores: {escape(task)}" if run.several else "Scores"
    head = f"<h2>{title}</h2><p class='soft'>{escape(TABLES[task].score_ends)}</p>\n"
    return head + table(["policy", *map(escape, suites)], rows)


def _top(values: list[float | None]) -> float | None:
    """The greatest finite value."""
    return max((value for value in values if value is not None and value == value), default=None)


def _suite(run: SuiteRun, several: bool = False) -> str:
    name = run.suite.name
    anchor = escape(_anchor(run, several))
    parts = [
        f'<h2 id="{anchor}">{anchor}</h2>',
        f"<p>{escape(run.suite.about[0].upper() + run.suite.about[1:])}.",
    ]
    parts.append(f' <span class="soft">{len(run.seeds)} episodes, seeds {_seed_range(run)}.</span></p>')
    parts += [f'<p class="soft">{escape(note)}</p>' for note in run.notes]
    if run.error is not None:
        return "".join(parts) + f'<p class="warn">This suite could not run: {escape(run.error)}</p>'
    finished = [entry for entry in run.entries if "error" not in entry]
    parts.append(_main_table(finished, run.table))
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
            f"{run.table.distribution_title} {name}",
            "A dot is an episode, the bar the middle half, the stroke the median, the diamond the mean. "
            "Scores below −1 are drawn at −1.",
        )
    )
    parts.append(
        picture(
            figures.tracks(run),
            f"Best and median track of each policy on {name}",
            run.table.tracks_caption,
        )
    )
    if run.suite.stratified:
        parts += ["<h3>By difficulty</h3>", _strata_table(finished, run.table)]
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


def _statistic(entry: dict[str, Any], column: Column) -> float | None:
    """What ``column`` shows of ``entry``."""
    return entry["score"] if column.metric == "score" else entry["metrics"][column.metric][column.statistic]


def _cell(entry: dict[str, Any], column: Column, top: float | None) -> str:
    def shown(value: float | None) -> str:
        if column.percent:
            return percent(value)
        return number(None if value is None else value / column.scale, column.digits)

    value = _statistic(entry, column)
    if not column.interval:
        return shown(value)
    found = entry["score_summary"] if column.metric == "score" else entry["metrics"][column.metric]
    bounds = found["iqm_ci95" if column.statistic == "iqm" else "ci95"]
    return with_range(shown(value), bounds, shown, best=top is not None and value == top)


def _best(entries: list[dict[str, Any]], column: Column, lasted: str) -> float | None:
    """The best value of a column; for some of them only policies count that nearly always last."""
    if column.better is None:
        return None
    if column.reliable:
        entries = [entry for entry in entries if entry["metrics"][lasted]["mean"] >= _RELIABLE]
    sign = -1.0 if column.better == "less" else 1.0
    values = [_statistic(entry, column) for entry in entries]
    top = _top([None if value is None else sign * value for value in values])
    return None if top is None else sign * top


def _columns(entries: list[dict[str, Any]], columns: tuple[Column, ...]) -> list[Column]:
    """``columns`` without those optional ones that no policy fills."""
    return [
        column
        for column in columns
        if not column.optional or _top([_statistic(entry, column) for entry in entries]) is not None
    ]


def _main_table(entries: list[dict[str, Any]], shown: TaskTable) -> str:
    columns = _columns(entries, shown.main)
    tops = [_best(entries, column, shown.lasted) for column in columns]
    rows = [
        [
            _name(entry["policy"]),
            *(_cell(entry, column, top) for column, top in zip(columns, tops, strict=True)),
            number(entry["planning_ms_per_decision"], 3),
            number(entry["decisions_per_episode"], 0),
        ]
        for entry in entries
    ]
    heads = [column.heading for column in columns]
    return table(["policy", *heads, "planning,<br>ms a decision", "decisions"], rows)


def _strata_table(entries: list[dict[str, Any]], shown: TaskTable) -> str:
    columns = _columns(entries, shown.main[: shown.strata])
    rows = []
    for stratum in entries[0]["strata"]:
        parts = [entry["strata"][stratum] for entry in entries]
        tops = [_best(parts, column, shown.lasted) for column in columns]
        for entry, part in zip(entries, parts, strict=True):
            cells = [_cell(part, column, top) for column, top in zip(columns, tops, strict=True)]
            rows.append([f"{escape(stratum)}", _name(entry["policy"]), str(part["episodes"]), *cells])
    heads = [column.heading for column in columns]
    return table(["stratum", "policy", "episodes", *heads], rows, text=(1,))


def _paired_table(run: SuiteRun) -> str:
    # A metric that no policy of a suite has is not compared, unless it is the only one.
    pairings = [
        p
        for p in run.table.pairings
        if len(run.table.pairings) == 1 or any(pair[p.metric]["n"] for pair in run.pairs)
    ]
    score = Pairing(
        metric="score", less_is_better=False,
        headings=("seeds", "score:<br>first − second", "first scores<br>higher"),
    )  # fmt: skip
    rows = []
    for pair in run.pairs:
        cells = [f"{_name(pair['a'])} against {_name(pair['b'])}"]
        for pairing in [*pairings, score]:
            found, digits = pair[pairing.metric], pairing.digits
            cells += [
                str(found["n"]),
                with_range(
                    number(found["difference"], digits), [*found["ci95"]], lambda v, d=digits: number(v, d)
                ),
                with_range(percent(found["probability_of_improvement"]), found["probability_ci95"], percent),
            ]
        rows.append(cells)
    heads = [heading for pairing in [*pairings, score] for heading in pairing.headings]
    return table(["first against second", *heads], rows)


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
        f"<h3>{escape(_anchor(part, run.several))}</h3><p><code>{escape(part.suite.params)}</code></p>"
        f"<p><code>{' '.join(map(str, part.seeds))}</code></p>"
        for part in run.runs
    )
    return (
        definitions({**run.manifest, "wall time": f"{run.wall_s:.1f} s", "seed set": run.seed, **machine})
        + folded("Versions", definitions(packages))
        + folded("Parameters and seeds of every suite", seeds)
    )


def _terminal(found: dict[str, Any], form: str) -> str:
    """One cell on the terminal: "percent" of a mean, "ci95", or a statistic by its name."""
    if form == "percent":
        return percent(found["mean"])
    return "…".join(map(number, found["ci95"])) if form == "ci95" else number(found[form])


def print_summary(run: Benchmark, console: Any) -> None:
    """One table a suite on the terminal."""
    from rich.markup import escape as plain
    from rich.table import Table

    for part in run.runs:
        if part.error is not None:
            console.print(f"[red]{_anchor(part, run.several)}: {plain(part.error)}[/red]", soft_wrap=True)
            continue
        shown = Table(title=f"{_anchor(part, run.several)}, {len(part.seeds)} episodes", title_justify="left")
        shown.add_column("policy")
        finished = [entry for entry in part.entries if "error" not in entry]
        kept = {column.metric for column in _columns(finished, part.table.main)}
        shown_of = [item for item in part.table.terminal if item[1] in kept]
        for head, *_ in shown_of:
            shown.add_column(head, justify="right")
        for head in ("score", "ms/decision"):
            shown.add_column(head, justify="right")
        for entry in part.entries:
            if "error" in entry:
                shown.add_row(entry["policy"], "[red]did not run[/red]")
                continue
            shown.add_row(
                entry["policy"], *(_terminal(entry["metrics"][metric], form) for _, metric, form in shown_of),
                number(entry["score"]), number(entry["planning_ms_per_decision"], 3),
            )  # fmt: skip
        console.print(shown)
        for entry in part.entries:
            if "error" in entry:
                error = entry["error"]
                message = f"{entry['policy']} did not run: {error['type']}: {error['message']}"
                console.print(f"[red]{plain(message)}[/red]", soft_wrap=True)

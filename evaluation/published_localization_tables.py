"""The published results of transponder localization beside ours, as tables of plain text."""

from __future__ import annotations

from typing import Any

from evaluation.markup import DASH, escape, number, picture, table
from evaluation.published_localization import MARK

#: A figure's name, which is its file's too, and its caption; the table that it stands behind.
CAPTIONS = {
    "localization": "Mean of Σ ln det Y and RMS error over measurements, by steps ahead. Bars: published, with its "
    "standard deviation over runs.",
    "localization-tracks": "The first run of each policy. Circle: first measurement; dots: measurements; stars: "
    "transponders.",
    "localization-consistency": "Four fixed places: estimates of the transponder at (17, 15, 6) m with the 95 % "
    "ellipse of the estimator and that of their scatter; NEES of one and of four transponders against χ².",
}
_BEHIND = {"msla": ("localization", "localization-tracks"), "fixed": ("localization-consistency",)}
#: What a marked cell shows.
_MARKS = {True: " ▲", False: " ▼"}

Table = tuple[str, str, str, list[str], list[list[str]]]


def mark(apart: float | None) -> str:
    """A triangle, up or down, where ours differs by more than three standard errors of the difference."""
    return "" if apart is None or abs(apart) <= MARK else _MARKS[apart > 0]


def tables(found: dict[str, Any]) -> list[Table]:
    """All tables: key, title, note, head and rows of plain text."""
    return [
        *((name, *_comparison(name, part)) for name, part in found["tables"].items()),
        ("fixed", *_fixed(found["fixed"])),
        ("goal", *_goal(found)),
    ]


def _comparison(name: str, part: dict[str, Any]) -> tuple[str, str, list[str], list[list[str]]]:
    field = name.startswith("field")
    whose = ", ".join(f"{m} of {M}" for M, m in part["error_of"].items())
    note = (
        f"Published: Garcia 2018, {part['source']}, {part['published_runs']} runs, deviation over runs in "
        f"brackets. Ours: {part['runs']} runs, ± standard error. RMS error of transponder {whose}, its error by "
        f"bootstrap. k = 0 moves at random. {_MARKS[True].strip()} {_MARKS[False].strip()}: above, below by more than "
        f"{MARK:g} standard errors of the difference; of a published RMS error none is given, ours is taken for it."
    )
    if field:
        note += (
            " Published from ranges recorded at sea, with errors of the vehicle's and the transponders' places; ours "
            "simulates its settings: cells are not marked."
        )
    else:
        note += " Planning: processor time of a run of 30 measurements, published (in brackets) of 50."
    head = ["M", "k"]
    for cell in part["rows"][0]["cells"]:
        head += [
            f"published\nn = {cell['epoch']}",
            "ours\nΣ ln det",
            f"published\nn = {cell['epoch']}",
            "ours\nRMS, m",
        ]
    head += ["diverged", "planning,\nms a run"]
    rows = []
    for row in part["rows"]:
        cells = [str(row["M"]), str(row["k"])]
        for cell in row["cells"]:
            theirs, apart = cell["published"], cell["apart"]
            cells += [
                f"{number(theirs['log_det'])} ({number(theirs['std'])})",
                f"{number(cell['log_det'])} ± {number(cell['se'])}"
                + ("" if field else mark(apart["log_det"])),
                number(theirs["rms_m"]),
                f"{number(cell['rms_m'])} ± {number(cell['rms_se'])}"
                + ("" if field else mark(apart["rms_m"])),
            ]
        spent = number(1e3 * row["planning_s_a_run"], 1) if row["k"] else DASH
        if row["published_planning_s_a_run"] is not None and not field:
            spent += f" ({number(1e3 * row['published_planning_s_a_run'], 0)})"
        rows.append([*cells, str(row["diverged"]), spent])
    return part["title"], note, head, rows


def _consistent(found: dict[str, Any]) -> str:
    return (
        f"mean {number(found['mean'])} ± {number(found['se'])} ({found['degrees']} is right); Kolmogorov–Smirnov "
        f"{number(found['ks'], 3)}, p = {number(found['p'], 3)}"
    )


def _percent(share: dict[str, float]) -> str:
    return f"{number(100 * share['mean'], 1)} ± {number(100 * share['se'], 1)} %"


def _fixed(part: dict[str, Any]) -> tuple[str, str, list[str], list[list[str]]]:
    def axes(values: list[float]) -> str:
        return " × ".join(number(value, 3) for value in values)

    rows = [
        ["NEES, M = 1", "“fits” χ²(3)", _consistent(part["nees"]["1"])],
        ["NEES, M = 4", "“fits” χ²(12), elsewhere", _consistent(part["nees"]["4"])],
        ["truth inside the run's own 95 % ellipse", DASH, _percent(part["inside_own_ellipse"])],
        ["estimates inside the 95 % ellipse of their scatter", DASH, _percent(part["inside_sample_ellipse"])],
        [
            "semi-axes of the 95 % ellipse, m", "“comparable”",
            f"{axes(part['estimated_axes_m'])} by the estimator, {axes(part['actual_axes_m'])} of the scatter",
        ],
        ["diverged", DASH, str(part["diverged"])],
    ]  # fmt: skip
    return (
        "Consistency from four fixed places",
        f"Published as figures: Garcia 2018, {part['source']}. Ours: {part['runs']} runs.",
        ["", "published", "ours"],
        rows,
    )


def _goal(found: dict[str, Any]) -> tuple[str, str, list[str], list[list[str]]]:
    """Where ours is at or above the published Σ ln det, and how consistent it is along planned tracks."""
    rows = []
    for name in ("msla", "greedy"):
        for row in found["tables"][name]["rows"]:
            if not row["k"]:
                continue
            above = [cell["log_det"] >= cell["published"]["log_det"] for cell in row["cells"]]
            below = [
                f"n = {cell['epoch']} by {number(cell['published']['log_det'] - cell['log_det'])} ± "
                f"{number(float((cell['se'] ** 2 + cell['published']['se'] ** 2) ** 0.5))}"
                for cell, good in zip(row["cells"], above, strict=True)
                if not good
            ]
            rows.append(
                [
                    f"{found['tables'][name]['title']}, M = {row['M']}, k = {row['k']}",
                    f"{sum(above)} of {len(above)}" + (f"; below: {', '.join(below)}" if below else ""),
                    _consistent(row["nees"]),
                ]
            )
    return (
        "At or above the published Σ ln det, and NEES along the planned tracks",
        "NEES at the last measurement, summed over transponders, against χ² with 3 M degrees of freedom.",
        ["row", "cells at or above", "NEES at the end"],
        rows,
    )


def section(found: dict[str, Any], pictures: dict[str, bytes] | None = None) -> str:
    """The tables as HTML, each figure behind the table it belongs to if ``pictures`` are given."""
    parts = []
    for name, title, note, head, rows in tables(found):
        parts.append(f'<h3>{escape(title)}</h3><p class="soft">{escape(note)}</p>')
        cells = [[escape(cell) for cell in row] for row in rows]
        prose = range(1, len(head)) if len(head) == 3 else ()
        parts.append(table([escape(text).replace("\n", "<br>") for text in head], cells, text=tuple(prose)))
        if pictures is not None:
            for figure in _BEHIND.get(name, ()):
                parts.append(picture(pictures[figure], CAPTIONS[figure], escape(CAPTIONS[figure])))
    return "\n".join(parts)


def print_tables(found: dict[str, Any], console: Any) -> None:
    """The tables on the terminal: of the wide ones Σ ln det and RMS error apart."""
    from rich.table import Table as Shown

    for _, title, note, head, rows in tables(found):
        pieces = [("", list(range(len(head))))]
        if len(head) > 3:
            wide = range(2, len(head) - 2)
            # The last two columns go with the narrower table.
            pieces = [
                (": Σ ln det Y", [0, 1, *(k for k in wide if (k - 2) % 4 < 2)]),
                (
                    ": RMS error, m",
                    [0, 1, *(k for k in wide if (k - 2) % 4 >= 2), len(head) - 2, len(head) - 1],
                ),
            ]
        for k, (what, columns) in enumerate(pieces):
            last = k == len(pieces) - 1
            shown = Shown(
                title=title + what,
                title_justify="left",
                caption=note if last else None,
                caption_justify="left",
            )
            for column in columns:
                prose = len(head) == 3
                shown.add_column(
                    head[column], justify="right" if column and not prose else "left", no_wrap=not prose
                )
            for row in rows:
                shown.add_row(*(row[column] for column in columns))
            console.print(shown)

"""The published study of plume tracing beside ours, as tables of plain text."""

from __future__ import annotations

from typing import Any

from evaluation.markup import DASH, escape, number, percent, picture, table
from evaluation.published_plume import MARK
from evaluation.published_plume_values import COLUMNS

#: A figure's name, which is its file's too, and its caption.
CAPTIONS = {
    "plume": "Mean distances at the end against the error: published (crosses, five runs), the printed script run "
    "again "
    "(filled, with the standard deviation over runs) and ours (open).",
    "plume-orientation": "Figure 5 run again, from above (circles: starts; star: lamp), and teams that begin "
    "anywhere in a "
    "square.",
}
_BEHIND = {"position": "plume", "orientation": "plume-orientation"}
_MARKS = {True: " ▲", False: " ▼"}
_VARIANTS = {
    "published": "script", "one factor": "one factor", "product": "ours",
}  # fmt: skip
_UNITS = {
    "noise": ("sensor\nnoise", 100.0, "%"),
    "position": ("error of\nplace", 1.0, "m"),
    "heading": ("heading\nerror", 1.0, "°"),
}

Table = tuple[str, str, str, list[str], list[list[str]]]


def mark(apart: float | None) -> str:
    """A triangle, up or down, where ours is above or below by more than three standard errors of the difference."""
    return "" if apart is None or not abs(apart) > MARK else _MARKS[apart > 0]


def _spread(value: dict[str, float], apart: float | None) -> str:
    return f"{number(value['mean'])} ± {number(value['std'])}{mark(apart)}"


def _rows(name: str, rows: list[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    what, scale, unit = _UNITS[name]
    published = name != "heading"
    head = ["start", what, "variant"]
    for title in COLUMNS.values():
        head += ["publ.", f"run again\n{title}, m"] if published else [f"{title}, m"]
    # A terminal has room for one of the two beside the published numbers.
    head += ["reached\nto 1 m"] if published else ["reached\nto 1 m", "updates\nto source"]
    cells = []
    for row in rows:
        line = [row["start"], f"{scale * row['level']:g} {unit}", _VARIANTS[row["variant"]]]
        for column in COLUMNS:
            apart = None if row["apart"] is None else row["apart"][column]
            theirs = DASH if row["published"] is None else number(row["published"][column])
            line += [theirs] * published + [_spread(row["ours"][column], apart)]
        cells.append([*line, percent(row["success"])])
        if not published:
            cells[-1].append(number(row["updates_to_source"]["mean"], 1))
    return head, cells


def tables(found: dict[str, Any]) -> list[Table]:
    """All tables: key, title, note, head and rows of plain text."""
    fewer = found["fewer"]
    source = found["source"]
    marks = (
        f"{_MARKS[True].strip()} {_MARKS[False].strip()}: ours above or below by more than {MARK:g} standard errors "
        "of the difference, where the published mean is taken for one of "
        f"{found['published_runs']} runs that scatter as ours do."
    )
    return [
        (
            "noise", "Plume tracing: sensor noise",
            f"Published: {source}, tables 1 and 2. Ours: mean ± standard deviation over {found['runs']} runs, in rows "
            f"“ours” {fewer}. Script: the algorithm as printed, robots in turn, ten readings of the moment, QR. One "
            "factor for all: its noise as printed, which does not move the minimum; noise of each reading does. "
            f"Ours: all at once, best 20 readings, SVD with fall-back to the plane. {marks}",
            *_rows("noise", found["noise"]),
        ),
        (
            "position", "Plume tracing: position error",
            f"Published: {source}, tables 3 and 4. Script: the error is added to the true places at every robot's "
            f"update, a random walk, as printed. Ours: an error of measurement, {fewer} runs. {marks}",
            *_rows("position", found["position"]),
        ),
        (
            "locked", "Plume tracing: updates until the team no longer moves",
            f"Published: {source}, section 6. Ours: the last update in which any robot moved by more than 1 mm, "
            "mean ± standard deviation, the script without errors.",
            ["start", "published\nabout", "ours"],
            [
                [start, number(row["published"], 0), _spread(row["ours"], None)]
                for start, row in found["locked"].items()
            ],
        ),
        (
            "heading", "Plume tracing: heading error",
            f"Published: {source}, section 8: the robots still find the source, on longer ways. Ours: each robot's "
            f"course is wrong by the same angle all along, uniform within ± the error; {fewer} runs.",
            *_rows("heading", found["heading"]),
        ),
        _orientation(found),
    ]  # fmt: skip


def _orientation(found: dict[str, Any]) -> Table:
    study = found["orientation"]
    at = list(study["rows"][0]["course_off_deg"])
    head = ["field", "reached\nafter", "closest then, m", *(f"course off, °\nupdate {k}" for k in at)]
    rows = [
        [
            row["field"], number(row["reached_at"], 0),
            f"{number(row['closest_then_m'])} ({row['published_updates']} updates)",
            *(number(row["course_off_deg"][k], 0) for k in at),
        ]
        for row in study["rows"]
    ]  # fmt: skip
    reach = "; ".join(
        f"{number(square['furthest_m'], 0)} m {percent(square['reached'])} ({number(square['updates'], 0)} updates)"
        for square in study["squares"]
        if square["field"] == "oriented-light"
    )
    low, high = study["works_up_to_m"]
    note = (
        f"Published: {found['source']}, {study['source']}: robots that take an orientation-dependent light for k/R² "
        "first stray, then close in, and need more updates; it works up to "
        f"{number(low, 0)} to {number(high, 0)} m. Ours: the printed starts (furthest "
        f"{number(study['furthest_start_m'], 0)} m), all at once, {number(study['step_limit_m'], 1)} m an axis; course "
        f"off: mean angle to the source's direction. {study['teams']} random teams a square, orientation-dependent "
        f"light, by the mean distance of the furthest robot: {reach}."
    )
    return "orientation", "Plume tracing: a sensor that depends on orientation", note, head, rows


def section(found: dict[str, Any], pictures: dict[str, bytes] | None = None) -> str:
    """The tables as HTML, each figure behind the table it belongs to if ``pictures`` are given."""
    parts = []
    for key, title, note, head, rows in tables(found):
        parts.append(f'<h3>{escape(title)}</h3><p class="soft">{escape(note)}</p>')
        parts.append(
            table(
                [escape(text).replace("\n", "<br>") for text in head],
                [[escape(cell) for cell in row] for row in rows],
            )
        )
        if pictures is not None and key in _BEHIND:
            name = _BEHIND[key]
            parts.append(picture(pictures[name], CAPTIONS[name], escape(CAPTIONS[name])))
    return "\n".join(parts)


def print_tables(found: dict[str, Any], console: Any) -> None:
    """The tables on the terminal."""
    from rich.table import Table as Grid

    for _, title, note, head, rows in tables(found):
        shown = Grid(title=title, title_justify="left", caption=note, caption_justify="left")
        for k, text in enumerate(head):
            shown.add_column(text, justify="right" if k else "left", no_wrap=True)
        for row in rows:
            shown.add_row(*row)
        console.print(shown)

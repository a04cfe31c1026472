"""The published results of tracking and placement beside ours: all tables and figures of ``evaluate.py published``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from aquaquad_envs.errors import check_range
from evaluation import published_figures
from evaluation.markup import DASH, escape, number, picture, table
from evaluation.published_laboratory import HIGH_SHARE, PEAK_DELAY_S, reproduce_laboratory
from evaluation.published_maps import reproduce_maps
from evaluation.published_placement import reproduce_placement
from evaluation.published_tracking import METHODS, MODELS, reproduce_filters
from evaluation.published_tracking import steps as filter_steps

#: Runs of each filter row; with 24 all takes about 45 s on an idle core, filterpy's rows a fifth of it.
RUNS = 24
#: A figure's name, which is its file's too, and its caption.
CAPTIONS = {
    "filters": "EKF (wide) and UKF (narrow) by bearings: the curves of the two lie on each other.",
    "laboratory": "Three TDOA in the room, first run. Dashed: the target leaves its place; stop and go begins.",
    "maps": "HDOP where one vehicle (not drawn) moves and the others and the target stay; white is singular.",
    "placement": "Local optimisation of HDOP from five tries of each start (circles) to their optima (triangles).",
}


def steps(runs: int) -> int:
    """How often :func:`reproduce` calls ``advance``."""
    return filter_steps(runs) + 3


def reproduce(runs: int, seed: int, advance: Callable[[], None]) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Every table, as JSON can hold it, and every figure as PNG by its name."""
    check_range("tracking-runs", runs, 2, 100_000)
    check_range("seed", seed, 0, 2**62)
    filters, filter_curves = reproduce_filters(runs, seed, advance)
    laboratory, laboratory_curves = reproduce_laboratory(runs, seed)
    advance()
    maps, drawn = reproduce_maps()
    advance()
    placement, ways = reproduce_placement(seed)
    advance()
    found = {
        "runs": runs, "seed": seed, "filters": filters, "laboratory": laboratory, "maps": maps,
        "placement": placement,
    }  # fmt: skip
    pictures = {
        "filters": published_figures.filters(filter_curves),
        "laboratory": published_figures.laboratory(laboratory_curves),
        "maps": published_figures.maps(drawn),
        "placement": published_figures.placement(ways),
    }
    return found, pictures


def _with_error(value: dict[str, Any]) -> str:
    """Mean ± standard error, in thousands (k) where large."""
    unit, sign = (1e3, "k") if value["mean"] >= 1e4 else (1.0, "")
    digits = 0 if value["mean"] >= 100 else 1
    mean, error = (None if part is None else part / unit for part in (value["mean"], value["se"]))
    return f"{number(mean, digits)}{sign} ± {number(error, digits)}{sign}"


def _filter_head(errors: str) -> list[str]:
    return [
        "perimeter, motion, angles", "filter", *(f"{name}, {unit}{errors}" for name, unit in (
            ("x", "m²"), ("y", "m²"), ("u", "m²/s²"), ("v", "m²/s²"))),
    ]  # fmt: skip


def _filter_rows(found: dict[str, Any]) -> list[list[str]]:
    rows = []
    for method in METHODS:
        theirs = found["published"][method]
        when = theirs["converged_s"]
        rows.append(
            [
                "published", method.upper(), *(number(value, 1) for value in theirs["mse"].values()),
                f"{_or_never(when['position'])} / {_or_never(when['velocity'])}", number(theirs["time_s"]),
            ]
        )  # fmt: skip
    for row in found["rows"]:
        when = row["converged_s"]
        rows.append(
            [
                _name(row), row["method"].upper(), *(_with_error(value) for value in row["mse"].values()),
                f"{number(when['position'], 0)} / {number(when['velocity'], 0)}",
                number(row["time_s"]["mean"], 3),
            ]
        )  # fmt: skip
    return rows


def _or_never(value: float | None) -> str:
    return "never" if value is None else number(value, 0)


def _name(row: dict[str, Any]) -> str:
    return f"{row['perimeter']}, {MODELS[row['model']]}, {'wrapped' if row['wrap'] else 'plain'}"


def filters_apart(found: dict[str, Any]) -> dict[str, float]:
    """Greatest relative difference of EKF and UKF in any mean square error, angles wrapped and plain."""
    apart = {"wrapped": 0.0, "plain": 0.0}
    rows = {(_name(row), row["method"]): row for row in found["rows"]}
    for (name, method), row in rows.items():
        other = rows[name, "ekf"]
        if method != "ekf":
            key = "wrapped" if row["wrap"] else "plain"
            for part, value in row["mse"].items():
                apart[key] = max(apart[key], abs(value["mean"] / other["mse"][part]["mean"] - 1.0))
    return apart


def _peer_rows(found: dict[str, Any]) -> list[list[str]]:
    return [
        [
            _name(row), row["method"].upper(), *(number(value, 1) for value in row["mse"].values()),
            f"{row['apart_m']:.0e}", number(row["cycle_us"], 0), number(row["ours_cycle_us"], 2),
        ]
        for row in found["filterpy"]["rows"]
    ]  # fmt: skip


def _peer_note(found: dict[str, Any]) -> str:
    peer = found["filterpy"]
    if peer["version"] is None:
        return "filterpy is not installed: its rows are left out (pip install filterpy)."
    return (
        f"filterpy {peer['version']} over the first {number(peer['of_s'], 0)} s of {peer['runs']} run(s), which is "
        "mostly the start, and ours on the same measurements: greatest difference of position."
    )


def _variation_rows(found: dict[str, Any]) -> list[list[str]]:
    return [
        [
            row["title"], method.upper(), *(_with_error(value) for value in row[method]["mse"].values()),
        ]
        for row in found["variations"]["rows"]
        for method in METHODS
        if method in row
    ]  # fmt: skip


def _laboratory_rows(found: dict[str, Any]) -> list[list[str]]:
    theirs, quartiles = found["published"], found["mse_quartiles"]

    def spread(name: str) -> str:
        low, middle, high = quartiles[name]
        value = found["mse"][name]
        return (
            f"{number(value['mean'])} ± {number(value['se'])}; median {number(middle)} "
            f"(quartiles {number(low)} … {number(high)})"
        )

    peaks = found["peaks"]

    def share(seen: str) -> str:
        row = peaks[seen]
        return (
            f"{_share(row['at_high_hdop'])} (by chance {_share(row['by_chance'], error=False)}); rank correlation "
            f"{number(row['rank_correlation']['mean'])} ± {number(row['rank_correlation']['se'])}"
        )

    return [
        ["mean |noise|, ms", number(1e3 * theirs["mean_noise_s"], 1), number(1e3 * found["noise_mean_abs_s"], 2)],
        [
            "convergence, s", f"within {number(theirs['converged_s'], 0)}",
            f"{number(found['converged_s'], 1)} (mean error 10 % of the first); RMS error at "
            f"{number(theirs['converged_s'], 0)} s {number(found['rms_then_m'])} m",
        ],
        ["mean square error x, m²", number(theirs["mse"]["x"]), spread("x")],
        ["mean square error y, m²", number(theirs["mse"]["y"]), spread("y")],
        *(
            [f"RMS error, {part}, m", theirs["rms_m"][part] or DASH, number(value)]
            for part, value in found["rms_m"].items()
        ),
        ["tracks lost", DASH, f"{found['lost']} of {found['runs']} (left out of means)"],
        ["error peaks at high HDOP of the estimate", theirs["error_peaks_at_high_hdop"], share("estimate")],
        ["error peaks at high HDOP of the target", DASH, share("truth")],
    ]  # fmt: skip


def _share(value: dict[str, Any], *, error: bool = True) -> str:
    mean = f"{number(100 * value['mean'], 0)}"
    return f"{mean} ± {number(100 * value['se'], 0)} %" if error else f"{mean} %"


def _placement_rows(found: dict[str, Any]) -> list[list[str]]:
    def between(values: list[float], digits: int) -> str:
        low, high = number(min(values), digits), number(max(values), digits)
        return low if low == high else f"{low} … {high}"

    rows = []
    for row in found["rows"]:
        digits = 4 if row["kind"] == "range" else 1
        title = f"{row['kind']}, {row['start']}"
        if row["standoff_m"]:
            title += f", ≥ {number(row['standoff_m'], 0)} m"
        rows.append(
            [
                title, between(row["begin"], digits), between(row["least_at_first_ranges"], digits),
                between(row["end"], digits), number(row["global"], digits),
                number(row["range_growth"]["mean"], 3), between(row["on_target"], 0),
                between(row["largest_gap_deg"], 0),
            ]
        )  # fmt: skip
    return rows


def _map_rows(found: dict[str, Any]) -> list[list[str]]:
    tdoa, bearing, ranges = found["tdoa"], found["bearing"], found["range"]
    ridge = bearing["ridge"]
    said = found["published"]["said"]
    return [
        [
            "TDOA, third sensor", said["tdoa"],
            f"greatest towards {', '.join(str(k) for k in tdoa['greatest_towards_deg'])}° from east; least "
            f"{number(tdoa['least'], 0)} m/s towards {tdoa['least_towards_deg']}°; north {number(tdoa['north'], 0)} "
            f"({'a dip' if tdoa['north_is_a_dip'] else 'no dip'}); relative change with distance "
            f"{number(tdoa['range_free'], 3)}",
        ],
        [
            "bearing, fourth vehicle", said["bearing"],
            f"{number(bearing['least'], 0)} … {number(bearing['greatest'], 0)} m/rad (assumed in App. C: at most "
            f"{number(bearing['published_greatest'], 0)}; without the vehicle {number(bearing['without_it'], 0)}); "
            f"the ridge is {number(ridge['centre']['from_north_east_deg'], 0)}° off the line of vehicles 1 and 3. With "
            f"App. C's target it is {number(ridge['goal']['towards_vehicle_2_deg'], 0)}° off the line to vehicle 2",
        ],
        ["range, fourth vehicle", DASH, f"{number(ranges['least'])} … {number(ranges['greatest'])}"],
    ]  # fmt: skip


_CONVERGED = "converged,\npos./vel. s"
_PLACEMENT_HEAD = [
    "measurement, start", "HDOP at\nthe start", "best there by\ndirections", "local\noptimum", "global\noptimum",
    "range, end\n/ start", "on the\ntarget", "widest\ngap, °",
]  # fmt: skip


def tables(found: dict[str, Any]) -> list[tuple[str, str, list[str], list[list[str]]]]:
    """All tables: title, note, head and rows of plain text."""
    filters, assumed = found["filters"], found["filters"]["assumed"]
    apart = filters_apart(filters)
    return [
        (
            "EKF against UKF, four bearings: mean square errors",
            f"Published: Dillard 2014, {filters['published']['source']}, one run. Ours: {filters['runs']} runs a row, "
            "mean ± standard error; processor time of a run. Φ: exp(A Δt). The sensors' tracks are not published. "
            f"Assumed: a perimeter of {number(assumed['radius_m'] / 1e3, 0)} km that turns at "
            f"{number(assumed['turning_m_s'], 1)} m/s, a first covariance of {number(assumed['prior'][0], 0)}, noise "
            f"sampled every {number(assumed['dt_s'], 3)} s. Converged: the mean error over runs is 10 % of the first. "
            "On the same measurements the mean square errors of EKF and UKF differ by "
            f"{apart['wrapped']:.0e} (wrapped) and {apart['plain']:.0e} (plain) of themselves at most.",
            [*_filter_head(""), _CONVERGED, "time, s"],
            _filter_rows(filters),
        ),
        (
            "The same by filterpy",
            _peer_note(filters),
            [*_filter_head(""), "apart, m", "µs a cycle", "ours, µs"],
            _peer_rows(filters),
        ),
        (
            "What the assumptions do",
            f"Perimeter diagonal, App. B's motion, wrapped unless said; {filters['variations']['runs']} runs a row.",
            ["assumption", *_filter_head("")[1:]],
            _variation_rows(filters),
        ),
        (
            "Laboratory test, three TDOA",
            f"Published: Dillard 2014, {found['laboratory']['published']['source']}, one run. Ours: "
            f"{found['laboratory']['runs']} runs, each with its own walk. Peaks: stop and go only, share of the "
            f"error's peaks within {number(PEAK_DELAY_S, 0)} s after HDOP was in its upper "
            f"{number(100 * HIGH_SHARE, 0)} %.",
            ["", "published", "ours"],
            _laboratory_rows(found["laboratory"]),
        ),
        (
            "HDOP maps",
            f"Published as figures: Dillard 2014, {found['maps']['published']['source']}.",
            ["map", "published", "ours"],
            _map_rows(found["maps"]),
        ),
        (
            "Placement of eight sensors by local optimisation of HDOP",
            f"Published as figures: Dillard 2014, {found['placement']['published']['source']}. Least … greatest of "
            f"{found['placement']['tries']} tries; bearings in m/rad, proportional to the scale, an assumption "
            f"({number(found['placement']['assumed']['even_radius_m'], 0)} m; evenly there 2r/√N = "
            f"{number(found['placement']['even_bearing_hdop'], 1)}).",
            _PLACEMENT_HEAD,
            _placement_rows(found["placement"]),
        ),
    ]  # fmt: skip


def section(found: dict[str, Any], pictures: dict[str, bytes] | None = None) -> str:
    """The tables as HTML, each figure behind the tables it belongs to if ``pictures`` are given."""
    parts = []
    after = {2: "filters", 3: "laboratory", 4: "maps", 5: "placement"}
    for k, (title, note, head, rows) in enumerate(tables(found)):
        parts.append(f'<h3>{escape(title)}</h3><p class="soft">{escape(note)}</p>')
        if rows:
            cells = [[escape(cell) for cell in row] for row in rows]
            prose = range(1, len(head)) if len(head) == 3 else ()
            parts.append(
                table([escape(text).replace("\n", "<br>") for text in head], cells, text=tuple(prose))
            )
        if pictures is not None and k in after:
            name = after[k]
            parts.append(picture(pictures[name], CAPTIONS[name], escape(CAPTIONS[name])))
    return "\n".join(parts)


def print_tables(found: dict[str, Any], console: Any) -> None:
    """The tables on the terminal."""
    from rich.table import Table

    for title, note, head, rows in tables(found):
        shown = Table(title=title, title_justify="left", caption=note, caption_justify="left")
        for k, text in enumerate(head):
            prose = len(head) == 3
            shown.add_column(text, justify="right" if k and not prose else "left", no_wrap=not prose)
        for row in rows:
            shown.add_row(*row)
        if rows:
            console.print(shown)
        else:
            console.print(f"{title}: {note}")

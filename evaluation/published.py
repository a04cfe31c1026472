"""The published tables beside ours: DR-RRT* here (Dillard, NPS 2014, App. C; SPEC §6), tracking and placement in
:mod:`evaluation.published_sensor_placement`, transponder localization in :mod:`evaluation.published_localization`,
plume tracing in :mod:`evaluation.published_plume`, laser tracking in :mod:`evaluation.published_laser`.

DR-RRT*: published vortex, constant per cell, 60 s Euler drift, published start, goal, team and target. The obstacle set
is not published: ours is one 2 km square at the centre.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_choice, check_range
from aquaquad_envs.tasks.batch import make_world_batch
from baselines import make_policy
from baselines.dr_rrt_star import plan_published
from baselines.problem import DriftHopProblem
from evaluation import (
    manifest,
    published_laser,
    published_localization,
    published_localization_figures,
    published_localization_tables,
    published_plume,
    published_plume_figures,
    published_plume_tables,
    published_sensor_placement,
    statistics,
)
from evaluation.benchmark import write_json, write_text
from evaluation.markup import DASH, definitions, escape, number, page, percent, table

#: What the source reports of 1000 runs: energy, Wh, and time, ms, each mean and standard deviation.
PUBLISHED: dict[str, dict[str, Any]] = {
    "single": {"title": "single solution", "energy_wh": (38.69, 6.81), "time_ms": (190.0, 90.0)},
    "seeking": {"title": "optimality-seeking", "energy_wh": (36.26, 3.93), "time_ms": (4964.0, 18.0)},
}
_WORLD: dict[str, Any] = {"scenario": "vortex", "interpolation": "cell", "integrator": "euler"}


def problem() -> tuple[DriftHopProblem, float]:
    """The published problem and its least flight energy, Wh, from the grid."""
    batch = make_world_batch("drift-hop", 1, **_WORLD)
    batch.reset(0)
    world, params, ocean = batch.worlds[0], batch.params, batch.ocean
    goal = float(world["goal_x"]), float(world["goal_y"])
    made = DriftHopProblem(
        velocity=ocean.velocity, axes=ocean.axes, clearance=ocean.clearance, clearance_grid=ocean.clearance_grid,
        start=(float(world["start_x"]), float(world["start_y"])), goal=goal, half_width_m=params.half_width_m,
        goal_radius_m=params.goal_radius_m, max_hop_m=params.max_hop_m, airspeed_m_s=params.airspeed_m_s,
        flight_power_w=params.flight_power_w, team=batch.constants.team,
        target=(goal[0] + params.target_offset[0], goal[1] + params.target_offset[1]),
    )  # fmt: skip
    bound = make_policy("optimal", batch).bound_wh()  # type: ignore[attr-defined]
    return made, float(bound[0])


#: Tasks with published tables.
TASKS = ("drift-hop", "sensor-placement", "transponder-localization", "laser-tracking", "plume-tracing")
#: Runs of DR-RRT* to one of each row of plume tracing and of each flight of laser tracking, and the least of these.
_PLUME_SHARE, _LASER_SHARE, _LEAST = 5, 20, 4


def reproduce(
    runs: int,
    seed: int,
    output: Path,
    arguments: list[str],
    advance: Callable[[], None],
    *,
    tasks: Sequence[str] = ("drift-hop",),
    tracking_runs: int = published_sensor_placement.RUNS,
) -> dict[str, Any]:
    """Make the tables of ``tasks``; write ``published.json``, ``published.html`` and figures; returns the tables.

    ``runs`` of each variant of DR-RRT* and of each row of transponder localization (in proportion where fewer were
    published), a twentieth of them of each flight of laser tracking, a fifth of each row of plume tracing,
    ``tracking_runs`` of each filter. ``advance`` is called :func:`steps` times.
    """
    for task in tasks:
        check_choice("task", task, TASKS)
    check_range("runs", runs, 1, 1_000_000)
    check_range("tracking-runs", tracking_runs, 2, 100_000)
    check_range("seed", seed, 0, 2**62)
    begun = time.perf_counter()
    found: dict[str, Any] = {
        "schema": 1,
        "machine": manifest.machine(),
        "manifest": manifest.run_manifest(arguments),
    }
    pictures: dict[str, bytes] = {}
    if "drift-hop" in tasks:
        found |= _reproduce_planner(runs, seed, advance)
    if "sensor-placement" in tasks:
        found["sensor_placement"], pictures = published_sensor_placement.reproduce(
            tracking_runs, seed, advance
        )
    if "transponder-localization" in tasks:
        found["localization"], drawn = published_localization.reproduce_localization(runs, seed, advance)
        pictures |= published_localization_figures.draw(drawn)
    if "laser-tracking" in tasks:
        found["laser"], drawn = published_laser.reproduce(max(runs // _LASER_SHARE, _LEAST), seed, advance)
        pictures |= drawn
    if "plume-tracing" in tasks:
        count = max(runs // _PLUME_SHARE, _LEAST)
        found["plume"], drawn = published_plume.reproduce_plume(count, seed, advance)
        pictures |= published_plume_figures.draw(found["plume"], drawn)
    found["manifest"]["wall_s"] = time.perf_counter() - begun
    write_json(output / "published.json", found)
    for name, png in pictures.items():
        (output / f"published-{name}.png").write_bytes(png)
    title = "Published results beside ours"
    body = f"<h1>{title}</h1>{section(found, pictures)}<h2>This run</h2>" + definitions(
        {**found["manifest"], **{k: v for k, v in found["machine"].items() if k != "packages"}}
    )
    write_text(output / "published.html", page(title, body))
    return found


def steps(runs: int, tracking_runs: int, tasks: Sequence[str]) -> int:
    """How often :func:`reproduce` calls ``advance``."""
    planner = len(PUBLISHED) * runs if "drift-hop" in tasks else 0
    placement = published_sensor_placement.steps(tracking_runs) if "sensor-placement" in tasks else 0
    localization = published_localization.steps() if "transponder-localization" in tasks else 0
    plume = published_plume.steps() if "plume-tracing" in tasks else 0
    laser = published_laser.steps(runs) if "laser-tracking" in tasks else 0
    return planner + placement + localization + laser + plume


def _reproduce_planner(runs: int, seed: int, advance: Callable[[], None]) -> dict[str, Any]:
    """Run both variants of DR-RRT* ``runs`` times."""
    task, bound = problem()
    found: dict[str, Any] = {
        "runs": runs,
        "seed": seed,
        "direct_wh": task.direct_energy_wh,
        "bound_wh": bound,
        "rows": [],
    }
    for variant, published in PUBLISHED.items():
        # Compiled code is loaded before the clock runs.
        plan_published(task, seed=seed, variant=variant)
        plans = []
        for run in range(runs):
            plans.append(plan_published(task, seed=seed + run, variant=variant))
            advance()
        energy = np.array([plan.flight_energy_wh if plan.success else np.nan for plan in plans])
        times = np.array([1e3 * plan.planning_time_s for plan in plans])
        ours = statistics.summary(energy, robust=True)
        found["rows"].append(
            {
                "variant": variant,
                "title": published["title"],
                "published": {
                    **published, "saving_vs_direct": 1 - published["energy_wh"][0] / task.direct_energy_wh,
                },
                "arrived": statistics.summary(np.isfinite(energy), share=True),
                "energy_wh": ours,
                "saving_vs_direct": 1 - ours["mean"] / task.direct_energy_wh,
                "optimality_gap": ours["mean"] / bound - 1,
                "time_ms": statistics.summary(times),
                "iterations": statistics.summary(np.array([plan.iterations for plan in plans], dtype=float)),
            }
        )  # fmt: skip
    return found


def _rows(found: dict[str, Any]) -> list[list[str]]:
    """Cells that the page and the terminal share."""
    rows = []
    for row in found["rows"]:
        theirs = row["published"]
        rows.append(
            [
                row["title"],
                f"{number(theirs['energy_wh'][0])} ± {number(theirs['energy_wh'][1])}",
                f"{number(row['energy_wh']['mean'])} ± {number(row['energy_wh']['std'])}",
                " … ".join(number(bound) for bound in row["energy_wh"]["ci95"]),
                percent(theirs["saving_vs_direct"]),
                percent(row["saving_vs_direct"]),
                f"{number(theirs['time_ms'][0], 0)} ± {number(theirs['time_ms'][1], 0)}",
                f"{number(row['time_ms']['mean'])} ± {number(row['time_ms']['std'])}",
                percent(row["arrived"]["mean"], 1),
            ]
        )
    rows.append(
        ["straight flight", number(found["direct_wh"], 1), number(found["direct_wh"], 1), *[DASH] * 6]
    )
    saving = 1 - found["bound_wh"] / found["direct_wh"]
    rows.append(["grid optimum", DASH, number(found["bound_wh"]), DASH, DASH, percent(saving), *[DASH] * 3])
    return rows


_HEAD = (
    "", "published:\nenergy, Wh", "ours:\nenergy, Wh", "95 % of\nthe mean", "published:\nunder direct",
    "ours:\nunder direct", "published:\ntime, ms", "ours:\ntime, ms", "ours:\narrived",
)  # fmt: skip


#: The column that only the page has room for.
_INTERVAL = 3


def section(found: dict[str, Any], pictures: dict[str, bytes] | None = None) -> str:
    """The tables that were made, as HTML; with figures if ``pictures`` are given."""
    parts = []
    if "rows" in found:
        head = [escape(text).replace("\n", "<br>") for text in _HEAD]
        parts.append(
            f'<h3>DR-RRT*</h3><p class="soft">{found["runs"]} runs of each variant, seeds from {found["seed"]}; '
            "published: 1000 runs. Mean ± standard deviation. The published obstacle set is unknown; ours is one 2 km "
            "square at the centre. Times are of this machine, one thread.</p>"
            + table(head, [[escape(cell) for cell in row] for row in _rows(found)])
        )
    if "sensor_placement" in found:
        parts.append(published_sensor_placement.section(found["sensor_placement"], pictures))
    if "localization" in found:
        parts.append(published_localization_tables.section(found["localization"], pictures))
    if "laser" in found:
        parts.append(published_laser.section(found["laser"], pictures))
    if "plume" in found:
        parts.append(published_plume_tables.section(found["plume"], pictures))
    return "\n".join(parts)


def section_in(output: Path) -> str | None:
    """The tables of an earlier ``published`` run in the same folder, None where there is none that can be read."""
    try:
        return section(json.loads((output / "published.json").read_text(encoding="utf-8"))) or None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def print_table(found: dict[str, Any], console: Any) -> None:
    """The tables on the terminal."""
    if "rows" in found:
        _print_planner(found, console)
    if "sensor_placement" in found:
        published_sensor_placement.print_tables(found["sensor_placement"], console)
    if "localization" in found:
        published_localization_tables.print_tables(found["localization"], console)
    if "laser" in found:
        published_laser.print_tables(found["laser"], console)
    if "plume" in found:
        published_plume_tables.print_tables(found["plume"], console)


def _print_planner(found: dict[str, Any], console: Any) -> None:
    from rich.table import Table

    shown = Table(
        title=f"DR-RRT*, published (1000 runs) and ours ({found['runs']} runs); mean ± standard deviation",
        title_justify="left",
    )
    for k, text in enumerate(_HEAD):
        if k != _INTERVAL:
            shown.add_column(text, justify="right" if k else "left", no_wrap=True)
    for row in _rows(found):
        shown.add_row(*(cell for k, cell in enumerate(row) if k != _INTERVAL))
    console.print(shown)

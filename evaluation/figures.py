"""Pictures of the report, as PNG bytes: distributions, and tracks over the field."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.tasks.batch import WorldBatch
from evaluation.benchmark import SuiteRun
from evaluation.figures_laser import draw_light
from evaluation.figures_localization import draw_localization, localization_title
from evaluation.figures_plume import draw_plume, plume_title
from evaluation.figures_team import draw_team, team_title
from evaluation.rollouts import make_batch

#: Okabe and Ito's colours, which the colour-blind tell apart too.
COLOURS = {
    "random": "#7f7f7f", "drift": "#56b4e9", "direct-flight": "#e69f00", "greedy": "#f0e442",
    "dr-rrt-star": "#009e73",
    "optimal": "#0072b2", "ppo": "#d55e00", "hold": "#e69f00", "hdop-optimal": "#0072b2", "hop-in-turn": "#009e73",
    "omlp-greedy": "#e69f00", "omlp-1": "#56b4e9", "omlp-2": "#009e73", "omlp-3": "#0072b2",
    "search-hold": "#e69f00", "gradient-ascent": "#56b4e9", "ekf-tracking": "#009e73", "rov-tracking": "#f0e442",
    "memory-tracking": "#000000",
    "true-center": "#0072b2",
    "quadratic-fit": "#0072b2", "spiral-surge": "#009e73", "straight-line": "#e69f00",
}  # fmt: skip
_OTHER = "#cc79a7"
_DRIFT, _HOP = "#0072b2", "#d55e00"
_DPI = 100
_ARROWS = 15


def _figure(width: float, height: float, **grid: Any) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # No pyplot: nothing global, no display, whatever the user's own backend is.
    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(**grid)


def _png(figure: Any) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", facecolor="white")
    return _fewer_colours(out.getvalue())


def _fewer_colours(png: bytes) -> bytes:
    """The same picture with a palette of 256 colours, a third of the size (Pillow comes with Matplotlib)."""
    from PIL import Image

    out = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
        out, format="PNG", optimize=True
    )
    return out.getvalue()


def distributions(run: SuiteRun) -> bytes:
    """What the task is about (flight energy of arrivals, tracking error), and the score, a row a policy."""
    names, table = list(run.runs), run.table
    metric, title = next(
        (
            (metric, label)
            for metric, label in table.distribution
            if any(np.isfinite(run.metrics[name][metric]).any() for name in names)
        ),
        table.distribution[0],
    )
    figure, axes = _figure(10.5, 1.1 + 0.5 * len(names), nrows=1, ncols=2, sharey=True)
    jitter = np.random.default_rng(0)
    data = (
        (axes[0], title, {n: run.metrics[n][metric] for n in names}),
        (axes[1], table.score_label, run.scores),
    )
    for axis, label, values in data:
        for row, name in enumerate(names):
            _strip(axis, row, values[name], colour_of(name), jitter)
        axis.set_xlabel(label)
        axis.grid(axis="x", color="#dddddd", linewidth=0.6)
        axis.set_axisbelow(True)
        for side in ("top", "right", "left"):
            axis.spines[side].set_visible(False)
    lasted = [run.metrics[name][table.lasted] for name in names]
    labels = [
        f"{name}\n{int(a.sum())} of {len(a)} {table.lasted_word}"
        for name, a in zip(names, lasted, strict=True)
    ]
    axes[0].set_yticks(range(len(names)), labels, fontsize=8)
    for axis in axes:
        axis.tick_params(axis="y", length=0)
        axis.margins(x=0.06)
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    axes[0].set_xlim(left=-0.02 * axes[0].get_xlim()[1])
    # One wild policy must not squeeze the rest; points beyond are drawn at the edge.
    axes[1].set_xlim(-1.08, 1.2)
    return _png(figure)


def _strip(axis: Any, row: int, values: np.ndarray, colour: str, jitter: np.random.Generator) -> None:
    values = values[np.isfinite(values)]
    if not len(values):
        return
    shown = np.maximum(values, -1.0)
    axis.scatter(
        shown, row + jitter.uniform(-0.16, 0.16, len(shown)), s=9, color=colour, alpha=0.45, linewidths=0
    )
    low, middle, high = np.percentile(shown, [25, 50, 75])
    axis.plot([low, high], [row, row], color=colour, linewidth=6, alpha=0.45, solid_capstyle="butt")
    axis.plot([middle, middle], [row - 0.26, row + 0.26], color=colour, linewidth=2.2)
    axis.plot(
        [shown.mean()],
        [row],
        marker="D",
        markersize=5,
        color="white",
        markeredgecolor=colour,
        markeredgewidth=1.5,
    )


def best_and_median(run: SuiteRun, name: str) -> tuple[int, int]:
    """Episodes of ``name`` that rank best and in the middle, those that failed last."""
    known = run.metrics[name]
    values = [sign * known[metric] for metric, sign in run.table.rank if metric in known]
    ranked = next((v for v in values if np.isfinite(v).any()), values[0])
    ranked = np.where(np.isfinite(ranked), ranked, np.inf)
    lasted = known.get(run.table.lasted)
    order = np.lexsort((ranked, np.zeros(len(ranked)) if lasted is None else lasted != 1))
    return int(order[0]), int(order[(len(order) - 1) // 2])


def tracks(run: SuiteRun) -> bytes:
    """The best and the median track of each policy, drawn over the field."""
    names = list(run.runs)
    figure, axes = _figure(2.35 * len(names) + 0.6, 6.4, nrows=2, ncols=len(names), squeeze=False)
    batch = make_batch(run.suite, 1)
    fastest = 0.0
    fields = batch.worlds.dtype.names or ()
    light = run.suite.task == "laser-tracking"
    for column, name in enumerate(names):
        for row, (kind, episode) in enumerate(
            zip(("best", "median"), best_and_median(run, name), strict=True)
        ):
            axis = axes[row, column]
            drawn = batch, run.runs[name], episode
            if not light:
                fastest = max(fastest, _draw_field(axis, batch, run.runs[name].worlds[episode]))
            if light:
                title = draw_light(axis, *drawn)
            elif "place_x" in fields:
                draw_localization(axis, *drawn)
                title = localization_title(run.runs[name], episode)
            elif "puff_x" in fields:
                draw_plume(axis, *drawn)
                title = plume_title(run.runs[name], episode)
            elif batch.task.num_agents is None:
                _draw_track(axis, batch, run, name, episode)
                title = _title(batch, run.runs[name].worlds[episode])
            else:
                draw_team(axis, *drawn)
                title = team_title(*drawn)
            axis.set_title(
                f"{name + chr(10) if row == 0 else ''}{kind}: {title}\nseed {run.seeds[episode]}", fontsize=8
            )
            axis.tick_params(labelsize=6, length=2)
            if column and "place_x" not in fields and not light:  # whose panels have limits of their own
                axis.set_yticklabels([])
    _label_axes(axes, in_metres=light)
    return _png(figure)


def _label_axes(axes: np.ndarray, *, in_metres: bool) -> None:
    """Name the axes of panels drawn in m or km; what is less than a kilometre wide reads in m."""
    small = not in_metres and all(float(np.ptp(axis.get_xlim())) < 1.0 for axis in axes.flat)
    unit = "m" if in_metres or small else "km"
    for axis in axes[:, 0]:
        axis.set_ylabel(f"north, {unit}", fontsize=7)
    for axis in axes[-1]:
        axis.set_xlabel(f"east, {unit}", fontsize=7)
    if small:
        from matplotlib.ticker import FixedFormatter

        for side in (side for axis in axes.flat for side in (axis.xaxis, axis.yaxis)):
            # Panels without numbers stay so.
            if not isinstance(side.get_major_formatter(), FixedFormatter):
                side.set_major_formatter(lambda kilometres, _: f"{1e3 * kilometres:g}")


def _title(batch: WorldBatch, world: np.ndarray) -> str:
    outcome = batch.task.outcomes[world["outcome"]]
    return f"{world['flight_wh']:.1f} Wh, {world['time_s'] / 3600:.1f} h" if outcome == "goal" else outcome


def _draw_field(axis: Any, batch: WorldBatch, world: np.ndarray) -> float:
    """Speed, arrows and obstacles of the true current halfway through the episode; returns its top speed."""
    ocean, half = batch.ocean, batch.params.half_width_m
    axes = ocean.axes
    field = CurrentField(
        velocity=ocean.velocity[world["truth"]], grid=Grid(axes.x0, axes.y0, axes.spacing), time0_s=axes.time0,
        time_step_s=axes.time_step, interpolation="cell" if axes.by_cell else "bilinear",
    )  # fmt: skip
    when = float(world["clock_s"] + 0.5 * world["time_s"])
    fine = np.linspace(-half, half, 60)
    speed = np.hypot(*np.moveaxis(field.sample(*np.meshgrid(fine, fine), when), -1, 0))
    extent = [-half / 1e3, half / 1e3] * 2
    axis.imshow(speed, origin="lower", extent=extent, cmap="Greys", vmin=0, vmax=3 * speed.max() + 1e-9)
    if speed.any():
        coarse = half * (np.arange(_ARROWS) + 0.5 - _ARROWS / 2) / (_ARROWS / 2)
        x, y = np.meshgrid(coarse, coarse)
        flow = field.sample(x, y, when)
        axis.quiver(
            x / 1e3, y / 1e3, flow[..., 0], flow[..., 1], color="#6b7785",
            scale=_ARROWS * 1.1 * speed.max() + 1e-9, width=0.004, headwidth=4,
        )  # fmt: skip
    grid, clearance = ocean.clearance_grid, ocean.clearance[world["obstacle"]]
    if clearance.min() < 0:
        gx, gy = grid.nodes(*clearance.shape)
        axis.contourf(gx / 1e3, gy / 1e3, clearance, levels=[-1e9, 0], colors=["#3a3a3a"], alpha=0.75)
    axis.set_xlim(extent[:2])
    axis.set_ylim(extent[:2])
    axis.set_aspect("equal")
    return float(speed.max())


def _draw_track(axis: Any, batch: WorldBatch, run: SuiteRun, name: str, episode: int) -> None:
    results = run.runs[name]
    assert results.track is not None and results.flown is not None
    steps = int(results.decisions[episode])
    path = results.track[: steps + 1, episode] / 1e3
    for flown, colour, width, style in ((False, _DRIFT, 1.8, "-"), (True, _HOP, 1.5, (0, (3, 1)))):
        pieces = [path[k : k + 2] for k in range(steps) if bool(results.flown[k, episode]) == flown]
        # NaN rows part the pieces: one line object instead of hundreds.
        line = np.concatenate(
            [np.vstack([piece, [[np.nan, np.nan]]]) for piece in pieces] or [np.empty((0, 2))]
        )
        axis.plot(line[:, 0], line[:, 1], color=colour, linewidth=width, linestyle=style)
    world = results.worlds[episode]
    axis.plot(
        world["start_x"] / 1e3,
        world["start_y"] / 1e3,
        "o",
        color="white",
        markeredgecolor="black",
        markersize=5,
    )
    axis.plot(
        world["goal_x"] / 1e3, world["goal_y"] / 1e3, "*", color="#f0e442", markeredgecolor="black", markersize=9,
        markeredgewidth=0.7,
    )  # fmt: skip
    if world["outcome"] != 1:
        axis.plot(path[-1, 0], path[-1, 1], "X", color="black", markersize=6, markeredgecolor="white")


def colour_of(policy: str) -> str:
    """The colour of a policy in every figure."""
    return COLOURS.get(policy.partition("=")[0], _OTHER)

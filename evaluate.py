"""Run the benchmark, or reproduce the published tables: `python evaluate.py --help` tells how."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from tyro.conf import arg

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError, check_choice

CRASHED, WRONG_INPUT, INTERRUPTED = 1, 2, 130


@dataclass(frozen=True, kw_only=True)
class Options:
    """Run policies over suites of frozen seeds, and write a report.

    Without options: every policy on every suite at the quick size, in minutes. Open index.html in the
    output folder; results.json beside it holds the same numbers. Every policy meets the same
    seeds, which training never uses. Ctrl-C keeps what is finished.

    Examples:
      python evaluate.py
      python evaluate.py --suite gyres --policies direct-flight,dr-rrt-star,ppo --episodes 300
      python evaluate.py --suite file --currents ocean.nc --currents-center 36.6 -122.2
      python evaluate.py --task transponder-localization --survey two_way_times.txt
      python evaluate.py published --runs 1000

    `python evaluate.py published` reproduces the published tables beside ours
    (`python evaluate.py published --help`).
    """

    task: Annotated[str | None, arg(metavar="TASK", help_behavior_hint="")] = None
    """decision problem: drift-hop, sensor-placement, transponder-localization, laser-tracking or plume-tracing
    (default: all)"""
    policies: Annotated[tuple[str, ...], arg(metavar="NAME,NAME...", help_behavior_hint="")] = ()
    """random, ppo; drift-hop: drift, direct-flight, greedy, dr-rrt-star, optimal; sensor-placement: drift, hold,
    hop-in-turn, hdop-optimal; transponder-localization: omlp-greedy, omlp-1, omlp-2, omlp-3, any omlp-K;
    laser-tracking: search-hold, gradient-ascent, ekf-tracking, memory-tracking, rov-tracking, true-center;
    plume-tracing: quadratic-fit, spiral-surge, straight-line; also ppo=FOLDER for a checkpoint that you trained,
    MODULE:CLASS for a policy that you wrote (default: all that ship)"""
    suite: Annotated[tuple[str, ...], arg(metavar="NAME,NAME...", help_behavior_hint="")] = ()
    """drift-hop: vortex, vortex-perturbed, gyres, forecast-error; sensor-placement: calm-, vortex- or gyres- with
    bearing, range or tdoa, fence, grid-1x1, grid-3x3, grid-5x5; transponder-localization: single, four, random,
    current, field, aquaquad; laser-tracking: still, moving, wandering, flat-top, gaussian, daylight, planar;
    plume-tracing: surround, corner, noise, position-error, heading-error, advected, turbulent, turbulent-3,
    turbulent-30; also file (default: all; file
    only when --currents is given)"""
    episodes: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    """episodes of each suite (default: each suite's quick size, 4 to 100)"""
    seed: Annotated[int, arg(metavar="N")] = 0
    """which set of frozen seeds, 0 to 99"""
    currents: Annotated[tuple[Path, ...], arg(metavar="FILE.nc", help_behavior_hint="")] = ()
    """NetCDF file of an ocean model, for suite file; two files where u and v lie apart"""
    currents_center: Annotated[tuple[float, float] | None, arg(metavar="LAT LON", help_behavior_hint="")] = (
        None
    )
    """degrees north and east of the middle of the box in that file (default: the middle of its data)"""
    survey: Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")] = None
    """recorded two-way times (docs/localization.md): no suites, but where that transponder is, and --policies (also
    survey-order) choosing among the recorded places, --episodes times (default 20), in survey.html"""
    survey_reach: Annotated[float | None, arg(metavar="M", help_behavior_hint="")] = None
    """how far the next recorded place may be, m (default: ten times the usual distance between consecutive ones)"""
    survey_measurements: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    """replies of each run through the survey (default: 30, or all)"""
    survey_sound_speed: Annotated[float | None, arg(metavar="M/S", help_behavior_hint="")] = None
    """mean speed of sound there, m/s (default: estimated from the survey)"""
    output: Annotated[Path, arg(metavar="DIR")] = Path("runs/evaluation")
    """folder of the report"""


@dataclass(frozen=True, kw_only=True)
class PublishedOptions:
    """Reproduce the published tables beside ours: DR-RRT* (Dillard 2014, App. C), trackers, HDOP, placement,
    transponder localization (Garcia 2018), laser tracking (figures 3.4 to 6.10), plume tracing (Byrne et al. 2003).

    Prints the published numbers beside ours and writes published.json, published.html and its figures.

    Examples:
      python evaluate.py published --runs 1000
      python evaluate.py published --task sensor-placement
    """

    task: Annotated[str, arg(metavar="TASK")] = "all"
    """drift-hop (DR-RRT*), sensor-placement (EKF and UKF, laboratory test, HDOP maps, placement),
    transponder-localization (look-ahead and greedy planning, consistency), laser-tracking (step
    responses, each simulation flown again), plume-tracing (noise, errors of place and
    heading, orientation), or all"""
    runs: Annotated[int, arg(metavar="N")] = 1000
    """independent runs of each variant of DR-RRT*, and of each row of transponder localization where as many are
    published, in proportion elsewhere (published: 1000); a twentieth of them of each
    flight of laser tracking (published: 1), a fifth of each row of plume tracing (published: 5)"""
    tracking_runs: Annotated[int, arg(metavar="N")] = 24
    """independent runs of each filter (published: 1)"""
    seed: Annotated[int, arg(metavar="N")] = 0
    """seed of the first run; run i has this + i"""
    output: Annotated[Path, arg(metavar="DIR")] = Path("runs/evaluation")
    """folder of the report"""


def benchmark(options: Options, arguments: list[str], console: Console) -> int:
    """Run the benchmark that ``options`` ask for; returns the exit status."""
    from evaluation.benchmark import Benchmark
    from evaluation.policies import policies_by_task
    from evaluation.report import print_summary, write_report
    from evaluation.suites import find_suites, find_tasks

    tasks = find_tasks(options.task, _split(options.suite))
    policies = policies_by_task(tasks, _split(options.policies))
    if len(tasks) > 1:
        tasks = [task for task in tasks if policies[task]]
    suites = find_suites(
        options.task,
        _split(options.suite),
        currents=options.currents,
        center=options.currents_center,
    )
    run = Benchmark(
        task=" and ".join(tasks),
        suites=[suite for suite in suites if suite.task in tasks],
        policies=policies[tasks[0]] if len(tasks) == 1 else policies,
        seed=options.seed,
        output=options.output,
        arguments=arguments,
        episodes=options.episodes,
    )
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("episodes"),
        TimeRemainingColumn(),
    )  # fmt: skip
    status = 0
    with Progress(*columns, console=console, transient=True) as progress:
        bar = progress.add_task("starting", total=run.steps)

        def advance(suite: str, policy: str, episodes: int) -> None:
            progress.update(bar, advance=episodes, description=f"{suite}: {policy}")

        run.advance = advance
        try:
            run.run()
        except KeyboardInterrupt:
            run.write()
            status = INTERRUPTED
    report = write_report(run)
    print_summary(run, console)
    console.print(
        f"{'Interrupted; what was finished is' if status else 'Report'} in {report}", soft_wrap=True
    )
    if not status and run.crashed:
        status = CRASHED
    return status


def survey(options: Options, arguments: list[str], console: Console) -> int:
    """Solve and replay the recorded survey that ``options`` name; returns the exit status."""
    from evaluation.survey import content, run_survey, write_survey
    from evaluation.survey_replay import TASK
    from evaluation.survey_report import print_survey

    assert options.survey is not None
    check_choice("task", options.task or TASK, (TASK,))
    for name, value in (("--suite", options.suite), ("--currents", options.currents)):
        if value:
            raise InvalidParameterError(name, value, "nothing beside --survey", "Run one after the other.")
    with Progress(TextColumn("{task.description}"), console=console, transient=True) as progress:
        bar = progress.add_task("reading")
        run = run_survey(
            options.survey, policies=_split(options.policies), reach_m=options.survey_reach,
            measurements=options.survey_measurements, sound_speed_m_s=options.survey_sound_speed,
            runs=20 if options.episodes is None else options.episodes, seed=options.seed, arguments=arguments,
            advance=lambda what: progress.update(bar, description=what),
        )  # fmt: skip
        report = write_survey(run, options.output)
    print_survey(run, content(run), console)
    console.print(f"Report in {report}", soft_wrap=True)
    return 0


def published(options: PublishedOptions, arguments: list[str], console: Console) -> int:
    """Reproduce the published tables; returns the exit status."""
    from evaluation.published import TASKS, print_table, reproduce, steps

    check_choice("task", options.task, ("all", *TASKS))
    tasks = TASKS if options.task == "all" else (options.task,)
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("published tables", total=steps(options.runs, options.tracking_runs, tasks))
        table = reproduce(
            options.runs, options.seed, options.output, arguments, lambda: progress.advance(bar), tasks=tasks,
            tracking_runs=options.tracking_runs,
        )  # fmt: skip
    print_table(table, console)
    console.print(f"Written to {options.output / 'published.json'} and published.html", soft_wrap=True)
    return 0


def _split(names: Sequence[str]) -> list[str]:
    return [part for name in names for part in name.split(",") if part]


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, call, print; returns the exit status: 1 a policy crashed, 2 wrong input, 130 interrupted."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    # Plain text for pipes and files; Rich decides for terminals.
    console = Console(width=None if sys.stdout.isatty() else 120)
    try:
        if given[:1] == ["published"]:
            chosen = tyro.cli(
                PublishedOptions,
                prog="evaluate.py published",
                args=given[1:],
                description=inspect.getdoc(PublishedOptions),
            )
            return published(chosen, given, console)
        options = tyro.cli(Options, prog="evaluate.py", args=given, description=inspect.getdoc(Options))
        if options.survey is not None:
            return survey(options, given, console)
        return benchmark(options, given, console)
    except AquaQuadError as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return WRONG_INPUT
    except OSError as error:
        print(f"evaluate.py: {error.strerror}: {error.filename}", file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        print("evaluate.py: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    status = main()
    if status == INTERRUPTED:
        # A planner in the middle of a decision would hold up a normal exit.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)

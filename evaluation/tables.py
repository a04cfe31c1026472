"""What the report shows of each task: columns, words, and which module scores it."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of a suite's table.

    metric: name of a metric, or "score". heading: HTML. better: "less", "more" (bold marks the best), or None.
    statistic: "mean" or "iqm". interval: whether the 95 % interval stands below. percent: a share. scale: what
    numbers are divided by. reliable: policies that seldom last compete for no bold. optional: left out
    where no policy has a value.
    """

    metric: str
    heading: str
    better: str | None = None
    statistic: str = "mean"
    interval: bool = False
    percent: bool = False
    digits: int = 2
    scale: float = 1.0
    reliable: bool = False
    optional: bool = False


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """A metric by which two policies are compared on the same seeds."""

    metric: str
    less_is_better: bool
    #: Headings: number of seeds, difference, probability of improvement.
    headings: tuple[str, str, str]
    digits: int = 2


@dataclass(frozen=True, kw_only=True)
class TaskTable:
    """How the results of one task are shown.

    lasted: metric, 0 or 1, of whether an episode went well enough to count for energies and errors. shares,
    robust: metrics with Wilson's interval, and with that of the IQM. references: names of the two ends of the
    score in results.json. score_ends, score_label: what 0 and 1 are. distribution: metric, label. rank: metric and
    sign by which episodes are best. main: columns of the first table, strata: how many of them the strata show.
    terminal: heading, metric, and what is shown of it.
    """

    task: str
    scoring: str
    lasted: str
    lasted_word: str
    shares: tuple[str, ...]
    robust: tuple[str, ...]
    references: tuple[str, str]
    score_ends: str
    score_label: str
    distribution: tuple[tuple[str, str], ...]
    distribution_title: str
    rank: tuple[tuple[str, int], ...]
    tracks_caption: str
    main: tuple[Column, ...]
    strata: int
    pairings: tuple[Pairing, ...]
    terminal: tuple[tuple[str, str, str], ...]
    notes: str

    @property
    def scores(self) -> Any:
        """The module with ``ReferenceSolver``, ``metrics_of``, ``scores_of`` and ``outcomes_of``."""
        return importlib.import_module(self.scoring)


_SCORE = Column(metric="score", heading="score", better="more", interval=True)

TABLES: dict[str, TaskTable] = {
    "drift-hop": TaskTable(
        task="drift-hop",
        scoring="evaluation.scores",
        lasted="success",
        lasted_word="arrived",
        shares=("success",),
        robust=("flight_energy_wh",),
        references=("null_wh", "bound_wh"),
        score_ends="0 is direct flight, 1 the least flight energy on the true current.",
        score_label="score (0 direct flight, 1 grid optimum)",
        distribution=(("flight_energy_wh", "flight energy, Wh (arrived)"),),
        distribution_title="Flight energy and score of each policy on",
        rank=(("saving_vs_direct", -1),),
        tracks_caption="The best and the median episode of each policy by saving (failures last). Blue: drift, one "
        "piece a decision; orange dashes: flight. Circle: start; star: goal; cross: where a failed episode ended. Grey "
        "shade and arrows: the true current halfway through the episode; dark: obstacles.",
        main=(
            Column(metric="success", heading="arrived", better="more", interval=True, percent=True),
            Column(
                metric="flight_energy_wh", heading="flight energy, Wh<br>mean", better="less", interval=True,
                reliable=True,
            ),
            Column(
                metric="flight_energy_wh", heading="flight energy, Wh<br>IQM", better="less", statistic="iqm",
                interval=True, reliable=True,
            ),
            Column(metric="saving_vs_direct", heading="saving", percent=True),
            Column(metric="optimality_gap", heading="gap to<br>optimum", percent=True),
            _SCORE,
            Column(metric="duration_s", heading="duration, h", digits=1, scale=3600.0),
        ),
        strata=6,
        pairings=(
            Pairing(
                metric="flight_energy_wh", less_is_better=True,
                headings=("seeds both<br>arrived on", "energy, Wh:<br>first − second", "first flies<br>on less"),
            ),
        ),
        terminal=(
            ("arrived", "success", "percent"), ("energy Wh", "flight_energy_wh", "mean"),
            ("95 %", "flight_energy_wh", "ci95"), ("IQM", "flight_energy_wh", "iqm"),
            ("saving", "saving_vs_direct", "percent"),
        ),
        notes="notes.html",
    ),
    "sensor-placement": TaskTable(
        task="sensor-placement",
        scoring="evaluation.scores_placement",
        lasted="survived",
        lasted_word="kept the team",
        shares=("survived",),
        robust=("tracking_rmse_m", "coverage"),
        references=("null", "bound"),
        score_ends="0 is hold, 1 the posterior Cramér–Rao bound of a team that knows where the targets are (fence: "
        "full coverage).",
        score_label="score (0 hold, 1 bound)",
        distribution=(("tracking_rmse_m", "tracking RMSE, m"), ("coverage", "coverage of the fence")),
        distribution_title="Error (fence: coverage) and score of each policy on",
        rank=(("tracking_rmse_m", 1), ("coverage", -1)),
        tracks_caption="The best and the median episode of each policy by tracking RMSE (fence: coverage). Each "
        "vehicle in its own colour, flights dashed, circle: start, dot: end (cross: lost). Black: the target's track, "
        "star: its end; orange plus and ellipse: estimate at the end and its 95 %. Green: the fence at the end. Grey "
        "shade and arrows: the true current halfway through the episode; dark: obstacles.",
        main=(
            Column(
                metric="survived", heading="kept<br>the team", better="more", interval=True, percent=True
            ),
            Column(
                metric="tracking_rmse_m", heading="RMSE, m<br>mean", better="less", interval=True, reliable=True,
                optional=True,
            ),
            Column(
                metric="tracking_rmse_m", heading="RMSE, m<br>IQM", better="less", statistic="iqm", interval=True,
                reliable=True, optional=True,
            ),
            Column(metric="bound_rmse_m", heading="its bound,<br>m", optional=True),
            Column(metric="rmse_over_bound", heading="RMSE over<br>its bound", interval=True, optional=True),
            Column(metric="nees", heading="NEES<br>(2 is right)", optional=True),
            Column(metric="mean_hdop", heading="HDOP, m", digits=1, optional=True),
            Column(
                metric="coverage", heading="coverage", better="more", interval=True, percent=True, reliable=True,
                optional=True,
            ),
            Column(metric="flight_energy_wh", heading="flight energy,<br>Wh", interval=True, digits=1),
            _SCORE,
        ),
        strata=10,
        pairings=(
            Pairing(
                metric="tracking_rmse_m", less_is_better=True,
                headings=("seeds", "RMSE, m:<br>first − second", "first errs<br>less"),
            ),
            Pairing(
                metric="coverage", less_is_better=False,
                headings=("seeds", "coverage:<br>first − second", "first covers<br>more"),
            ),
            Pairing(
                metric="flight_energy_wh", less_is_better=True, digits=1,
                headings=("seeds", "energy, Wh:<br>first − second", "first flies<br>on less"),
            ),
        ),
        terminal=(
            ("kept team", "survived", "percent"), ("RMSE m", "tracking_rmse_m", "mean"),
            ("95 %", "tracking_rmse_m", "ci95"), ("over bound", "rmse_over_bound", "mean"),
            ("HDOP m", "mean_hdop", "mean"), ("coverage", "coverage", "percent"),
            ("energy Wh", "flight_energy_wh", "mean"),
        ),
        notes="notes_placement.html",
    ),
    "transponder-localization": TaskTable(
        task="transponder-localization",
        scoring="evaluation.scores_localization",
        lasted="survived",
        lasted_word="kept the vehicle",
        shares=("survived", "diverged"),
        robust=("rmse_m",),
        references=("null", "bound"),
        score_ends="0 is random, 1 the best trajectory found with known transponders, both by Σ ln det of the "
        "information at the true positions, a transponder.",
        score_label="score (0 random, 1 bound)",
        distribution=(("rmse_m", "error of the estimates, m"), ("log_det", "Σ ln det Y at the end")),
        distribution_title="Error, information and score of each policy on",
        rank=(("rmse_m", 1),),
        tracks_caption="The best and the median episode of each policy by error at the end. Circle: start, and first "
        "measurement; dots: measurements; stars: transponders; orange plus and ellipse: estimates at the end and their "
        "95 %. Grey shade and arrows: the true current halfway through the episode; dark: obstacles.",
        main=(
            Column(metric="survived", heading="kept<br>the vehicle", better="more", percent=True),
            Column(metric="rmse_m", heading="RMSE, m<br>mean", better="less", interval=True, digits=3, reliable=True),
            Column(
                metric="rmse_m", heading="RMSE, m<br>IQM", better="less", statistic="iqm", interval=True, digits=3,
                reliable=True,
            ),
            Column(metric="log_det", heading="Σ ln det Y<br>at estimates", interval=True),
            Column(metric="log_det_true", heading="Σ ln det Y<br>at truth", better="more", interval=True),
            Column(metric="below_bound", heading="below bound,<br>a transponder", better="less"),
            Column(metric="nees", heading="NEES<br>(3 is right)", interval=True),
            Column(metric="diverged", heading="diverged", better="less", percent=True),
            _SCORE,
        ),
        strata=9,
        pairings=(
            Pairing(
                metric="rmse_m", less_is_better=True, digits=3,
                headings=("seeds", "RMSE, m:<br>first − second", "first errs<br>less"),
            ),
            Pairing(
                metric="log_det_true", less_is_better=False,
                headings=("seeds", "Σ ln det at truth:<br>first − second", "first knows<br>more"),
            ),
        ),
        terminal=(
            ("RMSE m", "rmse_m", "mean"), ("95 %", "rmse_m", "ci95"), ("ln det", "log_det", "mean"),
            ("at truth", "log_det_true", "mean"), ("NEES", "nees", "mean"), ("diverged", "diverged", "percent"),
        ),
        notes="notes_localization.html",
    ),
    "laser-tracking": TaskTable(
        task="laser-tracking",
        scoring="evaluation.scores_laser",
        lasted="acquired",
        lasted_word="found the light",
        shares=("acquired",),
        robust=("time_in_lda", "time_in_lda_acquired", "center_rmse_m", "time_to_acquire_s"),
        references=("null", "bound"),
        score_ends="0 is search-hold, 1 the true centre.",
        score_label="score (0 search-hold, 1 true centre)",
        distribution=(("time_in_lda", "share of time in the LDA"),),
        distribution_title="Time in the light and score of each policy on",
        rank=(("time_in_lda", -1),),
        tracks_caption="The best and the median episode of each policy by time in the detectable area. Circle: start; "
        "star: the light's centre at the end.",
        main=(
            Column(metric="acquired", heading="found the<br>light", better="more", interval=True, percent=True),
            Column(metric="time_in_lda", heading="in the LDA", better="more", interval=True, percent=True, digits=1),
            Column(
                metric="time_in_lda_acquired", heading="after<br>acquisition", better="more", interval=True,
                percent=True, digits=1, optional=True,
            ),
            Column(
                metric="time_to_acquire_s", heading="to acquire, s<br>mean", better="less", interval=True, digits=1,
            ),
            Column(
                metric="center_rmse_m", heading="centre error, m<br>mean", better="less", interval=True,
                reliable=True, optional=True,
            ),
            Column(metric="light_received", heading="light<br>received", percent=True),
            _SCORE,
        ),
        strata=6,
        pairings=(
            Pairing(
                metric="time_in_lda", less_is_better=False, digits=3,
                headings=("seeds", "share in the LDA:<br>first − second", "first stays<br>longer"),
            ),
        ),
        terminal=(
            ("found", "acquired", "percent"), ("in LDA", "time_in_lda", "percent"),
            ("95 %", "time_in_lda", "ci95"), ("after acq.", "time_in_lda_acquired", "percent"),
            ("acquire s", "time_to_acquire_s", "mean"), ("error m", "center_rmse_m", "mean"),
        ),
        notes="notes_laser.html",
    ),
    "plume-tracing": TaskTable(
        task="plume-tracing",
        scoring="evaluation.scores_plume",
        lasted="success",
        lasted_word="reached",
        shares=("success",),
        robust=("updates_to_source",),
        references=("null", "bound"),
        score_ends="0 is random, 1 a team that goes straight to a source that it knows, by updates to the source.",
        score_label="score (0 random, 1 straight line)",
        distribution=(("updates_to_source", "updates to the source (all where not reached)"),),
        distribution_title="Updates to the source and score of each policy on",
        rank=(("updates_to_source", 1), ("closest_m", 1)),
        tracks_caption="The best and the median episode of each policy by updates to the source. Each robot in its own "
        "colour from above, circle: start, dot: end; star: source; green: puffs at the end. Grey shade and arrows: the "
        "true current halfway through the episode.",
        main=(
            Column(metric="success", heading="reached", better="more", interval=True, percent=True),
            Column(metric="updates_to_source", heading="updates<br>mean", better="less", interval=True, digits=1),
            Column(
                metric="updates_to_source", heading="updates<br>IQM", better="less", statistic="iqm", interval=True,
                digits=1,
            ),
            Column(metric="reached_after", heading="when<br>reached", digits=1, optional=True),
            Column(metric="closest_m", heading="closest,<br>m", better="less", interval=True, reliable=True),
            Column(metric="center_of_mass_m", heading="mean,<br>m", better="less", interval=True, reliable=True),
            Column(metric="furthest_m", heading="furthest,<br>m", digits=1),
            _SCORE,
        ),
        strata=8,
        pairings=(
            Pairing(
                metric="updates_to_source", less_is_better=True, digits=1,
                headings=("seeds", "updates:<br>first − second", "first is<br>sooner"),
            ),
            Pairing(
                metric="center_of_mass_m", less_is_better=True,
                headings=("seeds", "mean distance, m:<br>first − second", "first ends<br>nearer"),
            ),
        ),
        terminal=(
            ("reached", "success", "percent"), ("updates", "updates_to_source", "mean"),
            ("95 %", "updates_to_source", "ci95"), ("closest m", "closest_m", "mean"),
            ("mean m", "center_of_mass_m", "mean"), ("furthest m", "furthest_m", "mean"),
        ),
        notes="notes_plume.html",
    ),
}  # fmt: skip

"""The picture of a sensor placement world: current, team, targets, what is believed of them, the fence."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from aquaquad_envs.estimation.hdop import hdop
from aquaquad_envs.rendering.beliefs import BELIEF, TARGET, estimate_mark, paint_ellipse, target_mark
from aquaquad_envs.rendering.canvas import Canvas, Point
from aquaquad_envs.rendering.chart import INK, QUIET
from aquaquad_envs.rendering.sea import (
    GOAL,
    HEADER,
    HOP,
    MAP,
    MARGIN,
    WHITE,
    SeaPicture,
    Track,
    battery_bar,
    legend_track,
    paint_track,
    vehicle,
)
from aquaquad_envs.sensing.measurements import KINDS, measurement_std
from aquaquad_envs.tasks.sensor_placement_data import RUNNING, TIME_OUT

__all__ = ["BELIEF", "TARGET", "Picture"]


class Picture(SeaPicture):
    """Paints sensor placement worlds of ``batch``: tracks, targets, estimates with their 95 % ellipses."""

    def __init__(self, batch: Any) -> None:
        super().__init__(batch)
        self._vehicles, self._targets = int(batch.params.num_vehicles), int(batch.params.num_targets)
        self.tracks = [Track() for _ in range(self._vehicles)]
        self._courses: list[list[Point]] = [[] for _ in range(self._targets)]
        self._time_s = -1.0

    def restart(self) -> None:
        """Forget all tracks."""
        for track in self.tracks:
            track.restart()
        self._courses = [[] for _ in range(self._targets)]
        self._time_s = -1.0

    def paint_legend(self, canvas: Canvas, x: float, y: float) -> float:
        """Drift, hop, and with targets these and the beliefs."""
        x = legend_track(canvas, x, y)
        if self._targets:
            target_mark(canvas, (x + 7, y))
            x += 19 + canvas.text((x + 19, y), "target", 17, INK) + 18
            estimate_mark(canvas, (x + 7, y))
            x += 19 + canvas.text((x + 19, y), "estimate, 95 %", 17, INK) + 18
        return x

    def paint_moving(self, canvas: Canvas, world: np.void) -> None:
        """Fence, courses of the targets, tracks, beliefs and vehicles."""
        if float(world["time_s"]) < self._time_s:
            self.restart()
        self._time_s = float(world["time_s"])
        if self._params.scenario == "fence":
            canvas.lines([self.view.pixel(*corner) for corner in world["fence"]], INK, 6)
            canvas.lines([self.view.pixel(*corner) for corner in world["fence"]], GOAL, 3)
        for k in range(self._targets):
            self._courses[k].append(self.view.pixel(world["target_x"][k], world["target_y"][k]))
            canvas.lines(self._courses[k], TARGET, 2, dash=(4, 4))
        for i, track in enumerate(self.tracks):
            track.add(
                SimpleRecord(x=world["x"][i], y=world["y"][i], time_s=world["time_s"], hops=world["hops"][i])
            )
            paint_track(canvas, self.view, track.segments)
        for k in range(self._targets):
            self._paint_belief(canvas, world, k)
            target_mark(canvas, self._courses[k][-1])
        for i in range(self._vehicles):
            place = self.view.held(self.view.pixel(world["x"][i], world["y"][i]), 11)
            if world["agent_outcome"][i] in (RUNNING, self._outcomes.index("time out")):
                vehicle(canvas, place)
            else:
                wreck(canvas, place)

    def _paint_belief(self, canvas: Canvas, world: np.void, k: int) -> None:
        x, y = world["estimate"][k][:2]
        paint_ellipse(canvas, self.view, (x, y), np.array(world["covariance"][k][:2, :2]))
        estimate_mark(canvas, self.view.pixel(x, y))

    def paint_state(self, canvas: Canvas, world: np.void) -> None:
        """The header: time, energy, error of the tracks, HDOP, a battery bar a vehicle, outcome."""
        columns = [
            (0, "TIME", f"{world['time_s'] / 3600:.1f} h"),
            (66, "FLIGHT ENERGY", f"{world['flight_wh'][: self._vehicles].sum():.0f} Wh"),
        ]
        if self._targets:
            error = np.hypot(
                world["estimate"][: self._targets, 0] - world["target_x"][: self._targets],
                world["estimate"][: self._targets, 1] - world["target_y"][: self._targets],
            )
            geometry = np.mean([team_hdop_m(world, self._params, k) for k in range(self._targets)])
            shown = f"{geometry:.0f} m" if np.isfinite(geometry) else "none"
            columns += [(164, "ERROR", f"{np.sqrt(np.mean(error**2)):.0f} m"), (230, "HDOP", shown)]
        for x, caption, value in columns:
            canvas.text((MARGIN + x, 15), caption, 13, QUIET)
            canvas.text((MARGIN + x, 35), value, 22, INK)
        canvas.text((MARGIN + 300, 15), "BATTERIES", 13, QUIET)
        for i in range(self._vehicles):
            share = float(world["battery_wh"][i]) / float(self._params.battery_wh)
            battery_bar(canvas, MARGIN + 300.0 + 24 * i, 29.0, 20.0, 10.0, share)
        outcome = self._outcomes[int(world["outcome"])]
        color = {"running": QUIET, "time out": GOAL}.get(outcome, HOP)
        canvas.text((MARGIN + MAP, 15), "OUTCOME", 13, QUIET, align=1)
        canvas.text((MARGIN + MAP, HEADER - 19), outcome, 22, color, align=1)


def team_hdop_m(world: np.void, params: Any, target: int) -> float:
    """HDOP, m, of the vehicles that are alive about the true ``target``; inf where singular."""
    count = int(params.num_vehicles)
    alive = np.isin(world["agent_outcome"][:count], (RUNNING, TIME_OUT))
    here = np.stack([world["x"], world["y"]], -1)[:count][alive]
    place = np.array([world["target_x"][target], world["target_y"][target]])
    pairs = None
    first = second = np.arange(len(here))
    if params.measurement == "tdoa":
        if len(here) < 2:
            return float("inf")
        if params.tdoa_pairs == "all":
            first, second = np.triu_indices(len(here), 1)
        else:
            nearest = int(np.argmin(np.hypot(*(here - place).T)))
            first = np.array([i for i in range(len(here)) if i != nearest])
            second = np.full(len(first), nearest)
        pairs = np.stack([first, second], -1)
    if not len(first):
        return float("inf")
    stds = [
        measurement_std(
            KINDS[params.measurement], params.measurement_std, params.noise_level, params.noise_reference_m, *place,
            *here[i], *here[k],
        )
        for i, k in zip(first, second, strict=True)
    ]  # fmt: skip
    found = hdop(
        params.measurement, here, place, stds=stds, pairs=pairs, sound_speed_m_s=params.sound_speed_m_s
    )
    return float(found)


class SimpleRecord(SimpleNamespace):
    """One vehicle of a team, read like the record of a world with one."""

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)


def wreck(canvas: Canvas, center: Point) -> None:
    """A vehicle that is lost: a slanted cross."""
    x, y = center
    for width, color in ((5.5, WHITE), (3.5, INK)):
        canvas.lines([(x - 6, y - 6), (x + 6, y + 6)], color, width)
        canvas.lines([(x - 6, y + 6), (x + 6, y - 6)], color, width)

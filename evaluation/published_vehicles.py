"""Step responses of both vehicles of laser tracking (Toombs 2022, figs. 3.4 and 3.7), and how soon they settle.

The source shows that its vehicles follow position commands, and for the submerged one any angle beside them; it gives
no gains, masses or times. So its statements are checked here, on the parameters of ``physics.quadrotor`` and
``physics.rov``: commands are followed; a quadrotor's sideways answer begins later than its climb, since it has to tilt
first; the submerged vehicle follows place and angle at once, turning the shorter way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.physics import quadrotor, rov

DT_S = 0.01
#: Commands held one after another, for so long: (x, z), m, of the quadrotor and (x, z, pitch), m and rad, of the ROV.
QUADROTOR_STEPS = ((1.0, -1.0), (-1.0, -3.0), (1.0, -3.0))
ROV_STEPS = ((2.0, 1.0, np.radians(30.0)), (0.0, 2.0, np.radians(-45.0)), (0.0, 2.0, np.radians(179.0)))
QUADROTOR_HOLD_S, ROV_HOLD_S = 10.0, 20.0
#: Settled: for good within this share of the step. Begun: past this share of it.
BAND, BEGUN = 0.05, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """A vehicle under commands: ``times`` (n,) s, ``states`` and ``wanted`` (n, axes), m and rad, a column an axis."""

    vehicle: str
    axes: tuple[str, ...]
    times: np.ndarray
    states: np.ndarray
    wanted: np.ndarray
    hold_s: float


def quadrotor_response(vehicle: quadrotor.Quadrotor | None = None) -> Response:
    """The quadrotor under position commands, from rest at the origin."""
    count = round(QUADROTOR_HOLD_S / DT_S)
    wanted = np.repeat(np.array(QUADROTOR_STEPS), count, axis=0)
    track = np.empty((len(wanted) + 1, 6))
    quadrotor.fly(np.zeros(6), np.zeros(5), wanted, True, True, vehicle or quadrotor.Quadrotor(), DT_S, track)
    return Response(
        vehicle="quadrotor", axes=("x", "z"), times=DT_S * np.arange(len(wanted)), states=track[:-1, :2],
        wanted=wanted, hold_s=QUADROTOR_HOLD_S,
    )  # fmt: skip


def rov_response(vehicle: rov.Rov | None = None) -> Response:
    """The submerged vehicle under commands of place and angle, from rest at the origin, trimmed."""
    vehicle = vehicle or rov.Rov()
    count = round(ROV_HOLD_S / DT_S)
    wanted = np.repeat(np.array(ROV_STEPS), count, axis=0)
    track = np.empty((len(wanted) + 1, 6))
    integrals = np.array([0.0, 0.0, 0.0, rov.trimmed_integral(vehicle), 0.0])
    rov.dive(np.zeros(6), integrals, wanted, True, True, vehicle, DT_S, track)
    return Response(
        vehicle="submerged vehicle", axes=("x", "z", "pitch"), times=DT_S * np.arange(len(wanted)),
        states=track[:-1, :3], wanted=wanted, hold_s=ROV_HOLD_S,
    )  # fmt: skip


def step_numbers(values: np.ndarray, wanted: float, dt_s: float, *, band: float = BAND) -> dict[str, float]:
    """Of an answer ``values`` (n,), that began at its first, to a step to ``wanted``: times, s, and overshoot, a share.

    ``delay_s`` until 2 % of the way, ``settling_s`` until it is for good within ``band`` of the step; inf where
    that is never. Raises ``InvalidParameterError`` for a band outside (0, 1].
    """
    check_range("band", band, 0, 1, open_low=True)
    step = wanted - values[0]
    way = (values - values[0]) / step
    begun = way >= BEGUN
    outside = np.flatnonzero(np.abs(way - 1.0) > band)
    last = outside[-1] + 1 if len(outside) else 0
    return {
        "step": float(step),
        "delay_s": dt_s * float(begun.argmax()) if begun.any() else np.inf,
        "settling_s": dt_s * float(last) if last < len(way) else np.inf,
        "overshoot": float(max(way.max() - 1.0, 0.0)),
    }


def step_table(response: Response) -> list[dict[str, Any]]:
    """A row a step and axis: vehicle, axis, command, and :func:`step_numbers`."""
    count = round(response.hold_s / DT_S)
    rows = []
    for first in range(0, len(response.times), count):
        before = response.wanted[first - 1] if first else np.zeros(len(response.axes))
        for k, axis in enumerate(response.axes):
            if response.wanted[first, k] == before[k]:
                continue
            values, wanted = response.states[first : first + count, k], float(response.wanted[first, k])
            if axis == "pitch":  # the shorter way round may lead to another turn's angle
                wanted = values[0] + (wanted - values[0] + np.pi) % (2 * np.pi) - np.pi
            numbers = step_numbers(values, float(wanted), DT_S)
            start = float(response.times[first])
            rows.append(
                {
                    "vehicle": response.vehicle,
                    "axis": axis,
                    "time_s": start,
                    "wanted": float(wanted),
                    **numbers,
                }
            )
    return rows


def reproduce_vehicles() -> tuple[dict[str, Any], dict[str, bytes]]:
    """Both tables, with whether the published statements hold, and both figures."""
    responses = (quadrotor_response(), rov_response())
    rows = [row for response in responses for row in step_table(response)]
    first = {row["axis"]: row for row in rows if row["vehicle"] == "quadrotor" and row["time_s"] == 0.0}
    below = [row for row in rows if row["vehicle"] != "quadrotor"]
    table = {
        "rows": rows,
        "statements": {
            "quadrotor: sideways motion begins later than a climb": first["x"]["delay_s"]
            > first["z"]["delay_s"],
            "both follow every command": all(np.isfinite(row["settling_s"]) for row in rows),
            "submerged vehicle: angles turn by half a turn at most": all(
                abs(row["step"]) <= np.pi for row in below if row["axis"] == "pitch"
            ),
        },
    }
    return table, {
        "quadrotor-steps": _draw(responses[0], "Fig. 3.4: quadrotor under position commands"),
        "rov-steps": _draw(responses[1], "Fig. 3.7: submerged vehicle under commands of place and angle"),
    }


def _draw(response: Response, title: str) -> bytes:
    from evaluation.figures import _figure, _png

    labels = {"x": "x, m", "z": "z (down), m", "pitch": "pitch, °"}
    figure, axes = _figure(
        8.0, 1.9 * len(response.axes) + 0.5, nrows=len(response.axes), ncols=1, sharex=True
    )
    for k, (panel, axis) in enumerate(zip(axes, response.axes, strict=True)):
        scale = 180.0 / np.pi if axis == "pitch" else 1.0
        panel.plot(
            response.times, scale * response.wanted[:, k], "--", color="grey", linewidth=1.0, label="command"
        )
        panel.plot(
            response.times, scale * response.states[:, k], color="#0072b2", linewidth=1.6, label="vehicle"
        )
        panel.set_ylabel(labels[axis])
        panel.grid(color="#dddddd", linewidth=0.6)
        if axis == "z":
            panel.invert_yaxis()
    axes[0].legend(fontsize=8, loc="upper right")
    axes[0].set_title(title, fontsize=10)
    axes[-1].set_xlabel("time, s")
    return _png(figure)

"""Policies of laser tracking: one state machine, five ways to use it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.estimation.gradient import make_gradient_settings
from aquaquad_envs.estimation.kalman_motion import make_motion
from baselines import laser_machine as machine
from baselines.laser_machine import MACHINE, MachineSettings, decide_all

_OWN = "own position and velocity as measured, the reading, altitude, depth and beam, and the first guess"
_RELATIVE = ", the submerged vehicle's velocity where it is measured"
#: Standard deviations, in shares of the peak, of what a reading's model leaves out.
_MODEL_STD = 0.01
#: m/s, of the submerged vehicle's velocity beyond what is measured of it.
_BIAS_M_S = 0.02
_LEAST_STD = 1e-3
#: A filter of fixes needs some deviation.
_LEAST_FIX_M = 0.05


class LaserPolicy:
    """Concentric search until there is light, then one way of tracking, over all worlds of ``batch``.

    Parameters: ``spacing`` of the circles in detectable radii w; ``search_share`` of the greatest speed to search at;
    ``gain``, 1/s, from position error to velocity; ``patience``, s, in the dark before the search begins again;
    ``gate`` of the filter (inf: the tangent only, as published); ``scan``: lowest radius of the edge ride in w, its
    growth with the estimate's deviation, highest radius in w; ``scan_rate``, rad/s, as far as 60 % of the greatest
    speed allows.
    ``climb``: speed, in shares of the greatest, up a gradient of the whole peak over w; ``min_move``, in w, between
    two points of a gradient. ``ambient_time_s`` over which ambient light that varies is followed, and the share
    ``ambient_left`` of its spread that is taken for noise. Raises ``InvalidParameterError``.
    """

    kind = machine.HOLD
    information = _OWN

    def __init__(
        self,
        batch: Any,
        *,
        spacing: float = 1.5,
        search_share: float = 0.8,
        gain: float = 2.0,
        patience: float = 2.0,
        gate: float = 3.0,
        scan: tuple[float, float, float] = (0.4, 2.0, 0.75),
        scan_rate: float = 1.2,
        climb: float = 0.8,
        min_move: float = 0.3,
        ambient_time_s: float = 5.0,
        ambient_left: float = 0.5,
    ) -> None:
        p, c = batch.params, batch.constants
        known, w, dt = c.rov_velocity_known, c.radius, c.action_period
        for name, value, low, high in (
            ("spacing", spacing, 0.05, 10.0), ("search_share", search_share, 0.01, 1.0), ("gain", gain, 0.01, 10.0),
            ("patience", patience, 0.0, 1e6), ("gate", gate, 1.0, math.inf), ("scan_rate", scan_rate, 0.0, 10.0),
            ("climb", climb, 0.0, 100.0), ("min_move", min_move, 1e-3, 10.0),
            ("ambient_time_s", ambient_time_s, dt, 1e6), ("ambient_left", ambient_left, 0.0, 1.0),
        ):  # fmt: skip
            check_range(name, value, low, high)
        for value in scan:
            check_range("scan", value, 0.0, 10.0)
        self.batch = batch
        step = c.full_scale / max(c.levels - 1, 1) if c.levels > 1 and np.isfinite(c.full_scale) else 0.0
        # Followed over ``ambient_time_s``, a slow change is left to a share of its spread.
        share = dt / ambient_time_s if c.ambient_variation > 0.0 else 0.0
        ambient = ambient_left * c.beam.ambient * c.ambient_variation
        std = math.sqrt(c.noise_std**2 + step**2 / 12.0 + ambient**2 + (_MODEL_STD * c.peak) ** 2)
        # Measured velocities add up to a random walk of the place; unknown ones wander like the vehicle's own.
        walk = (c.rov_velocity_std * dt) ** 2 if known else 0.0
        wander = 0.5 * p.rov_speed_m_s
        density = 1e-5 if known else max(2.0 * wander**2 / p.wander_time_s * 0.1, 1e-5)
        self.settings = MachineSettings(
            kind=self.kind, dt=dt, max_speed=c.max_speed, planar=c.axes == 1, smoothing=0.3, spacing=spacing * w,
            search_speed=search_share * c.max_speed, farthest=4.0 * max(p.guess_std_m, w), gain=float(gain), lag=0.4,
            threshold=max(c.detection, 4.0 * std), patience=float(patience),
            gradient_gain=climb * c.max_speed * w / c.peak,
            gradient=make_gradient_settings(min_move_m=min_move * w, smoothing=0.5, decay=0.05),
            beam=c.beam, std=max(std, _LEAST_STD * c.peak), ambient_share=share, gate=float(gate), radius=w,
            motion=make_motion("constant-velocity", density=density, step_variances=(walk + 1e-8, 0.0, 0.0)),
            speed_std=_BIAS_M_S if known else max(wander, _BIAS_M_S),
            greatest_speed=3.0 * _BIAS_M_S if known else max(1.2 * p.rov_speed_m_s, 3.0 * _BIAS_M_S),
            scan_low=scan[0] * w, scan_slope=scan[1], scan_high=scan[2] * w,
            scan_rate=min(float(scan_rate), 0.6 * c.max_speed / max(scan[2] * w, 1e-9)),
            fix_std=max(c.fix_std, _LEAST_FIX_M),
        )  # fmt: skip
        self.machines = np.zeros(batch.num_worlds, dtype=MACHINE)

    def reset(self, seeds: np.ndarray) -> None:
        """Forget everything; nothing is drawn."""
        self.machines[:] = np.zeros((), dtype=MACHINE)

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, axes): the velocity command as a share of the greatest speed."""
        actions = np.zeros(self.batch.action_shape, dtype=np.float32)
        decide_all(self.machines, worlds, self.settings, actions)
        return actions


class SearchHold(LaserPolicy):
    """Stops where the light was met and stays there; searches again about there once it is gone."""


class GradientAscent(LaserPolicy):
    """Climbs the gradient of the reading (algorithms 2 and 4)."""

    kind = machine.GRADIENT
    information = _OWN + _RELATIVE


class EkfTracking(LaserPolicy):
    """Rides the rim about the centre that a bank of extended Kalman filters believes in."""

    kind = machine.EKF
    information = _OWN + _RELATIVE


class RovTracking(LaserPolicy):
    """Flies over where acoustic fixes, filtered, place the submerged vehicle."""

    kind = machine.FIX
    information = _OWN + _RELATIVE + ", and acoustic fixes of it"


class TrueCenter(LaserPolicy):
    """Flies to the true centre: the bound of the score."""

    kind = machine.TRUTH
    information = "the true centre and its velocity, and its own"

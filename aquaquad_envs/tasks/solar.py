"""The sun over a mission, as all worlds take it from their parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.physics import energy
from aquaquad_envs.tasks.scenarios import ScenarioBank


def solar_table(params: Any, bank: ScenarioBank) -> tuple[energy.SolarCharge, float]:
    """Charge table over the mission, and seconds of local solar time at clock 0.

    ``params``: a :class:`~aquaquad_envs.tasks.vehicle_params.VehicleParams` with ``horizon_s`` and ``action_period_s``.
    """
    # Real currents bring their own place and date; the sun follows them.
    start_time = bank.start_time or params.start_time
    start = np.datetime64(energy.parse_start_time(start_time), "s")
    latitude, longitude = params.latitude, params.longitude
    if bank.center is not None:
        latitude, longitude = bank.center
    midnight = start.astype("datetime64[D]")
    offset = float((start - midnight).astype(np.float64)) + longitude / 360.0 * 86400.0
    # An action may begin just before the horizon and end after it.
    longest = max(params.action_period_s, params.max_hop_m / params.airspeed_m_s)
    duration = params.horizon_s + params.start_time_spread_s + longest + 3600.0
    if params.solar == "constant":
        return energy.constant_charge(
            energy.PRESETS[params.energy].solar_wh_per_day, duration_s=duration
        ), offset
    if params.solar == "file":
        return energy.weather_file_charge(
            params.solar_file, start_time=start_time, duration_s=duration
        ), offset
    return energy.clear_sky_charge(
        latitude=latitude, longitude=longitude, start_time=start_time, duration_s=duration
    ), offset

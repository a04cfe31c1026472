"""Energy: published budgets, solar charge as a table, and the battery's balance.

Solar charge is precomputed as the energy collected since the mission's clock began,
C(t) in Wh, on a uniform time grid; the charge between two times is C(t1) - C(t0), so a step
costs two look-ups and sums over steps telescope exactly.
"""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.grids import locate

SECONDS_PER_HOUR = 3600.0
_QUIET = threading.Lock()


@dataclass(frozen=True, kw_only=True)
class EnergyPreset:
    """A published energy budget; powers in W, energies in Wh."""

    flight_power_w: float
    base_power_w: float  # sensing and communication included, averaged over the day
    solar_wh_per_day: float
    battery_wh: float


PRESETS = {
    # Dillard 2014, II.C: 5 W passive, 10 W of sensing and communication for 6 h a day. The thesis
    # gives no battery: the capacity is that of the 2016 paper.
    "2014": EnergyPreset(
        flight_power_w=200.0, base_power_w=5.0 + 10.0 * 6 / 24, solar_wh_per_day=400.0, battery_wh=178.0
    ),
    # Dobrokhodov et al. 2016, Tab. I: sensing and communication are part of the 5 W.
    "2016": EnergyPreset(flight_power_w=340.0, base_power_w=5.0, solar_wh_per_day=590.0, battery_wh=178.0),
}

#: Published array: 0.3 m², 24 % (Dillard 2014, II.C).
ARRAY_AREA_M2 = 0.3
ARRAY_EFFICIENCY = 0.24


@dataclass(frozen=True, kw_only=True, eq=False)
class SolarCharge:
    """Energy collected since clock time 0: ``collected_wh[i]`` at ``i * time_step_s``; non-decreasing."""

    collected_wh: np.ndarray
    time_step_s: float

    def between(self, start_s: float, end_s: float) -> float:
        """Energy collected from ``start_s`` to ``end_s``, Wh."""
        return float(charge_between(self.collected_wh, self.time_step_s, start_s, end_s))


def constant_charge(wh_per_day: float, *, duration_s: float) -> SolarCharge:
    """The published day-average: the same charging power at all times."""
    check_range("wh_per_day", wh_per_day, 0, 1e6)
    check_range("duration_s", duration_s, 0, 1e9, open_low=True)
    return SolarCharge(
        collected_wh=np.array([0.0, wh_per_day * duration_s / 86400.0]), time_step_s=float(duration_s)
    )


def parse_start_time(start_time: str) -> str:
    """``start_time`` as an ISO time in UTC without zone; raises ``InvalidParameterError`` if it is none."""
    try:
        stamp = datetime.fromisoformat(start_time)
    except (ValueError, TypeError):
        raise InvalidParameterError(
            "start_time", start_time, "an ISO date and time such as '2014-06-21T15:00'", "It is read as UTC."
        ) from None
    return (stamp.astimezone(UTC).replace(tzinfo=None) if stamp.tzinfo else stamp).isoformat()


def _timestamp(start_time: str):
    import pandas as pd

    return pd.Timestamp(parse_start_time(start_time), tz="UTC")


def _cumulative(power_w: np.ndarray, time_step_s: float) -> SolarCharge:
    steps = 0.5 * (power_w[1:] + power_w[:-1]) * time_step_s / SECONDS_PER_HOUR
    return SolarCharge(collected_wh=np.concatenate([[0.0], np.cumsum(steps)]), time_step_s=time_step_s)


def clear_sky_charge(
    *,
    latitude: float,
    longitude: float,
    start_time: str,
    duration_s: float,
    area_m2: float = ARRAY_AREA_M2,
    efficiency: float = ARRAY_EFFICIENCY,
    time_step_s: float = 300.0,
) -> SolarCharge:
    """Charge of a horizontal array under a clear sky: P = area · efficiency · GHI(t).

    GHI (W/m²) is the Ineichen–Perez clear-sky irradiance on a level surface with the
    climatological Linke turbidity of the place and month, both from pvlib; level incidence is
    part of GHI. Latitude and longitude in degrees (north, east positive), ``start_time`` an ISO
    time in UTC. Valid for a calm sea: waves that tilt the array are neglected.
    """
    import pandas as pd
    import pvlib

    check_range("latitude", latitude, -90, 90)
    check_range("longitude", longitude, -180, 360)
    _check_array(area_m2, efficiency)
    start = _timestamp(start_time)
    count = 1 + int(np.ceil(duration_s / time_step_s))
    times = pd.DatetimeIndex(start + pd.to_timedelta(np.arange(count) * time_step_s, unit="s"))
    longitude = (longitude + 180.0) % 360.0 - 180.0
    place = pvlib.location.Location(latitude, longitude, altitude=0.0)
    # pvlib's own deprecation notices are not our user's; silencing is not safe between threads.
    with _QUIET, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ghi = place.get_clearsky(times, model="ineichen")["ghi"].to_numpy(dtype=np.float64)
    return _cumulative(area_m2 * efficiency * np.maximum(ghi, 0.0), time_step_s)


def weather_file_charge(
    path: str | Path,
    *,
    start_time: str,
    duration_s: float,
    area_m2: float = ARRAY_AREA_M2,
    efficiency: float = ARRAY_EFFICIENCY,
) -> SolarCharge:
    """Charge of a horizontal array from measured or typical irradiance: a TMY3 or NSRDB (PSM) CSV file.

    The file's GHI at the same month, day and hour (UTC) is used whatever its year, so that a
    typical year serves any mission; each record's mean irradiance counts over its own interval.
    Raises ``InvalidParameterError`` naming the file where it is missing or not such a file.
    """
    _check_array(area_m2, efficiency)
    ghi, interval_s, offset_s = _read_weather(Path(path))
    start = _timestamp(start_time)
    year_start = start.replace(month=1, day=1, hour=0, minute=0, second=0, microsecond=0, nanosecond=0)
    day = min(start.day_of_year - 1, 364)
    if start.is_leap_year and start.day_of_year > 59:
        day = start.day_of_year - 2  # a typical year has no 29 February: hold 28 February
    elapsed = day * 86400.0 + ((start - year_start).total_seconds() % 86400.0)
    year_s = len(ghi) * interval_s
    collected = np.concatenate([[0.0], np.cumsum(ghi)]) * area_m2 * efficiency * interval_s / SECONDS_PER_HOUR
    count = 1 + int(np.ceil(duration_s / 300.0))
    # Time along the file's own records, wrapped at the end of the year.
    along = elapsed - offset_s + np.arange(count) * 300.0
    turns, within = np.divmod(along, year_s)
    table = turns * collected[-1] + np.interp(within, np.arange(len(collected)) * interval_s, collected)
    return SolarCharge(collected_wh=table - table[0], time_step_s=300.0)


def _read_weather(path: Path) -> tuple[np.ndarray, float, float]:
    """GHI (W/m²) of a whole year, the interval (s), and the time of the first record's start after 1 January UTC."""
    import pvlib

    remedy = "Give a TMY3 file or an NSRDB PSM CSV file of a whole year."
    if not path.is_file():
        raise InvalidParameterError("solar_file", str(path), "an existing file", remedy)
    try:
        with path.open(errors="replace") as lines:
            nsrdb = lines.readline().startswith("Source,Location ID")
        if nsrdb:
            reader = getattr(pvlib.iotools, "read_nsrdb_psm4", None) or pvlib.iotools.read_psm3
            data, _ = reader(path, map_variables=True)
        else:
            data, _ = pvlib.iotools.read_tmy3(path, coerce_year=1990, map_variables=True)
        ghi = data["ghi"].to_numpy(dtype=np.float64)
        stamps = data.index.tz_convert("UTC")
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OSError) as error:
        raise InvalidParameterError(
            "solar_file", str(path), "a TMY3 or NSRDB file", f"{remedy} ({error})"
        ) from error
    per_year = len(ghi)
    if per_year not in (8760, 8784, 17520, 17568) or not np.isfinite(ghi).all() or (ghi < 0).any():
        raise InvalidParameterError(
            "solar_file", f"{path.name} with {per_year} records", "a whole year of finite GHI, hourly or half-hourly",
            remedy,
        )  # fmt: skip
    interval_s = 3600.0 if per_year < 10_000 else 1800.0
    # TMY3 stamps the end of each hour; PSM stamps the middle of its interval.
    first = stamps[0]
    seconds = (first.day_of_year - 1) * 86400.0 + first.hour * 3600.0 + first.minute * 60.0
    return ghi, interval_s, seconds - (interval_s / 2 if nsrdb else interval_s)


def _check_array(area_m2: float, efficiency: float) -> None:
    check_range("area_m2", area_m2, 0, 1e4)
    check_range("efficiency", efficiency, 0, 1)


@kernel
def collected_at(collected_wh, time_step, t):
    """Energy, Wh, collected from clock time 0 until ``t`` s."""
    index, fraction = locate(0.0, time_step, collected_wh.size, t)
    return collected_wh[index] + fraction * (collected_wh[index + 1] - collected_wh[index])


@kernel
def charge_between(collected_wh, time_step, start, end):
    """Energy, Wh, collected between clock times ``start`` and ``end``, s."""
    return collected_at(collected_wh, time_step, end) - collected_at(collected_wh, time_step, start)


@kernel
def balance(battery, capacity, charged, demanded):
    """New (battery, spent, clipped, empty), Wh, after charging and spending over one interval.

    battery' = min(battery + charged - spent, capacity), clipped = what exceeded the capacity;
    battery' + spent + clipped = battery + charged at all times. Where the demand exceeds what there
    is, spent is what there is, the battery is 0 and ``empty`` is true (the mission's constraint
    battery + charge - passive - flight >= 0 is broken).
    """
    available = battery + charged
    empty = demanded > available
    spent = available if empty else demanded
    left = available - spent
    stored = min(left, capacity)
    return stored, spent, left - stored, empty

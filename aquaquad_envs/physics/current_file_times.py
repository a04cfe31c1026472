"""When: dates of the frames of a file, the span of a mission in them, interpolation in time."""

from __future__ import annotations

import datetime
import re
from typing import Any

import numpy as np

from aquaquad_envs.errors import CurrentFileError, InvalidParameterError
from aquaquad_envs.physics.current_file_naming import Located, describe, find_time
from aquaquad_envs.physics.current_file_source import Component, read_values, unpack

_EPOCH = "seconds since 1970-01-01 00:00:00"
#: Share of a step by which dates may be off and still count as uniform.
_ROUNDING = 0.05


def find_dates(component: Component, notes: list[str]) -> tuple[np.ndarray | None, np.ndarray, str]:
    """Dates of the frames: (seconds since 1970 in the file's calendar or None, file order, calendar).

    Frames without a valid date and repeated dates are left out, and unsorted ones sorted.
    """
    dataset = component.source.dataset
    hints = f"{component.source.text('coordinates')} {component.source.text('time')}"
    located = find_time(dataset, component.time, hints)
    size = 1 if component.time is None else component.source.variable.sizes[component.time]
    if located is None:
        if size > 1:
            raise CurrentFileError(
                f"{component.source.name!r} has {size} steps along {component.time!r} but no variable that dates them. "
                f"The variables are: {describe([dataset])}."
            )
        return None, np.zeros(1, dtype=np.int64), "standard"
    seconds, calendar = _decode(located)
    seconds = np.atleast_1d(seconds)
    order = np.argsort(seconds, kind="stable")  # NaN sorts to the end
    good = order[np.isfinite(seconds[order])]
    if len(good) < len(order):
        notes.append(f"{len(order) - len(good)} frames without a valid time are left out")
    if len(good) == 0:
        raise CurrentFileError(f"no valid time in {located.name!r} (units {located.text('units')!r}).")
    if np.any(np.diff(good) < 0):
        notes.append("times were not in order; sorted")
    fresh = np.concatenate([[True], np.diff(seconds[good]) > 1e-3])
    if not fresh.all():
        notes.append(f"{int(np.sum(~fresh))} repeated times are left out; the first of each is used")
    return seconds[good[fresh]], good[fresh], calendar


def _decode(located: Located) -> tuple[np.ndarray, str]:
    """Seconds since 1970-01-01 in the file's own calendar, NaN where missing."""
    import cftime

    units, calendar = (
        str(located.variable.attrs.get("units", "")).strip(),
        located.text("calendar") or "standard",
    )
    raw = read_values(located.variable, located.name)
    try:
        if raw.dtype.kind in "SUO":
            if raw.dtype.kind == "S" and raw.dtype.itemsize == 1 and raw.ndim:
                raw = np.array([b"".join(row) for row in raw.reshape(-1, raw.shape[-1])])
            texts = [x.decode() if isinstance(x, bytes) else str(x) for x in np.ravel(raw)]
            dates = [parse_date(text.replace("_", "T"), calendar) for text in texts]
            return np.array(cftime.date2num(dates, _EPOCH, calendar=calendar), dtype=np.float64), calendar
        if " since " not in units:
            raise ValueError("no 'units' of the form 'hours since 2000-01-01'")
        values = unpack(np.atleast_1d(raw), dict(located.variable.attrs))
        good = np.abs(values) < 1e30  # netCDF's default fill is 9.97e36
        seconds = np.full(values.shape, np.nan)
        if good.any():
            dates = cftime.num2date(values[good], units, calendar=calendar, only_use_cftime_datetimes=True)
            # The dates, not the numbers, are what the two files of a pair have in common.
            seconds[good] = np.array(cftime.date2num(dates, _EPOCH, calendar=calendar), dtype=np.float64)
        return seconds, calendar
    except Exception as error:
        shown = np.ravel(raw)[:3].tolist()
        raise CurrentFileError(
            f"time {located.name!r} does not parse: units {units!r}, calendar {calendar!r}, first values {shown} "
            f"({type(error).__name__}: {error}). Give it CF units such as 'hours since 2000-01-01 00:00:00'."
        ) from error


def parse_date(text: str, calendar: str) -> Any:
    """An ISO date such as '2024-01-31' or '2024-01-31T06:00:00Z' as a cftime date of ``calendar``."""
    import cftime

    match = re.fullmatch(
        r"(\d{4})-(\d\d?)-(\d\d?)(?:[T ](\d\d?):(\d\d)(?::(\d\d)(?:\.(\d+))?)?)?\s*(Z|UTC|[+-]\d\d:?\d\d)?",
        text.strip(),
    )
    if match is None:
        raise ValueError(f"{text!r} is not a date such as 2024-01-31T06:00:00")
    numbers = [int(part or 0) for part in match.groups()[:6]]
    date = cftime.datetime(*numbers, int((match[7] or "0").ljust(6, "0")[:6]), calendar=calendar)
    if match[8] and match[8][0] in "+-":
        digits = match[8][1:].replace(":", "")
        shift = datetime.timedelta(hours=int(digits[:2]), minutes=int(digits[2:]))
        date = date - shift if match[8][0] == "+" else date + shift
    return date


def date_components(u: Component, v: Component, notes: list[str]) -> tuple[np.ndarray, str]:
    """Date the frames of both components; returns all dates in the span they share, s, and the calendar."""
    seconds_u, u.order, calendar = find_dates(u, notes)
    seconds_v, v.order, other = find_dates(v, notes)
    if seconds_u is None or seconds_v is None:
        known = [(s, c) for s, c in ((seconds_u, calendar), (seconds_v, other)) if s is not None]
        if not known:
            notes.append("the file has no time; the current is steady")
            return np.zeros(1), calendar
        if len(known[0][0]) > 1:
            raise CurrentFileError("only one of the two components has times, and several.")
        seconds_u = seconds_v = known[0][0]
        calendar = known[0][1]
    u.seconds, v.seconds = seconds_u, seconds_v
    first, last = max(seconds_u[0], seconds_v[0]), min(seconds_u[-1], seconds_v[-1])
    if first > last:
        spans = [f"{iso_date(s[0], calendar)} to {iso_date(s[-1], calendar)}" for s in (seconds_u, seconds_v)]
        raise CurrentFileError(f"u and v share no time: u covers {spans[0]}, v {spans[1]}.")
    if len(seconds_u) == len(seconds_v) and np.allclose(seconds_u, seconds_v, rtol=0, atol=0.5):
        v.seconds = seconds_u
    else:
        notes.append("u and v have different times; both interpolated over the span they share")
    every = np.union1d(u.seconds, v.seconds)
    every = every[(every >= first) & (every <= last)]
    return every[np.diff(every, prepend=-np.inf) > 1e-3], calendar


def iso_date(seconds: float, calendar: str) -> str:
    """Seconds since 1970 in ``calendar`` as an ISO date, to the second."""
    import cftime

    return str(
        cftime.num2date(round(seconds), _EPOCH, calendar=calendar, only_use_cftime_datetimes=True).isoformat()
    )


def mission_span(
    frames: np.ndarray,
    dated: bool,
    calendar: str,
    start_time: str | None,
    duration_s: float | None,
    notes: list[str],
) -> tuple[float, float]:
    """Seconds of mission time 0 and of the end of what is read."""
    import cftime

    first, last, start = float(frames[0]), float(frames[-1]), float(frames[0])
    if start_time is not None:
        if not dated:
            raise CurrentFileError(
                f"start_time {start_time!r} cannot be found: the file has no time. Leave it out."
            )
        try:
            date = parse_date(str(start_time), calendar)
        except ValueError as error:
            raise InvalidParameterError(
                "start_time",
                start_time,
                f"an ISO date such as '2024-01-31T06:00:00' in the {calendar} calendar",
            ) from error
        start = float(cftime.date2num(date, _EPOCH, calendar=calendar))
        if not first - 1.0 <= start <= last + 1.0:
            raise CurrentFileError(
                f"start_time {start_time!r} is outside the file, which covers {iso_date(first, calendar)} to "
                f"{iso_date(last, calendar)} ({calendar} calendar)."
            )
        # Dates stored as floating-point days are off by fractions of a second.
        nearest = float(frames[np.argmin(np.abs(frames - start))])
        start = nearest if abs(nearest - start) <= min(1.0, _ROUNDING * (last - first)) else start
        start = min(max(start, first), last)
    end = last if duration_s is None else min(start + duration_s, last)
    if duration_s is not None and start + duration_s > last + 1.0:
        held = f"the file ends {(last - start) / 3600:.4g} h after the start"
        notes.append(held + f", before {duration_s / 3600:.4g} h are over; its last frame is held")
    return start, end


def timeline(dates: np.ndarray, start: float, end: float, notes: list[str]) -> tuple[np.ndarray, float]:
    """When to sample the file, s, from ``start`` to at least ``end`` in uniform steps, and the step.

    The file's own frames where they are uniform from ``start`` on; else the coarsest step
    that meets ``start`` and all frames (so that nothing is lost), or, where that is much finer
    than the frames, their median step.
    """
    tolerance = 1e-3
    begin = max(int(np.searchsorted(dates, start + tolerance, side="right")) - 1, 0)
    frames = dates[begin : int(np.searchsorted(dates, end - tolerance)) + 1]
    later = frames[frames > start + tolerance] - start
    if len(later) == 0:
        return np.array([start]), 3600.0
    gaps = np.diff(frames)
    if gaps.max() > 5 * np.median(gaps):
        notes.append(f"a gap of {gaps.max() / 3600:.4g} h between frames is interpolated")
    uniform = np.all(np.abs(gaps - gaps.mean()) <= _ROUNDING * gaps.mean())
    if uniform and abs(frames[0] - start) <= tolerance:
        return frames, float(gaps.mean())
    whole = np.rint(later).astype(np.int64)
    step = float(np.gcd.reduce(whole))
    if np.abs(later - whole).max() > 0.01 or step == 0 or whole[-1] / step + 1 > max(4 * len(frames), 48):
        count = int(np.ceil(later[-1] / np.median(np.diff(later, prepend=0.0)) - 1e-9))
        step = float(later[-1] / count)
    count = round(later[-1] / step)
    notes.append(f"times resampled linearly to uniform steps of {step:g} s")
    return start + step * np.arange(count + 1), step


def frames_about(component: Component, times: np.ndarray) -> np.ndarray:
    """The component's frames that interpolation at ``times`` needs."""
    if component.seconds is None:
        return np.zeros(1, dtype=np.int64)
    low = max(int(np.searchsorted(component.seconds, times[0] + 1e-3, side="right")) - 1, 0)
    high = min(int(np.searchsorted(component.seconds, times[-1] - 1e-3)), len(component.seconds) - 1)
    return np.arange(low, max(high, low) + 1)


def in_time(stored: np.ndarray, part: Component, times: np.ndarray, notes: list[str]) -> np.ndarray:
    """Fill gaps of points valid in at least half of the frames, then interpolate linearly to ``times``."""
    missing = np.isnan(stored)
    share = missing.mean(axis=0)
    stored[:, share > 0.5] = np.nan
    gaps = np.argwhere((share > 0) & (share <= 0.5))
    seconds = np.zeros(1) if part.seconds is None else part.seconds[frames_about(part, times)]
    for i, j in gaps:
        good = ~missing[:, i, j]
        stored[:, i, j] = np.interp(seconds, seconds[good], stored[good, i, j])
    if len(gaps):
        notes.append(f"gaps of {part.source.name!r} at {len(gaps)} points filled linearly in time")
    if len(seconds) == 1 or (len(seconds) == len(times) and np.abs(seconds - times).max() <= 1e-2):
        return stored if len(stored) == len(times) else np.repeat(stored, len(times), axis=0)
    lower = np.clip(np.searchsorted(seconds, times, side="right") - 1, 0, len(seconds) - 2)
    share_after = np.clip((times - seconds[lower]) / (seconds[lower + 1] - seconds[lower]), 0.0, 1.0)
    after = share_after[:, None, None]
    return stored[lower] * (1 - after) + stored[lower + 1] * after

"""Real ocean currents from NetCDF files, as a :class:`CurrentField` in local metres with its land."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aquaquad_envs.errors import CurrentFileError, InvalidParameterError, check_range
from aquaquad_envs.physics.current_file_naming import VelocityPair, find_angle, find_mask, find_velocity
from aquaquad_envs.physics.current_file_sampling import (
    HIGHEST_LATITUDE,
    Sampler,
    extent,
    spacings,
    wettest_center,
)
from aquaquad_envs.physics.current_file_source import (
    FASTEST_M_S,
    Component,
    HorizontalGrid,
    find_component,
    find_dates,
    find_grid_of_shape,
    find_undeclared_fill,
    open_files,
    parse_date,
    read_values,
    unpack,
)
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid

if TYPE_CHECKING:
    import xarray

_EPOCH = "seconds since 1970-01-01 00:00:00"
_LARGEST_FIELD_BYTES = 512 * 2**20
_SURVEY_POINTS = 4_000_000
_MOST_NODES_A_SIDE = 1001


@dataclass(frozen=True, kw_only=True, eq=False)
class FileCurrents:
    """Currents read from a file.

    Parameters
    ----------
    field: the current, m/s, on local metres about ``center``; 0 on land and where data are missing.
        Its time 0 is ``start_time``.
    land: bool (rows, columns) on the field's grid: nodes whose nearest point of the file is land
        or missing in more than half of the frames used, or that lie outside the data.
    center: (latitude, longitude), degrees north and east, of local (0, 0).
    start_time: ISO date of mission time 0 in the file's calendar; None when the file has no time.
    notes: what was chosen and assumed, one sentence each.
    """

    field: CurrentField
    land: np.ndarray
    center: tuple[float, float]
    start_time: str | None
    notes: tuple[str, ...]


def load_current_file(
    path: str | Path | Sequence[str | Path],
    *,
    half_width_m: float = 20_000.0,
    spacing_m: float | None = None,
    center: tuple[float, float] | None = None,
    start_time: str | None = None,
    duration_s: float | None = None,
) -> FileCurrents:
    """Read surface currents around a point from one NetCDF file, or from two that hold u and v.

    The sphere is projected about the centre: x = R cos(lat0) (lon - lon0), y = R (lat - lat0)
    with R = 6371.0088 km; x is off by a share of about tan(lat0) d / R at distance d (0.3 % at
    20 km and 45°), so boxes are limited to 500 km half width and centres to 85° latitude.

    Parameters
    ----------
    path: a NetCDF file (classic or NetCDF-4), or several that belong together (u, v, grid).
    half_width_m: the box is ``[-half_width, half_width]²``, m.
    spacing_m: between nodes, m. Default: half the resolution of the file, but 41 to 201 nodes a side.
    center: (latitude, longitude), degrees. Default: the point whose box has the most water, of
        equals the nearest to the middle of the data.
    start_time: ISO date of mission time 0, in the file's calendar. Default: the first time in the file.
    duration_s: how much to read from ``start_time`` on, s. Default: all (up to 512 MiB).

    Space is interpolated linearly over valid neighbours only, time linearly to uniform steps.
    Gaps of points that are valid in at least half of the frames used are filled linearly in time.

    Raises ``CurrentFileError``, which says what was found, for what cannot be read (no such file,
    not NetCDF, unstructured mesh, no velocity, no time that parses, box outside the data, all land),
    ``InvalidParameterError`` for the other arguments.
    """
    check_range("half_width_m", half_width_m, 0, 500_000.0, open_low=True)
    if spacing_m is not None:
        finest = 2 * half_width_m / (_MOST_NODES_A_SIDE - 1)
        check_range("spacing_m", spacing_m, finest, 2 * half_width_m)
    if duration_s is not None:
        check_range("duration_s", duration_s, 0, 1e11)
    center = _checked_center(center)
    paths = [Path(path)] if isinstance(path, str | Path) else [Path(one) for one in path]
    if not paths:
        raise CurrentFileError("no path was given. Give the path of a NetCDF file.")
    names = " and ".join(repr(one.name) for one in paths)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            with open_files(paths) as datasets:
                return _load(datasets, half_width_m, spacing_m, center, start_time, duration_s)
    except CurrentFileError as error:
        raise CurrentFileError(f"{names}: {error}" if names not in str(error) else str(error)) from error


def _checked_center(center: tuple[float, float] | None) -> tuple[float, float] | None:
    if center is None:
        return None
    try:
        latitude, longitude = (float(value) for value in center)
    except (TypeError, ValueError):
        latitude = longitude = np.nan
    if not (abs(latitude) <= HIGHEST_LATITUDE and abs(longitude) <= 360.0):
        raise CurrentFileError(
            f"center: got {center!r}, expected finite (latitude, longitude) in degrees, "
            f"latitude within ±{HIGHEST_LATITUDE:g} and longitude within ±360."
        )
    return latitude, longitude


def _load(
    datasets: list[xarray.Dataset],
    half_width_m: float,
    spacing_m: float | None,
    center: tuple[float, float] | None,
    start_time: str | None,
    duration_s: float | None,
) -> FileCurrents:
    notes: list[str] = []
    pair = find_velocity(datasets)
    notes.append(f"u is {pair.u.name!r} and v is {pair.v.name!r}, found by {pair.found_by}")
    u, v = (find_component(located, datasets, notes) for located in (pair.u, pair.v))
    water = _put_on_grids(u, v, datasets, notes)
    angle = _grid_angle(pair, u, datasets, notes)
    first, last, calendar = _date_components(u, v, notes)
    start, end = _mission_span(first, last, calendar, start_time, duration_s, notes)
    times, step = _timeline(u, v, start, end, notes)
    wet, stride, zero_is_land = _survey(u, v, water, times, notes)
    assert u.grid is not None
    if center is None:
        center = wettest_center(u.grid, wet, half_width_m, stride)
        notes.append(f"centre chosen at {center[0]:.4f}, {center[1]:.4f}, where the box has the most water")

    corners = np.array([-half_width_m, 0.0, half_width_m])
    probe = Sampler(u.grid, center, *(a.ravel() for a in np.meshgrid(corners, corners)))
    if probe.outside[4]:
        raise CurrentFileError(
            f"the centre {center} lies outside the data, which cover {extent(u.grid)}. "
            "Choose a centre inside, or leave it out."
        )
    if spacing_m is None:
        spacing_m = float(np.clip(probe.resolution_m / 2, half_width_m / 100, half_width_m / 20))
    grid, side = Grid.square(half_width_m, spacing_m)
    times = _fit_memory(times, side, duration_s, notes)
    velocity, land, outside = _sample(u, v, water, angle, zero_is_land, times, grid, side, center, notes)
    if land.all():
        raise CurrentFileError(
            f"the box of ±{half_width_m / 1000:g} km about {center} is all land or missing. The data cover "
            f"{extent(u.grid)}. Choose another centre, or leave it out."
        )
    if outside.any():
        notes.append(f"{100 * outside.mean():.0f} % of the box lies outside the data and is marked as land")
    for part in (u, v):
        if part.discarded:
            notes.append(
                f"values of {part.source.name!r} beyond {FASTEST_M_S:g} m/s (up to {part.discarded:.4g}) taken as missing"
            )
    land.setflags(write=False)
    return FileCurrents(
        field=CurrentField(velocity=velocity, grid=grid, time0_s=0.0, time_step_s=step),
        land=land, center=center,
        start_time=None if u.seconds is None else _iso(start, calendar), notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _put_on_grids(u: Component, v: Component, datasets: list[xarray.Dataset], notes: list[str]) -> np.ndarray | None:
    """Give both components their grid, staggered ones that of the cell centres; returns its water mask, if any."""
    (u_rows, u_columns), (v_rows, v_columns) = u.stored_shape, v.stored_shape
    if u.stored_shape != v.stored_shape:
        inner = u_columns == v_columns - 1 and v_rows == u_rows - 1
        outer = u_columns == v_columns + 1 and v_rows == u_rows + 1
        shape = (u_rows, v_columns)
        centers = find_grid_of_shape(datasets, shape) if inner or outer else None
        if centers is not None:
            shifts = (-1, 0) if inner else (0, 1)
            u.staggered, v.staggered = ("columns", *shifts), ("rows", *shifts)
            u.grid = v.grid = centers
            notes.append("staggered components averaged to the cell centres")
            return _water_at(datasets, shape)
    elif u.grid is None and v.grid is None:
        u.grid = v.grid = find_grid_of_shape(datasets, u.stored_shape)
    elif u.grid is None or v.grid is None:
        u.grid = v.grid = u.grid or v.grid
    if u.grid is None or v.grid is None:
        raise CurrentFileError(
            f"no latitude and longitude found for {u.source.name!r} {u.stored_shape} and {v.source.name!r} "
            f"{v.stored_shape}. Add them to the file, or pass the file of the grid as a further path."
        )
    if u.grid.same_as(v.grid):
        v.grid = u.grid
    else:
        notes.append("u and v lie at different points; each is interpolated from its own")
    return None


def _water_at(datasets: list[xarray.Dataset], shape: tuple[int, int]) -> np.ndarray | None:
    mask = find_mask(datasets, shape, ("mask_rho",))
    if mask is None:
        return None
    water = unpack(read_values(mask.variable, mask.name), dict(mask.variable.attrs)) > 0.5
    return water if mask.text("standard_name") != "land_binary_mask" else ~water


def _grid_angle(
    pair: VelocityPair, u: Component, datasets: list[xarray.Dataset], notes: list[str]
) -> np.ndarray | None:
    """Angle, rad, from east to the direction of u at every point of u's grid; None where it points east."""
    assert u.grid is not None
    grid, direction = u.grid, pair.direction
    located = find_angle(datasets, grid.shape)
    if u.staggered and direction == "east":
        notes.append("components are named eastward and northward but lie staggered: taken as along the grid")
        direction = "grid"
    if direction == "east":
        return None
    if direction == "" and not u.staggered and located is None:
        if not grid.regular:
            notes.append("nothing says how u and v point on this curved grid; assumed east and north")
        return None
    if located is None:
        if grid.regular:
            return None
        notes.append("components along the grid turned by its angle, found from latitude and longitude")
        return spacings(*grid.fields())[2]
    dims = located.variable.dims
    first = {str(d): 0 for d in dims[:-2]}
    angle = unpack(read_values(located.variable, located.name, **first), dict(located.variable.attrs))
    units = located.text("units")
    if "deg" in units or ("rad" not in units and np.nanmax(np.abs(angle)) > 2 * np.pi):
        angle = np.radians(angle)
        if "deg" not in units:
            notes.append(f"{located.name!r} taken as degrees: it exceeds 2π")
    notes.append(f"components turned from the grid to east and north by {located.name!r}")
    gap = np.angle(np.exp(1j * (angle - spacings(*grid.fields())[2])))
    if np.nanmedian(np.abs(gap)) > np.radians(10):
        notes.append(
            f"{located.name!r} differs from the angle of the grid lines by {np.degrees(np.nanmedian(gap)):.0f}°; "
            "check that it runs from east to the x axis"
        )
    return angle


def _date_components(u: Component, v: Component, notes: list[str]) -> tuple[float, float, str]:
    """Date the frames of both components; returns the span they share and the calendar."""
    seconds_u, u.order, calendar = find_dates(u, notes)
    seconds_v, v.order, other = find_dates(v, notes)
    if seconds_u is None or seconds_v is None:
        known = [(s, c) for s, c in ((seconds_u, calendar), (seconds_v, other)) if s is not None]
        if not known:
            notes.append("the file has no time; the current is steady")
            return 0.0, 0.0, calendar
        if len(known[0][0]) > 1:
            raise CurrentFileError("only one of the two components has times, and several.")
        seconds_u = seconds_v = known[0][0]
        calendar = known[0][1]
    u.seconds, v.seconds = seconds_u, seconds_v
    first, last = max(seconds_u[0], seconds_v[0]), min(seconds_u[-1], seconds_v[-1])
    if first > last:
        spans = [f"{_iso(s[0], calendar)} to {_iso(s[-1], calendar)}" for s in (seconds_u, seconds_v)]
        raise CurrentFileError(f"u and v share no time: u covers {spans[0]}, v {spans[1]}.")
    if len(seconds_u) != len(seconds_v) or not np.allclose(seconds_u, seconds_v, rtol=0, atol=1.0):
        notes.append("u and v have different times; both interpolated over the span they share")
    return float(first), float(last), calendar


def _iso(seconds: float, calendar: str) -> str:
    import cftime

    return str(cftime.num2date(round(seconds), _EPOCH, calendar=calendar, only_use_cftime_datetimes=True).isoformat())


def _mission_span(
    first: float, last: float, calendar: str, start_time: str | None, duration_s: float | None, notes: list[str]
) -> tuple[float, float]:
    """Seconds of mission time 0 and of the end of what is read."""
    import cftime

    start = first
    if start_time is not None:
        if first == last == 0.0 and any("has no time" in note for note in notes):
            raise CurrentFileError(f"start_time {start_time!r} cannot be found: the file has no time. Leave it out.")
        try:
            date = parse_date(str(start_time), calendar)
        except ValueError as error:
            raise InvalidParameterError(
                "start_time", start_time, f"an ISO date such as '2024-01-31T06:00:00' in the {calendar} calendar"
            ) from error
        start = float(cftime.date2num(date, _EPOCH, calendar=calendar))
        if not first - 1.0 <= start <= last + 1.0:
            raise CurrentFileError(
                f"start_time {start_time!r} is outside the file, which covers {_iso(first, calendar)} to "
                f"{_iso(last, calendar)} ({calendar} calendar)."
            )
        start = min(max(start, first), last)
    end = last if duration_s is None else min(start + duration_s, last)
    if duration_s is not None and start + duration_s > last + 1.0:
        held = f"the file ends {(last - start) / 3600:.4g} h after the start"
        notes.append(held + f", before {duration_s / 3600:.4g} h are over; its last frame is held")
    return start, end


def _timeline(u: Component, v: Component, start: float, end: float, notes: list[str]) -> tuple[np.ndarray, float]:
    """When to sample the file, s, from ``start`` to at least ``end`` in uniform steps, and the step.

    The file's own frames where they are uniform from ``start`` on; else the coarsest step
    that meets ``start`` and all frames (so that nothing is lost), or, where that is much finer
    than the frames, their median step.
    """
    if u.seconds is None or v.seconds is None:
        return np.zeros(1), 3600.0
    low, high = max(u.seconds[0], v.seconds[0]), min(u.seconds[-1], v.seconds[-1])
    every = np.unique(np.concatenate([u.seconds, v.seconds]))
    every = every[(every >= low - 1e-3) & (every <= high + 1e-3)]
    every = every[np.concatenate([[True], np.diff(every) > 1.0])]
    tolerance = 1.0
    begin = max(int(np.searchsorted(every, start + tolerance, side="right")) - 1, 0)
    frames = every[begin : int(np.searchsorted(every, end - tolerance)) + 1]
    if len(frames) == 0 or (len(frames) == 1 and frames[0] - start < tolerance):
        return np.array([start]), 3600.0
    gaps = np.diff(frames)
    if len(gaps) and gaps.max() > 5 * np.median(gaps):
        notes.append(f"a gap of {gaps.max() / 3600:.4g} h between frames is interpolated")
    if abs(frames[0] - start) <= tolerance and np.all(np.abs(gaps - gaps.mean()) <= 0.02 * gaps.mean()):
        return frames, float(gaps.mean())
    later = frames[frames > start + tolerance] - start
    if len(later) == 0:
        return np.array([start]), 3600.0
    whole = np.rint(later).astype(np.int64)
    step = float(np.gcd.reduce(whole))
    count = round(whole[-1] / step)
    if np.abs(later - whole).max() > 0.01 or count + 1 > max(4 * len(frames), 48):
        count = int(np.ceil(later[-1] / np.median(np.diff(later, prepend=0.0)) - 1e-9))
        step = float(later[-1] / count)
    notes.append(f"times resampled linearly to uniform steps of {step:g} s")
    return start + step * np.arange(count + 1), step


def _frames_about(component: Component, times: np.ndarray) -> np.ndarray:
    """The component's frames that interpolation at ``times`` needs."""
    if component.seconds is None:
        return np.zeros(1, dtype=np.int64)
    low = max(int(np.searchsorted(component.seconds, times[0] + 1.0, side="right")) - 1, 0)
    high = min(int(np.searchsorted(component.seconds, times[-1] - 1.0)), len(component.seconds) - 1)
    return np.arange(low, max(high, low) + 1)


def _survey(
    u: Component, v: Component, water: np.ndarray | None, times: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, int, bool]:
    """Look at whole frames (first, middle, last used): where water is, and how missing is written.

    Returns the water mask of every ``stride``-th point of u's grid, the stride, and whether exact zeros are land.
    """
    grids: list[HorizontalGrid] = [g for g in (u.grid, v.grid) if g is not None]
    shape = grids[0].shape
    stride = int(np.ceil(np.sqrt(max(1.0, shape[0] * shape[1] / _SURVEY_POINTS))))
    seen = []
    for part, grid in zip((u, v), grids, strict=True):
        frames = _frames_about(part, times)
        frames = np.unique(frames[[0, len(frames) // 2, -1]])
        raw = part.stored(part.order[frames[:1]], *(np.arange(n) for n in part.stored_shape))
        part.also_missing = find_undeclared_fill(part, raw)
        if part.also_missing:
            notes.append(f"undeclared fill values {part.also_missing} of {part.source.name!r} taken as missing")
        rows, columns = (np.arange(n) for n in grid.shape)
        seen.append(np.stack([part.read(frames[i : i + 1], rows, columns)[0, ::stride, ::stride] for i in range(len(frames))]))
    together = seen[0].shape[1:] == seen[1].shape[1:]
    wet = np.isfinite(seen[0]).mean(axis=0) >= 0.5
    if together:
        wet &= np.isfinite(seen[1]).mean(axis=0) >= 0.5
    if water is not None:
        wet &= water[::stride, ::stride]
    zero = together and np.all([np.all(np.nan_to_num(part) == 0, axis=0) for part in seen], axis=0) & wet
    zero_is_land = False
    if together:
        # Land is made of patches; a lone row or point at rest may well be water.
        patch = zero[:-1, :-1] & zero[1:, :-1] & zero[:-1, 1:] & zero[1:, 1:]
        count = int(patch.sum())
        zero_is_land = count >= 1 and int(zero.sum()) >= max(4, 0.005 * wet.sum())
        if zero_is_land:
            notes.append(f"points at exactly 0 in every frame ({100 * zero.sum() / wet.sum():.0f} %) taken as land")
            wet = wet & ~zero
    if not wet.any():
        reason = "it is all land or missing"
        if zero_is_land:
            reason = "every velocity is exactly 0"
        elif u.discarded or v.discarded:
            reason = (
                f"all values are missing or beyond {FASTEST_M_S:g} m/s (up to {max(u.discarded, v.discarded):.4g} m/s, "
                "read as stated in the notes: " + "; ".join(notes) + "); check the units"
            )
        raise CurrentFileError(f"no water was found: {reason}.")
    speed = float(np.nanmedian(np.abs(seen[0][:, wet])))
    if speed > 3.0:
        notes.append(f"half of all |u| exceed {speed:.3g} m/s, which no ocean does: check the units")
    return wet, stride, zero_is_land


def _fit_memory(times: np.ndarray, side: int, duration_s: float | None, notes: list[str]) -> np.ndarray:
    most = max(2, _LARGEST_FIELD_BYTES // (side * side * 16))
    if len(times) <= most:
        return times
    if duration_s is not None:
        raise CurrentFileError(
            f"{len(times)} frames of {side} × {side} nodes exceed {_LARGEST_FIELD_BYTES // 2**20} MiB. "
            "Give a shorter duration_s or a larger spacing_m."
        )
    notes.append(f"only the first {most} of {len(times)} frames are read (512 MiB); give start_time and duration_s")
    return times[:most]


def _sample(
    u: Component, v: Component, water: np.ndarray | None, angle: np.ndarray | None, zero_is_land: bool,
    times: np.ndarray, grid: Grid, side: int, center: tuple[float, float], notes: list[str],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Velocity (frames, side, side, 2), land and outside (side, side) on the nodes of ``grid``."""
    assert u.grid is not None and v.grid is not None
    x, y = (a.ravel() for a in grid.nodes(side, side))
    at_u = Sampler(u.grid, center, x, y)
    at_v = at_u if v.grid is u.grid else Sampler(v.grid, center, x, y)
    if not (len(at_u.rows) and len(at_v.rows)):
        everywhere = np.ones((side, side), dtype=bool)
        return np.zeros((len(times), side, side, 2)), everywhere, everywhere
    stored = [
        part.read(_frames_about(part, times), sampler.rows, sampler.columns)
        for part, sampler in ((u, at_u), (v, at_v))
    ]
    if zero_is_land and stored[0].shape[1:] == stored[1].shape[1:]:
        still = np.all([np.all(np.nan_to_num(part) == 0, axis=0) for part in stored], axis=0)
        for part in stored:
            part[:, still] = np.nan
    stored = [_in_time(values, part, times, notes) for values, part in zip(stored, (u, v), strict=True)]
    valid = [np.isfinite(values).all(axis=0) for values in stored]
    if at_u is at_v:
        valid[0] = valid[1] = valid[0] & valid[1]
    if water is not None:
        valid[0] = valid[1] = valid[0] & water[np.ix_(at_u.rows, at_u.columns)]
    east, land_u = at_u.values(stored[0], valid[0])
    north, land_v = at_v.values(stored[1], valid[1])
    if angle is not None:
        turn = angle[np.ix_(at_u.rows, at_u.columns)]
        parts, _ = at_u.values(np.stack([np.cos(turn), np.sin(turn)]), valid[0] & np.isfinite(turn))
        cos, sin = parts / np.maximum(np.hypot(*parts), 1e-12)
        east, north = east * cos - north * sin, east * sin + north * cos
    land = land_u | land_v
    velocity = np.stack([east, north], axis=-1)
    velocity[:, land] = 0.0
    return (
        velocity.reshape(len(times), side, side, 2),
        land.reshape(side, side),
        (at_u.outside | at_v.outside).reshape(side, side),
    )


def _in_time(stored: np.ndarray, part: Component, times: np.ndarray, notes: list[str]) -> np.ndarray:
    """Fill gaps of points valid in at least half of the frames, then interpolate linearly to ``times``."""
    missing = np.isnan(stored)
    share = missing.mean(axis=0)
    stored[:, share > 0.5] = np.nan
    gaps = np.argwhere((share > 0) & (share <= 0.5))
    seconds = np.zeros(1) if part.seconds is None else part.seconds[_frames_about(part, times)]
    for i, j in gaps:
        good = ~missing[:, i, j]
        stored[:, i, j] = np.interp(seconds, seconds[good], stored[good, i, j])
    if len(gaps):
        notes.append(f"gaps of {part.source.name!r} at {len(gaps)} points filled linearly in time")
    if len(seconds) == 1 or (len(seconds) == len(times) and np.abs(seconds - times).max() <= 1.0):
        return stored if len(stored) == len(times) else np.repeat(stored, len(times), axis=0)
    lower = np.clip(np.searchsorted(seconds, times, side="right") - 1, 0, len(seconds) - 2)
    share_after = np.clip((times - seconds[lower]) / (seconds[lower + 1] - seconds[lower]), 0.0, 1.0)
    after = share_after[:, None, None]
    return stored[lower] * (1 - after) + stored[lower + 1] * after

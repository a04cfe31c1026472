"""Real ocean currents from NetCDF files, as a :class:`CurrentField` in local metres with its land."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aquaquad_envs.errors import CurrentFileError, check_range
from aquaquad_envs.physics.current_file_axes import find_component, grid_angle, put_on_grids
from aquaquad_envs.physics.current_file_naming import find_velocity
from aquaquad_envs.physics.current_file_sampling import HIGHEST_LATITUDE, Sampler, extent, wettest_center
from aquaquad_envs.physics.current_file_source import (
    FASTEST_M_S,
    Component,
    HorizontalGrid,
    find_undeclared_fill,
    open_files,
)
from aquaquad_envs.physics.current_file_times import (
    date_components,
    frames_about,
    in_time,
    iso_date,
    mission_span,
    timeline,
)
from aquaquad_envs.physics.currents import CurrentField
from aquaquad_envs.physics.grids import Grid

if TYPE_CHECKING:
    import xarray

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
    water = put_on_grids(u, v, datasets, notes)
    angle = grid_angle(pair, u, datasets, notes)
    dates, calendar = date_components(u, v, notes)
    start, end = mission_span(dates, u.seconds is not None, calendar, start_time, duration_s, notes)
    times, step = timeline(dates, start, end, notes)
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
        notes.append(f"{100 * outside.mean():.2g} % of the box lies outside the data and is marked as land")
    for part in (u, v):
        if part.discarded:
            fastest = f"{FASTEST_M_S:g} m/s (up to {part.discarded:.4g})"
            notes.append(f"values of {part.source.name!r} beyond {fastest} taken as missing")
    land.setflags(write=False)
    return FileCurrents(
        field=CurrentField(velocity=velocity, grid=grid, time0_s=0.0, time_step_s=step),
        land=land, center=center,
        start_time=None if u.seconds is None else iso_date(start, calendar), notes=tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def _witnesses(component: Component, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First, middle and last frame used and of the whole file, and which of them are used.

    What is at rest in all of them is land; a model may well start from rest in its first frame.
    """
    used = frames_about(component, times)
    count = len(component.order)
    frames = np.unique([used[0], used[len(used) // 2], used[-1], 0, count // 2, count - 1])
    return frames, np.isin(frames, used)


def _survey(
    u: Component, v: Component, water: np.ndarray | None, times: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, int, bool]:
    """Look at whole frames: where water is, and how missing is written.

    Returns the water mask of every ``stride``-th point of u's grid, the stride, and whether exact zeros are land.
    """
    grids: list[HorizontalGrid] = [g for g in (u.grid, v.grid) if g is not None]
    shape = grids[0].shape
    stride = int(np.ceil(np.sqrt(max(1.0, shape[0] * shape[1] / _SURVEY_POINTS))))
    seen, wets = [], []
    for part, grid in zip((u, v), grids, strict=True):
        frames, used = _witnesses(part, times)
        raw = part.stored(part.order[frames[:1]], *(np.arange(n) for n in part.stored_shape))
        part.also_missing = find_undeclared_fill(part, raw)
        if part.also_missing:
            notes.append(
                f"undeclared fill values {part.also_missing} of {part.source.name!r} taken as missing"
            )
        rows, columns = (np.arange(n) for n in grid.shape)
        one_by_one = [part.read(frames[i : i + 1], rows, columns) for i in range(len(frames))]
        seen.append(np.concatenate([frame[:, ::stride, ::stride] for frame in one_by_one]))
        wets.append(np.isfinite(seen[-1][used]).mean(axis=0) >= 0.5)
    together = seen[0].shape[1:] == seen[1].shape[1:]
    wet = wets[0] & wets[1] if together else wets[0]
    if water is not None:
        wet &= water[::stride, ::stride]
    zero_is_land = False
    if together:
        zero = wet & np.all([np.all(np.nan_to_num(part) == 0, axis=0) for part in seen], axis=0)
        # Land is made of patches; a lone row or point at rest may well be water.
        patch = zero[:-1, :-1] & zero[1:, :-1] & zero[:-1, 1:] & zero[1:, 1:]
        zero_is_land = bool(patch.any()) and int(zero.sum()) >= max(4, 0.005 * wet.sum())
        if zero_is_land:
            notes.append(
                f"points at exactly 0 in every frame ({100 * zero.sum() / wet.sum():.0f} %) taken as land"
            )
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
    notes.append(
        f"only the first {most} of {len(times)} frames are read (512 MiB); give start_time and duration_s"
    )
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
        part.read(frames_about(part, times), sampler.rows, sampler.columns)
        for part, sampler in ((u, at_u), (v, at_v))
    ]
    if zero_is_land:
        for values, sampler in zip(stored, (at_u, at_v), strict=True):
            still = np.all(np.nan_to_num(values) == 0, axis=0)
            for part in (u, v):  # both must rest, at the same point of the file and in other frames too
                frames = np.union1d(_witnesses(part, times)[0], frames_about(part, times))
                still &= np.all(np.nan_to_num(part.read(frames, sampler.rows, sampler.columns)) == 0, axis=0)
            values[:, still] = np.nan
    stored = [in_time(values, part, times, notes) for values, part in zip(stored, (u, v), strict=True)]
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

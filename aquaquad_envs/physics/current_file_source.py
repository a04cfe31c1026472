"""Reads a file of ocean currents as it is stored: opening, unpacking, axes, horizontal grids, dates."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquaquad_envs.errors import CurrentFileError
from aquaquad_envs.physics.current_file_naming import (
    Located,
    describe,
    dimension_kind,
    find_mask,
    find_time,
    is_latitude,
    is_longitude,
    speed_unit,
)

if TYPE_CHECKING:
    import xarray

#: No ocean current is as fast as this, m/s: a faster value is a fill value that nobody declared.
FASTEST_M_S = 20.0
#: Values in common use for "missing"; believed only where they also stand apart from all others.
_SENTINELS = [sign * value for value in (9.99, 9.999, 99.0, 99.9, 99.99, 999.0, 999.9, 999.99, 9999.0, 9999.9,
              30000.0, 32766.0, 32767.0, 32768.0, 99999.0, 127.0, 128.0, 255.0, 65535.0, 2147483647.0,
              2147483648.0) for sign in (-1.0, 1.0)]  # fmt: skip
_CHUNK_VALUES = 8_000_000


@contextlib.contextmanager
def open_files(paths: Sequence[Path]) -> Iterator[list[xarray.Dataset]]:
    """Open NetCDF files undecoded (packed values, raw times); close them at the end."""
    try:
        import cftime  # noqa: F401
        import xarray
    except ImportError as error:
        raise CurrentFileError(
            f"reading currents from NetCDF needs {error.name}: pip install 'aquaquad-envs[files]'"
        ) from error
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(_open(xarray, path)) for path in paths]


def _open(xarray_module: Any, path: Path) -> xarray.Dataset:
    if not path.exists():
        raise CurrentFileError(f"there is no file {str(path)!r}. Give the path of a NetCDF file.")
    if not path.is_file():
        raise CurrentFileError(f"{str(path)!r} is not a file. Give the path of a NetCDF file.")
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise CurrentFileError(f"{path.name!r} cannot be read: {error}") from error
    if head[:4] in (b"CDF\x01", b"CDF\x02"):
        engines = ["netCDF4", "scipy"]
    elif head[:4] == b"CDF\x05":
        engines = ["netCDF4"]
    elif head[:8] == b"\x89HDF\r\n\x1a\n":
        engines = ["netCDF4", "h5netcdf"]
    else:
        kind = {b"\x1f\x8b": "it is compressed with gzip; unpack it first", b"PK": "it is a zip archive; unpack it first",
                b"GR": "it looks like GRIB; convert it to NetCDF first", b"<!": "it looks like a web page",
                b"": "it is empty"}.get(head[:2], f"it begins with {head[:8]!r}")  # fmt: skip
        raise CurrentFileError(f"{path.name!r} is not a NetCDF file: {kind}.")
    engines = [engine for engine in engines if importlib.util.find_spec(engine)]
    if not engines:
        raise CurrentFileError(f"reading {path.name!r} needs netCDF4: pip install 'aquaquad-envs[files]'")
    failures = []
    for engine in engines:
        try:
            return xarray_module.open_dataset(path, engine=engine.lower(), decode_cf=False, cache=False)
        except Exception as error:
            failures.append(f"{engine}: {type(error).__name__}: {error}")
    raise CurrentFileError(f"{path.name!r} cannot be read as NetCDF; it may be truncated ({'; '.join(failures)}).")


def read_values(variable: xarray.Variable, what: str, **index: Any) -> np.ndarray:
    """The stored values of a part of a variable; a file that breaks off half-way is refused by name."""
    try:
        return np.asarray(variable.isel(index).values)
    except Exception as error:
        raise CurrentFileError(
            f"{what!r} cannot be read; the file may be truncated or damaged ({type(error).__name__}: {error})."
        ) from error


def unpack(raw: np.ndarray, attrs: dict[str, Any], also_missing: Sequence[float] = ()) -> np.ndarray:
    """Stored values as float64 with NaN for missing, by fill value, scale and offset."""
    if str(attrs.get("_Unsigned", "")).lower() == "true" and raw.dtype.kind == "i":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    values = raw.astype(np.float64)
    missing = ~np.isfinite(values)
    for declared in (attrs.get("_FillValue"), attrs.get("missing_value"), list(also_missing)):
        for fill in np.ravel(declared) if declared is not None else ():
            number = _number(fill)
            if np.isfinite(number):
                # Compared in the stored precision: a float32 fill is often declared as a double.
                missing |= values == (float(np.float32(number)) if raw.dtype == np.float32 else number)
    values = values * _number(attrs.get("scale_factor", 1.0), 1.0) + _number(attrs.get("add_offset", 0.0), 0.0)
    values[missing] = np.nan
    return values


def _number(value: Any, otherwise: float = np.nan) -> float:
    try:
        return float(np.ravel(value)[0])
    except (TypeError, ValueError, IndexError):
        return otherwise


@dataclass(eq=False)
class HorizontalGrid:
    """Where the points of a component lie, degrees: axes (1-D, rows and columns) or a field (2-D)."""

    latitude: np.ndarray
    longitude: np.ndarray

    @property
    def regular(self) -> bool:
        """Whether rows are of one latitude and columns of one longitude."""
        return self.latitude.ndim == 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return (len(self.latitude), len(self.longitude)) if self.regular else self.latitude.shape  # type: ignore[return-value]

    def fields(self, stride: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Latitude and longitude of every point (or every ``stride``-th), each (rows, columns)."""
        if not self.regular:
            return self.latitude[::stride, ::stride], self.longitude[::stride, ::stride]
        latitude, longitude = self.latitude[::stride], self.longitude[::stride]
        return (
            np.broadcast_to(latitude[:, None], (len(latitude), len(longitude))),
            np.broadcast_to(longitude[None, :], (len(latitude), len(longitude))),
        )

    def same_as(self, other: HorizontalGrid) -> bool:
        """Whether two grids have the same points."""
        return self is other or (
            self.latitude.shape == other.latitude.shape
            and self.longitude.shape == other.longitude.shape
            and np.allclose(self.latitude, other.latitude, rtol=0, atol=1e-5, equal_nan=True)
            and np.allclose(self.longitude, other.longitude, rtol=0, atol=1e-5, equal_nan=True)
        )


@dataclass(eq=False)
class Component:
    """One component of the current with its axes; values are read on demand."""

    source: Located
    rows: str
    columns: str
    time: str | None
    fixed: dict[str, int]
    grid: HorizontalGrid | None
    unit_m_s: float
    seconds: np.ndarray | None = None  # of each sorted frame
    order: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=np.int64))  # frame -> index in file
    also_missing: list[float] = field(default_factory=list)
    staggered: tuple[str, int, int] | None = None  # axis ("rows", "columns") and offsets of the two averaged
    water: np.ndarray | None = None  # False where the file's own mask says land
    discarded: float = 0.0  # largest |value| thrown away as too fast to be a current

    @property
    def stored_shape(self) -> tuple[int, int]:
        """Rows and columns of the stored points (before staggered ones are averaged)."""
        sizes = self.source.variable.sizes
        return sizes[self.rows], sizes[self.columns]

    def stored(self, frames: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Values as stored at rows × columns of some frames, all as indices in the file, in any order."""
        index: dict[str, Any] = dict(self.fixed)
        low = int(frames.min())
        if self.time is not None:
            index[self.time] = slice(low, int(frames.max()) + 1)
        variable, wide = self.source.variable, []
        row_slice = slice(int(rows.min()), int(rows.max()) + 1)
        index[self.rows] = row_slice
        kept = [d for d in variable.dims if d in (self.time, self.rows, self.columns)]
        wanted = [d for d in (self.time, self.rows, self.columns) if d is not None]
        for run in _runs(columns):
            index[self.columns] = slice(*run)
            part = read_values(variable, self.source.name, **index).transpose([kept.index(d) for d in wanted])
            wide.append(part if self.time is not None else part[None])
        present = np.concatenate([np.arange(*run) for run in _runs(columns)])
        found = np.searchsorted(present, columns)
        return np.concatenate(wide, axis=2)[np.ix_(frames - low, rows - row_slice.start, found)]

    def _values(self, frames: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Velocity, m/s, at stored points; rows and columns outside the file are NaN."""
        height, width = self.stored_shape
        row_in, column_in = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
        out = np.full((len(frames), len(rows), len(columns)), np.nan)
        if not (row_in.any() and column_in.any()):
            return out
        raw = self.stored(frames, rows[row_in], columns[column_in])
        values = unpack(raw, dict(self.source.variable.attrs), self.also_missing) * self.unit_m_s
        if self.water is not None:
            values[:, ~self.water[np.ix_(rows[row_in], columns[column_in])]] = np.nan
        fast = np.abs(values) > FASTEST_M_S
        if fast.any():
            self.discarded = max(self.discarded, float(np.max(np.abs(values[fast]))))
            values[fast] = np.nan
        out[np.ix_(np.ones(len(frames), dtype=bool), row_in, column_in)] = values
        return out

    def read(self, frames: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Velocity, m/s, shape (frames, rows, columns) of the grid, of sorted frames; NaN where missing."""
        batch = max(1, _CHUNK_VALUES // (len(rows) * len(columns)))
        return np.concatenate(
            [self._read_batch(self.order[frames[i : i + batch]], rows, columns) for i in range(0, len(frames), batch)]
        )

    def _read_batch(self, frames: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        if self.staggered is None:
            return self._values(frames, rows, columns)
        axis, first, second = self.staggered
        a, b = (
            self._values(frames, rows + shift, columns) if axis == "rows"
            else self._values(frames, rows, columns + shift)
            for shift in (first, second)
        )  # fmt: skip
        # Beside land one of the two faces is missing: the other stands alone, not halved.
        return np.where(np.isnan(a), b, np.where(np.isnan(b), a, (a + b) / 2))


def _runs(indices: np.ndarray) -> list[tuple[int, int]]:
    """Half-open runs that cover the indices: a box over the seam of longitude is two short ones."""
    present = np.unique(indices)
    parts = np.split(present, np.flatnonzero(np.diff(present) > 64) + 1)
    return [(int(part[0]), int(part[-1]) + 1) for part in parts]


def find_component(located: Located, datasets: Sequence[xarray.Dataset], notes: list[str]) -> Component:
    """Tell the axes of a velocity component apart and find its grid (``grid=None``: has none of its own)."""
    dataset, variable = located.dataset, located.variable
    kinds = {str(d): dimension_kind(dataset, str(d)) for d in variable.dims}
    lone, places = _find_places(located, datasets, [d for d in kinds if kinds[d] == ""])
    horizontal = [d for d in kinds if kinds[d] == ""]
    if len(horizontal) > 2:
        used = set(places) if places else set()
        horizontal = [d for d in horizontal if d in used or variable.sizes[d] > 1]
    sizes = {str(d): int(n) for d, n in variable.sizes.items()}
    if lone or len(horizontal) < 2:
        where = lone or (horizontal[0] if horizontal else "none")
        raise CurrentFileError(
            f"{located.name!r} has one horizontal dimension ({where!r}; all: {sizes}): an unstructured mesh, a section "
            "or a station, which cannot be read. Interpolate it to a regular latitude/longitude grid first."
        )
    if len(horizontal) > 2:
        raise CurrentFileError(
            f"{located.name!r} has dimensions {sizes}, of which {horizontal} are not understood: two horizontal "
            "ones are needed. Select one slice along the others, or name them as usual (time, depth, ...)."
        )
    rows, columns = (places[0], places[1]) if places else _in_order(horizontal)
    if rows not in horizontal or columns not in horizontal:
        rows, columns = _in_order(horizontal)
    fixed: dict[str, int] = {}
    times = [d for d in kinds if kinds[d] == "time"]
    long_times = [d for d in times if sizes[d] > 1]
    if len(long_times) > 1:
        raise CurrentFileError(
            f"{located.name!r} has more than one time dimension ({', '.join(long_times)}; all: {sizes}). "
            "Select one forecast, so that one time dimension is left."
        )
    time = (long_times or [d for d in times if d in dataset.variables] or times or [None])[0]
    for d in kinds:
        if d in (rows, columns, time):
            continue
        fixed[d] = _surface(dataset, d, sizes[d], notes) if kinds[d] == "depth" else 0
        if kinds[d] == "member" and sizes[d] > 1:
            notes.append(f"the first of {sizes[d]} along {d!r} is used")
    if min(sizes[rows], sizes[columns]) < 2:
        raise CurrentFileError(
            f"{located.name!r} has {sizes[rows]} × {sizes[columns]} points; at least 2 × 2 are needed."
        )
    unit, note = speed_unit(located)
    notes += [note] if note else []
    grid = _read_grid(located, places[2], places[3], rows, columns) if places else None
    component = Component(located, rows, columns, time, fixed, grid, unit)
    mask = find_mask([dataset], component.stored_shape, _mask_names(located.name, component))
    if mask is not None:
        stored = unpack(read_values(mask.variable, mask.name), dict(mask.variable.attrs))
        land_is_one = mask.text("standard_name") == "land_binary_mask"
        component.water = (stored == 0) if land_is_one else (stored > 0.5)
    return component


def _mask_names(name: str, component: Component) -> tuple[str, ...]:
    text = f"{component.rows} {component.columns}".lower()
    if "_u" in text:
        return ("mask_u",)
    if "_v" in text:
        return ("mask_v",)
    return ("mask_rho",)


def _in_order(dimensions: Sequence[str]) -> tuple[str, str]:
    """Rows and columns of two dimensions without coordinates: as they stand unless named the other way."""
    first, second = dimensions
    across = ("x", "i", "lon")
    down = ("y", "j", "lat", "eta")
    if first.lower().startswith(across) and second.lower().startswith(down):
        return second, first
    return first, second


def _surface(dataset: xarray.Dataset, dimension: str, size: int, notes: list[str]) -> int:
    """Index of the level nearest the surface, whichever way the axis runs and whatever its sign."""
    if size == 1:
        return 0
    levels = [
        Located(dataset, str(name))
        for name, variable in dataset.variables.items()
        if variable.dims == (dimension,) and variable.dtype.kind in "iuf"
    ]
    levels.sort(key=lambda level: (level.name != dimension, not level.text("positive"), level.text("axis") != "z"))
    if levels:
        level = levels[0]
        values = unpack(read_values(level.variable, level.name), dict(level.variable.attrs))
        if np.isfinite(values).any():
            above_bottom = "above_sea_floor" in level.text("standard_name") or (
                level.text("positive") == "up" and np.nanmin(values) >= 0 and np.nanmax(values) > 0
            )
            index = int(np.nanargmax(values) if above_bottom else np.nanargmin(np.abs(values)))
            notes.append(f"surface level {level.name} = {values[index]:g} of {size} is used")
            return index
    # Without values only terrain-following axes are known to count from the bottom.
    index = size - 1 if dimension.lower() in ("s_rho", "s_w", "n", "sc_r") else 0
    notes.append(f"{dimension!r} has no values; its {'last' if index else 'first'} of {size} levels taken as surface")
    return index


def _find_places(
    located: Located, datasets: Sequence[xarray.Dataset], dims: list[str]
) -> tuple[str, tuple[str, str, Located, Located] | None]:
    """Latitude and longitude of a component: ("", (rows, columns, latitude, longitude)), or the one shared dimension."""
    own = located.dataset
    mentioned = str(located.variable.attrs.get("coordinates", "")).split()
    everything = [Located(own, str(name)) for name in own.variables]
    tiers = [
        [one for one in everything if one.name in mentioned],
        [one for one in everything if one.name not in mentioned],
    ]
    tiers += [[Located(other, str(name)) for name in other.variables] for other in datasets if other is not own]
    shared = ""
    for tier in tiers:
        latitudes = [one for one in tier if is_latitude(one)]
        longitudes = [one for one in tier if is_longitude(one)]
        pairs = [(a, b) for a in latitudes for b in longitudes if _match(a, b, dims) == "pair"]
        if pairs:
            suffix = located.name.lower()[-2:]
            a, b = min(
                pairs,
                key=lambda pair: (
                    -len(_squeezed(pair[0])), _swap(pair[0].name) != pair[1].name.lower(),
                    not pair[0].name.lower().endswith(suffix), pair[0].text("standard_name") != "latitude",
                ),
            )  # fmt: skip
            flat = _squeezed(a)
            rows, columns = (flat[0], flat[1]) if len(flat) == 2 else (flat[0], _squeezed(b)[0])
            return "", (rows, columns, a, b)
        shared = shared or next(
            (_squeezed(a)[0] for a in latitudes for b in longitudes if _match(a, b, dims) == "shared"), ""
        )
    return shared, None


def _swap(latitude_name: str) -> str:
    low = latitude_name.lower()
    return low.replace("lat", "lon").replace("gphi", "glam")


def _squeezed(located: Located) -> list[str]:
    """Horizontal dimensions of a coordinate: without time and axes of length one."""
    return [
        str(d)
        for d, size in located.variable.sizes.items()
        if (size > 1 or located.variable.ndim == 1) and dimension_kind(located.dataset, str(d)) != "time"
    ]


def _match(latitude: Located, longitude: Located, dims: list[str]) -> str:
    a, b = _squeezed(latitude), _squeezed(longitude)
    if not a or not b or not set(a + b) <= set(dims):
        return ""
    if len(a) == len(b) == 1:
        return "pair" if a != b else "shared"
    return "pair" if len(a) == 2 and set(a) == set(b) else ""


def _read_grid(located: Located, latitude: Located, longitude: Located, rows: str, columns: str) -> HorizontalGrid:
    fields = []
    for place in (latitude, longitude):
        first = {d: 0 for d in place.variable.dims if d not in (rows, columns)}
        values = unpack(read_values(place.variable, place.name, **first), dict(place.variable.attrs))
        if [d for d in place.variable.dims if d in (rows, columns)] == [columns, rows]:
            values = values.T
        if "rad" in place.text("units"):
            values = np.degrees(values)
        fields.append(values)
    return make_grid(fields[0], fields[1], f"{latitude.name}, {longitude.name}")


def make_grid(latitude: np.ndarray, longitude: np.ndarray, names: str) -> HorizontalGrid:
    """A grid of checked positions; a two-dimensional one that is in truth regular becomes axes."""
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(latitude) <= 90.01)
        bad_longitude = ~(np.abs(longitude) <= 720.0)
    if latitude.ndim == 1:
        if bad.any() or bad_longitude.any():
            raise CurrentFileError(
                f"latitude and longitude ({names}) run over {np.nanmin(latitude):g}..{np.nanmax(latitude):g} and "
                f"{np.nanmin(longitude):g}..{np.nanmax(longitude):g}, which are not degrees."
            )
        return HorizontalGrid(latitude, longitude)
    # Where a model drops land the positions are often filled with one value over and over.
    hole = bad | bad_longitude
    origin = (latitude == 0) & (longitude == 0)
    hole |= origin if np.count_nonzero(origin) > 1 else False
    if hole.all():
        raise CurrentFileError(f"no valid position in latitude and longitude ({names}).")
    latitude, longitude = np.where(hole, np.nan, latitude), np.where(hole, np.nan, longitude)
    if not hole.any() and np.ptp(latitude, axis=1).max() < 1e-6 and np.ptp(longitude, axis=0).max() < 1e-6:
        return HorizontalGrid(latitude[:, 0], longitude[0])
    return HorizontalGrid(latitude, longitude)


def find_grid_of_shape(datasets: Sequence[xarray.Dataset], shape: tuple[int, int]) -> HorizontalGrid | None:
    """A grid anywhere in the files with so many rows and columns (rho points of a staggered grid)."""
    for dataset in datasets:
        everything = [Located(dataset, str(name)) for name in dataset.variables]
        latitudes = [one for one in everything if is_latitude(one)]
        longitudes = [one for one in everything if is_longitude(one)]
        for a in sorted(latitudes, key=lambda one: "rho" not in one.name.lower()):
            for b in sorted(longitudes, key=lambda one, a=a: _swap(a.name) != one.name.lower()):
                flat_a, flat_b = _squeezed(a), _squeezed(b)
                sizes_a = tuple(a.variable.sizes[d] for d in flat_a)
                sizes_b = tuple(b.variable.sizes[d] for d in flat_b)
                if sizes_a == shape == sizes_b and flat_a == flat_b:
                    return _read_grid(a, a, b, flat_a[0], flat_a[1])
                if sizes_a == shape[:1] and sizes_b == shape[1:] and flat_a != flat_b:
                    return _read_grid(a, a, b, flat_a[0], flat_b[0])
    return None


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

    units, calendar = str(located.variable.attrs.get("units", "")).strip(), located.text("calendar") or "standard"
    raw = read_values(located.variable, located.name)
    epoch = "seconds since 1970-01-01 00:00:00"
    try:
        if raw.dtype.kind in "SUO":
            if raw.dtype.kind == "S" and raw.dtype.itemsize == 1 and raw.ndim:
                raw = np.array([b"".join(row) for row in raw.reshape(-1, raw.shape[-1])])
            texts = [x.decode() if isinstance(x, bytes) else str(x) for x in np.ravel(raw)]
            dates = [parse_date(text.replace("_", "T"), calendar) for text in texts]
            return np.array(cftime.date2num(dates, epoch, calendar=calendar), dtype=np.float64), calendar
        if " since " not in units:
            raise ValueError("no 'units' of the form 'hours since 2000-01-01'")
        values = unpack(np.atleast_1d(raw), dict(located.variable.attrs))
        good = np.abs(values) < 1e30  # netCDF's default fill is 9.97e36
        seconds = np.full(values.shape, np.nan)
        if good.any():
            dates = cftime.num2date(values[good], units, calendar=calendar, only_use_cftime_datetimes=True)
            # The dates, not the numbers, are what the two files of a pair have in common.
            seconds[good] = np.array(cftime.date2num(dates, epoch, calendar=calendar), dtype=np.float64)
        return seconds, calendar
    except Exception as error:
        shown = np.ravel(raw)[:3].tolist()
        raise CurrentFileError(
            f"time {located.name!r} does not parse: units {units!r}, calendar {calendar!r}, first values {shown} "
            f"({type(error).__name__}: {error}). Give it CF units such as 'hours since 2000-01-01 00:00:00'."
        ) from error


def parse_date(text: str, calendar: str) -> Any:
    """An ISO date such as '2024-01-31' or '2024-01-31T06:00:00Z' as a cftime date of ``calendar``."""
    import datetime
    import re

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


def find_undeclared_fill(component: Component, raw: np.ndarray) -> list[float]:
    """Stored values that are a common sentinel, occur often, and stand apart from all others."""
    values = raw[np.isfinite(unpack(raw, dict(component.source.variable.attrs)))].astype(np.float64)
    sentinels = list(_SENTINELS)
    if raw.dtype.kind in "iu":
        limits = np.iinfo(raw.dtype)
        sentinels += [float(limits.min), float(limits.min + 1), float(limits.max), float(limits.max - 1)]
    attrs = {k: v for k, v in component.source.variable.attrs.items() if k in ("scale_factor", "add_offset")}
    found: list[float] = []
    for _ in range(3):
        for extreme in (np.min, np.max):
            if values.size == 0:
                return found
            value = float(extreme(values))
            rest = values[values != value]
            if rest.size == 0 or values.size - rest.size < max(2, values.size // 1000):
                continue
            gap = np.abs(rest - value).min()
            speed = abs(float(unpack(np.array([value]), attrs)[0])) * component.unit_m_s
            if np.isclose(value, sentinels, rtol=1e-6).any() and gap > np.ptp(rest) and speed > 0.9:
                found.append(value)
                values = rest
    return found

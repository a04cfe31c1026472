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
        kind = {b"\x1f\x8b": "it is compressed with gzip; unpack it first",
                b"PK": "it is a zip archive; unpack it first",
                b"GR": "it looks like GRIB; convert it to NetCDF first", b"<!": "it looks like a web page",
                b"": "it is empty"}.get(head[:2], f"it begins with {head[:8]!r}")  # fmt: skip
        raise CurrentFileError(f"{path.name!r} is not a NetCDF file: {kind}.")
    engines = [engine for engine in engines if importlib.util.find_spec(engine)]
    if not engines:
        raise CurrentFileError(f"reading {path.name!r} needs netCDF4: pip install 'aquaquad-envs[files]'")
    if head[:4] in (b"CDF\x01", b"CDF\x02"):
        _check_whole(path)
    try:
        dataset = xarray_module.open_dataset(path, engine=engines[0].lower(), decode_cf=False, cache=False)
    except Exception as error:
        why = f"{engines[0]}: {type(error).__name__}: {error}"
        raise CurrentFileError(
            f"{path.name!r} cannot be read as NetCDF; it may be truncated ({why})."
        ) from error
    stored = sum(variable.size * variable.dtype.itemsize for variable in dataset.variables.values())
    if head[:4] == b"CDF\x05" and stored > path.stat().st_size:
        dataset.close()
        raise CurrentFileError(f"{path.name!r} is truncated: it holds less than its {stored} bytes of data.")
    return dataset


def _check_whole(path: Path) -> None:
    """Refuse a truncated classic file: the netCDF library itself reads zeros past its end."""
    from scipy.io import netcdf_file

    try:
        netcdf_file(path, "r", mmap=True).close()
    except Exception as error:
        raise CurrentFileError(
            f"{path.name!r} cannot be read as NetCDF; it may be truncated ({error})."
        ) from error


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
    values = values * _number(attrs.get("scale_factor", 1.0), 1.0) + _number(
        attrs.get("add_offset", 0.0), 0.0
    )
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
        return (len(self.latitude), len(self.longitude)) if self.regular else self.latitude.shape

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
            [
                self._read_batch(self.order[frames[i : i + batch]], rows, columns)
                for i in range(0, len(frames), batch)
            ]
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

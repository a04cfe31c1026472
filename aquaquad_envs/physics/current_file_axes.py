"""Tells the axes of the velocity components apart, and where their points lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from aquaquad_envs.errors import CurrentFileError
from aquaquad_envs.physics.current_file_naming import (
    Located,
    VelocityPair,
    dimension_kind,
    find_angle,
    find_mask,
    is_latitude,
    is_longitude,
    speed_unit,
)
from aquaquad_envs.physics.current_file_sampling import spacings
from aquaquad_envs.physics.current_file_source import Component, HorizontalGrid, read_values, unpack

if TYPE_CHECKING:
    import xarray


def find_component(located: Located, datasets: Sequence[xarray.Dataset], notes: list[str]) -> Component:
    """Tell the axes of a velocity component apart and find its grid (``grid=None``: has none of its own)."""
    dataset, variable = located.dataset, located.variable
    kinds = {str(d): dimension_kind(dataset, str(d)) for d in variable.dims}
    lone, places = _find_places(located, datasets, [d for d in kinds if kinds[d] == ""])
    horizontal = [d for d in kinds if kinds[d] == ""]
    if len(horizontal) > 2:
        used = set(places[:2]) if places else set()
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
    time = next(iter(long_times or [d for d in times if d in dataset.variables] or times), None)
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
    levels.sort(
        key=lambda level: (level.name != dimension, not level.text("positive"), level.text("axis") != "z")
    )
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
    notes.append(
        f"{dimension!r} has no values; its {'last' if index else 'first'} of {size} levels taken as surface"
    )
    return index


def _find_places(
    located: Located, datasets: Sequence[xarray.Dataset], dims: list[str]
) -> tuple[str, tuple[str, str, Located, Located] | None]:
    """Position of a component: ("", (rows, columns, latitude, longitude)), or (the one shared dimension, None)."""
    own = located.dataset
    mentioned = str(located.variable.attrs.get("coordinates", "")).split()
    everything = [Located(own, str(name)) for name in own.variables]
    tiers = [
        [one for one in everything if one.name in mentioned],
        [one for one in everything if one.name not in mentioned],
    ]
    tiers += [
        [Located(other, str(name)) for name in other.variables] for other in datasets if other is not own
    ]
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


def _read_grid(
    located: Located, latitude: Located, longitude: Located, rows: str, columns: str
) -> HorizontalGrid:
    fields = []
    for place in (latitude, longitude):
        first = {str(d): 0 for d in place.variable.dims if d not in (rows, columns)}
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
    spots = np.where(hole, np.nan, longitude + 1j * latitude)
    _, group, counts = np.unique(spots, return_inverse=True, return_counts=True, equal_nan=True)
    hole |= counts[np.reshape(group, hole.shape)] > 4
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
            wanted = _swap(a.name)
            for b in sorted(longitudes, key=lambda one: one.name.lower() != wanted):
                flat_a, flat_b = _squeezed(a), _squeezed(b)
                sizes_a = tuple(a.variable.sizes[d] for d in flat_a)
                sizes_b = tuple(b.variable.sizes[d] for d in flat_b)
                if sizes_a == shape == sizes_b and flat_a == flat_b:
                    return _read_grid(a, a, b, flat_a[0], flat_a[1])
                if sizes_a == shape[:1] and sizes_b == shape[1:] and flat_a != flat_b:
                    return _read_grid(a, a, b, flat_a[0], flat_b[0])
    return None


def put_on_grids(
    u: Component, v: Component, datasets: list[xarray.Dataset], notes: list[str]
) -> np.ndarray | None:
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


def grid_angle(
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

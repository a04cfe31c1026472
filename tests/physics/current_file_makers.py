"""Small NetCDF files of known currents for the tests of the reader."""

from __future__ import annotations

import pathlib

import netCDF4
import numpy as np

from aquaquad_envs.physics.current_files import FileCurrents, load_current_file

SHARED = pathlib.Path(__file__).parents[2].parent / "shared" / "data" / "currents"
METRES_PER_DEGREE = np.pi / 180 * 6_371_008.8
CENTER = (40.0, -30.0)
OMEGA = 1e-5  # rad/s of the solid-body rotation


def local(latitude, longitude, center=CENTER):
    """Metres about ``center``, written out here once more as an independent check."""
    east = (longitude - center[1] + 540.0) % 360.0 - 180.0
    return (
        METRES_PER_DEGREE * np.cos(np.radians(center[0])) * east,
        METRES_PER_DEGREE * (latitude - center[0]),
    )


def axes(center=CENTER, n=15, step=0.05):
    offsets = step * (np.arange(n) - n // 2)
    return center[0] + offsets, center[1] + offsets


def rotation(latitude, longitude, center=CENTER):
    x, y = local(latitude, longitude, center)
    return -OMEGA * y, OMEGA * x


def expected_rotation(field):
    x, y = field.grid.nodes(*field.velocity.shape[1:3])
    return np.stack([-OMEGA * y, OMEGA * x], axis=-1)


def write(path, variables, *, format="NETCDF4", attrs=None):
    """Write ``{name: (dims, values, attributes)}``; ``_FillValue`` goes where netCDF wants it."""
    with netCDF4.Dataset(path, "w", format=format) as file:
        for name, value in (attrs or {}).items():
            file.setncattr(name, value)
        for name, (dims, values, attributes) in variables.items():
            values = np.asarray(values)
            for dim, size in zip(dims, values.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, size)
            attributes = dict(attributes)
            fill = attributes.pop("_FillValue", None)
            variable = file.createVariable(name, values.dtype, dims, fill_value=fill)
            variable.set_auto_maskandscale(False)
            variable.setncatts(attributes)
            variable[...] = values
    return path


def small(path, u, v, *, lat=None, lon=None, dims=("lat", "lon"), names=("u", "v"), attrs=None, more=None):
    """One field without time: ``lat`` and ``lon`` as axes (default) or, if two-dimensional, as fields."""
    if lat is None:
        lat, lon = axes()
    first, second = (dims, dims) if np.ndim(lat) == 2 else (("lat",), ("lon",))
    u_attrs, v_attrs = attrs if isinstance(attrs, tuple) else (attrs or {},) * 2
    variables = {"lat": (first, lat, {}), "lon": (second, lon, {}), **(more or {})}
    variables |= {names[0]: (dims, u, u_attrs), names[1]: (dims, v, v_attrs)}
    return write(path, variables)


def plain(path, u=None, v=None, *, center=CENTER, names=("uo", "vo"), units="m s-1", time=(0.0,), **options):
    """A regular file (time, lat, lon) with the rotation about ``center`` unless u and v are given."""
    latitude, longitude = axes(center)
    if u is None:
        u, v = rotation(*np.meshgrid(latitude, longitude, indexing="ij"), center)
    u, v = (np.broadcast_to(a, (len(time), *np.shape(a)[-2:])) for a in (u, v))
    attributes = {"units": units} if units is not None else {}
    attributes.update(options.pop("velocity_attrs", {}))
    time_attrs = {"units": "hours since 2024-01-01 00:00:00", "standard_name": "time"}
    time_attrs.update(options.pop("time_attrs", {}))
    return write(
        path,
        {
            "time": (("time",), np.asarray(time), time_attrs),
            "lat": (("lat",), latitude, {"units": "degrees_north"}),
            "lon": (("lon",), longitude, {"units": "degrees_east"}),
            names[0]: (("time", "lat", "lon"), u, attributes),
            names[1]: (("time", "lat", "lon"), v, attributes),
        },
        **options,
    )


def load(path, **options) -> FileCurrents:
    return load_current_file(path, **{"center": CENTER, "half_width_m": 10_000.0, **options})


def constant(u, v, center=CENTER):
    latitude, longitude = axes(center)
    shape = (len(latitude), len(longitude))
    return np.full(shape, float(u)), np.full(shape, float(v))


STANDARD_PAIRS = [
    ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    ("barotropic_eastward_sea_water_velocity", "barotropic_northward_sea_water_velocity"),
    ("sea_water_x_velocity", "sea_water_y_velocity"),
    ("sea_water_surface_x_velocity", "sea_water_surface_y_velocity"),
    ("surface_geostrophic_eastward_sea_water_velocity", "surface_geostrophic_northward_sea_water_velocity"),
]


def curved(angle=0.3, n=31, step=2000.0, center=CENTER):
    """Positions of a square grid turned by ``angle`` about ``center``: (latitude, longitude) (n, n)."""
    j, i = np.meshgrid(np.arange(n) - (n - 1) / 2, np.arange(n) - (n - 1) / 2, indexing="ij")
    x = step * (i * np.cos(angle) - j * np.sin(angle))
    y = step * (i * np.sin(angle) + j * np.cos(angle))
    return center[0] + y / METRES_PER_DEGREE, center[1] + x / METRES_PER_DEGREE / np.cos(
        np.radians(center[0])
    )


def roms(
    path,
    angle=0.3,
    *,
    land_from=None,
    names=("u", "v"),
    inner=True,
    angle_units="radians",
    mask=True,
    own_places=True,
):
    """A staggered file: the rotation about the centre, as components along a grid turned by ``angle``."""
    lat, lon = curved(angle)
    n = len(lat)

    def between(a, axis):
        if inner:
            return (np.take(a, range(1, n), axis) + np.take(a, range(n - 1), axis)) / 2
        first, last = (2 * np.take(a, [i], axis) - np.take(a, [k], axis) for i, k in ((0, 1), (n - 1, n - 2)))
        wide = np.concatenate([first, a, last], axis)
        return (np.take(wide, range(1, n + 2), axis) + np.take(wide, range(n + 1), axis)) / 2

    east_u, north_u = rotation(between(lat, 1), between(lon, 1))
    east_v, north_v = rotation(between(lat, 0), between(lon, 0))
    u = east_u * np.cos(angle) + north_u * np.sin(angle)
    v = -east_v * np.sin(angle) + north_v * np.cos(angle)
    stored_angle = np.degrees(angle) if angle_units == "degrees" else angle
    mask_rho = np.ones_like(lat)
    if land_from is not None:
        mask_rho[:, land_from:] = 0
        u[:, land_from - 1 :] = 1e37  # every face that touches land
        v[:, land_from:] = 1e37
    time = {"time": "ocean_time", "units": "meter second-1", "_FillValue": 1e37}
    variables = {
        "ocean_time": (("ocean_time",), np.array([0.0, 3600.0]), {"units": "seconds since 2016-01-01"}),
        "s_rho": (("s_rho",), np.array([-0.9, -0.1]), {}),
        "lat_rho": (("eta_rho", "xi_rho"), lat, {}), "lon_rho": (("eta_rho", "xi_rho"), lon, {}),
        "angle": (("eta_rho", "xi_rho"), np.full_like(lat, stored_angle), {"units": angle_units}),
    }  # fmt: skip
    if mask:
        variables["mask_rho"] = (("eta_rho", "xi_rho"), mask_rho, {})
    if own_places:
        for letter, axis in (("u", 1), ("v", 0)):
            dims = (f"eta_{letter}", f"xi_{letter}")
            variables[f"lat_{letter}"] = (dims, between(lat, axis), {})
            variables[f"lon_{letter}"] = (dims, between(lon, axis), {})
    for name, values, letter in ((names[0], u, "u"), (names[1], v, "v")):
        stacked = np.stack([np.stack([np.where(values > 1e30, values, 0.1 * values), values])] * 2)
        places = {"coordinates": f"lon_{letter} lat_{letter} s_rho ocean_time"} if own_places else {}
        variables[name] = (
            ("ocean_time", "s_rho", f"eta_{letter}", f"xi_{letter}"),
            stacked,
            {**time, **places},
        )
    return write(path, variables)

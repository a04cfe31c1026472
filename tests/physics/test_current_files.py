"""Real currents from NetCDF: every trap as a small synthetic file, numbers checked, and the real files."""

from __future__ import annotations

import pathlib
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

netCDF4 = pytest.importorskip("netCDF4")
pytest.importorskip("xarray")

from aquaquad_envs.errors import AquaQuadError, CurrentFileError, InvalidParameterError  # noqa: E402
from aquaquad_envs.physics.current_file_naming import parse_speed_unit  # noqa: E402
from aquaquad_envs.physics.current_files import FileCurrents, load_current_file  # noqa: E402

pytestmark = pytest.mark.filterwarnings("error")

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


@pytest.fixture
def file(tmp_path):
    return tmp_path / "currents.nc"


def constant(u, v, center=CENTER):
    latitude, longitude = axes(center)
    shape = (len(latitude), len(longitude))
    return np.full(shape, float(u)), np.full(shape, float(v))


# --- numbers ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "format", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4", "NETCDF4_CLASSIC"]
)
def test_solid_body_rotation_is_exact_in_metres_from_every_format(file, format):
    result = load(plain(file, format=format))
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9
    assert not result.land.any()
    assert result.center == CENTER
    assert result.start_time == "2024-01-01T00:00:00"
    assert result.field.time0_s == 0.0
    x, y = 3100.0, -4700.0
    np.testing.assert_allclose(result.field.sample(x, y), [-OMEGA * y, OMEGA * x], atol=1e-9)


@pytest.mark.parametrize("engine", ["scipy", "h5netcdf"])
def test_other_engines_serve_where_netcdf4_is_not_installed(file, engine, monkeypatch):
    from aquaquad_envs.physics import current_file_source

    if engine == "h5netcdf":
        pytest.importorskip("h5netcdf")
    plain(file, format="NETCDF4" if engine == "h5netcdf" else "NETCDF3_64BIT_OFFSET")
    original = current_file_source.importlib.util.find_spec
    monkeypatch.setattr(
        current_file_source.importlib.util,
        "find_spec",
        lambda name: None if name == "netCDF4" else original(name),
    )
    result = load(file)
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9


@given(
    latitude=st.floats(-70, 70), longitude=st.floats(-180, 180), gradients=st.lists(st.floats(-1, 1), min_size=6, max_size=6),
    turn=st.sampled_from([0.0, 360.0, -360.0]), descending=st.booleans(), transposed=st.booleans(),
)  # fmt: skip
@settings(max_examples=20, deadline=None)
def test_any_linear_field_is_exact_wherever_the_longitudes_start(
    tmp_path_factory, latitude, longitude, gradients, turn, descending, transposed
):
    center = (latitude, longitude)
    lat, lon = axes(center)
    if descending:
        lat = lat[::-1]
    x, y = local(*np.meshgrid(lat, lon, indexing="ij"), center)
    a, b, c, d, e, f = gradients
    a += 1.5  # at rest everywhere would be land
    u, v = a + 1e-5 * (b * x + c * y), d + 1e-5 * (e * x + f * y)
    stored = (lon + 180.0) % 360.0 - 180.0 if turn == 0 else lon % 360.0 if turn > 0 else lon - 360.0
    dims = ("lon", "lat") if transposed else ("lat", "lon")
    path = tmp_path_factory.mktemp("linear") / "f.nc"
    write(path, {
        "lat": (("lat",), lat, {"units": "degrees_north"}), "lon": (("lon",), stored, {"units": "degrees_east"}),
        "u": (dims, u.T if transposed else u, {"units": "m/s"}), "v": (dims, v.T if transposed else v, {"units": "m/s"}),
    })  # fmt: skip
    result = load_current_file(path, center=center, half_width_m=8000.0, spacing_m=800.0)
    nx, ny = result.field.grid.nodes(*result.land.shape)
    expected = np.stack([a + 1e-5 * (b * nx + c * ny), d + 1e-5 * (e * nx + f * ny)], axis=-1)
    assert not result.land.any()
    assert np.abs(result.field.velocity[0] - expected).max() < 1e-7
    assert result.field.velocity.shape == (1, 21, 21, 2)


@pytest.mark.parametrize("center", [(10.0, 0.0), (-10.0, 180.0), (5.0, -179.99), (5.0, 359.98)])
@pytest.mark.parametrize("first", [0.0, -180.0, -179.75, 0.25])
def test_boxes_over_the_seam_of_a_global_file(file, center, first):
    lat, lon = np.arange(-20.0, 20.1, 0.5), first + np.arange(0, 360, 0.5)
    x, y = local(*np.meshgrid(lat, lon, indexing="ij"), center)
    u, v = np.clip(-OMEGA * y, -5, 5), np.clip(OMEGA * x, -5, 5)
    write(file, {
        "latitude": (("latitude",), lat, {}), "longitude": (("longitude",), lon, {}),
        "uo": (("latitude", "longitude"), u, {"units": "m/s"}), "vo": (("latitude", "longitude"), v, {"units": "m/s"}),
    })  # fmt: skip
    result = load_current_file(file, center=center, half_width_m=60_000.0)
    assert not result.land.any()
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9


def test_default_spacing_follows_the_file_within_bounds(file):
    plain(file)  # 0.05° east is 4.26 km here
    assert load(file, half_width_m=20_000).land.shape == (41, 41)
    fine = load_current_file(file, center=CENTER, half_width_m=100.0)
    assert fine.land.shape == (41, 41) and fine.field.grid.spacing == pytest.approx(5.0)
    assert load(file, spacing_m=500.0).land.shape == (41, 41)
    lat, lon = axes(n=61, step=0.005)
    u, v = rotation(*np.meshgrid(lat, lon, indexing="ij"))
    write(file, {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
                 "u": (("lat", "lon"), u, {}), "v": (("lat", "lon"), v, {})})  # fmt: skip
    assert load(file).land.shape[0] in range(90, 100)  # half of 0.43 km over 20 km


# --- names -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "names",
    [("uo", "vo"), ("water_u", "water_v"), ("u", "v"), ("U", "V"), ("u_sur", "v_sur"), ("ubar", "vbar"), ("ssu", "ssv"),
     ("uos", "vos"), ("UGOS", "VGOS"), ("ugos", "vgos"), ("vozocrtx", "vomecrty"), ("u_eastward", "v_northward"),
     ("u_surf", "v_surf"), ("UVEL", "VVEL"), ("eastward_velocity", "northward_velocity"), ("ucur", "vcur")],
)  # fmt: skip
def test_usual_names(file, names):
    result = load(plain(file, names=names))
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9
    assert any(repr(names[0]) in note and repr(names[1]) in note for note in result.notes)


STANDARD_PAIRS = [
    ("eastward_sea_water_velocity", "northward_sea_water_velocity"),
    ("surface_eastward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    ("barotropic_eastward_sea_water_velocity", "barotropic_northward_sea_water_velocity"),
    ("sea_water_x_velocity", "sea_water_y_velocity"),
    ("sea_water_surface_x_velocity", "sea_water_surface_y_velocity"),
    ("surface_geostrophic_eastward_sea_water_velocity", "surface_geostrophic_northward_sea_water_velocity"),
]


def with_standard_names(path, pairs):
    """Each pair (u name, v name, standard names, u, v) as constants."""
    lat, lon = axes()
    variables = {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {})}
    for u_name, v_name, standard, u, v in pairs:
        for name, standard_name, value in zip((u_name, v_name), standard, constant(u, v), strict=True):
            attributes = {"units": "m s-1", **({"standard_name": standard_name} if standard_name else {})}
            variables[name] = (("lat", "lon"), value, attributes)
    return write(path, variables)


@pytest.mark.parametrize("standard", STANDARD_PAIRS)
def test_standard_names_go_before_usual_names(file, standard):
    with_standard_names(file, [("u", "v", ("", ""), 9.0, 9.0), ("foo", "bar", standard, 0.3, -0.2)])
    np.testing.assert_allclose(load(file).field.velocity[0, 0, 0], [0.3, -0.2])


def test_total_currents_go_before_partial_ones_and_waves_and_wind_never_count(file):
    stokes = ("sea_surface_wave_stokes_drift_x_velocity", "sea_surface_wave_stokes_drift_y_velocity")
    tide = ("surface_sea_water_x_velocity_due_to_tide", "surface_sea_water_y_velocity_due_to_tide")
    flags = (
        "surface_eastward_sea_water_velocity status_flag",
        "surface_northward_sea_water_velocity status_flag",
    )
    pairs = [
        ("vsdx", "vsdy", stokes, 1.0, 1.0), ("utide", "vtide", tide, 2.0, 2.0), ("qcu", "qcv", flags, 3.0, 3.0),
        ("ubar", "vbar", STANDARD_PAIRS[2], 4.0, 4.0), ("cu", "cv", STANDARD_PAIRS[0], 0.5, 0.25),
        ("uwnd", "vwnd", ("eastward_wind", "northward_wind"), 8.0, 8.0),
    ]  # fmt: skip
    with_standard_names(file, pairs)
    np.testing.assert_allclose(load(file).field.velocity[0, 0, 0], [0.5, 0.25])
    with_standard_names(file, [("u", "v", ("eastward_wind", "northward_wind"), 8.0, 8.0)])
    with pytest.raises(CurrentFileError, match=r"no velocity.*u\(lat, lon\)"):
        load(file)
    with_standard_names(file, [("siu", "siv", ("sea_ice_x_velocity", "sea_ice_y_velocity"), 1.0, 1.0)])
    with pytest.raises(CurrentFileError, match="no velocity"):
        load(file)


def test_one_standard_name_on_both_components_falls_back_to_their_names(file):
    with_standard_names(file, [("u", "v", ("eastward_sea_water_velocity",) * 2, 0.5, 0.25)])
    np.testing.assert_allclose(load(file).field.velocity[0, 0, 0], [0.5, 0.25])


def test_long_names_are_the_last_resort(file):
    u, v = constant(0.5, 0.25)
    lat, lon = axes()
    write(file, {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
                 "var1": (("lat", "lon"), v, {"long_name": "Northward current velocity", "units": "m/s"}),
                 "var2": (("lat", "lon"), u, {"long_name": "Eastward current velocity", "units": "m/s"})})  # fmt: skip
    np.testing.assert_allclose(load(file).field.velocity[0, 0, 0], [0.5, 0.25])


# --- axes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, levels, attributes, surface",
    [("depth", [0.5, 10.0, 100.0], {"positive": "down"}, 0), ("depth", [100.0, 10.0, 0.5], {"positive": "down"}, 2),
     ("z", [-100.0, -10.0, -0.5], {"axis": "Z", "positive": "up"}, 2), ("z", [-0.5, -10.0, -100.0], {}, 0),
     ("s_rho", [-0.95, -0.5, -0.05], {"standard_name": "ocean_s_coordinate_g2"}, 2), ("lev", [3.0, 2.0, 1.0], {}, 2),
     ("height", [1.0, 5.0, 40.0], {"standard_name": "height_above_sea_floor", "positive": "up"}, 2),
     ("depth", [7.0], {}, 0), ("s_rho", None, {}, 2), ("level", None, {}, 0)],
)  # fmt: skip
def test_depth_is_reduced_to_the_surface(file, name, levels, attributes, surface):
    lat, lon = axes()
    u, v = constant(0.5, 0.25)
    count = 3 if levels is None else len(levels)
    factor = np.where(np.arange(count) == surface, 1.0, 0.1)[None, :, None, None]
    variables = {
        "time": (("time",), np.array([0.0, 6.0]), {"units": "hours since 2000-01-01"}),
        "lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
        "u": (("time", name, "lat", "lon"), np.repeat(factor * u, 2, axis=0), {"units": "m/s"}),
        "v": (("time", name, "lat", "lon"), np.repeat(factor * v, 2, axis=0), {"units": "m/s"}),
    }  # fmt: skip
    if levels is not None:
        variables[name] = ((name,), np.array(levels), attributes)
    result = load(write(file, variables))
    np.testing.assert_allclose(result.field.velocity[1, 3, 3], [0.5, 0.25])
    assert result.field.velocity.shape[0] == 2


def test_the_first_member_of_an_ensemble_is_taken_with_a_note_and_other_axes_refused(file):
    lat, lon = axes()
    u, v = constant(0.5, 0.25)
    members = np.array([1.0, 3.0])[:, None, None]
    for name, ok in (("ensemble", True), ("realization", True), ("frequency", False)):
        write(file, {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
                     "u": ((name, "lat", "lon"), members * u, {}), "v": ((name, "lat", "lon"), members * v, {})})  # fmt: skip
        if ok:
            result = load(file)
            np.testing.assert_allclose(result.field.velocity[0, 0, 0], [0.5, 0.25])
            assert any(name in note for note in result.notes)
        else:
            with pytest.raises(CurrentFileError, match="frequency"):
                load(file)


# --- units, packing, missing values ----------------------------------------------------------


@pytest.mark.parametrize(
    "text, scale",
    [("m s-1", 1), ("m/s", 1), ("meter second-1", 1), ("meters per second", 1), ("m.s-1", 1), ("m s^-1", 1), ("m s**-1", 1),
     ("ms-1", 1), ("Meters/Second", 1), ("m sec-1", 1), ("m s⁻¹", 1), ("cm/s", 0.01), ("cm s-1", 0.01), ("centimeter/second", 0.01),
     ("mm s-1", 0.001), ("km/h", 1 / 3.6), ("km h-1", 1 / 3.6), ("knots", 1852 / 3600), ("kt", 1852 / 3600), ("m/day", 1 / 86400),
     ("furlong/fortnight", None), ("K", None), ("m2 s-1", None)],
)  # fmt: skip
def test_speed_units(text, scale):
    assert parse_speed_unit(text) == (None if scale is None else pytest.approx(scale))


@pytest.mark.parametrize(
    "units, factor", [("cm/s", 100.0), ("knots", 3600 / 1852), ("km/h", 3.6), (None, 1.0), ("", 1.0)]
)
def test_units_of_a_file(file, units, factor):
    u, v = constant(0.5 * factor, -0.25 * factor)
    result = load(plain(file, u, v, units=units))
    np.testing.assert_allclose(result.field.velocity[0, 2, 2], [0.5, -0.25])
    assert any("assumed m/s" in note for note in result.notes) == (not units)


def test_units_that_are_no_speed_are_refused_and_implausible_speeds_noted(file):
    with pytest.raises(CurrentFileError, match=r"furlong.*m s-1"):
        load(plain(file, units="furlong/fortnight"))
    assert any("check the units" in note for note in load(plain(file, *constant(8.0, 1.0), units=None)).notes)
    with pytest.raises(CurrentFileError, match=r"beyond 20 m/s \(up to 80.*units"):
        load(plain(file, *constant(80.0, 50.0), units=None))


@pytest.mark.parametrize(
    "dtype, scale, written, declared",
    [("i2", 0.001, -32768, -32767), ("i2", 0.001, -32767, None), ("i2", 0.0001, -32768, -1), ("i2", 0.001, -9999, None),
     ("i4", 0.001, -2147483648, None), ("i2", 0.01, 9999, -9999), ("i2", 0.001, 32767, -32768)],
)  # fmt: skip
def test_packed_integers_with_a_wrong_or_no_fill_value(file, dtype, scale, written, declared):
    u, v = constant(0.5, -0.25)
    rows, columns = np.indices(u.shape)
    u, v = u + 0.01 * np.sin(rows), v + 0.01 * np.cos(columns)
    packed = [np.rint(a / scale).astype(dtype) for a in (u, v)]
    for a in packed:
        a[:, :6] = written
    attributes = {"scale_factor": scale, "add_offset": 0.0}
    if declared is not None:
        attributes["_FillValue"] = np.array(declared, dtype=dtype)[()]
    result = load(plain(file, *packed, velocity_attrs=attributes), half_width_m=15_000.0)
    x, _ = result.field.grid.nodes(*result.land.shape)
    east = x / METRES_PER_DEGREE / np.cos(np.radians(CENTER[0]))
    clear = np.abs(east + 0.075) > 1e-9  # half-way between the last missing column and the first good one
    np.testing.assert_array_equal(result.land[clear], (east < -0.075)[clear])
    assert result.field.velocity[0][~result.land][:, 0] == pytest.approx(0.5, abs=0.0101 + scale)
    assert any("missing" in note for note in result.notes)


def test_unsigned_packing_and_offset(file):
    u, v = ((np.full((15, 15), value)).astype(np.uint8).view(np.int8) for value in (200, 100))
    attributes = {"scale_factor": 0.01, "add_offset": -1.0, "_Unsigned": "true"}
    np.testing.assert_allclose(
        load(plain(file, u, v, velocity_attrs=attributes)).field.velocity[0, 0, 0], [1.0, 0.0], atol=1e-12
    )


@pytest.mark.parametrize("fill", [1.26765e30, 9.96921e36, -9999.0, 999.0, np.nan, -99.99, 1e20])
@pytest.mark.parametrize("declared", [True, False])
def test_a_coast_is_land_and_does_not_dilute_the_water_beside_it(file, fill, declared):
    u, v = (a.astype(np.float32) for a in constant(0.5, -0.25))
    u[9:], v[9:] = fill, fill
    attributes = {"_FillValue": np.float32(fill)} if declared else {}
    result = load(plain(file, u, v, velocity_attrs=attributes), spacing_m=250.0)
    _, y = result.field.grid.nodes(*result.land.shape)
    coast = 1.5 * 0.05 * METRES_PER_DEGREE
    np.testing.assert_array_equal(result.land, y > coast)
    assert np.abs(result.field.velocity[0][~result.land] - [0.5, -0.25]).max() < 1e-6
    assert np.all(result.field.velocity[0][result.land] == 0)


def test_land_written_as_zero_is_land_but_a_line_of_slack_water_is_not(file):
    u, v = constant(0.5, -0.25)
    u[9:], v[9:] = 0, 0
    result = load(plain(file, u, v))
    _, y = result.field.grid.nodes(*result.land.shape)
    np.testing.assert_array_equal(result.land, y > 1.5 * 0.05 * METRES_PER_DEGREE)
    assert np.abs(result.field.velocity[0][~result.land] - [0.5, -0.25]).max() < 1e-12
    assert any("exactly 0" in note for note in result.notes)
    # A shear flow is at rest along one row.
    latitude, longitude = np.meshgrid(*axes(), indexing="ij")
    shear = 1e-5 * local(latitude, longitude)[1]
    shear[7] = 0.0
    assert not load(plain(file, shear, np.zeros_like(shear))).land.any()
    # Zero in one frame only is slack water.
    both = np.stack([u, u + 0.1]), np.stack([v, v + 0.1])
    assert not load(plain(file, *both, time=(0.0, 1.0))).land.any()
    with pytest.raises(CurrentFileError, match="exactly 0"):
        load(plain(file, *constant(0, 0)))


def test_gaps_in_time_are_filled_and_points_mostly_missing_are_land(file):
    u, v = (np.repeat(a[None], 5, axis=0) for a in constant(0.5, -0.25))
    u = u * np.arange(1, 6)[:, None, None] / 5
    u[2, 7, 7] = v[2, 7, 7] = np.nan  # one gap
    u[:3, 7, 9] = v[:3, 7, 9] = np.nan  # missing in 3 of 5
    result = load(plain(file, u, v, time=np.arange(5.0)), spacing_m=200.0)
    assert result.field.sample(0.0, 0.0, 2 * 3600.0) == pytest.approx([0.3, -0.25])
    x, y = local(CENTER[0], CENTER[1] + 2 * 0.05)
    row, column = (round((p + 10_000) / 200) for p in (y, x))
    assert result.land[row, column] and not result.land[row, 50]
    assert any("gap" in note for note in result.notes)


# --- time ------------------------------------------------------------------------------------


def ramp(path, time, values=None, **options):
    """u is ``values`` (default the time in hours / 100), v half of it."""
    time = np.asarray(time)
    values = time / 100.0 if values is None else np.asarray(values)
    u, v = constant(1.0, 0.5)
    return plain(path, values[:, None, None] * u, values[:, None, None] * v, time=time, **options)


def frames(result):
    return result.field.velocity[:, 3, 3, 0]


def test_times_unsorted_and_repeated(file):
    result = load(ramp(file, [0.0, 6.0, 3.0, 3.0, 9.0], [0.01, 0.07, 0.04, 0.9, 0.1]))
    np.testing.assert_allclose(frames(result), [0.01, 0.04, 0.07, 0.1])
    assert result.field.time_step_s == pytest.approx(10800)
    assert any("sorted" in n for n in result.notes) and any("repeated" in n for n in result.notes)


def test_irregular_times_become_uniform_without_loss(file):
    values = np.array([0.1, 0.5, 0.2, 0.9])
    result = load(ramp(file, [0.0, 1.0, 3.0, 6.0], values))
    assert result.field.time_step_s == pytest.approx(3600.0) and len(result.field.velocity) == 7
    np.testing.assert_allclose(frames(result), np.interp(np.arange(7.0), [0, 1, 3, 6], values))
    # Steps without a useful common measure: the median step, ends met, within the linear interpolant.
    odd = np.array([0.0, 1.0131, 2.7177, 3.9013, 5.5551])
    result = load(ramp(file, odd))
    span = result.field.time_step_s * (len(result.field.velocity) - 1)
    assert span == pytest.approx(odd[-1] * 3600, abs=2)
    np.testing.assert_allclose(
        frames(result), np.linspace(0, odd[-1], len(result.field.velocity)) / 100, atol=1e-6
    )


def test_float32_times_with_jitter_are_uniform(file):
    time = np.arange(650_000, 650_020, dtype=np.float32) + np.float32(0.0625) * (np.arange(20) % 2 == 0) * 0.0
    result = load(ramp(file, time, np.arange(20) / 100.0, time_attrs={"units": "hours since 1950-01-01"}))
    assert result.field.time_step_s == pytest.approx(3600.0) and len(result.field.velocity) == 20


@pytest.mark.parametrize(
    "calendar, units, hours, start, second",
    [("noleap", "days since 2024-02-28", 24, "2024-02-28T00:00:00", "2024-03-01T00:00:00"),
     ("360_day", "days since 2023-02-29", 24, "2023-02-29T00:00:00", "2023-02-30T00:00:00"),
     ("julian", "days since 1900-02-28", 24, "1900-02-28T00:00:00", "1900-02-29T00:00:00"),
     ("gregorian", "hours since 2024-02-28 12:00:00", 1, "2024-02-28T12:00:00", "2024-02-28T13:00:00"),
     ("proleptic_gregorian", "seconds since 1990-01-01T00:00:00Z", 1 / 3600, "1990-01-01T00:00:00", "1990-01-01T00:00:01"),
     ("all_leap", "days since 2023-02-28", 24, "2023-02-28T00:00:00", "2023-02-29T00:00:00")],
)  # fmt: skip
def test_calendars(file, calendar, units, hours, start, second):
    u, v = constant(1.0, 0.5)
    scale = np.array([0.1, 0.2, 0.3])[:, None, None]
    plain(file, scale * u, scale * v, time=[0.0, 1.0, 2.0], time_attrs={"units": units, "calendar": calendar})
    result = load(file)
    assert result.start_time == start
    assert result.field.time_step_s == pytest.approx(hours * 3600)
    later = load(file, start_time=second)
    assert later.start_time == second
    if hours >= 1:
        np.testing.assert_allclose(frames(later), [0.2, 0.3])


def test_start_and_duration_choose_the_frames_that_cover_them(file):
    ramp(file, np.arange(0.0, 49.0, 3.0))
    result = load(file, start_time="2024-01-01T06:00", duration_s=7 * 3600.0)
    np.testing.assert_allclose(frames(result), [0.06, 0.09, 0.12, 0.15])
    assert result.field.time0_s == 0.0 and result.start_time == "2024-01-01T06:00:00"
    between = load(file, start_time="2024-01-01 07:00:00Z", duration_s=6 * 3600.0)
    for hours in (0.0, 1.5, 2.0, 4.0, 6.0):
        assert between.field.sample(0.0, 0.0, hours * 3600)[0] == pytest.approx((7 + hours) / 100, abs=1e-12)
    assert len(load(file, duration_s=0.0).field.velocity) == 1
    late = load(file, start_time="2024-01-02T12:00:00", duration_s=48 * 3600.0)
    assert len(late.field.velocity) == 5 and any("held" in note for note in late.notes)
    assert len(load(file).field.velocity) == 17
    for bad in ("2023-12-31", "2024-01-04T00:00:00"):
        with pytest.raises(CurrentFileError, match=r"outside.*2024-01-01T00:00:00 to 2024-01-03T00:00:00"):
            load(file, start_time=bad)
    with pytest.raises(InvalidParameterError, match="ISO"):
        load(file, start_time="yesterday")
    with pytest.raises(InvalidParameterError, match="duration_s"):
        load(file, duration_s=-1.0)


def test_no_time_is_a_steady_field(file):
    lat, lon = axes()
    u, v = constant(0.5, 0.25)
    write(file, {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
                 "u": (("lat", "lon"), u, {}), "v": (("lat", "lon"), v, {})})  # fmt: skip
    result = load(file)
    assert result.start_time is None and len(result.field.velocity) == 1
    with pytest.raises(CurrentFileError, match="no time"):
        load(file, start_time="2024-01-01")


@pytest.mark.parametrize(
    "attrs", [{"units": "fortnights after Easter"}, {"units": "days since yesterday"}, {"units": "hours since 2024-01-01", "calendar": "mayan"},
              {"units": "months since 2000-01-01"}, {"units": "1"}],
)  # fmt: skip
def test_time_that_does_not_parse_is_refused(file, attrs):
    with pytest.raises(CurrentFileError, match=r"'time' does not parse.*units"):
        load(ramp(file, [0.0, 1.0], time_attrs=attrs))


# --- several files, staggered and curved grids ------------------------------------------------


def test_u_and_v_in_two_files_and_one_of_them_alone(tmp_path):
    lat, lon = axes()
    u, v = rotation(*np.meshgrid(lat, lon, indexing="ij"))
    paths = []
    for name, values, hours in (("uo", u, [0.0, 1.0, 2.0]), ("vo", v, [1.0, 2.0, 3.0])):
        paths.append(write(tmp_path / f"{name}.nc", {
            "time": (("time",), np.array(hours), {"units": "hours since 2024-01-01"}),
            "lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
            name: (("time", "lat", "lon"), np.repeat(values[None], 3, axis=0), {"units": "m/s"}),
        }))  # fmt: skip
    for order in (paths, paths[::-1], [str(p) for p in paths]):
        result = load(order)
        assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9
        assert len(result.field.velocity) == 2 and result.start_time == "2024-01-01T01:00:00"
    for lone in paths:
        with pytest.raises(CurrentFileError, match=r"only one component.*two files"):
            load(lone)


def curved(angle=0.3, n=31, step=2000.0, center=CENTER):
    """Positions of a square grid turned by ``angle`` about ``center``: (latitude, longitude) (n, n)."""
    j, i = np.meshgrid(np.arange(n) - (n - 1) / 2, np.arange(n) - (n - 1) / 2, indexing="ij")
    x = step * (i * np.cos(angle) - j * np.sin(angle))
    y = step * (i * np.sin(angle) + j * np.cos(angle))
    return center[0] + y / METRES_PER_DEGREE, center[1] + x / METRES_PER_DEGREE / np.cos(
        np.radians(center[0])
    )


def test_curved_grid_with_eastward_components_is_exact(file):
    lat, lon = curved()
    u, v = rotation(lat, lon)
    write(file, {"lat": (("y", "x"), lat, {}), "lon": (("y", "x"), lon, {}),
                 "u": (("y", "x"), u, {"standard_name": "eastward_sea_water_velocity", "units": "m/s"}),
                 "v": (("y", "x"), v, {"standard_name": "northward_sea_water_velocity", "units": "m/s"}),
                 "angle": (("y", "x"), np.full_like(lat, 0.3), {})})  # fmt: skip
    result = load(file)
    assert not result.land.any()
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9
    # A box beyond the grid: its outside is land, and a centre outside is refused.
    big = load(file, half_width_m=45_000.0)
    x, y = big.field.grid.nodes(*big.land.shape)
    inside = np.maximum(np.abs(x * np.cos(0.3) + y * np.sin(0.3)), np.abs(-x * np.sin(0.3) + y * np.cos(0.3)))
    assert not big.land[inside < 30_000].any() and big.land[inside > 31_600].all()
    assert np.abs(big.field.velocity[0] - expected_rotation(big.field))[inside < 30_000].max() < 1e-9
    with pytest.raises(CurrentFileError, match="outside the data"):
        load(file, center=(41.0, -30.0))


@pytest.mark.parametrize("units", ["radians", "degrees", None])
@pytest.mark.parametrize("angle", [0.3, -1.2, 2.5])
def test_components_along_the_grid_are_turned_by_angle(file, angle, units):
    lat, lon = curved(angle)
    # A current of 0.5 m/s to the east, as seen along axes turned anticlockwise by ``angle``.
    u, v = np.full_like(lat, 0.5 * np.cos(angle)), np.full_like(lat, -0.5 * np.sin(angle))
    stored = np.degrees(angle) if units == "degrees" else angle
    write(file, {"lat": (("y", "x"), lat, {}), "lon": (("y", "x"), lon, {}),
                 "u": (("y", "x"), u, {"standard_name": "sea_water_x_velocity", "units": "m/s"}),
                 "v": (("y", "x"), v, {"standard_name": "sea_water_y_velocity", "units": "m/s"}),
                 "angle": (("y", "x"), np.full_like(lat, stored), {"units": units} if units else {})})  # fmt: skip
    result = load(file)
    assert np.abs(result.field.velocity[0] - [0.5, 0.0]).max() < 1e-12
    assert any("turned" in note for note in result.notes)


def test_without_an_angle_the_grid_lines_tell_it(file):
    lat, lon = curved(0.8)
    u, v = np.full_like(lat, 0.5 * np.cos(0.8)), np.full_like(lat, -0.5 * np.sin(0.8))
    write(file, {"nav_lat": (("y", "x"), lat, {}), "nav_lon": (("y", "x"), lon, {}),
                 "vozocrtx": (("y", "x"), u, {"units": "m/s"}), "vomecrty": (("y", "x"), v, {"units": "m/s"})})  # fmt: skip
    # The grid lines are seen on the sphere, where they are straight to about 0.5 % here.
    assert np.abs(load(file).field.velocity[0] - [0.5, 0.0]).max() < 3e-3


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
        "angle": (("eta_rho", "xi_rho"), np.full_like(lat, np.degrees(angle) if angle_units == "degrees" else angle), {"units": angle_units}),
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


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"angle": -0.7},
        {"inner": False},
        {"angle_units": "degrees"},
        {"own_places": False},
        {"names": ("u_sur", "v_sur")},
    ],
)
def test_staggered_components_are_averaged_and_turned(file, options):
    result = load(roms(file, **options))
    assert not result.land.any() and len(result.field.velocity) == 2
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9
    assert any("staggered" in note for note in result.notes)


@pytest.mark.parametrize("mask", [True, False])
def test_staggered_coast(file, mask):
    land_from, angle = 18, 0.3  # columns 18.. are land, 15 is the centre
    result = load(roms(file, angle, land_from=land_from, mask=mask), spacing_m=500.0)
    x, y = result.field.grid.nodes(*result.land.shape)
    along = x * np.cos(angle) + y * np.sin(angle)
    coast = 2000.0 * (land_from - 15.5)
    clear = np.abs(along - coast) > 1.0
    np.testing.assert_array_equal(result.land[clear], (along > coast)[clear])
    # At the last water column u is that of its one open face, half a cell off; v is exact; nothing is halved.
    wrong = np.abs(result.field.velocity[0] - expected_rotation(result.field)).max(axis=-1)
    assert wrong[(along < coast - 3000.0)].max() < 1e-9
    assert wrong[~result.land].max() < OMEGA * 2100.0


def test_components_at_offset_points_are_each_taken_from_their_own(file):
    lat, lon = axes()
    half = 0.025
    u, _ = rotation(*np.meshgrid(lat, lon + half, indexing="ij"))
    _, v = rotation(*np.meshgrid(lat + half, lon, indexing="ij"))
    north, east = {"units": "degrees_north"}, {"units": "degrees_east"}
    write(file, {"YC": (("YC",), lat, north), "XC": (("XC",), lon, east), "YG": (("YG",), lat + half, north), "XG": (("XG",), lon + half, east),
                 "UVEL": (("YC", "XG"), u, {"units": "m/s"}), "VVEL": (("YG", "XC"), v, {"units": "m/s"})})  # fmt: skip
    result = load(file)
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9


def test_curved_grid_with_positions_missing_over_land(file):
    lat, lon = curved(0.2)
    u, v = rotation(lat, lon)
    for hole in (np.nan, 0.0, 1e20, -1.0):
        a, b = lat.copy(), lon.copy()
        a[20:], b[20:] = hole, hole
        write(file, {"lat": (("y", "x"), a, {}), "lon": (("y", "x"), b, {}),
                     "u_eastward": (("y", "x"), u, {"units": "m/s"}), "v_northward": (("y", "x"), v, {"units": "m/s"})})  # fmt: skip
        result = load(file)
        x, y = result.field.grid.nodes(*result.land.shape)
        up = -x * np.sin(0.2) + y * np.cos(0.2)
        assert result.land[up > 10_000].all() and not result.land[up < 8000].any()
        assert np.abs(result.field.velocity[0] - expected_rotation(result.field))[up < 8000].max() < 1e-9


# --- the centre -------------------------------------------------------------------------------


def test_the_centre_is_chosen_where_the_box_is_all_water_near_the_middle(file):
    u, v = constant(0.5, 0.25)
    u[4:11, 4:11] = v[4:11, 4:11] = np.nan
    plain(file, u, v)
    first = load_current_file(file, half_width_m=3000.0)
    second = load_current_file(file, half_width_m=3000.0)
    assert first.center == second.center and not first.land.any()
    np.testing.assert_array_equal(first.field.velocity, second.field.velocity)
    whole = load_current_file(plain(file), half_width_m=3000.0)
    assert whole.center == pytest.approx(CENTER)
    # No box is all water: the wettest is taken and the rest marked as land.
    partly = load_current_file(plain(file, u, v), half_width_m=25_000.0)
    assert 0 < partly.land.mean() < 1


@pytest.mark.parametrize(
    "center", [(np.nan, 0.0), (40.0, np.inf), (95.0, 0.0), (40.0,), ("a", "b"), (89.0, 0.0), 5.0]
)
def test_a_centre_that_is_no_place_is_refused(file, center):
    with pytest.raises(CurrentFileError, match="center"):
        load(plain(file), center=center)


def test_a_box_outside_the_data_and_a_box_of_land_are_refused_with_the_extent(file):
    with pytest.raises(CurrentFileError, match=r"outside the data.*39\.650 to 40\.350.*-30\.350 to -29\.650"):
        load(plain(file), center=(10.0, 100.0))
    u, v = constant(0.5, 0.25)
    u[:8], v[:8] = np.nan, np.nan
    with pytest.raises(CurrentFileError, match=r"all land or missing.*Choose another"):
        load(plain(file, u, v), center=(39.75, -30.0), half_width_m=5000.0)
    u[:], v[:] = np.nan, np.nan
    with pytest.raises(CurrentFileError, match="all land"):
        load(plain(file, u, v))


# --- refusals ---------------------------------------------------------------------------------


def test_what_is_not_netcdf_is_refused_by_name(tmp_path):
    with pytest.raises(CurrentFileError, match=r"no file.*missing\.nc"):
        load(tmp_path / "missing.nc")
    with pytest.raises(CurrentFileError, match="not a file"):
        load(tmp_path)
    for content, words in ((b"hello world, not NetCDF", "begins with"), (b"", "empty"), (b"\x1f\x8b\x08\x00aaaa", "gzip"), (b"GRIB....", "GRIB"),
                           (b"<!DOCTYPE html>", "web page"), (b"\x89HDF\r\n\x1a\n" + b"x" * 50, "cannot be read"), (b"CDF\x01" + b"\xff" * 50, "cannot be read")):  # fmt: skip
        path = tmp_path / "bad.nc"
        path.write_bytes(content)
        with pytest.raises(CurrentFileError, match=rf"bad\.nc.*{words}"):
            load(path)
    with pytest.raises(CurrentFileError, match="no path"):
        load([])


@pytest.mark.parametrize("format", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_a_truncated_file_is_refused_or_read_whole(file, format):
    data = plain(file, format=format).read_bytes()
    for keep in (len(data) // 3, len(data) // 2, len(data) * 3 // 4):
        file.write_bytes(data[:keep])
        with pytest.raises(CurrentFileError):
            load(file)


def test_unstructured_meshes_sections_and_stations_are_refused(file):
    n = 40
    place = np.linspace(0, 1, n)
    for dims, names in ((("nele",), ("ua", "va")), (("node",), ("u", "v"))):
        write(file, {"lat": (dims, 40 + place, {"standard_name": "latitude"}), "lon": (dims, -30 + place, {"standard_name": "longitude"}),
                     "time": (("time",), np.arange(2.0), {"units": "hours since 2000-01-01"}),
                     names[0]: (("time", *dims), np.ones((2, n)), {"units": "m/s"}), names[1]: (("time", *dims), np.ones((2, n)), {"units": "m/s"})})  # fmt: skip
        with pytest.raises(CurrentFileError, match=rf"{dims[0]}.*unstructured"):
            load(file)
    write(file, {"lat": (("node",), place, {}), "lon": (("node",), place, {}), "u": (("siglay", "nele"), np.ones((3, 60)), {}),
                 "v": (("siglay", "nele"), np.ones((3, 60)), {})})  # fmt: skip
    with pytest.raises(CurrentFileError, match="unstructured"):
        load(file)


def test_files_without_velocity_or_places_are_refused(file):
    lat, lon = axes()
    values = np.ones((15, 15))
    write(
        file,
        {
            "lat": (("lat",), lat, {}),
            "lon": (("lon",), lon, {}),
            "thetao": (("lat", "lon"), values, {"units": "degC"}),
        },
    )
    with pytest.raises(CurrentFileError, match=r"no velocity.*thetao\(lat, lon\)"):
        load(file)
    write(file, {"u": (("y", "x"), values, {}), "v": (("y", "x"), values, {})})
    with pytest.raises(CurrentFileError, match="no latitude and longitude"):
        load(file)
    write(file, {"y": (("y",), 1e5 * np.arange(15.0), {"standard_name": "projection_y_coordinate", "units": "m"}),
                 "x": (("x",), 1e5 * np.arange(15.0), {"standard_name": "projection_x_coordinate", "units": "m"}),
                 "u": (("y", "x"), values, {}), "v": (("y", "x"), values, {})})  # fmt: skip
    with pytest.raises(CurrentFileError, match="no latitude and longitude"):
        load(file)
    write(file, {"lat": (("lat",), np.arange(15.0) * 100, {}), "lon": (("lon",), lon, {}),
                 "u": (("lat", "lon"), values, {}), "v": (("lat", "lon"), values, {})})  # fmt: skip
    with pytest.raises(CurrentFileError, match="not degrees"):
        load(file)
    write(file, {"lat": (("lat",), lat, {}), "lon": (("lon",), lon, {}),
                 "u": (("time", "lat", "lon"), np.ones((3, 15, 15)), {}), "v": (("time", "lat", "lon"), np.ones((3, 15, 15)), {})})  # fmt: skip
    with pytest.raises(CurrentFileError, match="no variable that dates them"):
        load(file)


@pytest.mark.parametrize(
    "options",
    [
        {"half_width_m": 0.0},
        {"half_width_m": np.nan},
        {"half_width_m": 1e9},
        {"spacing_m": 0.0},
        {"spacing_m": np.inf},
        {"spacing_m": 1.0},
    ],
)
def test_sizes_out_of_bounds_are_refused(file, options):
    with pytest.raises(InvalidParameterError, match=next(iter(options))):
        load(plain(file), **options)
    assert issubclass(CurrentFileError, AquaQuadError)


def test_the_result_cannot_be_changed_by_accident(file):
    result = load(plain(file))
    for array in (result.land, result.field.velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


# --- the real files ---------------------------------------------------------------------------


def read_independently(name):
    """(latitude, longitude, u, v) of the first frame at the surface, by netCDF4's own unpacking; masked arrays."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with netCDF4.Dataset(SHARED / name) as file:
            get = file.variables
            if name.startswith("wcofs"):
                lat, lon, angle = (np.asarray(get[k][:]) for k in ("lat_rho", "lon_rho", "angle"))
                u, v = (np.ma.filled(get[k][0].astype(float), np.nan) for k in ("u_sur", "v_sur"))
                u = np.nanmean(
                    np.stack(
                        [
                            np.pad(u, ((0, 0), (1, 0)), constant_values=np.nan),
                            np.pad(u, ((0, 0), (0, 1)), constant_values=np.nan),
                        ]
                    ),
                    axis=0,
                )
                v = np.nanmean(
                    np.stack(
                        [
                            np.pad(v, ((1, 0), (0, 0)), constant_values=np.nan),
                            np.pad(v, ((0, 1), (0, 0)), constant_values=np.nan),
                        ]
                    ),
                    axis=0,
                )
                return lat, lon, u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)
            names = next(p for p in (("uo", "vo"), ("water_u", "water_v"), ("u", "v")) if p[0] in get)
            u, v = (np.ma.filled(np.squeeze(get[k][0]).astype(float), np.nan) for k in names)
            axis = [
                np.asarray(
                    get[next(k for k in get if k.startswith(start) and get[k].ndim == 1)][:], dtype=float
                )
                for start in ("lat", "lon")
            ]
            return (*np.meshgrid(*axis, indexing="ij"), u, v)


@pytest.mark.parametrize("half_width_m", [20_000.0, 80_000.0])
@pytest.mark.parametrize("start", ["wa_rtofs", "cmems", "hfr", "wcofs"])
def test_real_files_against_their_nearest_points(start, half_width_m):
    found = sorted(SHARED.glob(f"{start}*.nc"))
    if not found:
        pytest.skip("the real current files (../shared/data/currents) are not here")
    result = load_current_file(found[0], half_width_m=half_width_m)
    lat, lon, u, v = read_independently(found[0].name)
    x, y = local(lat, lon, result.center)
    nx, ny = result.field.grid.nodes(*result.land.shape)
    checked = 0
    rng = np.random.default_rng(1)
    for i, j in rng.integers(0, result.land.shape[0], (300, 2)):
        away = np.hypot(x - nx[i, j], y - ny[i, j])
        order = np.argsort(away, axis=None)
        a, b = np.unravel_index(order[0], away.shape)
        c = np.unravel_index(order[1], away.shape)
        if away[c] - away[a, b] < 1.0 or not (0 < a < lat.shape[0] - 1 and 0 < b < lat.shape[1] - 1):
            continue  # a tie, or the rim, where the box may leave the data
        near_u, near_v = u[a - 1 : a + 2, b - 1 : b + 2], v[a - 1 : a + 2, b - 1 : b + 2]
        assert result.land[i, j] == np.isnan(u[a, b] + v[a, b])
        if result.land[i, j]:
            assert np.all(result.field.velocity[:, i, j] == 0)
            continue
        for value, near in zip(result.field.velocity[0, i, j], (near_u, near_v), strict=True):
            assert np.nanmin(near) - 2e-3 <= value <= np.nanmax(near) + 2e-3
        checked += 1
    assert checked > 100
    assert np.abs(result.field.velocity).max() < 3.0


def test_real_file_at_its_own_points():
    path = SHARED / "wa_rtofs_global.nc"
    if not path.exists():
        pytest.skip("the real current files (../shared/data/currents) are not here")
    lat, lon, u, v = read_independently(path.name)
    i, j = 18, 12
    result = load_current_file(
        path, center=(lat[i, j], lon[i, j]), half_width_m=10_000.0, duration_s=43_200.0
    )
    np.testing.assert_allclose(result.field.sample(0.0, 0.0), [u[i, j], v[i, j]], atol=1e-6)
    assert result.start_time == "2024-10-28T03:00:00" and len(result.field.velocity) == 5
    assert any("units" in note and "m/s" in note for note in result.notes)

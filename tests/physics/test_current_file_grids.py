"""Currents from NetCDF: names, curved and staggered grids, files that belong together, known products."""

from __future__ import annotations

import numpy as np
import pytest

netCDF4 = pytest.importorskip("netCDF4")
pytest.importorskip("xarray")

from aquaquad_envs.errors import CurrentFileError  # noqa: E402
from tests.physics.current_file_makers import (  # noqa: E402
    OMEGA,
    STANDARD_PAIRS,
    axes,
    constant,
    curved,
    expected_rotation,
    load,
    plain,
    roms,
    rotation,
    small,
    write,
)

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def file(tmp_path):
    return tmp_path / "currents.nc"


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
    # The northward one comes first in the file.
    attrs = tuple(
        {"long_name": f"{way} current velocity", "units": "m/s"} for way in ("Northward", "Eastward")
    )
    small(file, *constant(0.25, 0.5), names=("var1", "var2"), attrs=attrs)
    np.testing.assert_allclose(load(file).field.velocity[0, 0, 0], [0.5, 0.25])


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


def test_curved_grid_with_eastward_components_is_exact(file):
    lat, lon = curved()
    u, v = rotation(lat, lon)
    attrs = tuple({"standard_name": name} for name in STANDARD_PAIRS[0])
    angle = {"angle": (("y", "x"), np.full_like(lat, 0.3), {})}  # of the grid, not of these components
    small(file, u, v, lat=lat, lon=lon, dims=("y", "x"), attrs=attrs, more=angle)
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
    attrs = tuple({"standard_name": name} for name in STANDARD_PAIRS[3])
    more = {"angle": (("y", "x"), np.full_like(lat, stored), {"units": units} if units else {})}
    small(file, u, v, lat=lat, lon=lon, dims=("y", "x"), attrs=attrs, more=more)
    result = load(file)
    assert np.abs(result.field.velocity[0] - [0.5, 0.0]).max() < 1e-12
    assert any("turned" in note for note in result.notes)


def test_without_an_angle_the_grid_lines_tell_it(file):
    lat, lon = curved(0.8)
    u, v = np.full_like(lat, 0.5 * np.cos(0.8)), np.full_like(lat, -0.5 * np.sin(0.8))
    small(file, u, v, lat=lat, lon=lon, dims=("y", "x"), names=("vozocrtx", "vomecrty"))
    # The grid lines are seen on the sphere, where they are straight to about 0.5 % here.
    assert np.abs(load(file).field.velocity[0] - [0.5, 0.0]).max() < 3e-3


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
    write(file, {
        "YC": (("YC",), lat, north), "YG": (("YG",), lat + half, north),
        "XC": (("XC",), lon, east), "XG": (("XG",), lon + half, east),
        "UVEL": (("YC", "XG"), u, {"units": "m/s"}), "VVEL": (("YG", "XC"), v, {"units": "m/s"}),
    })  # fmt: skip
    result = load(file)
    assert np.abs(result.field.velocity - expected_rotation(result.field)).max() < 1e-9


def test_curved_grid_with_positions_missing_over_land(file):
    lat, lon = curved(0.2)
    u, v = rotation(lat, lon)
    for hole in (np.nan, 0.0, 1e20, -1.0):
        a, b = lat.copy(), lon.copy()
        a[20:], b[20:] = hole, hole
        small(file, u, v, lat=a, lon=b, dims=("y", "x"), names=("u_eastward", "v_northward"))
        result = load(file)
        x, y = result.field.grid.nodes(*result.land.shape)
        up = -x * np.sin(0.2) + y * np.cos(0.2)
        assert result.land[up > 10_000].all() and not result.land[up < 8000].any()
        assert np.abs(result.field.velocity[0] - expected_rotation(result.field))[up < 8000].max() < 1e-9


# --- the shapes of known products, as far as they differ from the above --------------------------


def test_hycom_native_with_two_dates_and_index_axes(file):
    lat, lon = curved(0.1)
    places = {"coordinates": "Longitude Latitude Date", "units": "m/s", "_FillValue": np.float32(1.267651e30)}
    u, v = (np.full((1, 1, 31, 31), value, dtype="f4") for value in (0.5, 0.25))
    write(file, {
        "MT": (("MT",), np.array([45000.0]), {"units": "days since 1900-12-31 00:00:00", "axis": "T"}),
        "Date": (("MT",), np.array([20240315.0]), {"units": "day as %Y%m%d.%f"}),
        "Layer": (("Layer",), np.array([1]), {"positive": "down", "axis": "Z"}),
        "Y": (("Y",), np.arange(31), {"axis": "Y"}), "X": (("X",), np.arange(31), {"axis": "X"}),
        "Latitude": (("Y", "X"), lat, {"units": "degrees_north"}),
        "Longitude": (("Y", "X"), lon + 360, {"units": "degrees_east"}),
        "u_velocity": (("MT", "Layer", "Y", "X"), u, {**places, "standard_name": STANDARD_PAIRS[0][0]}),
        "v_velocity": (("MT", "Layer", "Y", "X"), v, {**places, "standard_name": STANDARD_PAIRS[0][1]}),
    })  # fmt: skip
    result = load(file)
    assert result.start_time == "2024-03-15T00:00:00"
    np.testing.assert_allclose(result.field.velocity[0, 5, 5], [0.5, 0.25])


def test_nemo_pair_with_land_as_zero(tmp_path):
    angle = 0.2
    lat, lon = curved(angle)
    paths = []
    for letter, name, value, (row, column) in (
        ("u", "vozocrtx", 0.5, (0, 1)),
        ("v", "vomecrty", 0.1, (1, 0)),
    ):
        half = [(field[row, column] - field[0, 0]) / 2 for field in (lat, lon)]
        values = np.full((2, 2, 31, 31), value, dtype="f4")
        values[:, 1] *= 0.1  # the lower level
        values[..., 22:] = 0.0
        paths.append(write(tmp_path / f"{letter}.nc", {
            "nav_lat": (("y", "x"), lat + half[0], {}), "nav_lon": (("y", "x"), lon + half[1], {}),
            f"depth{letter}": ((f"depth{letter}",), np.array([0.5, 10.0]), {"positive": "down"}),
            "time_counter": (("time_counter",), np.array([0.0, 86400.0]), {"units": "seconds since 1900-01-01", "calendar": "noleap"}),
            name: (("time_counter", f"depth{letter}", "y", "x"), values, {"units": "m/s", "coordinates": "nav_lat nav_lon"}),
        }))  # fmt: skip
    result = load(paths)
    x, y = result.field.grid.nodes(*result.land.shape)
    along = x * np.cos(angle) + y * np.sin(angle)
    assert result.land[along > 14_500].all() and not result.land[along < 12_500].any()
    turned = [0.5 * np.cos(angle) - 0.1 * np.sin(angle), 0.5 * np.sin(angle) + 0.1 * np.cos(angle)]
    assert np.abs(result.field.velocity[0][~result.land] - turned).max() < 1e-3


def test_dates_as_text_and_positions_that_carry_time(file):
    text = np.array([list("2024-01-01_00:00:00"), list("2024-01-01_00:30:00")], dtype="S1")
    dims = ("Time", "south_north", "west_east")
    u, v = (np.full((2, 31, 31), value) for value in (0.5, 0.25))
    places = {
        name: (dims, np.repeat(a[None], 2, axis=0), {})
        for name, a in zip(("XLAT", "XLONG"), curved(), strict=True)
    }
    write(file, {"Times": (("Time", "length"), text, {}), **places, "U": (dims, u, {}), "V": (dims, v, {})})
    result = load(file)
    assert result.start_time == "2024-01-01T00:00:00" and result.field.time_step_s == 1800.0
    assert any("assumed east and north" in note for note in result.notes)


def test_pop_in_centimetres_with_two_grids_of_places(file):
    lat, lon = curved(0.4)
    dims, places = ("nlat", "nlon"), {"units": "centimeter/s", "coordinates": "ULONG ULAT time"}
    write(file, {
        "ULAT": (dims, lat, {}), "ULONG": (dims, lon % 360, {}),
        "TLAT": (dims, lat - 1.0, {}), "TLONG": (dims, lon % 360, {}), "ANGLE": (dims, np.full_like(lat, 0.4), {}),
        "UVEL": (dims, np.full_like(lat, 50 * np.cos(0.4)), {**places, "long_name": "Velocity in grid-x direction"}),
        "VVEL": (dims, np.full_like(lat, -50 * np.sin(0.4)), {**places, "long_name": "Velocity in grid-y direction"}),
    })  # fmt: skip
    assert np.abs(load(file).field.velocity[0] - [0.5, 0.0]).max() < 1e-9


def test_forecast_steps_with_valid_times(file):
    u, v = (np.stack([a, 2 * a]) for a in constant(0.5, 0.25))
    more = {
        "step": (("step",), np.array([0.0, 6.0]), {"units": "hours", "standard_name": "forecast_period"}),
        "time": (
            (),
            np.array(0.0),
            {"units": "hours since 2023-12-31", "standard_name": "forecast_reference_time"},
        ),
        "valid_time": (
            ("step",),
            np.array([24.0, 30.0]),
            {"units": "hours since 2023-12-31", "standard_name": "time"},
        ),
    }
    result = load(small(file, u, v, dims=("step", "lat", "lon"), names=("ocu", "ocv"), more=more))
    assert result.start_time == "2024-01-01T00:00:00" and result.field.time_step_s == 6 * 3600

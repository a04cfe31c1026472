"""Currents from NetCDF: metres, the centre, refusals, and the real files against an independent reading."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

netCDF4 = pytest.importorskip("netCDF4")
pytest.importorskip("xarray")

from aquaquad_envs.errors import AquaQuadError, CurrentFileError, InvalidParameterError  # noqa: E402
from aquaquad_envs.physics.current_files import load_current_file  # noqa: E402
from tests.physics.current_file_makers import (  # noqa: E402
    CENTER,
    OMEGA,
    SHARED,
    axes,
    constant,
    expected_rotation,
    load,
    local,
    plain,
    rotation,
    small,
    write,
)

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def file(tmp_path):
    return tmp_path / "currents.nc"


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
    latitude=st.floats(-70, 70), longitude=st.floats(-180, 180),
    gradients=st.lists(st.floats(-1, 1), min_size=6, max_size=6),
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
    if transposed:
        u, v = u.T, v.T
    small(path, u, v, lat=lat, lon=stored, dims=dims, attrs={"units": "m/s"})
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
    small(file, u, v, lat=lat, lon=lon)
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
    small(file, u, v, lat=lat, lon=lon)
    assert load(file).land.shape[0] in range(90, 100)  # half of 0.43 km over 20 km


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
    for content, words in (
        (b"hello world, not NetCDF", "begins with"), (b"", "empty"), (b"\x1f\x8b\x08\x00aaaa", "gzip"),
        (b"GRIB....", "GRIB"), (b"<!DOCTYPE html>", "web page"),
        (b"\x89HDF\r\n\x1a\n" + b"x" * 50, "cannot be read"), (b"CDF\x01" + b"\xff" * 50, "cannot be read"),
    ):  # fmt: skip
        path = tmp_path / "bad.nc"
        path.write_bytes(content)
        with pytest.raises(CurrentFileError, match=rf"bad\.nc.*{words}"):
            load(path)
    with pytest.raises(CurrentFileError, match="no path"):
        load([])


@pytest.mark.parametrize("format", ["NETCDF4", "NETCDF3_CLASSIC", "NETCDF3_64BIT_DATA"])
def test_a_truncated_file_is_refused(file, format):
    data = plain(file, format=format).read_bytes()
    for keep in (len(data) // 3, len(data) // 2, len(data) * 3 // 4):
        file.write_bytes(data[:keep])
        with pytest.raises(CurrentFileError):
            load(file)


def test_unstructured_meshes_sections_and_stations_are_refused(file):
    n = 40
    place = np.linspace(0, 1, n)
    for dim, names in (("nele", ("ua", "va")), ("node", ("u", "v"))):
        write(file, {
            "lat": ((dim,), 40 + place, {"standard_name": "latitude"}),
            "lon": ((dim,), -30 + place, {"standard_name": "longitude"}),
            "time": (("time",), np.arange(2.0), {"units": "hours since 2000-01-01"}),
            **{name: (("time", dim), np.ones((2, n)), {"units": "m/s"}) for name in names},
        })  # fmt: skip
        with pytest.raises(CurrentFileError, match=rf"{dim}.*unstructured"):
            load(file)
    write(file, {
        "lat": (("node",), place, {}), "lon": (("node",), place, {}),
        **{name: (("siglay", "nele"), np.ones((3, 60)), {}) for name in ("u", "v")},
    })  # fmt: skip
    with pytest.raises(CurrentFileError, match="unstructured"):
        load(file)


def test_files_without_velocity_or_places_are_refused(file):
    _lat, lon = axes()
    ones = np.ones((15, 15))
    small(file, ones, ones, names=("thetao", "so"))
    with pytest.raises(CurrentFileError, match=r"no velocity.*thetao\(lat, lon\)"):
        load(file)
    uv = {name: (("y", "x"), ones, {}) for name in ("u", "v")}
    projected = {
        name: (
            (name,),
            1e5 * np.arange(15.0),
            {"standard_name": f"projection_{name}_coordinate", "units": "m"},
        )
        for name in ("y", "x")
    }
    for variables in (uv, {**projected, **uv}):
        write(file, variables)
        with pytest.raises(CurrentFileError, match="no latitude and longitude"):
            load(file)
    small(file, ones, ones, lat=np.arange(15.0) * 100, lon=lon)
    with pytest.raises(CurrentFileError, match="not degrees"):
        load(file)
    small(file, np.ones((3, 15, 15)), np.ones((3, 15, 15)), dims=("time", "lat", "lon"))
    with pytest.raises(CurrentFileError, match="no variable that dates them"):
        load(file)


@pytest.mark.parametrize(
    "name, value",
    [("half_width_m", 0.0), ("half_width_m", np.nan), ("half_width_m", 1e9), ("half_width_m", "20 km"),
     ("spacing_m", 0.0), ("spacing_m", np.inf), ("spacing_m", 1.0)],
)  # fmt: skip
def test_sizes_out_of_bounds_are_refused(file, name, value):
    with pytest.raises(InvalidParameterError, match=name):
        load(plain(file), **{name: value})
    assert issubclass(CurrentFileError, AquaQuadError)


def test_the_result_cannot_be_changed_by_accident(file):
    result = load(plain(file))
    for array in (result.land, result.field.velocity):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


# --- the real files ---------------------------------------------------------------------------


def centred(faces, axis):
    """Mean of the faces on either side of a cell; of one where the other is missing."""
    pads = [[(0, 0), (0, 0)] for _ in range(2)]
    pads[0][axis], pads[1][axis] = (1, 0), (0, 1)
    return np.nanmean([np.pad(faces, pad, constant_values=np.nan) for pad in pads], axis=0)


def read_independently(name):
    """(latitude, longitude, u, v) of the first frame at the surface, NaN on land, by netCDF4's own unpacking."""
    with warnings.catch_warnings(), netCDF4.Dataset(SHARED / name) as file:
        warnings.simplefilter("ignore")
        pairs = (("u_sur", "v_sur"), ("uo", "vo"), ("water_u", "water_v"), ("u", "v"))
        pair = next(pair for pair in pairs if pair[0] in file.variables)
        u, v = (np.ma.filled(np.squeeze(file[k][0]).astype(float), np.nan) for k in pair)
        if pair[0] == "u_sur":
            lat, lon, angle = (np.asarray(file[k][:]) for k in ("lat_rho", "lon_rho", "angle"))
            u, v = centred(u, 1), centred(v, 0)
            return lat, lon, u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)
        lat, lon = (
            np.asarray(next(file[k][:] for k in file.variables if k.startswith(start)), dtype=float)
            for start in ("lat", "lon")
        )
        return (*np.meshgrid(lat, lon, indexing="ij"), u, v)


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

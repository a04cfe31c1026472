"""Currents from NetCDF: depth, units, packing, missing values and land, times."""

from __future__ import annotations

import numpy as np
import pytest

netCDF4 = pytest.importorskip("netCDF4")
pytest.importorskip("xarray")

from aquaquad_envs.errors import CurrentFileError, InvalidParameterError  # noqa: E402
from aquaquad_envs.physics.current_file_naming import parse_speed_unit  # noqa: E402
from tests.physics.current_file_makers import (  # noqa: E402
    CENTER,
    METRES_PER_DEGREE,
    axes,
    constant,
    load,
    local,
    plain,
    small,
    write,
)

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def file(tmp_path):
    return tmp_path / "currents.nc"


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
    u, v = (np.stack([a, 3 * a]) for a in constant(0.5, 0.25))
    for name, ok in (("ensemble", True), ("realization", True), ("frequency", False)):
        small(file, u, v, dims=(name, "lat", "lon"))
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
    [
        *((text, 1) for text in ("m s-1", "m/s", "meter second-1", "meters per second", "m.s-1", "m s^-1")),
        *((text, 1) for text in ("m s**-1", "ms-1", "Meters/Second", "m sec-1", "m s⁻¹", "[m/s]", "meter/sec")),
        *((text, 0.01) for text in ("cm/s", "cm s-1", "centimeter/second", "cm.s-1")),
        ("mm s-1", 0.001), ("km/h", 1 / 3.6), ("km h-1", 1 / 3.6), ("m/day", 1 / 86400),
        ("knots", 1852 / 3600), ("kt", 1852 / 3600),
        *((text, None) for text in ("furlong/fortnight", "K", "m2 s-1", "degree", "m", "s-1")),
    ],
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


def test_days_rounded_to_float32_are_still_uniform(file):
    days = (12_000 + np.arange(20) / 24).astype(np.float32)  # rounded to 84 s
    assert np.ptp(np.diff(days)) * 86400 > 60
    result = load(ramp(file, days, np.arange(20) / 100.0, time_attrs={"units": "days since 1990-01-01"}))
    assert result.field.time_step_s == pytest.approx(3600.0, abs=5.0)
    np.testing.assert_allclose(frames(result), np.arange(20) / 100.0)


def test_a_model_that_starts_from_rest_is_not_land(file):
    u, v = constant(0.5, -0.25)
    start = np.array([0.0, 1.0, 2.0])[:, None, None]
    result = load(plain(file, start * u, start * v, time=(0.0, 1.0, 2.0)), duration_s=0.0)
    assert not result.land.any() and not result.field.velocity.any()


@pytest.mark.parametrize(
    "calendar, units, hours, start, second",
    [("noleap", "days since 2024-02-28", 24, "2024-02-28T00:00:00", "2024-03-01T00:00:00"),
     ("360_day", "days since 2023-02-29", 24, "2023-02-29T00:00:00", "2023-02-30T00:00:00"),
     ("julian", "days since 1900-02-28", 24, "1900-02-28T00:00:00", "1900-02-29T00:00:00"),
     ("gregorian", "hours since 2024-02-28 12:00:00", 1, "2024-02-28T12:00:00", "2024-02-28T13:00:00"),
     ("proleptic_gregorian", "seconds since 1990-01-01T00:00:00Z", 1 / 3600, "1990-01-01T00:00:00",
      "1990-01-01T00:00:01"),
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
    small(file, *constant(0.5, 0.25))
    result = load(file)
    assert result.start_time is None and len(result.field.velocity) == 1
    with pytest.raises(CurrentFileError, match="no time"):
        load(file, start_time="2024-01-01")


@pytest.mark.parametrize(
    "attrs",
    [{"units": "fortnights after Easter"}, {"units": "days since yesterday"}, {"units": "1"},
     {"units": "hours since 2024-01-01", "calendar": "mayan"}, {"units": "months since 2000-01-01"}],
)  # fmt: skip
def test_time_that_does_not_parse_is_refused(file, attrs):
    with pytest.raises(CurrentFileError, match=r"'time' does not parse.*units"):
        load(ramp(file, [0.0, 1.0], time_attrs=attrs))

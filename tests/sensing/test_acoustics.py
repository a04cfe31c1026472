"""Sound speed against TEOS-10, absorption against Francois and Garrison, noise in its limits."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.sensing.acoustics import (
    absorption_db_per_km,
    ambient_noise_db,
    sound_speed,
    sound_speed_at,
)


@pytest.mark.parametrize(
    "water, speed",
    [
        ((0.0, 35.0, 0.0), 1449.2),
        ((10.0, 35.0, 0.0), 1489.99),  # + 46 - 5.5 + 0.29
        ((10.0, 35.0, 100.0), 1491.59),  # + 1.6
        ((10.0, 30.0, 0.0), 1483.79),  # - 5 · 1.24
        ((20.0, 35.0, 0.0), 1521.52),  # + 92 - 22 + 2.32
    ],
)
def test_sound_speed_by_hand(water, speed):
    assert sound_speed(*water) == pytest.approx(speed, abs=1e-9)
    assert sound_speed_at(*water) == pytest.approx(speed, abs=1e-9)


@given(st.floats(0, 34), st.floats(0, 44), st.floats(0, 990))
def test_sound_is_faster_in_warm_salt_deep_water(temperature, salinity, depth):
    here = sound_speed(temperature, salinity, depth)
    assert sound_speed(temperature + 1, salinity, depth) > here
    assert sound_speed(temperature, salinity + 1, depth) > here
    assert sound_speed(temperature, salinity, depth + 10) == pytest.approx(here + 0.16, abs=1e-9)


def test_sound_speed_broadcasts():
    speeds = sound_speed(np.array([[5.0], [10.0]]), 35.0, np.array([0.0, 10.0, 20.0]))
    assert speeds.shape == (2, 3)
    assert speeds[1, 2] == sound_speed(10.0, 35.0, 20.0) == sound_speed_at(10.0, 35.0, 20.0)
    assert isinstance(sound_speed(10, 35, 20), float)


def difference_from_teos10(temperatures, salinities, depths):
    gsw = pytest.importorskip("gsw")
    t, s, z = np.meshgrid(temperatures, salinities, depths, indexing="ij")
    pressure = gsw.p_from_z(-z, 45.0)
    absolute = gsw.SA_from_SP(s, pressure, -30.0, 45.0)
    return sound_speed(t, s, z) - gsw.sound_speed_t_exact(absolute, t, pressure)


@pytest.mark.parametrize(
    "temperatures, salinities, depths, most, rms",
    [
        ((5, 30), (32, 37), (0, 100), 0.26, 0.12),  # the mixed layer, where the vehicles listen
        ((0, 35), (30, 40), (0, 1000), 0.75, 0.30),
        ((0, 35), (0, 45), (0, 1000), 1.5, 0.55),  # all of the equation's validity
    ],
)
def test_against_teos10(temperatures, salinities, depths, most, rms):
    """The figures in docs/acoustics.md: the differences are of this size, and not smaller either."""
    grid = (np.linspace(*bounds, 21) for bounds in (temperatures, salinities, depths))
    difference = difference_from_teos10(*grid)
    assert 0.75 * most < np.abs(difference).max() <= most
    assert np.sqrt(np.mean(difference**2)) <= rms


def test_too_low_below_its_depth():
    deep = difference_from_teos10([2.0], [35.0], [1000.0, 2000.0, 4000.0]).ravel()
    np.testing.assert_allclose(deep, [-0.23, -1.04, -3.75], atol=0.01)


def francois_garrison(f, t, s, z, ph):
    """Francois and Garrison, J. Acoust. Soc. Am. 72, 1982: dB/km, f in kHz. Written for this test alone."""
    c = 1412 + 3.21 * t + 1.19 * s + 0.0167 * z
    boric = 8.86 / c * 10 ** (0.78 * ph - 5)
    f1 = 2.8 * math.sqrt(s / 35) * 10 ** (4 - 1245 / (273 + t))
    magnesium = 21.44 * s / c * (1 + 0.025 * t)
    p2 = 1 - 1.37e-4 * z + 6.2e-9 * z**2
    f2 = 8.17 * 10 ** (8 - 1990 / (273 + t)) / (1 + 0.0018 * (s - 35))
    water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.5e-8 * t**3
    p3 = 1 - 3.83e-5 * z + 4.9e-10 * z**2
    return (
        boric * f1 * f**2 / (f1**2 + f**2) + magnesium * p2 * f2 * f**2 / (f2**2 + f**2) + water * p3 * f**2
    )


@pytest.mark.parametrize("depth", [0.0, 1000.0])
@pytest.mark.parametrize("frequency", [500, 1000, 3000, 10_000, 20_000])
def test_absorption_against_another_model_in_thorps_water(frequency, depth):
    ratio = absorption_db_per_km(frequency) / francois_garrison(frequency / 1000, 4.0, 35.0, depth, 8.0)
    assert 1.03 < ratio < 1.22


def test_absorption_is_overstated_in_warm_water():
    ratio = [
        absorption_db_per_km(1000.0 * f) / francois_garrison(f, 20.0, 35.0, 20.0, 8.0)
        for f in (0.5, 1, 2, 5, 20)
    ]
    assert min(ratio) > 1.1 and 1.7 < max(ratio) < 1.75


def test_absorption_known_values_and_rise():
    assert absorption_db_per_km(1000.0) == pytest.approx(0.069, abs=5e-4)
    assert absorption_db_per_km(10_000.0) == pytest.approx(1.19, abs=5e-3)
    assert absorption_db_per_km(0.1) == pytest.approx(0.0033, rel=1e-3)
    rising = absorption_db_per_km(np.geomspace(1, 1e5, 200))
    assert (np.diff(rising) > 0).all()


def test_ambient_noise_in_its_four_bands():
    def slope(low, high, **settings):
        return (ambient_noise_db(high, **settings) - ambient_noise_db(low, **settings)) / math.log10(
            high / low
        )

    # dB a decade: turbulence - 30 (still air and no ships), surface about - 17 and - 20 in the limit, thermal + 20.
    assert slope(10, 12, wind_m_s=0, shipping=0) < -15
    assert slope(3000, 20_000, wind_m_s=15) == pytest.approx(-17, abs=1.5)
    assert slope(9e4, 1e5, wind_m_s=0) > 5
    quiet, storm = ambient_noise_db(1000.0, wind_m_s=1), ambient_noise_db(1000.0, wind_m_s=16)
    assert storm - quiet == pytest.approx(7.5 * 3, abs=1.0)
    ships = ambient_noise_db(100.0, wind_m_s=0, shipping=1) - ambient_noise_db(100.0, wind_m_s=0, shipping=0)
    assert ships == pytest.approx(20, abs=1.5)
    # By hand at 1 kHz, 5 m/s, half the ships: 29.0 + 50 + 16.77 - 5.85 and weaker terms.
    assert ambient_noise_db(1000.0) == pytest.approx(60.95, abs=0.05)
    assert ambient_noise_db(1000.0, bandwidth_hz=100) == pytest.approx(ambient_noise_db(1000.0) + 20)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: sound_speed(60.0, 35.0, 0.0), r"temperature_c: got 60.0, expected numbers in \[-3, 45\]"),
        (lambda: sound_speed(10.0, -1.0, 0.0), "salinity_ppt: got -1.0"),
        (lambda: sound_speed(10.0, 35.0, [0.0, -5.0]), "depth_m: got -5.0"),
        (lambda: sound_speed([10.0, math.nan], 35.0, 0.0), "temperature_c: got nan"),
        (lambda: sound_speed("warm", 35.0, 0.0), "temperature_c: got 'warm'"),
        (lambda: absorption_db_per_km(0.0), "frequency_hz: got 0.0"),
        (lambda: ambient_noise_db(1000.0, shipping=2.0), "shipping: got 2.0"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()


def test_every_wrong_value_is_found_wherever_it_stands():
    for place in itertools.product(range(2), range(3)):
        depths = np.zeros((2, 3))
        depths[place] = 2e4
        with pytest.raises(InvalidParameterError, match="depth_m"):
            sound_speed(10.0, 35.0, depths)

"""The sea as a medium of sound: its speed, its absorption, and the noise in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import InvalidParameterError

#: Speed of sound of the published laboratory test, m/s (Dillard 2014, V.C).
PUBLISHED_SOUND_SPEED = 1500.0


@kernel
def sound_speed_at(temperature, salinity, depth):
    """Speed of sound, m/s: the equation of :func:`sound_speed` for one point, unchecked."""
    return (
        1449.2
        + temperature * (4.6 + temperature * (-0.055 + 0.00029 * temperature))
        + (1.34 - 0.010 * temperature) * (salinity - 35.0)
        + 0.016 * depth
    )


def sound_speed(temperature_c: npt.ArrayLike, salinity_ppt: npt.ArrayLike, depth_m: npt.ArrayLike) -> Any:
    """Speed of sound in sea water, m/s, at T °C, S parts per thousand and depth z m.

    c = 1449.2 + 4.6 T - 0.055 T² + 0.00029 T³ + (1.34 - 0.010 T)(S - 35) + 0.016 z
    (Medwin, J. Acoust. Soc. Am. 58, 1975; Dillard 2014, eq. II.1). Arguments are broadcast
    against each other; the result has their shape, a float for scalars.

    Valid for 0–35 °C, 0–45 ppt and 0–1000 m. There it differs from TEOS-10 (gsw, practical salinity,
    in situ temperature) by at most 1.5 m/s, for S of 30–40 by 0.75 m/s, in the upper 100 m of the ocean
    (5–30 °C, S 32–37) by 0.25 m/s. Deeper it is too low, the pressure term being linear: by 3.7 m/s at
    4000 m (docs/acoustics.md). Raises ``InvalidParameterError`` outside -3–45 °C, 0–50 ppt, 0–12 000 m, and for NaN.
    """
    temperature = _checked("temperature_c", temperature_c, -3.0, 45.0)
    salinity = _checked("salinity_ppt", salinity_ppt, 0.0, 50.0)
    depth = _checked("depth_m", depth_m, 0.0, 12_000.0)
    return _plain(sound_speed_at.py_func(temperature, salinity, depth))


def absorption_db_per_km(frequency_hz: npt.ArrayLike) -> Any:
    """Thorp's absorption of sound in sea water, dB/km, at f in kHz (the argument is in Hz).

    α = 0.0033 + 0.11 f²/(1 + f²) + 44 f²/(4100 + f²) + 3.0e-4 f² (Thorp, J. Acoust. Soc. Am. 42,
    1967, in the form of Urick, Principles of Underwater Sound, 3rd ed., 1983, p. 108). Scalar or array.
    For 4 °C, 35 ppt, pH 8 and 0.2–50 kHz. Francois and Garrison (1982) give less: at 4 °C, 0.5–20 kHz Thorp
    is 3–21 % above them, in surface water of 20 °C up to 75 %; at 0.1 kHz several times, of the
    little there is. Raises ``InvalidParameterError`` outside 0.001 Hz to 100 kHz.
    """
    f = _checked("frequency_hz", frequency_hz, 1e-3, 1e5) / 1000.0
    f2 = f * f
    return _plain(0.0033 + 0.11 * f2 / (1.0 + f2) + 44.0 * f2 / (4100.0 + f2) + 3.0e-4 * f2)


def ambient_noise_db(
    frequency_hz: npt.ArrayLike, *, wind_m_s: float = 5.0, shipping: float = 0.5, bandwidth_hz: float = 1.0
) -> Any:
    """Level of the ambient noise, dB re 1 µPa, in a band ``bandwidth_hz`` about ``frequency_hz``.

    Sum of the powers of four spectrum levels, dB re 1 µPa²/Hz, f in kHz, w the wind speed, s
    in [0, 1] the shipping: turbulence 17 - 30 log f; ships 40 + 20 (s - 0.5) + 26 log f - 60 log(f + 0.03);
    surface 50 + 7.5 √w + 20 log f - 40 log(f + 0.4); thermal -15 + 20 log f; plus 10 log(bandwidth)
    (Coates, Underwater Acoustic Systems, 1990; Stojanovic, Mob. Comput. Commun. Rev. 11, 2007, eq. 7; log to
    the base of ten). The band's spectrum is taken as flat. For 10 Hz to 100 kHz in the open
    sea. Scalar or array. Raises ``InvalidParameterError`` outside these bounds.
    """
    f = _checked("frequency_hz", frequency_hz, 10.0, 1e5) / 1000.0
    wind = _checked("wind_m_s", wind_m_s, 0.0, 60.0)
    ships = _checked("shipping", shipping, 0.0, 1.0)
    band = _checked("bandwidth_hz", bandwidth_hz, 1e-3, 1e5)
    log_f = np.log10(f)
    levels = (
        17.0 - 30.0 * log_f,
        40.0 + 20.0 * (ships - 0.5) + 26.0 * log_f - 60.0 * np.log10(f + 0.03),
        50.0 + 7.5 * np.sqrt(wind) + 20.0 * log_f - 40.0 * np.log10(f + 0.4),
        -15.0 + 20.0 * log_f,
    )
    power = sum(10.0 ** (level / 10.0) for level in levels)
    return _plain(10.0 * np.log10(power) + 10.0 * np.log10(band))


def _checked(name: str, values: npt.ArrayLike, low: float, high: float) -> np.ndarray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidParameterError(name, values, "a number or an array of numbers") from None
    wrong = ~((array >= low) & (array <= high))  # NaN too
    if wrong.any():
        raise InvalidParameterError(name, float(array[wrong].flat[0]), f"numbers in [{low:g}, {high:g}]")
    return array


def _plain(values: Any) -> Any:
    """A float for scalars, else the array."""
    return float(values) if np.ndim(values) == 0 else values

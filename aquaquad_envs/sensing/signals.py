"""Time difference of arrival from raw recordings: generalised cross-correlation with phase transform.

Two sensors record x = s(t - t_x) + noise and y = s(t - t_y) + noise. The delay t_y - t_x is where

    R(τ) = Re Σ_f W(f) Y(f) X*(f) e^{i 2π f τ},   W = 1/|Y X*| (phase transform) or 1 (plain correlation),

summed over a band, is greatest (Knapp and Carter, IEEE Trans. Acoust. Speech Signal Process. 24, 1976).
The sum over a band is a band-pass with sharp edges: recordings need no other filter. The published
trial took the peak of the plain correlation of an up-sweep (Dillard 2014, II.E, fig. 17). Delays are
positive where ``y`` hears later than ``x``; the TDOA τ_ij = (r_i - r_j)/c of
:mod:`aquaquad_envs.sensing.measurements` is therefore ``estimate_delay(x=recording_j, y=recording_i)``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range


def chirp(
    *, low_hz: float, high_hz: float, duration_s: float, sample_rate_hz: float, taper: float = 0.1
) -> np.ndarray:
    """A linear up-sweep of amplitude 1, ``low_hz`` to ``high_hz``, with a Tukey window.

    ``taper`` in [0, 1] is the share of the duration that fades in and out. Raises ``InvalidParameterError``
    unless 0 < low < high < half the sample rate.
    """
    from scipy.signal import chirp as sweep
    from scipy.signal.windows import tukey

    _check_band((low_hz, high_hz), sample_rate_hz)
    check_range("taper", taper, 0, 1)
    check_range("duration_s", duration_s, 2.0 / sample_rate_hz, 1e6)
    t = np.arange(round(duration_s * sample_rate_hz)) / sample_rate_hz
    return sweep(t, f0=low_hz, f1=high_hz, t1=duration_s) * tukey(t.size, taper)


def recording(
    signal: np.ndarray,
    *,
    sample_rate_hz: float,
    duration_s: float,
    arrivals: Sequence[tuple[float, float]],
    noise_std: float = 0.0,
    rng: np.random.Generator | None = None,
) -> np.ndarray:
    """What a sensor records: ``signal`` along several paths, plus white normal noise.

    ``arrivals`` are pairs (delay s, amplitude), one a path; a reflection at the surface has a
    negative amplitude. Delays need not be whole samples: they are exact for a signal without content
    at half the sample rate. Raises ``InvalidParameterError`` where a path does not end within the recording.
    """
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    signal = np.asarray(signal, dtype=np.float64)
    check_range("noise_std", noise_std, 0, 1e12)
    if noise_std > 0 and rng is None:
        raise InvalidParameterError("rng", rng, "a random generator", "Noise is drawn from it.")
    size = round(duration_s * sample_rate_hz)
    latest = (size - signal.size) / sample_rate_hz
    for delay, _ in arrivals:
        check_range("arrivals", delay, 0, latest, remedy="A path must begin and end within the recording.")
    # The band-limited tails of a fractional delay wrap round: into the padding.
    padded = next_fast_len(size + 64, real=True)
    f = rfftfreq(padded, 1.0 / sample_rate_hz)
    response = sum(gain * np.exp(-2j * np.pi * f * delay) for delay, gain in arrivals)
    heard = irfft(rfft(signal, padded) * response, padded)[:size]
    return heard + noise_std * rng.standard_normal(size) if rng is not None else heard


def estimate_delay(
    x: np.ndarray,
    y: np.ndarray,
    *,
    sample_rate_hz: float,
    band_hz: tuple[float, float],
    weighting: str = "phat",
    interpolation: str = "spectral",
    max_delay_s: float | None = None,
) -> float:
    """Delay, s, of recording ``y`` after recording ``x``: the peak of R(τ) over ``band_hz``.

    ``weighting`` is "phat" or "none". ``interpolation``: "spectral" climbs to the maximum of R itself, as
    exact as the arithmetic; "parabolic" lays a parabola through three points of R a quarter of a
    sample apart, biased by up to a thousandth of a sample; "none" takes the nearest sample. Peaks
    beyond ``max_delay_s`` (the distance of the sensors over c is a sound bound) are ignored. With the
    phase transform every frequency of the band has one vote, so the band must be the signal's. Raises
    ``InvalidParameterError`` for recordings of unequal length, a band outside (0, half the sample
    rate) or one that holds nothing.
    """
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    check_choice("weighting", weighting, ("phat", "none"))
    check_choice("interpolation", interpolation, ("spectral", "parabolic", "none"))
    _check_band(band_hz, sample_rate_hz)
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape or x.size < 8:
        raise InvalidParameterError(
            "recordings", (x.shape, y.shape), "two recordings of one length, 8 samples or more"
        )
    longest = (x.size - 1) / sample_rate_hz
    if max_delay_s is not None:
        check_range("max_delay_s", max_delay_s, 1.0 / sample_rate_hz, longest)
        longest = max_delay_s

    size = next_fast_len(2 * x.size, real=True)  # twice the length: delays do not wrap round
    f = rfftfreq(size, 1.0 / sample_rate_hz)
    inside = (f >= band_hz[0]) & (f <= band_hz[1])
    cross = np.where(inside, rfft(y, size) * np.conj(rfft(x, size)), 0.0)
    magnitude = np.abs(cross)
    if not magnitude.max(initial=0.0) > 0.0:
        raise InvalidParameterError("recordings", "silence in the band", "a signal between the band's edges")
    if weighting == "phat":
        cross = np.divide(cross, magnitude, out=cross, where=magnitude > 0.0)

    # Four times the sample rate: R between samples is never far below its peak.
    fine = 1 if interpolation == "none" else 4
    correlation = irfft(cross, fine * size)
    reach = int(longest * sample_rate_hz * fine)
    lags = np.arange(-reach, reach + 1)
    peak = int(lags[np.argmax(correlation[lags])])
    step = 1.0 / (fine * sample_rate_hz)
    if interpolation == "none":
        return peak * step
    before, at, after = correlation[[peak - 1, peak, (peak + 1) % correlation.size]]
    bend = before - 2.0 * at + after
    delay = (peak + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)) * step
    if interpolation == "spectral":
        delay = _climb(cross[inside], 2.0 * np.pi * f[inside], delay, step)
    return float(delay)


def _climb(cross: np.ndarray, omega: np.ndarray, delay: float, step: float) -> float:
    """Newton's method on R'(τ) = 0 from a start within ``step`` of the maximum."""
    start = delay
    for _ in range(20):
        turned = cross * np.exp(1j * omega * delay)
        slope = -np.sum(omega * turned.imag)
        bend = -np.sum(omega * omega * turned.real)
        if bend >= 0.0:
            return start
        change = -slope / bend
        delay += change
        if abs(delay - start) > step:
            return start
        if abs(change) < 1e-12 * step:
            break
    return delay


def delay_bound_std(
    signal: np.ndarray, *, sample_rate_hz: float, noise_std: float | tuple[float, float]
) -> float:
    """Cramér–Rao bound: the least standard deviation, s, of any unbiased estimate of the delay of two recordings.

    For ``signal`` as received, of unknown form, in white normal noise of ``noise_std`` a sample (one
    number, or one a recording): var ≥ (σ_x² + σ_y²) / Σ_n ṡ(n)², ṡ the signal's time derivative at the samples.
    It is the sum of the bounds of two arrival times of a known signal, the unknown form
    costing nothing more (Kay, Estimation Theory, 1993, 3.11). Knapp and Carter's bound for random signals
    tends to it at high signal-to-noise ratio; below the threshold no estimator is near. Raises
    ``InvalidParameterError`` for a constant signal.
    """
    from scipy.fft import next_fast_len, rfft, rfftfreq

    signal = np.asarray(signal, dtype=np.float64)
    pair = (noise_std, noise_std) if isinstance(noise_std, float | int) else noise_std
    for std in pair:
        check_range("noise_std", std, 0, 1e12)
    size = next_fast_len(2 * signal.size, real=True)
    spectrum = rfft(signal, size) * 2.0 * np.pi * rfftfreq(size, 1.0 / sample_rate_hz)
    # Parseval: positive and negative frequencies.
    slope_energy = 2.0 * float(np.sum(np.abs(spectrum) ** 2)) / size
    if not slope_energy > 0.0:
        raise InvalidParameterError("signal", signal, "a signal that changes")
    return float(np.sqrt((pair[0] ** 2 + pair[1] ** 2) / slope_energy))


def _check_band(band_hz: tuple[float, float], sample_rate_hz: float) -> None:
    check_range("sample_rate_hz", sample_rate_hz, 1e-3, 1e9)
    low, high = band_hz
    if not 0.0 < low < high < 0.5 * sample_rate_hz:
        raise InvalidParameterError(
            "band_hz", tuple(band_hz), f"0 < low < high < {0.5 * sample_rate_hz:g} Hz, half the sample rate"
        )

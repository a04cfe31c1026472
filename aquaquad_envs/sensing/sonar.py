"""The passive sonar equation: whether a sensor at some range hears an emission.

Signal excess, dB: SE = SL - level · TL(r) - NL + AG - DT, with the transmission loss

    TL(r) = 20 log r                          for r ≤ r_t  (spherical spreading)
          = 20 log r_t + 10 log(r / r_t)      for r > r_t  (cylindrical, in a duct or a shallow sea)
          + α r

log to the base of ten, r in m and at least 1 m. Probability of detection: Φ(SE / σ), the
normal distribution of the fluctuations of SE about its mean, 1/2 where SE = 0
(Urick, Principles of Underwater Sound, 3rd ed., 1983, ch. 2, 6 and 12). The published work has
no such model and names that as a limit of its dilution of precision (Dillard 2014, IV.A): level 0
keeps it so, and every sensor then hears every emission.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.sensing.acoustics import absorption_db_per_km


class SonarTerms(NamedTuple):
    """What kernels need of a :class:`PassiveSonar`: excess at 1 m (dB), α (dB/m), r_t (m), σ (dB), level."""

    excess_at_1m: float
    absorption: float
    transition_range: float
    transition_std: float
    level: float


@kernel
def transmission_loss(r, transition_range, absorption):
    """TL, dB re 1 m, at range ``r`` m (held at 1 m or more); ``absorption`` in dB/m."""
    r = r if r > 1.0 else 1.0
    near = r if r < transition_range else transition_range
    far = r / near
    return 20.0 * np.log10(near) + 10.0 * np.log10(far) + absorption * r


@kernel
def signal_excess(sonar, r):
    """SE, dB, at range ``r`` m."""
    return sonar.excess_at_1m - sonar.level * transmission_loss(r, sonar.transition_range, sonar.absorption)


@kernel
def detection_probability(sonar, r):
    """Probability in [0, 1] that an emission at range ``r`` m is heard.

    1 at level 0, whatever the excess; a step from 0 to 1 at SE ≥ 0 where σ is 0.
    """
    if sonar.level == 0.0:
        return 1.0
    excess = signal_excess(sonar, r)
    if sonar.transition_std == 0.0:
        return 1.0 if excess >= 0.0 else 0.0
    return 0.5 * math.erfc(-excess / (sonar.transition_std * math.sqrt(2.0)))


@kernel
def detects(sonar, r, stream):
    """Whether an emission at range ``r`` m is heard: one uniform draw from ``stream``, at every level."""
    return uniform(stream) < detection_probability(sonar, r)


@loop_kernel
def _over_ranges(sonar, ranges, excess, probability):
    for i in range(ranges.size):
        excess[i] = signal_excess(sonar, ranges[i])
        probability[i] = detection_probability(sonar, ranges[i])


@dataclass(frozen=True, kw_only=True)
class PassiveSonar:
    """Terms of the passive sonar equation of this module; raises ``InvalidParameterError`` outside their bounds.

    Levels in dB re 1 µPa (source: at 1 m), all over the same band. ``level`` 0, the default, is range
    independence: all is heard. The other defaults are a made-up but ordinary case: a source of 150 dB
    in 100 Hz about 1 kHz, 5 m/s of wind, one hydrophone; at level 1 half is heard at 7 km.
    """

    level: float = 0.0  # 0: range independent, all is heard; 1: the equation; between: a share of TL in dB
    source_level_db: float = 150.0
    noise_level_db: float = 81.0  # ambient_noise_db(1000, wind_m_s=5, bandwidth_hz=100)
    array_gain_db: float = 0.0
    detection_threshold_db: float = 0.0
    frequency_hz: float = 1000.0  # sets the absorption
    transition_range_m: float = 1000.0  # spherical to cylindrical; `rays.transition_range` for a duct
    transition_std_db: float = 8.0  # Urick gives 8-10 dB for the sum of all fluctuations

    def __post_init__(self) -> None:
        check_range("level", self.level, 0, 1)
        for name in ("source_level_db", "noise_level_db", "array_gain_db", "detection_threshold_db"):
            check_range(name, getattr(self, name), -300, 300)
        check_range("frequency_hz", self.frequency_hz, 10, 1e5)
        check_range("transition_range_m", self.transition_range_m, 1, 1e7)
        check_range("transition_std_db", self.transition_std_db, 0, 100)

    def terms(self) -> SonarTerms:
        """The numbers that the kernels read."""
        return SonarTerms(
            excess_at_1m=float(
                self.source_level_db - self.noise_level_db + self.array_gain_db - self.detection_threshold_db
            ),
            absorption=absorption_db_per_km(self.frequency_hz) / 1000.0,
            transition_range=float(self.transition_range_m),
            transition_std=float(self.transition_std_db),
            level=float(self.level),
        )

    def signal_excess(self, range_m: npt.ArrayLike) -> Any:
        """SE, dB, at each range, m."""
        return self._over(range_m)[0]

    def detection_probability(self, range_m: npt.ArrayLike) -> Any:
        """Probability of detection at each range, m."""
        return self._over(range_m)[1]

    def detection_range(self, probability: float = 0.5) -> float:
        """Range, m, at which the probability of detection falls to ``probability``: ``inf`` if it never does.

        0 where even 1 m is too far. Raises ``InvalidParameterError`` unless 0 < probability < 1.
        """
        from scipy.optimize import brentq
        from scipy.special import ndtri

        if not 0.0 < probability < 1.0:
            raise InvalidParameterError("probability", probability, "a number in (0, 1)")
        if self.level == 0.0:
            return math.inf
        sonar = self.terms()
        needed = self.transition_std_db * float(ndtri(probability))
        if signal_excess(sonar, 1.0) < needed:
            return 0.0
        # TL rises at least as fast as α r: this far out it must exceed what is left.
        far = 2.0 + (sonar.excess_at_1m - needed) / (sonar.level * sonar.absorption)
        return float(brentq(lambda r: signal_excess(sonar, r) - needed, 1.0, far, xtol=1e-6))

    def _over(self, range_m: npt.ArrayLike) -> tuple[Any, Any]:
        ranges = np.asarray(range_m, dtype=np.float64)
        if not (ranges >= 0).all():
            raise InvalidParameterError("range_m", range_m, "numbers of at least 0")
        excess, probability = np.empty(ranges.size), np.empty(ranges.size)
        _over_ranges(self.terms(), ranges.ravel(), excess, probability)
        shape = ranges.shape
        if not shape:
            return float(excess[0]), float(probability[0])
        return excess.reshape(shape), probability.reshape(shape)


def detection_index(false_alarm: float, detection: float = 0.5) -> float:
    """Detection index d = (Φ⁻¹(p_D) - Φ⁻¹(p_FA))²: the squared separation of noise and signal needed.

    For a detector whose output is normal with one variance (Urick 1983, ch. 12). Raises
    ``InvalidParameterError`` unless 0 < p_FA < p_D < 1.
    """
    from scipy.special import ndtri

    if not 0.0 < false_alarm < detection < 1.0:
        raise InvalidParameterError("false_alarm", false_alarm, f"a number in (0, {detection})")
    return float((ndtri(detection) - ndtri(false_alarm)) ** 2)


def detection_threshold_db(index: float, *, bandwidth_hz: float, integration_time_s: float) -> float:
    """Detection threshold of an energy detector, dB, for signal and noise levels over the same band.

    DT = 5 log10(d / (w t)): Urick's 5 log10(d w / t) refers noise to a band of 1 Hz, here it is the noise in
    the whole band w (hence - 10 log10 w). For w t of 100 or more. Raises ``InvalidParameterError``
    for a ``bandwidth_hz``, ``integration_time_s`` or ``index`` that is not positive.
    """
    check_range("index", index, 0, 1e9, open_low=True)
    check_range("bandwidth_hz", bandwidth_hz, 0, 1e9, open_low=True)
    check_range("integration_time_s", integration_time_s, 0, 1e9, open_low=True)
    return 5.0 * math.log10(index / (bandwidth_hz * integration_time_s))

"""The passive sonar equation: loss by hand, probabilities by an independent detector, and level 0."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.randomness import seed_streams, uniform
from aquaquad_envs.sensing.acoustics import absorption_db_per_km, ambient_noise_db
from aquaquad_envs.sensing.sonar import (
    PassiveSonar,
    detection_index,
    detection_probability,
    detection_threshold_db,
    detects,
    signal_excess,
    transmission_loss,
)

sonars = st.builds(
    PassiveSonar,
    level=st.floats(0.1, 1),
    source_level_db=st.floats(100, 200),
    noise_level_db=st.floats(40, 100),
    frequency_hz=st.floats(50, 2e4),
    transition_range_m=st.floats(1, 1e5),
    transition_std_db=st.floats(0.5, 12),
)


# --- loss --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "r, loss", [(0.0, 0.0), (1.0, 0.0), (100.0, 40.0), (1000.0, 60.0), (10_000.0, 70.0), (1e5, 80.0)]
)
def test_spreading_by_hand(r, loss):
    assert transmission_loss(r, 1000.0, 0.0) == pytest.approx(loss, abs=1e-12)
    assert transmission_loss(r, 1000.0, 7e-5) == pytest.approx(loss + 7e-5 * max(r, 1.0), abs=1e-12)


@given(st.floats(1, 1e6), st.floats(1, 1e5))
def test_doubling_the_range_costs_six_decibels_then_three(r, transition):
    rise = transmission_loss(2 * r, transition, 0.0) - transmission_loss(r, transition, 0.0)
    if 2 * r <= transition:
        assert rise == pytest.approx(20 * math.log10(2), abs=1e-9)
    elif r >= transition:
        assert rise == pytest.approx(10 * math.log10(2), abs=1e-9)
    else:
        assert 3.0 < rise < 6.1


# --- detection ---------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(sonars, st.floats(0, 1e5))
def test_the_equation_term_by_term(sonar, r):
    loss = transmission_loss(r, sonar.transition_range_m, absorption_db_per_km(sonar.frequency_hz) / 1000)
    excess = sonar.source_level_db - sonar.level * loss - sonar.noise_level_db
    assert sonar.signal_excess(r) == pytest.approx(excess, abs=1e-9)
    expected = stats.norm.cdf(excess / sonar.transition_std_db)
    assert sonar.detection_probability(r) == pytest.approx(expected, rel=1e-9, abs=1e-300)


@settings(max_examples=50)
@given(sonars)
def test_farther_is_never_better(sonar):
    probability = sonar.detection_probability(np.geomspace(0.1, 1e6, 300))
    assert (np.diff(probability) <= 0).all() and (probability >= 0).all() and (probability <= 1).all()


def test_gain_and_threshold_count_one_for_one():
    base = PassiveSonar(level=1.0)
    other = PassiveSonar(level=1.0, array_gain_db=7.0, detection_threshold_db=3.0)
    assert other.signal_excess(5000.0) == pytest.approx(base.signal_excess(5000.0) + 4.0)


@given(st.floats(-300, 300), st.floats(0, 1e6))
def test_level_zero_hears_everything(source, r):
    assert PassiveSonar(source_level_db=source).detection_probability(r) == 1.0
    assert PassiveSonar(source_level_db=source).detection_range() == math.inf


def test_without_fluctuations_detection_is_a_step():
    sonar = PassiveSonar(level=1.0, transition_std_db=0.0)
    edge = sonar.detection_range()
    np.testing.assert_array_equal(
        sonar.detection_probability([0.5 * edge, 0.999 * edge, 1.001 * edge, 2 * edge]), [1.0, 1.0, 0.0, 0.0]
    )


@settings(max_examples=50)
@given(sonars, st.floats(0.01, 0.99))
def test_detection_range_is_where_the_probability_is(sonar, probability):
    r = sonar.detection_range(probability)
    if r == 0.0:
        assert sonar.detection_probability(1.0) < probability
    else:
        assert sonar.detection_probability(r) == pytest.approx(probability, abs=1e-6)


def test_the_ordinary_case():
    sonar = PassiveSonar(level=1.0)
    assert sonar.noise_level_db == pytest.approx(ambient_noise_db(1000.0, bandwidth_hz=100.0), abs=0.1)
    assert 6900 < sonar.detection_range() < 7200  # "half is heard at 7 km"


def test_detections_come_at_their_probability_and_take_one_draw_at_every_level():
    words, same = seed_streams(4)[2], seed_streams(4)[2]
    sonar = PassiveSonar(level=1.0).terms()
    r, count = 10_000.0, 4000
    heard = sum(detects(sonar, r, words) for _ in range(count))
    assert stats.binomtest(heard, count, detection_probability(sonar, r)).pvalue > 1e-3
    certain = PassiveSonar().terms()
    assert all(detects(certain, r, same) for _ in range(count))
    assert uniform(words) == uniform(same)


def test_arrays_keep_their_shape_and_equal_the_kernels():
    sonar = PassiveSonar(level=1.0)
    ranges = np.geomspace(1, 1e5, 12).reshape(3, 4)
    probability = sonar.detection_probability(ranges)
    assert probability.shape == (3, 4)
    terms = sonar.terms()
    assert probability[1, 2] == detection_probability(terms, ranges[1, 2])
    assert sonar.signal_excess(ranges)[2, 3] == signal_excess(terms, ranges[2, 3])


# --- thresholds --------------------------------------------------------------------------------------------


def test_detection_index():
    assert detection_index(1e-4) == pytest.approx(3.7190**2, rel=1e-4)
    assert detection_index(0.01, 0.9) == pytest.approx((1.2816 + 2.3263) ** 2, rel=1e-4)


@pytest.mark.parametrize("false_alarm, detection", [(1e-2, 0.5), (1e-3, 0.5), (1e-2, 0.9)])
def test_threshold_against_the_exact_energy_detector(false_alarm, detection):
    """The energy of w t = 20 000 pairs of normal samples is χ²: at the stated SNR it detects as stated."""
    band, time = 1000.0, 20.0
    level = detection_threshold_db(
        detection_index(false_alarm, detection), bandwidth_hz=band, integration_time_s=time
    )
    freedom = 2 * band * time
    threshold = stats.chi2.isf(false_alarm, freedom)
    found = stats.chi2.sf(threshold / (1 + 10 ** (level / 10)), freedom)
    assert found == pytest.approx(detection, abs=0.02)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: PassiveSonar(level=1.5), "level: got 1.5"),
        (lambda: PassiveSonar(source_level_db=math.nan), "source_level_db: got nan"),
        (lambda: PassiveSonar(transition_range_m=0.0), "transition_range_m"),
        (lambda: PassiveSonar(transition_std_db=-1.0), "transition_std_db"),
        (lambda: PassiveSonar(frequency_hz=0.0), "frequency_hz"),
        (lambda: PassiveSonar().detection_probability([-1.0]), "range_m"),
        (lambda: PassiveSonar(level=1.0).detection_range(1.0), "probability: got 1.0"),
        (lambda: detection_index(0.6, 0.5), "false_alarm: got 0.6"),
        (lambda: detection_threshold_db(1.0, bandwidth_hz=0.0, integration_time_s=1.0), "bandwidth_hz"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

"""Summaries and intervals against independent formulas."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluation import statistics


def iqm_by_hand(values):
    """Mean of what is left when int(n / 4) values are cut at either end."""
    ordered = sorted(values)
    cut = len(ordered) // 4
    middle = ordered[cut : len(ordered) - cut]
    return sum(middle) / len(middle)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=60))
@settings(max_examples=100)
def test_summary_matches_the_definitions(values):
    found = statistics.summary(np.array(values))
    n = len(values)
    mean = math.fsum(values) / n
    assert found["n"] == n
    assert found["mean"] == pytest.approx(mean, abs=1e-9)
    assert found["iqm"] == pytest.approx(iqm_by_hand(values), abs=1e-9)
    ordered = sorted(values)
    assert found["median"] == pytest.approx((ordered[(n - 1) // 2] + ordered[n // 2]) / 2, abs=1e-9)
    if n > 1:
        variance = math.fsum((v - mean) ** 2 for v in values) / (n - 1)
        assert found["std"] == pytest.approx(math.sqrt(variance), abs=1e-6)
        low, high = found["ci95"]
        assert min(values) - 1e-9 <= low <= high <= max(values) + 1e-9


def test_values_that_are_not_finite_are_left_out_and_counted_out():
    found = statistics.summary(np.array([1.0, np.nan, 3.0, np.inf]))
    assert (found["n"], found["mean"]) == (2, 2.0)
    empty = statistics.summary(np.array([np.nan]))
    assert empty["n"] == 0 and math.isnan(empty["mean"]) and all(map(math.isnan, empty["ci95"]))


def test_the_interval_of_a_mean_is_near_student_s_and_covers_it():
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(100):
        sample = rng.normal(3.0, 2.0, 60)
        low, high = statistics.interval(sample)
        half = 2.0010 * sample.std(ddof=1) / math.sqrt(60)  # t, 59 degrees of freedom
        assert low == pytest.approx(sample.mean() - half, abs=0.15)
        assert high == pytest.approx(sample.mean() + half, abs=0.15)
        covered += low <= 3.0 <= high
    assert covered >= 87  # of an expected 95; below with probability 0.1 %


def test_a_constant_and_a_single_value():
    assert statistics.interval(np.full(10, 4.0)) == (4.0, 4.0)
    assert all(map(math.isnan, statistics.interval(np.array([4.0]))))


def test_the_interval_of_an_iqm_ignores_an_outlier():
    sample = np.append(np.random.default_rng(1).normal(10, 1, 50), 1e6)
    low, high = statistics.interval(sample, statistics.iqm)
    assert 9 < low < high < 11
    assert statistics.interval(sample)[1] > 1e4


def test_intervals_are_repeatable():
    sample = np.random.default_rng(2).exponential(size=30)
    assert statistics.interval(sample) == statistics.interval(sample)


@pytest.mark.parametrize("successes, n", [(0, 20), (20, 20), (97, 100), (1, 3)])
def test_a_share_has_wilson_s_interval(successes, n):
    values = np.array([1.0] * successes + [0.0] * (n - successes))
    z, p = 1.959963984540054, successes / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = statistics.proportion_interval(values)
    assert low == pytest.approx(max(middle - half, 0), abs=1e-9)
    assert high == pytest.approx(min(middle + half, 1), abs=1e-9)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=2, max_size=40))
@settings(max_examples=50)
def test_paired_differences_and_probability_of_improvement(pairs):
    a, b = (np.array(column, dtype=float) for column in zip(*pairs, strict=True))
    found = statistics.paired(a, b, less_is_better=True)
    wins = sum(x < y for x, y in pairs)
    ties = sum(x == y for x, y in pairs)
    assert found["probability_of_improvement"] == pytest.approx((wins + ties / 2) / len(pairs))
    assert found["difference"] == pytest.approx(sum(x - y for x, y in pairs) / len(pairs))
    mirrored = statistics.paired(b, a, less_is_better=True)
    assert mirrored["probability_of_improvement"] == pytest.approx(1 - found["probability_of_improvement"])
    assert statistics.paired(-a, -b, less_is_better=False)["probability_of_improvement"] == pytest.approx(
        found["probability_of_improvement"]
    )


def test_pairing_removes_what_the_seeds_have_in_common():
    rng = np.random.default_rng(3)
    hard = rng.normal(30, 20, 80)
    a, b = hard + rng.normal(0, 0.5, 80), hard + 1.0 + rng.normal(0, 0.5, 80)
    found = statistics.paired(a, b, less_is_better=True)
    assert found["ci95"][1] < 0, "a is better by 1 on every seed: the interval must exclude 0"
    assert found["ci95"][1] - found["ci95"][0] < 0.5 < np.ptp(statistics.interval(a)) / 2


def test_pairs_need_both_values():
    a, b = np.array([1.0, np.nan, 3.0]), np.array([2.0, 2.0, np.nan])
    assert statistics.paired(a, b, less_is_better=True)["n"] == 1
    nothing = statistics.paired(a[1:2], b[1:2], less_is_better=True)
    assert nothing["n"] == 0 and math.isnan(nothing["difference"])

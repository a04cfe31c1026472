"""Emissions: pings at their times, holding times by distribution, no dependence on the time step."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.randomness import seed_streams
from aquaquad_envs.sensing.emissions import Emissions, advance_emission, start_emission


@loop_kernel
def steps(terms, start, step, stream, heard, when):
    nominal, next_time, on = start_emission(terms, start, stream)
    for i in range(heard.size):
        heard[i], when[i], nominal, next_time, on = advance_emission(
            terms, start + (i + 1) * step, nominal, next_time, on, stream
        )


def run(emissions, *, step, count, seed=0, start=0.0):
    heard, when = np.zeros(count, dtype=bool), np.zeros(count)
    steps(emissions.terms(), start, step, seed_streams(seed)[3], heard, when)
    return heard, when


def test_always_is_heard_at_the_end_of_every_step():
    heard, when = run(Emissions(), step=5.0, count=20, start=100.0)
    assert heard.all()
    np.testing.assert_array_equal(when, 105.0 + 5.0 * np.arange(20))


@settings(max_examples=50)
@given(st.floats(2.0, 500.0), st.integers(0, 1000))
def test_pings_without_jitter_keep_time(period, seed):
    heard, when = run(Emissions(kind="periodic", period_s=period), step=1.0, count=3000, seed=seed)
    pings = when[heard]
    np.testing.assert_allclose(np.diff(pings), period, rtol=1e-9)
    assert 0 <= pings[0] < period
    assert len(pings) == 1 + math.floor((3000 - pings[0]) / period)


@settings(max_examples=50)
@given(st.floats(2.0, 100.0), st.floats(0, 1), st.integers(0, 1000))
def test_jittered_pings_stay_in_order_and_in_step(period, jitter, seed):
    heard, when = run(
        Emissions(kind="periodic", period_s=period, jitter=jitter), step=1.0, count=3000, seed=seed
    )
    end = np.arange(1, 3001)
    assert ((when > end - 1) & (when <= end))[heard].all()
    pings = when[heard]
    gaps = np.diff(pings)
    if period * (1 - jitter) > 1.0:  # else two may fall into one step
        assert (np.abs(gaps - period) <= jitter * period + 1e-9).all()
        # Jitter does not add up: the clock behind it keeps time.
        assert abs(pings[-1] - pings[0] - period * (len(pings) - 1)) <= jitter * period + 1e-9
    assert (gaps > 0).all()


def test_jitter_is_uniform_and_the_phase_too():
    emissions = Emissions(kind="periodic", period_s=10.0, jitter=0.6)
    heard, when = run(emissions, step=1.0, count=40_000)
    pings = when[heard]
    offset = pings - 10.0 * np.arange(len(pings))
    centre = (offset.max() + offset.min()) / 2
    assert stats.kstest((offset - centre) / 6.0 + 0.5, "uniform").pvalue > 1e-3
    first = [
        run(Emissions(kind="periodic", period_s=10.0), step=10.0, count=1, seed=s)[1][0] for s in range(300)
    ]
    assert stats.kstest(np.array(first) / 10.0, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("kind", ["periodic", "random"])
def test_no_dependence_on_the_time_step(kind):
    emissions = Emissions(kind=kind, period_s=50.0, jitter=0.5, mean_on_s=30.0, mean_off_s=70.0)
    fine, fine_when = run(emissions, step=1.0, count=7000, seed=5)
    coarse, coarse_when = run(emissions, step=7.0, count=1000, seed=5)
    if kind == "periodic":
        np.testing.assert_array_equal(fine_when[fine], coarse_when[coarse])
    else:
        np.testing.assert_array_equal(fine[6::7], coarse)


def test_random_sources_hold_for_exponential_times():
    heard, _ = run(Emissions(kind="random", mean_on_s=300.0, mean_off_s=900.0), step=1.0, count=1_500_000)
    edges = np.flatnonzero(np.diff(heard.astype(int)))
    spans = (
        np.diff(edges) + stats.uniform.rvs(size=len(edges) - 1, random_state=0) - 0.5
    )  # whole steps, spread
    first_on = bool(heard[edges[0] + 1])
    on, off = (spans[0::2], spans[1::2]) if first_on else (spans[1::2], spans[0::2])
    assert min(len(on), len(off)) > 1000
    assert stats.kstest(on, "expon", args=(0, 300)).pvalue > 1e-3
    assert stats.kstest(off, "expon", args=(0, 900)).pvalue > 1e-3


def test_random_sources_start_in_equilibrium():
    """On with probability a quarter from the first step on, however long the step."""
    emissions = Emissions(kind="random", mean_on_s=300.0, mean_off_s=900.0)
    runs = np.array([run(emissions, step=200.0, count=4, seed=s)[0] for s in range(2000)])
    for column in runs.T:
        assert stats.binomtest(int(column.sum()), 2000, 0.25).pvalue > 1e-3
    # And the correlation in time of a two-state process: p + (1 - p) exp(-t (1/on + 1/off)).
    again = runs[runs[:, 0], 1]
    expected = 0.25 + 0.75 * math.exp(-200 * (1 / 300 + 1 / 900))
    assert stats.binomtest(int(again.sum()), len(again), expected).pvalue > 1e-3


def test_never_off_is_always():
    heard, _ = run(Emissions(kind="random", mean_off_s=0.0), step=1.0, count=100)
    assert heard.all()


def test_seeds_replay():
    emissions = Emissions(kind="random", mean_on_s=20.0, mean_off_s=20.0)
    first, second, other = (run(emissions, step=1.0, count=500, seed=s)[0] for s in (1, 1, 2))
    assert (first == second).all() and (first != other).any()


@pytest.mark.parametrize(
    "settings_, words",
    [
        ({"kind": "periodical"}, "Did you mean 'periodic'"),
        ({"period_s": 0.0}, "period_s: got 0.0"),
        ({"jitter": 1.1}, "jitter: got 1.1"),
        ({"mean_on_s": 0.0}, "mean_on_s"),
        ({"mean_off_s": math.nan}, "mean_off_s: got nan"),
    ],
)
def test_refusals_say_why(settings_, words):
    with pytest.raises(InvalidParameterError, match=words):
        Emissions(**settings_)

"""Placement by local optimisation: bounds in closed form, optima that reach them, published experiment."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.hdop import even_spread_hdop, hdop, two_sensor_hdop
from evaluation.placement import largest_gap, least_hdop, place
from evaluation.published_placement import STANDOFF_M, reproduce_placement
from evaluation.published_values import PLACEMENT

RANGES = st.lists(st.floats(10.0, 1e4), min_size=3, max_size=8)


def ring(angles, ranges):
    return np.asarray(ranges)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


@given(ranges=RANGES, seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["range", "bearing", "tdoa"]))
@settings(max_examples=60, deadline=None)
def test_no_directions_are_better_than_the_bound(ranges, seed, kind):
    draw = np.random.default_rng(seed)
    least = least_hdop(kind, ranges)
    for _ in range(20):
        angles = draw.uniform(0, 2 * np.pi, len(ranges))
        assert hdop(kind, ring(angles, ranges), [0.0, 0.0]) >= least * (1 - 1e-9)


@given(ranges=RANGES, seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_the_bound_of_bearings_is_reached_at_those_ranges(ranges, seed):
    """By an independent search over the directions alone, from several starts."""
    from scipy.optimize import minimize

    draw = np.random.default_rng(seed)
    weights = 1.0 / np.asarray(ranges) ** 2

    def excess(angles):
        return abs(weights @ np.exp(2j * angles)) ** 2 / weights.sum() ** 2

    best = min(
        (minimize(excess, draw.uniform(0, np.pi, len(ranges)), options={"gtol": 1e-12}) for _ in range(6)),
        key=lambda found: found.fun,
    )
    reached = hdop("bearing", ring(best.x, ranges), [0.0, 0.0])
    assert reached == pytest.approx(least_hdop("bearing", ranges), rel=1e-3)


def test_the_bound_agrees_with_the_published_ones():
    for count in (3, 5, 8):
        assert least_hdop("range", np.linspace(10, 500, count)) == pytest.approx(2 / np.sqrt(count))
        assert least_hdop("bearing", [700.0] * count) == pytest.approx(2 * 700 / np.sqrt(count))
        assert least_hdop("tdoa", [700.0] * count) == even_spread_hdop("tdoa", count)
    # Two sensors do best at a right angle.
    right = [[300.0, 0.0], [0.0, 400.0]]
    for kind in ("range", "bearing"):
        assert least_hdop(kind, [300.0, 400.0]) == pytest.approx(
            float(two_sensor_hdop(kind, right, [0.0, 0.0]))
        )


def test_one_near_sensor_leaves_the_other_direction_to_the_others():
    """As r₁ → 0 the bound tends to that of the others' own strength, 1/√(Σ 1/r²), not to 0."""
    others = np.array([500.0, 700.0, 900.0])
    limit = 1 / np.sqrt(np.sum(others**-2.0))
    for near in (1.0, 1e-3, 1e-9):
        assert least_hdop("bearing", [near, *others]) == pytest.approx(limit, rel=1e-4)


@pytest.mark.parametrize("kind, centre", [("range", 180.0), ("tdoa", 0.0)])
def test_a_local_optimum_is_the_global_one(kind, centre):
    """Of ranges from a cluster on one side too; of TDOA from around the target."""
    draw = np.random.default_rng(3)
    for _ in range(4):
        start = centre + ring(2 * np.pi * np.arange(5) / 5, [100.0] * 5) + draw.normal(0, 20, (5, 2))
        found = place(kind, start)
        assert found.hdop == pytest.approx(even_spread_hdop(kind, 5), rel=1e-5)
        assert found.path_hdop[0] == pytest.approx(float(hdop(kind, start, [0.0, 0.0])))
        assert found.hdop == pytest.approx(found.path_hdop[-1]) and found.converged
        np.testing.assert_array_equal(found.path[-1], found.sensors)


def test_the_standoff_is_kept_and_used_up():
    draw = np.random.default_rng(1)
    target = np.array([-3000.0, 2000.0])
    start = target + draw.normal(0, 400, (6, 2))
    found = place("bearing", start, target, standoff_m=150.0)
    ranges = np.hypot(*(found.sensors - target).T)
    assert ranges.min() >= 150.0 * (1 - 1e-12)
    assert found.hdop == pytest.approx(even_spread_hdop("bearing", 6, range_m=150.0), rel=1e-4)
    assert (np.diff(found.path_hdop) <= 1e-9 * found.path_hdop[:-1]).all()


def test_bearings_without_a_standoff_run_onto_the_target():
    start = ring(2 * np.pi * np.arange(8) / 8 + 0.1 * np.sin(np.arange(8)), [1000.0] * 8)
    found = place("bearing", start)
    ranges = np.sort(np.hypot(*found.sensors.T))
    # One sensor fixes one direction only: it takes two.
    assert found.hdop < 1.0 and ranges[1] < 1.0


def test_the_widest_gap():
    assert largest_gap([[1, 0], [0, 1], [-1, 0], [0, -1]]) == pytest.approx(np.pi / 2)
    assert largest_gap(np.array([[2, 0], [1, 1], [0, 3]]) + 5.0, [5.0, 5.0]) == pytest.approx(1.5 * np.pi)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: place("rnage", np.eye(3, 2)), "Did you mean 'range'"),
        (lambda: place("range", [[1.0, 0.0], [0.0, 1.0]]), "N at least 3"),
        (lambda: place("range", [[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]), "finite HDOP"),
        (lambda: place("range", np.eye(3, 2), standoff_m=-1.0), "standoff_m: got -1"),
        (lambda: least_hdop("bearing", [1.0]), "at least two"),
        (lambda: least_hdop("bearing", [1.0, 0.0, 2.0]), "positive"),
    ],
)
def test_wrong_input_is_refused(call, message):
    with pytest.raises(InvalidParameterError, match=message):
        call()


def test_the_published_experiment():
    table, ways = reproduce_placement(0)
    rows = {(row["kind"], row["start"], row["standoff_m"]): row for row in table["rows"]}
    assert len(rows) == 6 and len(ways) == 6
    for row in rows.values():
        assert len(row["begin"]) == len(row["end"]) == PLACEMENT["tries"]
        # Nothing beats the global optimum, nor the best directions at its own ranges.
        assert min(row["end"]) >= row["global"] * (1 - 1e-9)
        assert (np.array(row["end"]) >= np.array(row["least_at_last_ranges"]) * (1 - 1e-6)).all()
        assert (np.array(row["end"]) < np.array(row["begin"])).all()
    for start in ("even", "clustered"):
        assert rows["range", start, 0.0]["end"] == pytest.approx([2 / np.sqrt(8)] * 5, rel=1e-5)
        # Steps along the tangent lengthen ranges, though nothing is gained by it.
        assert rows["range", start, 0.0]["range_growth"]["mean"] > 1
        assert rows["bearing", start, STANDOFF_M]["end"] == pytest.approx(
            [2 * STANDOFF_M / np.sqrt(8)] * 5, rel=1e-3
        )
        assert min(rows["bearing", start, 0.0]["on_target"]) >= 1
    # Same starts, so what differs is the measurement.
    np.testing.assert_array_equal(ways["range even 0"][2].path[0], ways["bearing even 0"][2].path[0])

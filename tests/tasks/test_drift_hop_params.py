"""Parameters of drift/hop: defaults as published, bad values refused by name."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.tasks import drift_hop
from aquaquad_envs.tasks.drift_hop import Params

BOUNDS = {name: (low, high, open_low) for name, low, high, open_low in drift_hop._BOUNDS}


def test_published_defaults():
    p = Params()
    assert (p.half_width_m, p.goal_radius_m) == (5000.0, 100.0)
    assert p.max_hop_m / p.airspeed_m_s == pytest.approx(120.0)
    assert p.airspeed_m_s == pytest.approx(40_000 / 3600)
    assert p.action_period_s / p.sub_steps == 60.0
    assert (p.flight_power_w, p.base_power_w, p.battery_wh) == (200.0, 7.5, 178.0)
    assert p.team == ((5000.0, 5000.0), (5000.0, -5000.0), (-5000.0, -5000.0))
    assert Params(energy="2016").flight_power_w == 340.0
    assert Params(energy="2016", flight_power_w=100.0).flight_power_w == 100.0
    assert Params(scenario="gyres").team == ()
    assert Params(scenario="gyres", half_width_m=8000.0).half_width_m == 8000.0


def test_parameters_are_frozen_keyword_only_and_hashable():
    assert hash(Params()) == hash(Params())
    assert Params(team=[[1, 2]]) == Params(team=((1.0, 2.0),))
    with pytest.raises(dataclasses.FrozenInstanceError):
        Params().sub_steps = 3
    with pytest.raises(TypeError):
        Params("vortex")
    assert pickle.loads(pickle.dumps(Params(scenario="gyres"))) == Params(scenario="gyres")


def test_every_number_has_a_bound():
    numbers = {f.name for f in dataclasses.fields(Params) if f.type in ("float", "int", "float | None")}
    assert numbers == set(BOUNDS) - {"x"}


@st.composite
def bad_numbers(draw):
    name = draw(st.sampled_from(sorted(BOUNDS)))
    low, high, open_low = BOUNDS[name]
    bad = [
        st.just(math.nan), st.just(math.inf), st.just(-math.inf), st.just("10"), st.just(True), st.just([1.0]),
        st.floats(max_value=low, exclude_max=not open_low, allow_nan=False),
        st.floats(min_value=high, exclude_min=True, allow_nan=False),
    ]  # fmt: skip
    if name not in ("half_width_m", "horizon_s", "flight_power_w", "base_power_w", "battery_wh"):
        bad.append(st.none())
    return name, draw(st.one_of(bad))


@settings(max_examples=200)
@given(bad_numbers())
def test_numbers_out_of_bounds_are_named(pair):
    name, value = pair
    with pytest.raises(InvalidParameterError) as raised:
        Params(**{name: value})
    assert raised.value.name == name
    assert str(raised.value).startswith(f"{name}: got {value!r}, expected ")


@pytest.mark.parametrize("cast", [np.float32, np.float64, np.int64])
def test_numpy_scalars_are_numbers(cast):
    assert Params(horizon_s=cast(7200)).horizon_s == 7200
    assert Params(sub_steps=np.int64(5)).sub_steps == 5


@pytest.mark.parametrize(
    "values, words",
    [
        ({"scenario": "vortx"}, "scenario: got 'vortx'.*Did you mean 'vortex'"),
        ({"scenario": None}, "scenario: got None"),
        ({"energy": "2015"}, "energy: got '2015', expected one of 2014, 2016"),
        ({"integrator": "RK4"}, "integrator: got 'RK4'"),
        ({"interpolation": "bilinar"}, "Did you mean 'bilinear'"),
        ({"solar": "clear_sky"}, "Did you mean 'clear-sky'"),
        ({"solar": "file"}, "solar_file: got None, expected the path"),
        ({"action_type": "box"}, "action_type: got 'box'"),
        ({"sub_steps": 2.5}, "sub_steps: got 2.5, expected a whole number"),
        ({"obstacles": [[0, 0, 1]]}, "obstacles: got .*4 finite numbers each"),
        ({"obstacles": "square"}, "obstacles: got 'square'"),
        ({"obstacles": [[0, 0, 1, 1], [2]]}, "obstacles: got"),
        ({"team": [[0, np.nan]]}, "team: got .*2 finite numbers each"),
        ({"team": 5.0}, "team: got 5.0"),
        ({"target_offset": (1.0,)}, "target_offset: got .*two finite numbers"),
        ({"target_offset": (1.0, np.inf)}, "target_offset"),
        ({"target_offset": None}, "target_offset: got None"),
        ({"currents_center": "Monterey"}, "currents_center: got 'Monterey'"),
        ({"half_width_m": 4000.0}, "half_width_m: got 4000.0.*vortex"),
        ({"half_width_m": 90_000.0}, "half_width_m: got 90000.0.*vortex"),
    ],
)
def test_refusals_say_why(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        Params(**values)


@pytest.mark.parametrize(
    "values, words",
    [
        ({"obstacles": [[5, 0, 1, 1]]}, r"rectangles\[0\].*min < max"),
        ({"start_time": "yesterday"}, "start_time: got 'yesterday'"),
        ({"scenario": "file"}, "currents_file: got None"),
        (
            {"solar": "file", "solar_file": "nowhere.csv"},
            "solar_file: got 'nowhere.csv', expected an existing file",
        ),
        (
            {"scenario": "gyres", "num_fields": 1, "obstacles": [[-5e3, -5e3, 5e3, 5e3]]},
            "obstacles: got .*room for",
        ),
        ({"action_periods_s": 60.0}, "action_periods_s.*Did you mean 'action_period_s'"),
        ({"threads": 0}, "threads: got 0"),
        ({"num_worlds": 0}, "num_worlds: got 0"),
        ({"num_worlds": 2.0}, "num_worlds: got 2.0"),
    ],
)
def test_what_only_building_can_tell_is_refused_too(values, words):
    with pytest.raises(AquaQuadError, match=words):
        aquaquad_envs.make_world_batch("drift-hop", **{"num_worlds": 1, **values})


def test_an_unknown_task_is_refused():
    with pytest.raises(InvalidParameterError, match=r"task: got 'drift_hop'.*Did you mean 'drift-hop'"):
        aquaquad_envs.make_world_batch("drift_hop", 1)

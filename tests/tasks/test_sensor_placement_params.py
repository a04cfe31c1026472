"""Parameters of sensor placement: defaults as stated, bad values refused by name."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.tasks import sensor_placement_params
from aquaquad_envs.tasks.sensor_placement import Params

BOUNDS = {name: (low, high, open_low) for name, low, high, open_low in sensor_placement_params._BOUNDS}


def test_published_defaults():
    p = Params()
    assert (p.num_vehicles, p.num_targets, p.measurement, p.tracker) == (4, 1, "tdoa", "ukf")
    assert p.action_period_s / p.sub_steps == 60.0
    assert p.max_hop_m / p.airspeed_m_s == pytest.approx(120.0)
    assert p.tdoa_std_s == pytest.approx(1.414e-3, rel=1e-3)
    assert p.bearing_std_rad == pytest.approx(0.1414, rel=1e-3)
    assert (p.flight_power_w, p.base_power_w, p.battery_wh) == (200.0, 7.5, 178.0)
    assert (p.noise_level, p.detection_level, p.travel_time_level, p.sharing_delay_s, p.dropout) == (0,) * 5
    grid = Params(scenario="grid")
    assert (grid.num_vehicles, grid.num_targets, grid.measurement, grid.vehicle_speed_m_s) == (
        3,
        3,
        "range",
        1.0,
    )
    assert grid.target_speed_m_s < grid.vehicle_speed_m_s
    assert Params(scenario="grid", num_vehicles=1, num_targets=1).num_vehicles == 1


def test_the_fence_is_as_long_as_its_density_asks():
    assert Params(scenario="fence").fence_length_m == pytest.approx(6000.0)
    assert Params(scenario="fence", fence_density_per_km=1.0, num_vehicles=5).fence_length_m == pytest.approx(
        5000.0
    )
    assert Params(scenario="fence", fence_density_per_km=1.0).fence_cover_m == pytest.approx(600.0)


def test_parameters_are_frozen_keyword_only_and_hashable():
    assert hash(Params()) == hash(Params())
    assert Params(obstacles=[[0, 0, 1, 1]]) == Params(obstacles=((0.0, 0.0, 1.0, 1.0),))
    with pytest.raises(dataclasses.FrozenInstanceError):
        Params().sub_steps = 3
    with pytest.raises(TypeError):
        Params("vortex")
    assert pickle.loads(pickle.dumps(Params(scenario="grid"))) == Params(scenario="grid")


def test_every_number_has_a_bound():
    numbers = {
        f.name for f in dataclasses.fields(Params) if f.type in ("float", "int", "float | None", "int | None")
    }
    assert numbers == set(BOUNDS)


@st.composite
def bad_numbers(draw):
    name = draw(st.sampled_from(sorted(BOUNDS)))
    low, high, open_low = BOUNDS[name]
    bad = [
        st.just(math.nan), st.just(math.inf), st.just(-math.inf), st.just("10"), st.just(True), st.just([1.0]),
        st.floats(max_value=low, exclude_max=not open_low, allow_nan=False),
        st.floats(min_value=high, exclude_min=True, allow_nan=False),
    ]  # fmt: skip
    field = {f.name: f for f in dataclasses.fields(Params)}[name]
    if "None" not in field.type:
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


@pytest.mark.parametrize("name", sorted(sensor_placement_params._CHOICES))
def test_words_that_are_no_choice_are_named(name):
    with pytest.raises(InvalidParameterError, match=f"{name}: got 'nonsense', expected one of "):
        Params(**{name: "nonsense"})


@pytest.mark.parametrize(
    "values, words",
    [
        ({"scenario": "clam"}, "scenario: got 'clam'.*Did you mean 'calm'"),
        ({"energy": "2015"}, "energy: got '2015'"),
        ({"measurement": "toda"}, "Did you mean 'tdoa'"),
        ({"num_vehicles": 2}, "num_vehicles: got 2, expected 3 to 8.*grid"),
        ({"num_vehicles": 4.0}, "num_vehicles: got 4.0, expected a whole number"),
        ({"num_targets": 0}, "num_targets: got 0, expected 1 to 5.*fence"),
        ({"scenario": "grid", "measurement": "tdoa"}, "measurement: got 'tdoa', expected 'range'"),
        ({"action_period_s": 60.0}, "max_hop_m: got 1333.*at most 666.*synchronous"),
        (
            {"scenario": "fence", "num_vehicles": 8, "fence_density_per_km": 0.5},
            "fence_density_per_km: got 0.5",
        ),
        ({"solar": "file"}, "solar_file: got None"),
        ({"obstacles": [[0, 0, 1]]}, "obstacles: got .*4 finite numbers each"),
        ({"obstacles": "square"}, "obstacles: got 'square'"),
        ({"currents_center": "Monterey"}, "currents_center: got 'Monterey'"),
        ({"half_width_m": 4000.0}, "half_width_m: got 4000.0.*vortex"),
    ],
)
def test_refusals_say_why(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        Params(**values)


@pytest.mark.parametrize(
    "values, words",
    [
        ({"start_time": "yesterday"}, "start_time: got 'yesterday'"),
        ({"scenario": "file"}, "currents_file: got None"),
        ({"scenario": "calm", "obstacles": [[5, 0, 1, 1]]}, r"rectangles\[0\].*min < max"),
        ({"dropuot": 0.5}, "dropuot.*Did you mean 'dropout'"),
    ],
)
def test_what_only_building_can_tell_is_refused_too(values, words):
    with pytest.raises(AquaQuadError, match=words):
        aquaquad_envs.make_world_batch("sensor-placement", **{"num_worlds": 1, **values})


@pytest.mark.parametrize("cast", [np.float32, np.float64, np.int64])
def test_numpy_scalars_are_numbers(cast):
    assert Params(horizon_s=cast(7200)).horizon_s == 7200
    assert Params(num_vehicles=np.int64(5)).num_vehicles == 5

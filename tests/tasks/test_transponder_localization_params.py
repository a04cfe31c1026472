"""Parameters of transponder localization: defaults as published, bad values refused by name."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.tasks import transponder_localization_params
from aquaquad_envs.tasks.transponder_localization import Params, build

BOUNDS = {
    name: (low, high, open_low) for name, low, high, open_low in transponder_localization_params._BOUNDS
}


def test_published_defaults():
    p = Params()
    assert (p.scenario, p.vehicle, p.num_measurements, p.period_s) == ("single", "yaw-rate", 30, 1.0)
    assert (p.speed_m_s, p.yaw_rate_limit_deg_s, p.max_step_m, p.range_std_m) == (3.0, 30.0, 5.0, 0.12)
    assert (p.start, p.start_heading_deg, p.prior_std_m) == ((-3.0, 9.0), -30.0, (100.0, 100.0, 2.0))
    field = Params(scenario="field")
    assert (field.range_std_m, field.max_step_m, field.start_heading_deg) == (1.006, 10.0, 13.0)
    assert (p.outlier_share, p.miss_share, p.sound_speed_error, p.robust_threshold, p.current_noise_m_s) == (
        0,
    ) * 5
    constants = build(p)[1]
    assert constants.prior_information == pytest.approx([1e-4, 0, 0, 1e-4, 0, 0.25])
    assert constants.yaw_limit == pytest.approx(np.pi / 6) and constants.step_length == 3.0


def test_large_scenarios_keep_turns_and_steps_in_proportion():
    deep = Params(scenario="deep")
    assert deep.yaw_rate_limit_deg_s * deep.period_s == pytest.approx(30.0)
    hops = Params(scenario="deep", vehicle="aquaquad")
    assert hops.period_s == 300.0 and hops.horizon_s == 29 * 300.0
    assert Params(scenario="deep", vehicle="aquaquad", period_s=200.0).period_s == 200.0
    assert build(deep)[1].fewest == 1 and build(deep)[1].most == 6


def test_parameters_are_frozen_keyword_only_and_hashable():
    assert hash(Params()) == hash(Params())
    assert Params(transponders=[[0, 0, 1]], start=[1, 2]) == Params(
        transponders=((0.0, 0.0, 1.0),), start=(1.0, 2.0)
    )
    with pytest.raises(dataclasses.FrozenInstanceError):
        Params().speed_m_s = 2.0
    with pytest.raises(TypeError):
        Params("single")
    assert pickle.loads(pickle.dumps(Params(scenario="four"))) == Params(scenario="four")


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


@pytest.mark.parametrize(
    "values, words",
    [
        ({"scenario": "singel"}, "scenario: got 'singel'.*Did you mean 'single'"),
        ({"vehicle": "yawrate"}, "vehicle: got 'yawrate'.*Did you mean 'yaw-rate'"),
        ({"integrator": "rk5"}, "integrator: got 'rk5'"),
        (
            {"num_transponders": 2},
            "num_transponders: got 2, expected a whole number, 1 to 1.*places are given",
        ),
        (
            {"scenario": "random", "num_transponders": 2.5},
            "num_transponders: got 2.5, expected a whole number",
        ),
        ({"num_measurements": 3.5}, "num_measurements: got 3.5, expected a whole number"),
        ({"transponders": ((0, 0, -1),)}, "transponders: got .*positive down"),
        ({"transponders": ((0, 0, 1),) * 7}, "transponders: got '7 of them', expected at most 6"),
        ({"transponders": ((0, 0),)}, "transponders: got .*3 finite numbers each"),
        ({"transponders": "here"}, "transponders: got 'here'"),
        ({"start": (0, 0, 0)}, "start: got .*two finite numbers"),
        ({"depth_m": (5, 2)}, "depth_m: got .*least <= greatest"),
        ({"depth_m": (5, math.nan)}, "depth_m: got .*2 finite numbers"),
        ({"prior_std_m": (1, 1)}, "prior_std_m: got .*3 finite numbers"),
        ({"prior_std_m": (1, 1, 0)}, "prior_std_m: got .*numbers in"),
        ({"range_std_m": 1e-3}, "prior_std_m: got .*worse than a range"),
        ({"vehicle": "aquaquad"}, "max_hop_m: got 1333.*width of the box.*deep"),
        ({"scenario": "deep", "vehicle": "aquaquad", "period_s": 60.0}, "max_hop_m: got 1333.*at most 666"),
        ({"solar": "file"}, "solar_file: got None"),
    ],
)
def test_refusals_say_why(values, words):
    with pytest.raises(InvalidParameterError, match=words):
        Params(**values)


@pytest.mark.parametrize(
    "values, words",
    [
        ({"scenario": "file"}, "currents_file: got None"),
        ({"mis_share": 0.5}, "mis_share.*Did you mean 'miss_share'"),
        ({"obstacles": [[5, 0, 1, 1]]}, r"rectangles\[0\].*min < max"),
    ],
)
def test_what_only_building_can_tell_is_refused_too(values, words):
    with pytest.raises(AquaQuadError, match=words):
        aquaquad_envs.make_world_batch("transponder-localization", **{"num_worlds": 1, **values})


def test_real_currents_carry_and_land_is_left_alone(tmp_path):
    pytest.importorskip("netCDF4")
    from aquaquad_envs.physics.obstacles import clearance_at
    from tests.physics.current_file_makers import CENTER, plain

    path = tmp_path / "currents.nc"
    plain(path)
    batch = aquaquad_envs.make_world_batch(
        "transponder-localization", 16, scenario="file", currents_file=str(path), currents_center=CENTER,
        half_width_m=5000.0, num_fields=4, speed_m_s=0.0,
    )  # fmt: skip
    batch.reset(0)
    w, ocean = batch.worlds, batch.ocean
    for i in range(16):
        for m in range(w["num_transponders"][i]):
            x, y, _ = w["target"][i, m]
            assert clearance_at(ocean.clearance, int(w["obstacle"][i]), ocean.clearance_grid, x, y) > 0
    batch.step(np.zeros((16, 1)))
    assert np.hypot(w["x"] - w["start_x"], w["y"] - w["start_y"]).max() > 0

"""Parameters of plume tracing: defaults as stated, bad values refused by name."""

import dataclasses

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks import plume_tracing_params
from aquaquad_envs.tasks.plume_tracing_currents import build_ocean
from aquaquad_envs.tasks.plume_tracing_data import WORLD
from aquaquad_envs.tasks.plume_tracing_params import Params
from aquaquad_envs.tasks.task import load_task

BOUNDS = {name: (low, high, open_low) for name, low, high, open_low in plume_tracing_params._BOUNDS}


@pytest.mark.parametrize("scenario", plume_tracing_params.SCENARIOS)
def test_defaults_of_every_scenario_are_complete(scenario):
    params = Params(scenario=scenario)
    left = [field.name for field in dataclasses.fields(params) if getattr(params, field.name) is None]
    assert left == ["comm_radius_m"]
    assert params.plume_age_s == params.num_puffs * params.release_period_s


def test_every_number_has_bounds_and_keeps_them():
    numbers = {
        f.name for f in dataclasses.fields(Params) if isinstance(getattr(Params(), f.name), int | float)
    }
    assert numbers - {"surface_bound", "stop_at_source"} <= set(BOUNDS)
    for name, (low, high, open_low) in BOUNDS.items():
        for value in (low - 1.0, high * 2 + 1, float("nan"), "many", *((low,) if open_low else ())):
            with pytest.raises(InvalidParameterError, match=name):
                Params(**{name: value})


@pytest.mark.parametrize("name", [*sorted(plume_tracing_params._CHOICES), "scenario"])
def test_choices_are_refused_with_what_there_is(name):
    with pytest.raises(InvalidParameterError, match=name):
        Params(**{name: "nothing"})


@pytest.mark.parametrize(
    "values, name",
    [
        ({"num_robots": 4.5}, "num_robots"), ({"surface_bound": 1}, "surface_bound"),
        ({"scenario": "surround", "source_depth_m": 25.0}, "source_depth_m"),
        ({"scenario": "surround", "start_height_m": 9.5}, "start_height_m"),
        ({"scenario": "corner", "start_radius_m": 60.0}, "start_radius_m"),
        ({"start_radius_m": 60.0}, "start_radius_m"), ({"current": "still"}, "layout"),
        ({"layout": "scattered", "source_spread_m": 50.0}, "source_spread_m"),
    ],
)  # fmt: skip
def test_what_does_not_go_together_is_refused_by_name(values, name):
    with pytest.raises(InvalidParameterError, match=name):
        Params(**values)


def test_records_have_no_gaps_that_a_copy_would_lose():
    assert WORLD.itemsize == sum(WORLD[name].itemsize for name in WORLD.names) and WORLD.isalignedstruct


def test_unknown_names_are_answered_with_the_nearest():
    with pytest.raises(InvalidParameterError, match="Did you mean 'num_robots'"):
        load_task("plume-tracing").make_params(num_robot=3)


@pytest.mark.parametrize("current", plume_tracing_params.CURRENTS)
def test_currents(current):
    layout = "scattered" if current == "still" else "downstream"
    params = Params(current=current, layout=layout, num_fields=6, current_variation=0.5)
    ocean = build_ocean(params)
    assert len(ocean.velocity) == (1 if current == "still" else 6) and np.isfinite(ocean.velocity).all()
    speed = np.hypot(ocean.velocity[..., 0], ocean.velocity[..., 1])
    if current == "still":
        assert not speed.any()
        return
    assert ocean.velocity.shape[1] > 1 and 0.05 < speed.mean() < 1.0
    ends = ocean.axes.time0 + ocean.axes.time_step * (ocean.velocity.shape[1] - 1)
    assert (
        ends
        >= params.plume_age_s + params.start_time_spread_s + params.horizon_updates * params.update_period_s
    )
    if current == "stream":
        mean = ocean.velocity.mean((1, 2, 3))
        assert np.hypot(*mean.T).min() > 0.08 and np.hypot(*mean.T).max() < 0.32
        eddies = ocean.velocity - mean[:, None, None, None]
        share = np.sqrt((eddies**2).sum(-1).mean((1, 2, 3))) / np.hypot(*mean.T)
        assert 0.25 < share.mean() < 0.75

"""Hold: stays about its start, returns when carried off, and flies no more than that takes."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy


def sea(u, v, **params):
    """One team in a uniform current, without obstacles."""
    batch = aquaquad_envs.make_world_batch("sensor-placement", 1, scenario="vortex", obstacles=(), **params)
    velocity = np.empty_like(batch.ocean.velocity)
    velocity[..., 0], velocity[..., 1] = u, v
    batch.ocean = batch.ocean._replace(velocity=velocity)
    batch.reset(0)
    return batch


def put(batch, i, x, y):
    batch.worlds["x"][0, i], batch.worlds["y"][0, i] = x, y


def test_it_drifts_within_its_radius_and_hops_back_beyond_it():
    batch = sea(0.0, 0.0)
    batch.worlds["start_x"][0, :4], batch.worlds["start_y"][0, :4] = 0.0, 0.0
    for i, x in enumerate((0.0, 200.0, 260.0, 3000.0)):
        put(batch, i, x, 0.0)
    action = make_policy("hold", batch, radius_m=250.0).act(batch.observations, batch.worlds)[0]
    assert not action[:2].any()
    assert action[2] * batch.params.max_hop_m == pytest.approx((-260.0, 0.0), rel=1e-6)
    assert action[3] == pytest.approx((-1.0, 0.0)), "a full hop where it takes several"


def test_it_returns_early_where_the_current_leads_out_of_the_box():
    batch = sea(0.5, 0.0)
    batch.worlds["start_x"][0, :4], batch.worlds["start_y"][0, :4] = 4700.0, 0.0
    put(batch, 0, 4860.0, 0.0)  # 150 m further in 300 s, 50 m of margin
    put(batch, 1, 4860.0 - 200.0, 0.0)
    policy = make_policy("hold", batch, radius_m=1000.0)
    action = policy.act(batch.observations, batch.worlds)[0]
    assert action[0, 0] < 0 and not action[1].any()


def test_teams_stay_about_their_start_and_alive():
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 20, scenario="gyres", num_fields=16, field_seed=4
    )
    result = rollout(make_policy("hold", batch), batch, np.arange(20), tracks=True)
    away = np.hypot(*np.moveaxis(result.track - result.track[0], -1, 0))
    # The radius and one decision's drift, at most 1.5 m/s in these fields.
    assert away.max() < 250.0 + 300.0 * 1.5
    assert (result.metrics["alive"] == 1).mean() > 0.8
    assert (result.metrics["flight_energy_wh"] > 0).all()


def test_steered_vehicles_stand_still():
    batch = aquaquad_envs.make_world_batch("sensor-placement", 2, scenario="grid")
    result = rollout(make_policy("hold", batch), batch, [0, 1], tracks=True)
    assert (result.track == result.track[0]).all()


def test_refuses_what_it_cannot_use():
    batch = sea(0.0, 0.0)
    for options in ({"radius_m": -1.0}, {"margin_m": float("nan")}):
        with pytest.raises(InvalidParameterError, match=next(iter(options))):
            make_policy("hold", batch, **options)
    with pytest.raises(InvalidParameterError, match="continuous"):
        make_policy("hold", aquaquad_envs.make_world_batch("sensor-placement", 1, action_type="discrete"))

"""Greedy look-ahead: what it does where the best is plain to see, and over whole missions."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy


def sea(u, v, *, at=(-4000.0, 0.0), goal=(3000.0, 0.0), **params):
    """One world in a uniform current, without obstacles unless given."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 1, **{"obstacles": (), "team": (), **params})
    velocity = np.empty_like(batch.ocean.velocity)
    velocity[..., 0], velocity[..., 1] = u, v
    batch.ocean = batch.ocean._replace(velocity=velocity)
    batch.reset(0)
    batch.worlds["x"], batch.worlds["y"] = at
    batch.worlds["goal_x"], batch.worlds["goal_y"] = goal
    return batch


def decide(batch, **options):
    return make_policy("greedy", batch, **options).act(batch.observations, batch.worlds)[0]


def test_drifts_where_the_current_leads_to_the_goal():
    assert not decide(sea(0.5, 0.0)).any()


def test_flies_full_hops_to_the_goal_against_the_current():
    np.testing.assert_allclose(decide(sea(-0.5, 0.0)), (1.0, 0.0), atol=1e-6)


def test_in_still_water_it_flies_the_direct_way():
    batch = sea(0.0, 0.0)
    result = rollout(make_policy("greedy", batch), batch, [0])
    assert result.metrics["success"][0] == 1
    # Reset put the vehicle back: the mission of the vortex suite, flown in still water.
    straight = np.hypot(7000, 7000) - batch.params.goal_radius_m
    assert result.worlds["flight_wh"][0] == pytest.approx(straight / (40_000 / 3600) * 200 / 3600, rel=0.02)


def test_hops_aside_into_the_current_that_leads_on():
    """A jet along y = 1000, still water elsewhere: one hop north-east, then free drift."""
    batch = sea(0.0, 0.0, goal=(3000.0, 1000.0))
    nodes = batch.ocean.axes.y0 + batch.ocean.axes.spacing * np.arange(batch.ocean.velocity.shape[2])
    velocity = batch.ocean.velocity.copy()
    velocity[0, 0, :, :, 0] = np.where(np.abs(nodes - 1000.0) < 300.0, 1.0, 0.0)[:, None]
    batch.ocean = batch.ocean._replace(velocity=velocity)
    hop = decide(batch) * batch.params.max_hop_m
    assert 500 < hop[1] < 1500


def test_the_last_hop_reaches_a_goal_closer_than_the_threshold():
    batch = sea(-0.01, 0.0, at=(2880.0, 0.0))
    action = decide(batch)
    assert np.hypot(*action) >= batch.params.drift_threshold
    batch.step(action[None])
    assert batch.terminated[0] and batch.metrics()["success"][0] == 1


def test_never_lands_on_what_it_knows_of():
    batch = aquaquad_envs.make_world_batch("drift-hop", 200, scenario="gyres", num_fields=32, field_seed=5)
    result = rollout(make_policy("greedy", batch), batch, np.arange(200))
    success = result.metrics["success"]
    assert success.mean() > 0.97
    direct = rollout(make_policy("direct-flight", batch), batch, np.arange(200))
    both = (success > 0) & (direct.metrics["success"] > 0)
    saved = direct.metrics["flight_energy_wh"][both] - result.metrics["flight_energy_wh"][both]
    assert saved.mean() > 5 * saved.std() / np.sqrt(both.sum())


def test_a_longer_look_ahead_saves_more():
    batch = aquaquad_envs.make_world_batch("drift-hop", 200, scenario="gyres", num_fields=32, field_seed=5)
    used = [
        rollout(make_policy("greedy", batch, lookahead_h=hours), batch, np.arange(200))
        for hours in (0.5, 4.0)
    ]
    both = (used[0].metrics["success"] > 0) & (used[1].metrics["success"] > 0)
    short, long = (result.metrics["flight_energy_wh"][both].mean() for result in used)
    assert long < short


def test_plans_on_the_forecast_not_on_the_truth():
    batch = aquaquad_envs.make_world_batch("drift-hop", 3, scenario="forecast-error", num_fields=4)
    batch.reset(0)
    policy = make_policy("greedy", batch)
    before = policy.act(batch.observations, batch.worlds)
    velocity = batch.ocean.velocity.copy()
    for truth in set(batch.worlds["truth"]) - set(batch.worlds["forecast"]):
        velocity[truth] = np.nan
    batch.ocean = batch.ocean._replace(velocity=velocity)
    np.testing.assert_array_equal(policy.act(batch.observations, batch.worlds), before)


def test_refuses_what_it_cannot_use():
    batch = sea(0.0, 0.0)
    with pytest.raises(InvalidParameterError, match="lookahead_h"):
        make_policy("greedy", batch, lookahead_h=-1.0)
    with pytest.raises(InvalidParameterError, match="margin_m"):
        make_policy("greedy", batch, margin_m=float("nan"))
    with pytest.raises(InvalidParameterError, match="continuous"):
        make_policy("greedy", aquaquad_envs.make_world_batch("drift-hop", 1, action_type="discrete"))

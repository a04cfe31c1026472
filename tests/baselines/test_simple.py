"""Random, drift and direct flight: seeded per world, straight where they can, round obstacles where they must."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.currents import current_at
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import POLICIES, make_policy
from baselines.direct_flight import route


def straight_energy(batch):
    worlds = batch.worlds
    distance = np.hypot(worlds["goal_x"] - worlds["start_x"], worlds["goal_y"] - worlds["start_y"])
    return flight_energy_wh(distance, batch.params.airspeed_m_s, batch.params.flight_power_w)


def test_an_unknown_policy_is_refused_with_the_nearest_name():
    batch = make_world_batch("drift-hop", 1)
    with pytest.raises(InvalidParameterError, match="Did you mean 'direct-flight'"):
        make_policy("direct-fligth", batch)


@pytest.mark.parametrize("task, name", [(task, name) for task in POLICIES for name in sorted(POLICIES[task])])
def test_every_policy_states_what_it_knows(task, name):
    batch = make_world_batch(task, 1)
    assert len(make_policy(name, batch).information) > 3


def test_random_actions_depend_on_the_world_s_seed_alone():
    small, large = make_world_batch("drift-hop", 2), make_world_batch("drift-hop", 5)
    one, other = make_policy("random", small), make_policy("random", large)
    one.reset(np.array([7, 3]))
    other.reset(np.array([1, 7, 2, 3, 9]))
    for _ in range(150):  # across several blocks of draws
        a, b = one.act(None, small.worlds), other.act(None, large.worlds)
        assert np.array_equal(a, b[[1, 3]])
    again = make_policy("random", small)
    again.reset(np.array([7, 4]))
    one.reset(np.array([7, 3]))
    first, second = one.act(None, small.worlds), again.act(None, small.worlds)
    assert np.array_equal(first[0], second[0]) and not np.array_equal(first[1], second[1])


def test_random_actions_are_uniform_in_the_box():
    batch = make_world_batch("drift-hop", 200)
    policy = make_policy("random", batch)
    policy.reset(np.arange(200))
    drawn = np.concatenate([policy.act(None, batch.worlds) for _ in range(100)]).astype(np.float64)
    n = len(drawn)
    assert drawn.min() >= -1 and drawn.max() <= 1
    # Five standard errors of the mean and of the variance of a uniform number.
    assert np.abs(drawn.mean(0)).max() < 5 * np.sqrt(1 / 3 / n)
    assert np.abs(drawn.var(0) - 1 / 3).max() < 5 * np.sqrt((1 / 5 - 1 / 9) / n)
    assert abs(np.mean(drawn[:, 0] * drawn[:, 1])) < 5 / 3 / np.sqrt(n)


def test_random_and_drift_play_the_discrete_variant():
    batch = make_world_batch("drift-hop", 3, action_type="discrete")
    for name in ("random", "drift"):
        results = rollout(make_policy(name, batch), batch, [1, 2, 3])
        assert (results.worlds["outcome"] > 0).all()
    assert (results.worlds["flight_wh"] == 0).all(), "drift must not fly"
    with pytest.raises(InvalidParameterError, match="continuous"):
        make_policy("direct-flight", batch)


@pytest.mark.parametrize("action_type", ["continuous", "discrete"])
def test_random_and_drift_play_for_whole_teams(action_type):
    small, large = (
        make_world_batch("sensor-placement", n, scenario="calm", horizon_s=1800.0, action_type=action_type)
        for n in (1, 3)
    )
    ends = []
    for batch, seeds in ((small, [5]), (large, [4, 5, 6])):
        policy = make_policy("random", batch)
        results = rollout(policy, batch, seeds)
        ends.append(results.worlds[seeds.index(5)])
        actions = policy.act(None, batch.worlds)
        assert actions.shape == batch.action_shape and len(np.unique(actions[0], axis=0)) > 1
        still = rollout(make_policy("drift", batch), batch, seeds)
        assert (still.worlds["flight_wh"] == 0).all() and (results.worlds["flight_wh"][:, :4] > 0).any()
    assert np.array_equal(ends[0]["x"], ends[1]["x"])


def test_drift_never_flies_and_goes_where_the_current_goes():
    batch = make_world_batch("drift-hop", 4, scenario="gyres", horizon_s=3600.0)
    results = rollout(make_policy("drift", batch), batch, range(4), tracks=True)
    assert (results.worlds["flight_wh"] == 0).all() and (results.worlds["hops"] == 0).all()
    assert not results.flown.any()
    first = results.track[1] - results.track[0]
    for i, world in enumerate(results.worlds):
        axes = batch.ocean.axes
        start = current_at(
            batch.ocean.velocity, world["truth"], axes, world["clock_s"], world["start_x"], world["start_y"]
        )
        # Ten minutes at about the current of the start.
        assert first[i] == pytest.approx(600.0 * np.array(start), abs=0.35 * 600.0 * np.hypot(*start))


def test_direct_flight_without_obstacles_is_the_straight_line_to_the_centre():
    batch = make_world_batch("drift-hop", 20, scenario="gyres", obstacles=())
    results = rollout(make_policy("direct-flight", batch), batch, range(20))
    assert (results.metrics["success"] == 1).all()
    assert results.worlds["flight_wh"] == pytest.approx(straight_energy(batch), rel=1e-5)
    assert results.worlds["x"] == pytest.approx(results.worlds["goal_x"], abs=0.1)
    assert (results.worlds["drift_s"] == 0).all()


def test_direct_flight_in_the_published_vortex_goes_round_the_square():
    batch = make_world_batch("drift-hop", 1, scenario="vortex")
    results = rollout(make_policy("direct-flight", batch), batch, [0])
    # By hand: the diagonal has 2828 m of obstacle and the longest hop is 1333 m. The best single hop over the
    # square cuts a corner along a chord of 1333.3 m parallel to the diagonal: from (57, 1000) to (1000, 57).
    cut = 4000 / 3 / np.sqrt(2)
    shortest = np.hypot(4000 + 1000 - cut, 3000) + 4000 / 3 + np.hypot(2000, 3000 + 1000 - cut)
    shortest_wh = flight_energy_wh(shortest, 100 / 9, 200.0)
    assert results.metrics["success"][0] == 1
    assert shortest_wh - 1e-6 <= results.worlds["flight_wh"][0] < 1.005 * shortest_wh


def test_direct_flight_lands_nowhere_but_on_open_water_in_the_suites():
    for scenario in ("vortex-perturbed", "gyres"):
        batch = make_world_batch("drift-hop", 60, scenario=scenario)
        results = rollout(make_policy("direct-flight", batch), batch, range(60))
        assert (results.metrics["success"] == 1).all(), scenario
        assert (results.worlds["flight_wh"] > 0.999 * straight_energy(batch)).all()
        assert (results.worlds["flight_wh"] < 1.1 * straight_energy(batch)).all()


def test_a_last_hop_is_never_below_the_drift_threshold():
    batch = make_world_batch("drift-hop", 1, scenario="vortex", obstacles=())
    for remaining in (40.0, 134.0, 4000 / 3 + 20.0, 2 * 4000 / 3 + 90.0, 5000.0):
        batch.reset(0)
        batch.worlds["x"], batch.worlds["y"] = 3000.0 - remaining - 100.0, -3000.0
        batch.worlds["goal_x"] = 3000.0 - 100.0
        policy = make_policy("direct-flight", batch)
        policy.reset(np.array([0]))
        for _ in range(8):
            batch.step(policy.act(batch.observations, batch.worlds))
        assert batch.worlds["drift_s"][0] == 0, remaining
        assert batch.worlds["outcome"][0] == 1, remaining


def test_a_walled_off_goal_is_flown_at_and_missed():
    # A wall 3 km thick across the whole box cannot be hopped over.
    batch = make_world_batch(
        "drift-hop", 1, scenario="vortex", obstacles=((-1500.0, -6000.0, 1500.0, 6000.0),)
    )
    results = rollout(make_policy("direct-flight", batch), batch, [0])
    assert batch.task.outcomes[results.worlds["outcome"][0]] == "collision"


def test_a_detour_is_a_chain_of_hops_over_open_water():
    wall = ((-1500.0, -5000.0, 1500.0, 3000.0),)
    batch = make_world_batch("drift-hop", 1, scenario="vortex", obstacles=wall)
    landings = route(batch, 0, np.array([-4000.0, -1000.0]), np.array([4000.0, -1000.0]))
    legs = np.diff(np.array([[-4000.0, -1000.0], *landings]), axis=0)
    assert np.hypot(*legs.T).max() <= batch.params.max_hop_m + 1e-6
    assert max(landing[1] for landing in landings) > 3000.0
    # Round the two corners of the wall: the shortest path by hand.
    shortest = 2 * np.hypot(2500.0, 4000.0) + 3000.0
    assert np.hypot(*legs.T).sum() < 1.02 * shortest

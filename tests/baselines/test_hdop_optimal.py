"""hdop-optimal: its prediction against independent formulas, and what it does where the best is plain to see."""

import itertools

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.hdop import hdop
from aquaquad_envs.estimation.kalman_update import work_shape
from aquaquad_envs.estimation.posterior_bound import bound_update
from aquaquad_envs.tasks.rollout import rollout
from aquaquad_envs.tasks.sensor_placement_data import BATTERY_EMPTY, TIME_OUT
from baselines import make_policy
from baselines.hdop_optimal import KnownTargets, assign
from baselines.hdop_optimal_cost import add_information, expected_information, predicted_mean_square

SEEDS = np.arange(2_000_000, 2_000_012)


def scene(seed=1, **params):
    batch = aquaquad_envs.make_world_batch("sensor-placement", 1, **{"scenario": "calm", **params})
    batch.reset(seed)
    return batch


def place(batch, vehicles, target, *, std=30.0):
    """Vehicles and an exact estimate of a resting target where they are wanted."""
    world = batch.worlds[0]
    world["x"][: len(vehicles)], world["y"][: len(vehicles)] = np.array(vehicles, dtype=float).T
    world["start_x"], world["start_y"] = world["x"], world["y"]
    world["target_x"][0], world["target_y"][0] = target
    world["target_u"][0] = world["target_v"][0] = 0.0
    world["estimate"][0] = 0.0
    world["estimate"][0, :2] = target
    world["covariance"][0] = 0.0
    world["covariance"][0, :4, :4] = np.diag([std**2, std**2, 1e-4, 1e-4])


def act(batch, **options):
    policy = make_policy("hdop-optimal", batch, **options)
    policy.reset(np.zeros(batch.num_worlds, dtype=int))
    return policy, policy.act(batch.observations, batch.worlds)


def test_information_is_added_as_the_filters_add_it():
    rng = np.random.default_rng(0)
    for n, singular in itertools.product((4, 6), (False, True)):
        root = rng.normal(size=(n, n))
        covariance = root @ root.T + 0.1 * np.eye(n)
        row = rng.normal(size=(1 if singular else 2, 2))
        (a, b), (_, d) = row.T @ row
        expected = covariance.copy()
        bound_update(np.zeros(n), expected, np.zeros(work_shape(n, 2)), a, b, d)
        add_information(covariance, np.zeros((n, 2)), a, b, d)
        np.testing.assert_allclose(covariance, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("kind", ["bearing", "range", "tdoa"])
def test_the_information_expected_is_that_of_hdop(kind):
    batch = scene(measurement=kind)
    vehicles = [(1000.0, 200.0), (-500.0, 900.0), (-800.0, -700.0), (400.0, -1500.0)]
    place(batch, vehicles, (50.0, -20.0))
    policy, _ = act(batch, price_per_wh=1e6)  # too dear to fly: everybody drifts, in still water
    a, b, d = expected_information(
        batch.worlds[0], 50.0, -20.0, 1, -1.0, 0.0, policy.paths, policy.beliefs, batch.constants
    )
    nearest = int(np.argmin(np.hypot(*(np.array(vehicles) - (50.0, -20.0)).T)))
    pairs = [(i, nearest) for i in range(4) if i != nearest] if kind == "tdoa" else None
    exact = hdop(kind, vehicles, (50.0, -20.0), stds=batch.params.measurement_std, pairs=pairs)
    assert np.sqrt((a + d) / (a * d - b * b)) == pytest.approx(float(exact), rel=1e-9)


@pytest.mark.parametrize("kind, scenario", [("bearing", "calm"), ("tdoa", "gyres"), ("range", "vortex")])
def test_the_prediction_comes_true(kind, scenario):
    """The predicted variance of a decision is near to what the tracker's own covariance then says."""
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 8, scenario=scenario, measurement=kind, num_fields=8, field_seed=3
    )
    batch.reset(5)
    policy = make_policy("hdop-optimal", batch)
    ratios = []
    for _ in range(20):
        actions = policy.act(batch.observations, batch.worlds)
        # The last world decided is the one whose plan the policy still holds.
        world = batch.worlds[-1].copy()
        believed = predicted_mean_square(world, 1, np.inf, policy.paths, policy.beliefs, batch.constants)
        before = batch.worlds["error2_sum"][-1]
        batch.step(actions)
        measured = (batch.worlds["error2_sum"][-1] - before) / batch.params.sub_steps
        ratios.append(measured / believed)
    # Squared errors of one episode scatter by themselves: the median of χ²₂/2 is 0.69.
    assert 0.2 < np.median(ratios) < 2.0


def test_it_surrounds_a_target_that_lies_to_one_side():
    batch = scene(measurement="range")
    place(batch, [(-3000.0, 0.0), (-3000.0, 50.0), (-3000.0, 100.0), (-3000.0, -50.0)], (0.0, 0.0))
    before = hdop("range", np.stack([batch.worlds["x"], batch.worlds["y"]], -1)[0, :4], (0.0, 0.0))
    policy = make_policy("hdop-optimal", batch)
    for _ in range(12):
        batch.step(policy.act(batch.observations, batch.worlds))
        batch.worlds["target_x"][0, 0] = batch.worlds["target_y"][0, 0] = 0.0
    after = hdop("range", np.stack([batch.worlds["x"], batch.worlds["y"]], -1)[0, :4], (0.0, 0.0))
    assert after < 1.3 < before, "the least of four ranges is 1"


def test_bearings_draw_near_and_a_price_keeps_them_away():
    batch = scene(measurement="bearing")
    vehicles = [(3000.0, 0.0), (0.0, 3000.0), (-3000.0, 0.0), (0.0, -3000.0)]
    place(batch, vehicles, (0.0, 0.0))
    _, action = act(batch, price_per_wh=0.0)
    flown = np.einsum("ij,ij->i", action[0], -np.array(vehicles) / 3000.0)
    assert flown.max() > 0.9, "somebody flies a full hop at the target"
    assert not act(batch, price_per_wh=10.0)[1].any()


def test_it_never_takes_the_whole_team_out_of_hearing_of_a_wide_track():
    batch = scene(measurement="bearing")
    place(batch, [(3000.0, 0.0), (0.0, 3000.0), (-3000.0, 0.0), (0.0, -3000.0)], (0.0, 0.0), std=500.0)
    action = act(batch, price_per_wh=0.0)[1][0]
    flying_s = np.hypot(*action.T) * batch.params.max_hop_m / batch.params.airspeed_m_s
    sub_step_s = batch.params.action_period_s / batch.params.sub_steps
    assert (flying_s <= sub_step_s).sum() >= 2, "two bearings at least make a fix"


def test_landings_and_drifts_stay_in_open_water():
    for scenario in ("vortex", "gyres"):
        batch = aquaquad_envs.make_world_batch(
            "sensor-placement", 6, scenario=scenario, measurement="bearing", num_fields=12, field_seed=3
        )
        result = rollout(make_policy("hdop-optimal", batch), batch, SEEDS[:6])
        outcomes = result.worlds["agent_outcome"][:, :4]
        assert (outcomes == TIME_OUT).mean() > 0.98


def test_the_battery_is_kept():
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 4, scenario="vortex", measurement="bearing", battery_wh=70.0, solar="constant"
    )
    result = rollout(make_policy("hdop-optimal", batch, price_per_wh=0.0), batch, SEEDS[:4])
    assert not (result.worlds["agent_outcome"] == BATTERY_EMPTY).any()
    assert (result.worlds["battery_wh"][:, :4] > 0).all() and (result.metrics["flight_energy_wh"] > 0).all()


@pytest.mark.parametrize("kind", ["bearing", "tdoa"])
def test_it_beats_hold_and_comes_near_the_bound(kind):
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 12, scenario="vortex", measurement=kind, horizon_s=7200.0
    )
    held = rollout(make_policy("hold", batch), batch, SEEDS).metrics
    found = rollout(make_policy("hdop-optimal", batch), batch, SEEDS).metrics
    known = rollout(KnownTargets(batch), batch, SEEDS).metrics
    gain = np.log(held["tracking_rmse_m"] / found["tracking_rmse_m"])
    assert gain.mean() > 5 * gain.std() / np.sqrt(len(gain))
    assert np.median(found["tracking_rmse_m"] / found["bound_rmse_m"]) < 1.3
    assert np.log(known["bound_rmse_m"]).mean() < np.log(held["bound_rmse_m"]).mean()


def test_the_truth_is_not_looked_at():
    batch = scene(measurement="tdoa", scenario="gyres", num_fields=4)
    policy, before = act(batch)
    worlds = batch.worlds.copy()
    for name in ("target_x", "target_y", "target_u", "target_v", "bound"):
        worlds[name] = np.nan
    np.testing.assert_array_equal(policy.act(batch.observations, worlds), before)


def test_worlds_do_not_depend_on_each_other():
    one, many = (
        aquaquad_envs.make_world_batch(
            "sensor-placement", n, scenario="gyres", num_fields=4, horizon_s=3600.0
        )
        for n in (1, 3)
    )
    alone = rollout(make_policy("hdop-optimal", one), one, [7])
    among = rollout(make_policy("hdop-optimal", many), many, [3, 7, 9])
    np.testing.assert_array_equal(alone.worlds["x"][0], among.worlds["x"][1])


def test_a_fence_is_covered():
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 3, scenario="fence", num_fields=6, field_seed=3
    )
    assert rollout(make_policy("hdop-optimal", batch), batch, SEEDS[:3]).metrics["coverage"].mean() > 0.8
    assert rollout(make_policy("hold", batch), batch, SEEDS[:3]).metrics["coverage"].mean() < 0.4


def test_steered_vehicles_find_their_targets():
    batch = aquaquad_envs.make_world_batch("sensor-placement", 4, scenario="grid", horizon_s=1800.0)
    held = rollout(make_policy("hold", batch), batch, SEEDS[:4]).metrics
    found = rollout(make_policy("hdop-optimal", batch), batch, SEEDS[:4]).metrics
    assert found["mean_hdop"].mean() < 0.85 * held["mean_hdop"].mean()


@pytest.mark.parametrize(
    "params",
    [
        {"num_vehicles": 8, "num_targets": 3}, {"num_vehicles": 3, "tdoa_pairs": "all"},
        {"track_model": "constant-acceleration", "tracker": "ekf", "target_motion": "manoeuvring"},
        {"emissions": "periodic", "detection_level": 1.0, "noise_level": 1.0, "dropout": 0.2},
        {"emissions": "random", "travel_time_level": 1.0, "sharing_delay_s": 30.0, "start_layout": "cluster"},
        {"scenario": "fence", "num_targets": 1}, {"drift_threshold": 0.0},
    ],
)  # fmt: skip
def test_every_variant_of_the_world_is_played(params):
    batch = aquaquad_envs.make_world_batch(
        "sensor-placement", 2, **{"scenario": "gyres", "num_fields": 4, "horizon_s": 3000.0, **params}
    )
    result = rollout(make_policy("hdop-optimal", batch), batch, [1, 2])
    assert np.isfinite(result.metrics["tracking_rmse_m"]).all()
    assert (result.worlds["outcome"] == batch.task.outcomes.index("time out")).all()


def test_assignment_is_the_least_of_all():
    distances = np.random.default_rng(1).uniform(size=(5, 5))
    chosen, total = assign(distances)
    least = min(distances[range(5), order].sum() for order in itertools.permutations(range(5)))
    assert total == pytest.approx(least) and distances[range(5), chosen].sum() == pytest.approx(least)


def test_routes_of_dr_rrt_star_need_less_energy():
    batch = aquaquad_envs.make_world_batch("sensor-placement", 6, scenario="vortex", measurement="bearing")
    policy = make_policy("hdop-optimal", batch, through="dr-rrt-star")
    routed = rollout(policy, batch, SEEDS[:6])
    straight = rollout(make_policy("hdop-optimal", batch), batch, SEEDS[:6])
    assert policy.routes.taken.sum() > 0
    assert (routed.worlds["agent_outcome"][:, :4] == TIME_OUT).all()
    assert routed.metrics["flight_energy_wh"].mean() < straight.metrics["flight_energy_wh"].mean()
    again = rollout(policy, batch, SEEDS[:6])
    np.testing.assert_array_equal(again.worlds["x"], routed.worlds["x"])


def test_refuses_what_it_cannot_use():
    batch = scene()
    for options in (
        {"lookahead_s": 0.0},
        {"price_per_wh": -1.0},
        {"margin_m": float("nan")},
        {"reserve": 2.0},
    ):
        with pytest.raises(InvalidParameterError, match=next(iter(options))):
            make_policy("hdop-optimal", batch, **options)
    with pytest.raises(InvalidParameterError, match="Did you mean 'hops'"):
        make_policy("hdop-optimal", batch, through="hop")
    with pytest.raises(InvalidParameterError, match="continuous"):
        make_policy("hdop-optimal", scene(action_type="discrete"))

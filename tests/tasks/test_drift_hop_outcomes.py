"""How drift/hop episodes end, what hops and drifts cost, and what a finished world does."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.tasks.drift_hop_kernels import OUTCOMES, REWARD_TERMS

DRIFT = (0.0, 0.0)


def sea(u=0.0, v=0.0, *, at=(-4000.0, 4000.0), goal=(3000.0, -3000.0), worlds=1, **params):
    """Worlds of the vortex scenario (2 km square at the centre) in a uniform current, placed by hand."""
    batch = aquaquad_envs.make_world_batch("drift-hop", worlds, **params)
    velocity = np.empty_like(batch.ocean.velocity)
    velocity[..., 0], velocity[..., 1] = u, v
    velocity.setflags(write=False)
    batch.ocean = batch.ocean._replace(velocity=velocity)
    batch.reset(0)
    batch.worlds["x"], batch.worlds["y"] = at
    batch.worlds["goal_x"], batch.worlds["goal_y"] = goal
    return batch


def step(batch, action):
    batch.step(np.tile(np.array(action, dtype=np.float32), (batch.num_worlds, 1)))
    return OUTCOMES[batch.worlds["outcome"][0]]


def terms(batch):
    return dict(zip(REWARD_TERMS, batch.reward_terms[0], strict=True))


def seen(batch, name):
    """One observation of the first world."""
    return float(batch.observations[0][batch.task.observation_names.index(name)])


def hop_to(batch, x, y):
    w = batch.worlds[0]
    return (x - w["x"]) / batch.params.max_hop_m, (y - w["y"]) / batch.params.max_hop_m


def test_a_drift_goes_with_the_current_and_costs_no_flight():
    batch = sea(0.5, -0.25)
    assert step(batch, DRIFT) == "running"
    w = batch.worlds[0]
    assert (w["x"], w["y"]) == pytest.approx((-3700.0, 3850.0))
    assert w["drift_s"] == w["time_s"] == 600 and w["flight_wh"] == w["hops"] == w["flight_s"] == 0
    assert terms(batch)["flight"] == 0 and terms(batch)["progress"] > 0
    assert not batch.terminated[0] and not batch.truncated[0]


def test_a_hop_ignores_the_current_and_lasts_its_flight_time():
    batch = sea(1.0, 1.0)
    assert step(batch, (0.6, -0.8)) == "running"
    w = batch.worlds[0]
    assert (w["x"], w["y"]) == pytest.approx((-4000 + 0.6 * 4000 / 3, 4000 - 0.8 * 4000 / 3), abs=1e-3)
    assert w["time_s"] == w["flight_s"] == pytest.approx(120.0, rel=1e-6)
    assert w["flight_wh"] == pytest.approx(200 / 30, rel=1e-6) and w["hops"] == 1
    assert terms(batch)["flight"] == pytest.approx(-200 / 300, rel=1e-6)


def test_a_direct_flight_costs_the_published_energy():
    """Eight hops straight at the goal: 49.5 Wh less the goal radius; flight and progress cancel."""
    batch = sea(obstacles=())
    outcome, total = "running", 0.0
    while outcome == "running":
        outcome = step(batch, np.clip(np.array(hop_to(batch, 3000, -3000)), -np.sqrt(0.5), np.sqrt(0.5)))
        total += terms(batch)["flight"] + terms(batch)["progress"]
    assert outcome == "goal"
    assert batch.metrics()["flight_energy_wh"][0] == pytest.approx(49.497, abs=0.005)
    assert batch.metrics()["saving_vs_direct"][0] == pytest.approx(0.0, abs=1e-4)
    assert batch.worlds["hops"][0] == 8
    assert total == pytest.approx(0.0, abs=1e-4)


def test_goal_by_drift_stops_at_the_first_sub_step_inside():
    batch = sea(0.5, 0.0, at=(2750.0, -3000.0))
    assert step(batch, DRIFT) == "goal"
    # 30 m a minute: 150 m needed, so 5 of the 10 sub-steps.
    assert batch.worlds["time_s"][0] == 300 and batch.worlds["x"][0] == pytest.approx(2900.0)
    assert batch.terminated[0] and not batch.truncated[0]
    assert terms(batch)["arrival"] == 1.0 and terms(batch)["failure"] == 0.0
    assert batch.metrics()["success"][0] == 1.0


def test_goal_by_landing_but_not_by_flying_over():
    batch = sea(at=(2000.0, -3000.0))
    assert step(batch, hop_to(batch, 3050.0, -3000.0)) == "goal"
    over = sea(at=(2000.0, -3000.0))
    assert step(over, hop_to(over, 3200.0, -3000.0)) == "running"


@pytest.mark.parametrize("inside", [99.9, 100.1])
def test_the_goal_radius_is_sharp(inside):
    batch = sea(at=(3000.0 - inside, -3000.0))
    assert step(batch, DRIFT) == ("goal" if inside < 100 else "running")


def test_collision_by_drift():
    batch = sea(0.5, 0.0, at=(-1100.0, 0.0))
    assert step(batch, DRIFT) == "collision"
    assert -1000 < batch.worlds["x"][0] <= -970
    assert batch.terminated[0] and not batch.truncated[0]
    assert terms(batch)["failure"] == -5.0 and terms(batch)["arrival"] == 0.0


def test_collision_by_landing():
    batch = sea(at=(-1500.0, 0.0))
    assert step(batch, hop_to(batch, -500.0, 0.0)) == "collision"
    assert terms(batch)["failure"] == -5.0


def test_hops_pass_over_obstacles():
    batch = sea(at=(-400.0, 1300.0), obstacles=((-1000.0, 200.0, 1000.0, 1200.0),))
    assert step(batch, hop_to(batch, -400.0, 0.0)) == "running"
    assert batch.worlds["y"][0] == pytest.approx(0.0, abs=1e-3)


def test_the_margin_grows_the_obstacle():
    for margin, expected in ((0.0, "running"), (200.0, "collision")):
        batch = sea(at=(-2000.0, 0.0), obstacle_margin_m=margin)
        assert step(batch, hop_to(batch, -1100.0, 0.0)) == expected


@pytest.mark.parametrize("way", ["drift", "hop"])
def test_leaving_the_box(way):
    batch = sea(0.5, 0.0, at=(4900.0, 2000.0))
    assert step(batch, DRIFT if way == "drift" else (0.5, 0.0)) == "left box"
    assert batch.terminated[0] and not batch.truncated[0]
    assert terms(batch)["failure"] == -5.0
    assert batch.observations[0][0] == 1.0


@pytest.mark.parametrize("way", ["drift", "hop"])
def test_an_empty_battery(way):
    batch = sea(battery_wh=10.0, initial_charge=0.05, solar="constant", base_power_w=40.0)
    assert step(batch, DRIFT if way == "drift" else (1.0, 0.0)) == "battery empty"
    w = batch.worlds[0]
    assert w["battery_wh"] == 0 and batch.terminated[0] and not batch.truncated[0]
    assert w["spent_wh"] == pytest.approx(0.5 + w["solar_wh"])
    assert terms(batch)["failure"] == -5.0


def test_landing_in_the_goal_with_an_empty_battery_is_no_success():
    batch = sea(at=(2000.0, -3000.0), battery_wh=2.0, solar="constant")
    assert step(batch, hop_to(batch, 3000.0, -3000.0)) == "battery empty"
    assert batch.metrics()["success"][0] == 0.0


def test_time_out_truncates_without_a_penalty():
    batch = sea(horizon_s=1800.0)
    assert [step(batch, DRIFT) for _ in range(3)] == ["running", "running", "time out"]
    assert batch.truncated[0] and not batch.terminated[0]
    assert terms(batch) == {"flight": 0.0, "progress": 0.0, "arrival": 0.0, "failure": 0.0}
    assert seen(batch, "time left") == 0.0


@pytest.mark.parametrize(
    "params", [{"start_time_spread_s": 50_000.0}, {"sub_steps": 7, "action_period_s": 700.0}]
)
def test_the_horizon_is_met_on_time_whatever_the_clock(params):
    """A whole number of drifts fills the horizon; rounding of the clock must not add another."""
    period = params.get("action_period_s", 600.0)
    batch = sea(worlds=200, horizon_s=30 * period, **params)
    for _ in range(30):
        assert not batch.truncated.any()
        step(batch, DRIFT)
    assert batch.truncated.all()


def test_arriving_at_the_last_moment_counts():
    batch = sea(0.5, 0.0, at=(2640.0, -3000.0), horizon_s=540.0)
    assert step(batch, DRIFT) == "goal"
    assert batch.terminated[0] and not batch.truncated[0]


@pytest.mark.parametrize("norm, hops", [(0.0999, 0), (0.1001, 1)])
def test_the_threshold_parts_drift_from_hop(norm, hops):
    batch = sea()
    step(batch, (0.0, -norm))
    assert batch.worlds["hops"][0] == hops


def test_without_a_threshold_only_zero_drifts():
    batch = sea(drift_threshold=0.0)
    step(batch, DRIFT)
    assert batch.worlds["hops"][0] == 0
    step(batch, (1e-6, 0.0))
    assert batch.worlds["hops"][0] == 1


@pytest.mark.parametrize("action", [(3.0, -4.0), (3e8, -4e8), (3e37, -4e37)])
def test_long_actions_are_shortened_to_the_disc(action):
    batch, golden = sea(), sea()
    step(batch, action)
    step(golden, (0.6, -0.8))
    for name in ("x", "y", "flight_wh", "time_s"):
        assert batch.worlds[name][0] == pytest.approx(golden.worlds[name][0], rel=1e-6)


@pytest.mark.parametrize("action", [(3e200, -4e200), (1.2e308, -1.6e308), (np.finfo(float).max, 0.0)])
def test_even_those_whose_square_overflows(action):
    batch = sea(worlds=2)
    batch.step(np.array([action, (0.3, 0.4)]))
    moved = np.hypot(batch.worlds["x"][0] + 4000, batch.worlds["y"][0] - 4000)
    assert moved == pytest.approx(4000 / 3)
    golden = sea(worlds=2)
    golden.step(np.array([(1.0, 0.0), (0.3, 0.4)]))
    assert golden.worlds[1] == batch.worlds[1]


@pytest.mark.parametrize("number", range(33))
def test_the_discrete_variant(number):
    """0 drifts; 1 to 16 are half hops and 17 to 32 full hops, anticlockwise from east."""
    batch = aquaquad_envs.make_world_batch(
        "drift-hop", 1, action_type="discrete", scenario="tide", num_fields=1
    )
    batch.reset(0)
    batch.worlds["x"] = batch.worlds["y"] = 0.0
    batch.step(np.array([number]))
    w = batch.worlds[0]
    if number == 0:
        assert w["hops"] == 0 and w["time_s"] == 600
        return
    angle, share = 2 * np.pi * ((number - 1) % 16) / 16, 0.5 if number <= 16 else 1.0
    expected = share * 4000 / 3 * np.array([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose((w["x"], w["y"]), expected, atol=1e-9)


def test_a_finished_world_stays_until_reset():
    batch = sea(0.5, 0.0, at=(2750.0, -3000.0), worlds=3)
    batch.worlds["x"][1] = -2000.0
    step(batch, DRIFT)
    kept, before = batch.worlds.copy(), batch.observations.copy()
    assert batch.terminated.tolist() == [True, False, True]
    step(batch, (1.0, 0.0))
    assert (batch.worlds[[0, 2]] == kept[[0, 2]]).all() and batch.worlds[1] != kept[1]
    np.testing.assert_array_equal(batch.observations[[0, 2]], before[[0, 2]])
    assert batch.rewards[[0, 2]].tolist() == [0.0, 0.0]
    assert batch.terminated.tolist() == [True, False, True]
    batch.reset(mask=batch.terminated.copy())
    assert not batch.terminated.any() and (batch.worlds["steps"][[0, 2]] == 0).all()


@pytest.mark.parametrize(
    "params",
    [
        {"scenario": "gyres", "num_fields": 32},
        {"scenario": "vortex-perturbed", "battery_wh": 12.0, "start_time_spread_s": 86_400.0},
        {"scenario": "vortex", "energy": "2016", "initial_charge": 0.1, "start_time": "2014-12-21T06:00"},
    ],
    ids=["gyres", "small battery", "winter night"],
)
def test_energy_is_conserved_over_whole_episodes(params):
    """stored = start + charged - spent - clipped, in every world at every step, and 0 <= stored <= capacity."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 400, **params)
    rng = np.random.default_rng(8)
    batch.reset(8)
    start, capacity = batch.worlds["battery_wh"].copy(), batch.params.battery_wh
    power = np.array([batch.params.base_power_w, batch.params.flight_power_w])
    for _ in range(80):
        hop = rng.uniform(size=(400, 1)) < 0.25
        batch.step(np.where(hop, rng.uniform(-1, 1, (400, 2)), 0.0))
        w = batch.worlds
        stored = start + w["solar_wh"] - w["spent_wh"] - w["clipped_wh"]
        np.testing.assert_allclose(w["battery_wh"], stored, atol=1e-9)
        assert (w["battery_wh"] >= 0).all() and (w["battery_wh"] <= capacity).all()
        going = w["outcome"] != OUTCOMES.index("battery empty")
        demand = (power[0] * w["time_s"] + power[1] * w["flight_s"]) / 3600
        np.testing.assert_allclose(w["spent_wh"][going], demand[going], atol=1e-9)
        assert (w["spent_wh"] <= demand + 1e-9).all()
    ends = {OUTCOMES[k] for k in batch.worlds["outcome"]}
    assert ends & {"left box", "collision"}
    if "battery_wh" in params:
        assert "battery empty" in ends and (batch.worlds["clipped_wh"] > 0).any()
    if "start_time" in params:
        assert "battery empty" in ends


def test_the_sun_charges_by_day_only():
    day = sea(initial_charge=0.5, start_time="2014-06-21T20:00")
    night = sea(initial_charge=0.5, start_time="2014-06-21T08:00")
    step(day, DRIFT)
    step(night, DRIFT)
    assert day.worlds["solar_wh"][0] > 8 and day.worlds["battery_wh"][0] > 89
    assert night.worlds["solar_wh"][0] == 0 and night.worlds["battery_wh"][0] < 89


def test_the_sun_shines_through_the_longest_hop():
    """The charge table must outlast a mission whose last decision is a hop of hours."""
    batch = sea(
        half_width_m=50_000.0, at=(0.0, 0.0), max_hop_m=40_000.0, airspeed_m_s=1.0, horizon_s=3600.0,
        solar="constant", initial_charge=0.1, flight_power_w=1.0, base_power_w=0.0, battery_wh=1000.0,
    )  # fmt: skip
    assert step(batch, (1.0, 0.0)) == "time out"
    assert batch.worlds["solar_wh"][0] == pytest.approx(400 * 40_000 / 86_400, rel=1e-6)


def test_mean_hdop_is_weighted_by_time():
    batch = sea()
    assert np.isnan(sea(team=()).metrics()["mean_hdop"][0])
    first = 9000 * seen(batch, "HDOP")
    step(batch, DRIFT)
    assert batch.metrics()["mean_hdop"][0] == pytest.approx(first, rel=1e-5)
    second = 9000 * seen(batch, "HDOP")
    step(batch, (0.0, -1.0))
    expected = (first * 600 + second * 120) / 720
    assert batch.metrics()["mean_hdop"][0] == pytest.approx(expected, rel=1e-5)
    step(batch, DRIFT)
    assert 9000 * seen(batch, "HDOP") != pytest.approx(second, rel=1e-3)

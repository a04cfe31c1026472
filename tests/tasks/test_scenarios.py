"""Scenario banks: what episodes are drawn from."""

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.tasks.drift_hop import Params
from aquaquad_envs.tasks.scenarios import SCENARIOS, build_bank

RANDOM = ("gyres", "forecast-error", "double-gyre", "tide")


def bank(scenario, **params):
    return build_bank(Params(scenario=scenario, **{"num_fields": 12, **params}).scenario_spec())


def made(scenario, worlds=300, seed=0, **params):
    batch = aquaquad_envs.make_world_batch(
        "drift-hop", worlds, scenario=scenario, **{"num_fields": 12, **params}
    )
    batch.reset(seed)
    return batch


def clearances(batch, x, y):
    ocean, w = batch.ocean, batch.worlds
    return np.array([
        clearance_at(ocean.clearance, w["obstacle"][i], ocean.clearance_grid, w[x][i], w[y][i]) for i in range(len(w))
    ])  # fmt: skip


@pytest.mark.parametrize("scenario", RANDOM)
def test_a_larger_bank_begins_with_the_smaller(scenario):
    small, large = bank(scenario, num_fields=3), bank(scenario, num_fields=7)
    for k in range(3):
        a, b = small.scenarios[k], large.scenarios[k]
        for field in ("start_x", "start_y", "goal_x", "goal_y", "start_spread", "goal_spread"):
            assert a[field] == b[field]
        for field, stack in (("truth", "velocity"), ("forecast", "velocity"), ("obstacle", "clearance")):
            np.testing.assert_array_equal(getattr(small, stack)[a[field]], getattr(large, stack)[b[field]])


@pytest.mark.parametrize("scenario", RANDOM)
def test_the_field_seed_decides_the_bank(scenario):
    one, other = bank(scenario), bank(scenario, field_seed=1)
    assert np.abs(one.velocity - other.velocity).max() > 0.05
    assert (one.scenarios["goal_x"] != other.scenarios["goal_x"]).all()
    assert bank(scenario) is one, "equal parameters share one bank"


def test_scenarios_of_a_bank_differ():
    gyres = bank("gyres")
    assert len(np.unique(gyres.velocity[:, 0, 0, 0, 0])) == 12
    assert len(np.unique(gyres.scenarios["start_x"])) == 12


@pytest.mark.parametrize("scenario", [*RANDOM, "vortex", "vortex-perturbed"])
def test_starts_and_goals_lie_in_open_water_inside_the_box(scenario):
    batch = made(scenario)
    half = batch.params.half_width_m
    for x, y in (("x", "y"), ("goal_x", "goal_y")):
        assert (clearances(batch, x, y) > 0).all()
        assert (np.maximum(abs(batch.worlds[x]), abs(batch.worlds[y])) <= half).all()
    apart = np.hypot(batch.worlds["x"] - batch.worlds["goal_x"], batch.worlds["y"] - batch.worlds["goal_y"])
    assert (apart > 0.7 * half).all()
    assert (batch.worlds["start_x"] == batch.worlds["x"]).all()


@pytest.mark.parametrize("margin", [0.0, 400.0])
def test_own_obstacles_are_kept_clear_of_too(margin):
    obstacles = ((-3000.0, -4000.0, 0.0, 1000.0), (1000.0, 0.0, 4000.0, 3500.0))
    batch = made("gyres", obstacles=obstacles, obstacle_margin_m=margin)
    for x, y in (("x", "y"), ("goal_x", "goal_y")):
        for x0, y0, x1, y1 in obstacles:
            dx = np.maximum(np.maximum(x0 - batch.worlds[x], batch.worlds[x] - x1), 0)
            dy = np.maximum(np.maximum(y0 - batch.worlds[y], batch.worlds[y] - y1), 0)
            assert (np.hypot(dx, dy) > margin - 125).all()  # corners are rounded within a cell
        assert (clearances(batch, x, y) > 0).all()


def test_the_published_vortex():
    w = made("vortex", 5).worlds
    assert (w["x"] == -4000).all() and (w["y"] == 4000).all()
    assert (w["goal_x"] == 3000).all() and (w["goal_y"] == -3000).all()
    batch = made("vortex", 1)
    for point, inside in (((0, 0), True), ((999, 999), True), ((1001, 0), False), ((0, -1100), False)):
        clear = clearance_at(batch.ocean.clearance, 0, batch.ocean.clearance_grid, *map(float, point))
        assert (clear < 0) == inside


def test_the_perturbed_vortex_fills_two_discs():
    w = made("vortex-perturbed", 4000).worlds
    for x, y, cx, cy in (("x", "y", -4000, 4000), ("goal_x", "goal_y", 3000, -3000)):
        away = np.hypot(w[x] - cx, w[y] - cy)
        assert away.max() <= 500.0 and away.max() > 490
        assert np.mean(away**2) == pytest.approx(500**2 / 2, rel=0.05)  # uniform in the disc
        assert abs(np.mean(w[x]) - cx) < 20 and abs(np.mean(w[y]) - cy) < 20
    assert abs(np.corrcoef(w["x"], w["goal_x"])[0, 1]) < 0.06


def test_the_forecast_differs_from_the_truth_in_forecast_error_only():
    for scenario in SCENARIOS:
        if scenario == "file":
            continue
        records = bank(scenario).scenarios
        assert (records["forecast"] == records["truth"]).all() == (scenario != "forecast-error")


@pytest.mark.parametrize("error", [0.0, 0.4, 1.0])
def test_the_forecast_is_off_by_as_much_as_said(error):
    made_bank = bank("forecast-error", num_fields=40, forecast_error=error)
    truth = made_bank.velocity[made_bank.scenarios["truth"]]
    forecast = made_bank.velocity[made_bank.scenarios["forecast"]]
    square = [np.mean(np.sum(field**2, -1), axis=(1, 2, 3)) for field in (forecast - truth, truth)]
    assert np.sqrt(np.mean(square[0] / square[1])) == pytest.approx(error, rel=0.15, abs=1e-12)


def test_forecast_error_has_the_truths_of_gyres():
    """The same ocean, seen less well: results of the two suites compare."""
    gyres, seen = bank("gyres"), bank("forecast-error")
    np.testing.assert_array_equal(gyres.velocity, seen.velocity[seen.scenarios["truth"]])
    np.testing.assert_array_equal(gyres.clearance, seen.clearance)
    assert (gyres.scenarios["start_x"] == seen.scenarios["start_x"]).all()


def test_the_policy_is_shown_the_forecast():
    batch = made("forecast-error", 50, forecast_error=1.0)
    names = batch.task.observation_names
    seen = batch.observations[:, names.index("forecast u")]
    measured = batch.observations[:, names.index("current u")]
    assert np.abs(seen - measured).max() > 0.05


def test_starting_anywhere():
    everywhere = made("vortex", 2000, start_anywhere=1.0)
    half = everywhere.params.half_width_m
    w = everywhere.worlds
    assert w["x"].min() < -0.95 * half and w["x"].max() > 0.95 * half
    assert (clearances(everywhere, "x", "y") >= 0).all()
    assert (np.hypot(w["x"] - w["goal_x"], w["y"] - w["goal_y"]) > everywhere.params.goal_radius_m).all()
    some = made("vortex", 2000, start_anywhere=0.3).worlds
    assert np.mean(some["x"] != -4000) == pytest.approx(0.3, abs=0.04)


def test_clocks_spread():
    batch = made("gyres", 1000, start_time_spread_s=10_000.0)
    clock = batch.worlds["clock_s"]
    assert clock.min() >= 0 and clock.max() <= 10_000 and np.ptp(clock) > 9000
    assert (made("gyres", 10).worlds["clock_s"] == 0).all()


def test_episodes_visit_the_whole_bank():
    batch = made("gyres", 600)
    assert set(batch.worlds["scenario"]) == set(range(12))


def test_banks_cannot_be_changed():
    made_bank = bank("gyres")
    for array in (made_bank.velocity, made_bank.clearance, made_bank.scenarios):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = array[0]

"""Transponder localization: moves, ranges, estimates, rewards and ends, against formulas of their own."""

import numpy as np
import pytest
from scipy.stats import kstest

from aquaquad_envs.tasks.transponder_localization_params import PUBLISHED
from tests.tasks.transponder_worlds import DEEP, flow, outcome, play, terms, unpacked, water


def test_the_published_start_is_measured_at_once_and_the_rest_one_a_step():
    batch = water(num_measurements=7)
    w = batch.worlds[0]
    assert (w["x"], w["y"], w["count"], w["steps"]) == (-3.0, 9.0, 1, 0)
    assert np.degrees(w["heading"]) == pytest.approx(-30.0)
    assert w["target"][0].tolist() == [17.0, 15.0, 6.0]
    assert w["ranges"][0, 0] == pytest.approx(np.linalg.norm([20, 6, 6]), abs=1.0) and w["time_s"] == 0.0
    play(batch, [0.3] * 5)
    assert (w["count"], w["steps"], w["time_s"]) == (6, 5, 5.0) and not batch.done[0]
    play(batch, [0.3])
    assert w["count"] == 7 and batch.truncated[0] and not batch.terminated[0] and outcome(batch) == "time out"
    kept = batch.snapshot()
    play(batch, [0.3])
    assert batch.worlds.tobytes() == kept.tobytes() and batch.rewards[0] == 0.0


@pytest.mark.parametrize("scenario, number", [("single", 1), ("four", 4), ("field", 2)])
def test_published_scenarios_have_their_transponders(scenario, number):
    batch = water(3, scenario=scenario)
    assert (batch.worlds["num_transponders"] == number).all()
    assert np.ptp(batch.worlds["target"], axis=0).max() == 0.0
    if scenario == "four":
        assert np.array_equal(batch.worlds["target"][0, :4], PUBLISHED)
        assert water(scenario="four", num_transponders=2).worlds["num_transponders"][0] == 2


def test_the_yaw_rate_vehicle_turns_first_and_then_goes():
    batch = play(water(), [1.0, -0.5, 5.0])
    w, heading = batch.worlds[0], np.radians(-30.0)
    x, y = -3.0, 9.0
    for turn in (30.0, -15.0, 30.0):  # a rate beyond 1 is held there
        heading += np.radians(turn)
        x, y = x + 3.0 * np.cos(heading), y + 3.0 * np.sin(heading)
    assert (w["x"], w["y"], w["heading"]) == pytest.approx((x, y, heading))
    assert w["place_x"][3] == w["x"] and w["place_y"][3] == w["y"]


def test_the_greedy_vehicle_steps_where_it_likes_within_reach():
    batch = play(water(vehicle="greedy"), [[0.6, -0.2]])
    assert (batch.worlds["x"][0], batch.worlds["y"][0]) == pytest.approx((0.0, 8.0))
    play(batch, [[3.0, 4.0]])
    assert (batch.worlds["x"][0], batch.worlds["y"][0]) == pytest.approx((3.0, 12.0))


@pytest.mark.parametrize("vehicle", ["yaw-rate", "greedy"])
def test_the_water_carries_every_vehicle(vehicle):
    size = 1 if vehicle == "yaw-rate" else 2
    still = play(water(vehicle=vehicle), [[0.4] * size] * 6).worlds[0]
    carried = play(flow(water(vehicle=vehicle), 0.5, -0.25), [[0.4] * size] * 6).worlds[0]
    assert carried["x"] - still["x"] == pytest.approx(3.0) and carried["y"] - still["y"] == pytest.approx(
        -1.5
    )


def test_the_current_scenario_drifts_and_its_level_is_a_factor():
    def drift(level):
        batch = water(20, scenario="current", num_fields=4, speed_m_s=0.0, current_level=level)
        start = batch.worlds["x"].copy()
        return play(batch, [0.0]).worlds["x"] - start

    one, two, none = drift(1.0), drift(2.0), drift(0.0)
    assert np.abs(one).max() > 0.05 and two == pytest.approx(2 * one, abs=0.05) and not none.any()


def test_ranges_have_the_stated_noise():
    batch = water(3000, range_std_m=0.5)
    error = batch.worlds["ranges"][:, 0, 0] - np.linalg.norm([20, 6, 6])
    assert kstest(error / 0.5, "norm").pvalue > 1e-3


def test_outliers_are_late_echoes():
    batch = water(
        3000, outlier_share=0.3, outlier_scale_m=50.0, range_std_m=1e-3, prior_std_m=(1.0, 1.0, 1.0)
    )
    error = batch.worlds["ranges"][:, 0, 0] - np.linalg.norm([20, 6, 6])
    late = np.abs(error) > 0.01
    assert late.mean() == pytest.approx(0.3, abs=0.03) and error[late].min() > 0
    assert kstest(error[late] / 50.0, "halfnorm").pvalue > 1e-3


def test_missed_replies_are_nan_and_change_no_belief():
    batch = play(water(400, scenario="four", miss_share=0.25), [0.1] * 9)
    w = batch.worlds
    missed = np.isnan(w["ranges"][:, :4, :10])
    assert missed.mean() == pytest.approx(0.25, abs=0.02)
    assert np.array_equal(w["replies"][:, :4], 10 - missed.sum(-1))
    silent = play(water(2, miss_share=1.0), [0.1] * 5).worlds[0]
    assert np.array_equal(silent["estimate"], silent["prior_mean"]) and silent["replies"][0] == 0
    assert silent["log_det"] == pytest.approx(-np.log(1e4 * 1e4 * 4))


def test_a_wrong_speed_of_sound_scales_all_ranges_of_an_episode_alike():
    batch = play(
        water(2000, sound_speed_error=0.02, range_std_m=1e-3, prior_std_m=(1.0, 1.0, 1.0)), [0.0] * 3
    )
    w = batch.worlds
    away = np.hypot(w["place_x"][:, :4] - 17.0, w["place_y"][:, :4] - 15.0)
    ratio = w["ranges"][:, 0, :4] / np.hypot(away, 6.0)
    assert np.ptp(ratio, axis=1).max() < 1e-3
    assert kstest((ratio[:, 0] - 1.0) / 0.02, "norm").pvalue > 1e-3


def test_first_estimates_scatter_about_the_truth_as_stated():
    w = water(2000, prior_std_m=(30.0, 10.0, 1.0)).worlds
    error = (w["prior_mean"] - w["target"])[:, 0] / (30.0, 10.0, 1.0)
    for axis in range(3):
        assert kstest(error[:, axis], "norm").pvalue > 1e-3


def test_first_estimates_lie_in_the_water():
    w = water(500, scenario="field").worlds
    assert w["prior_mean"][:, :2, 2].min() >= 0.0 and w["estimate"][:, :2, 2].min() >= 0.0
    assert (w["prior_mean"][:, :2, 2] > 1.15 + 2.0).any()


def test_belief_is_the_map_of_prior_and_ranges():
    """Zero gradient of the posterior at the estimate, and the information the paper's equation 4.13 has there."""
    w = play(water(scenario="four"), [0.5, -0.2, 0.8] * 3).worlds[0]
    places = np.stack([w["place_x"], w["place_y"], np.zeros(128)], -1)[: w["count"]]
    prior = np.diag([1e-4, 1e-4, 0.25])
    log_det = 0.0
    for m in range(4):
        offset = w["estimate"][m] - places
        distance = np.linalg.norm(offset, axis=1)
        direction = offset / distance[:, None]
        residual = w["ranges"][m, : w["count"]] - distance
        gradient = prior @ (w["prior_mean"][m] - w["estimate"][m]) + direction.T @ residual / 0.12**2
        information = prior + direction.T @ direction / 0.12**2
        # Within a thousandth of a standard deviation of a range of the stationary point.
        assert np.abs(np.linalg.solve(information, gradient)).max() < 1e-3
        assert unpacked(w["information"][m]) == pytest.approx(information, rel=1e-3, abs=1e-3)
        log_det += np.linalg.slogdet(unpacked(w["information"][m]))[1]
    assert w["log_det"] == pytest.approx(log_det) and w["diverged"] == 0


@pytest.mark.parametrize("scenario", ["single", "four"])
def test_rewards_of_information_sum_to_the_gain_of_an_episode(scenario):
    batch = water(5, scenario=scenario, error_weight=2.0)
    begun = batch.worlds["log_det"].copy()
    error = batch.metrics()["rmse_m"]
    total = np.zeros(5)
    lost = np.zeros(5)
    for _ in range(29):
        play(batch, [0.7])
        total += batch.reward_terms[:, 0]
        lost += batch.reward_terms[:, 1]
        assert batch.rewards == pytest.approx(batch.reward_terms.sum(1))
    number = batch.worlds["num_transponders"][0]
    assert total == pytest.approx((batch.worlds["log_det"] - begun) / number)
    assert lost == pytest.approx(2.0 * np.log((error + 0.12) / (batch.metrics()["rmse_m"] + 0.12)))
    assert batch.truncated.all() and (total > 5.0).all()


def test_metrics_are_those_of_the_record():
    batch = play(water(6, scenario="random"), [0.4] * 12)
    w, found = batch.worlds, batch.metrics()
    for i in range(6):
        number = w["num_transponders"][i]
        error = (w["estimate"] - w["target"])[i, :number]
        square = np.einsum("mi,mij,mj->m", error, unpacked(w["information"][i, :number]), error)
        assert found["nees"][i] == pytest.approx(square.mean())
        assert found["rmse_m"][i] == pytest.approx(np.sqrt((error**2).sum(-1).mean()))
    assert (found["duration_s"] == 12.0).all() and not found["flight_energy_wh"].any()


def test_random_worlds_lie_where_they_should():
    w = water(600, scenario="random").worlds
    assert np.unique(w["num_transponders"]).tolist() == [1, 2, 3, 4, 5, 6]
    for i, number in enumerate(w["num_transponders"]):
        assert not w["target"][i, number:].any()
        assert np.hypot(*w["target"][i, :number, :2].T).max() <= 30.0
        assert w["target"][i, :number, 2].min() >= 3.0 and w["target"][i, :number, 2].max() <= 15.0
    assert np.hypot(w["x"], w["y"]).max() <= 30.0
    assert kstest(w["heading"], "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 1e-3
    assert (water(4, scenario="random", num_transponders=3).worlds["num_transponders"] == 3).all()


def test_an_aquaquad_pays_for_hops_and_drifts_for_nothing():
    batch = water(**DEEP)
    w = batch.worlds[0]
    play(batch, [[0.5, 0.0]])
    flown = 200.0 * 60.0 / 3600.0
    assert w["flight_wh"] == pytest.approx(flown) and w["hops"] == 1 and w["flight_s"] == pytest.approx(60.0)
    assert terms(batch)["energy"] == pytest.approx(-0.5 * flown / 10.0) and w["time_s"] == 300.0
    play(batch, [[0.05, 0.0]])
    assert w["flight_wh"] == pytest.approx(flown) and w["hops"] == 1 and w["drift_s"] == pytest.approx(540.0)
    assert w["battery_wh"] + w["spent_wh"] + w["clipped_wh"] == pytest.approx(178.0 + w["solar_wh"])


def test_an_aquaquad_hops_as_far_as_it_says_and_drifts_on():
    still = play(water(**DEEP, current_level=0.0), [[0.3, 0.4]]).worlds[0]
    assert still["x"] - still["start_x"] == pytest.approx(400.0)
    assert still["y"] - still["start_y"] == pytest.approx(4000 / 3 * 0.4)
    carried = play(flow(water(**DEEP), 0.2, 0.1), [[0.3, 0.4]]).worlds[0]
    assert carried["x"] - carried["start_x"] == pytest.approx(400.0 + 0.2 * 240.0)
    assert carried["y"] - carried["start_y"] == pytest.approx(4000 / 3 * 0.4 + 0.1 * 240.0)


@pytest.mark.parametrize(
    "params, actions, end",
    [
        ({}, [[1.0, 0.0]] * 9, "left box"),
        ({"battery_wh": 5.0}, [[0.9, 0.0], [-0.9, 0.0]], "battery empty"),
        ({"obstacles": ((-4000.0, -4000.0, 4000.0, 4000.0),)}, [[0.2, 0.0]], "collision"),
    ],
)
def test_a_lost_aquaquad_measures_no_more(params, actions, end):
    batch = water(**{**DEEP, "current_level": 0.0, **params})
    for action in actions:
        count = batch.worlds["count"][0]
        play(batch, [action])
        if batch.done[0]:
            break
    assert outcome(batch) == end and batch.terminated[0] and not batch.truncated[0]
    assert terms(batch)["failure"] == -5.0 and terms(batch)["information"] == 0.0
    assert batch.worlds["count"][0] == count


def test_the_published_random_motion_at_once():
    """Rows k = 0 of the published tables: ln det Y after 3, 7 and 30 measurements, its mean to a tenth."""
    batch = water(1000, seed=1)
    rng = np.random.default_rng(0)
    for n in range(2, 31):
        batch.step(rng.uniform(-1, 1, (1000, 1)))
        for at, mean, std in ((3, 4.24, 0.70), (7, 8.77, 0.65), (30, 15.73, 1.68)):
            if n == at:
                assert batch.worlds["log_det"].mean() == pytest.approx(mean, abs=0.12), n
                assert batch.worlds["log_det"].std() == pytest.approx(std, rel=0.2), n
    assert not batch.metrics()["diverged"].any() and np.median(batch.metrics()["rmse_m"]) < 0.6

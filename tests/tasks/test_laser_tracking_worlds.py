"""Worlds of laser tracking: light and its reading, other sensors, rewards, metrics, streams of random numbers."""

import numpy as np
import pytest

from aquaquad_envs import make_world_batch
from aquaquad_envs.sensing.laser import detectable_radius, intensity
from aquaquad_envs.tasks.laser_tracking_data import X


def make(worlds=8, *, seed=0, **params):
    batch = make_world_batch("laser-tracking", worlds, **params)
    batch.reset(seed)
    return batch


def put(batch, offsets):
    """Put the quadrotor at ``offsets`` (worlds, 2) from the light's centre, at rest over it."""
    for plane in (0, 1):
        batch.worlds["uav"][:, plane, X] = batch.worlds["rov"][:, plane, X] + np.asarray(offsets)[:, plane]
    batch.worlds["uav"][:, :, 3:] = 0.0
    batch.worlds["uav"][:, :, 2] = 0.0


def test_light_and_detectable_area():
    """What the record says of the light is the beam's intensity at the distance that it says."""
    for profile in ("flat-top", "gaussian"):
        batch = make(5, scenario="still", profile=profile, noise_level=0.0, adc_bits=0)
        put(batch, [[0, 0], [0.3, 0.4], [0.0, 0.69], [-0.72, 0.0], [3.0, 0.0]])
        batch.step(np.zeros((5, 2)))
        beam, worlds = batch.constants.beam, batch.worlds
        # From above: at rest over a vehicle that stays, nothing moves.
        np.testing.assert_allclose(worlds["range_m"], [0, 0.5, 0.69, 0.72, 3.0], atol=1e-9)
        expected = [intensity(beam, r, 8.0) for r in worlds["range_m"]]
        np.testing.assert_allclose(worlds["light"], expected, rtol=1e-6, atol=1e-30)
        np.testing.assert_allclose(worlds["reading"], worlds["light"])
        assert detectable_radius(beam, 8.0) == pytest.approx(8.0 * np.sin(np.radians(5.0)))
        assert worlds["in_lda"].tolist() == [1, 1, 1, 0, 0]
    assert batch.constants.peak == pytest.approx(2 * 0.045 / (np.pi * (8 * np.sin(np.radians(5))) ** 2))


def test_a_reading_has_the_stated_noise_ambient_light_and_steps():
    batch = make(
        4000, scenario="still", noise_std_w_m2=1e-3, adc_bits=0, ambient_w_m2=0.02, full_scale_w_m2=1.0
    )
    put(batch, np.zeros((4000, 2)))
    batch.step(np.zeros((4000, 2)))
    error = batch.worlds["reading"] - 0.02 - batch.constants.peak
    assert abs(error.mean()) < 4e-3 / np.sqrt(4000) and error.std() == pytest.approx(1e-3, rel=0.05)
    coarse = make(500, scenario="still", noise_std_w_m2=5e-3, adc_bits=4, full_scale_w_m2=0.02)
    put(coarse, np.zeros((500, 2)))
    coarse.step(np.zeros((500, 2)))
    steps = coarse.worlds["reading"] / (0.02 / 15)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert coarse.worlds["reading"].max() == pytest.approx(0.02)  # saturated


def test_other_sensors():
    """Own motion, the vehicle's velocity and its sum, fixes: zero mean, stated deviations."""
    batch = make(3000, scenario="moving", position_std_m=0.1, velocity_std_m_s=0.05, fix_std_m=0.7)
    start = np.stack([batch.worlds["rov_x"], batch.worlds["rov_y"]], -1)
    fixes = []
    for _ in range(20):
        batch.step(np.tile([0.3, -0.2], (3000, 1)))
        fixes.append(batch.worlds["fix_s"][0])
    w = batch.worlds
    for measured, true, std in (
        ("own_x", "x", 0.1), ("own_y", "y", 0.1), ("own_u", "u", 0.05), ("own_v", "v", 0.05),
        ("seen_u", "rov_u", 0.05), ("seen_v", "rov_v", 0.05), ("fix_x", "rov_x", 0.7),
    ):  # fmt: skip
        error = w[measured] - w[true]
        assert abs(error.mean()) < 4 * std / np.sqrt(3000) and error.std() == pytest.approx(std, rel=0.06), (
            measured
        )
    # The way carried: twenty velocities of 0.05 m/s over 0.1 s each.
    error = w["carried_x"] - (w["rov_x"] - start[:, 0])
    assert error.std() == pytest.approx(0.05 * 0.1 * np.sqrt(20), rel=0.06) and abs(error.mean()) < 2e-3
    # A fix is due every second.
    assert np.round(fixes, 6).tolist() == [0.0] * 9 + [1.0] * 10 + [2.0]
    guess = np.stack([w["guess_x"], w["guess_y"]], -1) - start
    assert guess.std() == pytest.approx(1.5, rel=0.05) and abs(guess.mean()) < 0.1
    assert (np.hypot(*start.T) >= 3.0 - 1e-9).all() and (np.hypot(*start.T) <= 5.0 + 1e-9).all()


def test_without_noise_sensors_tell_the_truth():
    batch = make(6, noise_level=0.0)
    for _ in range(25):
        batch.step(np.full((6, 2), 0.4))
    w = batch.worlds
    for measured, true in (("own_x", "x"), ("own_v", "v"), ("seen_u", "rov_u"), ("seen_v", "rov_v")):
        np.testing.assert_array_equal(w[measured], w[true])
    unknown = make(6, noise_level=0.0, rov_velocity="unknown")
    unknown.step(np.full((6, 2), 0.4))
    assert not unknown.worlds["seen_u"].any() and not unknown.worlds["carried_x"].any()


def test_ambient_light_varies_about_its_mean():
    batch = make(400, ambient_w_m2=0.01, ambient_variation=0.3, ambient_time_s=2.0)
    light = []
    for _ in range(200):
        batch.step(np.zeros((400, 2)))
        light.append(batch.worlds["ambient"].copy())
    light = np.array(light)
    assert light.min() >= 0.0 and light.mean() == pytest.approx(0.01, rel=0.02)
    assert light.std() == pytest.approx(0.003, rel=0.05)
    step = (light - 0.01) / 0.003
    assert np.mean(step[20:] * step[:-20]) == pytest.approx(np.exp(-1), abs=0.05)


def test_a_stream_shifts_no_other():
    """Noise, ambient light or another motion change what they are about, and nothing else of the episode."""
    plain = make(5, seed=3)
    others = {
        "noise": make(5, seed=3, noise_level=0.0),
        "ambient": make(5, seed=3, ambient_w_m2=0.01, ambient_variation=0.5),
        "motion": make(5, seed=3, scenario="wandering"),
    }
    for _ in range(12):
        for batch in (plain, *others.values()):
            batch.step(np.full((5, 2), 0.2))
    for name, batch in others.items():
        for field in ("guess_x", "x", "altitude"):
            np.testing.assert_array_equal(batch.worlds[field], plain.worlds[field], err_msg=name)
    for name in ("noise", "ambient"):
        np.testing.assert_array_equal(others[name].worlds["rov_x"], plain.worlds["rov_x"])
    np.testing.assert_array_equal(others["ambient"].worlds["own_x"], plain.worlds["own_x"])
    assert (others["motion"].worlds["rov_x"] != plain.worlds["rov_x"]).any()


def test_reward_terms():
    weights = {"light_weight": 2.0, "area_weight": 4.0, "center_weight": 3.0, "effort_weight": 0.5}
    batch = make(4, scenario="still", noise_level=0.0, **weights)
    put(batch, [[0, 0], [0.5, 0], [0, 2.0], [0, 0]])
    batch.step(np.array([[0, 0], [0, 0], [0, 0], [0.6, 0.8]], dtype=float))
    w, c = batch.worlds, batch.constants
    light, area, center, effort = batch.reward_terms.T
    np.testing.assert_allclose(light, 2.0 * 0.1 * np.minimum(w["light"] / c.peak, 1.0))
    np.testing.assert_allclose(area, 4.0 * 0.1 * (w["range_m"] <= c.radius))
    np.testing.assert_allclose(center, 3.0 * 0.1 * c.radius / (c.radius + w["range_m"]))
    np.testing.assert_allclose(effort, [0, 0, 0, -0.5 * 0.1], atol=1e-12)
    np.testing.assert_allclose(batch.rewards, batch.reward_terms.sum(-1))
    assert light[0] == pytest.approx(0.2) and light[2] == pytest.approx(0.0, abs=1e-9)
    # Nearer is better, also in the dark.
    assert center[0] > center[1] > center[2] > 0.0
    batch.step(np.array([[0, 0], [0, 0], [0, 0], [0.6, 0.8]], dtype=float))
    assert batch.reward_terms[3, 3] == 0.0  # the command did not change


def test_metrics_against_a_log():
    """A crossing of the light, counted here from the truth at every decision."""
    batch = make(30, scenario="moving", horizon_s=12.0, start_distance_m=3.0)
    inside, away = [], []
    while not batch.finished.all():
        w = batch.worlds
        towards = np.stack([w["rov_x"] - w["x"], w["rov_y"] - w["y"]], -1)
        if batch.worlds["steps"][0] > 70:
            towards = np.full((30, 2), 1.0)  # and away again
        batch.step(np.clip(towards, -1, 1))
        inside.append(batch.worlds["in_lda"].astype(bool))
        away.append(batch.worlds["range_m"].copy())
    inside, away = np.array(inside), np.array(away)
    found = batch.metrics()
    assert len(inside) == 120 and batch.truncated.all() and not batch.terminated.any()
    np.testing.assert_allclose(found["time_in_lda"], inside.mean(0))
    first = inside.argmax(0)
    assert inside.any(0).all() and (found["acquired"] == 1).all()
    np.testing.assert_allclose(found["time_to_acquire_s"], 0.1 * (first + 1))
    for i in range(30):
        after = slice(first[i] + 1, None)
        assert found["time_in_lda_acquired"][i] == pytest.approx(inside[after, i].mean())
        assert found["center_rmse_m"][i] == pytest.approx(np.sqrt((away[after, i] ** 2).mean()))
    assert 0.2 < found["time_in_lda_acquired"].mean() < 0.95
    assert (found["duration_s"] == 12.0).all()


def test_what_never_finds_the_light():
    batch = make(3, horizon_s=2.0)
    for _ in range(20):
        batch.step(np.zeros((3, 2)))
    found = batch.metrics()
    assert (found["acquired"] == 0).all() and (found["time_to_acquire_s"] == 2.0).all()
    assert np.isnan(found["time_in_lda_acquired"]).all() and np.isnan(found["center_rmse_m"]).all()


def test_a_finished_world_stays():
    batch = make(2, horizon_s=0.3)
    for _ in range(3):
        batch.step(np.ones((2, 2)))
    assert batch.truncated.all() and (batch.worlds["outcome"] == 1).all()
    before = batch.snapshot()
    batch.step(np.ones((2, 2)))
    assert np.array_equal(before, batch.worlds) and not batch.rewards.any() and batch.truncated.all()

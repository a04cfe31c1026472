"""What is remembered of readings: ground that is dark, where the centre must be, ambient light."""

import numpy as np
import pytest

from aquaquad_envs import make_world_batch
from aquaquad_envs.tasks.laser_tracking_data import SECTORS
from baselines import make_policy

RAYS = np.stack([f(2 * np.pi * np.arange(SECTORS) / SECTORS) for f in (np.cos, np.sin)], -1)


def make(worlds, *, seed=0, **params):
    batch = make_world_batch("laser-tracking", worlds, **params)
    batch.reset(seed)
    return batch


def place(w):
    return np.stack([w["own_x"] - w["carried_x"], w["own_y"] - w["carried_y"]], -1)


def test_swept_ground_was_seen_dark():
    """Every point that counts as swept lies near enough to a place where it was dark to be seen from there."""
    batch = make(16, scenario="still", start_distance_m=200.0)
    w, radius = batch.worlds, batch.constants.sweep
    rng = np.random.default_rng(0)
    for name in ("search_x", "search_y"):
        w[name] = rng.normal(0.0, 0.5, 16)
    places, grown = [], 0.0
    for _ in range(200):
        batch.step(rng.uniform(-1, 1, (16, 2)))
        places.append(place(w))
        grown = max(grown, w["swept"].max())
    assert (w["light_s"] < 0).all() and grown > radius
    seen = np.stack(places, 1)
    for k in range(16):
        center = np.array([w["search_x"][k], w["search_y"][k]])
        for ray, swept in zip(RAYS, w["swept"][k], strict=True):
            points = center + ray * np.linspace(0.0, 0.999 * swept, 50)[:, None]
            away = np.linalg.norm(points[:, None] - seen[k], axis=-1).min(1)
            assert (away <= radius + 1e-9).all()


def test_a_straight_way_through_the_centre_is_swept_to_its_end_and_on():
    batch = make(1, scenario="still", noise_level=0.0, start_distance_m=200.0)
    w, radius = batch.worlds, batch.constants.sweep
    w["search_x"] = w["search_y"] = 0.0
    for _ in range(50):
        batch.step(np.array([[1.0, 0.0]]))
    # Forgotten by 2 cm/s where nothing was added: the vehicle moves faster than that.
    assert w["swept"][0, 0] == pytest.approx(w["own_x"][0] + radius, abs=1e-6)
    assert w["swept"][0, SECTORS // 2] == pytest.approx(radius - 0.02 * w["time_s"][0], abs=0.02)


@pytest.mark.parametrize("scenario", ["still", "moving", "wandering"])
def test_the_centre_is_known_while_the_light_is_followed(scenario):
    batch = make(32, scenario=scenario)
    policy, w, errors = make_policy("ekf-tracking", batch), batch.worlds, []
    policy.reset(np.arange(32))
    for _ in range(600):
        batch.step(policy.act(batch.observations, w))
        x, y = w["center_x"] + w["carried_x"] - w["rov_x"], w["center_y"] + w["carried_y"] - w["rov_y"]
        errors.append(np.hypot(x, y)[w["detected"] == 1])
    errors = np.concatenate(errors)
    assert np.median(errors) < 0.35 * batch.constants.radius
    # While there is light it is never believed further off than light reaches.
    assert np.percentile(errors, 99) < 1.5 * batch.constants.radius


def test_light_clears_what_was_swept_and_moves_the_search():
    batch = make(64, scenario="still")
    policy, w = make_policy("ekf-tracking", batch), batch.worlds
    policy.reset(np.arange(64))
    swept_before = np.zeros(64, dtype=bool)
    for _ in range(400):
        before = w["swept"].max(1) > 0
        batch.step(policy.act(batch.observations, w))
        lit = w["detected"] == 1
        swept_before |= before & lit
        assert (w["swept"][lit] == 0).all()
        np.testing.assert_array_equal(w["search_x"][lit], w["center_x"][lit])
        never = w["light_s"] < 0
        np.testing.assert_array_equal(w["search_x"][never], w["guess_x"][never])
    assert swept_before.sum() > 10


def test_ambient_light_that_varies_is_followed_in_the_dark():
    batch = make(64, scenario="still", start_distance_m=200.0, ambient_w_m2=0.004, ambient_variation=0.35)
    w, followed, nominal = batch.worlds, [], []
    for step in range(600):
        batch.step(np.zeros((64, 2)))
        if step >= 100:
            followed.append(w["ambient_seen"] - w["ambient"])
            nominal.append(0.004 - w["ambient"])
    assert np.std(followed) < 0.6 * np.std(nominal) and abs(np.mean(followed)) < 0.2 * np.std(nominal)
    steady = make(4, scenario="still", ambient_w_m2=0.004)
    steady.step(np.zeros((4, 2)))
    assert (steady.worlds["ambient_seen"] == 0.004).all()

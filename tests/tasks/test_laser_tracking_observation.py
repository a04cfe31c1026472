"""What an agent of laser tracking observes: bounds, places, memory, and that it turns with the map."""

import numpy as np
import pytest

from agents.frames import frame_direction, vector_pairs
from aquaquad_envs import make_world_batch
from aquaquad_envs.tasks.laser_tracking_data import X
from aquaquad_envs.tasks.laser_tracking_observation import LAGS, OBSERVATION_NAMES

AT = {name: i for i, name in enumerate(OBSERVATION_NAMES)}


def make(worlds=8, *, seed=0, **params):
    batch = make_world_batch("laser-tracking", worlds, **params)
    batch.reset(seed)
    return batch


def vector(observations, name, scale):
    """The vector that a squashed pair stands for."""
    first = AT[name]
    squashed = observations[:, first : first + 2].astype(float)
    length = np.linalg.norm(squashed, axis=1, keepdims=True)
    return scale * squashed / (1.0 - length)


def test_within_bounds_wherever_it_is():
    batch = make(32, scenario="mixed", ambient_w_m2=0.01, ambient_variation=1.0, noise_level=5.0)
    rng = np.random.default_rng(0)
    for step in range(60):
        batch.step(rng.uniform(-1, 1, (32, 2)))
        if step == 30:
            batch.worlds["uav"][:, 0, X] += 1e6
        assert np.abs(batch.observations).max() <= 1.0 and np.isfinite(batch.observations).all()


def test_places_are_relative():
    """Without noise: to the guess, to the start and along the way, all as the submerged vehicle sees them."""
    batch = make(10, scenario="moving", noise_level=0.0, start_distance_m=50.0)
    scale = 2.0 * batch.constants.radius
    begun = np.stack([batch.worlds["rov_x"], batch.worlds["rov_y"]], -1)
    places = [np.zeros((10, 2))]
    for _ in range(40):
        batch.step(np.full((10, 2), -0.5))
        w = batch.worlds
        places.append(np.stack([w["own_x"] - w["carried_x"], w["own_y"] - w["carried_y"]], -1))
    o, here = batch.observations, places[-1]
    # The carried way is the sum of velocities at the decisions' ends.
    drifted = np.stack([w["rov_x"], w["rov_y"]], -1) - begun
    np.testing.assert_allclose(np.stack([w["carried_x"], w["carried_y"]], -1), drifted, atol=0.02)
    guess = np.stack([w["guess_x"], w["guess_y"]], -1)
    np.testing.assert_allclose(vector(o, "moved dx", scale), here, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(vector(o, "search dx", scale), guess - here, rtol=1e-4)
    np.testing.assert_allclose(vector(o, "goal dx", scale), guess - here, rtol=1e-4)
    away = np.linalg.norm(guess - here, axis=1)
    np.testing.assert_allclose(o[:, AT["goal distance"]], away / (away + scale), rtol=1e-5)
    np.testing.assert_allclose(o[:, AT["goal direction x"]], (guess - here)[:, 0] / away, rtol=1e-5)
    own = np.stack([w["u"], w["v"]], -1)
    np.testing.assert_allclose(vector(o, "velocity u", 1.0), own, rtol=1e-4, atol=1e-5)
    below = np.stack([w["rov_u"], w["rov_v"]], -1)
    np.testing.assert_allclose(vector(o, "relative velocity u", 1.0), own - below, rtol=1e-4, atol=1e-5)
    for lag in LAGS:
        since = here - places[-1 - lag]
        np.testing.assert_allclose(vector(o, f"moved dx since {lag} ago", scale), since, rtol=1e-4, atol=1e-5)
    assert (o[:, AT["detected"]] == 0).all() and (o[:, AT["time since light"]] == 1).all()
    assert o[0, AT["time left"]] == pytest.approx(1 - 4.0 / 120.0)
    assert o[0, AT["height"]] == pytest.approx(8.0 / 16.0, abs=1e-3)


def test_memory_of_light_and_its_edges():
    """Across the light and beyond: gained on one side, lost on the other, the mean place in between."""
    batch = make(1, scenario="still", noise_level=0.0, guess_std_m=0.0)
    w, scale = batch.worlds, 2.0 * batch.constants.radius
    light = np.array([w["rov_x"][0], w["rov_y"][0]])
    for plane in (0, 1):
        w["uav"][0, plane, X] = light[plane] - (2.0 if plane == 0 else 0.0)
    signal, seen = [], []
    for _ in range(60):
        batch.step(np.array([[1.0, 0.0]]))
        o = batch.observations
        signal.append(float(o[0, AT["intensity"]]))
        seen.append((w["x"][0] - light[0], bool(o[0, AT["detected"]])))
    lit = [x for x, detected in seen if detected]
    edge = (
        8 * np.sin(np.radians(5.0)) * 10**0.1 * (2 * np.log(4.0)) ** 0.1
    )  # where a quarter of the peak is left
    assert min(lit) == pytest.approx(-edge, abs=0.11) and max(lit) == pytest.approx(edge, abs=0.11)
    assert max(signal) == pytest.approx(0.5, abs=1e-3)  # the whole light, squashed
    here = np.array([w["x"][0], w["y"][0]])
    # Seen on both sides, the centre is known along the way to the noise that a reading is granted.
    assert vector(o, "goal dx", scale)[0] + here == pytest.approx(light, abs=0.1)
    assert vector(o, "search dx", scale)[0] + here == pytest.approx(light, abs=0.1)
    assert vector(o, "last light dx", scale)[0] + here == pytest.approx(light + np.array([edge, 0]), abs=0.11)
    assert vector(o, "edge dx", scale)[0] + here == pytest.approx(light + np.array([edge, 0]), abs=0.11)
    assert vector(o, "rim dx", scale)[0] + here == pytest.approx(light, abs=0.1)
    assert o[0, AT["edge kind"]] == -1.0
    gone = w["time_s"][0] - w["light_s"][0]
    assert gone > 0.5 and o[0, AT["time since light"]] == pytest.approx(gone / (gone + 5.0))
    assert o[0, AT["intensity 32 ago"]] == pytest.approx(signal[-33], abs=1e-6)


def test_vectors_stand_in_pairs_that_a_frame_can_turn():
    assert frame_direction(OBSERVATION_NAMES) == ("goal direction x", "goal direction y")
    pairs = vector_pairs(OBSERVATION_NAMES)
    turned = {OBSERVATION_NAMES[i] for pair in pairs for i in pair}
    still = set(OBSERVATION_NAMES) - turned - {"goal direction x", "goal direction y"}
    assert not any(word in name.split() for name in still for word in ("dx", "dy", "u", "v", "x", "y"))


def test_an_episode_turned_by_a_quarter_is_observed_turned():
    """The same world and commands, all turned by 90°: pairs turn, the rest stays."""
    plain, turned = (make(6, scenario="moving", noise_level=0.0) for _ in "ab")
    for a, b, sign in (("x", "y", 1.0), ("y", "x", -1.0)):
        for name in ("guess", "rov", "center", "search"):
            turned.worlds[f"{name}_{b}"] = sign * plain.worlds[f"{name}_{a}"]
    for b, sign in ((1, 1.0), (0, -1.0)):
        turned.worlds["rov"][:, b, X] = sign * plain.worlds["rov"][:, 1 - b, X]
    turned.worlds["wanted_v"], turned.worlds["wanted_u"] = plain.worlds["wanted_u"], -plain.worlds["wanted_v"]
    for _ in range(50):
        towards = plain.observations[:, AT["goal direction x"] :][:, :2].astype(float)
        plain.step(towards)
        turned.step(np.stack([-towards[:, 1], towards[:, 0]], -1))
    pairs = [*vector_pairs(OBSERVATION_NAMES), (AT["goal direction x"], AT["goal direction y"])]
    expected = plain.observations.copy()
    for i, j in pairs:
        expected[:, i], expected[:, j] = -plain.observations[:, j], plain.observations[:, i]
    np.testing.assert_allclose(turned.observations, expected, atol=1e-5)

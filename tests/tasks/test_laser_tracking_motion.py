"""How the vehicles of laser tracking move: the models of physics/, commands, and the four motions below."""

import numpy as np
import pytest

from aquaquad_envs import make_world_batch
from aquaquad_envs.physics.quadrotor import Quadrotor, fly
from aquaquad_envs.physics.rov import Rov, dive
from aquaquad_envs.tasks.laser_tracking_data import INT_Z, MIXED, PLANAR, SCENARIOS


def make(worlds=8, **params):
    batch = make_world_batch("laser-tracking", worlds, **params)
    batch.reset(0)
    return batch


def fold(state, integrals):
    """A planar row of the record: states, and the integrals that are in use."""
    return np.concatenate([state, integrals[1:]])


def test_two_planar_models_one_an_axis():
    """Bit for bit the loops of physics/, plane by plane, under changing commands; a climb on the way."""
    batch = make(3, scenario="turning", start_altitude_m=3.0)
    rng = np.random.default_rng(0)
    uav, rov = batch.worlds["uav"].copy(), batch.worlds["rov"].copy()
    for _ in range(15):
        actions = rng.uniform(-0.7, 0.7, (3, 2))
        batch.step(actions)
        for i, world in enumerate(batch.worlds):
            for plane, (own, below) in enumerate((("command_u", "wanted_u"), ("command_v", "wanted_v"))):
                track = np.empty((11, 6))
                state, integrals = uav[i, plane, :6].copy(), np.concatenate([[0.0], uav[i, plane, INT_Z:]])
                fly(
                    state,
                    integrals,
                    np.tile([world[own], -4.0], (10, 1)),
                    False,
                    True,
                    Quadrotor(),
                    0.01,
                    track,
                )
                uav[i, plane] = fold(state, integrals)
                state, integrals = rov[i, plane, :6].copy(), np.concatenate([[0.0], rov[i, plane, INT_Z:]])
                dive(
                    state,
                    integrals,
                    np.tile([world[below], 4.0, 0.0], (10, 1)),
                    False,
                    True,
                    Rov(),
                    0.01,
                    track,
                )
                rov[i, plane] = fold(state, integrals)
        assert uav.shape == (3, 2, PLANAR)
        np.testing.assert_array_equal(batch.worlds["uav"], uav)
        np.testing.assert_array_equal(batch.worlds["rov"], rov)
        np.testing.assert_array_equal(batch.worlds["x"], uav[:, 0, 0])
        np.testing.assert_array_equal(batch.worlds["altitude"], -0.5 * (uav[:, 0, 1] + uav[:, 1, 1]))


def test_commands_are_velocities_within_the_unit_disc():
    batch = make(4, max_speed_m_s=0.8)
    for _ in range(60):
        batch.step(np.array([[1.0, 0.0], [0.0, -0.5], [3.0, 4.0], [-1.0, 1.0]]))
    expected = 0.8 * np.array([[1.0, 0.0], [0.0, -0.5], [0.6, 0.8], [-np.sqrt(0.5), np.sqrt(0.5)]])
    worlds = batch.worlds
    np.testing.assert_allclose(np.stack([worlds["command_u"], worlds["command_v"]], -1), expected, atol=1e-12)
    np.testing.assert_allclose(np.stack([worlds["u"], worlds["v"]], -1), expected, atol=0.02)
    assert abs(worlds["altitude"] - 4.0).max() < 0.05


def test_the_published_plane():
    """One axis: nothing moves along y; from the ground it climbs to its altitude."""
    batch = make(16, axes=1, start_altitude_m=0.0, scenario="mixed")
    assert batch.action_shape == (16, 1) and (batch.worlds["altitude"] == 0.0).all()
    for _ in range(100):
        batch.step(np.full((16, 1), 0.5))
    worlds = batch.worlds
    for name in ("y", "v", "rov_y", "rov_v", "own_y", "guess_y", "carried_y", "command_v", "fix_y"):
        assert (worlds[name] == 0.0).all(), name
    np.testing.assert_allclose(worlds["altitude"], 4.0, atol=0.05)
    np.testing.assert_allclose(worlds["u"], 0.5, atol=0.02)
    assert set(np.sign(worlds["guess_x"])) == {-1.0, 1.0}


@pytest.mark.parametrize("scenario", ["still", "moving", "turning", "wandering"])
def test_motions_of_the_submerged_vehicle(scenario):
    batch = make(64, scenario=scenario, turn_period_s=20.0, wander_time_s=5.0)
    start = np.stack([batch.worlds["rov_x"], batch.worlds["rov_y"]], -1)
    track, speeds = [start], []
    for _ in range(400):
        batch.step(np.zeros((64, 2)))
        track.append(np.stack([batch.worlds["rov_x"], batch.worlds["rov_y"]], -1))
        speeds.append(np.hypot(batch.worlds["rov_u"], batch.worlds["rov_v"]))
    track, speeds = np.array(track), np.array(speeds)
    assert (batch.worlds["motion"] == SCENARIOS[scenario]).all()
    assert speeds.max() < 0.31 and abs(batch.worlds["depth"] - 4.0).max() < 0.01
    steady = track[-200:]
    if scenario == "still":
        assert abs(track - start).max() < 1e-9
    if scenario == "moving":
        assert speeds[-1].min() > 0.029 and speeds[-1].max() > 0.25
        # A straight line, evenly.
        assert abs(np.diff(steady, 2, axis=0)).max() < 1e-4
    if scenario == "turning":
        course = np.unwrap(np.arctan2(*np.diff(steady, axis=0).transpose(2, 0, 1)[::-1]), axis=0)
        rate = abs(course[-1] - course[0]) / (0.1 * (len(course) - 1))
        assert (rate > 0.45 * 2 * np.pi / 20).all() and (rate < 1.55 * 2 * np.pi / 20).all()
        assert set(np.sign(course[-1] - course[0])) == {-1.0, 1.0}
    if scenario == "wandering":
        along = np.diff(steady, axis=0) / 0.1
        assert abs(along.mean()) < 0.03 and 0.08 < along.std() < 0.16
        # Correlation over one correlation time is 1/e.
        a, b = along[:-50].ravel(), along[50:].ravel()
        assert 0.1 < np.corrcoef(a, b)[0, 1] < 0.6


def test_mixed_draws_all_four_in_equal_parts():
    kinds = make(2000, scenario="mixed").worlds["motion"]
    counts = np.bincount(kinds, minlength=MIXED)
    assert len(counts) == MIXED and abs(counts - 500).max() < 4 * np.sqrt(2000 * 0.25 * 0.75)
    # The kind changes nothing else: courses of one seed are the same in mixed and moving.
    moving, mixed = make(200, scenario="moving").worlds, make(200, scenario="mixed").worlds
    straight = mixed["motion"] == SCENARIOS["moving"]
    np.testing.assert_array_equal(moving["wanted_u"][straight], mixed["wanted_u"][straight])

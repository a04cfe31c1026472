"""The goal's frame: what turns with the map, and that a turned map is the same lesson."""

import numpy as np
import pytest

import aquaquad_envs
from agents.frames import Frame, vector_pairs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.drift_hop_observation import OBSERVATION_NAMES


@pytest.fixture
def observations():
    batch = aquaquad_envs.make_world_batch("drift-hop", 50, scenario="gyres", num_fields=8)
    return batch.reset(0).copy()


def test_every_vector_is_found_once():
    pairs = vector_pairs(OBSERVATION_NAMES)
    names = [(OBSERVATION_NAMES[i], OBSERVATION_NAMES[j]) for i, j in pairs]
    assert ("x", "y") in names and ("forecast u 45°", "forecast v 45°") in names
    assert ("drift dx in 4 h", "drift dy in 4 h") in names and ("goal hop x", "goal hop y") in names
    assert not any("goal direction" in name for pair in names for name in pair)
    flat = pairs.ravel()
    assert len(set(flat)) == len(flat)
    components = {"x", "y", "dx", "dy", "u", "v"}
    left = [n for i, n in enumerate(OBSERVATION_NAMES) if i not in flat and components & set(n.split())]
    assert left == ["goal direction x", "goal direction y"]


def test_the_goal_lies_ahead_and_lengths_stay(observations):
    frame = Frame("goal", OBSERVATION_NAMES)
    seen = frame.observe(observations)
    at = OBSERVATION_NAMES.index
    assert (seen[:, at("goal dx")] > 0).all()
    np.testing.assert_allclose(seen[:, at("goal dy")], 0.0, atol=1e-6)
    for i, j in vector_pairs(OBSERVATION_NAMES):
        np.testing.assert_allclose(
            np.hypot(seen[:, i], seen[:, j]), np.hypot(observations[:, i], observations[:, j]), atol=1e-6
        )
    # What is no vector, and the input itself, stay as they are.
    assert (seen[:, at("battery")] == observations[:, at("battery")]).all()
    assert Frame("world", OBSERVATION_NAMES).observe(observations) is observations


def test_actions_there_and_back(observations):
    frame = Frame("goal", OBSERVATION_NAMES)
    actions = np.random.default_rng(0).uniform(-0.7, 0.7, (50, 2))
    np.testing.assert_allclose(
        frame.act(frame.see_actions(actions, observations), observations), actions, atol=1e-6
    )
    towards = frame.act(np.tile([1.0, 0.0], (50, 1)), observations)
    at = OBSERVATION_NAMES.index("goal direction x")
    np.testing.assert_allclose(towards, observations[:, at : at + 2], atol=1e-6)
    assert np.abs(frame.act(np.ones((50, 2)), observations)).max() <= 1.0


def test_a_turned_map_looks_the_same():
    """Uniform current, position and goal turned by 90°: the same in the goal's frame but for north and obstacles."""
    seen = []
    for turn in (0, 1):
        batch = aquaquad_envs.make_world_batch("drift-hop", 1, team=(), obstacles=())
        rotate = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turn)
        velocity = np.empty_like(batch.ocean.velocity)
        velocity[:] = rotate @ (0.3, -0.4)
        batch.ocean = batch.ocean._replace(velocity=velocity)
        batch.reset(0)
        batch.worlds["x"], batch.worlds["y"] = rotate @ (-1000.0, 500.0)
        batch.worlds["goal_x"], batch.worlds["goal_y"] = rotate @ (2500.0, 1500.0)
        batch.step(np.zeros((1, 2)))
        seen.append(Frame("goal", OBSERVATION_NAMES).observe(batch.observations)[0])
    north = [OBSERVATION_NAMES.index(name) for name in ("goal direction x", "goal direction y")]
    np.testing.assert_allclose(np.delete(seen[0], north), np.delete(seen[1], north), atol=1e-5)


def test_a_team_turns_to_its_nearest_target():
    batch = aquaquad_envs.make_world_batch("sensor-placement", 6, scenario="calm")
    names = batch.task.observation_names
    rows = batch.reset(0).reshape(-1, len(names))
    seen = Frame("goal", names).observe(rows)
    np.testing.assert_allclose(seen[:, names.index("target 1 dy")], 0.0, atol=1e-6)
    assert (seen[:, names.index("target 1 dx")] >= 0).all()
    # An agent that is done sees zeros, and its actions stay as they are.
    nothing = np.zeros((1, len(names)), np.float32)
    assert not Frame("goal", names).observe(nothing).any()
    np.testing.assert_allclose(Frame("goal", names).act(np.array([[0.3, -0.2]]), nothing), [[0.3, -0.2]])


def test_a_team_that_traces_a_plume_turns_along_the_current():
    batch = aquaquad_envs.make_world_batch("plume-tracing", 3, num_fields=3, plume_age_s=20.0)
    names = batch.task.observation_names
    rows = batch.reset(0).reshape(-1, len(names))
    frame = Frame("goal", names)
    seen = frame.observe(rows)
    for k in range(1, 6):
        pair = [names.index(f"robot {k} d{axis}") for axis in "xy"]
        along = rows[:, names.index("flow direction x")] * rows[:, pair[0]]
        along += rows[:, names.index("flow direction y")] * rows[:, pair[1]]
        np.testing.assert_allclose(seen[:, pair[0]], along, atol=1e-6)
    # Upstream, and down as it was.
    acted = frame.act(np.tile([-1.0, 0.0, 0.7], (len(rows), 1)), rows)
    np.testing.assert_allclose(acted[:, 0], -rows[:, names.index("flow direction x")], atol=1e-6)
    np.testing.assert_allclose(acted[:, 2], 0.7)
    back = frame.see_actions(acted, rows)
    np.testing.assert_allclose(back, np.tile([-1.0, 0.0, 0.7], (len(rows), 1)), atol=1e-6)


def test_refuses_unknown_frames_and_tasks_without_a_direction():
    with pytest.raises(InvalidParameterError, match="frame"):
        Frame("north", OBSERVATION_NAMES)
    with pytest.raises(InvalidParameterError, match="direction"):
        Frame("goal", ("x", "y"))

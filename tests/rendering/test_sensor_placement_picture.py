"""The picture of sensor placement: what is drawn, where, and that it follows the world."""

import numpy as np
import pytest

pytest.importorskip("pygame")

from aquaquad_envs import make_world_batch
from aquaquad_envs.rendering import make_renderer, sea, sensor_placement

SCENARIOS = {
    "calm": {}, "vortex": {"num_targets": 3, "num_vehicles": 8}, "gyres": {"num_fields": 3},
    "fence": {"num_fields": 2}, "grid": {"num_vehicles": 5, "num_targets": 5},
}  # fmt: skip


def scene(scenario="calm", **params):
    batch = make_world_batch("sensor-placement", 1, scenario=scenario, **params)
    batch.reset(0)
    return batch, make_renderer(batch, "rgb_array", 10)


def pixel(picture, renderer, x, y):
    column, row = renderer._picture.view.pixel(x, y)
    return picture[int(row), int(column)].astype(int)


def near(picture, renderer, x, y, color):
    """Least difference from ``color`` within some pixels of a place."""
    column, row = (int(value) for value in renderer._picture.view.pixel(x, y))
    around = picture[row - 7 : row + 8, column - 7 : column + 8].astype(int)
    return np.abs(around - color).max(-1).min()


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_scenario_has_a_picture_that_changes_with_the_world(scenario):
    batch, renderer = scene(scenario, **SCENARIOS[scenario])
    first = renderer.draw(batch.worlds[0])
    assert first.shape == (720, 640, 3) and first.dtype == np.uint8
    batch.step(np.full(batch.action_shape, 0.5))
    second = renderer.draw(batch.worlds[0])
    assert (first != second).any() and not np.shares_memory(first, second)


def test_vehicles_targets_and_estimates_are_where_they_are():
    batch, renderer = scene()
    world = batch.worlds[0]
    world["x"][:4], world["y"][:4] = (-4000, -4000, 4000, 4000), (-4000, 4000, 4000, -4000)
    world["target_x"][0], world["target_y"][0] = 1500, 1000
    world["estimate"][0, :2] = -1500, -1000
    world["covariance"][0][:2, :2] = np.diag([800.0**2, 200.0**2])
    picture = renderer.draw(world)
    for i in range(4):
        assert near(picture, renderer, world["x"][i], world["y"][i], sea.VEHICLE) < 30
    assert near(picture, renderer, 1500, 1000, sensor_placement.TARGET) < 30
    assert near(picture, renderer, -1500, -1000, sensor_placement.BELIEF) < 30
    # The 95 % ellipse: 2.448 standard deviations along each axis, and nothing half-way.
    scale = np.sqrt(-2 * np.log(0.05))
    for dx, dy in ((800 * scale, 0.0), (-800 * scale, 0.0), (0.0, 200 * scale), (0.0, -200 * scale)):
        assert np.abs(pixel(picture, renderer, -1500 + dx, -1000 + dy) - sensor_placement.BELIEF).max() < 60
    assert np.abs(pixel(picture, renderer, -1500 + 400 * scale, -1000) - sensor_placement.BELIEF).max() > 60


def test_a_lost_vehicle_is_told_from_one_that_works():
    batch, renderer = scene()
    world = batch.worlds[0]
    x, y = float(world["x"][0]), float(world["y"][0])
    assert near(renderer.draw(world), renderer, x, y, sea.VEHICLE) < 30
    world["agent_outcome"][0] = batch.task.outcomes.index("collision")
    assert near(renderer.draw(world), renderer, x, y, sea.VEHICLE) > 60


def test_hops_leave_a_track_until_the_next_episode():
    batch, renderer = scene()
    before = renderer.draw(batch.worlds[0])
    for _ in range(3):
        batch.step(np.tile([0.6, 0.0], (1, 4, 1)))
        after = renderer.draw(batch.worlds[0])

    def hops(picture):
        water = picture[sea.HEADER : sea.HEADER + sea.MAP].astype(int)
        return int((np.abs(water - sea.HOP).max(-1) < 30).sum())

    assert hops(after) > hops(before) + 100
    batch.reset(0)
    assert hops(renderer.draw(batch.worlds[0])) < 20

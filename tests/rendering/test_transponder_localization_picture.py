"""The picture of transponder localization: what is drawn, where, and that it follows the world."""

import numpy as np
import pytest

pytest.importorskip("pygame")

from aquaquad_envs import make_world_batch
from aquaquad_envs.rendering import beliefs, make_renderer, sea

SCENARIOS = {
    "single": {}, "four": {"vehicle": "greedy"}, "current": {"num_fields": 3},
    "deep": {"num_fields": 2, "vehicle": "aquaquad", "solar": "constant"},
}  # fmt: skip


def scene(scenario="single", **params):
    batch = make_world_batch("transponder-localization", 1, scenario=scenario, **params)
    batch.reset(0)
    return batch, make_renderer(batch, "rgb_array", 10)


def near(picture, renderer, x, y, color, pixels=7):
    """Least difference from ``color`` within some pixels of a place."""
    column, row = (int(value) for value in renderer._picture.view.pixel(x, y))
    around = picture[row - pixels : row + pixels + 1, column - pixels : column + pixels + 1].astype(int)
    return np.abs(around - color).max(-1).min()


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_scenario_has_a_picture_that_changes_with_the_world(scenario):
    batch, renderer = scene(scenario, **SCENARIOS[scenario])
    first = renderer.draw(batch.worlds[0])
    assert first.shape == (720, 640, 3) and first.dtype == np.uint8
    batch.step(np.full(batch.action_shape, 0.5))
    second = renderer.draw(batch.worlds[0])
    assert (first != second).any() and not np.shares_memory(first, second)


def test_transponder_estimate_and_vehicle_are_where_they_are():
    batch, renderer = scene()
    world = batch.worlds[0]
    world["x"], world["y"] = -20.0, -30.0
    world["prior_mean"][0, :2] = 40.0, -40.0
    world["target"][0, :2] = 30.0, 20.0
    world["estimate"][0, :2] = -30.0, 30.0
    # Deviations of 8 m east and 2 m north.
    world["information"][0] = (1 / 64, 0.0, 0.0, 1 / 4, 0.0, 1.0)
    picture = renderer.draw(world)
    assert near(picture, renderer, -20, -30, sea.VEHICLE) < 30
    assert near(picture, renderer, 30, 20, beliefs.TARGET) < 30
    for x, y in ((-30, 30), (40, -40)):
        assert near(picture, renderer, x, y, beliefs.BELIEF) < 60
    # The 95 % ellipse: 2.448 standard deviations along each axis, and nothing half-way.
    scale = np.sqrt(-2 * np.log(0.05))
    for dx, dy in ((8 * scale, 0.0), (-8 * scale, 0.0), (0.0, 2 * scale), (0.0, -2 * scale)):
        assert near(picture, renderer, -30 + dx, 30 + dy, beliefs.BELIEF, 1) < 60
    assert near(picture, renderer, -30 + 4 * scale, 30, beliefs.BELIEF, 1) > 60


def test_the_prior_of_a_large_box_has_its_ellipse():
    batch, renderer = scene("deep", num_fields=2, num_transponders=1)
    world = batch.worlds[0]
    world["prior_mean"][0, :2] = 0.0, 0.0
    world["estimate"][0, :2] = world["target"][0, :2] = 4500.0, 4500.0
    world["place_x"][0], world["place_y"][0] = world["x"], world["y"] = -4500.0, -4500.0
    world["start_x"], world["start_y"] = world["x"], world["y"]
    picture = renderer.draw(world)
    radius = 1000.0 * np.sqrt(-2 * np.log(0.05))
    found = [
        near(picture, renderer, radius * np.cos(a), radius * np.sin(a), beliefs.BELIEF, 1) < 60
        for a in np.linspace(0, 2 * np.pi, 400)
    ]
    assert 0.3 < np.mean(found) < 1.0  # dashed


def test_a_track_grows_until_the_next_episode():
    batch, renderer = scene()
    fresh = renderer.draw(batch.worlds[0])
    for _ in range(6):
        batch.step(np.full(batch.action_shape, 0.2))
        renderer.draw(batch.worlds[0])
    assert len(renderer._picture.track.segments[0].points) == 7
    batch.reset(0)
    assert np.array_equal(renderer.draw(batch.worlds[0]), fresh)

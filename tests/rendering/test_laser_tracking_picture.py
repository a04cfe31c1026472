"""The picture of laser tracking: what is drawn, where, and that it follows the world."""

import numpy as np
import pytest

pytest.importorskip("pygame")

from aquaquad_envs import make_world_batch
from aquaquad_envs.rendering import laser_tracking as picture_of
from aquaquad_envs.rendering import make_renderer, sea
from aquaquad_envs.tasks.laser_tracking_data import X


def scene(**params):
    batch = make_world_batch("laser-tracking", 1, **params)
    batch.reset(0)
    return batch, make_renderer(batch, "rgb_array", 10)


def color_at(picture, renderer, x, y):
    column, row = renderer._picture.pixel(x, y)
    return picture[int(row), int(column)].astype(int)


def near(picture, renderer, x, y, color):
    column, row = (int(value) for value in renderer._picture.pixel(x, y))
    around = picture[row - 7 : row + 8, column - 7 : column + 8].astype(int)
    return np.abs(around - color).max(-1).min()


@pytest.mark.parametrize(
    "params", [{}, {"axes": 1, "start_altitude_m": 0.0}, {"profile": "gaussian", "depth_m": 20.0}]
)
def test_a_picture_that_changes_with_the_world(params):
    batch, renderer = scene(**params)
    first = renderer.draw(batch.worlds[0])
    width, height = renderer._picture.size
    assert first.shape == (height, width, 3) and first.dtype == np.uint8
    for _ in range(10):
        batch.step(np.full(batch.action_shape, 0.5))
    second = renderer.draw(batch.worlds[0])
    assert (first != second).any() and not np.shares_memory(first, second)


def test_discs_guess_and_vehicle_are_where_they_are():
    batch, renderer = scene(scenario="still")
    world = batch.worlds[0]
    world["guess_x"], world["guess_y"] = world["rov_x"] + 4.0, world["rov_y"] - 3.0
    picture = renderer.draw(world)
    light = np.array([world["rov_x"], world["rov_y"]])
    lda, lia = 8 * np.sin(np.radians(5.0)), 8 * np.sin(np.radians(10.0))
    for radius, color in ((0.8 * lda, picture_of.DETECTABLE), (0.5 * (lda + lia), picture_of.LIT)):
        for along in ((radius, 0.0), (0.0, -radius)):
            assert np.abs(color_at(picture, renderer, *(light + along)) - color).max() < 8
    assert np.abs(color_at(picture, renderer, light[0] + 1.3 * lia, light[1]) - picture_of.LIT).max() > 15
    assert near(picture, renderer, world["x"], world["y"], sea.VEHICLE) < 30
    assert near(picture, renderer, world["guess_x"], world["guess_y"], sea.FORECAST) < 30


def test_the_track_tells_where_light_was_seen_and_is_forgotten():
    batch, renderer = scene(scenario="still", noise_level=0.0)
    for plane in (0, 1):
        batch.worlds["uav"][0, plane, X] = batch.worlds["rov"][0, plane, X] - (2.5 if plane == 0 else 0.0)
    for _ in range(65):
        batch.step(np.array([[1.0, 0.0]]))
        picture = renderer.draw(batch.worlds[0])
    light = batch.worlds["rov_x"][0], batch.worlds["rov_y"][0]
    for offset, color in ((-1.6, sea.HOP), (0.35, sea.GOAL), (1.3, sea.HOP)):
        assert near(picture, renderer, light[0] + offset, light[1], color) < 40, offset
    batch.reset(0)
    again = renderer.draw(batch.worlds[0]).astype(int)
    map_of = again[picture_of.HEADER : picture_of.HEADER + picture_of.MAP]
    assert (np.abs(map_of - sea.HOP).max(-1) < 30).sum() < 20

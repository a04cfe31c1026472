"""The picture of plume tracing: what is drawn, where, from above and from the south, and that it follows the world."""

import numpy as np
import pytest

pytest.importorskip("pygame")

from aquaquad_envs import make_world_batch
from aquaquad_envs.rendering import make_renderer, plume_tracing, sea

SMALL = {"num_fields": 2, "plume_age_s": 60.0}


def scene(scenario="surround", **params):
    extra = {} if scenario in ("surround", "corner") else SMALL
    batch = make_world_batch("plume-tracing", 1, scenario=scenario, **{**extra, **params})
    batch.reset(0)
    return batch, make_renderer(batch, "rgb_array", 10)


def near(picture, point, color):
    """Least difference from ``color`` within some pixels of a place."""
    column, row = (int(value) for value in point)
    around = picture[row - 4 : row + 5, column - 4 : column + 5].astype(int)
    return np.abs(around - color).max(-1).min()


@pytest.mark.parametrize("scenario", ["surround", "corner", "advected", "turbulent"])
def test_every_scenario_has_a_picture_that_changes_with_the_world(scenario):
    batch, renderer = scene(scenario)
    first = renderer.draw(batch.worlds[0])
    assert first.shape == (*plume_tracing.Picture.size[::-1], 3) and first.dtype == np.uint8
    batch.step(np.full(batch.action_shape, 1.0))
    second = renderer.draw(batch.worlds[0])
    assert (first != second).any() and not np.shares_memory(first, second)


def test_robots_and_source_are_where_they_are_in_both_views():
    batch, renderer = scene(num_robots=2)
    world, picture = batch.worlds[0], renderer._picture
    world["x"][:2], world["y"][:2], world["z"][:2] = (-20, 20), (10, -30), (4, 16)
    world["reading"][:2] = (0.0, 1.0)
    world["source_x"], world["source_y"] = 5, 25
    drawn = renderer.draw(world)
    for i, color in enumerate((sea.VEHICLE, plume_tracing.DETECTS)):
        x, y, z = (float(world[name][i]) for name in "xyz")
        assert near(drawn, picture.view.pixel(x, y), color) < 30
        assert near(drawn, picture.side_pixel(x, z), color) < 30
    assert near(drawn, picture.view.pixel(5, 25), plume_tracing.SOURCE) < 30
    assert near(drawn, picture.side_pixel(5, 10), plume_tracing.SOURCE) < 30
    assert picture.side_pixel(5, 0)[0] == picture.view.pixel(5, 25)[0], "one above the other"


def test_the_plume_is_opaque_where_its_puffs_are():
    batch, renderer = scene("turbulent")
    world, picture = batch.worlds[0], renderer._picture
    for from_south, rows in ((False, "puff_y"), (True, "puff_z")):
        opacity = picture.plume_colors(world, from_south=from_south)[..., 3].astype(float)
        alive = int(world["released"])
        half = picture.view.half_width_m
        column = (world["puff_x"][:alive] + half) / (2 * half) * (opacity.shape[1] - 1)
        share = world[rows][:alive] / 10.0 if from_south else (half - world[rows][:alive]) / (2 * half)
        inside = np.abs(column - opacity.shape[1] / 2) < opacity.shape[1] / 2 - 1
        at = opacity[
            np.rint(share * (opacity.shape[0] - 1)).astype(int)[inside], np.rint(column).astype(int)[inside]
        ]
        assert at.min() > 3 * opacity.mean() and opacity.max() > 150


def test_tracks_last_until_the_next_episode():
    batch, renderer = scene()
    for _ in range(3):
        batch.step(np.ones(batch.action_shape))
        renderer.draw(batch.worlds[0])
    assert [len(track) for track in renderer._picture.tracks] == [3] * 10
    batch.reset(0)
    renderer.draw(batch.worlds[0])
    assert [len(track) for track in renderer._picture.tracks] == [1] * 10

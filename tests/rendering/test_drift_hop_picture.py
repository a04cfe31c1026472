"""The picture of drift/hop: what is drawn, where, and that it follows the world."""

import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pygame")

from aquaquad_envs import make_world_batch
from aquaquad_envs.rendering import make_renderer, sea

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "currents"
SCENARIOS = {
    "vortex": {"scenario": "vortex", "obstacle_margin_m": 300.0},
    "cells": {"scenario": "vortex", "interpolation": "cell"},
    "gyres": {"scenario": "gyres", "num_fields": 3},
    "wide": {"scenario": "gyres", "num_fields": 2, "half_width_m": 20_000.0},
    "forecast": {"scenario": "forecast-error", "num_fields": 2},
    "tide": {"scenario": "tide", "num_fields": 2, "start_time_spread_s": 7200.0},
    "discrete": {"scenario": "vortex", "action_type": "discrete"},
}


def scene(**params):
    batch = make_world_batch("drift-hop", 1, **({"scenario": "vortex"} | params))
    batch.reset(0)
    return batch, make_renderer(batch, "rgb_array", 10)


def moved(world, x, y, *, hop=False, seconds=600.0):
    """The same world a decision later, elsewhere."""
    world["x"], world["y"] = x, y
    world["time_s"] += seconds
    world["hops"] += hop


def pixel(picture, renderer, x, y):
    column, row = renderer._picture.view.pixel(x, y)
    return picture[int(row), int(column)].astype(int)


def share_of(color, picture, tolerance=30):
    """How many pixels of the map have about this colour."""
    water = picture[sea.HEADER : sea.HEADER + sea.MAP].astype(int)
    return int((np.abs(water - color).max(-1) <= tolerance).sum())


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_has_a_picture_that_changes_with_the_world(name):
    batch, renderer = scene(**SCENARIOS[name])
    first = renderer.draw(batch.worlds[0])
    assert first.shape == (720, 640, 3) and first.dtype == np.uint8
    action = np.zeros(1, dtype=int) if name == "discrete" else np.zeros((1, 2))
    batch.step(action)
    second = renderer.draw(batch.worlds[0])
    assert second is not first and not np.shares_memory(first, second)
    assert (first != second).any()
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 200


def test_real_currents_with_land():
    path = DATA / "wcofs_subset.nc"
    if not path.exists():
        pytest.skip(f"no {path.name}: the data files are not in this checkout")
    pytest.importorskip("xarray")
    batch, renderer = scene(scenario="file", currents_file=str(path), num_fields=2)
    assert renderer.draw(batch.worlds[0]).std() > 10


def test_same_states_same_picture_and_drawing_leaves_the_world_alone():
    pictures = []
    for _ in range(2):
        batch, renderer = scene(scenario="gyres", num_fields=3)
        renderer.draw(batch.worlds[0])
        for heading in (0.0, 1.0, 0.0):
            batch.step(np.array([[heading, 0.0]]))
            before = batch.snapshot()
            pictures.append(renderer.draw(batch.worlds[0]))
            assert (batch.worlds == before).all()
    for first, second in zip(pictures[:3], pictures[3:], strict=True):
        np.testing.assert_array_equal(first, second)


def test_vehicle_is_drawn_where_it_is():
    batch, renderer = scene()
    world = batch.worlds[0]
    moved(world, -3000.0, -2000.0)
    first = renderer.draw(world)
    assert np.abs(pixel(first, renderer, -3000, -2000) - sea.VEHICLE).max() < 20
    moved(world, 2500.0, 3500.0, hop=True)
    second = renderer.draw(world)
    assert np.abs(pixel(second, renderer, 2500, 3500) - sea.VEHICLE).max() < 20
    assert np.abs(pixel(second, renderer, -3000, -2000) - sea.VEHICLE).max() > 60


def test_a_vehicle_that_left_the_box_stays_in_sight():
    batch, renderer = scene()
    moved(batch.worlds[0], 6300.0, 200.0, hop=True)
    assert share_of(sea.VEHICLE, renderer.draw(batch.worlds[0])) > 40


def test_drift_and_hop_look_different():
    pictures = []
    for hop in (False, True):
        batch, renderer = scene()
        renderer.draw(batch.worlds[0])
        moved(batch.worlds[0], 3000.0, 4000.0, hop=hop)
        pictures.append(renderer.draw(batch.worlds[0]))
    drift, hop = (share_of(sea.HOP, picture) for picture in pictures)
    assert drift == 0 and hop > 300
    # A drift is one line, a hop is dashed: along it the colour changes again and again.
    changes = []
    for picture in pictures:
        along = [pixel(picture, renderer, x, 4000.0).sum() for x in np.linspace(-3500, 2500, 600)]
        changes.append(int((np.abs(np.diff(along)) > 80).sum()))
    assert changes[0] < 3 and changes[1] > 20


def test_goal_has_its_true_radius_or_is_just_visible():
    batch, renderer = scene(goal_radius_m=800.0)
    picture = renderer.draw(batch.worlds[0])
    inset = 1.5 / renderer._picture.view.pixels_per_m
    for angle in np.linspace(0, 2 * np.pi, 12):
        x, y = 3000 + (800 - inset) * np.cos(angle), -3000 + (800 - inset) * np.sin(angle)
        assert np.abs(pixel(picture, renderer, x, y) - sea.GOAL).max() < 90
    batch, renderer = scene(goal_radius_m=1.0)
    assert share_of(sea.GOAL, renderer.draw(batch.worlds[0])) > 60


def test_obstacle_margin_and_open_water_differ():
    batch, renderer = scene(obstacle_margin_m=400.0)
    picture = renderer.draw(batch.worlds[0])

    def mean(x, y):
        column, row = (int(value) for value in renderer._picture.view.pixel(x, y))
        return picture[row - 6 : row + 6, column - 6 : column + 6].reshape(-1, 3).mean(0)

    solid, margin, water = mean(0, 0), mean(1200, 300), mean(1750, 300)
    assert solid[0] - solid[2] > 10, "land is warm"
    assert margin[2] - margin[0] > -5, "water shows through a margin"
    assert water[2] - water[0] > 20, "water is blue"
    assert solid.sum() < margin.sum() < water.sum()


def test_faster_water_is_darker():
    batch, renderer = scene(obstacles=())
    field, _ = renderer._picture._field(0)
    picture = renderer.draw(batch.worlds[0])
    # Beside the arrows: means over squares of water, slow near the centre and fast near a corner.
    lightness, speed = [], []
    for x in (500.0, 2000.0, 4500.0):
        column, row = (int(value) for value in renderer._picture.view.pixel(x, x))
        lightness.append(np.median(picture[row - 12 : row + 12, column - 12 : column + 12]))
        speed.append(np.hypot(*field.sample(x, x)))
    assert np.all(np.diff(speed) > 0) and np.all(np.diff(lightness) < 0)


@pytest.mark.parametrize(("scenario", "changes"), [("tide", True), ("vortex", False)])
def test_the_map_shows_the_current_of_the_present_time(scenario, changes):
    batch, renderer = scene(scenario=scenario, num_fields=1)
    water = slice(sea.HEADER, sea.HEADER + sea.MAP)
    first = renderer.draw(batch.worlds[0])[water]
    batch.worlds["time_s"] = 3 * 3600.0
    renderer.restart()
    assert (first != renderer.draw(batch.worlds[0])[water]).any() == changes


def test_the_map_shows_the_truth_not_the_forecast():
    batch, renderer = scene(scenario="forecast-error", num_fields=2)
    world = batch.worlds[0]
    assert world["truth"] != world["forecast"]
    with_forecast = renderer.draw(world)
    assert share_of(sea.FORECAST, with_forecast, 12) > 100
    world["forecast"] = world["truth"]
    known = make_renderer(batch, "rgb_array", 10).draw(world)
    assert share_of(sea.FORECAST, known, 12) == 0
    # But for the arrows the map is the same: a forecast that is believed does not colour the water.
    assert (known == with_forecast).all(-1).mean() > 0.9


def test_track_joins_hops_in_a_row_and_tells_drifts_apart():
    batch, _ = scene()
    world, track = batch.worlds[0], sea.Track()
    track.add(world)
    track.add(world)
    assert track.segments == []
    for x, hop in ((-3000, False), (-2000, True), (-1000, True), (0, False), (500, False)):
        moved(world, x, 4000.0, hop=hop)
        track.add(world)
    assert [segment.is_hop for segment in track.segments] == [False, True, False]
    assert track.segments[1].points == [(-3000, 4000), (-2000, 4000), (-1000, 4000)]
    assert track.segments[2].points == [(-1000, 4000), (0, 4000), (500, 4000)]
    batch.reset(1)
    track.add(world)
    assert track.segments == [], "a clock that went back is a new episode"


def test_restart_forgets_the_track():
    batch, renderer = scene()
    blank = renderer.draw(batch.worlds[0])
    for _ in range(4):
        batch.step(np.array([[1.0, 0.0]]))
        renderer.draw(batch.worlds[0])
    batch.reset(0)
    renderer.restart()
    np.testing.assert_array_equal(renderer.draw(batch.worlds[0]), blank)
    # Also where the clock does not tell, as on a restored snapshot.
    renderer.restart()
    moved(batch.worlds[0], 3000.0, 4000.0, hop=True)
    assert share_of(sea.HOP, renderer.draw(batch.worlds[0])) == 0


def test_outcome_and_battery_are_shown():
    batch, renderer = scene()
    world = batch.worlds[0]
    header = slice(0, sea.HEADER)
    pictures = [renderer.draw(world)[header]]
    world["battery_wh"] *= 0.1
    pictures.append(renderer.draw(world)[header])
    for outcome in range(1, len(batch.task.outcomes)):
        world["outcome"] = outcome
        pictures.append(renderer.draw(world)[header])
    for i, first in enumerate(pictures):
        assert all((first != second).any() for second in pictures[i + 1 :])


@pytest.mark.parametrize("name", ["gyres", "forecast"])
def test_thirty_pictures_a_second(name):
    """In processor time, so that a busy machine does not fail it; each step shows a new current."""
    batch, renderer = scene(**SCENARIOS[name])
    renderer.draw(batch.worlds[0])
    took = []
    for step in range(15):
        batch.step(np.full((1, 2), 0.2 if step % 3 == 0 else 0.0))
        began = time.process_time()
        renderer.draw(batch.worlds[0])
        took.append(time.process_time() - began)
    assert np.median(took) < 1 / 30

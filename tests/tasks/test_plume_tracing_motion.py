"""How robots of plume tracing begin and move: the published layouts, limits, spacing, errors of course and place."""

import numpy as np
import pytest

from tests.tasks.plume_tracing_worlds import places, stay, team


def test_ring_and_arc_lie_as_published():
    batch = team(40, scenario="surround")
    for world in range(40):
        here = places(batch, world)
        angle = np.rad2deg(np.arctan2(here[:, 1], here[:, 0])) % 360
        np.testing.assert_allclose(angle, np.arange(0, 360, 36), atol=1e-9)
        radius = np.hypot(here[:, 0], here[:, 1])
        assert np.abs(radius / 20 - 1).max() <= 0.001
        height = 10.0 - here[:, 2]
        assert (height >= 7.2).all() and (height <= 8.8).all()
    heights = 10.0 - batch.worlds["z"][:, :10]
    assert heights.min() < 7.3 and heights.max() > 8.7, "uniform within ± 10 %"
    here = places(team(scenario="corner"))
    np.testing.assert_allclose(
        np.rad2deg(np.arctan2(here[:, 1], here[:, 0])), np.linspace(25, 65, 10), atol=1e-9
    )


def test_teams_downstream_of_a_plume_keep_apart_and_in_the_water():
    batch = team(60, scenario="turbulent", num_robots=30, num_fields=8, plume_age_s=10.0)
    w = batch.worlds
    flow = batch.ocean.velocity.mean((1, 2, 3))[w["truth"]]
    ahead = np.stack([w["x"].mean(-1) - w["source_x"], w["y"].mean(-1) - w["source_y"]], -1)
    cosine = (flow * ahead).sum(-1) / np.hypot(*flow.T) / np.hypot(*ahead.T)
    assert np.median(cosine) > 0.9, "the team lies where the current goes"
    assert ((w["source_z"] >= 2.0) & (w["source_z"] <= 8.0)).all()
    for world in range(60):
        here = places(batch, world)
        gaps = np.linalg.norm(here[:, None] - here, axis=-1) + 10 * np.eye(30)
        assert gaps.min() >= 0.5
        assert np.abs(here[:, :2]).max() <= 40 and (here[:, 2] >= 0).all() and (here[:, 2] <= 10).all()


def test_a_move_is_the_action_times_the_step_limit_on_each_axis():
    batch = team(num_robots=3)
    before = places(batch)
    batch.step(np.array([[[1, -1, 1], [0.2, 0, -0.5], [5, 0.1, -7]]], dtype=float))
    wanted = 0.5 * np.array([[1, -1, 1], [0.2, 0, -0.5], [1, 0.1, -1]])
    np.testing.assert_allclose(places(batch) - before, wanted, atol=1e-12)
    np.testing.assert_allclose(places(batch, prefix="moved_"), wanted, atol=1e-12)


def test_walls_surface_and_bottom_hold_robots():
    batch = team(num_robots=2, at=[(49.8, -49.9, 0.1), (0.0, 0.0, 19.9)])
    batch.step(np.array([[[1, -1, -1], [0, 0, 1]]], dtype=float))
    np.testing.assert_allclose(places(batch), [(50, -50, 0), (0, 0, 20)], atol=1e-12)


def test_robots_bound_to_the_surface_stay_there():
    batch = team(surface_bound=True)
    assert (places(batch)[:, 2] == 0).all()
    batch.step(np.ones(batch.action_shape))
    assert (places(batch)[:, 2] == 0).all()
    w = batch.worlds[0]
    np.testing.assert_allclose(w["distance"][:10], np.hypot(w["x"], w["y"])[:10])


def test_moves_are_shortened_by_tenths_until_clear_of_others():
    # 0.75 m apart, steps of 0.5 m: half of the way leaves 0.5 m, more does not.
    batch = team(num_robots=2, at=[(0.0, 0.0, 5.0), (0.75, 0.0, 5.0)])
    batch.step(np.array([[[1, 0, 0], [0, 0, 0]]], dtype=float))
    assert places(batch)[0, 0] == pytest.approx(0.25)
    assert list(batch.worlds["blocked"][0, :2]) == [1, 0]
    assert batch.reward_terms[0, 0, 4] == pytest.approx(-0.02 / 2)
    batch.step(np.array([[[1, 0, 0], [-1, 0, 0]]], dtype=float))
    np.testing.assert_allclose(places(batch)[:, 0], [0.25, 0.75], atol=1e-12)
    assert list(batch.worlds["blocked"][0, :2]) == [1, 1]


def test_robots_too_near_each_other_may_part():
    batch = team(num_robots=2, at=[(0.0, 0.0, 5.0), (0.2, 0.0, 5.0)])
    batch.step(np.array([[[-0.2, 0, 0], [0, 0, 0]]], dtype=float))
    assert places(batch)[0, 0] == pytest.approx(-0.1)
    batch.step(np.array([[[0.2, 0, 0], [0, 0, 0]]], dtype=float))
    assert places(batch)[0, 0] == pytest.approx(-0.1), "but not come nearer"


def test_spacing_is_kept_by_any_play():
    batch = team(8, num_robots=30, start_radius_m=6.0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        goal = np.stack([-batch.worlds[name][:, :30] for name in "xyz"], -1)
        goal[..., 2] += 10
        batch.step(np.clip(goal + rng.uniform(-1, 1, goal.shape), -1, 1))
    for world in range(8):
        gaps = np.linalg.norm(places(batch, world)[:, None] - places(batch, world), axis=-1)
        assert (gaps + 10 * np.eye(30)).min() >= 0.5 - 1e-9


def courses(batch):
    moved = places(batch, prefix="moved_")
    return np.rad2deg(np.arctan2(moved[:, 1], moved[:, 0]))


def test_heading_errors_turn_moves_and_keep_their_length():
    east = np.tile([1.0, 0.0, 0.5], (1, 10, 1))
    first = team(heading_error_deg=30.0)
    first.step(east)
    np.testing.assert_allclose(np.linalg.norm(places(first, prefix="moved_"), axis=1), 0.5 * np.hypot(1, 0.5))
    once = courses(first)
    assert np.abs(once).max() <= 30 and np.ptp(once) > 5
    first.step(east)
    np.testing.assert_allclose(courses(first), once, atol=1e-9)
    anew = team(heading_error_deg=30.0, heading_error_kind="each-move")
    anew.step(east)
    before = courses(anew)
    anew.step(east)
    assert np.abs(courses(anew) - before).max() > 5 and np.abs(courses(anew)).max() <= 30


def test_position_errors_are_of_the_measurement_alone():
    batch = team(20, position_error_m=0.5)
    before = batch.worlds["x"].copy()
    stay(batch, 3)
    assert (batch.worlds["x"] == before).all()
    for name, most in (("x", 0.5), ("y", 0.5), ("z", 0.0)):
        error = (batch.worlds[f"seen_{name}"] - batch.worlds[name])[:, :10]
        assert np.abs(error).max() <= most
        if most:
            assert error.std() == pytest.approx(most / np.sqrt(3), rel=0.15)


def test_the_published_position_error_is_a_walk_at_every_robots_turn():
    batch = team(200, position_error_m=0.25, position_error_kind="random-walk", updates="sequential")
    before = batch.worlds["x"][:, :10].copy()
    stay(batch, 10)
    assert (batch.worlds["updates"] == 1).all()
    moved = batch.worlds["x"][:, :10] - before
    # Ten turns, in each of which all robots wander.
    assert moved.std() == pytest.approx(0.25 * np.sqrt(10 / 3), rel=0.05)
    assert (batch.worlds["seen_x"] == batch.worlds["x"]).all()
    # What is read is the field before the walk, and so are the distances.
    w = batch.worlds
    now = np.sqrt((w["x"] - w["source_x"][:, None]) ** 2 + (w["y"]) ** 2 + (w["z"] - 10) ** 2)[:, :10]
    assert np.abs(now - w["distance"][:, :10]).max() > 0.05


def test_one_robot_a_step_where_updates_are_sequential():
    batch = team(num_robots=3, updates="sequential", horizon_updates=2)
    for step in range(6):
        before = places(batch)
        assert batch.worlds["turn"][0] == step % 3
        batch.step(np.full(batch.action_shape, 0.4))
        moved = (places(batch) != before).any(-1)
        assert list(moved) == [k == step % 3 for k in range(3)]
        assert batch.worlds["updates"][0] == (step + 1) // 3
        assert batch.worlds["time_s"][0] == pytest.approx((step + 1) / 3)
    assert batch.truncated.all()

"""The policies of plume tracing: what they steer for, and what they do when there is nothing to steer for."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy
from baselines.spiral_surge import spiral_course

SEEDS = np.arange(3)
#: F = 1/G is exactly quadratic about such a source.
LAMP = {"scenario": "surround", "field": "light", "layout": "scattered", "half_width_m": 30.0}
PRINTED = {"method": "qr", "readings": "now", "condition_limit": 1e300, "without_fit": "hold"}
PLUME = {"scenario": "turbulent", "num_fields": 2, "plume_age_s": 90.0}


def begun(worlds=3, seeds=SEEDS, **params):
    batch = make_world_batch("plume-tracing", worlds, **params)
    batch.reset(seeds)
    return batch


def actions_of(name, batch, **options):
    policy = make_policy(name, batch, **options)
    policy.reset(SEEDS)
    return policy.act(batch.observations, batch.worlds).copy()


@pytest.mark.parametrize(
    "options", [{}, {"method": "qr"}, {"method": "tls"}, PRINTED, {"range_m": 5.0}], ids=str
)
def test_a_quadratic_field_is_descended_straight_to_its_source(options):
    batch = begun(**LAMP)
    found = actions_of("quadratic-fit", batch, **options)
    assert found.dtype == np.float32 and found.shape == (3, 10, 3)
    np.testing.assert_allclose(found, actions_of("straight-line", batch), atol=1e-5)


def test_at_the_surface_it_is_descended_in_the_plane():
    batch = begun(**LAMP, surface_bound=True, source_depth_m=0.0)
    found = actions_of("quadratic-fit", batch)
    assert not found[..., 2].any()
    np.testing.assert_allclose(found, actions_of("straight-line", batch), atol=1e-5)
    # Of a lamp below, two dimensions find the place above it.
    deep = begun(**LAMP)
    depths = deep.worlds["z"].copy()
    flat = actions_of("quadratic-fit", deep, dimensions=2)
    assert not flat[..., 2].any() and (deep.worlds["z"] == depths).all()


def test_in_turn_only_one_robot_moves():
    batch = begun(**LAMP, updates="sequential")
    policy = make_policy("quadratic-fit", batch)
    policy.reset(SEEDS)
    for turn in range(3):
        found = policy.act(batch.observations, batch.worlds)
        assert found[:, turn].any(axis=-1).all()
        assert not np.delete(found, turn, axis=1).any()
        batch.step(found)


@pytest.mark.parametrize("name", ["quadratic-fit", "spiral-surge", "straight-line"])
def test_decisions_do_not_depend_on_other_worlds(name):
    together = begun(**PLUME)
    many = actions_of(name, together)
    for k in range(3):
        alone = begun(1, SEEDS[k : k + 1], **PLUME)
        np.testing.assert_array_equal(actions_of(name, alone)[0], many[k])
    assert np.isfinite(many).all() and np.abs(many).max() <= 1.0 + 1e-6


def test_the_printed_algorithm_holds_where_it_has_no_fit():
    batch = begun(**LAMP, num_robots=5)  # five readings, ten unknowns
    assert not actions_of("quadratic-fit", batch, **PRINTED).any()
    ten = begun(**LAMP)
    assert actions_of("quadratic-fit", ten, **PRINTED).any()
    assert not actions_of("quadratic-fit", ten, **{**PRINTED, "range_m": 0.1, "max_range_m": 0.1}).any()


def test_ours_goes_to_the_best_reading_where_it_has_no_fit():
    batch = begun(**LAMP, num_robots=5)
    policy = make_policy("quadratic-fit", batch)
    found = policy.act(batch.observations, batch.worlds)
    assert not policy.axes.any()
    best = batch.worlds["memory"][:, 0, 0, :3]
    places = np.stack([batch.worlds[name][:, :5] for name in ("x", "y", "z")], axis=-1)
    away = best[:, None] - places
    far = np.linalg.norm(away, axis=-1) > 2.0
    found_, away = found[far], away[far]
    cosines = (found_ * away).sum(-1) / (np.linalg.norm(found_, axis=-1) * np.linalg.norm(away, axis=-1))
    np.testing.assert_allclose(cosines, 1.0, atol=1e-6)
    assert far.sum() >= 9 and found[~far].any(axis=-1).all()


def test_three_robots_find_a_lamp_by_what_they_remember():
    batch = make_world_batch(
        "plume-tracing", 3, **{**LAMP, "num_robots": 3, "horizon_updates": 120, "stop_at_source": True}
    )
    found = rollout(make_policy("quadratic-fit", batch), batch, SEEDS).metrics
    assert found["success"].all() and (found["updates_to_source"] < 100).all()


def test_ill_conditioned_readings_go_to_the_plane():
    batch = begun(scenario="surround", start_height_spread=1e-5)
    policy = make_policy("quadratic-fit", batch)
    assert not policy.act(batch.observations, batch.worlds)[..., 2].any()
    assert (policy.axes == 3).all()
    open_ = make_policy("quadratic-fit", batch, condition_limit=1e300)
    open_.act(batch.observations, batch.worlds)
    assert (open_.axes == 7).all() and (open_.conditions > 1e4).all()


def test_the_logarithm_is_exact_in_a_gaussian():
    batch = begun(**LAMP)
    batch.worlds["reading"][:, :10] = np.exp(-0.5 * batch.worlds["distance"][:, :10] ** 2 / 9.0**2)
    straight = actions_of("straight-line", batch)
    np.testing.assert_allclose(actions_of("quadratic-fit", batch, transform="logarithm"), straight, atol=1e-5)
    assert np.abs(actions_of("quadratic-fit", batch) - straight).max() > 0.1


def test_the_straight_line_arrives_when_the_longest_axis_is_travelled():
    batch = make_world_batch("plume-tracing", 3, **{**LAMP, "num_robots": 2, "reach_time_s": 0.0})
    batch.reset(SEEDS)
    policy = make_policy("straight-line", batch)
    away = np.stack([batch.worlds[a][:, :2] - batch.worlds[f"source_{a}"][:, None] for a in "xyz"], axis=-1)
    needed = np.ceil(np.abs(away).max(-1) / batch.params.step_limit_m)
    for _ in range(int(needed.min(axis=1).max())):
        batch.step(policy.act(batch.observations, batch.worlds))
    np.testing.assert_allclose(batch.worlds["distance"][:, :2].min(axis=1), 0.0, atol=1e-4)


def test_turns_of_the_spiral_are_the_gap_apart():
    gap, step = 3.0, 0.01
    course = np.array([spiral_course.py_func(step * k, gap) for k in range(60_000)])
    path = np.cumsum(step * np.stack([np.cos(course), np.sin(course)]), axis=1)
    radius = np.hypot(*path)
    crossings = np.flatnonzero(np.diff(np.sign(path[1])) > 0)  # eastward axis, once a turn
    np.testing.assert_allclose(np.diff(radius[crossings])[3:], gap, rtol=0.05)


def test_spiral_surge_goes_upstream_on_a_detection_and_casts_after():
    batch = begun(**PLUME)
    worlds, robots = batch.worlds, batch.num_agents
    worlds["reading"][:, :robots] = 0.0
    worlds["reading"][:, 0] = 1.0
    policy = make_policy("spiral-surge", batch, surge_m=1.0)
    policy.reset(SEEDS)
    first = policy.act(batch.observations, worlds).copy()
    flow = np.stack([worlds["flow_u"][:, 0], worlds["flow_v"][:, 0]], axis=-1)
    upstream = -flow / np.linalg.norm(flow, axis=-1, keepdims=True)
    np.testing.assert_allclose(first[:, 0, :2], upstream, atol=1e-6)
    worlds["reading"][:, 0] = 0.0
    np.testing.assert_allclose(policy.act(batch.observations, worlds)[:, 0, :2], upstream, atol=1e-6)
    # The metre is over: a spiral, whose first course is a right angle off the robot's own.
    cast = policy.act(batch.observations, worlds)[:, 0, :2]
    np.testing.assert_allclose(cast, np.tile([0.0, 1.0], (3, 1)), atol=1e-6)


def test_spiral_surge_answers_the_strongest_call():
    batch = begun(**PLUME)
    worlds, robots = batch.worlds, batch.num_agents
    worlds["reading"][:, :robots] = 0.0
    worlds["memory_count"][:, 0] = 1
    worlds["memory"][:, 0, 0, :3] = 0.0
    found = actions_of("spiral-surge", batch)
    places = np.stack([worlds[f"seen_{a}"][:, :robots] for a in "xyz"], axis=-1)
    cosines = -(found * places).sum(-1) / (np.linalg.norm(found, axis=-1) * np.linalg.norm(places, axis=-1))
    np.testing.assert_allclose(cosines, 1.0, atol=1e-6)


@pytest.mark.parametrize(
    "name, options, named",
    [
        ("quadratic-fit", {"method": "svx"}, "Did you mean 'svd'"),
        ("quadratic-fit", {"dimensions": 4}, "dimensions: got 4"),
        ("quadratic-fit", {"readings": "all"}, "readings"),
        ("quadratic-fit", {"neighbours": 51}, "neighbours: got 51"),
        ("quadratic-fit", {"transform": "log"}, "transform"),
        ("quadratic-fit", {"without_fit": "stop"}, "without_fit"),
        ("quadratic-fit", {"range_m": 0.0}, "range_m: got 0.0"),
        ("quadratic-fit", {"condition_limit": 0.5}, "condition_limit"),
        ("spiral-surge", {"gap_m": 0.0}, "gap_m: got 0.0"),
        ("spiral-surge", {"patience_s": -1.0}, "patience_s"),
    ],
)
def test_wrong_options_are_named(name, options, named):
    batch = make_world_batch("plume-tracing", 1, **LAMP)
    with pytest.raises(InvalidParameterError, match=named):
        make_policy(name, batch, **options)

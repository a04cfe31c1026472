"""Scripted policies of laser tracking: what they do, what they know, and that they know no more."""

import math

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy
from baselines.laser_machine import LOST, SEARCH, TRACK

POLICIES = (
    "search-hold",
    "gradient-ascent",
    "ekf-tracking",
    "memory-tracking",
    "rov-tracking",
    "true-center",
)
#: What no sensor measures.
TRUTH = ("x", "y", "u", "v", "rov_x", "rov_y", "rov_u", "rov_v", "ambient", "range_m", "light", "in_lda")
SEEDS = 2_000_000 + np.arange(10)


def flown(name, seeds=SEEDS, options=None, **params):
    batch = make_world_batch("laser-tracking", len(seeds), **{"horizon_s": 60.0, **params})
    policy = make_policy(name, batch, **(options or {}))
    return rollout(policy, batch, seeds).metrics, batch, policy


def traced(batch, policy, seeds, *names):
    """The named fields of the record, (steps, worlds) each, and the machines' modes."""
    batch.reset(seeds)
    policy.reset(seeds)
    rows = []
    while not batch.finished.all():
        batch.step(policy.act(batch.observations, batch.worlds))
        rows.append([*(batch.worlds[name].copy() for name in names), policy.machines["mode"].copy()])
    return [np.array(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize(
    "name, scenario, least",
    [
        ("gradient-ascent", "still", 0.6), ("ekf-tracking", "still", 0.95), ("ekf-tracking", "moving", 0.95),
        ("memory-tracking", "moving", 0.95), ("memory-tracking", "wandering", 0.95),
        ("ekf-tracking", "wandering", 0.95), ("rov-tracking", "moving", 0.97), ("true-center", "wandering", 0.99),
    ],
)  # fmt: skip
def test_they_stay_in_the_light_once_they_have_it(name, scenario, least):
    metrics, _, _ = flown(name, scenario=scenario)
    assert metrics["acquired"].mean() >= 0.8
    assert np.nanmean(metrics["time_in_lda_acquired"]) >= least


def test_holding_loses_a_vehicle_that_moves():
    metrics, _, _ = flown("search-hold", scenario="moving")
    assert metrics["time_in_lda"].mean() < 0.3


@pytest.mark.parametrize("profile", ["gaussian", "flat-top"])
def test_on_one_axis(profile):
    metrics, batch, _ = flown("ekf-tracking", axes=1, start_altitude_m=0.0, profile=profile)
    assert np.nanmean(metrics["time_in_lda_acquired"]) > 0.9
    assert (batch.worlds["y"] == 0).all()


def test_an_unknown_velocity_is_estimated():
    """Without a measured velocity the filter finds it, from light alone, in most worlds."""
    _, batch, policy = flown(
        "ekf-tracking", scenario="moving", rov_velocity="unknown", guess_std_m=0.1, start_distance_m=1.5,
    )  # fmt: skip
    held = policy.machines["mode"] == TRACK
    assert held.mean() >= 0.5
    true = np.stack([batch.worlds["rov_u"], batch.worlds["rov_v"]], axis=-1)[held]
    error = np.hypot(*(policy.machines["state"][held, 2:] - true).T)
    assert np.median(error) < 0.35 * np.median(np.hypot(*true.T))


def test_search_flies_circles_one_spacing_apart():
    batch = make_world_batch("laser-tracking", 1, scenario="still", power_w=1e-12, horizon_s=80.0)
    policy = make_policy("search-hold", batch, spacing=1.0)
    x, y, own, _, mode = traced(batch, policy, [5], "x", "y", "own_u", "own_v")
    assert (mode == SEARCH).all() and len(own)
    world = batch.worlds[0]
    apart = np.hypot(x - world["guess_x"], y - world["guess_y"])[:, 0] / batch.constants.radius
    speed = np.hypot(np.diff(x[:, 0]), np.diff(y[:, 0])) / batch.constants.action_period
    # Time on each circle: its circumference at constant speed.
    begun = int(np.argmax(apart < 0.3))
    for k in (2, 3, 4):
        on = np.abs(apart[begun:] - k) < 0.25
        length = on.sum() * batch.constants.action_period * policy.settings.search_speed
        assert length == pytest.approx(2 * math.pi * k * batch.constants.radius, rel=0.25)
    assert np.median(speed[begun + 50 :]) == pytest.approx(policy.settings.search_speed, rel=0.1)


@pytest.mark.parametrize("name", POLICIES)
def test_they_know_only_what_is_measured(name):
    """Lies about the truth change no action but those of the policy that is said to know it."""
    batch = make_world_batch("laser-tracking", 3, scenario="moving", horizon_s=60.0)
    honest, lied = (make_policy(name, batch) for _ in range(2))
    batch.reset(SEEDS[:3])
    for policy in (honest, lied):
        policy.reset(SEEDS[:3])
    same = True
    for _ in range(150):
        worlds = batch.snapshot()
        for field in TRUTH:
            worlds[field] = 7 if field == "in_lda" else worlds[field] + 5.0
        actions = honest.act(batch.observations, batch.worlds)
        same &= np.array_equal(actions, lied.act(batch.observations, worlds))
        batch.step(actions)
    assert same == (name != "true-center")


@pytest.mark.parametrize("name", ["ekf-tracking", "memory-tracking", "rov-tracking"])
def test_actions_do_not_depend_on_the_batch(name):
    params = {"scenario": "mixed", "horizon_s": 20.0}
    many = make_world_batch("laser-tracking", 4, **params)
    whole = rollout(make_policy(name, many), many, SEEDS[:4])
    one = make_world_batch("laser-tracking", 1, **params)
    alone = rollout(make_policy(name, one), one, SEEDS[2:3])
    assert whole.worlds[2] == alone.worlds[0]


def test_light_that_goes_is_lost_and_searched_for():
    batch = make_world_batch(
        "laser-tracking", 1, scenario="still", start_distance_m=1.0, guess_std_m=0.0, horizon_s=60.0
    )
    policy = make_policy("ekf-tracking", batch, patience=1.0)
    batch.reset([3])
    policy.reset(np.array([3]))
    for _ in range(100):
        batch.step(policy.act(batch.observations, batch.worlds))
    assert policy.machines["mode"][0] == TRACK
    modes = []
    for _ in range(14):
        dark = batch.snapshot()
        dark["reading"] = 0.0
        policy.act(batch.observations, dark)
        modes.append(int(policy.machines["mode"][0]))
    assert modes[0] == LOST and modes[-1] == SEARCH
    assert modes == sorted(modes, key=lambda mode: (LOST, SEARCH).index(mode))
    bright = batch.snapshot()
    bright["reading"] = batch.constants.peak
    policy.act(batch.observations, bright)
    assert policy.machines["mode"][0] == TRACK


def test_ambient_light_is_followed_while_it_is_dark():
    params = {"ambient_w_m2": 0.005, "ambient_variation": 0.3, "power_w": 1e-12, "noise_std_w_m2": 1e-4}
    batch = make_world_batch("laser-tracking", 4, horizon_s=60.0, full_scale_w_m2=0.02, **params)
    policy = make_policy("ekf-tracking", batch)
    policy.settings = policy.settings._replace(threshold=1.0)
    ambient, _ = traced(batch, policy, SEEDS[:4], "ambient")
    believed = policy.machines["ambient"]
    assert np.abs(believed - ambient[-1]).max() < np.abs(0.005 - ambient).max()
    assert believed == pytest.approx(ambient[-80:].mean(axis=0), abs=6e-4)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"spacing": 0.0}, "spacing: got 0.0"),
        ({"search_share": 2.0}, "search_share"),
        ({"gate": 0.5}, "gate: got 0.5"),
        ({"scan": (0.5, -1.0, 0.8)}, "scan: got -1.0"),
        ({"ambient_time_s": 0.0}, "ambient_time_s"),
    ],
)
def test_refusals_say_why(options, words):
    batch = make_world_batch("laser-tracking", 1)
    with pytest.raises(InvalidParameterError, match=words):
        make_policy("ekf-tracking", batch, **options)

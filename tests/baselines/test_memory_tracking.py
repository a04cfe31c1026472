"""``memory-tracking``: how it searches, that an observation decides its action, and refusals."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy


def test_the_search_leaves_no_gap():
    """In the dark, ground is seen all round the guess, further and further out."""
    batch = make_world_batch("laser-tracking", 4, scenario="still", start_distance_m=500.0, horizon_s=60.0)
    policy, w = make_policy("memory-tracking", batch), batch.worlds
    batch.reset(7)
    # A guess near the start, and no light anywhere near.
    for name, value in (("search_x", 3.0), ("search_y", [-1.0, 0.0, 1.0, 2.0])):
        w[name] = w[name.replace("search", "guess")] = value
    seen, least = [], []
    while not batch.finished.all():
        batch.step(policy.act(batch.observations, w))
        seen.append(np.stack([w["x"] - w["guess_x"], w["y"] - w["guess_y"]], -1))
        least.append(w["swept"].min(1).copy())
    seen, least = np.stack(seen, 1), np.stack(least, 1)
    assert (least[:, -1] > 2.5 * batch.constants.radius).all()
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    for k in range(4):
        for r in np.linspace(0.0, least[k, -1], 20):
            ring = r * np.stack([np.cos(angles), np.sin(angles)], -1)
            away = np.linalg.norm(ring[:, None] - seen[k], axis=-1).min(1)
            # Between two sectors the edge of what was seen bulges inwards.
            assert away.max() < 1.5 * batch.constants.sweep


def test_it_finds_the_light_sooner_than_circles_do():
    seeds = 2_000_000 + np.arange(60)
    waited = {}
    for name in ("memory-tracking", "ekf-tracking"):
        batch = make_world_batch("laser-tracking", 60, scenario="still", horizon_s=60.0)
        waited[name] = rollout(make_policy(name, batch), batch, seeds).metrics["time_to_acquire_s"].mean()
    assert waited["memory-tracking"] < waited["ekf-tracking"] + 1.0


def test_it_keeps_nothing_between_decisions():
    """A policy that was never asked before answers alike."""
    batch = make_world_batch("laser-tracking", 3, scenario="wandering", horizon_s=30.0)
    policy = make_policy("memory-tracking", batch)
    batch.reset(1)
    for _ in range(200):
        fresh = make_policy("memory-tracking", batch).act(batch.observations, batch.worlds)
        actions = policy.act(batch.observations, batch.worlds)
        np.testing.assert_array_equal(actions, fresh)
        assert actions.dtype == np.float32 and np.linalg.norm(actions, axis=1).max() <= 1.0 + 1e-6
        batch.step(actions)


def test_on_one_axis_it_stays_on_it():
    batch = make_world_batch("laser-tracking", 10, scenario="moving", axes=1, horizon_s=60.0)
    metrics = rollout(make_policy("memory-tracking", batch), batch, 2_000_000 + np.arange(10)).metrics
    assert (batch.worlds["y"] == 0).all()
    assert np.nanmean(metrics["time_in_lda_acquired"]) > 0.9


def test_refusals():
    batch = make_world_batch("laser-tracking", 1)
    with pytest.raises(InvalidParameterError, match="patience: got -1"):
        make_policy("memory-tracking", batch, patience=-1.0)

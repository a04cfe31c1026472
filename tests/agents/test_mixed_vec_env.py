"""Worlds of several kinds in one ``VecEnv``."""

import numpy as np
import pytest

from agents.mixed_vec_env import MixedVecEnv
from agents.recipes import make_recipe
from agents.training import build
from aquaquad_envs.interfaces.registration import sb3_vec_env

KINDS = ({}, {"horizon_s": 0.3})


def parts():
    return [
        sb3_vec_env("laser-tracking", 3, scenario="mixed", **{"horizon_s": 0.5, **kind}) for kind in KINDS
    ]


def test_rows_are_those_of_the_parts():
    mixed, alone = MixedVecEnv(parts()), parts()
    assert list(mixed.seed(5)) == [5, 6, 7, 8, 9, 10] and mixed.num_envs == 6
    alone[0].seed(5)
    alone[1].seed(8)
    np.testing.assert_array_equal(mixed.reset(), np.concatenate([part.reset() for part in alone]))
    rng = np.random.default_rng(0)
    ends = []
    for _ in range(12):
        actions = rng.uniform(-1, 1, (6, 2)).astype(np.float32)
        observations, rewards, done, infos = mixed.step(actions)
        wanted = [part.step(own) for part, own in zip(alone, np.split(actions, 2), strict=True)]
        for got, own in ((observations, 0), (rewards, 1), (done, 2)):
            np.testing.assert_array_equal(got, np.concatenate([part[own] for part in wanted]))
        assert len(infos) == 6 and all(
            ("episode" in info) == end for info, end in zip(infos, done, strict=True)
        )
        ends.append(done)
    # Missions of 0.5 and of 0.3 s.
    assert [list(row[[0, 3]]) for row in ends[:6]] == [[False] * 2] * 2 + [[False, True]] + [[False] * 2] + [
        [True, False], [False, True]
    ]  # fmt: skip


def test_attributes_and_refusals():
    mixed = MixedVecEnv(parts())
    assert mixed.get_attr("num_worlds") == [3] * 6 and mixed.get_attr("render_mode", [0, 1]) == [None] * 2
    assert mixed.env_is_wrapped(object) == [False] * 6
    with pytest.raises(AttributeError, match="share their parameters"):
        mixed.set_attr("params", 1)
    with pytest.raises(AttributeError, match="not Python objects"):
        mixed.env_method("reset")


@pytest.mark.parametrize("algorithm", ["ppo", "mappo"])
def test_a_recipe_of_several_kinds_trains(algorithm):
    recipe = make_recipe("sensor-placement", "vortex", algorithm)
    settings = {**recipe.algorithm_settings, "n_steps": 8, "batch_size": 64}
    assert len(recipe.variants) == 3
    model = build(
        recipe.with_overrides(num_worlds=6, algorithm_settings=settings), seed=0, threads=1, log_folder=None
    )
    horizons = [batch.params.horizon_s for batch in model.env.batches]
    assert horizons == [6 * 3600.0, 1800.0, 6 * 3600.0] and model.env.num_envs == 6 * 4
    model.learn(2 * 8 * 24)
    assert model.num_timesteps >= 2 * 8 * 24

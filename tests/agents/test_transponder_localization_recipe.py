"""The recipe of transponder localization: trains, keeps a policy, and that policy plays every suite of its vehicle."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from agents.checkpoints import SHIPPED, shipped
from agents.learned import LearnedPolicy
from agents.recipes import make_recipe
from agents.training import train
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout


def test_a_short_training_leaves_a_policy_for_any_number_of_transponders(tmp_path):
    recipe = make_recipe("transponder-localization", "random", "ppo")
    settings = {**recipe.algorithm_settings, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    tiny = dataclasses.replace(
        recipe, num_worlds=8, hidden=(16, 16), imitation_rounds=0, value_warmup_frames=0, evaluation_episodes=4,
        algorithm_settings=settings,
    )  # fmt: skip
    card = train(tiny, steps=128, seed=0, output=tmp_path, quiet=True)
    assert np.isfinite(card["results"]["score"]) and card["results"]["score"] == card["results"]["log_det"]
    for scenario in ("single", "four", "current"):
        batch = make_world_batch("transponder-localization", 3, scenario=scenario, num_fields=2)
        played = rollout(LearnedPolicy(batch, checkpoint=tmp_path / "policy"), batch, np.arange(3))
        assert (played.decisions == 29).all() and np.isfinite(played.metrics["log_det"]).all()


def test_training_and_validation_draw_other_worlds_than_the_suites():
    recipe = make_recipe("transponder-localization", "current", "ppo")
    assert {recipe.params["field_seed"], recipe.validation["field_seed"]} == {1, 2}
    assert shipped("transponder-localization", "four") == SHIPPED / "transponder-localization" / "random"
    with pytest.raises(InvalidParameterError, match="algorithm: got 'sac'"):
        make_recipe("transponder-localization", "random", "sac")

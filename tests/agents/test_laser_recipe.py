"""Training on laser tracking: the recipe builds and learns, its expert begins every mission anew."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from agents import checkpoints, imitation  # noqa: E402
from agents.learned import LearnedPolicy  # noqa: E402
from agents.recipes import FIRST_TRAINING_SEED, make_recipe  # noqa: E402
from agents.state import actor_of  # noqa: E402
from agents.training import build, train  # noqa: E402
from aquaquad_envs.errors import CheckpointError, InvalidParameterError  # noqa: E402
from aquaquad_envs.tasks.batch import make_world_batch  # noqa: E402


def tiny(scenario="flat-top", **overrides):
    recipe = make_recipe("laser-tracking", scenario, "ppo")
    settings = {**recipe.algorithm_settings, "n_steps": 8, "batch_size": 64, "n_epochs": 1}
    short = {**recipe.params, "horizon_s": 3.0}
    values = {
        "num_worlds": 8, "hidden": (16, 16), "imitation_rounds": 0, "value_warmup_frames": 0, "params": short,
        "validation": short, "checkpoint_every": 128, "evaluate_every": 128, "evaluation_episodes": 4,
        "algorithm_settings": settings,
    }  # fmt: skip
    return dataclasses.replace(recipe, **{**values, **overrides})


def test_it_trains_and_the_policy_flies(tmp_path):
    card = train(tiny(), steps=256, seed=0, output=tmp_path, quiet=True)
    assert (
        0.0 <= card["results"]["score"] <= 1.0 and card["results"]["score"] == card["results"]["time_in_lda"]
    )
    batch = make_world_batch("laser-tracking", 5, scenario="wandering")
    batch.reset(0)
    actions = LearnedPolicy(batch, checkpoint=tmp_path / "policy").act(batch.observations, batch.worlds)
    assert actions.shape == (5, 2) and np.abs(actions).max() <= 1.0
    # In a plane it acts by the axis that there is.
    plane = make_world_batch("laser-tracking", 5, axes=1)
    plane.reset(0)
    policy = LearnedPolicy(plane, checkpoint=tmp_path / "policy")
    assert policy.act(plane.observations, plane.worlds).shape == (5, 1)
    narrow = dict(checkpoints.load(tmp_path / "policy", task="laser-tracking", kind="policy")[0])
    last = f"{len(narrow) // 2 - 1}"
    narrow |= {name: narrow[name][:1] for name in (f"{last}.weight", f"{last}.bias")}
    card = checkpoints.load(tmp_path / "policy", task="laser-tracking", kind="policy")[1]
    checkpoints.save(tmp_path / "narrow", narrow, card)
    with pytest.raises(CheckpointError, match="other sizes"):
        LearnedPolicy(batch, checkpoint=tmp_path / "narrow")


class Counter:
    """An expert with a memory: east in the first half of a mission, west in the second."""

    information = "nothing"

    def __init__(self, batch):
        self.actions, self.resets, self.asked = np.zeros(batch.action_shape, np.float32), [], 0

    def reset(self, seeds):
        self.resets.append(np.asarray(seeds))
        self.asked = 0

    def act(self, observations, worlds):
        self.asked += 1
        self.actions[:, 0] = 0.8 if self.asked < 15 else -0.8
        return self.actions


def test_an_expert_with_a_memory_begins_every_mission_anew(monkeypatch):
    made = []

    def make(name, batch):
        made.append((name, Counter(batch)))
        return made[-1][1]

    monkeypatch.setattr(imitation, "make_policy", make)
    recipe = tiny(
        imitation_rounds=2, imitation_worlds=4, imitation_missions=3, imitation_epochs=30, frame="world"
    )
    model = build(recipe, seed=0, threads=1, log_folder=None)
    losses = []
    imitation.imitate(
        actor_of(model), recipe, seed=0, report=lambda number, loss, labels: losses.append(loss)
    )
    assert [name for name, _ in made] == ["memory-tracking"] * 2
    seeds = np.array([expert.resets for _, expert in made])
    assert (
        seeds.shape == (2, 3, 4)
        and len(np.unique(seeds)) == seeds.size
        and seeds.min() >= FIRST_TRAINING_SEED
    )
    # The time left tells the halves apart.
    assert losses[-1] < 0.1


def test_other_recipes_are_refused():
    with pytest.raises(InvalidParameterError, match="Did you mean 'flat-top'"):
        make_recipe("laser-tracking", "flattop", "ppo")
    with pytest.raises(InvalidParameterError, match="algorithm"):
        make_recipe("laser-tracking", "flat-top", "sac")

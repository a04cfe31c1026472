"""Training: the stored policy is the trained one, and a killed run goes on where it was saved."""

import dataclasses
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from agents import checkpoints  # noqa: E402
from agents.imitation import imitate  # noqa: E402
from agents.learned import LearnedPolicy  # noqa: E402
from agents.recipes import make_recipe  # noqa: E402
from agents.state import actor_of, actor_tensors, restore_state, training_tensors  # noqa: E402
from agents.training import build, train  # noqa: E402
from aquaquad_envs.errors import AquaQuadError, CheckpointError  # noqa: E402
from aquaquad_envs.tasks.batch import make_world_batch  # noqa: E402

ROOT = Path(__file__).parents[2]


def tiny(algorithm="ppo", **overrides):
    recipe = make_recipe("drift-hop", "vortex", algorithm)
    settings = dict(recipe.algorithm_settings)
    if algorithm == "ppo":
        settings |= {"n_steps": 8, "batch_size": 64, "n_epochs": 1}
    else:
        settings |= {"buffer_size": 2000, "batch_size": 32, "learning_starts": 32, "gradient_steps": 1}
    values = {
        "num_worlds": 8, "hidden": (16, 16), "imitation_rounds": 0, "value_warmup_frames": 0,
        "checkpoint_every": 64, "evaluate_every": 128, "evaluation_episodes": 4,
        "algorithm_settings": settings,
    }  # fmt: skip
    return dataclasses.replace(recipe, **{**values, **overrides})


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_state_survives_a_round_trip(algorithm, tmp_path):
    recipe = tiny(algorithm)
    model = build(recipe, seed=0, threads=1, log_folder=None)
    model.learn(200)
    tensors, settings = training_tensors(model)
    other = build(recipe, seed=1, threads=1, log_folder=None)
    assert any(
        not np.array_equal(training_tensors(other)[0].get(name), value) for name, value in tensors.items()
    )
    restore_state(other, tensors, settings)
    again, _ = training_tensors(other)
    assert again.keys() == tensors.keys()
    for name, value in tensors.items():
        np.testing.assert_array_equal(again[name], value)


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_stored_policy_acts_as_the_trained_one(algorithm, tmp_path):
    card = train(tiny(algorithm), steps=256, seed=3, output=tmp_path, quiet=True)
    assert card["steps"] >= 0 and card["algorithm"] == algorithm
    batch = make_world_batch("drift-hop", 16, scenario="vortex-perturbed")
    batch.reset(5)
    policy = LearnedPolicy(batch, checkpoint=tmp_path / "latest")
    ours = policy.act(batch.observations, batch.worlds)
    model = build(tiny(algorithm), seed=3, threads=1, log_folder=None)
    tensors, saved = checkpoints.load(tmp_path / "training", kind="training")
    restore_state(model, tensors, saved["optimisers"])
    theirs, _ = model.predict(batch.observations, deterministic=True)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


def test_an_action_does_not_depend_on_the_batch_around_it(tmp_path):
    train(tiny(), steps=64, seed=0, output=tmp_path, quiet=True)
    batch = make_world_batch("drift-hop", 64, scenario="vortex-perturbed")
    batch.reset(0)
    policy = LearnedPolicy(batch, checkpoint=tmp_path / "policy")
    all_actions = policy.act(batch.observations, batch.worlds)
    for i in (0, 7, 63):
        alone = policy.act(batch.observations[i : i + 1], batch.worlds[i : i + 1])
        np.testing.assert_array_equal(alone[0], all_actions[i])


def test_same_seed_same_policy(tmp_path):
    for name in ("a", "b"):
        train(tiny(), steps=128, seed=4, output=tmp_path / name, quiet=True)
    first, _ = checkpoints.load(tmp_path / "a" / "latest")
    second, _ = checkpoints.load(tmp_path / "b" / "latest")
    for name, value in first.items():
        np.testing.assert_array_equal(second[name], value)


def test_resume_goes_on_from_the_saved_frames(tmp_path):
    train(tiny(), steps=128, seed=0, output=tmp_path, quiet=True)
    before, card = checkpoints.load(tmp_path / "training")
    assert card["progress"]["frames"] == 128
    train(tiny(), steps=256, seed=0, output=tmp_path, resume=True, quiet=True)
    after, card = checkpoints.load(tmp_path / "training")
    assert card["progress"]["frames"] == 256
    assert any(not np.array_equal(before[name], after[name]) for name in before)


def test_resume_refuses_another_recipe_and_a_second_start(tmp_path):
    train(tiny(), steps=64, seed=0, output=tmp_path, quiet=True)
    with pytest.raises(CheckpointError, match="--resume"):
        train(tiny(), steps=64, seed=0, output=tmp_path, quiet=True)
    with pytest.raises(CheckpointError, match="another seed"):
        train(tiny(), steps=64, seed=1, output=tmp_path, resume=True, quiet=True)
    with pytest.raises(CheckpointError, match="another recipe"):
        train(tiny(hidden=(8,)), steps=64, seed=0, output=tmp_path, resume=True, quiet=True)


def test_kill_and_resume(tmp_path):
    """kill -9 loses at most one checkpoint interval."""
    command = [
        sys.executable, "train.py", "--steps", "100000000", "--num-worlds", "64", "--imitation-rounds", "0",
        "--output", str(tmp_path),
    ]  # fmt: skip
    command += ["--checkpoint-every", "8192"]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL)
    card = tmp_path / "training" / checkpoints.CARD
    deadline = time.monotonic() + 120
    while not card.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    _, saved = checkpoints.load(tmp_path / "training", kind="training")
    frames = saved["progress"]["frames"]
    assert frames >= 8192
    command[3] = str(frames + 8192)
    done = subprocess.run(
        [*command, "--resume"], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    _, saved = checkpoints.load(tmp_path / "training", kind="training")
    assert saved["progress"]["frames"] >= frames + 8192


def test_imitation_lowers_the_error():
    recipe = tiny(imitation_rounds=2, imitation_worlds=4, imitation_epochs=20, hidden=(64,))
    recipe = dataclasses.replace(recipe, params={"scenario": "vortex"})
    model = build(recipe, seed=0, threads=1, log_folder=None)
    losses = []
    before = actor_tensors(model)
    imitate(actor_of(model), recipe, seed=0, report=lambda number, loss, labels: losses.append(loss))
    after = actor_tensors(model)
    assert losses[-1] < losses[0]
    assert any(not np.array_equal(before[name], after[name]) for name in before)


def test_imitation_begins_with_the_first_decision_and_plays_later_missions_only_so_far():
    recipe = tiny(
        imitation_rounds=1, imitation_worlds=3, imitation_missions=5, imitation_decisions=2, imitation_epochs=1,
        imitation_scatter=False, imitation_huber=0.1, expert="greedy",
    )  # fmt: skip
    params = {"scenario": "vortex", "horizon_s": 4 * 600.0}
    recipe = dataclasses.replace(recipe, params=params)
    model = build(recipe, seed=0, threads=1, log_folder=None)
    counts = []
    imitate(actor_of(model), recipe, seed=0, report=lambda number, loss, labels: counts.append(labels))
    # At most as many drifts of 600 s as the mission has, hops being shorter; two decisions of each of four others.
    assert counts[0] >= 3 * 4 + 4 * 3 * 2
    short = dataclasses.replace(recipe, imitation_missions=1)
    imitate(actor_of(model), short, seed=0, report=lambda number, loss, labels: counts.append(labels))
    assert counts[0] - counts[1] == 4 * 3 * 2


@pytest.mark.parametrize(
    ("task", "scenario", "algorithm", "message"),
    [
        ("drift-hopp", "vortex", "ppo", "drift-hop"),
        ("drift-hop", "vortx", "ppo", "Did you mean 'vortex'"),
        ("drift-hop", "vortex", "dqn", "ppo"),
    ],
)
def test_unknown_recipes_are_refused(task, scenario, algorithm, message):
    with pytest.raises(AquaQuadError, match=message):
        make_recipe(task, scenario, algorithm)

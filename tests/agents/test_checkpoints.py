"""Checkpoints: what is saved is what is loaded, and anything else is refused by name."""

import json

import numpy as np
import pytest

from agents import checkpoints
from agents.learned import LearnedPolicy
from aquaquad_envs.errors import CheckpointError
from aquaquad_envs.tasks.batch import make_world_batch

TENSORS = {"0.weight": np.arange(6, dtype=np.float32).reshape(2, 3), "0.bias": np.ones(2, np.float32)}


@pytest.fixture
def folder(tmp_path):
    checkpoints.save(tmp_path / "c", TENSORS, {"kind": "policy", "task": "drift-hop"})
    return tmp_path / "c"


def test_round_trip(folder):
    tensors, card = checkpoints.load(folder, task="drift-hop", kind="policy")
    assert card["task"] == "drift-hop"
    for name, value in TENSORS.items():
        np.testing.assert_array_equal(tensors[name], value)


def test_no_partial_files_remain(folder):
    assert sorted(path.name for path in folder.iterdir()) == [checkpoints.CARD, checkpoints.WEIGHTS]


@pytest.mark.parametrize("name", [checkpoints.CARD, checkpoints.WEIGHTS])
def test_a_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(CheckpointError, match=name):
        checkpoints.load(folder)


def test_truncated_weights_are_refused(folder):
    weights = folder / checkpoints.WEIGHTS
    weights.write_bytes(weights.read_bytes()[:-5])
    with pytest.raises(CheckpointError, match="truncated or altered"):
        checkpoints.load(folder)


def test_altered_weights_are_refused(folder):
    weights = folder / checkpoints.WEIGHTS
    data = bytearray(weights.read_bytes())
    data[-1] ^= 1
    weights.write_bytes(bytes(data))
    with pytest.raises(CheckpointError, match="truncated or altered"):
        checkpoints.load(folder)


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"schema": 1}', "null"])
def test_a_damaged_card_is_refused(folder, text):
    (folder / checkpoints.CARD).write_text(text)
    with pytest.raises(CheckpointError, match="card"):
        checkpoints.load(folder)


def test_a_pickle_in_place_of_weights_is_refused_and_never_run(folder):
    import hashlib
    import pickle

    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("the pickle was run",))

    data = pickle.dumps(Bomb())
    (folder / checkpoints.WEIGHTS).write_bytes(data)
    card = json.loads((folder / checkpoints.CARD).read_text())
    card["sha256"] = hashlib.sha256(data).hexdigest()
    (folder / checkpoints.CARD).write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="safetensors"):
        checkpoints.load(folder)


@pytest.mark.parametrize(("asked", "value"), [("task", "plume-tracing"), ("kind", "training")])
def test_a_checkpoint_for_something_else_is_refused(folder, asked, value):
    with pytest.raises(CheckpointError, match=value):
        checkpoints.load(folder, **{asked: value})


def test_another_schema_is_refused(folder):
    card = json.loads((folder / checkpoints.CARD).read_text())
    card["schema"] = 99
    (folder / checkpoints.CARD).write_text(json.dumps(card))
    with pytest.raises(CheckpointError, match="schema 99"):
        checkpoints.load(folder)


def test_a_policy_for_other_observations_is_refused(folder):
    batch = make_world_batch("drift-hop", 1)
    with pytest.raises(CheckpointError, match="observations"):
        LearnedPolicy(batch, checkpoint=folder)

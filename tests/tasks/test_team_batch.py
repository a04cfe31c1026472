"""Batches of teams: what the contract in ``tasks/task.py`` asks of each task, and that nothing else matters."""

import pickle

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from aquaquad_envs.tasks.task import TASKS, load_task
from tests.interfaces.teams import TEAMS, TOGETHER, list_toy, make_batch, random_actions

ARRAYS = ("observations", "rewards", "reward_terms", "terminated", "truncated")
DECISIONS = 60


@pytest.fixture(autouse=True)
def toy_is_listed(monkeypatch):
    list_toy(monkeypatch)


@pytest.fixture(params=TEAMS)
def task(request):
    return request.param


def play(batch, columns=None, decisions=DECISIONS):
    """Step with autoreset from seeds 5, 6, ...: the arrays of each step, of the first ``columns`` worlds."""
    log = [batch.reset(5)[:columns].copy()]
    for decision in range(decisions):
        actions = random_actions(batch, range(min(batch.num_worlds, 7)), decision)
        batch.step(np.resize(actions, batch.action_shape))
        log += [getattr(batch, name)[:columns].copy() for name in ARRAYS]
        log += [batch.state()[:columns], batch.outcomes[:columns].copy()]
        batch.reset(mask=batch.finished)
        log.append(batch.observations[:columns].copy())
    return log, batch.worlds[:columns].copy()


def same(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one[0], other[0], strict=True)) and (
        one[1].tobytes() == other[1].tobytes()
    )


def test_arrays_and_names(task):
    batch = make_batch(task, 3)
    described, agents, names = load_task(task), batch.num_agents, batch.task.observation_names
    assert TASKS[task][1] == "team" and agents == described.num_agents(batch.params) > 1
    assert batch.reset(0).shape == (3, agents, len(names)) and batch.observations.dtype == np.float32
    assert len(set(names)) == len(names)
    assert batch.rewards.shape == batch.terminated.shape == batch.truncated.shape == (3, agents)
    assert batch.reward_terms.shape == (3, agents, len(set(described.reward_terms)))
    assert batch.outcomes.shape == (3, agents) and batch.finished.shape == (3,)
    assert described.outcomes[0] == "running" and len(set(described.outcomes)) == len(described.outcomes)
    assert described.state is not None, "a team has a central view"
    state_names = described.state_names(batch.params)
    state = batch.state()
    assert state.shape == (3, len(state_names)) and state.dtype == np.float32
    assert len(set(state_names)) == len(state_names)
    metrics = batch.metrics()
    assert metrics and all(values.shape == (3,) for values in metrics.values())
    assert all(len(values) == 2 for values in batch.metrics(np.array([True, False, True])).values())


def test_values_stay_in_bounds_and_flags_agree(task):
    batch = make_batch(task, 64)
    batch.reset(0)
    rng, ended, alone = np.random.default_rng(0), 0, 0
    for _ in range(200):
        before = batch.done
        batch.step(rng.uniform(-1.5, 1.5, batch.action_shape) * rng.choice([0.03, 1.0, 1e200]))
        assert (
            np.abs(batch.observations).max() <= 1.0 and np.abs(batch.state()).max() <= 1.0
        )  # false for NaN, too
        assert np.isfinite(batch.rewards).all()
        np.testing.assert_allclose(batch.reward_terms.sum(-1), batch.rewards, atol=1e-12)
        done = batch.done
        assert not (batch.terminated & batch.truncated).any()
        assert done[before].all(), "who is done stays done"
        assert np.array_equal(done, batch.outcomes > 0)
        assert np.array_equal(done.all(1), batch.finished)
        assert np.array_equal(batch.finished, batch.worlds["outcome"] > 0)
        assert not batch.observations[before].any() and not batch.rewards[before].any()
        assert not batch.reward_terms[before].any()
        alone += int((done.any(1) & ~batch.finished).sum())
        ended += int(batch.finished.sum())
        batch.reset(mask=batch.finished)
        assert not batch.done[~done].any() and not batch.finished.any()
        assert np.abs(batch.observations).max() <= 1.0 and np.abs(batch.state()).max() <= 1.0
    assert ended > 64, f"{task}: too few worlds ended ({ended}); shorten them in SHORT"
    assert (alone > 0) != (task in TOGETHER), (
        f"{task}: no agent ended before its world; make them end in SHORT"
    )


def test_batch_size_and_threads_change_nothing(task):
    golden = play(make_batch(task, 7), 7)
    for worlds, threads in ((7, 2), (64, 1), (64, 2), (1100, 2)):
        assert same(play(make_batch(task, worlds, threads=threads), 7), golden), (worlds, threads)
    alone = make_batch(task, 1)
    alone.reset([5 + 3])
    for decision in range(DECISIONS):
        alone.step(random_actions(alone, [3], decision))
        step = golden[0][1 + decision * 8 :][:8]
        for values, name in zip(step, ARRAYS, strict=False):
            assert np.array_equal(getattr(alone, name)[0], values[3]), (decision, name)
        alone.reset(mask=alone.finished)
    assert alone.worlds[0].tobytes() == golden[1][3].tobytes()


def test_actions_of_agents_that_are_done_change_nothing(task):
    one, other = make_batch(task, 16), make_batch(task, 16)
    one.reset(0)
    other.reset(0)
    rng, differed = np.random.default_rng(0), 0
    for decision in range(DECISIONS):
        actions = random_actions(one, range(16), decision)
        changed = np.where(one.done[..., None], rng.uniform(-1, 1, actions.shape), actions)
        differed += int((changed != actions).any(-1).sum())
        one.step(actions)
        other.step(changed)
        assert one.worlds.tobytes() == other.worlds.tobytes()
        assert all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ARRAYS)
    assert differed > 0
    # Everything has ended or is let go on without them: a finished world stays as it is.
    finished = one.finished
    kept = one.worlds[finished].copy()
    one.step(rng.uniform(-1, 1, one.action_shape))
    assert one.worlds[finished].tobytes() == kept.tobytes()


def test_a_mask_touches_no_other_world(task):
    batch = make_batch(task, 4)
    batch.reset(0)
    for decision in range(5):
        batch.step(random_actions(batch, range(4), decision))
    before, seen, done = batch.snapshot(), batch.observations.copy(), batch.done
    mask = np.array([True, False, True, False])
    batch.reset([None, 5, 7, None], mask=mask)
    assert batch.worlds[~mask].tobytes() == before[~mask].tobytes()
    assert np.array_equal(batch.observations[~mask], seen[~mask])
    assert np.array_equal(batch.done[~mask], done[~mask]) and not batch.done[mask].any()
    fresh = make_batch(task, 1)
    fresh.reset([7])
    assert np.array_equal(batch.observations[2], fresh.observations[0])
    assert np.array_equal(batch.state()[2], fresh.state()[0])


def test_restoring_a_snapshot_replays_the_future(task):
    """Also into a batch whose agents are done: the records alone tell who goes on."""
    batch = make_batch(task, 10)
    batch.reset(1)
    for decision in range(6):
        batch.step(random_actions(batch, range(10), decision))
    kept, futures = batch.snapshot(), []
    for _ in range(2):
        log = []
        for decision in range(6, DECISIONS):
            batch.step(random_actions(batch, range(10), decision))
            log += [getattr(batch, name).copy() for name in ARRAYS]
        futures.append((log, batch.snapshot()))
        batch.restore(kept)
    assert same(*futures)


def test_a_pickle_goes_on_identically_and_is_small(task):
    batch = make_batch(task, 20, threads=2)
    batch.reset(1)
    for decision in range(5):
        batch.step(random_actions(batch, range(20), decision))
    data = pickle.dumps(batch)
    assert len(data) < 20 * (batch.worlds.itemsize + 8 * batch.observations[0].size) + 50_000
    copy = pickle.loads(data)
    for decision in range(5, 30):
        for each in (batch, copy):
            each.step(random_actions(batch, range(20), decision))
            each.reset(mask=each.finished)
        assert all(np.array_equal(getattr(batch, name), getattr(copy, name)) for name in ARRAYS)
    assert copy.worlds.tobytes() == batch.worlds.tobytes()


def bad_actions(shape):
    worlds, agents, size = shape
    one_nan, one_inf = np.zeros(shape), np.zeros(shape)
    one_nan[1, agents - 1, 0] = np.nan
    one_inf[0, 1, size - 1] = -np.inf
    return {
        "NaN": (one_nan, rf"action: got .*nan.*_{agents - 1} in world 1, expected finite"),
        "infinite": (one_inf, r"action: got .*-inf.*_1 in world 0, expected finite"),
        "no axis of agents": (np.zeros((worlds, size)), r"action: got shape \(\d+, \d+\), expected"),
        "rows of agents": (np.zeros((worlds * agents, size)), "action: got shape"),
        "one agent short": (np.zeros((worlds, agents - 1, size)), "action: got shape"),
        "one number long": (np.zeros((worlds, agents, size + 1)), "action: got shape"),
        "ragged": ([[[0.0] * size] * agents, [[0.0] * size]], "action: got rows of unequal length"),
        "none": (None, r"action: got shape \(\)"),
        "objects": (np.zeros(shape, dtype=object), "action: got dtype object, expected real"),
        "bool": (np.zeros(shape, dtype=bool), "action: got dtype bool, expected real"),
        "complex": (np.zeros(shape, dtype=complex), "action: got dtype complex"),
        "strings": (np.full(shape, "0.5"), "action: got dtype"),
    }  # fmt: skip


@pytest.mark.parametrize("name", bad_actions((2, 3, 2)))
def test_bad_actions_are_refused_and_nothing_moves(task, name):
    batch = make_batch(task, 2)
    batch.reset(0)
    before, arrays = batch.snapshot(), [getattr(batch, n).copy() for n in ARRAYS]
    actions, words = bad_actions(batch.action_shape)[name]
    with pytest.raises(InvalidActionError, match=words):
        batch.step(actions)
    assert batch.worlds.tobytes() == before.tobytes()
    assert all(np.array_equal(getattr(batch, n), a) for n, a in zip(ARRAYS, arrays, strict=True))
    batch.step(np.zeros(batch.action_shape))


def discrete(task, worlds):
    try:
        return make_batch(task, worlds, action_type="discrete")
    except InvalidParameterError:
        pytest.skip(f"{task} has no discrete variant")


def test_an_index_does_what_its_row_of_the_table_does(task):
    indexed, plain = discrete(task, 3), make_batch(task, 3)
    indexed.reset(0)
    plain.reset(0)
    for decision in range(20):
        index = random_actions(indexed, range(3), decision)
        assert index.shape == indexed.action_shape == indexed.rows
        indexed.step(index)
        plain.step(indexed.action_spec.table[index])
        assert indexed.worlds.tobytes() == plain.worlds.tobytes()


@pytest.mark.parametrize("wrong", ["one too large", "negative", "floats", "bool", "no axis of agents"])
def test_bad_indices_are_refused_and_nothing_moves(task, wrong):
    batch = discrete(task, 2)
    batch.reset(0)
    good = np.zeros(batch.rows, dtype=int)
    actions = {
        "one too large": good + len(batch.action_spec.table), "negative": good - 1, "floats": good * 1.0,
        "bool": good > 0, "no axis of agents": good[:, 0],
    }[wrong]  # fmt: skip
    before = batch.snapshot()
    with pytest.raises(InvalidActionError, match="action: got"):
        batch.step(actions)
    assert batch.worlds.tobytes() == before.tobytes()


def test_step_before_reset_is_refused(task):
    batch = make_batch(task, 2)
    with pytest.raises(InvalidActionError, match=r"expected reset\(\) before step\(\)"):
        batch.step(np.zeros(batch.action_shape))


def test_a_single_agents_central_view_is_its_observation():
    batch = make_batch("drift-hop", 2)
    batch.reset(0)
    assert np.array_equal(batch.state(), batch.observations)
    assert not np.shares_memory(batch.state(), batch.observations)
    assert batch.rows == batch.finished.shape == batch.outcomes.shape == (2,)


def test_a_team_of_another_size():
    for size in (1, 8):
        batch = make_batch("toy-team", 2, team_size=size)
        batch.reset(0)
        batch.step(np.zeros((2, size, 2)))
        assert batch.observations.shape[:2] == (2, size) == batch.done.shape
        assert batch.state().shape == (2, batch.state_size) == (2, 3 * size + 1)

"""Batches of worlds: seeds, continuing streams, batch sizes and threads, snapshots, pickles, bad input."""

import pickle
import time

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from aquaquad_envs.tasks.drift_hop_kernels import step_batch
from aquaquad_envs.tasks.task import TASKS

GYRES = {"scenario": "gyres", "num_fields": 16}
ARRAYS = ("observations", "rewards", "reward_terms", "terminated", "truncated")


def make(worlds, **params):
    return aquaquad_envs.make_world_batch("drift-hop", worlds, **{**GYRES, **params})


def mixed_actions(rng, worlds):
    drift = rng.uniform(size=(worlds, 1)) < 0.6
    return np.where(drift, 0.0, rng.uniform(-1, 1, (worlds, 2))).astype(np.float32)


def play(batch, seeds, steps=40, seed=0, columns=None):
    """Step with autoreset; the arrays of every step (for the first ``columns`` worlds), and the records."""
    rng = np.random.default_rng(seed)
    first = batch.reset(seeds).copy()
    log = []
    for _ in range(steps):
        # Actions are drawn a world at a time, so that larger batches begin like smaller ones.
        actions = np.stack(
            [mixed_actions(np.random.default_rng([seed, i, len(log)]), 1)[0] for i in range(7)]
        )
        full = mixed_actions(rng, batch.num_worlds)
        full[: min(7, batch.num_worlds)] = actions[: batch.num_worlds]
        batch.step(full)
        log.append([getattr(batch, name)[:columns].copy() for name in ARRAYS])
        batch.reset(mask=batch.terminated | batch.truncated)
        log[-1].append(batch.observations[:columns].copy())
    return first[:columns], log, batch.worlds[:columns].copy()


def same(a, b):
    return (
        np.array_equal(a[0], b[0])
        and all(
            np.array_equal(x, y) for p, q in zip(a[1], b[1], strict=True) for x, y in zip(p, q, strict=True)
        )
        and (a[2].tobytes() == b[2].tobytes())
    )


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_batch_size_and_threads_change_nothing(noise):
    golden = play(make(7, current_noise_m_s=noise), 11)
    assert any(step[3].any() for step in golden[1]), "no episode ended; streams that go on were not compared"
    for worlds, threads in ((7, 2), (64, 1), (65, 2), (4096, 1), (4096, 2), (7, 16)):
        batch = make(worlds, threads=threads, current_noise_m_s=noise)
        assert same(play(batch, 11, columns=7), golden), (worlds, threads)
    for i in (0, 3, 6):
        alone = make(1, current_noise_m_s=noise)
        alone.reset([11 + i])
        for step in range(40):
            alone.step(mixed_actions(np.random.default_rng([0, i, step]), 1))
            assert np.array_equal(alone.observations[0], golden[1][step][0][i])
            assert alone.rewards[0] == golden[1][step][1][i]
            alone.reset(mask=alone.terminated | alone.truncated)
        assert alone.worlds[0].tobytes() == golden[2][i].tobytes()


def test_two_threads_equal_one_in_every_world():
    logs = [play(make(1000, threads=threads), 5, steps=20) for threads in (1, 2)]
    assert same(*logs)


def test_one_build_serves_every_scenario():
    """Compiling takes seconds: arrays of banks are of one kind, so that it happens once."""
    builds = set()
    for scenario in ("vortex", "gyres", "forecast-error", "tide", "double-gyre"):
        batch = aquaquad_envs.make_world_batch("drift-hop", 1, scenario=scenario, num_fields=2)
        batch.reset(0)
        batch.step(np.zeros((1, 2)))
        builds.add(len(step_batch.signatures))
    assert len(builds) == 1


def test_seeds():
    by_int, by_list = make(5), make(5)
    assert np.array_equal(by_int.reset(40).copy(), by_list.reset([40, 41, 42, 43, 44]))
    assert np.array_equal(by_int.worlds, by_list.worlds)
    again = by_int.reset(np.arange(40, 45)).copy()
    assert np.array_equal(again, by_list.observations)
    assert not np.array_equal(by_int.reset(99), again)
    unseeded = [make(5).reset().copy() for _ in range(2)]
    assert not np.array_equal(*unseeded)


def test_none_goes_on_and_a_mask_touches_no_other_world():
    batch = make(4)
    batch.reset(0)
    batch.step(np.zeros((4, 2)))
    before, seen = batch.snapshot(), batch.observations.copy()
    mask = np.array([True, False, True, False])
    batch.reset([None, 5, 7, None], mask=mask)
    assert np.array_equal(batch.worlds[~mask], before[~mask]) and np.array_equal(
        batch.observations[~mask], seen[~mask]
    )
    fresh = make(1)
    fresh.reset([7])
    assert batch.worlds[2] == fresh.worlds[0]
    assert (batch.worlds[0]["rng_initial"] != before[0]["rng_initial"]).any()
    assert batch.worlds[0]["steps"] == 0


@pytest.mark.parametrize(
    "seeds", [-1, 1.5, "abc", True, [1, 2], [1, 2, -3], [1, 2, 0.5], np.array([0.0, 1.0, 2.0]), object(), {}]
)
def test_bad_seeds_are_refused_and_nothing_moves(seeds):
    batch = make(3)
    batch.reset(0)
    before = batch.snapshot()
    with pytest.raises(InvalidParameterError, match="seed"):
        batch.reset(seeds)
    assert np.array_equal(batch.worlds, before)


@pytest.mark.parametrize("mask", [[1, 0, 1], np.ones(2, bool), np.ones((3, 1), bool), True])
def test_bad_masks_are_refused(mask):
    batch = make(3)
    batch.reset(0)
    with pytest.raises(InvalidParameterError, match=r"mask: got .*boolean array of shape"):
        batch.reset(mask=mask)


def test_a_sensor_draw_shifts_no_other_stream():
    """Noisy measurements draw from their own source: everything else is the same, episode after episode."""
    quiet, noisy = make(50), make(50, current_noise_m_s=0.3)
    quiet.reset(3)
    noisy.reset(3)
    rng = np.random.default_rng(0)
    for _ in range(60):
        actions = mixed_actions(rng, 50)
        for batch in (quiet, noisy):
            batch.step(actions)
            batch.reset(mask=batch.terminated | batch.truncated)
    for name in quiet.worlds.dtype.names:
        assert np.array_equal(quiet.worlds[name], noisy.worlds[name]) == (name != "rng_sensor"), name
    names = quiet.task.observation_names
    differs = (quiet.observations != noisy.observations).any(0)
    assert {names[i] for i in np.flatnonzero(differs)} == {"current u", "current v"}


def test_sensor_noise_has_the_stated_size():
    batch, quiet = make(20_000, current_noise_m_s=0.1), make(20_000)
    first = batch.task.observation_names.index("current u")
    difference = (batch.reset(0) - quiet.reset(0))[:, first : first + 2]
    error = 2.0 * difference.astype(float)
    assert error.std() == pytest.approx(0.1, rel=0.02)
    assert abs(error.mean()) < 0.002 and abs(np.corrcoef(error.T)[0, 1]) < 0.02


def test_restoring_a_snapshot_replays_the_future():
    batch = make(30, current_noise_m_s=0.1)
    batch.reset(1)
    rng = np.random.default_rng(0)
    actions = [mixed_actions(rng, 30) for _ in range(40)]
    for a in actions[:10]:
        batch.step(a)
        batch.reset(mask=batch.terminated | batch.truncated)
    kept = batch.snapshot()
    futures = []
    for _ in range(2):
        log = []
        for a in actions[10:]:
            batch.step(a)
            log.append((batch.observations.copy(), batch.rewards.copy(), batch.terminated.copy()))
            batch.reset(mask=batch.terminated | batch.truncated)
        futures.append((log, batch.snapshot()))
        batch.restore(kept)
    for one, other in zip(futures[0][0], futures[1][0], strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert np.array_equal(futures[0][1], futures[1][1])


def test_a_snapshot_of_something_else_is_refused():
    batch = make(3)
    for wrong in (make(2).snapshot(), np.zeros(3)):
        with pytest.raises(InvalidParameterError, match="snapshot"):
            batch.restore(wrong)


def test_a_pickle_goes_on_identically_and_is_small():
    batch = make(20, current_noise_m_s=0.1, threads=2)
    batch.reset(1)
    rng = np.random.default_rng(0)
    for _ in range(5):
        batch.step(mixed_actions(rng, 20))
    data = pickle.dumps(batch)
    assert len(data) < 50_000
    copy = pickle.loads(data)
    assert np.array_equal(copy.observations, batch.observations)
    for _ in range(40):
        actions = mixed_actions(rng, 20)
        for each in (batch, copy):
            each.step(actions)
            each.reset(mask=each.terminated | each.truncated)
    assert copy.worlds.tobytes() == batch.worlds.tobytes()
    assert np.array_equal(copy.observations, batch.observations)


BAD_ACTIONS = {
    "one world short": np.zeros((2, 2)),
    "one number short": np.zeros((3, 1)),
    "flat": np.zeros(6),
    "ragged": [[0.0, 0.0], [0.0], [0.0, 0.0]],
    "none": None,
    "NaN": np.array([[0, 0], [0, np.nan], [0, 0.0]]),
    "infinite": np.array([[0, 0], [0, 0], [-np.inf, 0.0]]),
    "objects": np.zeros((3, 2), dtype=object),
    "strings": np.full((3, 2), "0.5"),
    "complex": np.zeros((3, 2), dtype=complex),
    "bool": np.zeros((3, 2), dtype=bool),
    "dates": np.zeros((3, 2), dtype="datetime64[s]"),
}


@pytest.mark.parametrize("name", BAD_ACTIONS)
def test_bad_actions_are_refused_and_nothing_moves(name):
    batch = make(3)
    batch.reset(0)
    before, arrays = batch.snapshot(), [getattr(batch, n).copy() for n in ARRAYS]
    with pytest.raises(InvalidActionError, match="action: got"):
        batch.step(BAD_ACTIONS[name])
    assert np.array_equal(batch.worlds, before)
    assert all(np.array_equal(getattr(batch, n), a) for n, a in zip(ARRAYS, arrays, strict=True))
    batch.step(np.zeros((3, 2)))
    assert (batch.worlds["steps"] == 1).all()


@pytest.mark.parametrize(
    "actions",
    [np.array([0, 33, 1]), np.array([0, -1, 1]), np.array([0.0, 1.0, 2.0]), np.array([True, False, True]),
     np.array(["1", "2", "3"]), np.zeros((3, 2), dtype=int), np.array([0, 1]), np.array([1, 2, None])],
)  # fmt: skip
def test_bad_indices_are_refused_and_nothing_moves(actions):
    batch = make(3, action_type="discrete")
    batch.reset(0)
    before = batch.snapshot()
    with pytest.raises(InvalidActionError, match="action: got"):
        batch.step(actions)
    assert np.array_equal(batch.worlds, before)
    batch.step(np.array([0, 32, 16], dtype=np.uint8))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.longdouble, np.int8, np.int64])
def test_real_numbers_of_any_kind_are_actions(dtype):
    batch, golden = make(3), make(3)
    for each, kind in ((batch, dtype), (golden, np.float64)):
        each.reset(0)
        each.step(np.array([[0, 0], [1, 0], [0, -1]], dtype=kind))
    assert np.array_equal(batch.worlds, golden.worlds)


def test_step_before_reset_is_refused():
    with pytest.raises(InvalidActionError, match=r"expected reset\(\) before step\(\)"):
        make(2).step(np.zeros((2, 2)))
    half = make(2)
    half.reset(0, mask=np.array([True, False]))
    with pytest.raises(InvalidActionError, match="never reset"):
        half.step(np.zeros((2, 2)))


def extreme_actions(rng, worlds):
    """Random, tiny, huge, exactly at the threshold, signed zeros, integers in float's clothing."""
    actions = rng.uniform(-1.5, 1.5, (worlds, 2))
    kind = rng.integers(0, 8, worlds)
    actions[kind < 3] *= 0.03
    actions[kind == 3] *= 10.0 ** rng.uniform(-320, 300)
    special = np.array([0.0, -0.0, 0.1, 1.0, -1.0, 5e-324, 1.7e308, -1.7e308, 0.1 / np.sqrt(2)])
    actions[kind == 4] = rng.choice(special, (int((kind == 4).sum()), 2))
    return actions


@pytest.mark.parametrize(
    "params",
    [
        {"scenario": "gyres", "num_fields": 64, "current_noise_m_s": 0.5, "start_anywhere": 0.5},
        {
            "scenario": "vortex-perturbed",
            "drift_threshold": 0.0,
            "battery_wh": 15.0,
            "start_time_spread_s": 1e5,
        },
    ],
    ids=["gyres", "vortex-perturbed"],
)
def test_a_million_hostile_steps(params):
    """Half a million each: nothing but finite numbers within the spaces comes out."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 4096, **params)
    rng = np.random.default_rng(6)
    batch.reset(0)
    episodes, began = 0, time.perf_counter()
    for _ in range(125):
        batch.step(extreme_actions(rng, 4096))
        assert np.abs(batch.observations).max() <= 1.0  # false for NaN, too
        assert np.isfinite(batch.rewards).all() and np.isfinite(batch.reward_terms).all()
        np.testing.assert_allclose(batch.reward_terms.sum(1), batch.rewards, atol=1e-12)
        assert not (batch.terminated & batch.truncated).any()
        done = batch.terminated | batch.truncated
        episodes += int(done.sum())
        batch.reset(mask=done)
        assert np.abs(batch.observations).max() <= 1.0
    for name in batch.worlds.dtype.names:
        assert np.isfinite(batch.worlds[name].astype(float)).all(), name
    assert episodes > 4096
    assert time.perf_counter() - began < 60


@pytest.mark.parametrize("task", TASKS)
def test_every_task_names_its_columns(task):
    batch = aquaquad_envs.make_world_batch(task, 2)
    batch.reset(0)
    names = batch.task.observation_names
    assert batch.observations.shape == (*batch.rows, len(names)) and len(set(names)) == len(names)
    assert batch.observations.dtype == np.float32
    assert len(set(batch.task.reward_terms)) == batch.reward_terms.shape[-1]
    metrics = batch.metrics()
    assert metrics and all(values.shape == (2,) for values in metrics.values())

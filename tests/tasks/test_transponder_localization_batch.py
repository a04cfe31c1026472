"""Batches of transponder localization: equal at every size and thread count, clean under every parameter, quick."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.tasks.transponder_localization_data import WORLD
from aquaquad_envs.tasks.transponder_localization_kernels import step_batch
from tests.tasks.transponder_worlds import DEEP, play, water

HARD = {
    "scenario": "current", "num_fields": 4, "outlier_share": 0.1, "miss_share": 0.2, "sound_speed_error": 0.01,
    "current_noise_m_s": 0.05, "robust_threshold": 2.0, "num_measurements": 8,
}  # fmt: skip


def episodes(worlds, threads=1, columns=5, **params):
    """Step with autoreset under random actions; all that came out for the first ``columns`` worlds."""
    batch = aquaquad_envs.make_world_batch("transponder-localization", worlds, threads=threads, **params)
    batch.reset(7)
    log = []
    for step in range(16):
        actions = np.stack(
            [np.random.default_rng([k, step]).uniform(-1, 1, batch.action_spec.size) for k in range(worlds)]
        )
        batch.step(actions)
        log += [
            getattr(batch, name)[:columns].tobytes() for name in ("observations", "rewards", "reward_terms")
        ]
        batch.reset(mask=batch.finished)
    return log, batch.worlds[:columns].tobytes()


@pytest.mark.parametrize("params", [{}, HARD, DEEP], ids=["plain", "hard", "deep"])
def test_batch_size_and_threads_change_nothing(params):
    golden = episodes(5, **params)
    for worlds, threads in ((40, 1), (41, 2), (6, 3)):
        assert episodes(worlds, threads=threads, **params) == golden


def test_a_reset_leaves_nothing_of_the_last_episode():
    batch = water(8, seed=1, **HARD)
    fresh = batch.worlds.copy()
    rng = np.random.default_rng(0)
    for _ in range(6):
        batch.step(rng.uniform(-1, 1, batch.action_shape))
    batch.reset(1)
    for name in WORLD.names:
        assert batch.worlds[name].tobytes() == fresh[name].tobytes(), name


def test_sources_of_randomness_do_not_shift_each_other():
    """Outliers, misses and noise leave the places as they were; another field leaves noise as it was."""
    plain, noisy = water(4, scenario="random"), water(4, scenario="random", outlier_share=0.5, miss_share=0.5)
    for name in ("target", "prior_mean", "start_x", "heading"):
        assert np.array_equal(plain.worlds[name], noisy.worlds[name])
    still = water(4, scenario="current", num_fields=3, current_level=0.0)
    moving = water(4, scenario="current", num_fields=3)
    assert np.array_equal(still.worlds["ranges"], moving.worlds["ranges"])


def test_a_snapshot_replays():
    batch = play(water(4, **HARD), [0.3] * 3)
    kept = batch.snapshot()
    first = play(batch, [0.1, -0.7]).worlds.tobytes()
    batch.restore(kept)
    assert play(batch, [0.1, -0.7]).worlds.tobytes() == first


@st.composite
def any_world(draw):
    pick = lambda *values: draw(st.sampled_from(values))  # noqa: E731
    vehicle = pick("yaw-rate", "greedy", "aquaquad")
    scenarios = (
        ("deep",) if vehicle == "aquaquad" else ("single", "four", "field", "random", "current", "deep")
    )
    params = {
        "scenario": pick(*scenarios), "vehicle": vehicle, "num_measurements": pick(2, 5, 128), "num_fields": 2,
        "range_std_m": pick(0.05, 1.0, 50.0), "prior_std_m": pick((1e-3, 1e-3, 1e-3), (100.0, 100.0, 2.0), (99.0, 99.0, 99.0)),
        "outlier_share": pick(0.0, 0.5, 1.0), "outlier_scale_m": pick(0.0, 10.0, 1e4), "miss_share": pick(0.0, 0.5, 1.0),
        "sound_speed_error": pick(0.0, 0.5), "robust_threshold": pick(0.0, 1.0), "current_level": pick(0.0, 1.0, 10.0),
        "depth_m": pick((0.0, 0.0), (5.0, 6.0)), "spread_m": pick(0.0, 20.0), "error_weight": pick(0.0, 1.0),
        "integrator": pick("rk4", "euler"), "current_noise_m_s": pick(0.0, 0.3), "solar": "constant",
        "speed_m_s": pick(0.0, 3.0), "action_type": pick("continuous", "discrete"),
    }  # fmt: skip
    return params, draw(st.integers(0, 2**32))


@settings(max_examples=60)
@given(any_world())
def test_nothing_but_clean_numbers_comes_out(case):
    params, seed = case
    batch = aquaquad_envs.make_world_batch("transponder-localization", 4, **params)
    batch.reset(seed)
    rng = np.random.default_rng(seed)
    for _ in range(6):
        table = batch.action_spec.table
        indices = table is not None and rng.integers(0, len(table), batch.action_shape)
        batch.step(rng.uniform(-2, 2, batch.action_shape) if table is None else indices)
        assert np.abs(batch.observations).max() <= 1  # false for NaN, too
        assert np.isfinite(batch.rewards).all() and np.isfinite(batch.reward_terms).all()
        for name in ("x", "y", "estimate", "information", "log_det", "battery_wh"):
            assert np.isfinite(batch.worlds[name]).all(), name
        assert not (batch.terminated & batch.truncated).any()
        assert all(np.isfinite(values).all() for values in batch.metrics().values())
    assert np.array_equal(batch.done, batch.worlds["outcome"] != 0)


def test_discrete_turns_are_rows_of_the_table():
    batch = water(action_type="discrete")
    assert batch.action_spec.table.ravel().tolist() == np.linspace(-1, 1, 9).tolist()
    batch.step(np.array([0]))
    assert np.degrees(batch.worlds["heading"][0]) == pytest.approx(-60.0)
    assert len(water(action_type="discrete", vehicle="greedy").action_spec.table) == 33


def test_every_world_is_one_build():
    """Compiling takes half a minute: vehicles, scenarios and noises share one."""
    play(water(), [0.0])
    builds = len(step_batch.signatures)
    for params in (
        {"scenario": "four"},
        {"vehicle": "greedy"},
        HARD,
        DEEP,
        {"transponders": ((1.0, 2.0, 3.0),)},
    ):
        play(water(**params), [0.1])
    assert len(step_batch.signatures) == builds


def test_speed():
    """A floor that a slip to Python, or to a loop that allocates, would break; benchmarks/ has the figures."""
    batch = play(water(1024), [0.5])
    begun = time.process_time()
    play(batch, [0.5] * 20)
    assert 20 * 1024 / (time.process_time() - begun) > 50_000

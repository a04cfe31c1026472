"""Batches of teams: equal at every size and thread count, clean under every parameter, quick."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.tasks.sensor_placement_data import OUTCOMES, WORLD
from aquaquad_envs.tasks.sensor_placement_kernels import step_batch
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES, STATE_NAMES
from tests.tasks.sensor_placement_worlds import drift, sea

HARD = {
    "scenario": "gyres", "num_fields": 8, "target_motion": "manoeuvring", "num_targets": 2, "detection_level": 0.8,
    "travel_time_level": 1.0, "sharing_delay_s": 90.0, "dropout": 0.2, "noise_level": 0.3, "current_noise_m_s": 0.05,
    "emissions": "random", "start_time_spread_s": 3600.0, "horizon_s": 3600.0,
}  # fmt: skip


def play(worlds, decisions=16, threads=1, columns=5, **params):
    """Step with autoreset under random hops; all that came out for the first ``columns`` worlds."""
    batch = aquaquad_envs.make_world_batch("sensor-placement", worlds, threads=threads, **params)
    batch.reset(7)
    log = []
    for step in range(decisions):
        actions = np.zeros(batch.action_shape)
        for k in range(worlds):
            actions[k] = np.random.default_rng([k, step]).uniform(-1, 1, actions.shape[1:])
        batch.step(actions)
        log += [getattr(batch, name)[:columns].copy() for name in ("observations", "rewards", "reward_terms")]
        batch.reset(mask=batch.finished)
    return log, batch.state()[:columns], batch.worlds[:columns].copy()


@pytest.mark.parametrize("params", [{}, HARD], ids=["plain", "hard"])
def test_batch_size_and_threads_change_nothing(params):
    golden = play(5, **params)
    for worlds, threads in ((40, 1), (41, 2), (6, 3)):
        other = play(worlds, threads=threads, **params)
        assert all(np.array_equal(a, b) for a, b in zip(golden[0], other[0], strict=True))
        assert np.array_equal(golden[1], other[1]) and golden[2].tobytes() == other[2].tobytes()


def test_seeds_decide_and_streams_go_on():
    first, second = (sea(2, seed=[5, 6]) for _ in range(2))
    assert first.worlds.tobytes() == second.worlds.tobytes()
    before = first.worlds["x"].copy()
    first.reset()
    second.reset()
    assert first.worlds.tobytes() == second.worlds.tobytes() and (first.worlds["x"] != before).any()


def test_a_reset_leaves_nothing_of_the_last_episode():
    batch = aquaquad_envs.make_world_batch("sensor-placement", 8, **{**HARD, "horizon_s": 21600.0})
    batch.reset(1)
    fresh = batch.worlds.copy()
    rng = np.random.default_rng(0)
    for _ in range(30):
        batch.step(rng.uniform(-1, 1, batch.action_shape))
    batch.reset(1)
    for name in WORLD.names:
        if name != "pending":
            assert np.array_equal(batch.worlds[name], fresh[name], equal_nan=True), name


def test_a_snapshot_replays():
    batch = drift(sea(4, **HARD), 3)
    kept = batch.snapshot()
    first = drift(batch, 3).worlds.tobytes()
    batch.restore(kept)
    assert drift(batch, 3).worlds.tobytes() == first


@st.composite
def any_world(draw):
    pick = lambda *values: draw(st.sampled_from(values))  # noqa: E731
    params = {
        "scenario": pick("calm", "vortex", "gyres", "fence"), "num_vehicles": draw(st.integers(3, 8)),
        "num_targets": draw(st.integers(1, 5)), "measurement": pick("bearing", "range", "tdoa"),
        "target_motion": pick("constant-velocity", "manoeuvring", "stop-and-go"), "tracker": pick("ukf", "ekf"),
        "track_model": pick("constant-velocity", "constant-acceleration"), "tdoa_pairs": pick("reference", "all"),
        "start_layout": pick("spread", "cluster"), "cluster_radius_m": pick(1.0, 500.0),
        "target_speed_m_s": pick(0.0, 0.3, 3.0), "target_noise_m2_s3": pick(0.0, 1e-7, 1e-2),
        "noise_level": pick(0.0, 2.0), "detection_level": pick(0.0, 1.0), "travel_time_level": pick(0.0, 1.0),
        "sharing_delay_s": pick(0.0, 300.0, 3600.0), "dropout": pick(0.0, 0.9), "action_type": pick("continuous", "discrete"),
        "emissions": pick("always", "periodic", "random"), "initial_position_std_m": pick(1e-3, 100.0, 5000.0),
        "tdoa_std_s": pick(1e-7, 1.4e-3, 1.0), "bearing_std_rad": pick(1e-6, 0.1, 3.0), "sub_steps": pick(1, 3, 5),
        "current_noise_m_s": pick(0.0, 0.1), "num_fields": 2, "horizon_s": 3600.0,
    }  # fmt: skip
    if draw(st.booleans()) and params["num_vehicles"]:
        grid = {
            "scenario": "grid",
            "measurement": "range",
            "num_vehicles": draw(st.integers(1, 8)),
            "horizon_s": 600.0,
        }
        params = {**params, **grid}
    return params, draw(st.integers(0, 2**32))


@settings(max_examples=60)
@given(any_world())
def test_nothing_but_clean_numbers_comes_out(case):
    params, seed = case
    batch = aquaquad_envs.make_world_batch("sensor-placement", 4, **params)
    batch.reset(seed)
    rng = np.random.default_rng(seed)
    for _ in range(8):
        spec = batch.action_spec
        hops = (
            rng.integers(0, 33, batch.action_shape)
            if spec.table is not None
            else rng.uniform(-1, 1, batch.action_shape)
        )
        batch.step(hops)
        for array in (batch.observations, batch.state()):
            assert np.isfinite(array).all() and abs(array).max() <= 1
        assert np.isfinite(batch.rewards).all() and np.isfinite(batch.reward_terms).all()
        for name in (
            "estimate",
            "covariance",
            "bound",
            "x",
            "y",
            "battery_wh",
            "error2_sum",
            "nees_sum",
            "hdop_s",
        ):
            assert np.isfinite(batch.worlds[name]).all(), name
        assert not (batch.terminated & batch.truncated).any()
        assert np.array_equal(batch.done, batch.outcomes != 0)
    assert set(np.unique(batch.worlds["outcome"])) <= {
        0,
        OUTCOMES.index("time out"),
        OUTCOMES.index("team lost"),
    }


def test_land_turns_targets_back(tmp_path):
    pytest.importorskip("netCDF4")
    from tests.physics.current_file_makers import CENTER, plain

    path = tmp_path / "currents.nc"
    plain(path)
    batch = sea(
        16,
        scenario="file",
        currents_file=str(path),
        currents_center=CENTER,
        half_width_m=5000.0,
        num_fields=4,
    )
    drift(batch, 5)
    assert np.isfinite(batch.observations).all() and batch.observations.any()


def test_every_team_is_one_build():
    """Compiling takes a minute: sizes, measurements and scenarios share one."""
    drift(sea())
    builds = len(step_batch.signatures)
    for params in (
        {"num_vehicles": 8},
        {"scenario": "grid"},
        {"measurement": "bearing"},
        {"scenario": "vortex"},
    ):
        drift(sea(**params))
    assert len(step_batch.signatures) == builds


def test_the_state_is_central():
    batch = drift(sea(3, num_targets=2))
    view = batch.state()
    assert view.shape == (3, len(STATE_NAMES)) and view.dtype == np.float32
    w, at = batch.worlds, STATE_NAMES.index
    assert view[:, at("target 2 x")] == pytest.approx(w["target_x"][:, 1] / 5000, abs=1e-6)
    assert view[:, at("vehicle 4 y")] == pytest.approx(w["y"][:, 3] / 5000, abs=1e-6)
    assert view[:, at("vehicle 5 mask")].tolist() == [0, 0, 0]
    error = w["estimate"][:, 0, 0] - w["target_x"][:, 0]
    assert view[:, at("target 1 estimate error x")] == pytest.approx(
        error / (abs(error) + batch.constants.fix_scale), abs=1e-5
    )
    assert view[:, at("HDOP")] == pytest.approx(batch.observations[:, 0, OBSERVATION_NAMES.index("HDOP")])


def test_speed():
    """A floor that a slip to Python, or to a loop that allocates, would break; benchmarks/ has the figures."""
    batch = sea(1024, scenario="vortex")
    drift(batch)
    begun = time.process_time()
    drift(batch, 10)
    assert 10 * 1024 / (time.process_time() - begun) > 20_000

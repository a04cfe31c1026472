"""Every registered environment passes its interface's own checkers and refuses what is wrong."""

import importlib.util
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import aquaquad_envs
from aquaquad_envs.errors import AquaQuadError, InvalidActionError, InvalidParameterError
from aquaquad_envs.interfaces.checking import check_vector_env
from aquaquad_envs.tasks.task import TASKS

SINGLE = {env_id: name for name, (env_id, agents, _) in TASKS.items() if agents == "single"}
#: Parameters with which random actions end episodes soon, by task.
SHORT = {"drift-hop": {"horizon_s": 3600.0}, "laser-tracking": {"horizon_s": 3.0}}
VARIANTS = {
    "drift-hop": [{}, {"scenario": "gyres", "num_fields": 4}, {"action_type": "discrete"}],
    "transponder-localization": [
        {}, {"vehicle": "greedy", "scenario": "current", "num_fields": 2}, {"action_type": "discrete"},
        {"vehicle": "aquaquad", "scenario": "deep", "num_fields": 2, "solar": "constant"},
    ],
    "laser-tracking": [{}, {"axes": 1, "start_altitude_m": 0.0}],
}  # fmt: skip
CASES = [(env_id, params) for env_id, name in SINGLE.items() for params in VARIANTS.get(name, [{}])]


def make(env_id, **params):
    return gymnasium.make(env_id, **params)


def test_registered_ids_are_the_tasks():
    registered = {env_id for env_id in gymnasium.registry if env_id.startswith("AquaQuad/")}
    assert registered == set(SINGLE)
    for env_id in registered:
        spec = gymnasium.spec(env_id)
        assert spec.vector_entry_point is not None and spec.version == 0


def test_import_registers_without_loading_learning_libraries():
    """Numba and Gymnasium only: torch, SB3, pandas and the like load on first use."""
    code = (
        "import sys, gymnasium, aquaquad_envs; aquaquad_envs.interfaces.registration.register_all();"
        "print([m for m in ('torch', 'stable_baselines3', 'pandas', 'pvlib', 'xarray', 'matplotlib', 'pygame',"
        " 'shapely') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("env_id, params", CASES)
def test_gymnasium_check_env(env_id, params):
    # Rendering has its own tests; here it only counts where its library is installed.
    no_render = importlib.util.find_spec("pygame") is None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*human.*")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        warnings.filterwarnings("ignore", category=FutureWarning)
        warnings.filterwarnings("ignore", module="pvlib")
        warnings.filterwarnings("ignore", message=".*dayofyear.*")
        check_env(make(env_id, **params).unwrapped, skip_render_check=no_render)


@pytest.mark.parametrize("env_id, params", CASES)
def test_sb3_check_env(env_id, params):
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    sb3_check_env(make(env_id, **params).unwrapped, warn=True, skip_render_check=True)


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("env_id, params", CASES)
def test_vector_env(env_id, params, mode):
    short = SHORT.get(SINGLE[env_id], {})
    env = gymnasium.make_vec(env_id, 5, autoreset_mode=mode, **params, **short)
    assert env.metadata["autoreset_mode"] is mode
    check_vector_env(env.unwrapped)


@pytest.mark.parametrize("env_id, params", CASES)
def test_spaces_match_the_batch(env_id, params):
    env = make(env_id, **params).unwrapped
    assert env.observation_space.shape == (len(env.batch.task.observation_names),)
    obs, info = env.reset(seed=0)
    assert obs in env.observation_space and info == {"outcome": "running"}
    assert env.observation_space.dtype == np.float32


@pytest.mark.parametrize("env_id", SINGLE)
def test_infos_of_an_episode(env_id):
    """Reward terms sum to the reward at each step; metrics come once, at the end."""
    env = make(env_id, **SHORT.get(SINGLE[env_id], {}))
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(10_000):
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        assert tuple(info["reward_terms"]) == env.unwrapped.batch.task.reward_terms
        done = terminated or truncated
        assert ("metrics" in info) == done and (info["outcome"] == "running") != done
        if done:
            break
    assert done
    assert set(info["metrics"]) == set(env.unwrapped.batch.metrics())
    assert all(type(value) is float for value in info["metrics"].values())
    assert "metrics" not in env.reset()[1]


@pytest.mark.parametrize("env_id", SINGLE)
def test_vector_infos_agree_with_the_batch(env_id):
    env = gymnasium.make_vec(env_id, 6, autoreset_mode="SameStep", **SHORT.get(SINGLE[env_id], {}))
    env.reset(seed=2)
    env.action_space.seed(2)
    ends = 0
    for _ in range(300):
        _, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        terms = {name: value for name, value in info["reward_terms"].items() if name[0] != "_"}
        np.testing.assert_allclose(sum(terms.values()), rewards, atol=1e-12)
        done = terminated | truncated
        assert ("metrics" in info) == done.any() == ("final_info" in info)
        if done.any():
            assert np.array_equal(info["_metrics"], done) and np.array_equal(info["_final_info"], done)
            assert (info["final_info"]["outcome"][done] > 0).all()
            ends += int(done.sum())
    assert ends > 6


def test_final_info_does_not_change_with_the_next_episode():
    env = gymnasium.make_vec("AquaQuad/DriftHop-v0", 1, autoreset_mode="SameStep", horizon_s=600.0)
    env.reset(seed=0)
    *_, truncated, info = env.step(np.zeros((1, 2), np.float32))
    assert truncated[0] and info["final_info"]["metrics"]["duration_s"][0] == 600.0
    env.step(np.full((1, 2), 0.5, np.float32))
    assert info["final_info"]["metrics"]["duration_s"][0] == 600.0


BAD_BOX = {
    "NaN": np.array([np.nan, 0.0]), "infinity": np.array([np.inf, 0.0]), "short": np.zeros(1),
    "long": np.zeros(3), "batched": np.zeros((1, 2)), "scalar": 0.5, "objects": np.zeros(2, object),
    "strings": np.array(["a", "b"]), "complex": np.zeros(2, complex), "bool": np.zeros(2, bool), "none": None,
    "dict": {"x": 1}, "ragged": [[1.0], 2.0],
}  # fmt: skip
BAD_INDEX = {
    "float": 3.0, "numpy float": np.float64(3), "negative": -1, "too large": 33, "bool": True, "none": None,
    "string": "3", "array": np.array([1]), "huge": 2**70, "NaN": np.nan,
}  # fmt: skip


@pytest.mark.parametrize("kind, name", [("box", n) for n in BAD_BOX] + [("index", n) for n in BAD_INDEX])
def test_bad_actions_leave_the_env_usable(kind, name):
    """Through gymnasium.make and directly: the same error, the world untouched, the next step fine."""
    options = {} if kind == "box" else {"action_type": "discrete"}
    action = BAD_BOX[name] if kind == "box" else BAD_INDEX[name]
    for env in (make("AquaQuad/DriftHop-v0", **options).unwrapped,
                gymnasium.make("AquaQuad/DriftHop-v0", disable_env_checker=True, **options)):  # fmt: skip
        env.reset(seed=0)
        before = env.unwrapped.batch.snapshot()
        with pytest.raises(InvalidActionError, match="action: got"):
            env.step(action)
        assert np.array_equal(env.unwrapped.batch.worlds, before)
        env.step(env.action_space.sample())
        assert env.unwrapped.batch.worlds["steps"][0] == 1


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_bad_actions_leave_the_vector_env_usable(mode):
    golden, env = (
        gymnasium.make_vec("AquaQuad/DriftHop-v0", 3, autoreset_mode=mode, horizon_s=1800.0) for _ in "ab"
    )
    golden.reset(seed=0)
    env.reset(seed=0)
    for _ in range(8):
        for bad in (np.full((3, 2), np.nan), np.zeros((2, 2)), np.zeros((3, 2), object), "drift"):
            with pytest.raises(AquaQuadError):
                env.step(bad)
        returns = [each.step(np.zeros((3, 2), np.float32)) for each in (golden, env)]
        for a, b in zip(returns[0][:4], returns[1][:4], strict=True):
            assert np.array_equal(a, b)
        done = returns[0][2] | returns[0][3]
        if mode == "Disabled" and done.any():
            for each in (golden, env):
                each.reset(options={"reset_mask": done})


@pytest.mark.parametrize("env_id", SINGLE)
def test_step_before_reset_is_refused_everywhere(env_id):
    env = make(env_id).unwrapped
    with pytest.raises(InvalidActionError, match=r"reset\(\) before step"):
        env.step(env.action_space.sample())
    vector = gymnasium.make_vec(env_id, 2).unwrapped
    with pytest.raises(InvalidActionError, match=r"reset\(\) before step"):
        vector.step(vector.action_space.sample())
    rows = aquaquad_envs.sb3_vec_env(SINGLE[env_id], 2)
    with pytest.raises(InvalidActionError, match=r"reset\(\) before step"):
        rows.step(np.array([rows.action_space.sample() for _ in "ab"]))


@pytest.mark.parametrize("seed", [-1, 1.5, "1", np.float64(3)])
@pytest.mark.parametrize("env_id", SINGLE)
def test_bad_seeds_are_refused_and_nothing_moves(env_id, seed):
    single, vector = make(env_id).unwrapped, gymnasium.make_vec(env_id, 3).unwrapped
    for env in (single, vector):
        env.reset(seed=0)
        before = env.batch.snapshot()
        with pytest.raises((AquaQuadError, gymnasium.error.Error)):
            env.reset(seed=seed)
        assert np.array_equal(env.batch.worlds, before)


@pytest.mark.parametrize("options", [5, "reset", ["reset_mask"], {"reset_mask": [True, False]},
                                     {"reset_mask": np.zeros(2, bool)}, {"reset_mask": np.ones(3, bool)},
                                     {"reset_mask": np.ones(2, int)}])  # fmt: skip
def test_bad_options_are_refused_and_nothing_moves(options):
    env = gymnasium.make_vec("AquaQuad/DriftHop-v0", 2, autoreset_mode="Disabled").unwrapped
    env.reset(seed=0)
    env.step(np.ones((2, 2)))
    before = env.batch.snapshot()
    if isinstance(options, dict) and isinstance(options["reset_mask"], list):
        env.reset(options=options)  # a list of booleans is as good as an array
        assert env.batch.worlds["steps"].tolist() == [0, 1]
        return
    with pytest.raises(InvalidParameterError, match="options"):
        env.reset(options=options)
    assert np.array_equal(env.batch.worlds, before)
    single = make("AquaQuad/DriftHop-v0").unwrapped
    if not isinstance(options, dict):
        with pytest.raises(InvalidParameterError, match="options: got"):
            single.reset(options=options)


def test_disabled_autoreset_waits_for_the_mask():
    env = gymnasium.make_vec("AquaQuad/DriftHop-v0", 3, autoreset_mode="Disabled", horizon_s=1200.0)
    env.reset(seed=0)
    drift, mixed = np.zeros((3, 2)), np.array([[0, 0], [0, -0.5], [0, 0]])
    env.step(drift)
    *_, truncated, _ = env.step(mixed)
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(InvalidParameterError, match=r"2 finished worlds.*reset_mask"):
        env.step(drift)
    kept = env.unwrapped.batch.worlds[1].copy()
    env.reset(options={"reset_mask": truncated})
    assert env.unwrapped.batch.worlds[1] == kept
    assert env.unwrapped.batch.worlds["steps"].tolist() == [0, 2, 0]
    env.step(drift)
    env.reset(seed=5)  # without a mask all begin anew
    assert (env.unwrapped.batch.worlds["steps"] == 0).all()


@pytest.mark.parametrize(
    "options, words",
    [
        ({"autoreset_mode": "next_step"}, "autoreset_mode: got 'next_step'.*Did you mean"),
        ({"render_mode": "rgb_array"}, "render_mode: got 'rgb_array'.*gymnasium.make"),
        ({"max_episode_steps": 10}, "max_episode_steps: got 10.*horizon_s"),
        ({"threads": -1}, "threads: got -1"),
        ({"scenari": "gyres"}, "Did you mean 'scenario'"),
    ],
)
def test_vector_options_are_refused_by_name(options, words):
    with pytest.raises(InvalidParameterError, match=words):
        gymnasium.make_vec("AquaQuad/DriftHop-v0", 2, **options)


def test_make_refuses_unknown_parameters_and_modes():
    with pytest.raises(InvalidParameterError, match="Did you mean 'goal_radius_m'"):
        make("AquaQuad/DriftHop-v0", goal_radius=50.0)
    with pytest.raises(InvalidParameterError, match="render_mode: got 'ansi'"):
        make("AquaQuad/DriftHop-v0", render_mode="ansi")

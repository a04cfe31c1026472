"""The vector checker accepts what is right, Gymnasium's own included, and names what is wrong."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from aquaquad_envs.interfaces.checking import check_vector_env
from aquaquad_envs.interfaces.vector import WorldVectorEnv

MODES = list(AutoresetMode)


@pytest.mark.parametrize("mode", MODES)
def test_accepts_gymnasiums_own(mode):
    made = [lambda: gymnasium.make("CartPole-v1", disable_env_checker=True)] * 3
    check_vector_env(SyncVectorEnv(made, autoreset_mode=mode), steps=100)


def env(mode=AutoresetMode.NEXT_STEP, cls=WorldVectorEnv):
    return cls("drift-hop", 5, autoreset_mode=mode, scenario="gyres", num_fields=4, horizon_s=3600.0)


@pytest.mark.parametrize("mode", MODES)
def test_accepts_ours(mode):
    check_vector_env(env(mode), steps=100)


class SharedMemory(WorldVectorEnv):
    kept = None

    def step(self, actions):
        observations, *rest = super().step(actions)
        self.kept = observations if self.kept is None else self.kept
        self.kept[:] = observations
        return self.kept, *rest


class SharedInfo(WorldVectorEnv):
    kept = None

    def step(self, actions):
        *rest, info = super().step(actions)
        self.kept = info["outcome"] if self.kept is None else self.kept
        info["outcome"] = self.kept
        return *rest, info


class WrongDtype(WorldVectorEnv):
    def step(self, actions):
        obs, rewards, terminated, *rest = super().step(actions)
        return obs, rewards, terminated.astype(int), *rest


class WrongObservations(WorldVectorEnv):
    def step(self, actions):
        obs, *rest = super().step(actions)
        return obs.astype(np.float64), *rest


class OutsideTheSpace(WorldVectorEnv):
    def reset(self, **arguments):
        obs, info = super().reset(**arguments)
        return 3 * obs, info


class NaNReward(WorldVectorEnv):
    def step(self, actions):
        obs, rewards, *rest = super().step(actions)
        return obs, rewards * np.nan, *rest


class NoMask(WorldVectorEnv):
    def step(self, actions):
        *rest, info = super().step(actions)
        del info["_outcome"]
        return *rest, info


class NoInnerMask(WorldVectorEnv):
    def step(self, actions):
        *rest, info = super().step(actions)
        info["reward_terms"]["_flight"] = None
        return *rest, info


class ShortInfo(WorldVectorEnv):
    def step(self, actions):
        *rest, info = super().step(actions)
        info["outcome"] = info["outcome"][:-1]
        return *rest, info


class IgnoresTheSeed(WorldVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=np.random.default_rng().integers(10**9, size=5), options=options)


class SameSeedEverywhere(WorldVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=[seed] * 5 if isinstance(seed, int) else seed, options=options)


class WrongSpaces(WorldVectorEnv):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.observation_space = self.single_observation_space


class NoMode(WorldVectorEnv):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.metadata = {}


class RewardOnReset(WorldVectorEnv):
    def step(self, actions):
        obs, rewards, *rest = super().step(actions)
        return obs, rewards - 1.0, *rest


class NoFinal(WorldVectorEnv):
    def step(self, actions):
        *rest, info = super().step(actions)
        return *rest, {key: value for key, value in info.items() if "final" not in key}


class FinalOutside(WorldVectorEnv):
    def step(self, actions):
        *rest, info = super().step(actions)
        if "final_obs" in info:
            info["final_obs"] += 7
        return *rest, info


class ResetsEverything(WorldVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)


class StepsFinishedWorlds(WorldVectorEnv):
    def step(self, actions):
        self._finished[:] = False
        return super().step(actions)


@pytest.mark.parametrize(
    "cls, mode, words",
    [
        (SharedMemory, AutoresetMode.NEXT_STEP, "step wrote to|shares memory"),
        (SharedInfo, AutoresetMode.NEXT_STEP, "shares memory"),
        (WrongDtype, AutoresetMode.SAME_STEP, "terminated: got int64"),
        (WrongObservations, AutoresetMode.NEXT_STEP, "step: observations .float64"),
        (OutsideTheSpace, AutoresetMode.NEXT_STEP, "reset: observations .* lie outside"),
        (NaNReward, AutoresetMode.NEXT_STEP, "rewards: not all are finite"),
        (NoMask, AutoresetMode.NEXT_STEP, "'outcome'.*mask NoneType"),
        (NoInnerMask, AutoresetMode.NEXT_STEP, "'reward_terms'.*'flight'.*mask NoneType"),
        (ShortInfo, AutoresetMode.NEXT_STEP, "has 4 rows, expected 5"),
        (IgnoresTheSeed, AutoresetMode.NEXT_STEP, "same seed and actions gave different"),
        (SameSeedEverywhere, AutoresetMode.NEXT_STEP, r"reset\(seed=s\) differs"),
        (WrongSpaces, AutoresetMode.NEXT_STEP, "observation_space: got"),
        (NoMode, AutoresetMode.NEXT_STEP, "autoreset_mode"),
        (RewardOnReset, AutoresetMode.NEXT_STEP, "reward: not zero"),
        (NoFinal, AutoresetMode.SAME_STEP, "_final_obs"),
        (FinalOutside, AutoresetMode.SAME_STEP, "final_obs.* lies outside"),
        (ResetsEverything, AutoresetMode.DISABLED, "reset_mask changed worlds outside"),
        (StepsFinishedWorlds, AutoresetMode.DISABLED, "step with finished worlds was accepted"),
    ],
)
def test_names_what_is_wrong(cls, mode, words):
    with pytest.raises(AssertionError, match=words):
        check_vector_env(env(mode, cls), steps=100)


def test_without_an_end_nothing_is_certified():
    endless = WorldVectorEnv(
        "drift-hop", 2, half_width_m=50_000.0, obstacles=(), horizon_s=1e7, battery_wh=1e5
    )
    with pytest.raises(AssertionError, match="no episode ended in 5 steps"):
        check_vector_env(endless, steps=5)

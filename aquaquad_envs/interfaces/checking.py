"""A checker for ``gymnasium.vector.VectorEnv``; Gymnasium has one for single environments only."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space


def check_vector_env(env: VectorEnv, *, steps: int = 500, seed: int = 0) -> None:
    """Raise ``AssertionError`` naming what breaks the contract of a vector environment.

    Checked, with actions drawn from the action space: batched spaces; shapes and dtypes of everything
    that ``reset`` and ``step`` return; observations inside their space; ``_key`` masks of infos;
    that nothing returned earlier is written to later; the autoreset mode that ``env.metadata`` states
    (next step: a finished world answers with its first observation, no reward and no end; same step:
    ``final_obs``; disabled: partial resets by ``reset_mask`` leave the other worlds alone, and stepping
    a finished world is refused); that an int seed s seeds world i with s + i, and equal seeds and actions
    give equal episodes. Ends within ``steps`` steps are needed to see the autoreset: an environment
    without any fails. Leaves ``env`` reset with ``seed``.
    """
    mode = _check_declarations(env)
    _check_seeding(env, seed, min(steps, 50))
    _Run(env, mode, seed).check(steps)
    env.reset(seed=seed)


def _require(condition: Any, message: str) -> None:
    if not condition:
        raise AssertionError(message)


def _check_declarations(env: VectorEnv) -> AutoresetMode:
    number = env.num_envs
    _require(
        isinstance(number, int) and number >= 1, f"num_envs: got {number!r}, expected an int of 1 or more"
    )
    mode = env.metadata.get("autoreset_mode")
    if not isinstance(mode, AutoresetMode):
        raise AssertionError(f"metadata['autoreset_mode']: got {mode!r}, expected an AutoresetMode")
    for kind in ("observation", "action"):
        single, batched = getattr(env, f"single_{kind}_space"), getattr(env, f"{kind}_space")
        expected = batch_space(single, number)
        _require(batched == expected, f"{kind}_space: got {batched}, expected {expected}")
    return mode


def _check_seeding(env: VectorEnv, seed: int, steps: int) -> None:
    """Equal seeds and actions give equal episodes, and an int counts up from world to world."""
    logs = []
    counted: Any = [seed + i for i in range(env.num_envs)]
    for given in (seed, seed, counted):
        observations, _ = env.reset(seed=given)
        env.action_space.seed(seed)
        log = [copy.deepcopy(observations)]
        for _ in range(steps):
            *returned, _ = env.step(env.action_space.sample())
            log.append(copy.deepcopy(returned))
            done = returned[2] | returned[3]
            if env.metadata["autoreset_mode"] == AutoresetMode.DISABLED and done.any():
                log.append(copy.deepcopy(env.reset(options={"reset_mask": done})[0]))
        logs.append(log)
    _require(_equal(logs[0], logs[1]), "seed: the same seed and actions gave different episodes")
    _require(_equal(logs[0], logs[2]), "seed: reset(seed=s) differs from reset(seed=[s, s + 1, ...])")


class _Run:
    """One run of an environment under random actions, each return checked."""

    def __init__(self, env: VectorEnv, mode: AutoresetMode, seed: int) -> None:
        self.env, self.mode, self.seed = env, mode, seed
        self.kept: list[tuple[str, Any, Any]] = []

    def check(self, steps: int) -> None:
        env, number = self.env, self.env.num_envs
        first = self._reset(seed=self.seed)
        observations, finished, ends = first, np.zeros(number, dtype=bool), 0
        env.action_space.seed(self.seed)
        for _ in range(steps):
            restarting = finished if self.mode == AutoresetMode.NEXT_STEP else np.zeros(number, dtype=bool)
            if self.mode == AutoresetMode.DISABLED and finished.any():
                self._check_partial_reset(observations, finished)
            observations, rewards, terminated, truncated, info = self._step()
            for name, values in (("reward", rewards), ("terminated", terminated), ("truncated", truncated)):
                quiet = not np.asarray(values)[restarting].any()
                _require(
                    quiet,
                    f"{name}: not zero in a world that only began its next episode (next-step autoreset)",
                )
            finished = terminated | truncated
            ends += int(finished.sum())
            if self.mode == AutoresetMode.SAME_STEP:
                self._check_final(info, finished)
        _require(ends, f"no episode ended in {steps} steps: the autoreset was not seen; raise steps")
        if self.mode == AutoresetMode.DISABLED:
            self._check_refusal(finished, steps)

    def _reset(self, **arguments: Any) -> Any:
        returned = self.env.reset(**arguments)
        _require(isinstance(returned, tuple) and len(returned) == 2, "reset: expected (observations, info)")
        self._check_observations("reset", returned[0])
        self._check_info("reset", returned[1], self.env.num_envs)
        self._check_memory("reset", returned)
        return returned[0]

    def _step(self) -> tuple[Any, ...]:
        returned = self.env.step(self.env.action_space.sample())
        _require(isinstance(returned, tuple) and len(returned) == 5, "step: expected five results")
        observations, rewards, terminated, truncated, info = returned
        number = self.env.num_envs
        self._check_observations("step", observations)
        _require(
            isinstance(rewards, np.ndarray) and rewards.shape == (number,) and rewards.dtype.kind == "f",
            f"rewards: got {_kind(rewards)}, expected float ({number},)",
        )
        _require(np.isfinite(rewards).all(), "rewards: not all are finite")
        for name, flags in (("terminated", terminated), ("truncated", truncated)):
            _require(
                isinstance(flags, np.ndarray) and flags.shape == (number,) and flags.dtype == bool,
                f"{name}: got {_kind(flags)}, expected bool ({number},)",
            )
        self._check_info("step", info, number)
        self._check_memory("step", returned)
        return returned

    def _check_observations(self, where: str, observations: Any) -> None:
        _require(
            observations in self.env.observation_space,
            f"{where}: observations ({_kind(observations)}) lie outside {self.env.observation_space}",
        )

    def _check_info(self, where: str, info: Any, number: int) -> None:
        _require(isinstance(info, dict), f"{where}: info is {type(info).__name__}, expected a dict of arrays")
        for key, value in info.items():
            if key.startswith("_"):
                continue
            mask = info.get(f"_{key}")
            _require(
                isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (number,),
                f"{where}: info[{key!r}] has mask {_kind(mask)}, expected bool ({number},) under '_{key}'",
            )
            if isinstance(value, dict):
                self._check_info(f"{where}: info[{key!r}]", value, number)
            else:
                rows = len(value) if hasattr(value, "__len__") else None
                _require(rows == number, f"{where}: info[{key!r}] has {rows} rows, expected {number}")

    def _check_memory(self, where: str, returned: Any) -> None:
        """What was returned by the last calls still reads as it did, and shares no memory with this return."""
        for earlier, arrays, copies in self.kept:
            _require(_equal(arrays, copies), f"{where} wrote to what an earlier {earlier} had returned")
            for old in arrays:
                for new in _arrays(returned):
                    _require(
                        not np.may_share_memory(old, new), f"{where} shares memory with an earlier {earlier}"
                    )
        arrays = _arrays(returned)
        self.kept = [*self.kept[-1:], (where, arrays, copy.deepcopy(arrays))]

    def _check_final(self, info: dict[str, Any], finished: np.ndarray) -> None:
        if not finished.any():
            return
        mask = info.get("_final_obs")
        _require(
            mask is not None and np.array_equal(mask, finished),
            "same-step autoreset: info['_final_obs'] differs from terminated | truncated",
        )
        for i in np.flatnonzero(finished):
            last = info["final_obs"][i]
            inside = last in self.env.single_observation_space
            _require(inside, f"final_obs[{i}] ({_kind(last)}) lies outside the single observation space")

    def _check_refusal(self, finished: np.ndarray, steps: int) -> None:
        """The last check of a run, because Gymnasium's own refuses when some worlds have moved already."""
        for _ in range(steps):
            if finished.any():
                break
            _, _, terminated, truncated, _ = self._step()
            finished = terminated | truncated
        try:
            self.env.step(self.env.action_space.sample())
        except Exception:  # any refusal will do: Gymnasium's own is an AssertionError
            return
        _require(not finished.any(), "disabled autoreset: a step with finished worlds was accepted")

    def _check_partial_reset(self, observations: Any, finished: np.ndarray) -> None:
        after = self._reset(options={"reset_mask": finished.copy()})
        if isinstance(after, np.ndarray):
            others = np.array_equal(after[~finished], np.asarray(observations)[~finished])
            _require(others, "disabled autoreset: reset_mask changed worlds outside the mask")


def _arrays(value: Any) -> list[np.ndarray]:
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [array for item in value.values() for array in _arrays(item)]
    return [array for item in value for array in _arrays(item)] if isinstance(value, tuple | list) else []


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(_equal(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, np.ndarray) and one.dtype == object:
        return _equal(list(one), list(other))
    if isinstance(one, np.ndarray | np.generic):
        return bool(np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind in "fc"))
    return bool(one == other)


def _kind(value: Any) -> str:
    return f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__

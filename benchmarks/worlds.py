"""How fast worlds step: native batches, the Gymnasium interfaces, and PPO against a zero-cost VecEnv.

``python benchmarks/worlds.py`` measures all; ``--only`` takes one of batch, vector, single, team, localization,
laser, ppo.

Every figure is the best of several repetitions, in world-steps (decisions) per second; a drift decision is
ten Runge–Kutta sub-steps with obstacles, energy and observation. Ratios compare runs that alternate in
one process. Other work on the machine lowers all of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium
import numpy as np
import tyro

import aquaquad_envs
from aquaquad_envs.tasks.batch import WorldBatch
from baselines import make_policy


def best_rate(run: Callable[[], int], repetitions: int = 8) -> float:
    """Highest steps per second of ``run``, which returns the steps it made."""
    run()
    rates = []
    for _ in range(repetitions):
        began = time.perf_counter()
        rates.append(run() / (time.perf_counter() - began))
    return max(rates)


def batch_rate(batch: WorldBatch, actions: np.ndarray, steps: int = 20) -> float:
    """World-steps per second of a raw batch; worlds start anywhere, so that they last."""

    def run() -> int:
        batch.reset(0)
        began = time.perf_counter()
        alive = 0
        for _ in range(steps):
            alive += int((batch.worlds["outcome"] == 0).sum())
            batch.step(actions)
        run.seconds = time.perf_counter() - began
        return alive

    run()
    rates = []
    for _ in range(8):
        alive = run()
        rates.append(alive / run.seconds)
    return max(rates)


def batches() -> None:
    """Raw batches of 4096 worlds: drift only, and half hops, on one and two threads."""
    rng = np.random.default_rng(0)
    drift = np.zeros((4096, 2))
    mixed = np.where(rng.random((4096, 1)) < 0.5, drift, rng.uniform(-0.6, 0.6, (4096, 2)))
    for scenario in ("vortex", "gyres"):
        for threads in (1, 2):
            batch = aquaquad_envs.make_world_batch(
                "drift-hop", 4096, threads=threads, scenario=scenario, start_anywhere=1.0
            )
            for name, actions in (("drift", drift), ("half hops", mixed)):
                rate = batch_rate(batch, actions)
                print(
                    f"batch   {scenario:8} 4096 worlds, {threads} thread(s), {name:9}: {rate / 1e6:6.2f} M/s"
                )


def vector() -> None:
    """``VectorEnv.step`` at 4096 worlds, and Gymnasium's own vector env of the same single worlds at 16."""
    for threads in (1, 2):
        env = gymnasium.make_vec(
            "AquaQuad/DriftHop-v0", num_envs=4096, vectorization_mode="vector_entry_point",
            threads=threads, start_anywhere=1.0,
        )  # fmt: skip
        actions = np.zeros((4096, 2), dtype=np.float32)
        env.reset(seed=0)

        def run(env: gymnasium.vector.VectorEnv = env, actions: np.ndarray = actions) -> int:
            for _ in range(20):
                env.step(actions)
            return 20 * 4096

        print(
            f"vector  VectorEnv.step, 4096 worlds, {threads} thread(s), drift: {best_rate(run) / 1e6:6.2f} M/s"
        )
    rates = {}
    for mode in ("vector_entry_point", "sync"):
        env = gymnasium.make_vec("AquaQuad/DriftHop-v0", num_envs=16, vectorization_mode=mode)
        small = np.zeros((16, 2), dtype=np.float32)
        env.reset(seed=0)

        def run_small(env: gymnasium.vector.VectorEnv = env, small: np.ndarray = small) -> int:
            for _ in range(200):
                env.step(small)
            return 200 * 16

        rates[mode] = best_rate(run_small)
    ratio = rates["vector_entry_point"] / rates["sync"]
    print(f"vector  native over SyncVectorEnv, 16 worlds: {ratio:.1f} times ({rates['sync'] / 1e6:.3f} M/s)")


def team() -> None:
    """Raw batches of 1024 teams of 4 vehicles: drift with the tracker in the loop, and half hops."""
    rng = np.random.default_rng(0)
    for threads in (1, 2):
        for measurement in ("tdoa", "range"):
            batch = aquaquad_envs.make_world_batch(
                "sensor-placement", 1024, threads=threads, scenario="vortex", measurement=measurement
            )
            drift = np.zeros(batch.action_shape)
            hops = rng.uniform(-0.6, 0.6, drift.shape) * (rng.random((*drift.shape[:2], 1)) < 0.5)
            for name, actions in (("drift", drift), ("half hops", hops)):
                rate = batch_rate(batch, actions, steps=10)
                cycles = rate * batch.params.sub_steps
                print(
                    f"team    vortex, {measurement:5} 1024 worlds, {threads} threads, {name:9}: {rate / 1e3:6.0f} k/s, "
                    f"{cycles / 1e6:.2f} M tracker cycles/s"
                )


def localization() -> None:
    """Raw batches of 1024 worlds of transponder localization, 30 measurements, every estimate in the loop."""
    rng = np.random.default_rng(0)
    cases = (
        ("single", {"scenario": "single"}), ("four", {"scenario": "four"}),
        ("random", {"scenario": "random"}), ("current", {"scenario": "current"}),
        ("aquaquad", {"scenario": "deep", "vehicle": "aquaquad"}),
    )  # fmt: skip
    for threads in (1, 2):
        for name, params in cases:
            batch = aquaquad_envs.make_world_batch(
                "transponder-localization", 1024, threads=threads, **params
            )
            rate = batch_rate(batch, rng.uniform(-0.5, 0.5, batch.action_shape), steps=29)
            print(f"localization {name:8} 1024 worlds, {threads} thread(s): {rate / 1e3:6.0f} k/s")


def laser() -> None:
    """Raw batches of 1024 laser tracking worlds, ten sub-steps of both vehicles a step; and with a policy's filter."""
    actions = np.random.default_rng(0).uniform(-0.6, 0.6, (1024, 2))
    for threads in (1, 2):
        batch = aquaquad_envs.make_world_batch("laser-tracking", 1024, threads=threads)
        rate = batch_rate(batch, actions, steps=50)
        print(f"laser   1024 worlds, {threads} thread(s), any velocity:  {rate / 1e3:6.0f} k/s")
        for name in ("search-hold", "ekf-tracking"):
            policy = make_policy(name, batch)

            def run(batch: WorldBatch = batch, policy: object = policy) -> int:
                batch.reset(0)
                policy.reset(np.arange(1024))
                for _ in range(300):  # search, and a while of tracking
                    batch.step(policy.act(batch.observations, batch.worlds))
                return 300 * 1024

            rate = best_rate(run, 4)
            print(
                f"laser   1024 worlds, {threads} thread(s), {name:12}: {rate / 1e3:6.0f} k/s, policy included"
            )


def single() -> None:
    """``gymnasium.Env.step`` of one world, with resets; CartPole-v1 beside it."""
    for name in ("AquaQuad/DriftHop-v0", "CartPole-v1"):
        env = gymnasium.make(name).unwrapped
        action = np.zeros(2, np.float32) if name.startswith("Aqua") else 0
        env.reset(seed=0)

        def run(env: gymnasium.Env = env, action: object = action) -> int:
            for _ in range(2000):
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    env.reset()
            return 2000

        print(f"single  {name}: {best_rate(run):,.0f} steps/s")


def ppo(frames: int = 200_000) -> None:
    """PPO at 256 worlds × 64 steps: frames per second against a zero-cost VecEnv of the same shape."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

    class ZeroCost(VecEnv):
        """Returns the same arrays for ever."""

        def __init__(self, like: VecEnv) -> None:
            super().__init__(like.num_envs, like.observation_space, like.action_space)
            self.render_mode = None
            self.observation = np.zeros((like.num_envs, *like.observation_space.shape), np.float32)
            self.zeros = np.zeros(like.num_envs, np.float32)
            self.never = np.zeros(like.num_envs, bool)

        def reset(self) -> np.ndarray:
            return self.observation

        def step_async(self, actions: np.ndarray) -> None:
            pass

        def step_wait(self) -> tuple:
            return self.observation, self.zeros, self.never, [{} for _ in range(self.num_envs)]

        def close(self) -> None:
            pass

        def get_attr(self, attr_name: str, indices: object = None) -> list:
            return [getattr(self, attr_name)] * self.num_envs

        def set_attr(self, attr_name: str, value: object, indices: object = None) -> None:
            raise AttributeError(attr_name)

        def env_method(
            self, method_name: str, *args: object, indices: object = None, **kwargs: object
        ) -> list:
            raise AttributeError(method_name)

        def env_is_wrapped(self, wrapper_class: type, indices: object = None) -> list[bool]:
            return [False] * self.num_envs

    native = aquaquad_envs.sb3_vec_env("drift-hop", 256, scenario="vortex-perturbed")
    settings = {"n_steps": 64, "batch_size": 4096, "n_epochs": 4, "device": "cpu"}
    models = {
        "native": PPO("MlpPolicy", native, **settings),
        "zero-cost": PPO("MlpPolicy", ZeroCost(native), **settings),
    }
    rates: dict[str, list[float]] = {name: [] for name in models}
    for model in models.values():
        model.learn(256 * 64)
    for _ in range(3):
        for name, model in models.items():
            began = time.perf_counter()
            model.learn(frames)
            rates[name].append(model.num_timesteps / (time.perf_counter() - began))
    native_rate, free_rate = np.median(rates["native"]), np.median(rates["zero-cost"])
    print(
        f"ppo     native {native_rate:,.0f} frames/s, zero-cost {free_rate:,.0f}: {native_rate / free_rate:.2f}"
    )


@dataclass
class Args:
    """Measure how fast worlds step."""

    only: str | None = None
    """one of: batch, vector, single, team, localization, laser, ppo"""


if __name__ == "__main__":
    chosen = tyro.cli(Args).only
    for label, measure in {
        "batch": batches,
        "vector": vector,
        "single": single,
        "team": team,
        "localization": localization,
        "laser": laser,
        "ppo": ppo,
    }.items():
        if chosen in (None, label):
            measure()

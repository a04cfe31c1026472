"""Training with Stable-Baselines3 on native worlds: resumable, observed, reproducible in its seed."""

from __future__ import annotations

import dataclasses
import json
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper

from agents import checkpoints
from agents.central_critic import CentralCriticPolicy, StateVecEnv
from agents.framed_vec_env import FramedVecEnv
from agents.frames import Frame
from agents.imitation import imitate
from agents.learned import LearnedPolicy
from agents.mixed_vec_env import MixedVecEnv
from agents.recipes import FIRST_TRAINING_SEED, VALIDATION_SEED, Recipe, check_steps
from agents.state import actor_of, actor_tensors, put_actor, restore_state, training_tensors
from aquaquad_envs.errors import CheckpointError
from aquaquad_envs.interfaces.registration import sb3_vec_env
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "mappo": PPO, "sac": SAC}


def build(recipe: Recipe, *, seed: int, threads: int, log_folder: Path | None) -> BaseAlgorithm:
    """The untrained Stable-Baselines3 model of ``recipe`` over a native batch of worlds."""
    kinds = [{**recipe.params, **variant} for variant in recipe.variants]
    share = max(recipe.num_worlds // len(kinds), 1)
    parts = [sb3_vec_env(recipe.task, share, threads=threads, **params) for params in kinds]
    worlds = parts[0] if len(parts) == 1 else MixedVecEnv(parts)
    env: VecEnvWrapper = FramedVecEnv(worlds, Frame(recipe.frame, worlds.batch.task.observation_names))
    settings = dict(recipe.algorithm_settings)
    policy: dict[str, Any] = {"net_arch": list(recipe.hidden)}
    if recipe.algorithm != "sac":
        policy |= {"log_std_init": recipe.initial_log_std, "activation_fn": torch.nn.Tanh}
    network: Any = "MlpPolicy"
    if recipe.algorithm == "mappo":
        network, env = CentralCriticPolicy, StateVecEnv(env)
        policy["own"] = len(worlds.batch.task.observation_names)
    return ALGORITHMS[recipe.algorithm](
        network, env, seed=seed, policy_kwargs=policy, device="cpu", verbose=0,
        tensorboard_log=None if log_folder is None else str(log_folder), **settings,
    )  # fmt: skip


def train(
    recipe: Recipe,
    *,
    steps: int,
    seed: int,
    output: Path,
    resume: bool = False,
    threads: int = 1,
    start_from: Path | None = None,
    command: str = "",
    quiet: bool = False,
) -> dict[str, Any]:
    """Train for ``steps`` frames and write ``output/policy`` (the best on validation) and its card.

    ``output/training`` holds everything needed to go on; it is rewritten atomically every
    ``recipe.checkpoint_every`` frames, so a kill loses at most one interval. ``resume`` goes on from there,
    with fresh episodes. ``start_from``, a policy checkpoint, is trained further in place of imitating.
    Returns the card.
    """
    check_steps(steps)
    output.mkdir(parents=True, exist_ok=True)
    model = build(recipe, seed=seed, threads=threads, log_folder=output / "tensorboard")
    progress: dict[str, Any] = {"frames": 0, "best_score": None, "wall_s": 0.0}
    if resume:
        tensors, card = checkpoints.load(output / "training", task=recipe.task, kind="training")
        same = {"recipe": json.loads(json.dumps(dataclasses.asdict(recipe))), "seed": seed}
        for name, value in same.items():
            if card[name] != value:
                raise CheckpointError(
                    f"{output / 'training'}: was made with another {name}; give the same options, or a new --output."
                )
        restore_state(model, tensors, card["optimisers"])
        progress = card["progress"]
    elif (output / "training" / checkpoints.CARD).exists():
        raise CheckpointError(
            f"{output}: already holds a training; add --resume to go on, or choose another --output."
        )
    follower = _Follower(
        recipe, seed=seed, output=output, steps=steps, progress=progress, command=command, quiet=quiet
    )
    if not progress["frames"]:
        if start_from is not None:
            tensors, card = checkpoints.load(start_from, task=recipe.task, kind="policy")
            put_actor(model, tensors)
            progress["started_from"] = {name: card[name] for name in ("command", "seed", "steps", "recipe")}
            follower.progress = dict(progress)
        elif recipe.imitation_rounds:
            follower.imitate(model)
    # Fresh episodes that no earlier interval has seen, far above every seed that is evaluated.
    fresh = np.random.SeedSequence([seed, progress["frames"]]).generate_state(1)
    model.env.seed(FIRST_TRAINING_SEED + int(fresh[0]))
    model.num_timesteps = progress["frames"]
    remaining = max(steps - progress["frames"], 0)
    if remaining:
        with follower.bar:
            model.learn(remaining, callback=follower, reset_num_timesteps=False, tb_log_name="run")
    follower.finish(model)
    return json.loads((output / "policy" / checkpoints.CARD).read_text())


class _Follower(BaseCallback):
    """Progress bar, periodic checkpoints, evaluation on held-out seeds, the best policy kept."""

    def __init__(
        self,
        recipe: Recipe,
        *,
        seed: int,
        output: Path,
        steps: int,
        progress: dict,
        command: str,
        quiet: bool,
    ) -> None:
        from agents.progress import TrainingBar

        super().__init__()
        self.recipe, self.seed, self.output, self.command = recipe, seed, output, command
        self.progress = dict(progress)
        self.bar = TrainingBar(total=steps, start=self.progress["frames"], quiet=quiet)
        self.recent: deque[dict[str, float]] = deque(maxlen=512)
        self.began = time.monotonic()
        self.before_s = self.progress["wall_s"]
        self.saved = self.evaluated = self.progress["frames"]
        self.frozen: Any = None

    def imitate(self, model: BaseAlgorithm) -> None:
        """Begin from an imitation of the recipe's expert."""
        torch.manual_seed(self.seed)
        imitate(actor_of(model), self.recipe, seed=self.seed, report=self.bar.imitation)
        self.evaluate(model)
        self.save(model)

    def _on_training_start(self) -> None:
        if self.progress["frames"] < self.recipe.value_warmup_frames:
            self._freeze(True)

    def _freeze(self, frozen: bool) -> None:
        for parameter in [*actor_of(self.model).parameters(), self.model.policy.log_std]:
            parameter.requires_grad_(not frozen)
        self.frozen = frozen

    def _on_rollout_start(self) -> None:
        frames = self.model.num_timesteps
        self.progress["frames"] = frames
        if self.frozen and frames >= self.recipe.value_warmup_frames:
            self._freeze(False)
        # Between an update and the next rollout the model is consistent: the time to evaluate and save.
        if frames - self.evaluated >= self.recipe.evaluate_every:
            self.evaluate(self.model)
        if frames - self.saved >= self.recipe.checkpoint_every:
            self.save(self.model)

    def _on_step(self) -> bool:
        self.recent.extend(info["metrics"] for info in self.locals["infos"] if "metrics" in info)
        self.bar.update(self.model.num_timesteps, self._means())
        return True

    def _on_rollout_end(self) -> None:
        for name, value in self._means().items():
            self.logger.record(f"task/{name}", value)

    def _means(self) -> dict[str, float]:
        if not self.recent:
            return {}
        return {name: float(np.mean([m[name] for m in self.recent])) for name in self.recent[0]}

    def evaluate(self, model: BaseAlgorithm) -> None:
        """Run the deterministic policy on held-out seeds; keep it if it is the best so far."""
        self.evaluated = self.progress["frames"]
        self._write_policy(model, self.output / "latest", results={})
        results = validate(self.recipe, self.output / "latest", self.recipe.evaluation_episodes)
        self.bar.evaluation(self.evaluated, results)
        if self.logger_ready(model):
            for name, value in results.items():
                if value is not None:
                    model.logger.record(f"validation/{name}", value)
        best = self.progress["best_score"]
        if best is None or results["score"] > best:
            self.progress["best_score"] = results["score"]
            self._write_policy(model, self.output / "policy", results=results)

    @staticmethod
    def logger_ready(model: BaseAlgorithm) -> bool:
        """Whether the model has its logger already (it has none before ``learn``)."""
        return hasattr(model, "_logger")

    def save(self, model: BaseAlgorithm) -> None:
        """Write everything needed to go on."""
        self.saved = self.progress["frames"]
        self.progress["wall_s"] = self.before_s + time.monotonic() - self.began
        tensors, optimisers = training_tensors(model)
        checkpoints.save(
            self.output / "training", tensors,
            {
                "kind": "training", "task": self.recipe.task, "seed": self.seed,
                "recipe": dataclasses.asdict(self.recipe), "progress": self.progress,
                "optimisers": optimisers, "versions": checkpoints.versions(),
            },
        )  # fmt: skip

    def finish(self, model: BaseAlgorithm) -> None:
        """Evaluate and save the last state."""
        self.progress["frames"] = model.num_timesteps
        if self.evaluated != self.progress["frames"] or self.progress["best_score"] is None:
            self.evaluate(model)
        self.save(model)

    def _write_policy(self, model: BaseAlgorithm, folder: Path, *, results: dict[str, float]) -> None:
        batch = model.env.batch
        wall_s = self.before_s + time.monotonic() - self.began
        checkpoints.save(
            folder, actor_tensors(model),
            {
                "kind": "policy", "task": self.recipe.task, "scenario": self.recipe.scenario,
                "algorithm": self.recipe.algorithm, "command": self.command, "seed": self.seed,
                "steps": self.progress["frames"], "training_s": round(wall_s, 1),
                "hidden": list(self.recipe.hidden), "activation": "relu" if self.recipe.algorithm == "sac" else "tanh",
                "squash": self.recipe.algorithm == "sac", "frame": self.recipe.frame,
                "observation_names": list(batch.task.observation_names),
                "params": {k: v for k, v in dataclasses.asdict(batch.params).items() if v is not None},
                "recipe": dataclasses.asdict(self.recipe), "results": results,
                "started_from": self.progress.get("started_from"),
                "versions": checkpoints.versions(),
            },
        )  # fmt: skip


def _mean(values: np.ndarray) -> float | None:
    """Mean for the card, None where a metric does not apply (JSON has no NaN)."""
    return float(np.mean(values)) if np.isfinite(values).all() else None


def validate(recipe: Recipe, folder: Path, episodes: int) -> dict[str, Any]:
    """Mean metrics of a policy checkpoint on ``episodes`` held-out seeds, and a score to compare by."""
    batch = make_world_batch(recipe.task, episodes, **recipe.validation)
    result = rollout(LearnedPolicy(batch, checkpoint=folder), batch, VALIDATION_SEED + np.arange(episodes))
    means = {name: _mean(values) for name, values in result.metrics.items()}
    means["score"] = float(np.mean(_SCORES[recipe.task](result.metrics)))
    return means


def _drift_hop_score(metrics: dict[str, np.ndarray]) -> np.ndarray:
    """The saving against direct flight; a failed episode counts as flying five times the direct way."""
    return np.where(metrics["success"] > 0, metrics["saving_vs_direct"], -4.0)


def _sensor_placement_score(metrics: dict[str, np.ndarray]) -> np.ndarray:
    """Minus the logarithm of the tracking error, and a tenth of that for every tenfold flight energy beyond 1 Wh."""
    lost = 1.0 - metrics["alive"]
    return -np.log(metrics["tracking_rmse_m"]) - 0.05 * np.log1p(metrics["flight_energy_wh"]) - 5.0 * lost


def _transponder_localization_score(metrics: dict[str, np.ndarray]) -> np.ndarray:
    """What the planners maximise: the information at the end."""
    return metrics["log_det"]


def _laser_tracking_score(metrics: dict[str, np.ndarray]) -> np.ndarray:
    """The share of the episode in the light, which counts finding it and keeping it."""
    return metrics["time_in_lda"]


def _plume_tracing_score(metrics: dict[str, np.ndarray]) -> np.ndarray:
    """Reaching the source, sooner a little better; where it is not reached, being nearer a little better."""
    return metrics["success"] - 0.0005 * metrics["updates_to_source"] - 0.002 * metrics["closest_m"]


#: What the best policy of a training is chosen by, each (episodes,), higher is better.
_SCORES = {
    "drift-hop": _drift_hop_score,
    "sensor-placement": _sensor_placement_score,
    "transponder-localization": _transponder_localization_score,
    "laser-tracking": _laser_tracking_score,
    "plume-tracing": _plume_tracing_score,
}

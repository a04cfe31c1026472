"""Train a policy on native worlds: parse, call, print."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass
class Args:
    """Train a policy with Stable-Baselines3 and keep the best one on held-out seeds.

    Example: python train.py --task drift-hop --scenario vortex --steps 5000000 --output runs/vortex

    The policy lands in OUTPUT/policy (weights.safetensors and card.json); evaluate it with
    python evaluate.py --policies ppo=OUTPUT/policy. TensorBoard logs are in OUTPUT/tensorboard. Stopped by
    Ctrl-C or killed, the same command with --resume goes on from the last checkpoint.
    """

    task: str = "drift-hop"
    """task to train on"""
    algorithm: Literal["ppo", "mappo", "sac"] = "ppo"
    """learning algorithm: ppo; mappo, for teams, whose critic sees the whole world in training; or sac"""
    scenario: str = "vortex"
    """world to train on: vortex or gyres; for sensor-placement also calm"""
    steps: int = 10_000_000
    """frames (decisions summed over worlds) to train for"""
    seed: int = 0
    """decides weights, episodes and exploration"""
    output: Path = Path("runs/training")
    """folder for checkpoints, the policy and logs"""
    resume: bool = False
    """go on from OUTPUT's last checkpoint"""
    start_from: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """policy checkpoint to train further, in place of imitating (default: none)"""
    threads: int = 1
    """threads that step the worlds; above 1 pays from about 512 worlds"""
    num_worlds: int | None = None
    """worlds stepped together (default: the recipe's)"""
    learning_rate: float | None = None
    """step size of the optimiser (default: the recipe's)"""
    gamma: float | None = None
    """discount of a reward, a decision (default: the recipe's)"""
    checkpoint_every: int | None = None
    """frames between checkpoints (default: the recipe's)"""
    imitation_rounds: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """rounds of imitating the recipe's scripted expert first; 0 learns from reward alone (default: the recipe's)"""


def main() -> int:
    """Run the command line; returns the exit status."""
    args = tyro.cli(Args, description=Args.__doc__)
    from agents.recipes import make_recipe
    from aquaquad_envs.errors import AquaQuadError, check_range

    try:
        recipe = make_recipe(args.task, args.scenario, args.algorithm)
        recipe = recipe.with_overrides(
            num_worlds=args.num_worlds,
            imitation_rounds=args.imitation_rounds,
            checkpoint_every=args.checkpoint_every,
        )
        if args.algorithm != "sac" and recipe.imitation_rounds == 0:
            # Nothing to imitate: exploring has to find everything, and the critic starts level with the actor.
            recipe = recipe.with_overrides(initial_log_std=-0.5, value_warmup_frames=0)
        if args.gamma is not None:
            check_range("gamma", args.gamma, 0.0, 1.0)
        given = {"learning_rate": args.learning_rate, "gamma": args.gamma}
        settings = {name: value for name, value in given.items() if value is not None}
        recipe = recipe.with_overrides(algorithm_settings={**recipe.algorithm_settings, **settings})
        from agents.training import train

        card = train(
            recipe, steps=args.steps, seed=args.seed, output=args.output, resume=args.resume,
            threads=args.threads, start_from=args.start_from, command=shlex.join(["python", *sys.argv]),
        )  # fmt: skip
    except AquaQuadError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nstopped; go on with --resume --output {args.output}", file=sys.stderr)
        return 130
    results = ", ".join(f"{name} {value:.4g}" for name, value in card["results"].items() if value is not None)
    print(f"{args.output / 'policy'}: best of {args.steps:,} frames: {results}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

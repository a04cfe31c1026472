"""Imitation of a scripted policy: dataset aggregation (DAgger) on the task's own worlds.

Ross, Gordon and Bagnell, "A reduction of imitation learning and structured prediction to no-regret
online learning", AISTATS 2011: the learner acts, the expert says what it would have done in the
states that the learner reaches, and the learner is fitted to all labels so far.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from agents.frames import Frame
from agents.recipes import FIRST_TRAINING_SEED, Recipe
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.tasks.batch import WorldBatch, make_world_batch
from aquaquad_envs.tasks.task import load_task
from baselines import Policy, make_policy

_MINIBATCH = 256


def imitate(
    actor: torch.nn.Module,
    recipe: Recipe,
    *,
    seed: int,
    report: Callable[[int, float, int], None],
) -> None:
    """Fit ``actor`` (observations -> mean actions) to the expert's labels, ``recipe.imitation_rounds`` rounds.

    ``report(round, loss, labels)`` is called after each round. Deterministic in ``seed``.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1]))
    order = torch.Generator().manual_seed(seed)
    optimiser = torch.optim.Adam(actor.parameters(), lr=1e-3)
    seen: list[np.ndarray] = []
    labels: list[np.ndarray] = []
    frame = Frame(recipe.frame, load_task(recipe.task).observation_names)
    for number in range(recipe.imitation_rounds):
        # Kinds of worlds take turns.
        kind = recipe.variants[number % len(recipe.variants)]
        params = {**recipe.params, **kind, **recipe.imitation_params}
        batch = make_world_batch(recipe.task, recipe.imitation_worlds, **params)
        first = FIRST_TRAINING_SEED + (seed * 1000 + number) * recipe.imitation_worlds
        batch.reset(first)
        # The optimum grazes obstacles, which a learner cannot copy without striking them now and then:
        # the expert plans around obstacles grown by a margin, in worlds that are the same otherwise.
        planned = dict(params)
        if hasattr(batch.params, "obstacle_margin_m"):
            planned["obstacle_margin_m"] = batch.params.obstacle_margin_m + recipe.imitation_margin_m
        expert = make_policy(recipe.expert, make_world_batch(recipe.task, recipe.imitation_worlds, **planned))
        for mission in range(recipe.imitation_missions):
            if recipe.imitation_scatter:
                batch.reset(first)
                if mission > 0:
                    _scatter(batch, rng)
                    # A world that was moved is observed by its next step: it drifts once.
                    batch.step(np.zeros(batch.action_shape))
            else:
                batch.reset(first + 2**30 * mission)
            # An expert with a memory begins it anew.
            expert.reset(first + 2**30 * mission + np.arange(recipe.imitation_worlds))
            # Early rounds mostly follow the expert, later ones mostly the learner.
            trust = 0.7**number if number or mission else 1.0
            decisions = None if mission == 0 else recipe.imitation_decisions
            observations, wanted = _roll(batch, expert, actor, frame, trust, rng, decisions)
            seen.append(observations)
            labels.append(wanted)
        loss = _fit(actor, optimiser, np.concatenate(seen), np.concatenate(labels), recipe, order)
        for group in optimiser.param_groups:
            group["lr"] = 1e-3 * (1.0 - 0.9 * (number + 1) / recipe.imitation_rounds)
        report(number + 1, loss, sum(map(len, labels)))


def _scatter(batch: WorldBatch, rng: np.random.Generator) -> None:
    """Move every vehicle to a random place on open water, at a random time of its mission."""
    worlds, ocean, size = batch.worlds, batch.ocean, batch.params.half_width_m
    for world in worlds:
        for _ in range(100):
            x, y = rng.uniform(-size, size, 2)
            if clearance_at(ocean.clearance, int(world["obstacle"]), ocean.clearance_grid, x, y) > 0.0:
                world["x"], world["y"] = x, y
                break
    worlds["time_s"] = rng.uniform(0.0, 0.6, len(worlds)) * batch.params.horizon_s
    worlds["battery_wh"] *= rng.uniform(0.5, 1.0, len(worlds))


def _roll(
    batch: WorldBatch,
    expert: Policy,
    actor: torch.nn.Module,
    frame: Frame,
    trust: float,
    rng: np.random.Generator,
    decisions: int | None,
) -> tuple[np.ndarray, np.ndarray]:
    """One mission of every world, or its first ``decisions``: observations met and the expert's answers to them."""
    seen, labels = [], []
    for _ in range(10_000 if decisions is None else decisions):
        running = ~batch.done
        if not running.any():
            break
        wanted = expert.act(batch.observations, batch.worlds)
        rows = batch.observations.reshape(-1, batch.observations.shape[-1])
        observed = frame.observe(rows)
        seen.append(observed[running.ravel()])
        labels.append(frame.see_actions(wanted.reshape(len(rows), -1), rows)[running.ravel()])
        with torch.no_grad():
            own = np.clip(actor(torch.from_numpy(observed)).numpy(), -1.0, 1.0)
        own = frame.act(own, rows).reshape(wanted.shape)
        follow = rng.random(batch.rows) < trust
        batch.step(np.where(follow[..., None], wanted, own))
    return np.concatenate(seen), np.concatenate(labels)


def _fit(
    actor: torch.nn.Module,
    optimiser: torch.optim.Optimizer,
    observations: np.ndarray,
    labels: np.ndarray,
    recipe: Recipe,
    order: torch.Generator,
) -> float:
    """Some epochs of least squares, or of Huber's loss; returns the last epoch's mean loss."""
    x, y = torch.from_numpy(observations), torch.from_numpy(labels)
    measure: torch.nn.Module = torch.nn.MSELoss()
    if recipe.imitation_huber is not None:
        measure = torch.nn.SmoothL1Loss(beta=recipe.imitation_huber)
    loss_sum = 0.0
    for _ in range(recipe.imitation_epochs):
        loss_sum = 0.0
        for part in torch.randperm(len(x), generator=order).split(_MINIBATCH):
            loss = measure(actor(x[part]), y[part])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            loss_sum += float(loss.detach()) * len(part)
    return loss_sum / len(x)

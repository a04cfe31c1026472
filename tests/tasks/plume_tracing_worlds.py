"""What the tests of plume tracing share."""

import numpy as np

import aquaquad_envs
from aquaquad_envs.tasks.plume_tracing_data import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.plume_tracing_observation import OBSERVATION_NAMES


def team(worlds=1, *, seed=0, at=None, source=None, current=None, **params):
    """Worlds, ``surround`` unless said otherwise; robots and source placed, and the current uniform, where given.

    Readings of the reset are those of where the world itself had placed all: step once for those of the new places.
    """
    batch = aquaquad_envs.make_world_batch("plume-tracing", worlds, **{"scenario": "surround", **params})
    if current is not None:
        velocity = np.empty_like(batch.ocean.velocity)
        velocity[...] = current
        velocity.setflags(write=False)
        batch.ocean = batch.ocean._replace(velocity=velocity)
    batch.reset(seed)
    if at is not None:
        for name, values in zip("xyz", np.transpose(at), strict=True):
            batch.worlds[name][:, : len(at)] = values
    if source is not None:
        for name, value in zip("xyz", source, strict=True):
            batch.worlds[f"source_{name}"] = value
    return batch


def stay(batch, steps=1):
    for _ in range(steps):
        batch.step(np.zeros(batch.action_shape))
    return batch


def places(batch, world=0, prefix=""):
    """Positions of the robots of one world, (n, 3) m."""
    w = batch.worlds[world]
    return np.stack([w[prefix + name][: batch.num_agents] for name in "xyz"], -1)


def seen(batch, name, robot=0, world=0):
    return float(batch.observations[world, robot, OBSERVATION_NAMES.index(name)])


def terms(batch, robot=0, world=0):
    return dict(zip(REWARD_TERMS, batch.reward_terms[world, robot], strict=True))


def outcome(batch, world=0):
    return OUTCOMES[batch.worlds["outcome"][world]]


def remembered(batch, robot=0, world=0):
    """The readings that a robot remembers, (n, 6)."""
    w = batch.worlds[world]
    table = w["memory_of"][robot]
    return w["memory"][table][: w["memory_count"][table]].copy()

"""What the tests of transponder localization share."""

import numpy as np

import aquaquad_envs
from aquaquad_envs.tasks.transponder_localization_data import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.transponder_localization_observation import OBSERVATION_NAMES

#: An aquaquad at home, without the slow model of the sun.
DEEP = {"scenario": "deep", "vehicle": "aquaquad", "num_fields": 2, "solar": "constant"}


def water(worlds=1, *, seed=0, **params):
    """Worlds begun, the first measurement made."""
    batch = aquaquad_envs.make_world_batch("transponder-localization", worlds, **params)
    batch.reset(seed)
    return batch


def flow(batch, u, v=0.0, seed=0):
    """``batch`` begun anew in a uniform current."""
    velocity = np.empty_like(batch.ocean.velocity)
    velocity[..., 0], velocity[..., 1] = u, v
    velocity.setflags(write=False)
    batch.ocean = batch.ocean._replace(velocity=velocity)
    batch.constants = batch.constants._replace(still_water=False)
    batch.reset(seed)
    return batch


def play(batch, actions):
    """Step with each of ``actions`` in turn, the same in all worlds."""
    for action in actions:
        batch.step(np.broadcast_to(np.asarray(action, dtype=float), batch.action_shape))
    return batch


def seen(batch, name, world=0):
    return float(batch.observations[world, OBSERVATION_NAMES.index(name)])


def terms(batch, world=0):
    return dict(zip(REWARD_TERMS, batch.reward_terms[world], strict=True))


def outcome(batch, world=0):
    return OUTCOMES[batch.worlds["outcome"][world]]


def unpacked(packed):
    """(..., 6) as symmetric matrices (..., 3, 3)."""
    return np.asarray(packed)[..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(*np.shape(packed)[:-1], 3, 3)

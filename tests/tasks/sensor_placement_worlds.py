"""What the tests of sensor placement share."""

import numpy as np

import aquaquad_envs
from aquaquad_envs.estimation.hdop import hdop
from aquaquad_envs.tasks.sensor_placement_data import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES


def sea(worlds=1, u=None, v=0.0, *, at=None, seed=0, **params):
    """Worlds of the calm (in a uniform current if ``u`` is given), vehicles placed by hand."""
    batch = aquaquad_envs.make_world_batch("sensor-placement", worlds, **{"scenario": "calm", **params})
    if u is not None:
        velocity = np.empty_like(batch.ocean.velocity)
        velocity[..., 0], velocity[..., 1] = u, v
        velocity.setflags(write=False)
        batch.ocean = batch.ocean._replace(velocity=velocity)
        batch.constants = batch.constants._replace(still_water=False)
    batch.reset(seed)
    if at is not None:
        batch.worlds["x"][:, : len(at)], batch.worlds["y"][:, : len(at)] = np.transpose(at)
    return batch


def drift(batch, decisions=1):
    for _ in range(decisions):
        batch.step(np.zeros(batch.action_shape))
    return batch


def seen(batch, name, vehicle=0, world=0):
    return float(batch.observations[world, vehicle, OBSERVATION_NAMES.index(name)])


def terms(batch, vehicle=0):
    return dict(zip(REWARD_TERMS, batch.reward_terms[0, vehicle], strict=True))


def outcomes(batch, world=0):
    return [OUTCOMES[k] for k in batch.outcomes[world]]


def errors(batch):
    """Position errors of all tracks (worlds, targets), m."""
    n, w = batch.params.num_targets, batch.worlds
    dx = w["estimate"][:, :n, 0] - w["target_x"][:, :n]
    return np.hypot(dx, w["estimate"][:, :n, 1] - w["target_y"][:, :n])


def bounds(batch):
    """Bounds on their root mean square (worlds, targets), m."""
    bound = batch.worlds["bound"][:, : batch.params.num_targets]
    return np.sqrt(bound[..., 0, 0] + bound[..., 1, 1])


def squashed_hdop(points, target, kind, pairs, c, scale):
    """HDOP h of a team about ``target`` as h / (h + scale)."""
    chosen = None
    if kind == "tdoa" and pairs == "reference":
        near = np.linalg.norm(points - target, axis=1).argmin()
        chosen = [(k, near) for k in range(len(points)) if k != near]
    value = min(hdop(kind, points, target, stds=c.std, pairs=chosen), c.hdop_cap)
    return value / (value + scale)

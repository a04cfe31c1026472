"""``hop-in-turn``: what it does with an observation, and how well a team fares with it."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES
from baselines import make_policy

AT = {name: i for i, name in enumerate(OBSERVATION_NAMES)}


def make(worlds=1, **params):
    return make_world_batch("sensor-placement", worlds, **params)


def asked(gains, *, room=1.0, rooms=1.0, ahead=(0.0, 1.0), **options):
    """The action on an observation with these gains of hops, 0° first."""
    batch = make()
    observation = np.zeros((1, 4, len(OBSERVATION_NAMES)), dtype=np.float32)
    first = AT["HDOP after hop 0° in turn"]
    observation[0, 0, first : first + 8] = -np.asarray(gains)
    observation[0, 0, AT["room"]] = room
    observation[0, 0, AT["room after hop 0°"] :][:8] = rooms
    observation[0, 0, AT["target 1 direction x"] :][:2] = ahead
    return make_policy("hop-in-turn", batch, **options).act(observation, batch.worlds)[0, 0]


def test_the_best_hop_is_made_if_it_gains_enough():
    gains = np.zeros(8)
    gains[[0, 2]] = 0.1, 0.3
    # 90° anticlockwise of north is west.
    assert asked(gains) == pytest.approx([-0.48, 0.0], abs=1e-6)
    assert (asked(gains, least_gain=0.4) == 0).all() and (asked(np.zeros(8)) == 0).all()


def test_hops_without_room_are_not_made_and_a_vehicle_without_room_leaves():
    gains, rooms = np.zeros(8), np.ones(8)
    gains[[0, 2]], rooms[2] = (0.1, 0.3), 0.1
    assert asked(gains, rooms=rooms) == pytest.approx([0.0, 0.48], abs=1e-6)
    worse, rooms = -np.linspace(0.1, 0.2, 8), np.full(8, 0.02)
    rooms[4] = 0.4
    # Nothing is gained, but only a hop astern finds more room than here.
    assert asked(worse, room=0.05, rooms=rooms) == pytest.approx([0.0, -0.48], abs=1e-6)
    assert (asked(worse, room=0.2, rooms=rooms) == 0).all()


@pytest.mark.parametrize("measurement", ["tdoa", "range", "bearing"])
def test_a_team_tracks_better_than_one_that_holds_and_loses_nobody(measurement):
    seeds = 2_000_000 + np.arange(16)
    errors = {}
    for name in ("hold", "hop-in-turn"):
        batch = make(16, scenario="vortex", measurement=measurement)
        metrics = rollout(make_policy(name, batch), batch, seeds).metrics
        errors[name] = np.median(metrics["tracking_rmse_m"])
        assert name == "hold" or metrics["alive"].min() == 1.0
    assert errors["hop-in-turn"] < errors["hold"]


def test_steered_vehicles_take_whole_steps():
    batch = make(8, scenario="grid")
    batch.reset(0)
    actions = make_policy("hop-in-turn", batch).act(batch.observations, batch.worlds)
    lengths = np.linalg.norm(actions, axis=-1).ravel()
    assert set(np.round(lengths, 6)) <= {0.0, 1.0} and (lengths > 0).any()


def test_refusals():
    batch = make()
    with pytest.raises(InvalidParameterError, match="least_gain: got -1"):
        make_policy("hop-in-turn", batch, least_gain=-1.0)
    with pytest.raises(InvalidParameterError, match="room: got 2"):
        make_policy("hop-in-turn", batch, room=2.0)

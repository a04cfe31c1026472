"""``hop-in-turn``: what it does with an observation, and how well a team fares with it."""

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from aquaquad_envs.tasks.sensor_placement_observation import GAIN_SCALE, OBSERVATION_NAMES
from baselines import make_policy

AT = {name: i for i, name in enumerate(OBSERVATION_NAMES)}


def make(worlds=1, **params):
    return make_world_batch("sensor-placement", worlds, **params)


def asked(hop, gain, *, room=1.0, **options):
    """The action where the team counts on this hop, which takes ``gain`` from the HDOP as observed."""
    batch = make()
    observation = np.zeros((1, 4, len(OBSERVATION_NAMES)), dtype=np.float32)
    observation[0, 0, AT["turn hop dx"] :][:3] = *hop, gain / (abs(gain) + GAIN_SCALE)
    observation[0, 0, AT["room"]] = room
    return make_policy("hop-in-turn", batch, **options).act(observation, batch.worlds)[0, 0]


def test_the_hop_that_others_count_on_is_made_if_it_gains_enough():
    assert asked((0.3, -0.4), 0.003) == pytest.approx([0.3, -0.4])
    assert (asked((0.3, -0.4), 0.001) == 0).all() and (asked((0.3, -0.4), 0.003, least_gain=0.01) == 0).all()


def test_a_vehicle_without_room_leaves_at_any_price():
    assert asked((0.3, -0.4), -0.2, room=0.1) == pytest.approx([0.3, -0.4])
    assert (asked((0.3, -0.4), -0.2, room=0.2) == 0).all()


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

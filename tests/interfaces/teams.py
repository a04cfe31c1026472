"""What tests of teams share: the list of tasks, the toy among them, and random play."""

import sys

import numpy as np

import aquaquad_envs
from aquaquad_envs.tasks.task import TASKS
from tests.interfaces import toy_team

#: Every task of a team, the toy first.
TEAMS = [toy_team.NAME, *(name for name, (_, agents, _) in TASKS.items() if agents == "team")]
#: Teams that begin and end together: no agent is done before its world.
TOGETHER = {"plume-tracing"}
#: Parameters under which random actions end agents one by one and worlds soon, by task.
SHORT = {
    "laser-tracking": {"horizon_s": 3.0},
    toy_team.NAME: {"horizon": 12, "battery": 30.0},
    "plume-tracing": {
        "horizon_updates": 25,
        "num_fields": 4,
        "plume_age_s": 60.0,
        "comm_radius_m": 8.0,
        "comm_loss": 0.2,
        "own_weight": 0.5,  # agents differ in their rewards
    },
    "sensor-placement": {
        "horizon_s": 3600.0,
        "scenario": "gyres",
        "num_fields": 4,
        "current_noise_m_s": 0.05,
    },
}


def list_toy(monkeypatch):
    """While a test runs, the toy is a task like any other, with its picture."""
    monkeypatch.setitem(TASKS, toy_team.NAME, (toy_team.ENV_ID, "team", toy_team.__name__))
    monkeypatch.setitem(sys.modules, "aquaquad_envs.rendering.toy_team", toy_team)


def make_batch(task, worlds, *, threads=1, **params):
    return aquaquad_envs.make_world_batch(task, worlds, threads=threads, **{**SHORT.get(task, {}), **params})


def random_actions(batch, seeds, decision):
    """Actions of one decision, world by world from ``seeds``: every batch gives a world the same ones."""
    agents, spec = batch.num_agents, batch.action_spec
    rows = []
    for seed in seeds:
        rng = np.random.default_rng([seed, decision])
        if spec.table is not None:
            rows.append(rng.integers(0, len(spec.table), agents))
        else:
            small = rng.uniform(size=(agents, 1)) < 0.5
            rows.append(rng.uniform(-1, 1, (agents, spec.size)) * np.where(small, 0.05, 1.0))
    return np.array(rows)

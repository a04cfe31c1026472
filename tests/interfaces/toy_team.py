"""A small compiled task of a team: batteries of unequal size, so that its agents end one after another.

Agents move by their action and pay for it from the battery; whoever has an empty one is out, and the
rest go on until time is up. All that a real team has is here: streams of random numbers, both action
types, a central view, metrics and a picture.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import check_choice, check_range
from aquaquad_envs.physics.randomness import WORDS, normal, uniform
from aquaquad_envs.tasks.task import ActionSpec, Task

NAME, ENV_ID = "toy-team", "AquaQuad/ToyTeam-v0"
MOST = 8
OUTCOMES = ("running", "battery empty", "time out", "team lost")
RUNNING, EMPTY, TIME_OUT, LOST = range(4)


@dataclass(frozen=True, kw_only=True)
class Params:
    team_size: int = 3
    #: Decisions before truncation.
    horizon: int = 40
    #: Greatest battery at the start, the least is a tenth of it; a decision takes 1, and as much again for the longest move.
    battery: float = 200.0
    #: Show an agent its last state in the step that ends it, in place of zeros.
    last_look: bool = False
    action_type: str = "continuous"

    def __post_init__(self):
        check_choice("action_type", self.action_type, ("continuous", "discrete"))
        check_range("team_size", self.team_size, 1, MOST)
        check_range("horizon", self.horizon, 1, 1000)
        check_range("battery", self.battery, 1.0, 1e6)


WORLD = np.dtype(
    [
        ("x", np.float64, (MOST,)), ("y", np.float64, (MOST,)), ("battery", np.float64, (MOST,)),
        ("hops", np.int64, (MOST,)), ("steps", np.int64), ("outcome", np.int64),
        ("agent_outcome", np.int64, (MOST,)), ("reading", np.float64, (MOST,)),
        ("rng_initial", np.uint64, (WORDS,)), ("rng_field", np.uint64, (WORDS,)),
        ("rng_sensor", np.uint64, (WORDS,)), ("rng_target", np.uint64, (WORDS,)),
    ]
)  # fmt: skip


class Ocean(NamedTuple):
    """Data that the kernels read."""

    flow: np.ndarray


class Constants(NamedTuple):
    """Scalars that the kernels read."""

    horizon: int
    battery: float
    last_look: bool


@kernel
def _observe(w, observations, c, shown):
    """Write the rows of the agents whose bit is set in ``shown``; zeros elsewhere."""
    for k in range(observations.shape[0]):
        row = observations[k]
        row[:] = 0.0
        if not (shown >> k) & 1:
            continue
        mean, others = 0.0, 0
        for j in range(observations.shape[0]):
            if j != k and w.agent_outcome[j] == RUNNING:
                mean += w.x[j]
                others += 1
        row[0] = w.x[k]
        row[1] = w.y[k]
        row[2] = max(w.battery[k] / c.battery, 0.0)
        row[3] = w.steps / c.horizon
        row[4] = mean / others if others > 0 else 0.0
        row[5] = w.reading[k]


@kernel
def _running(w, agents):
    """Bits of the agents that go on; those take a reading."""
    bits = 0
    for k in range(agents):
        if w.agent_outcome[k] == RUNNING:
            bits |= 1 << k
            w.reading[k] = min(max(0.2 * normal(w.rng_sensor), -1.0), 1.0)
    return bits


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    agents = observations.shape[1]
    for i in range(worlds.size):
        if not mask[i]:
            continue
        w = worlds[i]
        w.steps = 0
        w.outcome = RUNNING
        for k in range(agents):
            w.x[k] = uniform(w.rng_initial) - 0.5
            w.y[k] = uniform(w.rng_initial) - 0.5
            w.battery[k] = c.battery * (0.1 + 0.9 * uniform(w.rng_initial))
            w.hops[k] = 0
            w.agent_outcome[k] = RUNNING
        _observe(w, observations[i], c, _running(w, agents))


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    agents = observations.shape[1]
    for i in range(worlds.size):
        w = worlds[i]
        before = 0
        if w.outcome == RUNNING:
            w.steps += 1
        for k in range(agents):
            rewards[i, k] = 0.0
            terms[i, k, :] = 0.0
            if w.agent_outcome[k] != RUNNING:
                continue
            before |= 1 << k
            length = np.sqrt(actions[i, k, 0] ** 2 + actions[i, k, 1] ** 2)
            scale = 0.1 / max(length, 1.0)
            w.x[k] = min(max(w.x[k] + scale * actions[i, k, 0] + ocean.flow[0], -1.0), 1.0)
            w.y[k] = min(max(w.y[k] + scale * actions[i, k, 1] + ocean.flow[1], -1.0), 1.0)
            w.hops[k] += 1 if length > 0.1 else 0
            w.battery[k] -= 1.0 + min(length, 1.0)
            terms[i, k, 0] = -min(length, 1.0)
            if w.battery[k] <= 0.0:
                w.agent_outcome[k] = EMPTY
                terms[i, k, 1] = -5.0
            elif w.steps >= c.horizon:
                w.agent_outcome[k] = TIME_OUT
            rewards[i, k] = terms[i, k, 0] + terms[i, k, 1]
        alive = _running(w, agents)
        if w.outcome == RUNNING and alive == 0:
            w.outcome = TIME_OUT if w.steps >= c.horizon else LOST
        for k in range(agents):
            terminated[i, k] = w.agent_outcome[k] == EMPTY
            truncated[i, k] = w.agent_outcome[k] == TIME_OUT
        _observe(w, observations[i], c, before if c.last_look else alive)


@loop_kernel
def write_state(worlds, out, ocean, c):
    agents = (out.shape[1] - 1) // 3
    for i in range(worlds.size):
        w = worlds[i]
        for k in range(agents):
            out[i, 3 * k] = w.x[k]
            out[i, 3 * k + 1] = w.y[k]
            out[i, 3 * k + 2] = w.agent_outcome[k] == RUNNING
        out[i, 3 * agents] = w.steps / c.horizon


def metrics(worlds, params):
    outcomes = worlds["agent_outcome"][:, : params.team_size]
    return {
        "survivors": (outcomes != EMPTY).sum(1).astype(float),
        "decisions": worlds["steps"].astype(float),
    }


class Picture:
    """Its agents as dots."""

    size = (80, 60)

    def __init__(self, batch):
        self.batch = batch

    def restart(self):
        pass

    def paint(self, canvas, world):
        canvas.fill((250, 250, 250))
        for x, y in zip(world["x"][: self.batch.num_agents], world["y"], strict=False):
            canvas.circle((40 + 30 * x, 30 - 20 * y), 3.0, (20, 60, 120))


TASK = Task(
    name=NAME,
    params=Params,
    world=WORLD,
    observation_names=("x", "y", "battery", "time", "mean x of the others", "reading"),
    reward_terms=("move", "loss"),
    outcomes=OUTCOMES,
    build=lambda params: (
        Ocean(np.array([0.01, -0.01])),
        Constants(int(params.horizon), float(params.battery), bool(params.last_look)),
        (),
    ),
    action_spec=lambda params: ActionSpec(
        size=2,
        table=np.array([[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
        if params.action_type == "discrete"
        else None,
    ),
    reset=reset_batch,
    step=step_batch,
    metrics=metrics,
    num_agents=lambda params: params.team_size,
    agent_name="drifter",
    state=write_state,
    state_names=lambda params: (
        *(f"{what} {k}" for k in range(params.team_size) for what in ("x", "y", "alive")),
        "time",
    ),
)

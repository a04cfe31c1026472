"""Compiled worlds of plume tracing: reset and step, world by world.

A step moves all robots (or the one whose turn it is), then the plume; then all robots read, find their places and
tell each other. An update of the team is one step, or one turn of every robot.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.sensing.plume import PLUME
from aquaquad_envs.tasks.plume_tracing_data import MAX_ROBOTS, REACHED, RUNNING, SCRATCH, TIME_OUT
from aquaquad_envs.tasks.plume_tracing_motion import move_team, start_team
from aquaquad_envs.tasks.plume_tracing_observation import observe_world, view_world
from aquaquad_envs.tasks.plume_tracing_plume import advance_plume, start_plume
from aquaquad_envs.tasks.plume_tracing_sensing import forget_all, sense

#: s of grace: rounding of the clock must not add an update.
_GRACE = 1e-6


@loop_kernel
def reset_world(w, ocean, c, s, frame):
    """Draw a new episode into record ``w``: field, plume, team, first readings; the streams go on."""
    w.truth = int(uniform(w.rng_field) * ocean.velocity.shape[0])
    w.forecast = w.truth
    w.obstacle = 0
    w.clock_s = c.plume_age + c.start_time_spread * uniform(w.rng_field)
    w.time_s = 0.0
    w.num_robots = c.num_robots
    w.turn = 0 if c.sequential else -1
    w.updates = 0
    w.steps = 0
    w.near_s = 0.0
    w.reached_at = -1
    w.last_moved = 0
    w.outcome = RUNNING
    for i in range(MAX_ROBOTS):
        w.agent_outcome[i] = RUNNING
    start_team(w, ocean, c)
    start_plume(w, ocean, c, frame)
    forget_all(w, c)
    sense(w, ocean, c, s)
    for i in range(c.num_robots):
        w.level_before[i] = w.level[i]
        w.mean_level[i] = w.level[i]
        w.detection_rate[i] = 1.0 if w.reading[i] > 0.0 else 0.0


@kernel
def closest_and_mean(w, c):
    """Least and mean distance of the team to the source, m."""
    least = np.inf
    total = 0.0
    for i in range(c.num_robots):
        least = min(least, w.distance[i])
        total += w.distance[i]
    return least, total / c.num_robots


@kernel
def _advance_clocks(w, dt, c):
    w.steps += 1
    if c.sequential:
        w.turn += 1
        if w.turn == c.num_robots:
            w.turn = 0
            w.updates += 1
        w.time_s = c.update_period * w.updates + dt * w.turn
    else:
        w.updates += 1
        w.time_s = c.update_period * w.updates


@kernel
def _close(w, closest, dt, c):
    """Note when the source is reached, and end what is over. Returns 1 where it has just been reached."""
    w.near_s = w.near_s + dt if closest <= c.reach_radius else 0.0
    just = 0
    if w.reached_at < 0 and closest <= c.reach_radius and w.near_s >= c.reach_time - _GRACE:
        w.reached_at = w.updates
        just = 1
    ended = RUNNING
    if just and c.stop_at_source:
        ended = REACHED
    elif w.updates >= c.horizon_updates:
        ended = TIME_OUT
    if ended != RUNNING:
        w.outcome = ended
        for i in range(c.num_robots):
            w.agent_outcome[i] = ended
    return just


@kernel
def _step_world(w, actions, observations, terms, ocean, c, s, frame):
    """One step of a running world; writes observations and reward terms of all robots."""
    closest, mean = closest_and_mean(w, c)
    for i in range(c.num_robots):
        s.before[i] = w.distance[i]
    dt = c.update_period / c.num_robots if c.sequential else c.update_period
    blocked = move_team(w, actions, c)
    began = w.time_s
    searching = 1.0 if w.reached_at < 0 else 0.0
    _advance_clocks(w, dt, c)
    if c.source.kind == PLUME:
        advance_plume(w, began, w.time_s, ocean, c, frame)
    sense(w, ocean, c, s)
    # Before the world is closed: what ends it by time still sees the team at work.
    observe_world(w, observations, c, s)
    closest_now, mean_now = closest_and_mean(w, c)
    just = _close(w, closest_now, dt, c)
    for i in range(c.num_robots):
        terms[i, 0] = c.closest_weight * (closest - closest_now) / c.step_limit
        terms[i, 1] = c.mean_weight * (mean - mean_now) / c.step_limit
        terms[i, 2] = c.own_weight * (s.before[i] - w.distance[i]) / c.step_limit
        terms[i, 3] = c.reached_bonus * just
        terms[i, 4] = -c.blocked_weight * blocked
        terms[i, 5] = -c.time_weight * searching * dt / c.update_period


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    frame = np.empty((1, 1, *ocean.velocity.shape[2:]))
    for k in range(worlds.size):
        if mask[k]:
            reset_world(worlds[k], ocean, c, s, frame)
            observe_world(worlds[k], observations[k], c, s)
    scratch[0].blocked = 0  # a record does not keep its array alive: this does


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one step of its team.

    Writes observations, rewards and their terms, terminated and truncated of all robots. A finished world gets zeros
    and keeps its flags.
    """
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    frame = np.empty((1, 1, *ocean.velocity.shape[2:]))
    for k in range(worlds.size):
        w = worlds[k]
        if w.outcome == RUNNING:
            _step_world(w, actions[k], observations[k], terms[k], ocean, c, s, frame)
        else:
            observations[k, :, :] = 0.0
            terms[k, :, :] = 0.0
        for i in range(c.num_robots):
            total = 0.0
            for term in range(terms.shape[2]):
                total += terms[k, i, term]
            rewards[k, i] = total
            terminated[k, i] = w.outcome == REACHED
            truncated[k, i] = w.outcome == TIME_OUT
    scratch[0].blocked = 0  # as in reset_batch


@loop_kernel
def state_batch(worlds, out, ocean, c):
    """The central view of every world."""
    for k in range(worlds.size):
        view_world(worlds[k], out[k], ocean, c)

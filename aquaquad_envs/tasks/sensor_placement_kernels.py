"""Compiled worlds of sensor placement: reset and step, world by world.

A decision is ``sub_steps`` equal pieces of the action period. In each the vehicles, the targets and the fence
move; at its end every target is heard, every track goes through one cycle, and sums are taken.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.energy import charge_between
from aquaquad_envs.physics.randomness import uniform
from aquaquad_envs.tasks.ocean import draw_clock, draw_scenario
from aquaquad_envs.tasks.sensor_placement_coverage import coverage
from aquaquad_envs.tasks.sensor_placement_data import (
    MAX_TARGETS,
    MAX_VEHICLES,
    ROUGH_FIX,
    RUNNING,
    SCRATCH,
    TEAM_LOST,
    TIME_OUT,
)
from aquaquad_envs.tasks.sensor_placement_observation import observe_world, view_world
from aquaquad_envs.tasks.sensor_placement_sensing import (
    advance_links,
    find_afloat,
    forget_delivered,
)
from aquaquad_envs.tasks.sensor_placement_targets import move_fence, move_target, start_fence, start_target
from aquaquad_envs.tasks.sensor_placement_tracking import load_track, start_track, store_track, track_target
from aquaquad_envs.tasks.sensor_placement_vehicles import begin_motion, move_vehicle, start_vehicles

#: Energy unit of the reward, Wh a vehicle.
REWARD_UNIT_WH = 10.0


@kernel
def _prepare(s, c):
    """Scratch memory that never changes during a call."""
    for row in range(s.kinds.size):
        s.kinds[row] = c.kind
        s.mask[row] = True
    s.nowhere[:] = 0.0


@loop_kernel
def reset_world(w, ocean, c):
    """Draw a new episode into record ``w``: scenario, team, targets, estimates, fence; the streams go on."""
    draw_scenario(w, ocean)
    w.num_vehicles = c.num_vehicles
    w.num_targets = c.num_targets
    draw_clock(w, c)
    for i in range(MAX_VEHICLES):
        w.x[i] = 0.0
        w.y[i] = 0.0
        w.start_x[i] = 0.0
        w.start_y[i] = 0.0
        w.battery_wh[i] = 0.0
        w.flight_wh[i] = 0.0
        w.solar_wh[i] = 0.0
        w.spent_wh[i] = 0.0
        w.clipped_wh[i] = 0.0
        w.drift_s[i] = 0.0
        w.flight_s[i] = 0.0
        w.hops[i] = 0
        w.on_water[i] = 0.0
        w.link_down[i] = 0
        w.agent_outcome[i] = RUNNING
    start_vehicles(w, ocean, c)
    for i in range(c.num_vehicles):
        if c.dropout > 0.0:
            w.link_down[i] = 1 if uniform(w.rng_sensor) < c.dropout else 0
    for j in range(c.num_targets):
        start_target(w, j, ocean, c)
        start_track(w, j, c)
    for j in range(c.num_targets, MAX_TARGETS):
        w.times_lost[j] = 0
        w.lost[j] = 0
    if c.fence:
        start_fence(w, c)
    w.pending_count = 0
    w.pending_lost = 0
    w.error2_sum = 0.0
    w.bound2_sum = 0.0
    w.nees_sum = 0.0
    w.cycles = 0
    w.hdop_s = 0.0
    w.coverage_s = 0.0
    w.alive_s = 0.0
    w.repairs = 0
    w.steps = 0
    w.outcome = RUNNING


@kernel
def _begin_decision(w, actions, c, s):
    """Hops take off, and tracks move to scratch memory."""
    s.error2 = 0.0
    s.bound2 = 0.0
    s.hdop = 0.0
    s.squashed_hdop = 0.0
    s.coverage = 0.0
    s.flown_wh = 0.0
    s.died = 0
    for i in range(c.num_vehicles):
        if w.agent_outcome[i] == RUNNING:
            begin_motion(w, i, actions[i, 0], actions[i, 1], s, c)
            w.on_water[i] = 1.0 - s.flight_left_s[i] / c.action_period
    for j in range(c.num_targets):
        if c.states == 4:
            load_track(w, j, s.state4[j], s.covariance4[j], s)
        else:
            load_track(w, j, s.state6[j], s.covariance6[j], s)


@kernel
def _move_all(w, begin, end, ocean, c, s):
    """Vehicles, targets, fence and links from mission time ``begin`` to ``end``."""
    dt = end - begin
    now = w.clock_s + begin
    charged = charge_between(ocean.collected_wh, ocean.solar_step, now, now + dt)
    for i in range(c.num_vehicles):
        if w.agent_outcome[i] == RUNNING:
            move_vehicle(w, i, now, dt, charged, ocean, c, s)
    for j in range(c.num_targets):
        move_target(w, j, end, dt, ocean, c)
    w.alive_s += dt * find_afloat(w, c, s)
    advance_links(w, dt, end, c, s)
    if c.fence:
        move_fence(w, dt, c)
        covered = coverage(w, s.afloat, c)
        w.coverage_s += covered * dt
        s.coverage += covered


@kernel
def _end_decision(w, began, c, s):
    """Tracks and sums go back to the record."""
    w.time_s = began + c.action_period
    w.steps += 1
    w.error2_sum += s.error2
    w.bound2_sum += s.bound2
    w.hdop_s += s.hdop * c.action_period / (c.sub_steps * max(c.num_targets, 1))
    for j in range(c.num_targets):
        if c.states == 4:
            store_track(w, j, s.state4[j], s.covariance4[j], s)
        else:
            store_track(w, j, s.state6[j], s.covariance6[j], s)


@kernel
def _close(w, c):
    """End what is over: the mission by time, or with its last vehicle."""
    alive = 0
    for i in range(c.num_vehicles):
        alive += 1 if w.agent_outcome[i] == RUNNING else 0
    if alive == 0:
        w.outcome = TEAM_LOST
    # A microsecond of grace: rounding of the clock must not add a decision.
    elif w.time_s >= c.horizon - 1e-6:
        w.outcome = TIME_OUT
        for i in range(c.num_vehicles):
            if w.agent_outcome[i] == RUNNING:
                w.agent_outcome[i] = TIME_OUT


@kernel
def _quality(error, scale, c):
    """1 for no error, a half at ``scale``, 0 for the greatest; 0 without targets."""
    return scale / (scale + error) if c.num_targets > 0 else 0.0


@kernel
def _price(team, c, s):
    """Reward terms of the decision, the same for the whole team, into ``team`` (terms,)."""
    cycles = max(c.sub_steps * c.num_targets, 1)
    # Qualities in [0, 1], not costs: were every decision a cost, an early end would pay.
    error = np.sqrt(s.error2 / cycles)
    held = _quality(error, c.fix_scale, c)
    reachable = _quality(np.sqrt(s.bound2 / cycles), c.fix_scale, c)
    team[0] = c.tracking_weight * (held - reachable)
    team[1] = c.bound_weight * reachable
    team[2] = c.acquisition_weight * _quality(error, ROUGH_FIX * c.fix_scale, c)
    team[3] = c.hdop_weight * (1.0 - s.squashed_hdop / cycles) if c.num_targets > 0 else 0.0
    team[4] = c.coverage_weight * s.coverage / c.sub_steps if c.fence else 0.0
    team[5] = -c.energy_weight * s.flown_wh / (REWARD_UNIT_WH * c.num_vehicles)
    team[6] = -c.failure_penalty * s.died / c.num_vehicles


@kernel
def _write_agents(w, running, members, team, rewards, terms, terminated, truncated, c):
    """Rewards of the agents that took part (``members``), and the flags of all."""
    for i in range(c.num_vehicles):
        total = 0.0
        for k in range(team.size):
            value = team[k] if running and members[i] else 0.0
            terms[i, k] = value
            total += value
        rewards[i] = total
        truncated[i] = w.agent_outcome[i] == TIME_OUT
        terminated[i] = w.agent_outcome[i] != RUNNING and w.agent_outcome[i] != TIME_OUT


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    members = np.ones(MAX_VEHICLES, dtype=np.bool_)
    _prepare(s, c)
    for k in range(worlds.size):
        if mask[k]:
            reset_world(worlds[k], ocean, c)
            observe_world(worlds[k], members, observations[k], ocean, c, s)
    scratch[0].died = 0  # a record does not keep its array alive: this does


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one decision of its team.

    Writes observations, rewards and their terms, terminated and truncated of all agents. An agent that was
    done before, and a finished world, get zeros and keep their flags.
    """
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    team = np.zeros(terms.shape[2])
    members = np.empty(MAX_VEHICLES, dtype=np.bool_)
    _prepare(s, c)
    # One function does it all: every further level of calls would be optimised, and paid for in start-up, anew.
    for index in range(worlds.size):
        w = worlds[index]
        for i in range(c.num_vehicles):
            members[i] = w.agent_outcome[i] == RUNNING
        running = w.outcome == RUNNING
        if running:
            _begin_decision(w, actions[index], c, s)
            began = w.time_s
            dt = c.action_period / c.sub_steps
            for k in range(c.sub_steps):
                end = began + (k + 1) * dt
                _move_all(w, began + k * dt, end, ocean, c, s)
                for j in range(c.num_targets):
                    track_target(w, j, end, dt, c, s)
                forget_delivered(w, end)
            _end_decision(w, began, c, s)
            _price(team, c, s)
            # Before the mission is closed: what ends it by time still sees the team at work.
            observe_world(w, members, observations[index], ocean, c, s)
            _close(w, c)
        else:
            observations[index, :, :] = 0.0
        _write_agents(
            w, running, members, team, rewards[index], terms[index], terminated[index], truncated[index], c
        )
    scratch[0].died = 0  # as in reset_batch


@loop_kernel
def state_batch(worlds, out, ocean, c):
    """The central view of every world."""
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    _prepare(s, c)
    for k in range(worlds.size):
        view_world(worlds[k], out[k], ocean, c, s)
    scratch[0].died = 0  # as in reset_batch

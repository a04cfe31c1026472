"""Compiled worlds of laser tracking: reset and step. Vehicles move over lanes of worlds, the rest world by world."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.randomness import normal, uniform
from aquaquad_envs.tasks.laser_tracking_data import RUNNING, TIME_OUT
from aquaquad_envs.tasks.laser_tracking_memory import remember, start_memory
from aquaquad_envs.tasks.laser_tracking_motion import (
    LANES,
    ROWS,
    change_motion,
    move_members,
    place_vehicles,
    start_motion,
    start_vehicles,
)
from aquaquad_envs.tasks.laser_tracking_observation import observe_world
from aquaquad_envs.tasks.laser_tracking_sensing import find_light, measure, start_sensing


@kernel
def _count(world, dt, c):
    """Add the ``dt`` s that end now to the sums of the metrics."""
    if world.in_lda == 1 and world.acquired_s < 0.0:
        world.acquired_s = world.time_s
        # The decision that found the light is not counted after it: it began outside.
    elif world.acquired_s >= 0.0:
        world.error2_sum += world.range_m * world.range_m * dt
    if world.in_lda == 1:
        world.lda_s += dt
    world.light_sum += min(world.light / c.peak, 1.0) * dt


@kernel
def reset_world(world, c):
    """Begin an episode: light and first guess from the stream of the start, motion from that of the target."""
    course = 2.0 * np.pi * uniform(world.rng_initial)
    distance = c.start_distance * (0.6 + 0.4 * uniform(world.rng_initial))
    error_x = c.guess_std * normal(world.rng_initial)
    error_y = c.guess_std * normal(world.rng_initial)
    rov_x = distance * np.cos(course)
    rov_y = distance * np.sin(course)
    if c.axes == 1:
        rov_x = distance if rov_x > 0.0 else -distance
        rov_y = 0.0
        error_y = 0.0
    world.guess_x = rov_x + error_x
    world.guess_y = rov_y + error_y
    start_vehicles(world, rov_x, rov_y, c)
    start_motion(world, c)
    world.command_u = 0.0
    world.command_v = 0.0
    world.time_s = 0.0
    world.steps = 0
    world.outcome = RUNNING
    world.acquired_s = -1.0
    world.lda_s = 0.0
    world.light_sum = 0.0
    world.error2_sum = 0.0
    find_light(world, c)
    if world.in_lda == 1:
        world.acquired_s = 0.0
    start_sensing(world, c)
    start_memory(world, c)


@kernel
def _take_command(world, action, c):
    """Take ``action`` as the velocity command; returns how much that changed, as a share of the greatest speed."""
    x = action[0]
    y = action[1] if c.axes == 2 else 0.0
    norm = np.sqrt(x * x + y * y)
    scale = c.max_speed / norm if norm > 1.0 else c.max_speed
    before_u = world.command_u
    before_v = world.command_v
    world.command_u = scale * x
    world.command_v = scale * y
    change_u = world.command_u - before_u
    change_v = world.command_v - before_v
    return np.sqrt(change_u * change_u + change_v * change_v) / c.max_speed


@kernel
def _price(world, change, term, c):
    """Reward terms of a decision; see docs/laser_tracking.md."""
    term[0] = c.light_weight * c.action_period * min(world.light / c.peak, 1.0)
    term[1] = c.area_weight * c.action_period * world.in_lda
    term[2] = c.center_weight * c.action_period * c.radius / (c.radius + world.range_m)
    term[3] = -c.effort_weight * c.action_period * change * change
    return term[0] + term[1] + term[2] + term[3]


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    for k in range(worlds.size):
        if mask[k]:
            reset_world(worlds[k], c)
            observe_world(worlds[k], observations[k], c)


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one decision.

    Writes observations, rewards and their terms, terminated and truncated. A finished world stays as it is,
    at no reward.
    """
    rows = np.empty((ROWS, LANES))
    members = np.empty(LANES, dtype=np.int64)
    changes = np.empty(LANES)
    first = 0
    while first < worlds.size:
        # The next running worlds, as many as there are lanes.
        n = 0
        while first < worlds.size and n < LANES:
            world = worlds[first]
            if world.outcome == RUNNING:
                changes[n] = _take_command(world, actions[first], c)
                change_motion(world, c)
                members[n] = first
                n += 1
            else:
                terms[first, :] = 0.0
                rewards[first] = 0.0
                terminated[first] = False
                truncated[first] = True
            first += 1
        if n > 0:
            move_members(worlds, members[:n], rows, c)
        for i in range(n):
            k = members[i]
            world = worlds[k]
            world.steps += 1
            # A product, not a sum: no rounding adds up.
            world.time_s = world.steps * c.action_period
            place_vehicles(world, c)
            find_light(world, c)
            measure(world, c.action_period, c)
            remember(world, c)
            _count(world, c.action_period, c)
            if world.time_s >= c.horizon - 1e-6:
                world.outcome = TIME_OUT
            rewards[k] = _price(world, changes[i], terms[k], c)
            terminated[k] = False
            truncated[k] = world.outcome == TIME_OUT
            observe_world(world, observations[k], c)

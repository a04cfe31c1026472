"""Compiled worlds of transponder localization: reset and step, world by world."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.tasks.ocean import draw_clock, draw_scenario
from aquaquad_envs.tasks.transponder_localization_data import RUNNING, TIME_OUT
from aquaquad_envs.tasks.transponder_localization_observation import make_scratch, observe_world
from aquaquad_envs.tasks.transponder_localization_sensing import measure, squared_error, start_transponders
from aquaquad_envs.tasks.transponder_localization_vehicles import move, start_vehicle

#: Energy unit of the reward, Wh.
REWARD_UNIT_WH = 10.0


@loop_kernel
def reset_world(w, ocean, c):
    """Draw a new episode into record ``w`` and make its first measurement; the streams go on."""
    draw_scenario(w, ocean)
    draw_clock(w, c)
    middle_x = 0.0
    middle_y = 0.0
    if c.about_start:
        middle_x = ocean.scenarios[w.scenario].start_x
        middle_y = ocean.scenarios[w.scenario].start_y
    start_vehicle(w, middle_x, middle_y, ocean, c)
    start_transponders(w, middle_x, middle_y, ocean, c)
    w.steps = 0
    w.outcome = RUNNING
    measure(w, c)


@kernel
def _log_error(w, c):
    """Logarithm of the error of the estimates, m; that of a range is added, so that none is best."""
    return np.log(np.sqrt(squared_error(w)) + c.sigma)


@loop_kernel
def step_world(w, action_x, action_y, terms, ocean, c):
    """Move, measure where the vehicle then is, and price the step by its ``terms``."""
    log_det = w.log_det
    log_error = _log_error(w, c)
    flight_wh = w.flight_wh
    move(w, action_x, action_y, ocean, c)
    w.steps += 1
    lost = w.outcome != RUNNING
    if not lost:
        measure(w, c)
        if w.count >= c.num_measurements:
            w.outcome = TIME_OUT
    terms[0] = c.information_weight * (w.log_det - log_det) / w.num_transponders
    terms[1] = c.error_weight * (log_error - _log_error(w, c))
    terms[2] = -c.energy_weight * (w.flight_wh - flight_wh) / REWARD_UNIT_WH
    terms[3] = -c.failure_penalty if lost else 0.0


@loop_kernel
def reset_batch(worlds, mask, observations, ocean, c):
    """Reset and observe the worlds whose ``mask`` is true."""
    s = make_scratch()
    for k in range(worlds.size):
        if mask[k]:
            reset_world(worlds[k], ocean, c)
            observe_world(worlds[k], observations[k], ocean, c, s)


@loop_kernel
def step_batch(worlds, actions, observations, rewards, terms, terminated, truncated, ocean, c):
    """Advance every running world by one measurement.

    Writes observations, rewards and their terms, terminated and truncated. A finished world stays as it is, at no
    reward.
    """
    s = make_scratch()
    last = actions.shape[1] - 1  # of one number the second is the first, and nobody reads it
    for k in range(worlds.size):
        w = worlds[k]
        if w.outcome == RUNNING:
            step_world(w, actions[k, 0], actions[k, last], terms[k], ocean, c)
            observe_world(w, observations[k], ocean, c, s)
        else:
            terms[k, :] = 0.0
        rewards[k] = terms[k, 0] + terms[k, 1] + terms[k, 2] + terms[k, 3]
        truncated[k] = w.outcome == TIME_OUT
        terminated[k] = w.outcome != RUNNING and w.outcome != TIME_OUT

"""Laser tracking: find the light of a laser that a submerged vehicle points upward, and stay in it.

Each decision is a horizontal velocity command of a quadrotor that holds its altitude. See ``docs/laser_tracking.md``
for the tables of observation, action and reward.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.physics.quadrotor import Quadrotor
from aquaquad_envs.physics.rov import Rov
from aquaquad_envs.sensing.laser import detectable_radius, peak_intensity, radius_of_intensity
from aquaquad_envs.tasks import laser_tracking_data as data
from aquaquad_envs.tasks import laser_tracking_kernels as kernels
from aquaquad_envs.tasks.laser_tracking_observation import OBSERVATION_NAMES
from aquaquad_envs.tasks.laser_tracking_params import Params
from aquaquad_envs.tasks.task import ActionSpec, Task

__all__ = ["TASK", "Params", "build", "metrics"]

#: s in the dark after which light that is found again may be anywhere.
_LOST_AFTER_S = 3.0
#: Share of the way to where light can be detected within which darkness rules a centre out.
_SWEEP = 0.9


def metrics(worlds: np.ndarray, params: Params) -> dict[str, np.ndarray]:
    """Metrics of the episodes so far, each (num_worlds,); meaningful once an episode is over.

    ``time_to_acquire_s`` is the episode's duration where the light was never found, ``time_in_lda_acquired`` and
    ``center_rmse_m`` are NaN there.
    """
    time_s, found = worlds["time_s"], worlds["acquired_s"] >= 0
    after = np.where(found, time_s - worlds["acquired_s"], 0.0)

    def share(total: np.ndarray, span: np.ndarray) -> np.ndarray:
        return np.divide(total, span, out=np.full(len(worlds), np.nan), where=span > 1e-9)

    # Of the time in the light all but the decision that ended there first comes after it.
    kept = worlds["lda_s"] - np.where(worlds["acquired_s"] > 0, params.action_period_s, 0.0)
    return {
        "time_in_lda": share(worlds["lda_s"], time_s),
        "time_in_lda_acquired": share(np.maximum(kept, 0.0), after),
        "acquired": found.astype(np.float64),
        "time_to_acquire_s": np.where(found, worlds["acquired_s"], time_s),
        "center_rmse_m": np.sqrt(share(worlds["error2_sum"], after)),
        "light_received": share(worlds["light_sum"], time_s),
        "duration_s": time_s.copy(),
    }


def build(params: Params) -> tuple[data.Ocean, data.Constants, tuple[str, ...]]:
    """Scalars for the kernels; these worlds read no fields and leave nothing to note."""
    beam = params.beam()
    height = float(params.altitude_m + params.depth_m)
    peak = float(peak_intensity(beam, height))
    full_scale = params.full_scale_w_m2
    if full_scale is None:
        full_scale = 1.5 * (peak + beam.ambient)
    level = float(params.noise_level)
    noise_std = level * float(params.noise_std_w_m2)
    levels = 2 ** int(params.adc_bits)
    # Two deviations of the noise, a step of the converter, and half a deviation of ambient light that is not followed.
    margin = 2.0 * noise_std + 0.5 * float(params.ambient_variation) * beam.ambient
    margin += full_scale / (levels - 1) if levels > 1 else 0.0
    constants = data.Constants(
        axes=int(params.axes), horizon=float(params.horizon_s), action_period=float(params.action_period_s),
        sub_steps=int(params.sub_steps), max_speed=float(params.max_speed_m_s), altitude=float(params.altitude_m),
        start_altitude=float(params.start_altitude_m), depth=float(params.depth_m),
        start_distance=float(params.start_distance_m), guess_std=float(params.guess_std_m),
        motion=data.SCENARIOS[params.scenario], rov_speed=float(params.rov_speed_m_s),
        turn_period=float(params.turn_period_s), wander_time=float(params.wander_time_s), beam=beam, peak=peak,
        radius=float(detectable_radius(beam, height)), detection=float(params.detection_share) * peak,
        noise_std=noise_std, levels=levels, margin=max(margin, 1e-3 * peak), lost_after=_LOST_AFTER_S,
        sweep=_SWEEP * float(radius_of_intensity(beam, params.detection_share * peak, height)),
        full_scale=float(full_scale), ambient_variation=float(params.ambient_variation),
        ambient_time=float(params.ambient_time_s), position_std=level * float(params.position_std_m),
        velocity_std=level * float(params.velocity_std_m_s),
        rov_velocity_known=params.rov_velocity == "measured",
        rov_velocity_std=level * float(params.rov_velocity_std_m_s), fix_std=level * float(params.fix_std_m),
        fix_period=float(params.fix_period_s), quadrotor=Quadrotor(), vehicle=Rov(),
        light_weight=float(params.light_weight), area_weight=float(params.area_weight),
        center_weight=float(params.center_weight),
        effort_weight=float(params.effort_weight),
    )  # fmt: skip
    return data.Ocean(nothing=np.zeros(1)), constants, ()


TASK = Task(
    name="laser-tracking",
    params=Params,
    world=data.WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=data.REWARD_TERMS,
    outcomes=data.OUTCOMES,
    build=build,
    action_spec=lambda params: ActionSpec(size=params.axes),
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
)

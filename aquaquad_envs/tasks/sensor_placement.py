"""Sensor placement: a team drifts, hops, listens, shares one tracker, and places itself to track submerged targets.

A PettingZoo parallel environment. See ``docs/sensor_placement.md`` for the tables of observation, action and reward.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.estimation.hdop import even_spread_hdop
from aquaquad_envs.estimation.kalman import METHODS
from aquaquad_envs.estimation.kalman_motion import make_motion, states_of
from aquaquad_envs.estimation.kalman_ukf import make_sigma_points
from aquaquad_envs.sensing.emissions import Emissions
from aquaquad_envs.sensing.measurements import KINDS
from aquaquad_envs.sensing.sonar import PassiveSonar
from aquaquad_envs.tasks import sensor_placement_data as data
from aquaquad_envs.tasks import sensor_placement_kernels as kernels
from aquaquad_envs.tasks.discrete_hops import hop_actions
from aquaquad_envs.tasks.ocean import Ocean, build_ocean
from aquaquad_envs.tasks.sensor_placement_observation import OBSERVATION_NAMES, STATE_NAMES
from aquaquad_envs.tasks.sensor_placement_params import SCENARIOS, Params
from aquaquad_envs.tasks.sensor_placement_targets import equivalent_density
from aquaquad_envs.tasks.task import Task

__all__ = ["SCENARIOS", "TASK", "Params", "build", "metrics"]

#: s; a target's acceleration lasts about so long, where the tracker's model has one.
ACCELERATION_TIME_S = 300.0
#: Vehicles evenly about a target at half the half width: the fix whose error scales errors and HDOP.
SCALE_VEHICLES = 4


def metrics(worlds: np.ndarray, params: Params) -> dict[str, np.ndarray]:
    """Metrics of the episodes so far, each (num_worlds,); meaningful once an episode is over.

    Those of tracking are NaN without targets, ``coverage`` without a fence, and all averages before the first decision.
    """
    cycles = worlds["cycles"]
    time_s = worlds["time_s"]

    def mean(total: np.ndarray, count: np.ndarray) -> np.ndarray:
        return np.divide(total, count, out=np.full(len(worlds), np.nan), where=count > 0)

    tracked, fenced = params.num_targets > 0, params.scenario == "fence"
    nothing = np.full(len(worlds), np.nan)
    return {
        "tracking_rmse_m": np.sqrt(mean(worlds["error2_sum"], cycles)),
        "bound_rmse_m": np.sqrt(mean(worlds["bound2_sum"], cycles)),
        "mean_hdop": mean(worlds["hdop_s"], time_s) if tracked else nothing,
        "nees": mean(worlds["nees_sum"], cycles),
        "times_lost": worlds["times_lost"].sum(-1).astype(np.float64) if tracked else nothing,
        "flight_energy_wh": worlds["flight_wh"].sum(-1),
        "alive": mean(worlds["alive_s"], params.num_vehicles * time_s),
        "coverage": mean(worlds["coverage_s"], time_s) if fenced else nothing,
        "duration_s": time_s.copy(),
    }


#: Share of the way flown in a step of the tracker that a short hop is: the vehicle listens again at its end.
_SHORT_HOP = 0.96


def _constants(params: Params, clock_offset: float) -> data.Constants:
    still, steered = params.scenario in ("calm", "grid"), params.scenario == "grid"
    density = equivalent_density(
        params.target_motion, params.target_speed_m_s, params.target_noise_m2_s3, params.manoeuvre_interval_s,
        params.stop_time_s,
    )  # fmt: skip
    process_noise = params.process_noise
    if process_noise is None:
        jerk = params.track_model == "constant-acceleration"
        process_noise = density / ACCELERATION_TIME_S**2 if jerk else density
    motion = make_motion(params.track_model, density=process_noise)
    scale = params.measurement_std * even_spread_hdop(
        params.measurement, SCALE_VEHICLES, range_m=0.5 * params.half_width_m,
        sound_speed_m_s=params.sound_speed_m_s,
    )  # fmt: skip
    step_s = params.action_period_s / params.sub_steps
    longest = params.vehicle_speed_m_s * params.action_period_s if steered else params.max_hop_m
    short = longest if steered else min(longest, _SHORT_HOP * params.airspeed_m_s * step_s)
    emissions = Emissions(
        kind=params.emissions, period_s=params.emission_period_s, jitter=params.emission_jitter,
        mean_on_s=params.emission_on_s, mean_off_s=params.emission_off_s,
    )  # fmt: skip
    sonar = PassiveSonar(level=params.detection_level, source_level_db=params.source_level_db)
    return data.Constants(
        **params.vehicle_constants(), clock_offset=clock_offset, num_vehicles=int(params.num_vehicles),
        num_targets=int(params.num_targets), horizon=float(params.horizon_s),
        action_period=float(params.action_period_s), sub_steps=int(params.sub_steps), still_water=still,
        steered=steered, vehicle_speed=float(params.vehicle_speed_m_s),
        longest_step=float(longest), short_hop=float(short),
        cluster_radius=float(params.cluster_radius_m) if params.start_layout == "cluster" else 0.0,
        target_motion=data.TARGET_MOTIONS[params.target_motion],
        target_speed=float(params.target_speed_m_s), target_density=float(params.target_noise_m2_s3),
        manoeuvre_interval=float(params.manoeuvre_interval_s), stop_time=float(params.stop_time_s),
        land=params.scenario == "file", truth_motion=make_motion("constant-velocity", density=density),
        kind=KINDS[params.measurement], std=float(params.measurement_std), noise_level=float(params.noise_level),
        noise_reference=float(params.noise_reference_m), sound_speed=float(params.sound_speed_m_s),
        all_pairs=params.tdoa_pairs == "all", sonar=sonar.terms(), emissions=emissions.terms(),
        travel_level=float(params.travel_time_level), sharing_delay=float(params.sharing_delay_s),
        dropout=float(params.dropout), dropout_burst=float(params.dropout_burst_s),
        method=METHODS[params.tracker], states=states_of(motion), motion=motion,
        points=make_sigma_points(states_of(motion)), initial_position_std=float(params.initial_position_std_m),
        initial_velocity_std=float(params.initial_velocity_std_m_s),
        initial_acceleration_std=float(np.sqrt(density / ACCELERATION_TIME_S)) + 1e-9,
        lost_nis=float(params.lost_nis), lost_std=float(params.lost_std_m),
        hdop_cap=2.0 * float(params.half_width_m), fix_scale=float(scale), fence=params.scenario == "fence",
        fence_length=float(params.fence_length_m), fence_speed=float(params.fence_speed_m_s),
        fence_cover=float(params.fence_cover_m), tracking_weight=float(params.tracking_weight),
        bound_weight=float(params.bound_weight), hdop_weight=float(params.hdop_weight),
        coverage_weight=float(params.coverage_weight), energy_weight=float(params.energy_weight),
        failure_penalty=float(params.failure_penalty),
        acquisition_weight=float(params.acquisition_weight),
    )  # fmt: skip


def build(params: Params) -> tuple[Ocean, data.Constants, tuple[str, ...]]:
    """Immutable data and scalars for the kernels, and notes on what was assumed in reading a file."""
    ocean, clock_offset, notes = build_ocean(params, still=params.scenario in ("calm", "grid"))
    return ocean, _constants(params, clock_offset), notes


TASK = Task(
    name="sensor-placement",
    params=Params,
    world=data.WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=data.REWARD_TERMS,
    outcomes=data.OUTCOMES,
    build=build,
    action_spec=hop_actions,
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
    num_agents=lambda params: params.num_vehicles,
    state=kernels.state_batch,
    state_names=lambda params: STATE_NAMES,
)

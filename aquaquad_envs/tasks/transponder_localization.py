"""Transponder localization: choose where to measure ranges so that transponders on the sea floor are found fastest.

Each decision moves the vehicle to the place of its next measurement; after each the world estimates every transponder.
See ``docs/transponder_localization.md`` for the tables of observation, action and reward.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquaquad_envs.estimation.map_estimator_kernels import MapSettings
from aquaquad_envs.tasks import transponder_localization_data as data
from aquaquad_envs.tasks import transponder_localization_kernels as kernels
from aquaquad_envs.tasks.discrete_hops import discrete_hops
from aquaquad_envs.tasks.ocean import Ocean, build_ocean
from aquaquad_envs.tasks.task import ActionSpec, Task
from aquaquad_envs.tasks.transponder_localization_observation import FAN, OBSERVATION_NAMES
from aquaquad_envs.tasks.transponder_localization_params import SCENARIOS, Params
from aquaquad_envs.tasks.transponder_localization_truth import true_log_det

__all__ = ["SCENARIOS", "TASK", "Params", "build", "metrics"]

#: Step at which an estimate has converged, as a share of the standard deviation of a range, and most steps.
_TOLERANCE = 1e-3
_MOST_ITERATIONS = 1000


def metrics(worlds: np.ndarray, params: Params) -> dict[str, np.ndarray]:
    """Metrics of the episodes so far, each (num_worlds,): of the estimates after the latest measurement."""
    counted = np.arange(data.MAX_TRANSPONDERS) < worlds["num_transponders"][:, None]
    number = np.maximum(counted.sum(1), 1)
    error = worlds["estimate"] - worlds["target"]
    square = np.where(counted, (error**2).sum(-1), 0.0).sum(1) / number
    xx, xy, xz, yy, yz, zz = np.moveaxis(worlds["information"], -1, 0)
    x, y, z = np.moveaxis(error, -1, 0)
    at_truth = np.zeros(len(worlds))
    true_log_det(worlds, _prior_information(params), 1.0 / params.range_std_m**2, at_truth)
    normalised = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    return {
        "rmse_m": np.sqrt(square),
        "log_det": worlds["log_det"].copy(),
        "log_det_true": at_truth,
        "nees": np.where(counted, normalised, 0.0).sum(1) / number,
        "diverged": (worlds["diverged"] > 0).astype(np.float64),
        "flight_energy_wh": worlds["flight_wh"].copy(),
        "duration_s": worlds["time_s"].copy(),
    }


def _prior_information(params: Params) -> np.ndarray:
    east, north, down = params.prior_std_m
    return _frozen([1.0 / east**2, 0.0, 0.0, 1.0 / north**2, 0.0, 1.0 / down**2])


def _frozen(values: object) -> np.ndarray:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _constants(params: Params, clock_offset: float) -> data.Constants:
    places = _frozen(params.transponders).reshape(-1, 3)
    wanted, given = params.num_transponders, len(places)
    step = {
        "yaw-rate": params.speed_m_s * params.period_s,
        "greedy": params.max_step_m,
        "aquaquad": params.max_hop_m,
    }
    start = (np.nan, np.nan) if params.start is None else params.start
    heading = np.nan if params.start_heading_deg is None else np.radians(params.start_heading_deg)
    sigma = float(params.range_std_m)
    east, north, down = params.prior_std_m
    return data.Constants(
        **params.vehicle_constants(), clock_offset=clock_offset, still_water=params.still,
        vehicle=data.VEHICLES[params.vehicle], num_measurements=int(params.num_measurements),
        period=float(params.period_s), speed=float(params.speed_m_s),
        yaw_limit=float(np.radians(params.yaw_rate_limit_deg_s)), max_step=float(params.max_step_m),
        step_length=max(float(step[params.vehicle]), 1e-6), sub_steps=int(params.sub_steps), transponders=places,
        fewest=int(wanted or given or 1), most=int(wanted or given or data.MAX_TRANSPONDERS),
        depth_low=params.depth_m[0], depth_high=params.depth_m[1], spread=float(params.spread_m),
        about_start=params.scenario == "file", start_x=float(start[0]), start_y=float(start[1]),
        start_heading=float(heading), sigma=sigma, prior_std_x=east, prior_std_y=north,
        prior_std_z=down,
        prior_information=_prior_information(params),
        outlier_share=float(params.outlier_share), outlier_scale=float(params.outlier_scale_m),
        miss_share=float(params.miss_share), sound_speed_error=float(params.sound_speed_error),
        settings=MapSettings(
            sigma=sigma, tolerance=_TOLERANCE * sigma, max_iterations=_MOST_ITERATIONS,
            huber=float(params.robust_threshold), mirror=True,
        ),
        information_weight=float(params.information_weight), error_weight=float(params.error_weight),
        energy_weight=float(params.energy_weight), failure_penalty=float(params.failure_penalty),
    )  # fmt: skip


def build(params: Params) -> tuple[Ocean, data.Constants, tuple[str, ...]]:
    """Immutable data and scalars for the kernels, and notes on what was assumed in reading a file."""
    # Only the aquaquad lives on the sun, whose model is slow to load.
    lit = params if params.vehicle == "aquaquad" else replace(params, solar="constant")
    ocean, clock_offset, notes = build_ocean(lit, still=params.still and params.scenario != "file")
    if params.current_level != 1.0:
        ocean = ocean._replace(velocity=_frozen(params.current_level * ocean.velocity))
    return ocean, _constants(params, clock_offset), notes


def _action_spec(params: Params) -> ActionSpec:
    turns = params.vehicle == "yaw-rate"
    if params.action_type == "continuous":
        return ActionSpec(size=1 if turns else 2)
    table = np.linspace(-1.0, 1.0, FAN)[:, None] if turns else discrete_hops()
    return ActionSpec(size=table.shape[1], table=table)


TASK = Task(
    name="transponder-localization",
    params=Params,
    world=data.WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=data.REWARD_TERMS,
    outcomes=data.OUTCOMES,
    build=build,
    action_spec=_action_spec,
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
)

"""Plume tracing: a team of robots samples a scalar field in three dimensions and closes in on its source.

A PettingZoo parallel environment. See ``docs/plume_tracing.md`` for the tables of observation, action and reward.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.sensing.plume import KINDS, PLUME, SourceTerms
from aquaquad_envs.sensing.plume_puffs import PuffTerms
from aquaquad_envs.tasks import plume_tracing_data as data
from aquaquad_envs.tasks import plume_tracing_kernels as kernels
from aquaquad_envs.tasks.plume_tracing_currents import build_ocean
from aquaquad_envs.tasks.plume_tracing_observation import OBSERVATION_NAMES, STATE_NAMES
from aquaquad_envs.tasks.plume_tracing_params import SCENARIOS, Params
from aquaquad_envs.tasks.task import ActionSpec, Task

__all__ = ["SCENARIOS", "TASK", "Params", "build", "metrics"]

#: m; communication without a bound.
_EVERYWHERE = 1e9
#: Standard deviations of a new puff whose concentration at its centre has level 0, in a plume.
_PLUME_SCALE_WIDTHS = 3.0


def metrics(worlds: np.ndarray, params: Params) -> dict[str, np.ndarray]:
    """Metrics of the episodes so far, each (num_worlds,); meaningful once an episode is over.

    ``center_of_mass_m`` is the mean of the robots' distances, as the published script has it under that name.
    ``updates_to_source`` counts all updates of the horizon where the source was not reached.
    """
    distance = worlds["distance"][:, : params.num_robots]
    reached = worlds["reached_at"] >= 0
    return {
        "success": reached.astype(np.float64),
        "closest_m": distance.min(-1),
        "center_of_mass_m": distance.mean(-1),
        "furthest_m": distance.max(-1),
        "updates_to_source": np.where(reached, worlds["reached_at"], params.horizon_updates).astype(
            np.float64
        ),
        "last_moved": worlds["last_moved"].astype(np.float64),
        "updates": worlds["updates"].astype(np.float64),
    }


def level_scale(params: Params) -> float:
    """The reading whose observed level is 0: that at ``start_radius_m``, or of a puff thrice its first width."""
    assert params.start_radius_m is not None
    kind = KINDS[str(params.field)]
    if kind == PLUME:
        amount = params.source_strength * params.release_period_s
        return amount / ((2.0 * np.pi) ** 1.5 * (_PLUME_SCALE_WIDTHS * params.puff_size_m) ** 3)
    away = max(params.start_radius_m, 1.0)
    return params.source_strength / (
        away**2 + (params.rational_offset_m2 if params.field == "rational" else 0.0)
    )


def _constants(params: Params) -> data.Constants:
    assert params.layout is not None and params.field is not None and params.half_width_m is not None
    assert params.water_depth_m is not None and params.horizon_updates is not None
    assert params.start_radius_m is not None and params.start_radius_spread is not None
    assert params.start_height_m is not None and params.start_height_spread is not None
    assert params.source_depth_m is not None and params.detection_floor is not None
    assert params.puff_growth_m2_s is not None and params.dispersion_m2_s is not None
    assert params.meander_std_m_s is not None and params.plume_age_s is not None
    assert params.memory_age_s is not None
    puffs = PuffTerms(
        size=int(params.num_puffs), period=float(params.release_period_s),
        amount=float(params.source_strength * params.release_period_s), first_spread2=float(params.puff_size_m) ** 2,
        growth=float(params.puff_growth_m2_s), scatter=float(params.dispersion_m2_s),
        vertical_scatter=float(params.dispersion_m2_s * params.vertical_dispersion_share),
        meander_std=float(params.meander_std_m_s), meander_time=float(params.meander_time_s),
        depth=float(params.water_depth_m),
    )  # fmt: skip
    return data.Constants(
        num_robots=int(params.num_robots), half_width=float(params.half_width_m), depth=float(params.water_depth_m),
        surface_bound=bool(params.surface_bound), sequential=params.updates == "sequential",
        horizon_updates=int(params.horizon_updates), update_period=float(params.update_period_s),
        step_limit=float(params.step_limit_m), spacing=float(params.spacing_m),
        reach_radius=float(params.reach_radius_m), reach_time=float(params.reach_time_s),
        stop_at_source=bool(params.stop_at_source), layout=data.LAYOUTS[params.layout],
        start_radius=float(params.start_radius_m), start_radius_spread=float(params.start_radius_spread),
        start_height=float(params.start_height_m), start_height_spread=float(params.start_height_spread),
        cluster_radius=float(params.cluster_radius_m), source_depth=float(params.source_depth_m),
        source_spread=float(params.source_spread_m),
        source=SourceTerms(KINDS[params.field], float(params.source_strength), float(params.rational_offset_m2)),
        puffs=puffs, still_water=params.current == "still", euler=params.integrator == "euler",
        plume_age=float(params.plume_age_s), start_time_spread=float(params.start_time_spread_s),
        sensor_noise=float(params.sensor_noise), detection_floor=float(params.detection_floor),
        level_scale=float(level_scale(params)), position_error=float(params.position_error_m),
        random_walk=params.position_error_kind == "random-walk",
        heading_error=float(np.deg2rad(params.heading_error_deg)),
        constant_heading=params.heading_error_kind == "constant", current_noise=float(params.current_noise_m_s),
        comm_radius=_EVERYWHERE if params.comm_radius_m is None else float(params.comm_radius_m),
        comm_loss=float(params.comm_loss), shared=params.comm_radius_m is None and params.comm_loss == 0.0,
        memory_rows=int(params.memory_rows), memory_age=float(params.memory_age_s),
        memory_spacing=float(params.memory_spacing_m), closest_weight=float(params.closest_weight),
        mean_weight=float(params.mean_weight), own_weight=float(params.own_weight),
        reached_bonus=float(params.reached_bonus), blocked_weight=float(params.blocked_weight),
        time_weight=float(params.time_weight),
    )  # fmt: skip


def build(params: Params) -> tuple[data.Ocean, data.Constants, tuple[str, ...]]:
    """Immutable data and scalars for the kernels; nothing is assumed that notes would have to tell."""
    return build_ocean(params), _constants(params), ()


TASK = Task(
    name="plume-tracing",
    params=Params,
    world=data.WORLD,
    observation_names=OBSERVATION_NAMES,
    reward_terms=data.REWARD_TERMS,
    outcomes=data.OUTCOMES,
    build=build,
    action_spec=lambda params: ActionSpec(size=3),
    reset=kernels.reset_batch,
    step=kernels.step_batch,
    metrics=metrics,
    num_agents=lambda params: params.num_robots,
    agent_name="robot",
    state=kernels.state_batch,
    state_names=lambda params: STATE_NAMES,
)

"""The currents that plumes are carried by: a stream with eddies, or those of the other tasks without obstacles."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from aquaquad_envs.physics import current_formulas
from aquaquad_envs.physics.currents import CurrentAxes
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.tasks.plume_tracing_data import Ocean
from aquaquad_envs.tasks.plume_tracing_params import Params
from aquaquad_envs.tasks.scenarios import ScenarioSpec, build_bank

#: s; eddies of a stream change within about so long, and their field has a frame in every quarter of it.
TURNOVER_S = 600.0


def build_ocean(params: Params) -> Ocean:
    """The currents of ``params``: one field in still water, else ``num_fields``."""
    assert params.half_width_m is not None and params.horizon_updates is not None
    assert params.plume_age_s is not None
    duration = (
        params.plume_age_s + params.start_time_spread_s + params.horizon_updates * params.update_period_s
    )
    if params.current == "still":
        return _still(params.half_width_m)
    if params.current == "stream":
        return _stream(
            params.half_width_m, params.current_speed_m_s, params.current_variation, int(params.num_fields),
            int(params.field_seed), duration,
        )  # fmt: skip
    spec = ScenarioSpec(
        scenario=str(params.current), half_width_m=params.half_width_m, obstacles=(), obstacle_margin_m=0.0,
        interpolation="bilinear", num_fields=int(params.num_fields), field_seed=int(params.field_seed),
        forecast_error=0.0, duration_s=duration, currents_file=None, currents_center=None, currents_start=None,
    )  # fmt: skip
    bank = build_bank(spec)
    return _ocean(bank.velocity, bank.axes, params.half_width_m)


def _ocean(velocity: np.ndarray, axes: CurrentAxes, half_width: float) -> Ocean:
    velocity.setflags(write=False)
    clearance = np.full((1, 2, 2), 10.0 * half_width)
    clearance.setflags(write=False)
    return Ocean(velocity, axes, clearance, Grid(-half_width, -half_width, 2.0 * half_width))


@lru_cache(maxsize=4)
def _still(half_width: float) -> Ocean:
    field = current_formulas.uniform(0.0, 0.0, half_width_m=half_width)
    return _ocean(field.velocity[None], field.axes, half_width)


@lru_cache(maxsize=4)
def _stream(
    half_width: float, speed: float, variation: float, count: int, seed: int, duration: float
) -> Ocean:
    """A uniform flow in any direction, 0.5 to 1.5 times ``speed``, plus divergence-free eddies that change in time."""
    fields = []
    for k in range(count):
        # One generator a field: a larger bank begins with the fields of a smaller one.
        rng = np.random.default_rng(np.random.SeedSequence([seed, k]))
        mean, course = speed * rng.uniform(0.5, 1.5), rng.uniform(0.0, 2.0 * np.pi)
        eddies = current_formulas.random_gyres(
            rng, half_width_m=half_width, speed_m_s=variation * mean, mean_flow_m_s=0.0,
            eddy_scale_m=half_width * rng.uniform(0.4, 0.8), turnover_s=TURNOVER_S, duration_s=duration,
            time_step_s=TURNOVER_S / 4.0, spacing_m=half_width / 10.0,
        )  # fmt: skip
        fields.append((eddies, mean * np.array([np.cos(course), np.sin(course)])))
    velocity = np.stack([eddies.velocity + flow for eddies, flow in fields])
    return _ocean(velocity, fields[0][0].axes, half_width)

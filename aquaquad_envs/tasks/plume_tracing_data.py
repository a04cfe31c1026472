"""What the kernels of plume tracing read and write: the record of a world, immutable data, scratch memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.physics.currents import CurrentAxes
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.randomness import WORDS
from aquaquad_envs.sensing.plume import SourceTerms
from aquaquad_envs.sensing.plume_puffs import MAX_PUFFS, PuffTerms

MAX_ROBOTS = 30
#: Readings that a robot remembers: the best ones, as published.
MEMORY = 20
#: Columns of a remembered reading: believed place (m), value, time (s), squashed value in (-1, 1).
PLACE_X, PLACE_Y, PLACE_Z, VALUE, TIME, LEVEL = range(6)
#: Time of what has never been, s.
NEVER = -1e9

OUTCOMES = ("running", "reached", "time out")
RUNNING, REACHED, TIME_OUT = range(3)

REWARD_TERMS = ("closest", "mean", "own", "reached", "blocked", "time")

#: Codes of where teams begin, by the name that users write.
LAYOUTS = {"surround": 0, "corner": 1, "downstream": 2, "scattered": 3}
SURROUND, CORNER, DOWNSTREAM, SCATTERED = range(4)

_ROBOTS = (MAX_ROBOTS,)

#: One record is one world, with room for the most robots and puffs. Positions in m (z down), times in s. Aligned, which
#: makes access fast, and without gaps, whose bytes a copy would not keep.
WORLD = np.dtype(
    [
        # Robots: where they are, where they believe to be, what they read there.
        *((name, np.float64, _ROBOTS) for name in ("x", "y", "z", "start_x", "start_y", "start_z")),
        *((name, np.float64, _ROBOTS) for name in ("seen_x", "seen_y", "seen_z")),
        ("reading", np.float64, _ROBOTS),  # 0 below the detection floor
        ("level", np.float64, _ROBOTS),  # the reading, squashed into (-1, 1); -1: nothing
        ("level_before", np.float64, _ROBOTS),
        ("mean_level", np.float64, _ROBOTS), ("detection_rate", np.float64, _ROBOTS),  # running means
        ("flow_u", np.float64, _ROBOTS), ("flow_v", np.float64, _ROBOTS),  # measured current, m/s
        ("course_error", np.float64, _ROBOTS),  # rad
        ("moved_x", np.float64, _ROBOTS), ("moved_y", np.float64, _ROBOTS), ("moved_z", np.float64, _ROBOTS),
        ("blocked", np.int64, _ROBOTS),  # 1: the last move was shortened
        ("distance", np.float64, _ROBOTS),  # true, to the source
        ("agent_outcome", np.int64, _ROBOTS),
        # Last detection: a robot's own, and the latest that it has heard of. Columns as in memory.
        ("own_whiff", np.float64, (MAX_ROBOTS, 6)), ("heard_whiff", np.float64, (MAX_ROBOTS, 6)),
        # 1 where robot i (row) heard robot j in the last exchange, itself included. Rows are filled up to whole words.
        ("heard", np.uint8, (MAX_ROBOTS, 8 * -(-MAX_ROBOTS // 8))),
        # The best readings heard, best first: rows [:memory_count[t]] of table t = memory_of[i].
        ("memory", np.float64, (MAX_ROBOTS, MEMORY, 6)), ("memory_count", np.int64, _ROBOTS),
        ("memory_of", np.int64, _ROBOTS),
        # Source and plume.
        ("source_x", np.float64), ("source_y", np.float64), ("source_z", np.float64),
        *((f"puff_{name}", np.float64, (MAX_PUFFS,)) for name in ("x", "y", "z", "birth")),
        ("released", np.int64), ("meander_u", np.float64), ("meander_v", np.float64),
        # Clocks and what is over.
        ("num_robots", np.int64), ("turn", np.int64),  # whose move is next; -1: everyone's
        ("updates", np.int64), ("steps", np.int64), ("time_s", np.float64), ("clock_s", np.float64),
        ("near_s", np.float64), ("reached_at", np.int64),  # update; -1: not yet
        ("last_moved", np.int64),  # update in which any robot last moved by more than 1 mm
        ("truth", np.int64), ("forecast", np.int64), ("obstacle", np.int64), ("outcome", np.int64),
        ("rng_initial", np.uint64, (WORDS,)), ("rng_field", np.uint64, (WORDS,)),
        ("rng_sensor", np.uint64, (WORDS,)), ("rng_target", np.uint64, (WORDS,)),
    ],
    align=True,
)  # fmt: skip

#: Scratch memory of one call, used by one world after another. A record, so that it travels as one pointer.
SCRATCH = np.dtype(
    [
        ("inverse", np.float64, (MAX_PUFFS,)), ("peak", np.float64, (MAX_PUFFS,)), ("work", np.float64, (MAX_PUFFS,)),
        ("near", np.float64, (4, MAX_PUFFS + 1)),
        ("key", np.float64, _ROBOTS), ("order", np.int64, _ROBOTS), ("before", np.float64, _ROBOTS),
        ("blocked", np.int64),
    ],
    align=True,
)  # fmt: skip


class Ocean(NamedTuple):
    """Everything immutable that kernels and policies read: the currents."""

    velocity: np.ndarray  # (F, T, rows, columns, 2) m/s
    axes: CurrentAxes
    clearance: np.ndarray  # (1, 2, 2) m: open water, for what is shared with other tasks
    clearance_grid: Grid


class Constants(NamedTuple):
    """Scalars of the parameters as kernels read them (units as in ``plume_tracing.Params``, angles in rad)."""

    num_robots: int
    half_width: float
    depth: float
    surface_bound: bool
    sequential: bool
    horizon_updates: int
    update_period: float
    step_limit: float
    spacing: float
    reach_radius: float
    reach_time: float
    stop_at_source: bool
    # Start.
    layout: int
    start_radius: float
    start_radius_spread: float
    start_height: float
    start_height_spread: float
    cluster_radius: float
    source_depth: float  # m; below 0: anywhere between 20 and 80 % of the depth
    source_spread: float
    # Field.
    source: SourceTerms
    puffs: PuffTerms
    still_water: bool
    euler: bool
    plume_age: float
    start_time_spread: float
    # Sensors.
    sensor_noise: float
    detection_floor: float
    level_scale: float  # the reading whose level is 0
    position_error: float
    random_walk: bool
    heading_error: float  # rad
    constant_heading: bool
    current_noise: float
    # Sharing.
    comm_radius: float
    comm_loss: float
    shared: bool  # everyone hears everyone: one memory serves all
    memory_rows: int
    memory_age: float
    memory_spacing: float
    # Reward.
    closest_weight: float
    mean_weight: float
    own_weight: float
    reached_bonus: float
    blocked_weight: float
    time_weight: float

"""What the kernels of laser tracking read and write: the record of a world and the scalars of its parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.physics.quadrotor import Quadrotor
from aquaquad_envs.physics.randomness import WORDS
from aquaquad_envs.physics.rov import Rov
from aquaquad_envs.sensing.laser import Beam

OUTCOMES = ("running", "time out")
RUNNING, TIME_OUT = range(2)

REWARD_TERMS = ("light", "area", "center", "effort")

STILL, MOVING, TURNING, WANDERING, MIXED = range(5)
#: Code of each motion of the submerged vehicle by the name that users write.
SCENARIOS = {"still": STILL, "moving": MOVING, "turning": TURNING, "wandering": WANDERING, "mixed": MIXED}

#: A planar vehicle in the record: its six states, then integrals of the controllers that are in use.
X, Z, PITCH, U, W, RATE, INT_Z, INT_VX, INT_VZ, INT_PITCH = range(10)
PLANAR = 10
PLANES = 2
#: Decisions whose reading and place are kept.
HISTORY = 64
#: Sectors of the ground about the centre of a search, from east anticlockwise.
SECTORS = 16

#: One record is one world. Positions in m from the quadrotor's start, x east, y north; velocities in m/s, times in s.
WORLD = np.dtype(
    [
        # The truth. Of x and y each has a planar model, that of x first; the centre of the light is over the ROV.
        ("x", np.float64), ("y", np.float64), ("u", np.float64), ("v", np.float64), ("altitude", np.float64),
        ("rov_x", np.float64), ("rov_y", np.float64), ("rov_u", np.float64), ("rov_v", np.float64),
        ("depth", np.float64),
        ("uav", np.float64, (PLANES, PLANAR)), ("rov", np.float64, (PLANES, PLANAR)),
        ("motion", np.int64), ("wanted_u", np.float64), ("wanted_v", np.float64), ("turn_rate", np.float64),
        ("ambient", np.float64), ("ambient_state", np.float64),
        ("range_m", np.float64), ("light", np.float64), ("in_lda", np.int64),
        # What policies may know: reading (W/m², ambient light included), own position and velocity, the ROV's
        # velocity and how far that has carried it since the start, the first guess of the centre, an acoustic fix.
        ("reading", np.float64), ("own_x", np.float64), ("own_y", np.float64), ("own_u", np.float64),
        ("own_v", np.float64), ("seen_u", np.float64), ("seen_v", np.float64), ("carried_x", np.float64),
        ("carried_y", np.float64), ("guess_x", np.float64), ("guess_y", np.float64), ("fix_x", np.float64),
        ("fix_y", np.float64), ("fix_s", np.float64), ("command_u", np.float64), ("command_v", np.float64),
        # What is remembered of readings, in the frame that moves with the ROV as far as its velocity is known.
        # Of a reading: signal as a share of the peak, place, least and greatest distance to the centre that it tells.
        ("history", np.float64, (HISTORY, 5)), ("detected", np.int64),
        ("light_s", np.float64), ("light_x", np.float64), ("light_y", np.float64),
        ("ambient_seen", np.float64),  # believed ambient light
        ("center_x", np.float64), ("center_y", np.float64),  # believed of the light
        # Where the light is looked for, and how far from there the ground is known to be dark, sector by sector.
        ("search_x", np.float64), ("search_y", np.float64), ("swept", np.float64, (SECTORS,)),
        ("edge_s", np.float64), ("edge_x", np.float64), ("edge_y", np.float64), ("edge_kind", np.int64),
        ("rim_x", np.float64), ("rim_y", np.float64), ("rim_count", np.float64),
        # Sums over the episode, for metrics.
        ("acquired_s", np.float64), ("lda_s", np.float64), ("light_sum", np.float64), ("error2_sum", np.float64),
        ("time_s", np.float64), ("steps", np.int64), ("outcome", np.int64),
        ("rng_initial", np.uint64, (WORDS,)), ("rng_field", np.uint64, (WORDS,)),
        ("rng_sensor", np.uint64, (WORDS,)), ("rng_target", np.uint64, (WORDS,)),
    ]
)  # fmt: skip


class Ocean(NamedTuple):
    """Nothing: these worlds read no fields."""

    nothing: np.ndarray


class Constants(NamedTuple):
    """Scalars of the parameters as kernels read them (units as in ``laser_tracking.Params``)."""

    axes: int
    horizon: float
    action_period: float
    sub_steps: int
    max_speed: float
    altitude: float
    start_altitude: float
    depth: float
    start_distance: float
    guess_std: float
    # The submerged vehicle.
    motion: int
    rov_speed: float
    turn_period: float
    wander_time: float
    # Light and its reading.
    beam: Beam
    peak: float  # W/m², on the axis at the nominal height
    radius: float  # m, of the detectable area there
    margin: float  # W/m² by which a reading less the believed ambient light may be wrong
    sweep: float  # m; no centre is within this of a place that is dark
    lost_after: float  # s in the dark after which light is found anew
    detection: float  # W/m² above the nominal ambient light that count as light
    noise_std: float
    levels: int
    full_scale: float
    ambient_variation: float
    ambient_time: float
    # Other sensors.
    position_std: float
    velocity_std: float
    rov_velocity_known: bool
    rov_velocity_std: float
    fix_std: float
    fix_period: float
    # Vehicles.
    quadrotor: Quadrotor
    vehicle: Rov
    # Reward.
    light_weight: float
    area_weight: float
    center_weight: float
    effort_weight: float

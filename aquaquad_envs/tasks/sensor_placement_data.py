"""What the kernels of sensor placement read and write: the record of a world, immutable data, scratch memory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.estimation.kalman_motion import Motion
from aquaquad_envs.estimation.kalman_ukf import SigmaPoints
from aquaquad_envs.estimation.kalman_update import work_shape
from aquaquad_envs.sensing.emissions import EmissionTerms
from aquaquad_envs.sensing.sonar import SonarTerms
from aquaquad_envs.tasks.ocean import EPISODE_FIELDS

MAX_VEHICLES = 8
MAX_TARGETS = 5
#: Most measurements of one target at one moment: all pairs of eight vehicles.
MAX_ROWS = MAX_VEHICLES * (MAX_VEHICLES - 1) // 2
#: Measurements that may be under way to the tracker at once.
PENDING = 160

OUTCOMES = ("running", "collision", "left box", "battery empty", "time out", "team lost")
RUNNING, COLLISION, LEFT_BOX, BATTERY_EMPTY, TIME_OUT, TEAM_LOST = range(6)

REWARD_TERMS = ("tracking", "bound", "acquisition", "hdop", "coverage", "energy", "failure")

CONSTANT_VELOCITY, MANOEUVRING, STOP_AND_GO = range(3)
#: Code of each kind of target by the name that users write.
TARGET_MOTIONS = {
    "constant-velocity": CONSTANT_VELOCITY,
    "manoeuvring": MANOEUVRING,
    "stop-and-go": STOP_AND_GO,
}

#: States of the track that a record has room for, and those of the bound.
STATES, BOUND_STATES = 6, 4
#: Corners of the fence.
CORNERS = 4
#: Error of a rough fix in errors of a good one.
ROUGH_FIX = 20.0
#: Columns of a measurement under way: when the tracker gets it and when it was heard (s), target, sensor's
#: place, the other sensor's (TDOA), value, standard deviation.
DUE, HEARD, WHOSE, SENSOR_X, SENSOR_Y, OTHER_X, OTHER_Y, VALUE, SIGMA = range(9)

#: Directions of the hops whose HDOP is observed: from the nearest target's direction, anticlockwise.
HEADINGS_DEG = tuple(range(0, 360, 45))
#: Formations judged a vehicle: without it, and with it after a hop on each heading.
FORMATIONS = 1 + len(HEADINGS_DEG)

_VEHICLES, _TARGETS = (MAX_VEHICLES,), (MAX_TARGETS,)

#: One record is one world, with room for the most vehicles and targets. Energies in Wh, positions in m, times in s.
WORLD = np.dtype(
    [
        # Vehicles.
        ("x", np.float64, _VEHICLES), ("y", np.float64, _VEHICLES),
        ("start_x", np.float64, _VEHICLES), ("start_y", np.float64, _VEHICLES),
        ("battery_wh", np.float64, _VEHICLES), ("flight_wh", np.float64, _VEHICLES),
        ("solar_wh", np.float64, _VEHICLES), ("spent_wh", np.float64, _VEHICLES),
        ("clipped_wh", np.float64, _VEHICLES), ("drift_s", np.float64, _VEHICLES),
        ("flight_s", np.float64, _VEHICLES), ("hops", np.int64, _VEHICLES),
        ("on_water", np.float64, _VEHICLES),  # share of the last decision
        ("link_down", np.int64, _VEHICLES), ("agent_outcome", np.int64, _VEHICLES),
        # Targets, what is believed of them, and the bound.
        ("target_x", np.float64, _TARGETS), ("target_y", np.float64, _TARGETS),
        ("target_u", np.float64, _TARGETS), ("target_v", np.float64, _TARGETS),
        ("target_next", np.float64, _TARGETS),  # time of the next manoeuvre
        ("emission_nominal", np.float64, _TARGETS), ("emission_next", np.float64, _TARGETS),
        ("emission_on", np.int64, _TARGETS),
        ("estimate", np.float64, (MAX_TARGETS, STATES)),
        ("covariance", np.float64, (MAX_TARGETS, STATES, STATES)),
        ("bound", np.float64, (MAX_TARGETS, BOUND_STATES, BOUND_STATES)),
        ("measured_s", np.float64, _TARGETS),  # when the track was last updated
        ("innovation", np.float64, _TARGETS),  # running mean of NIS per measurement
        ("lost", np.int64, _TARGETS), ("times_lost", np.int64, _TARGETS),
        ("pending", np.float64, (PENDING, 9)), ("pending_count", np.int64), ("pending_lost", np.int64),
        # Fence.
        ("fence", np.float64, (CORNERS, 2)), ("fence_u", np.float64), ("fence_v", np.float64),
        # Sums over the episode, for metrics.
        ("error2_sum", np.float64), ("bound2_sum", np.float64), ("nees_sum", np.float64),
        ("cycles", np.int64), ("hdop_s", np.float64), ("coverage_s", np.float64), ("alive_s", np.float64),
        ("repairs", np.int64),
        ("num_vehicles", np.int64), ("num_targets", np.int64),
        ("time_s", np.float64), ("clock_s", np.float64), *EPISODE_FIELDS,
    ]
)  # fmt: skip

_WORK = work_shape(STATES, MAX_ROWS)
_LANES = 1 + MAX_VEHICLES * FORMATIONS

#: Scratch memory of one call, used by one world after another. A record, so that it travels as one pointer.
SCRATCH = np.dtype(
    [
        ("state4", np.float64, (MAX_TARGETS, 4)), ("covariance4", np.float64, (MAX_TARGETS, 4, 4)),
        ("state6", np.float64, (MAX_TARGETS, 6)), ("covariance6", np.float64, (MAX_TARGETS, 6, 6)),
        ("bound", np.float64, (MAX_TARGETS, BOUND_STATES, BOUND_STATES)), ("nowhere", np.float64, (BOUND_STATES,)),
        ("work", np.float64, _WORK), ("kinds", np.int64, (MAX_ROWS,)), ("sensors", np.float64, (MAX_ROWS, 2)),
        ("others", np.float64, (MAX_ROWS, 2)), ("values", np.float64, (MAX_ROWS,)),
        ("sigmas", np.float64, (MAX_ROWS,)), ("mask", np.uint8, (MAX_ROWS,)),
        ("first", np.int64, (MAX_ROWS,)), ("second", np.int64, (MAX_ROWS,)),  # vehicles of a row
        ("afloat", np.uint8, _VEHICLES), ("hears", np.uint8, _VEHICLES), ("shared_s", np.float64, _VEHICLES),
        ("flight_left_s", np.float64, _VEHICLES), ("flight_u", np.float64, _VEHICLES),
        ("flight_v", np.float64, _VEHICLES), ("order", np.int64, _VEHICLES), ("key", np.float64, _VEHICLES),
        *((f"lane_{name}", np.float64, (MAX_VEHICLES, _LANES)) for name in ("x", "y", "weight")),
        *((f"lane_{name}", np.float64, (_LANES,)) for name in ("a", "b", "d", "rx", "ry", "least", "one", "hdop")),
        *((f"lane_{name}", np.float64, (_LANES,)) for name in ("fa", "fb", "fd")), ("lane_first", np.int64, (_LANES,)),
        ("room", np.float64, (MAX_VEHICLES, FORMATIONS)), ("turn_hdop", np.float64, (MAX_VEHICLES, FORMATIONS)),
        ("turn", np.int64, _VEHICLES), ("turn_x", np.float64, _VEHICLES), ("turn_y", np.float64, _VEHICLES),
        ("turn_gain", np.float64, _VEHICLES), ("turn_far", np.uint8, _VEHICLES),
        ("error2", np.float64), ("bound2", np.float64),
        ("hdop", np.float64), ("squashed_hdop", np.float64), ("coverage", np.float64),
        ("flown_wh", np.float64), ("died", np.int64),
        ("silent", np.int64),  # vehicles afloat that do not hear
    ]
)  # fmt: skip


class Constants(NamedTuple):
    """Scalars of the parameters as kernels read them (units as in ``sensor_placement.Params``)."""

    num_vehicles: int
    num_targets: int
    half_width: float
    horizon: float
    action_period: float
    sub_steps: int
    euler: bool
    still_water: bool  # no current anywhere: nothing to integrate
    steered: bool  # actions are velocities, without flight, energy or current
    vehicle_speed: float
    max_hop: float
    airspeed: float
    drift_threshold: float
    flight_power: float
    base_power: float
    capacity: float
    initial_charge: float
    start_time_spread: float
    clock_offset: float  # s of local solar time at clock 0
    longest_step: float  # m, of a full action
    short_hop: float  # m, over before the tracker's next step
    cluster_radius: float  # 0: vehicles start anywhere
    current_noise: float
    # Targets.
    target_motion: int
    target_speed: float
    target_density: float  # white acceleration of a constant-velocity target, m²/s³
    manoeuvre_interval: float
    stop_time: float
    land: bool  # obstacles are land, which targets do not pass
    truth_motion: Motion  # of the target, in its first two moments: for the bound
    # Sensing.
    kind: int
    std: float
    noise_level: float
    noise_reference: float
    sound_speed: float
    all_pairs: bool
    sonar: SonarTerms
    emissions: EmissionTerms
    travel_level: float
    sharing_delay: float
    dropout: float
    dropout_burst: float
    # Tracking.
    method: int
    states: int
    motion: Motion
    points: SigmaPoints
    initial_position_std: float
    initial_velocity_std: float
    initial_acceleration_std: float
    lost_nis: float
    lost_std: float
    hdop_cap: float
    fix_scale: float
    # Fence.
    fence: bool
    fence_length: float
    fence_speed: float
    fence_cover: float
    # Reward.
    tracking_weight: float
    bound_weight: float
    hdop_weight: float
    coverage_weight: float
    energy_weight: float
    failure_penalty: float
    acquisition_weight: float

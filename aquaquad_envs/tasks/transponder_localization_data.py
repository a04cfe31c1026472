"""What the kernels of transponder localization read and write: the record of a world, and the scalars."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.estimation.map_estimator_kernels import MapSettings
from aquaquad_envs.tasks.ocean import EPISODE_FIELDS

MAX_TRANSPONDERS = 6
MAX_MEASUREMENTS = 128

OUTCOMES = ("running", "collision", "left box", "battery empty", "time out")
RUNNING, COLLISION, LEFT_BOX, BATTERY_EMPTY, TIME_OUT = range(5)

REWARD_TERMS = ("information", "error", "energy", "failure")

YAW_RATE, GREEDY, AQUAQUAD = range(3)
#: Code of each vehicle by the name that users write.
VEHICLES = {"yaw-rate": YAW_RATE, "greedy": GREEDY, "aquaquad": AQUAQUAD}

_TRANSPONDERS = (MAX_TRANSPONDERS,)

#: One record is one world. Positions in m (z down), times in s, energies in Wh, information in m⁻², packed.
WORLD = np.dtype(
    [
        ("x", np.float64), ("y", np.float64),
        ("heading", np.float64),  # rad from east, anticlockwise; 0 of vehicles that have none
        ("start_x", np.float64), ("start_y", np.float64),
        # Epochs of measurement so far, the first at reset, and where they were.
        ("count", np.int64),
        ("place_x", np.float64, (MAX_MEASUREMENTS,)), ("place_y", np.float64, (MAX_MEASUREMENTS,)),
        ("ranges", np.float64, (MAX_TRANSPONDERS, MAX_MEASUREMENTS)),  # NaN: no reply
        ("range_scale", np.float64),  # assumed over true speed of sound
        # Transponders, and what is believed of them.
        ("num_transponders", np.int64),
        ("target", np.float64, (MAX_TRANSPONDERS, 3)), ("prior_mean", np.float64, (MAX_TRANSPONDERS, 3)),
        ("estimate", np.float64, (MAX_TRANSPONDERS, 3)), ("information", np.float64, (MAX_TRANSPONDERS, 6)),
        ("status", np.int64, _TRANSPONDERS),  # of the last estimate, an index into map_estimator.STATUSES
        ("replies", np.int64, _TRANSPONDERS),
        ("log_det", np.float64),  # sum over transponders of ln det of information
        ("diverged", np.int64),  # estimates that did not converge
        # The vehicle's life.
        ("battery_wh", np.float64), ("flight_wh", np.float64), ("solar_wh", np.float64),
        ("spent_wh", np.float64), ("clipped_wh", np.float64), ("drift_s", np.float64),
        ("flight_s", np.float64), ("hops", np.int64),
        ("time_s", np.float64), ("clock_s", np.float64),
        *EPISODE_FIELDS,
    ]
)  # fmt: skip


class Constants(NamedTuple):
    """The parameters as kernels read them (units as in ``transponder_localization.Params``, but angles in rad)."""

    vehicle: int
    num_measurements: int
    period: float
    speed: float
    yaw_limit: float
    max_step: float
    #: Length of a full step of the vehicle, whichever it is: the unit of lengths in observations.
    step_length: float
    half_width: float
    euler: bool
    still_water: bool  # no current anywhere: nothing to integrate
    sub_steps: int  # of the aquaquad; so are the next ten
    max_hop: float
    airspeed: float
    drift_threshold: float
    flight_power: float
    base_power: float
    capacity: float
    initial_charge: float
    start_time_spread: float
    clock_offset: float  # s of local solar time at clock 0
    current_noise: float
    # Transponders and start.
    transponders: np.ndarray  # (n, 3) m; none: drawn anew each episode
    fewest: int
    most: int
    depth_low: float
    depth_high: float
    spread: float
    about_start: bool  # transponders lie about the start of the bank's scenario, else about the origin
    start_x: float  # NaN: drawn
    start_y: float
    start_heading: float  # NaN: drawn
    # Ranges and estimates.
    sigma: float
    prior_std_x: float
    prior_std_y: float
    prior_std_z: float
    prior_information: np.ndarray  # (6,) m⁻², packed
    outlier_share: float
    outlier_scale: float
    miss_share: float
    sound_speed_error: float
    settings: MapSettings
    # Reward.
    information_weight: float
    error_weight: float
    energy_weight: float
    failure_penalty: float

"""What the source reports of tracking, HDOP and placement, with its pages: the one place where such values stand.

All of Dillard, *Energy-efficient underwater surveillance by means of hybrid aquacopters*, Naval Postgraduate
School, 2014. None: the source does not say.
"""

from __future__ import annotations

from typing import Any

#: Settings of both filters (III.E, pp. 40-46; App. B). α, β and κ are the tracker's defaults.
DT_S = 0.005
ASSUMED_STD = 1e-3  # √ of R's diagonal: rad and s alike
BEARING_NOISE_POWER = 1e-4  # rad² s
TDOA_NOISE_POWER = 1e-8  # s² s
SOUND_SPEED_M_S = 1500.0

#: EKF against UKF: mean square errors in m² and (m/s)², run time, and when the residuals settle.
FILTERS: dict[str, Any] = {
    "source": "III.E, pp. 40-46, table 2",
    "start": (100.0, 100.0, 20.0, 20.0, 0.0, 0.0),
    "duration_s": 350.0,
    "reach_m": 3500.0,
    "ekf": {
        "mse": {"x": 765.7431, "y": 719.7339, "u": 19.7663, "v": 13.7761},
        "time_s": 0.851532,
        "converged_s": {"position": None, "velocity": 150.0},
    },
    "ukf": {
        "mse": {"x": 97.6823, "y": 116.8798, "u": 12.4691, "v": 10.2321},
        "time_s": 1.076891,
        "converged_s": {"position": 75.0, "velocity": 75.0},
    },
}

#: The laboratory test of the UKF with three TDOA.
LABORATORY: dict[str, Any] = {
    "source": "V.C, pp. 89-97",
    "start": (0.5, 0.5),
    "target": (1.2551, 0.9699),
    "room_m": 8.0,
    "rests_until_s": 13.0,
    "centre_at_s": 55.0,
    "duration_s": 120.0,
    "mse": {"x": 0.21, "y": 0.88},
    "converged_s": 2.0,
    "mean_noise_s": 0.0011,
    "rms_m": {"resting": None, "to the centre": "minimal", "stop and go": "about 1"},
    "error_peaks_at_high_hdop": "all",
}

#: The three maps: figures without numbers; the greatest HDOP is the one that App. C assumes.
MAPS: dict[str, Any] = {
    "source": "IV.A.3, fig. 32, p. 55; IV.C.2, figs. 47 and 48, pp. 72-73; V.A.1, p. 78",
    "team": ((5000.0, 5000.0), (5000.0, -5000.0), (-5000.0, -5000.0)),
    "goal": (3000.0, -3000.0),
    "half_width_m": 5000.0,
    "max_bearing_hdop": 9000.0,
    "said": {
        "tdoa": "singular along the bearings of the two fixed sensors, least opposite them, a lesser dip between",
        "bearing": "singular on the target, a ridge from vehicle 1 to vehicle 3",
    },
}

#: The placement experiment: figures without numbers.
PLACEMENT: dict[str, Any] = {
    "source": "IV.A.4, figs. 34-35, pp. 56-58",
    "sensors": 8,
    "tries": 5,
    "said": {
        ("range", "even"): "near-optimal as it is; ranges grow slightly",
        ("range", "clustered"): "spreads in angle and away from the target, to one side",
        ("bearing", "even"): "near-optimal in angle; one node runs at the target",
        ("bearing", "clustered"): "the target is nearly covered by nodes",
    },
}

"""What the source reports of transponder localization (Garcia, UC Riverside 2018; SPEC §8), as data."""

from __future__ import annotations

from typing import Any

#: Epochs that the tables are about.
EPOCHS = (3, 7, 30)

#: (M, k) -> mean and standard deviation of Σ ln det Y, and RMS error, m, at each epoch; k = 0 moves at random.
Cells = dict[tuple[int, int], tuple[tuple[float, float, float], ...]]

#: Multi-step look-ahead by yaw rate, 1000 runs (Tables 5.5 and 5.9). The error is that of transponder 1, or of 2 of 4.
MSLA: Cells = {
    (1, 0): ((4.24, 0.70, 18.61), (8.77, 0.65, 2.56), (15.73, 1.68, 0.61)),
    (1, 1): ((4.22, 0.94, 20.06), (9.02, 0.87, 1.46), (17.70, 1.34, 0.19)),
    (1, 2): ((4.38, 0.80, 20.37), (8.98, 0.93, 1.36), (18.10, 1.13, 0.14)),
    (1, 3): ((4.55, 0.51, 21.55), (8.77, 0.84, 1.46), (18.55, 0.95, 0.13)),
    (4, 0): ((18.36, 1.87, 32.03), (38.38, 2.79, 1.48), (64.76, 4.05, 0.28)),
    (4, 1): ((18.59, 3.19, 28.82), (44.47, 0.67, 0.33), (76.19, 0.54, 0.08)),
    (4, 2): ((19.08, 3.01, 25.92), (44.34, 0.66, 0.31), (76.31, 0.42, 0.08)),
    (4, 3): ((19.54, 2.77, 26.05), (44.23, 0.63, 0.13), (76.30, 0.33, 0.08)),
}
#: Greedy, any point within 5 m, 500 runs (Tables 5.3 and 5.7).
GREEDY: Cells = {
    (1, 0): ((3.61, 1.18, 4.21), (6.86, 0.64, 1.79), (11.25, 0.57, 0.94)),
    (1, 1): ((4.56, 0.09, 1.87), (8.95, 0.28, 1.51), (18.63, 0.08, 0.09)),
    (4, 0): ((24.03, 3.99, 1.50), (39.15, 2.45, 1.21), (54.51, 2.12, 0.59)),
    (4, 1): ((29.94, 0.97, 0.66), (48.71, 1.71, 0.35), (76.61, 0.44, 0.08)),
}
#: Field trial, recorded ranges, 100 runs of first estimates (Tables 6.2, 6.4, 6.6, 6.8). The error is of transponder 1.
FIELD_MSLA: Cells = {
    (1, 0): ((-3.89, 1.05, 38.28), (0.17, 0.84, 16.32), (4.08, 1.06, 8.23)),
    (1, 1): ((-3.43, 1.24, 28.55), (0.57, 0.85, 13.44), (5.87, 0.70, 3.99)),
    (1, 2): ((-3.64, 1.33, 35.78), (0.42, 1.21, 20.29), (5.91, 0.74, 4.15)),
    (1, 3): ((-3.36, 1.33, 27.46), (0.78, 1.24, 10.44), (5.73, 0.67, 2.68)),
    (2, 0): ((-8.36, 1.72, 43.69), (0.14, 0.99, 16.79), (7.22, 1.83, 9.29)),
    (2, 1): ((-6.90, 2.06, 30.43), (0.79, 1.28, 14.81), (10.59, 1.73, 4.65)),
    (2, 2): ((-7.16, 2.14, 34.27), (0.93, 1.31, 13.89), (10.85, 1.40, 4.42)),
    (2, 3): ((-6.58, 2.07, 31.16), (1.03, 1.58, 14.43), (10.63, 1.25, 3.93)),
}
#: Greedy within 10 m (Tables 6.2 and 6.6).
FIELD_GREEDY: Cells = {
    (1, 0): ((-3.64, 1.14, 55.11), (0.21, 0.61, 26.79), (2.71, 0.38, 16.56)),
    (1, 1): ((-2.82, 1.28, 32.83), (0.89, 1.45, 17.39), (5.65, 0.99, 3.35)),
    (2, 0): ((-7.16, 2.34, 53.65), (0.48, 1.43, 24.59), (5.74, 1.11, 16.99)),
    (2, 1): ((-8.59, 1.45, 37.45), (3.48, 0.46, 6.65), (10.48, 0.89, 2.08)),
}

#: The published tables: how the vehicle moves, whether plans reckon with images of the estimates, how many runs, and
#: which transponder the error is of, by M.
TABLES: dict[str, dict[str, Any]] = {
    "msla": {
        "title": "Multi-step look-ahead by yaw rate", "vehicle": "yaw-rate", "scenarios": {1: "single", 4: "four"},
        "cells": MSLA, "images": True, "runs": 1000, "error_of": {1: 0, 4: 1}, "source": "Tables 5.5 and 5.9",
    },
    "msla-estimates": {
        "title": "Multi-step look-ahead by yaw rate, planned about the estimates alone", "vehicle": "yaw-rate",
        "scenarios": {1: "single", 4: "four"}, "cells": {key: cells for key, cells in MSLA.items() if key[1]},
        "images": False, "runs": 1000, "error_of": {1: 0, 4: 1}, "source": "Tables 5.5 and 5.9",
    },
    "greedy": {
        "title": "Greedy, any point within reach", "vehicle": "greedy", "scenarios": {1: "single", 4: "four"},
        "cells": GREEDY, "images": True, "runs": 500, "error_of": {1: 0, 4: 1}, "source": "Tables 5.3 and 5.7",
    },
    "field-msla": {
        "title": "Field trial, by yaw rate", "vehicle": "yaw-rate", "scenarios": {1: "field", 2: "field"},
        "cells": FIELD_MSLA, "images": True, "runs": 100, "error_of": {1: 0, 2: 0}, "source": "Tables 6.4 and 6.8",
    },
    "field-greedy": {
        "title": "Field trial, greedy", "vehicle": "greedy", "scenarios": {1: "field", 2: "field"},
        "cells": FIELD_GREEDY, "images": True, "runs": 100, "error_of": {1: 0, 2: 0}, "source": "Tables 6.2 and 6.6",
    },
}  # fmt: skip

#: Four fixed places: consistency of the estimator (5.1).
FIXED: dict[str, Any] = {
    "places": ((5.0, 5.0), (-5.0, 5.0), (-5.0, -5.0), (5.0, -5.0)),
    "prior_variance": (100.0, 100.0, 4.0), "std_m": 0.1, "runs": 500, "source": "5.1, figs. 5.1 and 5.2",
}  # fmt: skip

#: Planning time, s a run, of k = 1, 2, 3 by M (5.3, 5.5).
PLANNING_S = {1: (0.18, 0.43, 0.88), 4: (0.24, 0.72, 1.62)}

"""What the source reports of plume tracing: the one place where such values stand.

Byrne, Eskridge, Hurtado and Savage, *Algorithms and Analysis for Underwater Vehicle Plume Tracing*, SAND2003-2643.
"""

from __future__ import annotations

from typing import Any

import numpy as np

SOURCE = "SAND2003-2643"
#: Runs behind each published mean: what the printed script averages (A.1).
RUNS = 5
#: Our runs of a row that has a published mean, to one of a row that has none.
FEWER = 4
STARTS = ("surround", "corner")
#: Columns of the tables by our metric. The script calls the mean distance of the robots that of their centre of mass.
COLUMNS = {"center_of_mass_m": "CM", "closest_m": "closest", "furthest_m": "furthest"}

#: Tables 1 and 2: sensor noise as a share -> start -> columns, m.
NOISE_UPDATES = 50
NOISE: dict[float, dict[str, tuple[float, float, float]]] = {
    0.0: {"surround": (0.9744, 0.1714, 1.7439), "corner": (1.7435, 0.2141, 3.0771)},
    0.05: {"surround": (0.9655, 0.0934, 1.7365), "corner": (1.8330, 0.0500, 3.2518)},
    0.1: {"surround": (0.9643, 0.1028, 1.7457), "corner": (1.8974, 0.0361, 3.5291)},
}
#: Tables 3 and 4: position error, m -> start -> columns, m.
POSITION_UPDATES = 80
POSITION: dict[float, dict[str, tuple[float, float, float]]] = {
    0.0: {"surround": (1.0743, 0.0705, 2.1043), "corner": (1.7470, 0.0193, 3.0423)},
    0.25: {"surround": (2.4574, 1.3136, 4.1251), "corner": (2.0529, 0.7228, 4.0736)},
    0.5: {"surround": (3.5261, 1.4422, 6.6741), "corner": (4.5930, 1.8751, 8.8456)},
    1.0: {"surround": (12.2822, 6.1496, 20.1739), "corner": (13.3710, 6.2784, 25.3038)},
}
#: Updates after which a team no longer moves (section 6).
LOCKED = {"surround": 48, "corner": 35}
#: Heading errors, degrees (section 8): the robots still find the source.
HEADING_DEG = (10.0, 20.0, 30.0)

#: The orientation study (section 5, figure 5; starts of A.7): places relative to the source, m, z up. Updates drawn of
#: a sensor that looks at the source, and of one whose reading depends on orientation.
ORIENTATION: dict[str, Any] = {
    "source": "section 5, figure 5; A.5-A.7",
    "starts": np.array(
        [
            0.5 * np.array([34.3148, 56.2963, 11.8889, 16.9021, 27.8895, 55.6815, 48.5589, 9.5222, 23.1921, 47.8658]),
            0.5 * np.array([14.4320, 65.1551, 12.4608, 81.5887, 9.3024, 30.9941, 26.8817, 53.6451, 16.3278, 21.0988]),
            np.array([0.6828, 1.2523, 1.6615, 9.1142, 1.3626, 6.1700, 2.6898, 2.2066, 7.1290, 5.4900]),
        ]
    ).T,
    "step_limit_m": 1.0,
    "updates": {"light": 12, "oriented-light": 20},
    "works_up_to_m": (30.0, 40.0),
}  # fmt: skip

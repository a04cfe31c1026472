"""``omlp-greedy``, ``omlp-1`` ... ``omlp-3``, ``omlp-K``: measure next where K ranges tell most, and look again.

Optimal measurement location planning (SPEC §8; Garcia, UC Riverside 2018, ch. 4): at every decision the k steps with
the greatest Σ ln det of the information about all transponders, linearised about their estimates and the images that
ranges leave of these (:mod:`baselines.omlp_images`); the first of them is made. Value: :mod:`baselines.omlp_value`;
search, ties, and what is exact: :mod:`baselines.omlp_search`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_range
from aquaquad_envs.physics.vehicle import flight_energy_wh
from aquaquad_envs.tasks.transponder_localization_data import AQUAQUAD, YAW_RATE
from aquaquad_envs.tasks.transponder_localization_kernels import REWARD_UNIT_WH
from baselines.omlp_search import make_grids, plan_all
from baselines.omlp_value import Worth
from baselines.problem import require_continuous_actions

#: Most steps ahead; nothing is gained long before.
MOST_STEPS = 64
#: Share of the box's half-width that is kept from its edges at least, and at most.
_LEAST_MARGIN, _MOST_MARGIN = 0.01, 0.4


def worth_of(batch: Any, *, priced: bool = True) -> Worth:
    """What plans in the worlds of ``batch`` are judged by; hops cost what the reward charges if ``priced``.

    The margin leaves room for a period's drift.
    """
    c, ocean = batch.constants, batch.ocean
    weight = 1.0 / c.sigma**2
    if c.vehicle != AQUAQUAD:
        return Worth(weight, 0.0, 0.0)
    hop_wh = flight_energy_wh(c.max_hop, c.airspeed, c.flight_power)
    paid = priced and c.information_weight > 0
    price = c.energy_weight * hop_wh / REWARD_UNIT_WH / c.information_weight if paid else 0.0
    swept = 0.0 if c.still_water else c.period * float(np.hypot(*np.moveaxis(ocean.velocity, -1, 0)).max())
    margin = np.clip(swept, _LEAST_MARGIN * c.half_width, _MOST_MARGIN * c.half_width)
    return Worth(weight, float(price), float(margin))


class Omlp:
    """The first of the ``steps`` steps after which Σ ln det of the information is greatest, hops priced as rewarded.

    ``images``: whether it reckons with images of the estimates, and turns right where these leave it open, or plans as
    published about the estimates alone. Raises ``InvalidParameterError`` for worlds with discrete actions or of another
    task, or steps outside 1 to 64.
    """

    information = (
        "its own places and heading, all ranges, the first estimates and the latest with their information, the "
        "forecast, all obstacles"
    )

    def __init__(self, batch: Any, *, steps: int = 3, images: bool = True) -> None:
        if batch.task.name != "transponder-localization":
            raise InvalidParameterError("task", batch.task.name, "transponder-localization")
        require_continuous_actions(batch)
        check_range(
            "steps", steps, 1, MOST_STEPS, remedy="It is the number in the policy's name, as in omlp-3."
        )
        self.batch = batch
        self.steps = int(steps)
        self.images = bool(images)
        self.worth = worth_of(batch)
        self.grids = make_grids(self.steps, turning=batch.constants.vehicle == YAW_RATE)
        #: Of the latest decision: actions (num_worlds, steps, 2), and Σ ln det less prices (num_worlds,).
        self.plans = np.zeros((batch.num_worlds, self.steps, 2))
        self.values = np.zeros(batch.num_worlds)

    def reset(self, seeds: np.ndarray) -> None:
        """Nothing to reset: all that it knows is in the world's record."""

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """Actions, float32 (num_worlds, size): the first step of each plan."""
        batch = self.batch
        plan_all(
            worlds, self.steps, self.images, self.grids, self.plans, self.values, batch.ocean, batch.constants,
            self.worth,
        )  # fmt: skip
        return self.plans[:, 0, : batch.action_spec.size].astype(np.float32)


class OmlpGreedy(Omlp):
    """The best next place of all that one step reaches: of the "greedy" vehicle any point within its longest step."""

    def __init__(self, batch: Any) -> None:
        super().__init__(batch, steps=1)

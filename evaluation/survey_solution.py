"""Where a surveyed transponder is, from all replies at once: robust, with the noise estimated along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.estimation.map_estimator_noise import Adapted, adapt_noise, line_of_sight_std
from aquaquad_envs.estimation.map_estimator_times import TimeEstimates, estimate_from_times
from evaluation.survey_file import Survey

#: Huber's bound: 5 % of the efficiency is given for replies that are up to a third outliers.
HUBER = 1.345
#: Bound of the noise's estimate: it stands up to the most outliers, a half, at the price of some of its own precision.
NOISE_BOUND = 1.0
#: Mean speed of sound along the path where nothing is known of it, and what is: the ocean's 1450 to 1550 m/s.
SOUND_SPEED_M_S, SOUND_SPEED_STD_M_S = 1500.0, 30.0
#: Normalised residual beyond which a reply counts as an outlier in the report (no reply is left out of the solution).
OUTLIER = 4.0
#: Prior of the position about the middle of the survey, in usual ranges: as good as none.
_PRIOR_RANGES = 10.0


class SurveySolution(NamedTuple):
    """Position and noise from a whole survey."""

    name: str
    position_m: np.ndarray  # (3,) x east, y north, z down, frame of the file
    covariance: np.ndarray  # (3, 3) m²
    sound_speed_m_s: float
    sound_speed_std_m_s: float  # 0 where it was given
    range_std_m: float  # of the ranging alone
    residuals_m: np.ndarray  # (n,) one way
    stds_m: np.ndarray  # (n,) of each range: the ranging and the receiver's position
    outliers: np.ndarray  # (n,) bool

    @property
    def residual_rms_m(self) -> float:
        """Of the replies that are no outliers, one way."""
        return float(np.sqrt(np.mean(self.residuals_m[~self.outliers] ** 2)))


def solve_survey(
    survey: Survey,
    name: str,
    *,
    sound_speed_m_s: float = SOUND_SPEED_M_S,
    free_speed: bool = True,
    huber: float = HUBER,
) -> SurveySolution:
    """Maximum a-posteriori position from all replies, with a prior as good as none.

    The noise of the ranging is that of the residuals, beside what the stated errors of the receiver's positions add
    (``map_estimator_noise``). free_speed: the speed of sound is estimated, ± 30 m/s about ``sound_speed_m_s``. The
    transponder is taken to lie below the antenna. Raises ``AquaQuadError`` where the replies do not fix it.
    """
    # A quantile, not the least: that may be an outlier.
    low, usual = np.quantile(survey.two_way_s, [0.05, 0.5]) * sound_speed_m_s / 2
    level = float(np.mean(survey.places[:, 2]))
    middle = np.array([*np.median(survey.places[:, :2], axis=0), level + 0.7 * low])
    prior = (_PRIOR_RANGES * usual) ** 2 * np.eye(3)
    unknowns = 3 + int(free_speed)
    extra = np.zeros(len(survey.two_way_s))

    def solve(std: float) -> tuple[TimeEstimates, np.ndarray, np.ndarray, int]:
        def once(start: np.ndarray | None, mirror: bool) -> TimeEstimates:
            return estimate_from_times(
                survey.transmit, survey.receive, survey.two_way_s, middle, prior,
                time_std_s=2.0 * np.hypot(std, extra) / sound_speed_m_s, sound_speed_m_s=sound_speed_m_s,
                sound_speed_std_m_s=SOUND_SPEED_STD_M_S if free_speed else 0.0, huber=huber, start=start, mirror=mirror,
            )  # fmt: skip

        found = once(None, True)
        if found.position_m[2] < level:
            image = found.unknowns.copy()
            image[2] = 2.0 * level - image[2]
            found = once(image, False)
        extra[:] = line_of_sight_std(survey.places, found.position_m, survey.place_std)
        return found, found.residuals_s * float(found.sound_speed_m_s) / 2, extra, unknowns

    adapted: Adapted = adapt_noise(solve, 0.05 * float(usual), huber=NOISE_BOUND if huber > 0 else 0.0)
    found = adapted.solution
    if not (found.converged and adapted.settled):
        why = found.reasons[0] if found.reasons else "the noise does not settle"
        raise AquaQuadError(f"{survey.name}: no solution ({name}): {why}.")
    speed = float(found.sound_speed_m_s)
    residuals = found.residuals_s * speed / 2
    stds = np.hypot(adapted.std, extra)
    return SurveySolution(
        name, found.position_m.copy(), found.covariance[:3, :3].copy(), speed,
        float(np.sqrt(found.covariance[3, 3])), adapted.std, residuals, stds, np.abs(residuals) > OUTLIER * stds,
    )  # fmt: skip


def solutions(survey: Survey, sound_speed_m_s: float | None = None) -> dict[str, SurveySolution]:
    """The robust solutions with the speed of sound free and given, and plain least squares; the first is the reference.

    ``sound_speed_m_s``: as given by the user; the reference is then the solution that takes it. Others that fail are
    left out. Raises ``InvalidParameterError``, or ``AquaQuadError`` where there is no reference.
    """
    if sound_speed_m_s is not None and not 1000 <= sound_speed_m_s <= 2000:
        raise InvalidParameterError("survey-sound-speed", sound_speed_m_s, "m/s in [1000, 2000]")
    speed = SOUND_SPEED_M_S if sound_speed_m_s is None else float(sound_speed_m_s)
    ways = {
        "free": ("speed of sound estimated", True, HUBER),
        "given": (f"speed of sound {speed:g} m/s", False, HUBER),
        "plain": ("plain least squares", True, 0.0),
    }
    order = ("free", "given", "plain") if sound_speed_m_s is None else ("given", "free", "plain")
    found = {}
    for key in order:
        name, free_speed, huber = ways[key]
        try:
            found[key] = solve_survey(survey, name, sound_speed_m_s=speed, free_speed=free_speed, huber=huber)
        except AquaQuadError:
            # The others are there to compare with: they may fail where the first does not.
            if not found:
                raise
    return found

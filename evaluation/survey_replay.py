"""A recorded survey as a world: at each step a policy chooses among the places where there is a recorded reply.

The policy sees what it sees in transponder localization (estimate, information, own place; the transponder's is nowhere
in the record) and moves as there; the end of its step is matched to the nearest recorded place within reach that it
has not used yet, and that place's reply is what it measures. Where no place within reach is left, the
nearest one is taken, and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.errors import CheckpointError, InvalidParameterError, check_range
from aquaquad_envs.estimation.map_estimator import estimate_transponders, pack
from aquaquad_envs.tasks.batch import WorldBatch, make_world_batch
from aquaquad_envs.tasks.transponder_localization_data import MAX_MEASUREMENTS
from aquaquad_envs.tasks.transponder_localization_observation import make_scratch, observe_world
from aquaquad_envs.tasks.transponder_localization_params import MOST_RATIO
from aquaquad_envs.tasks.transponder_localization_vehicles import move
from evaluation.policies import build_policy
from evaluation.survey_file import Survey
from evaluation.survey_solution import HUBER, SurveySolution

TASK = "transponder-localization"
#: The places in the order of the file.
SURVEY_ORDER = "survey-order"
#: Vehicles that a policy is tried with: a free step, and for policies that only turn, turns.
VEHICLES = ("greedy", "yaw-rate")
#: Reach in usual distances between consecutive places, if the user does not choose.
_REACH = 10.0
#: First estimate: off by the usual range, and by this share of the depth; within what the world allows.
_DEPTH_SHARE = 0.1
#: Step at which an estimate has converged: far below what any survey resolves.
_TOLERANCE_M = 1e-4


class Replay(NamedTuple):
    """What one policy did, by run and number of measurements."""

    policy: str
    vehicle: str
    information: str
    chosen: np.ndarray  # (runs, measurements) index of the record
    estimates: np.ndarray  # (runs, measurements, 3) m, frame of the file
    errors_m: np.ndarray  # (runs, measurements) from the reference
    log_det: np.ndarray  # (runs, measurements) ln det of information
    sailed_m: np.ndarray  # (runs, measurements)
    beyond: int  # steps that no place within reach was left for
    unconverged: int  # estimates


class Setup(NamedTuple):
    """What all policies meet: the same starts and first estimates."""

    places: np.ndarray  # (n, 3) m, about ``shift``, the antenna's mean depth 0
    ranges: np.ndarray  # (n,) m
    stds: np.ndarray  # (n,) m
    shift: np.ndarray  # (3,) m
    reference: np.ndarray  # (3,) m, about ``shift``
    reach_m: float
    measurements: int
    first: np.ndarray  # (runs,) record of the first measurement
    prior_mean: np.ndarray  # (runs, 3) m
    prior_std: tuple[float, float, float]  # m
    seeds: np.ndarray  # (runs,)


def prepare(
    survey: Survey,
    reference: SurveySolution,
    *,
    reach_m: float | None = None,
    measurements: int = 30,
    runs: int = 20,
    seed: int = 0,
) -> Setup:
    """Starts at random records, first estimates normal about ``reference``.

    reach_m: default ten times the median distance between consecutive places. Ranges are half the two-way times at the
    reference's speed of sound. Raises ``InvalidParameterError``.
    """
    count = len(survey.two_way_s)
    spacing = float(np.median(np.linalg.norm(np.diff(survey.places[:, :2], axis=0), axis=1)))
    if reach_m is None and not spacing > 0:
        raise InvalidParameterError(
            "survey-reach", reach_m, "metres for a survey whose places mostly repeat", "Give --survey-reach."
        )
    reach = _REACH * spacing if reach_m is None else reach_m
    check_range("survey-reach", reach, 0, 1e5, open_low=True)
    for name, value, least, most in (
        ("survey-measurements", measurements, 2, min(MAX_MEASUREMENTS, count)),
        ("episodes", runs, 1, 100_000),
    ):
        if not least <= value <= most:
            raise InvalidParameterError(name, value, f"a whole number, {least} to {most}")
    shift = survey.places.mean(axis=0)
    ranges = survey.two_way_s * reference.sound_speed_m_s / 2
    place = reference.position_m - shift
    sigma = float(np.sqrt(np.mean(reference.stds_m**2)))
    most_std = 0.9 * MOST_RATIO * sigma
    wide = min(float(np.median(ranges)), most_std)
    prior_std = (wide, wide, min(max(_DEPTH_SHARE * float(place[2]), sigma), most_std))
    random = np.random.default_rng(np.random.SeedSequence([seed, count]))
    return Setup(
        survey.places - shift, ranges, reference.stds_m, shift, place, float(reach), int(measurements),
        random.integers(count, size=runs), place + random.standard_normal((runs, 3)) * prior_std, prior_std,
        random.integers(2**31, size=runs),
    )  # fmt: skip


def make_batch(setup: Setup, vehicle: str) -> WorldBatch:
    """Worlds whose records the replay fills in; ``vehicle`` reaches as far as the setup says in one step."""
    extent = float(np.abs(setup.places[:, :2]).max()) + float(setup.ranges.max())
    return make_world_batch(
        TASK, len(setup.first), scenario="random", vehicle=vehicle, num_measurements=setup.measurements,
        transponders=((0.0, 0.0, max(float(setup.reference[2]), 0.0)),), start=(0.0, 0.0),
        half_width_m=min(4.0 * (extent + setup.reach_m), 1e6), max_step_m=setup.reach_m, speed_m_s=1.0,
        period_s=setup.reach_m, range_std_m=float(np.sqrt(np.mean(setup.stds**2))), prior_std_m=setup.prior_std,
        robust_threshold=HUBER,
    )  # fmt: skip


@loop_kernel
def _observe_all(worlds, observations, ocean, c):
    scratch = make_scratch()
    for k in range(worlds.size):
        observe_world(worlds[k], observations[k], ocean, c, scratch)


@loop_kernel
def _move_all(worlds, actions, ocean, c):
    last = actions.shape[1] - 1
    for k in range(worlds.size):
        move(worlds[k], actions[k, 0], actions[k, last], ocean, c)


def _with_policy(setup: Setup, name: str) -> tuple[WorldBatch, Any, str]:
    """Worlds and the policy for them, with the first vehicle that it can steer."""
    for vehicle in VEHICLES:
        batch = make_batch(setup, vehicle)
        try:
            return batch, build_policy(name, batch), vehicle
        except CheckpointError:
            if vehicle == VEHICLES[-1]:
                raise
    raise AssertionError("unreachable")


def replay(setup: Setup, name: str, check: Callable[[], None] = lambda: None) -> Replay:
    """Let policy ``name`` measure, in all runs at once; ``check`` is called at every step."""
    if name == SURVEY_ORDER:
        batch, policy, vehicle = make_batch(setup, VEHICLES[0]), None, "–"
        information = "the order in which the places were visited"
    else:
        batch, policy, vehicle = _with_policy(setup, name)
        information = str(getattr(policy, "information", "not stated"))
    worlds, runs, steps = batch.worlds, len(setup.first), setup.measurements
    batch.reset(setup.seeds.tolist())
    # Nobody is told where the transponder is, not by mistake either.
    worlds["target"] = np.nan
    worlds["prior_mean"][:, 0] = worlds["estimate"][:, 0] = setup.prior_mean
    worlds["information"][:, 0] = batch.constants.prior_information
    worlds["count"] = 0
    if policy is not None:
        policy.reset(setup.seeds)
    chosen = np.zeros((runs, steps), dtype=np.int64)
    estimates, log_det = np.zeros((runs, steps, 3)), np.zeros((runs, steps))
    beyond = unconverged = 0
    chosen[:, 0] = setup.first
    for n in range(steps):
        check()
        if n > 0 and policy is None:
            chosen[:, n] = (chosen[:, n - 1] + 1) % len(setup.places)
        elif n > 0 and policy is not None:
            _observe_all(worlds, batch.observations, batch.ocean, batch.constants)
            actions = np.asarray(policy.act(batch.observations, worlds), dtype=np.float64)
            here = np.stack([worlds["x"], worlds["y"]], axis=-1)
            _move_all(worlds, actions, batch.ocean, batch.constants)
            chosen[:, n], missed = _match(
                setup, here, np.stack([worlds["x"], worlds["y"]], -1), chosen[:, :n]
            )
            beyond += missed
        unconverged += _measure(setup, worlds, chosen[:, : n + 1], vehicle == "yaw-rate")
        estimates[:, n], log_det[:, n] = worlds["estimate"][:, 0], worlds["log_det"]
    steps_m = np.linalg.norm(np.diff(setup.places[chosen][..., :2], axis=1), axis=-1)
    sailed = np.concatenate([np.zeros((runs, 1)), np.cumsum(steps_m, axis=1)], axis=1)
    return Replay(
        name, vehicle, information, chosen, estimates + setup.shift,
        np.linalg.norm(estimates - setup.reference, axis=-1), log_det, sailed, beyond, unconverged,
    )  # fmt: skip


def _match(setup: Setup, here: np.ndarray, wanted: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, int]:
    """Record of each run that is nearest to where it ``wanted`` to go, and how many had none within reach."""
    places = setup.places[:, :2]
    to_go = np.linalg.norm(places - here[:, None], axis=-1)
    off = np.linalg.norm(places - wanted[:, None], axis=-1)
    rows = np.arange(len(here))[:, None]
    to_go[rows, used] = off[rows, used] = np.inf
    reachable = to_go <= setup.reach_m
    none = ~reachable.any(axis=1)
    off[~reachable] = np.inf
    off[none] = to_go[none]
    return off.argmin(axis=1), int(none.sum())


def _measure(setup: Setup, worlds: np.ndarray, chosen: np.ndarray, turning: bool) -> int:
    """Write the latest reply and the estimate from all so far into the records; returns how many did not converge."""
    n = chosen.shape[1] - 1
    latest = setup.places[chosen[:, n]]
    if turning and n > 0:
        gone = latest[:, :2] - setup.places[chosen[:, n - 1], :2]
        moved = np.abs(gone).max(axis=1) > 0
        worlds["heading"][moved] = np.arctan2(gone[moved, 1], gone[moved, 0])
    worlds["x"], worlds["y"] = worlds["place_x"][:, n], worlds["place_y"][:, n] = latest[:, 0], latest[:, 1]
    if n == 0:
        worlds["start_x"], worlds["start_y"] = worlds["x"], worlds["y"]
    worlds["ranges"][:, 0, n] = setup.ranges[chosen[:, n]]
    worlds["count"] = worlds["replies"][:, 0] = n + 1
    # An early outlier may lead a warm start astray for good: the prior mean is another start.
    ways = [
        estimate_transponders(
            setup.places[chosen], setup.ranges[chosen], setup.prior_mean, np.diag(np.square(setup.prior_std)),
            std_m=setup.stds[chosen], start=start, huber=HUBER, tolerance_m=_TOLERANCE_M,
        )
        for start in (worlds["estimate"][:, 0].copy(), None)
    ]  # fmt: skip
    colder = ways[1].cost < ways[0].cost
    found = ways[0]
    for kept, other in zip(found, ways[1], strict=True):
        kept[colder] = other[colder]
    worlds["estimate"][:, 0], worlds["information"][:, 0] = found.estimate, pack(found.information)
    worlds["status"][:, 0] = found.status
    worlds["log_det"] = np.linalg.slogdet(found.information)[1]
    worlds["diverged"] += ~found.converged
    return int((~found.converged).sum())

"""Suites: what is evaluated on, with frozen seeds that training never uses.

Training draws its seeds from 1 000 000 up and its random fields with ``field_seed=1``; suites
use seeds below that and ``field_seed=0``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError, check_choice, check_range
from aquaquad_envs.tasks.task import TASKS

#: Seeds of one ``--seed`` value; the values reach from 0 to 99, so that all stay below training's.
SEEDS_EACH, MOST_SEEDS = 10_000, 100
STRATA = ("easy", "medium", "hard")
STRATA_FILE = "strata_seeds.json"


@dataclass(frozen=True, kw_only=True)
class Suite:
    """One table of the benchmark: parameters of the worlds, and their seeds.

    Parameters
    ----------
    task, name: on command lines. about: one sentence for the report.
    params: keyword parameters of the worlds. episodes: at the quick size.
    stratified: seeds come in equal parts from the frozen strata of difficulty.
    """

    task: str
    name: str
    about: str
    params: dict[str, Any] = field(default_factory=dict)
    episodes: int
    stratified: bool = False

    def seeds(self, episodes: int, seed: int) -> np.ndarray:
        """The frozen seeds of ``episodes`` episodes; ``seed`` picks another set of them."""
        return np.concatenate(list(self.strata_seeds(episodes, seed).values()))

    def strata_seeds(self, episodes: int, seed: int) -> dict[str, np.ndarray]:
        """Seeds by stratum, in the order of :meth:`seeds`; one stratum "" where there are none."""
        for name, value, bounds in (
            ("episodes", episodes, (1, SEEDS_EACH)),
            ("seed", seed, (0, MOST_SEEDS - 1)),
        ):
            check_range(name, value, *bounds)
        if not self.stratified:
            return {"": SEEDS_EACH * seed + np.arange(episodes)}
        frozen = frozen_strata()
        held = min(len(frozen[stratum]) for stratum in STRATA)
        if episodes > held * len(STRATA):
            raise InvalidParameterError(
                "episodes", episodes, f"at most {held * len(STRATA)} in suite {self.name}",
                "Its strata of difficulty hold no more frozen seeds.",
            )  # fmt: skip
        sizes = [episodes // 3 + (k < episodes % 3) for k in range(len(STRATA))]
        chosen = {}
        for stratum, size in zip(STRATA, sizes, strict=True):
            order = np.arange(held) if seed == 0 else np.random.default_rng(seed).permutation(held)
            chosen[stratum] = np.array(frozen[stratum])[order[:size]]
        return {stratum: seeds for stratum, seeds in chosen.items() if len(seeds)}


@lru_cache(maxsize=1)
def frozen_strata() -> dict[str, list[int]]:
    """Seeds of each stratum of ``gyres``, as ``python -m evaluation.strata`` froze them."""
    try:
        strata = json.loads(resources.files("evaluation").joinpath(STRATA_FILE).read_text())["seeds"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise AquaQuadError(
            f"evaluation/{STRATA_FILE}: {error}; make it with `python -m evaluation.strata`."
        ) from error
    return {name: strata[name] for name in STRATA}


#: Ambient light at 532 nm that varies by 30 %, a third of a flat top's, and twice the noise.
DAYLIGHT: dict[str, Any] = {"ambient_w_m2": 0.005, "ambient_variation": 0.3, "noise_std_w_m2": 1e-3}


def _light(name: str, about: str, **params: Any) -> Suite:
    return Suite(task="laser-tracking", name=name, about=about, params=params, episodes=40)


def _placement(name: str, about: str, episodes: int, **params: Any) -> Suite:
    return Suite(task="sensor-placement", name=name, about=about, params=params, episodes=episodes)


def _localization(name: str, about: str, episodes: int, **params: Any) -> Suite:
    params = {"scenario": name, **params}
    return Suite(task="transponder-localization", name=name, about=about, params=params, episodes=episodes)


def _tracing(name: str, about: str, episodes: int, **params: Any) -> Suite:
    return Suite(task="plume-tracing", name=name, about=about, params=params, episodes=episodes)


_WATERS = {
    "calm": "without current",
    "vortex": "in the published vortex with its 2 km square obstacle",
    "gyres": "in random divergence-free currents that change with time, with obstacles",
}
_MEASURED = {"bearing": "bearings", "range": "ranges", "tdoa": "time differences of arrival"}

#: Suites by task, in the order of the report. ``file`` needs a file and joins when one is given.
SUITES: dict[str, tuple[Suite, ...]] = {
    "drift-hop": (
        Suite(
            task="drift-hop", name="vortex", params={"scenario": "vortex"}, episodes=100,
            about="the published vortex, start and goal, with one 2 km square obstacle at the centre",
        ),
        Suite(
            task="drift-hop", name="vortex-perturbed", params={"scenario": "vortex-perturbed"}, episodes=100,
            about="the same, start and goal each anywhere within 500 m of the published ones",
        ),
        Suite(
            task="drift-hop", name="gyres", params={"scenario": "gyres"}, episodes=60, stratified=True,
            about="random divergence-free currents that change with time, random starts, goals and obstacles, in equal "
            "parts from three strata of difficulty",
        ),
        Suite(
            task="drift-hop", name="forecast-error", params={"scenario": "forecast-error"}, episodes=45,
            stratified=True, about="the episodes of gyres, but policies see a forecast that differs from the "
            "current that carries them (relative error 0.4)",
        ),
        Suite(
            task="drift-hop", name="file", params={"scenario": "file"}, episodes=24,
            about="currents of an ocean model from a NetCDF file, land as obstacles, random starts and goals",
        ),
    ),
    "sensor-placement": (
        *(
            _placement(
                f"{water}-{kind}", f"four vehicles track one target by {measured} {where}", 12, scenario=water,
                measurement=kind,
            )
            for water, where in _WATERS.items()
            for kind, measured in _MEASURED.items()
        ),
        _placement(
            "file", "four vehicles track one target by time differences of arrival in currents of an ocean model from "
            "a NetCDF file, land as obstacles", 12, scenario="file",
        ),
        _placement(
            "fence", "four vehicles hold a slowly moving line in the currents of gyres", 12, scenario="fence"
        ),
        *(
            _placement(
                f"grid-{n}x{n}", f"{n} steered vehicle{'s' * (n > 1)} and {n} slower target{'s' * (n > 1)}, "
                "ranges only, no current, no energy", episodes, scenario="grid", num_vehicles=n, num_targets=n,
            )
            for n, episodes in ((1, 24), (3, 12), (5, 4))
        ),
    ),
    "transponder-localization": (
        _localization("single", "the published transponder, start and noise, 30 measurements", 100),
        _localization("four", "the published four transponders, start and noise, 30 measurements", 60),
        _localization("random", "one to six transponders at random places and depths, random start", 100),
        _localization("current", "as random, in random divergence-free currents", 100),
        _localization(
            "field", "the two transponders of the published field trial, its start and its noise of 1 m", 60
        ),
        _localization(
            "aquaquad", "an AquaQuad that drifts and hops over one to six transponders, 500 to 2000 m deep, in a box "
            "of 10 km with random currents", 24, scenario="deep", vehicle="aquaquad",
        ),
        _localization(
            "file", "as aquaquad, in currents of an ocean model from a NetCDF file", 24, vehicle="aquaquad"
        ),
    ),
    "laser-tracking": (
        _light("still", "flat-top light over a vehicle that holds its place", scenario="still"),
        _light("moving", "flat-top light over a vehicle on a straight course, up to 0.3 m/s", scenario="moving"),
        _light("wandering", "flat-top light over a vehicle that wanders, up to 0.3 m/s", scenario="wandering"),
        _light(
            "flat-top", "flat-top light, the vehicle still, on a straight course, turning or wandering in equal parts",
            scenario="mixed",
        ),
        _light("gaussian", "the episodes of flat-top under a Gaussian beam", scenario="mixed", profile="gaussian"),
        _light(
            "daylight", "the episodes of flat-top with ambient light that varies, and twice the noise",
            scenario="mixed", **DAYLIGHT,
        ),
        _light(
            "planar", "the published reduction to one horizontal axis: from the ground, a vehicle on a straight course",
            scenario="moving", axes=1, start_altitude_m=0.0,
        ),
    ),
    "plume-tracing": (
        _tracing("surround", "ten robots on a 20 m ring, 8 m above a lamp, 50 updates", 24, scenario="surround"),
        _tracing("corner", "the same, the robots on an arc of 40° to one side", 24, scenario="corner"),
        _tracing("noise", "surround with 10 % sensor noise", 24, scenario="surround", sensor_noise=0.1),
        _tracing(
            "position-error", "surround with believed positions up to 0.5 m wrong in x and y, 80 updates", 24,
            scenario="surround", position_error_m=0.5, horizon_updates=80,
        ),
        _tracing(
            "heading-error", "surround with robots whose courses are up to 20° wrong", 24, scenario="surround",
            heading_error_deg=20.0,
        ),
        _tracing(
            "advected", "a smooth plume in a stream with eddies, ten robots 40 m downstream", 24, scenario="advected"
        ),
        _tracing(
            "turbulent", "a meandering plume of filaments in such a stream, ten robots 40 m downstream", 48,
            scenario="turbulent",
        ),
        *(
            _tracing(
                f"turbulent-{n}", f"the same with {n} robots", episodes, scenario="turbulent", num_robots=n,
            )
            for n, episodes in ((3, 48), (30, 24))
        ),
    ),
}  # fmt: skip


def find_tasks(task: str | None, suites: Sequence[str] = ()) -> list[str]:
    """``task`` alone, or where it is None the tasks that have any of ``suites``: all tasks if none is named.

    Raises ``InvalidParameterError`` naming the nearest known task or suite.
    """
    if task is not None:
        check_choice("task", task, TASKS)
        return [task]
    known = {suite.name for listed in SUITES.values() for suite in listed}
    for name in suites:
        check_choice("suite", name, sorted(known))
    return [
        name
        for name, listed in SUITES.items()
        if not suites or {suite.name for suite in listed} & set(suites)
    ]


def find_suites(
    task: str | None,
    names: Sequence[str] = (),
    *,
    currents: Sequence[Path] = (),
    center: tuple[float, float] | None = None,
) -> list[Suite]:
    """Suites of ``task`` (None: of all tasks) by ``names``, all that can run by default; ``currents`` feeds ``file``.

    Raises ``InvalidParameterError`` naming the nearest known name, or the file that is missing.
    """
    if task is None:
        found = []
        for each in find_tasks(None, names):
            theirs = {suite.name for suite in SUITES[each]}
            chosen = [name for name in names if name in theirs]
            found += find_suites(each, chosen, currents=currents, center=center)
        return found
    check_choice("task", task, TASKS)
    known = {suite.name: suite for suite in SUITES[task]}
    for name in names:
        check_choice("suite", name, known)
    for path in currents:
        if not Path(path).is_file():
            raise InvalidParameterError("currents", str(path), "the path of a NetCDF file that exists")
    if len(currents) > 2:
        raise InvalidParameterError("currents", f"{len(currents)} files", "one file, or two: u and v")
    if "file" in names and not currents:
        raise InvalidParameterError("currents", None, "the path of a NetCDF file", "Suite file reads it.")
    if center is not None and not currents:
        raise InvalidParameterError("currents_center", center, "a --currents file to go with it")
    chosen = list(names) or [name for name in known if name != "file" or currents]
    if currents and "file" not in chosen:
        raise InvalidParameterError(
            "suite", ", ".join(names), "file among the suites", "--currents feeds that one."
        )
    return [
        _with_currents(known[name], currents, center) if name == "file" else known[name] for name in chosen
    ]


def _with_currents(suite: Suite, currents: Sequence[Path], center: tuple[float, float] | None) -> Suite:
    files = tuple(str(path) for path in currents)
    params = {
        **suite.params,
        "currents_file": files if len(files) > 1 else files[0],
        "currents_center": center,
    }
    names = " and ".join(Path(path).name for path in files)
    return Suite(
        task=suite.task, name=suite.name, about=f"{suite.about}: {names}", params=params, episodes=suite.episodes,
    )  # fmt: skip

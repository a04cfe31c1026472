"""How fast the DR-RRT* planners are, beside OMPL's RRT* with as many iterations where its wheel is installed.

    python benchmarks/dr_rrt_star.py                  # needs: pip install ompl (optional)

One thread, the published vortex with a 2 km square at the centre. Figures are medians over seeds of the
processor time of the planning call, so that other work on the machine does not count. OMPL solves an easier problem
(the shortest straight flight in the same box around the same square, no drift); its obstacle test is a Python
callback here, so that its time without any obstacle is given too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tyro

from aquaquad_envs.physics.current_formulas import published_vortex
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap
from baselines.dr_rrt_star import plan, plan_published
from baselines.problem import DriftHopProblem

SQUARE = (-1000.0, -1000.0, 1000.0, 1000.0)
START, GOAL = (-4000.0, 4000.0), (3000.0, -3000.0)


@dataclass
class Options:
    seeds: int = 50
    iterations: int = 25_000
    ompl_seeds: int = 3


def processor_ms(run: Callable[[int], float], seeds: int) -> tuple[float, float, float]:
    """Median and worst milliseconds of ``run(seed)``, and the mean of what it returns."""
    run(0)
    times, results = [], []
    for seed in range(seeds):
        began = time.thread_time()
        results.append(run(seed))
        times.append(1e3 * (time.thread_time() - began))
    return float(np.median(times)), float(np.max(times)), float(np.mean(results))


def vortex(interpolation: str) -> DriftHopProblem:
    grid, side = Grid.square(5000.0, 100.0)
    return DriftHopProblem.of(
        published_vortex(interpolation=interpolation),
        ObstacleMap.from_rectangles([SQUARE], grid=grid, side=side),
        start=START, goal=GOAL, target=(3100.0, -2900.0),
        team=np.array([[5000.0, 5000.0], [5000.0, -5000.0], [-5000.0, -5000.0]]),
    )  # fmt: skip


def ompl_rrt_star(iterations: int, obstacle: bool) -> Callable[[int], float]:
    """OMPL's RRT* on the straight-flight problem; returns the energy of its path, Wh."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)

    def run(seed: int) -> float:
        util.RNG.setSeed(seed + 1)
        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        bounds.setLow(-5000.0)
        bounds.setHigh(5000.0)
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        x_min, y_min, x_max, y_max = SQUARE
        if obstacle:
            setup.setStateValidityChecker(lambda s: not (x_min < s[0] < x_max and y_min < s[1] < y_max))
        else:
            setup.setStateValidityChecker(base.AllValidStateValidityChecker(setup.getSpaceInformation()))
        states = []
        for x, y in (START, GOAL):
            state = space.allocState()
            state[0], state[1] = x, y
            states.append(state)
        setup.setStartAndGoalStates(states[0], states[1], 100.0)
        planner = geometric.RRTstar(setup.getSpaceInformation())
        planner.setRange(4000.0 / 3.0)
        setup.setPlanner(planner)
        asked = 0

        def done() -> bool:
            nonlocal asked
            asked += 1
            return asked > iterations

        setup.solve(base.PlannerTerminationCondition(done))
        return 200.0 * setup.getSolutionPath().length() / (40_000.0 / 3600.0) / 3600.0

    return run


def main(options: Options) -> None:
    cell, smooth = vortex("cell"), vortex("bilinear")
    n = options.iterations

    def published(variant: str) -> Callable[[int], float]:
        return lambda seed: plan_published(cell, seed=seed, variant=variant, iterations=n).flight_energy_wh

    runs = {
        "published, single solution": (published("single"), 190.0, options.seeds),
        f"published, seeking, {n} iterations": (published("seeking"), 4964.0, options.seeds),
        "product": (lambda seed: plan(smooth, seed=seed).flight_energy_wh, None, options.seeds),
    }
    try:
        import ompl  # noqa: F401
    except ImportError:
        print("OMPL is not installed (pip install ompl): its rows are left out.")
    else:
        runs[f"OMPL RRT*, {n} iterations"] = (ompl_rrt_star(n, True), None, options.ompl_seeds)
        runs[f"OMPL RRT*, {n} iterations, no obstacle"] = (ompl_rrt_star(n, False), None, options.ompl_seeds)
    rows = {name: (*processor_ms(run, seeds), source) for name, (run, source, seeds) in runs.items()}
    reference = rows[f"published, seeking, {n} iterations"][0]
    print(f"{'planner':42} {'median ms':>10} {'worst ms':>9} {'x seeking':>9} {'paper ms':>9} {'mean Wh':>8}")
    for name, (median, worst, energy, source) in rows.items():
        paper = f"{source:9.0f}" if source else " " * 9
        print(f"{name:42} {median:10.2f} {worst:9.2f} {median / reference:9.2f} {paper} {energy:8.2f}")


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))

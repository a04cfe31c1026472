"""How fast transponders are located, beside scipy's least squares in the same process.

``python benchmarks/map_estimator.py``. A solution is the maximum a-posteriori place of one transponder, from the
ranges so far of a vehicle that turns at random (published settings: σ = 0.12 m, prior 100 m about the truth), on one
thread. Warm: started from the solution one range before, as a world does; cold: from the prior mean. The peer
minimises the same cost, with the exact gradient, from the same start; the rates are the best of repetitions that
alternate. Other work on the machine lowers all rates.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.estimation.map_estimator import estimate_transponders, map_settings, pack, solve_point
from aquaquad_envs.estimation.map_estimator_lanes import LANES

TRANSPONDER = np.array([17.0, 15.0, 6.0])
STD = 0.12
PRIOR = np.diag([1e4, 1e4, 4.0])
RUNS = 512
COUNTS = (5, 15, 30, 50)


def runs(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (RUNS, count, 2), ranges (RUNS, count) and prior means (RUNS, 3)."""
    rng = np.random.default_rng(0)
    turns = rng.uniform(-np.pi / 6, np.pi / 6, (RUNS, count))
    heading = -np.pi / 6 + np.cumsum(turns, axis=1)
    steps = 3.0 * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    places = np.array([-3.0, 9.0]) + np.cumsum(steps, axis=1) - steps[:, :1]
    exact = np.sqrt(np.sum((places - TRANSPONDER[:2]) ** 2, axis=-1) + TRANSPONDER[2] ** 2)
    means = TRANSPONDER + rng.normal(size=(RUNS, 3)) * np.sqrt(np.diag(PRIOR))
    return places, exact + STD * rng.standard_normal(exact.shape), means


@loop_kernel
def solve_each(count, px, py, ranges, means, prior, settings, points, information):
    for i in range(points.shape[0]):
        solve_point(count, px[i], py[i], ranges[i], means[i], prior, settings, points[i], information[i])


def our_run(count: int, starts: np.ndarray, mirror: bool = True) -> tuple[Callable[[], int], np.ndarray]:
    """A function that solves every run once, and where the places come to lie."""
    places, ranges, means = runs(count)
    rows = np.zeros((3, RUNS, -(-count // LANES) * LANES))
    rows[:, :, :count] = places[..., 0], places[..., 1], ranges
    settings = map_settings(std_m=STD, mirror=mirror)
    points, information = starts.copy(), np.zeros((RUNS, 6))
    prior = pack(np.linalg.inv(PRIOR))

    def run() -> int:
        points[:] = starts
        solve_each(count, rows[0], rows[1], rows[2], means, prior, settings, points, information)
        return RUNS

    return run, points


def scipy_run(count: int, starts: np.ndarray, number: int = 8) -> tuple[Callable[[], int], np.ndarray]:
    """The same by scipy (MINPACK's Levenberg and Marquardt) for the first ``number`` runs."""
    from scipy.optimize import least_squares

    places, ranges, means = runs(count)
    spread = np.sqrt(np.diag(PRIOR))
    places = np.concatenate([places, np.zeros((RUNS, count, 1))], axis=-1)
    points = np.zeros((number, 3))

    def residuals(point: np.ndarray, i: int) -> np.ndarray:
        distance = np.sqrt(np.sum((point - places[i]) ** 2, axis=1))
        return np.concatenate([(point - means[i]) / spread, (distance - ranges[i]) / STD])

    def jacobian(point: np.ndarray, i: int) -> np.ndarray:
        arms = point - places[i]
        return np.concatenate([np.diag(1 / spread), arms / (STD * np.sqrt(np.sum(arms**2, axis=1)))[:, None]])

    def run() -> int:
        for i in range(number):
            points[i] = least_squares(residuals, starts[i], jacobian, args=(i,), method="lm", xtol=1e-8).x
        return number

    return run, points


def rate(run: Callable[[], int]) -> float:
    began = time.perf_counter()
    return run() / (time.perf_counter() - began)


def best_of(*candidates: Callable[[], int]) -> list[float]:
    for run in candidates:
        run()
    best = [0.0] * len(candidates)
    for _ in range(15):
        best = [max(known, rate(run)) for known, run in zip(best, candidates, strict=True)]
    return best


def main() -> None:
    """Measure and print."""
    print(f"Solutions/s on one thread; ours in batches of {RUNS}:")
    for count in COUNTS:
        places, ranges, means = runs(count)
        before = estimate_transponders(places[:, :-1], ranges[:, :-1], means, PRIOR, std_m=STD).estimate
        for name, starts in (("warm", before), ("cold", means)):
            ours, points = our_run(count, starts)
            one_side, _ = our_run(count, starts, mirror=False)
            theirs, scipy_points = scipy_run(count, starts)
            fast, faster, slow = best_of(ours, one_side, theirs)
            apart = np.linalg.norm(points[: len(scipy_points)] - scipy_points, axis=1)
            print(
                f"  {count:3} ranges, {name}: {fast:10,.0f} ({faster:10,.0f} without the look at the other side),"
                f" scipy {slow:6,.0f}: {fast / slow:6,.0f} times;"
                f" {np.sum(apart < 1e-3)} of {len(apart)} solutions the same to 1 mm"
            )
    places, ranges, means = runs(50)
    print("Through Python (estimate_transponders, 50 ranges, cold), by batch size:")
    for size in (1, 16, 256):

        def batch(size: int = size) -> int:
            estimate_transponders(places[:size], ranges[:size], means[:size], PRIOR, std_m=STD)
            return size

        print(f"  {size:4} {best_of(batch)[0]:10,.0f}")


if __name__ == "__main__":
    main()

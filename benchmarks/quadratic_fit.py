"""How fast the compiled quadratic fit runs, beside NumPy and SciPy in the same process.

``python benchmarks/quadratic_fit.py``. A fit is 20 readings in space, ten unknowns, the condition number of the design
matrix and the Newton step, on one thread. The peers get the design matrices ready made and give no
step: NumPy and SciPy one data set at a time by ``lstsq``, which gives singular values too, and NumPy's ``svd`` all
data sets in one call. Rates are the best of repetitions that alternate, by processor time: what
others do on the machine matters little.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

# Before NumPy is loaded: one thread for everybody.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402

from aquaquad_envs.estimation.quadratic_fit import METHODS, fit_quadratics  # noqa: E402

READINGS = 20
FITS = 2000
REPETITIONS = 8


def problem() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (fits, readings, 3), values with noise, and design matrices in units of their own scale."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(FITS, READINGS, 3))
    values = np.sum((points - 0.3) ** 2, axis=-1) + 0.1 * rng.normal(size=(FITS, READINGS))
    offsets = points - points[:, :1]
    offsets /= np.sqrt(np.mean(np.sum(offsets**2, axis=-1), axis=-1))[:, None, None]
    x, y, z = np.moveaxis(offsets, -1, 0)
    columns = [np.ones_like(x), x, y, z, x * x / 2, x * y, x * z, y * y / 2, y * z, z * z / 2]
    return points, values, np.stack(columns, axis=-1)


def runs() -> dict[str, Callable[[], np.ndarray]]:
    """Each way as a function that fits all and returns the condition numbers."""
    points, values, designs = problem()

    def compiled(method: str) -> Callable[[], np.ndarray]:
        return lambda: fit_quadratics(points, values, points[:, 0], method=method).condition

    def one_by_one(lstsq: Callable[..., tuple]) -> Callable[[], np.ndarray]:
        def run() -> np.ndarray:
            singular = [lstsq(d, f)[3] for d, f in zip(designs, values, strict=True)]
            return np.array([s[0] / s[-1] for s in singular])

        return run

    def batched() -> np.ndarray:
        u, s, vt = np.linalg.svd(designs, full_matrices=False)
        np.einsum("bij,bi,bi->bj", vt, 1.0 / s, np.einsum("bni,bn->bi", u, values))
        return s[:, 0] / s[:, -1]

    from scipy.linalg import lstsq

    return {
        **{f"ours, {method}": compiled(method) for method in METHODS},
        "numpy svd, batched": batched,
        "numpy lstsq": one_by_one(lambda d, f: np.linalg.lstsq(d, f, rcond=None)),
        "scipy lstsq": one_by_one(lambda d, f: lstsq(d, f, check_finite=False)),
    }


def main() -> None:
    """Measure and print."""
    ways = runs()
    found = {name: run() for name, run in ways.items()}  # compiles, too
    best = dict.fromkeys(ways, np.inf)
    for _ in range(REPETITIONS):
        for name, run in ways.items():
            begun = time.thread_time()
            run()
            best[name] = min(best[name], time.thread_time() - begun)
    print(f"{READINGS} readings, ten unknowns, condition number; one thread, {FITS} fits a call:")
    reference = found["numpy lstsq"]
    for name, seconds in best.items():
        apart = np.abs(found[name] / reference - 1.0).max()
        print(
            f"  {name:18} {FITS / seconds:9,.0f} fits/s, {1e6 * seconds / FITS:6.1f} µs each; "
            f"condition numbers within {apart:.0e} of NumPy's"
        )


if __name__ == "__main__":
    main()

"""Where sensors should stand: local optimisation of HDOP from a start, and the least that any placement can have.

With weights w_i (1 for ranges, 1/r_i² for bearings) and directions θ_i at the target the information matrix has the
trace T = Σ w_i and the eigenvalues (T ± |Σ w_i exp(2jθ_i)|)/2, hence HDOP² = 4T / (T² - |Σ w_i exp(2jθ_i)|²).
Its least over the directions is found in closed form: the sum of the 2θ_i-vectors can be closed to 0 if no weight
exceeds all others together, and to the excess D = 2 max w - T if one does:

    HDOP ≥ 2 √(T / (T² - D²)),  D = max(0, 2 max w_i - T).

For ranges this is 2/√N whatever the distances, for bearings at a common range r 2r/√N (SPEC §5). The sum is
stationary only where it is 0 or where all its vectors are collinear, and of the collinear ones only that of an
outweighing sensor is a minimum: over the directions every local minimum is a global one. TDOA has no such guarantee.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.estimation.hdop import even_spread_hdop, hdop

#: What MATLAB's fminunc does by default: at most this many iterations, to this relative first-order optimality.
MAX_ITERATIONS = 400
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Placement:
    """A local optimum and the way to it."""

    sensors: np.ndarray  # (N, 2), m
    hdop: float  # there: m/rad, 1 or m/s
    path: np.ndarray  # (iterations + 1, N, 2), m, from the start on
    path_hdop: np.ndarray  # (iterations + 1,)
    converged: bool  # first-order optimality within tolerance; not where HDOP falls to 0 on the target


def least_hdop(kind: str, ranges_m: Any) -> float:
    """The global optimum over all directions of sensors at ``ranges_m`` (N,) > 0 from the target, N ≥ 2.

    ``kind``: ``"range"`` (1) or ``"bearing"`` (m/rad); ``"tdoa"`` (m/s at 1500 m/s, all pairs, N ≥ 3): 2c/N, which no
    placement is under. ``inf`` where a single sensor outweighs all others beyond rounding. Raises
    ``InvalidParameterError``.
    """
    check_choice("kind", kind, ("range", "bearing", "tdoa"))
    ranges = np.asarray(ranges_m, dtype=float)
    if ranges.ndim != 1 or len(ranges) < 2 or not ((ranges > 0) & np.isfinite(ranges)).all():
        raise InvalidParameterError("ranges_m", ranges_m, "at least two positive finite ranges, m")
    if kind == "tdoa":
        return even_spread_hdop("tdoa", len(ranges))
    # In units of the least range, so that squares neither overflow nor vanish.
    scale = ranges.min() if kind == "bearing" else 1.0
    weights = (scale / ranges) ** 2 if kind == "bearing" else np.ones(len(ranges))
    total, greatest = weights.sum(), weights.max()
    others = np.sort(weights)[:-1].sum()
    # T² - D² = (T - D)(T + D); where one outweighs the others 2 Σ others · 2 max w.
    product = total * total if greatest <= others else 4.0 * others * greatest
    return float(scale * 2.0 * np.sqrt(total / product)) if product > 0 else float("inf")


def place(kind: str, start: Any, target: Any = (0.0, 0.0), *, standoff_m: float = 0.0) -> Placement:
    """Move sensors from ``start`` (N, 2), m, to a local minimum of HDOP about ``target`` (2,), m.

    BFGS with differences for gradients, as published (fminunc), on all 2N coordinates. ``standoff_m`` > 0 keeps every
    sensor at least so far from the target: bounded L-BFGS in range and direction; a start that is nearer is moved out.
    Without it the least bearing HDOP is 0, on the target. Raises ``InvalidParameterError``.
    """
    from scipy.optimize import minimize

    check_choice("kind", kind, ("range", "bearing", "tdoa"))
    check_range("standoff_m", standoff_m, 0, 1e9)
    about = np.asarray(target, dtype=float)
    first = np.asarray(start, dtype=float)
    if first.ndim != 2 or first.shape[1] != 2 or len(first) < 3 or not np.isfinite(first).all():
        raise InvalidParameterError(
            "start", first.shape, "finite positions, m, of shape (N, 2), N at least 3"
        )
    arms = first - about
    scale = float(np.hypot(*arms.T).mean())
    unit = float(hdop(kind, first, about))
    if not np.isfinite(unit):
        raise InvalidParameterError(
            "start", unit, "a finite HDOP at the start", "Spread the sensors a little."
        )

    def sensors_at(free: np.ndarray) -> np.ndarray:
        if standoff_m > 0:
            radius, angle = free.reshape(2, -1)
            return about + scale * (radius * np.array([np.cos(angle), np.sin(angle)])).T
        return about + scale * free.reshape(-1, 2)

    def cost(free: np.ndarray) -> float:
        return float(hdop(kind, sensors_at(free), about)) / unit

    if standoff_m > 0:
        radii, angles = np.hypot(*arms.T), np.arctan2(arms[:, 1], arms[:, 0])
        begin = np.concatenate([np.maximum(radii, standoff_m) / scale, angles])
        bounds = [(standoff_m / scale, None)] * len(first) + [(None, None)] * len(first)
        options: dict[str, Any] = {
            "method": "L-BFGS-B", "bounds": bounds, "options": {"maxiter": MAX_ITERATIONS, "gtol": TOLERANCE},
        }  # fmt: skip
    else:
        begin = arms.ravel() / scale
        options = {"method": "BFGS", "options": {"maxiter": MAX_ITERATIONS, "gtol": TOLERANCE}}
    ways = [begin.copy()]
    with np.errstate(invalid="ignore", over="ignore"):
        # A line search may step onto the target, where HDOP is inf and a difference of two NaN.
        found = minimize(cost, begin, callback=lambda free: ways.append(np.array(free)), **options)
    # A last step that was not accepted may be worse than an earlier one.
    ways.append(found.x)
    path = np.stack([sensors_at(free) for free in ways])
    values = np.array([float(hdop(kind, sensors, about)) for sensors in path])
    best = int(np.argmin(values))
    return Placement(
        path[best], float(values[best]), path[: best + 1], values[: best + 1], bool(found.success)
    )


def largest_gap(sensors: Any, target: Any = (0.0, 0.0)) -> float:
    """The widest angle, rad, seen from ``target`` without a sensor in it: π and more is a one-sided placement."""
    arms = np.asarray(sensors, dtype=float) - np.asarray(target, dtype=float)
    angles = np.sort(np.arctan2(arms[:, 1], arms[:, 0]))
    return float(np.max(np.diff(angles, append=angles[0] + 2.0 * np.pi)))

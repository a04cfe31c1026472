"""Horizontal dilution of precision (HDOP) and Cramér–Rao ellipse of a team of sensors about a target.

H is the Jacobian of the measurements with respect to the target's (x, y), one row a measurement
(Dillard 2014, IV.A); R their covariance, diag(σ²). The information matrix is J = HᵀH, or
HᵀR⁻¹H where standard deviations are given, and

    HDOP = sqrt(trace(J⁻¹)),   Cramér–Rao ellipse: eᵀ J e = k².

Without R the unit is that of a metre per unit of measurement: m/rad (bearing), 1 (range), m/s (TDOA); with R it
is m, the least standard deviation of position that an unbiased estimate can have. Range-only HDOP
does not depend on the distance (the thesis says that it improves with range: an erratum).
Singular geometry is ``inf``, never NaN or an exception: less than two independent directions, or a sensor that
stands on the target and has no direction to it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.sensing.measurements import BEARING, KINDS, RANGE, TDOA, measurement_gradient

#: k of the ellipse that holds 95 % of a normal error: sqrt(χ²₂ quantile), SPEC's 2.4477.
SCALE_95 = float(np.sqrt(-2.0 * np.log(0.05)))


@kernel
def _regular(a, b, d):
    """Whether [[a, b], [b, d]] is not singular to a part in 10¹², and its eigenvalues within 10²⁴ of each other.

    Written so that NaN (weights that overflow, a sensor all but on the target) is singular too. The second bound
    catches a line of sensors along an axis, where a·d itself is but rounding.
    """
    determinant = a * d - b * b
    return determinant > 1e-12 * a * d and determinant > 1e-24 * (a + d) * (a + d)


@kernel
def hdop_of_information(a, b, d):
    """sqrt(trace(J⁻¹)) of J = [[a, b], [b, d]]; ``inf`` where J is singular to rounding."""
    determinant = a * d - b * b
    if not _regular(a, b, d):
        return np.inf
    return np.sqrt((a + d) / determinant)


@kernel
def bearing_hdop(x, y, team, target_x, target_y):
    """HDOP, m/rad, of bearings from a sensor at (x, y) and from ``team`` (n, 2), m, to the target.

    Row of sensor i: [-(y_t - y_i), x_t - x_i] / r_i². ``inf`` where fewer than two sensors
    bear, all bearings are collinear, or a sensor stands on the target.
    """
    a = 0.0
    b = 0.0
    d = 0.0
    for i in range(team.shape[0] + 1):
        if i < team.shape[0]:
            dx = target_x - team[i, 0]
            dy = target_y - team[i, 1]
        else:
            dx = target_x - x
            dy = target_y - y
        r2 = dx * dx + dy * dy
        if r2 <= 0.0:
            return np.inf
        a += dy * dy / (r2 * r2)
        b -= dx * dy / (r2 * r2)
        d += dx * dx / (r2 * r2)
    return hdop_of_information(a, b, d)


@kernel
def position_information(kinds, sensors, others, sigmas, mask, count, x, y, sound_speed):
    """(J_xx, J_xy, J_yy) of the first ``count`` measurements about a target at (x, y), m.

    kinds: (m,) codes BEARING, RANGE, TDOA; sensors, others: (m, 2), m; sigmas: (m,) standard deviations in rad,
    m or s (all 1 for J = HᵀH); mask: (m,) True where measured; sound_speed in m/s. A sensor on
    the target has no direction and gives nothing.
    """
    a = 0.0
    b = 0.0
    d = 0.0
    for i in range(count):
        if mask[i]:
            gx, gy = measurement_gradient(
                kinds[i], x, y, sensors[i, 0], sensors[i, 1], others[i, 0], others[i, 1], sound_speed
            )
            inverse = 1.0 / sigmas[i]
            gx *= inverse
            gy *= inverse
            a += gx * gx
            b += gx * gy
            d += gy * gy
    return a, b, d


@kernel
def stands_on(kinds, sensors, others, mask, count, x, y):
    """Whether any of the first ``count`` sensors that measure is on (x, y): so near that its direction is lost."""
    for i in range(count):
        if mask[i]:
            dx = x - sensors[i, 0]
            dy = y - sensors[i, 1]
            if not dx * dx + dy * dy > 1e-300:
                return True
            if kinds[i] == TDOA:
                dx = x - others[i, 0]
                dy = y - others[i, 1]
                if not dx * dx + dy * dy > 1e-300:
                    return True
    return False


@kernel
def team_hdop(kinds, sensors, others, sigmas, mask, count, x, y, sound_speed):
    """HDOP of any mix of measurements, arguments as :func:`position_information`; ``inf`` where singular.

    In m with standard deviations ``sigmas``. For HᵀH of one kind set them all to 1 (a mix of kinds without
    R adds different units and has no meaning).
    """
    if stands_on(kinds, sensors, others, mask, count, x, y):
        return np.inf
    a, b, d = position_information(kinds, sensors, others, sigmas, mask, count, x, y, sound_speed)
    return hdop_of_information(a, b, d)


@kernel
def ellipse_of_information(a, b, d):
    """Semi-axes (major, minor), m, and direction of the major one, rad in (-π/2, π/2], of eᵀ J e = 1.

    J = [[a, b], [b, d]]. The major axis is ``inf`` where J is singular, both where it is 0.
    """
    half = 0.5 * (a - d)
    root = np.sqrt(half * half + b * b)
    great = 0.5 * (a + d) + root
    if not great > 0.0:
        return np.inf, np.inf, 0.0
    # The determinant over the greater eigenvalue keeps the digits of the lesser one.
    determinant = a * d - b * b
    minor = 1.0 / np.sqrt(great)
    # Across the eigenvector of the greater eigenvalue; adding 0 turns a negative zero into a positive one.
    angle = 0.5 * np.arctan2(-b + 0.0, -half + 0.0)
    if not _regular(a, b, d):
        return np.inf, minor, angle
    return np.sqrt(great / determinant), minor, angle


class Ellipse(NamedTuple):
    """A Cramér–Rao ellipse: semi-axes, m, and direction of the major one, rad from east."""

    semi_major_m: float
    semi_minor_m: float
    angle: float


def all_pairs(count: int) -> np.ndarray:
    """Index pairs (i, j), i < j, of ``count`` sensors: (pairs, 2). For three (0, 1), (0, 2), (1, 2)."""
    return np.stack(np.triu_indices(count, 1), axis=-1)


@loop_kernel
def _hdop_map(kinds, sensors, others, sigmas, mask, targets, sound_speed, out):
    for i in range(targets.shape[0]):
        out[i] = team_hdop(
            kinds, sensors, others, sigmas, mask, kinds.shape[0], targets[i, 0], targets[i, 1], sound_speed
        )


@loop_kernel
def _information(kinds, sensors, others, sigmas, mask, x, y, sound_speed):
    if stands_on(kinds, sensors, others, mask, kinds.shape[0], x, y):
        return np.nan, np.nan, np.nan
    return position_information(kinds, sensors, others, sigmas, mask, kinds.shape[0], x, y, sound_speed)


def hdop(
    kind: str,
    sensors: Any,
    targets: Any,
    *,
    stds: Any = None,
    pairs: Any = None,
    sound_speed_m_s: float = 1500.0,
) -> np.ndarray:
    """HDOP of ``sensors`` (n, 2), m, about each of ``targets`` (..., 2), m: shape (...).

    ``kind``: ``"bearing"``, ``"range"`` or ``"tdoa"``. stds: standard deviation of each measurement or
    one for all, in rad, m or s; without it J = HᵀH. pairs: (m, 2) indices of the sensors of each TDOA,
    by default :func:`all_pairs`. ``inf`` where singular. Raises ``InvalidParameterError``.
    """
    rows = _rows(kind, sensors, stds, pairs, sound_speed_m_s)
    targets = _points("targets", targets, None)
    out = np.empty(targets.shape[:-1])
    flat = np.ascontiguousarray(targets.reshape(-1, 2))
    _hdop_map(*rows, flat, float(sound_speed_m_s), out.reshape(-1))
    return out


def cramer_rao_ellipse(
    kind: str,
    sensors: Any,
    target: Any,
    *,
    stds: Any = None,
    pairs: Any = None,
    scale: float = SCALE_95,
    sound_speed_m_s: float = 1500.0,
) -> Ellipse:
    """Ellipse eᵀ J e = ``scale``² about ``target`` (2,), of 95 % for normal errors by default.

    Other arguments as :func:`hdop`. The semi-major axis is ``inf`` where the geometry is singular, both
    where nothing is measured or a sensor stands on the target. Raises ``InvalidParameterError``.
    """
    rows = _rows(kind, sensors, stds, pairs, sound_speed_m_s)
    check_range("scale", scale, 0, 1e6, open_low=True)
    x, y = (float(value) for value in _points("target", target, 1))
    major, minor, angle = ellipse_of_information(*_information(*rows, x, y, float(sound_speed_m_s)))
    return Ellipse(float(scale * major), float(scale * minor), float(angle))


def two_sensor_hdop(kind: str, sensors: Any, targets: Any) -> np.ndarray:
    """Closed form for two sensors, φ the angle at the target between them, r1 and r2 the ranges, m.

    Bearing: √(r1² + r2²) / |sin φ|, m/rad; range: √2 / |sin φ|, independent of range. ``inf`` where the
    target is collinear with the sensors. Two sensors give one TDOA, which fixes no position.
    """
    check_choice("kind", kind, ("bearing", "range"))
    sensors = _points("sensors", sensors, 2)
    if len(sensors) != 2:
        raise InvalidParameterError("sensors", sensors.shape, "two positions, shape (2, 2)")
    arms = _points("targets", targets, None)[..., None, :] - sensors
    ranges = np.hypot(arms[..., 0], arms[..., 1])
    cross = np.abs(arms[..., 0, 0] * arms[..., 1, 1] - arms[..., 0, 1] * arms[..., 1, 0])
    product = ranges[..., 0] * ranges[..., 1]
    above = (
        np.hypot(ranges[..., 0], ranges[..., 1]) if kind == "bearing" else np.full(product.shape, np.sqrt(2))
    )
    # sin φ of collinear points is rounding: the same bound as the kernels', which compare squares.
    regular = cross > 1e-6 * product
    return np.divide(above * product, cross, out=np.full(product.shape, np.inf), where=regular)


def even_spread_hdop(
    kind: str, count: int, *, range_m: float = 1.0, sound_speed_m_s: float = 1500.0
) -> float:
    """HDOP of ``count`` ≥ 3 sensors evenly about the target at ``range_m``, the least at that range.

    Bearing 2r/√N, range 2/√N, TDOA over all pairs 2c/N (SPEC §5; the last by Σ_{i<j} (e_i - e_j)(e_i - e_j)ᵀ =
    N²/2 · I for evenly spread unit vectors e).
    """
    check_choice("kind", kind, KINDS)
    check_range("count", count, 3, 1e9)
    check_range("range_m", range_m, 0, 1e12, open_low=True)
    check_range("sound_speed_m_s", sound_speed_m_s, 1, 1e5)
    code = KINDS[kind]
    if code == BEARING:
        return float(2.0 * range_m / np.sqrt(count))
    return float(2.0 / np.sqrt(count)) if code == RANGE else float(2.0 * sound_speed_m_s / count)


def _points(name: str, values: Any, dimensions: int | None) -> np.ndarray:
    points = np.asarray(values, dtype=np.float64)
    right = points.ndim >= 1 if dimensions is None else points.ndim == dimensions
    if not right or points.shape[-1] != 2 or not np.isfinite(points).all():
        raise InvalidParameterError(name, points.shape, "finite positions, m, of shape (..., 2)")
    return points


def _rows(kind: str, sensors: Any, stds: Any, pairs: Any, sound_speed_m_s: float) -> tuple[np.ndarray, ...]:
    """Kinds, sensors, others, standard deviations and mask as kernels read them."""
    check_choice("kind", kind, KINDS)
    check_range("sound_speed_m_s", sound_speed_m_s, 1, 1e5)
    here = there = _points("sensors", sensors, 2)
    if kind == "tdoa":
        chosen = np.asarray(all_pairs(len(here)) if pairs is None else pairs)
        whole = np.issubdtype(chosen.dtype, np.integer) and chosen.ndim == 2 and chosen.shape[1] == 2
        if not whole or (chosen.size and not (chosen.min() >= 0 and chosen.max() < len(here))):
            raise InvalidParameterError("pairs", pairs, f"(m, 2) indices of {len(here)} sensors")
        here, there = here[chosen[:, 0]], there[chosen[:, 1]]
    elif pairs is not None:
        raise InvalidParameterError("pairs", pairs, "None where kind is not 'tdoa'")
    count = len(here)
    try:
        sigmas = np.broadcast_to(np.asarray(1.0 if stds is None else stds, dtype=np.float64), (count,)).copy()
    except ValueError:
        raise InvalidParameterError("stds", np.shape(stds), f"one number, or {count}") from None
    if not ((sigmas > 0) & np.isfinite(sigmas)).all():
        raise InvalidParameterError("stds", stds, "positive finite standard deviations")
    kinds = np.full(count, KINDS[kind], dtype=np.int64)
    return kinds, np.ascontiguousarray(here), np.ascontiguousarray(there), sigmas, np.ones(count, dtype=bool)

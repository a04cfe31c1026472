"""Sound rays in water whose speed changes with depth alone, linearly within each layer.

Snell's law: p = sin θ / c is constant along a ray, θ the angle from the downward vertical
(Dillard 2014, eq. II.2). In a layer c = c_a + g (z - z_a) that makes the ray an exact circular arc of radius
1/(p g); from (z_a, cos θ_a) to (z_b, cos θ_b), both going the same way, with cos θ = ±√(1 - p² c²),

    Δx = (cos θ_a - cos θ_b)/(p g)             = p (c_a + c_b) Δz / (cos θ_a + cos θ_b)
    Δt = (artanh cos θ_a - artanh cos θ_b)/g   = artanh(g q)/g,
    q  = Δz (c_a + c_b)(1 + cos θ_a cos θ_b) / ((cos θ_a + cos θ_b)(c_a² + c_b² - p² c_a² c_b²)).

The right-hand forms are the ones used: they keep their digits, and hold, for a gradient of 0 and for vertical
rays. A ray turns where p c reaches 1. It is mirrored at the surface, and at the bottom if asked to.
Ray theory holds where the speed changes little within a wavelength; it has no amplitude here, no
diffraction, and no leakage out of a duct.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aquaquad_envs.errors import InvalidParameterError, check_choice, check_range
from aquaquad_envs.sensing.profiles import SoundSpeedProfile

#: What may happen where one leg of a ray ends and the next begins.
EVENTS = ("launch", "layer", "turn", "surface", "bottom", "end")


@dataclass(frozen=True, kw_only=True, eq=False)
class Ray:
    """A traced ray: vertices 0..n, and between vertices i and i + 1 one leg, an arc in a single layer.

    All arrays have one entry a vertex, but ``cosines`` and ``gradients`` one a leg: the cosine
    of the angle at its start and the gradient of sound speed in it.
    """

    parameter: float  # p = sin θ / c, s/m
    range_m: np.ndarray
    depth_m: np.ndarray
    time_s: np.ndarray
    speed_m_s: np.ndarray
    events: tuple[str, ...]
    cosines: np.ndarray
    gradients: np.ndarray
    complete: bool  # False: absorbed, or out of legs, before its range

    def count(self, event: str) -> int:
        """How often the ray met ``event``, one of :data:`EVENTS`."""
        check_choice("event", event, EVENTS)
        return self.events.count(event)

    def depth_at(self, range_m: npt.ArrayLike) -> Any:
        """Depth, m, on the exact arcs at each horizontal range, m; raises where the ray does not reach."""
        return self._along(range_m)[0]

    def time_at(self, range_m: npt.ArrayLike) -> Any:
        """Travel time, s, at each horizontal range, m; raises where the ray does not reach."""
        return self._along(range_m)[1]

    def angle_at(self, range_m: npt.ArrayLike) -> Any:
        """Angle, rad from the downward vertical, at each horizontal range, m."""
        return self._along(range_m)[2]

    def _along(self, range_m: npt.ArrayLike) -> tuple[Any, Any, Any]:
        x = np.asarray(range_m, dtype=np.float64)
        if not ((x >= 0) & (x <= self.range_m[-1])).all():
            raise InvalidParameterError("range_m", range_m, f"ranges in [0, {self.range_m[-1]:g}] m")
        leg = np.clip(np.searchsorted(self.range_m, x, side="right") - 1, 0, len(self.cosines) - 1)
        cosine, gradient, c = self.cosines[leg], self.gradients[leg], self.speed_m_s[leg]
        step = x - self.range_m[leg]
        end_cosine, drop = _advance(self.parameter, cosine, gradient, c, step)
        depth = self.depth_m[leg] + drop
        time = self.time_s[leg] + _leg_time(self.parameter, cosine, end_cosine, gradient, c, drop, step)
        found = depth, time, np.arccos(end_cosine)
        return tuple(float(v) for v in found) if x.ndim == 0 else found  # type: ignore[return-value]


def _advance(p: float, cosine: Any, gradient: Any, c: Any, step: Any) -> tuple[Any, Any]:
    """Cosine at the end and change of depth after a horizontal ``step`` from speed ``c`` within one layer."""
    end = np.clip(cosine - p * gradient * step, -1.0, 1.0)
    return end, step * (cosine + end) / (p * c + np.sqrt(1.0 - end * end))


def _leg_time(p: float, cosine: Any, end: Any, gradient: Any, c: Any, drop: Any, step: Any) -> Any:
    """Travel time over a leg: the module's Δt, with Δz and Δx tied by Snell's law.

    Δz / (cos θ_a + cos θ_b) = Δx / (p (c_a + c_b)) also holds where a leg passes its turning point or is
    level, and both are 0; which of the two is better conditioned decides.
    """
    end_c = c + gradient * drop
    total = cosine + end
    shallow = np.abs(total) < 1.0
    ratio = np.where(shallow, step / (p * (c + end_c)), drop / np.where(shallow, 1.0, total))
    q = ratio * (c + end_c) * (1.0 + cosine * end) / (c * c + end_c * end_c - (p * c * end_c) ** 2)
    gq = gradient * q
    small = np.abs(gq) < 1e-4
    series = 1.0 + gq * gq / 3.0
    return q * np.where(small, series, np.arctanh(gq) / np.where(small, 1.0, gq))


def trace_ray(
    profile: SoundSpeedProfile,
    *,
    source_depth_m: float,
    angle: float,
    max_range_m: float,
    bottom: str = "reflect",
    max_legs: int = 10_000,
) -> Ray:
    """The ray launched at ``angle`` from ``source_depth_m`` until ``max_range_m``.

    ``angle`` in rad from the downward vertical, in (0, π): below π/2 the ray goes down, above it up,
    at π/2 towards the lower speed. ``bottom`` is "reflect" or "absorb". A steep ray may run out of
    ``max_legs`` first; then, as when absorbed, ``complete`` is False. Raises
    ``InvalidParameterError`` for values outside their bounds.
    """
    check_range("source_depth_m", source_depth_m, 0, profile.bottom_m)
    if not 0.0 < angle < math.pi:
        raise InvalidParameterError("angle", angle, "a number in (0, π), rad from the downward vertical")
    check_range("max_range_m", max_range_m, 0, 1e8, open_low=True)
    check_choice("bottom", bottom, ("reflect", "absorb"))
    check_range("max_legs", max_legs, 1, 10_000_000)

    depths, speeds, gradients = profile.depths_m, profile.speeds_m_s, profile.gradients
    x, z, t, c = 0.0, float(source_depth_m), 0.0, profile.speed(source_depth_m)
    p = math.sin(angle) / c
    level = abs(angle - math.pi / 2) < 1e-12
    down = _bends_down(profile, z) if level else angle < math.pi / 2
    layer = _layer_of(depths, z, bool(down))
    cosine = 0.0 if level else math.cos(angle)
    vertices, events = [(x, z, t, c)], ["launch"]
    cosines: list[float] = []
    layer_gradients: list[float] = []
    complete = False

    while len(cosines) < max_legs:
        g = 0.0 if down is None else float(gradients[layer])
        target = layer + 1 if down else layer
        end_z, end_c, event = float(depths[target]), float(speeds[target]), "layer"
        if down is None:  # level for ever
            end_z, end_c, end_cosine = z, c, 0.0
        elif p * end_c >= 1.0:
            # Turns on the way. Where c itself is all but 1/p already, rounding must not send it back.
            end_c = max(1.0 / p, c)
            end_z = z + (end_c - c) / g if g != 0.0 else z
            end_cosine, event = 0.0, "turn"
        else:
            end_cosine = math.copysign(math.sqrt(max(0.0, 1.0 - (p * end_c) ** 2)), 1.0 if down else -1.0)
        total = cosine + end_cosine
        step = math.inf if total == 0.0 else p * (c + end_c) * (end_z - z) / total
        cosines.append(cosine)
        layer_gradients.append(g)
        if x + step >= max_range_m:
            step = max_range_m - x
            end_cosine, drop = _advance(p, cosine, g, c, step)
            t += float(_leg_time(p, cosine, end_cosine, g, c, drop, step))
            z = float(z + drop)
            vertices.append((max_range_m, z, t, profile.speed(z)))
            events.append("end")
            complete = True
            break
        t += float(_leg_time(p, cosine, end_cosine, g, c, end_z - z, step))
        x, z, c, cosine = x + step, end_z, end_c, end_cosine
        if event == "turn":
            down = not down
        elif target == 0:
            event, down, cosine = "surface", True, -cosine
        elif target == len(depths) - 1:
            event, down, cosine = "bottom", False, -cosine
        else:
            layer += 1 if down else -1
        vertices.append((x, z, t, c))
        if event == "bottom" and bottom == "absorb":
            events.append("bottom")
            break
        events.append(event)

    columns = np.array(vertices).T
    return Ray(
        parameter=p,
        range_m=columns[0],
        depth_m=columns[1],
        time_s=columns[2],
        speed_m_s=columns[3],
        events=tuple(events),
        cosines=np.array(cosines),
        gradients=np.array(layer_gradients),
        complete=complete,
    )


def _layer_of(depths: np.ndarray, z: float, down: bool) -> int:
    """Layer that a ray at depth ``z`` goes through next."""
    index = np.searchsorted(depths, z, side="right" if down else "left")
    return min(max(int(index) - 1, 0), len(depths) - 2)


def _bends_down(profile: SoundSpeedProfile, z: float) -> bool | None:
    """Whether a level ray at ``z`` bends down, up (False) or not at all (None): towards the lower speed."""
    below = profile.gradients[_layer_of(profile.depths_m, z, True)]
    above = profile.gradients[_layer_of(profile.depths_m, z, False)]
    if z < profile.bottom_m and below < 0:
        return True
    if z > 0 and above > 0:
        return False
    return None

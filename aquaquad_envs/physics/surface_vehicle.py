"""A surface vehicle that holds its speed and turns: p(n+1) = p(n) + R_z(φ(n+1)) v T, φ(n+1) = φ(n) + ω(n) T.

Position (x, y) in m, x east, y north; heading φ in rad from east, counter-clockwise; yaw rate ω in rad/s; still water:
what a current adds is added by the caller. The published vehicle of transponder localization (SPEC §8).
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel


@kernel
def turn_and_go(x, y, heading, yaw_rate, speed, dt):
    """Position, m, and heading, rad in [-π, π], after turning at ``yaw_rate`` and going on at ``speed`` for ``dt`` s.

    The turn comes first, as published: the whole step is made at the new heading.
    """
    new_heading = heading + yaw_rate * dt
    new_heading -= 2.0 * np.pi * np.round(new_heading / (2.0 * np.pi))
    return x + speed * dt * np.cos(new_heading), y + speed * dt * np.sin(new_heading), new_heading

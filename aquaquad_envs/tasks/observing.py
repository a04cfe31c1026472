"""How worlds of all tasks scale what they observe to [-1, 1]."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel

#: Speed that scales current observations, m/s.
CURRENT_SCALE = 2.0


@kernel
def unit(value):
    """``value`` held in [-1, 1], without branches."""
    value = value if value > -1.0 else -1.0
    return value if value < 1.0 else 1.0


@kernel
def local_time(now, c):
    """Sine and cosine of the local solar time (a day is one turn) at ``now`` s on the clock."""
    angle = 2.0 * np.pi * (now + c.clock_offset) / 86400.0
    return unit(np.sin(angle)), unit(np.cos(angle))

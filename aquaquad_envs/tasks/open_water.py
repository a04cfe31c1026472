"""Places on open water, drawn at random: shared by the worlds of all tasks."""

from __future__ import annotations

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.obstacles import clearance_at
from aquaquad_envs.physics.randomness import uniform_in_disc
from aquaquad_envs.physics.vehicle import inside_box


@kernel
def open_water_near(state, ocean, c, obstacle, x0, y0, spread):
    """A point within ``spread`` of (x0, y0), in the box and in open water; (x0, y0) after 100 tries."""
    if spread <= 0.0:
        return x0, y0
    for _ in range(100):
        dx, dy = uniform_in_disc(state)
        x, y = x0 + spread * dx, y0 + spread * dy
        clear = clearance_at(ocean.clearance, obstacle, ocean.clearance_grid, x, y) > 0.0
        if clear and inside_box(x, y, c.half_width):
            return x, y
    return x0, y0

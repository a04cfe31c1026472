"""The plume of a world: born before the mission, carried on with every step, read at any place; compiled."""

from __future__ import annotations

from aquaquad_envs.compilation import kernel, loop_kernel
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.sensing.plume import PLUME, source_reading
from aquaquad_envs.sensing.plume_puffs import (
    advance_meander,
    carry,
    concentration_at,
    present_frame,
    puff_widths,
    released_by,
    scatter,
)


@kernel
def puffs_alive(w, c):
    """Puffs of the ring that hold something."""
    return min(w.released, c.puffs.size)


@kernel
def _place_puff(w, k, x, y, z, now, dt, velocity, field, axes, c):
    """Slot ``k``: a puff that was at (x, y, z) at time ``now``, ``dt`` s later."""
    x, y = carry(x, y, now, dt, velocity, field, axes, w.meander_u, w.meander_v, c.euler)
    if c.puffs.scatter > 0.0:
        x, y, z = scatter(x, y, z, dt, c.puffs, w.rng_field)
    w.puff_x[k] = x
    w.puff_y[k] = y
    w.puff_z[k] = z


@kernel
def _advance_in(w, begin, end, velocity, field, axes, c):
    now = w.clock_s + begin
    for k in range(puffs_alive(w, c)):
        _place_puff(w, k, w.puff_x[k], w.puff_y[k], w.puff_z[k], now, end - begin, velocity, field, axes, c)
    due = released_by(end, -c.plume_age, c.puffs.period)
    while w.released < due:
        birth = w.released * c.puffs.period - c.plume_age
        k = w.released % c.puffs.size
        _place_puff(
            w, k, w.source_x, w.source_y, w.source_z, w.clock_s + birth, end - birth, velocity, field, axes, c
        )
        w.puff_birth[k] = birth
        w.released += 1


@loop_kernel
def advance_plume(w, begin, end, ocean, c, frame):
    """Carry, scatter and release puffs from mission time ``begin`` to ``end``, s; ``frame`` is scratch memory."""
    w.meander_u, w.meander_v = advance_meander(w.meander_u, w.meander_v, end - begin, c.puffs, w.rng_field)
    if c.euler:
        # One time serves all: the current of a step is that of its begin.
        present_frame(ocean.velocity, w.truth, ocean.axes, w.clock_s + begin, frame)
        _advance_in(w, begin, end, frame, 0, ocean.axes, c)
    else:
        _advance_in(w, begin, end, ocean.velocity, w.truth, ocean.axes, c)


@kernel
def start_plume(w, ocean, c, frame):
    """The plume as it is at mission time 0, ``c.plume_age`` s after its source began; needs clock, field, source."""
    w.released = 0
    w.meander_u = 0.0
    w.meander_v = 0.0
    if c.source.kind != PLUME:
        return
    if c.puffs.meander_std > 0.0:
        w.meander_u = c.puffs.meander_std * normal(w.rng_field)
        w.meander_v = c.puffs.meander_std * normal(w.rng_field)
    began = -c.plume_age
    pieces = int(c.plume_age / c.puffs.period) + 1
    dt = c.plume_age / pieces
    for k in range(pieces):
        advance_plume(w, began + k * dt, began + (k + 1) * dt, ocean, c, frame)


@kernel
def prepare_reading(w, c, s):
    """Widths and peaks of the puffs at the present time, for :func:`true_reading`."""
    if c.source.kind == PLUME:
        puff_widths(w.puff_birth, w.time_s, c.puffs, s.inverse, s.peak, puffs_alive(w, c))


@kernel
def true_reading(w, x, y, z, c, s):
    """The field at (x, y, z), m, without a sensor's errors."""
    if c.source.kind == PLUME:
        return concentration_at(
            w.puff_x,
            w.puff_y,
            w.puff_z,
            s.inverse,
            s.peak,
            puffs_alive(w, c),
            s.work,
            s.near,
            c.depth,
            x,
            y,
            z,
        )
    return source_reading(c.source, x - w.source_x, y - w.source_y, z - w.source_z)

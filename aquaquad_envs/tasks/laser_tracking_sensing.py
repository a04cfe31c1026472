"""What the quadrotor of laser tracking measures."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.sensing.laser import detectable_radius, intensity, reading

#: m; the light is computed for no less height over the source.
LEAST_HEIGHT = 0.1


@kernel
def height_of(world):
    """Height of the receiver over the source, m."""
    return max(world.altitude + world.depth, LEAST_HEIGHT)


@kernel
def find_light(world, c):
    """The truth about the light at the receiver: distance from the axis, intensity, whether in the detectable area."""
    dx = world.rov_x - world.x
    dy = world.rov_y - world.y
    height = height_of(world)
    world.range_m = np.sqrt(dx * dx + dy * dy)
    world.light = intensity(c.beam, world.range_m, height)
    world.in_lda = 1 if world.range_m <= detectable_radius(c.beam, height) else 0


@kernel
def _vary_ambient(world, dt, c):
    """Ambient light, W/m²: 1 + variation times an Ornstein–Uhlenbeck process of unit variance, never negative."""
    kept = np.exp(-dt / c.ambient_time)
    world.ambient_state = kept * world.ambient_state + np.sqrt(1.0 - kept * kept) * normal(world.rng_field)
    world.ambient = c.beam.ambient * max(1.0 + c.ambient_variation * world.ambient_state, 0.0)


@kernel
def _fix(world, c):
    """An acoustic fix of the submerged vehicle."""
    world.fix_x = world.rov_x + c.fix_std * normal(world.rng_sensor)
    world.fix_y = world.rov_y
    if c.axes == 2:
        world.fix_y += c.fix_std * normal(world.rng_sensor)
    world.fix_s = world.time_s


@kernel
def measure(world, dt, c):
    """Readings ``dt`` s after the last: light, own motion, the submerged vehicle's velocity, a fix when it is due.

    Of a velocity that is not known, nothing; as far as it is, ``carried`` adds it up.
    """
    if c.ambient_variation > 0.0:
        _vary_ambient(world, dt, c)
    world.reading = reading(
        world.light, world.ambient, c.noise_std, c.levels, c.full_scale, normal(world.rng_sensor)
    )
    world.own_x = world.x + c.position_std * normal(world.rng_sensor)
    world.own_u = world.u + c.velocity_std * normal(world.rng_sensor)
    if c.axes == 2:
        world.own_y = world.y + c.position_std * normal(world.rng_sensor)
        world.own_v = world.v + c.velocity_std * normal(world.rng_sensor)
    if c.rov_velocity_known:
        world.seen_u = world.rov_u + c.rov_velocity_std * normal(world.rng_sensor)
        world.carried_x += world.seen_u * dt
        if c.axes == 2:
            world.seen_v = world.rov_v + c.rov_velocity_std * normal(world.rng_sensor)
            world.carried_y += world.seen_v * dt
    # A microsecond of grace: rounding of the clock must not delay a fix.
    if world.time_s >= world.fix_s + c.fix_period - 1e-6:
        _fix(world, c)


@kernel
def start_sensing(world, c):
    """First readings of an episode."""
    world.own_y = 0.0
    world.own_v = 0.0
    world.seen_u = 0.0
    world.seen_v = 0.0
    world.carried_x = 0.0
    world.carried_y = 0.0
    world.ambient = c.beam.ambient
    world.ambient_state = 0.0
    world.fix_s = -2.0 * c.fix_period
    if c.ambient_variation > 0.0:
        world.ambient_state = normal(world.rng_field)
    measure(world, 0.0, c)

"""What the quadrotor of laser tracking measures, and what it remembers of that."""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.physics.randomness import normal
from aquaquad_envs.sensing.laser import detectable_radius, intensity, reading
from aquaquad_envs.tasks.laser_tracking_data import HISTORY

#: m; the light is computed for no less height over the source.
LEAST_HEIGHT = 0.1
#: s; places where there was light count in their mean for about so long, and so many edges in that of edges.
LIT_MEMORY_S = 10.0
RIM_MEMORY = 4.0


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
    """First readings of an episode, and nothing to remember."""
    world.own_y = 0.0
    world.own_v = 0.0
    world.seen_u = 0.0
    world.seen_v = 0.0
    world.carried_x = 0.0
    world.carried_y = 0.0
    world.ambient = c.beam.ambient
    world.ambient_state = 0.0
    world.detected = 0
    world.light_s = -1.0
    world.light_x = 0.0
    world.light_y = 0.0
    world.lit_x = 0.0
    world.lit_y = 0.0
    world.lit_count = 0.0
    world.edge_s = -1.0
    world.edge_x = 0.0
    world.edge_y = 0.0
    world.edge_kind = 0
    world.rim_x = 0.0
    world.rim_y = 0.0
    world.rim_count = 0.0
    world.fix_s = -2.0 * c.fix_period
    if c.ambient_variation > 0.0:
        world.ambient_state = normal(world.rng_field)
    measure(world, 0.0, c)
    remember(world, c)


@kernel
def signal_of(world, c):
    """The reading less the nominal ambient light, W/m²."""
    return world.reading - c.beam.ambient


@kernel
def remember(world, c):
    """Take the present reading into memory, at the place where it was made.

    Places are own position less ``carried``: relative to the submerged vehicle as far as its motion is known,
    and to where it was at the start.
    """
    x = world.own_x - world.carried_x
    y = world.own_y - world.carried_y
    signal = signal_of(world, c)
    detected = 1 if signal >= c.detection else 0
    if detected == 1:
        world.light_s = world.time_s
        world.light_x = x
        world.light_y = y
        world.lit_count = min(world.lit_count + 1.0, max(LIT_MEMORY_S / c.action_period, 1.0))
        world.lit_x += (x - world.lit_x) / world.lit_count
        world.lit_y += (y - world.lit_y) / world.lit_count
    if detected != world.detected and world.steps > 0:
        last = world.history[(world.steps - 1) % HISTORY]
        world.edge_x = 0.5 * (x + last[1])
        world.edge_y = 0.5 * (y + last[2])
        world.edge_s = world.time_s
        world.edge_kind = 1 if detected == 1 else -1
        world.rim_count = min(world.rim_count + 1.0, RIM_MEMORY)
        world.rim_x += (world.edge_x - world.rim_x) / world.rim_count
        world.rim_y += (world.edge_y - world.rim_y) / world.rim_count
    world.detected = detected
    entry = world.history[world.steps % HISTORY]
    entry[0] = signal / c.peak
    entry[1] = x
    entry[2] = y

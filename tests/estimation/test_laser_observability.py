"""Observability of the laser's centre along a pass, as published, and what the published rank misses."""

import math
from itertools import pairwise

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.laser_ekf import make_laser_model
from aquaquad_envs.estimation.laser_observability import (
    path_rank,
    polar_jacobian,
    polar_observability,
    polar_rank,
    transition,
)
from aquaquad_envs.sensing.laser import detectable_radius, intensity, make_beam

BEAM, HEIGHT = make_beam(), 8.0
W = detectable_radius(BEAM, HEIGHT)
MODEL = make_laser_model(BEAM, HEIGHT, intensity_std=5e-4, velocity_std=0.05)


def readings(state):
    r, angle, along, rate = state
    return np.array(
        [
            intensity(BEAM, r, HEIGHT),
            along * math.cos(angle) - r * rate * math.sin(angle),
            along * math.sin(angle) + r * rate * math.cos(angle),
        ]
    )


@pytest.mark.parametrize("state", [(0.5, 0.3, 0.4, -0.2), (0.9, -2.0, -1.0, 0.5)])
def test_jacobian_by_differences(state):
    step = 1e-6
    for k in range(4):
        change = step * np.eye(4)[k]
        numeric = (readings(np.array(state) + change) - readings(np.array(state) - change)) / (2 * step)
        np.testing.assert_allclose(polar_jacobian(MODEL, state)[:, k], numeric, atol=1e-7)


def test_matrix_is_the_published_stack():
    state, dt = (0.9, 0.4, 0.5, 0.1), 0.1
    stack = polar_observability(MODEL, state, dt) * np.tile([5e-4, 0.05, 0.05], 4)[:, None]
    gradient, step = polar_jacobian(MODEL, state), transition(dt)
    for k in range(4):
        np.testing.assert_allclose(stack[3 * k : 3 * k + 3], gradient)
        gradient = gradient @ step


def pass_ranks(speed):
    """Ranks over a pass across the axis, from 2 W on one side to 2 W on the other, by r / W."""
    places = np.linspace(-1.99, 1.99, 80) * W
    return {
        abs(x) / W: polar_rank(MODEL, (abs(x), 0.0 if x > 0 else math.pi, math.copysign(speed, x), 0.0))
        for x in places
    }


def test_rank_is_full_only_in_the_ring_and_in_motion():
    ranks = pass_ranks(0.8)
    for ratio, rank in ranks.items():
        if 1.0 <= ratio <= 1.4:
            assert rank == 4
        elif ratio < 0.5 or ratio > 1.8:
            assert rank < 4
    # What lies between changes once: inside to ring, ring to dark.
    full = [rank == 4 for _, rank in sorted(ranks.items())]
    assert sum(a != b for a, b in pairwise(full)) == 2
    assert max(pass_ranks(0.0).values()) < 4


def test_a_gaussian_is_observable_all_over_its_slope():
    beam = make_beam(profile="gaussian")
    model = make_laser_model(beam, HEIGHT, intensity_std=5e-4, velocity_std=0.05)
    assert all(polar_rank(model, (ratio * W, 0.0, 0.8, 0.0)) == 4 for ratio in (0.3, 0.6, 0.9, 1.2))
    assert polar_rank(model, (1e-9, 0.0, 0.8, 0.0)) < 4


def test_turning_polar_rates_look_observable_in_the_dark():
    """The artefact: no light, yet rank 4, since the model holds θ̇ constant."""
    assert polar_rank(MODEL, (3 * W, 0.0, 0.0, 0.5), 1.0) == 4
    dark = 3 * W * np.stack([np.cos(0.05 * np.arange(40)), np.sin(0.05 * np.arange(40))], axis=-1)
    assert path_rank(MODEL, dark, 0.1, velocities=True) == 2


def test_a_path_needs_the_ring_from_two_sides():
    angle = np.linspace(0, 2 * np.pi, 60)
    ride = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert path_rank(MODEL, W * ride, 0.1) == 4
    assert path_rank(MODEL, 0.3 * W * ride, 0.1) == 0
    straight = np.stack([np.linspace(-2, 2, 60) * W, np.zeros(60)], axis=-1)
    assert path_rank(MODEL, straight, 0.1, velocities=True) == 3
    chord = straight + np.array([0.0, 0.8 * W])
    assert path_rank(MODEL, chord, 0.1, velocities=True) == 4


def test_refusals_say_why():
    with pytest.raises(InvalidParameterError, match="offsets"):
        path_rank(MODEL, [[0.0, 0.0]], 0.1)
    with pytest.raises(InvalidParameterError, match="dt_s: got 0"):
        polar_rank(MODEL, (1, 0, 0, 0), 0)
    with pytest.raises(InvalidParameterError, match="least"):
        polar_rank(MODEL, (1, 0, 0, 0), least=0)

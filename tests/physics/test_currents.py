"""The gridded current: interpolation in space and time, the published cells, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.current_formulas import published_vortex
from aquaquad_envs.physics.currents import CurrentField, current_at
from aquaquad_envs.physics.grids import Grid

GRID = Grid(-2000.0, -1000.0, 500.0)


def random_field(frames=4, **options):
    velocity = np.random.default_rng(1).normal(size=(frames, 6, 9, 2))
    return CurrentField(velocity=velocity, grid=GRID, time_step_s=1800.0, **options)


def test_agrees_with_an_independent_interpolant():
    field = random_field(time0_s=600.0)
    axes = (
        600.0 + 1800.0 * np.arange(4),
        GRID.y0 + GRID.spacing * np.arange(6),
        GRID.x0 + GRID.spacing * np.arange(9),
    )
    golden = RegularGridInterpolator(axes, field.velocity)
    rng = np.random.default_rng(2)
    for t in rng.uniform(600, 6000, 20):
        x, y = rng.uniform(-2000, 2000, 50), rng.uniform(-1000, 1500, 50)
        expected = golden(np.stack([np.full(50, t), y, x], -1))
        np.testing.assert_allclose(field.sample(x, y, t), expected, atol=1e-13)


def test_linear_in_time_and_held_at_both_ends():
    field = random_field(time0_s=600.0)
    point = (123.0, -456.0)
    first, second = field.sample(*point, 600.0), field.sample(*point, 2400.0)
    np.testing.assert_allclose(field.sample(*point, 600.0 + 450.0), 0.75 * first + 0.25 * second, atol=1e-14)
    np.testing.assert_array_equal(field.sample(*point, -1e9), first)
    np.testing.assert_array_equal(field.sample(*point, 1e9), field.sample(*point, 600.0 + 3 * 1800.0))


def test_held_outside_the_box():
    field = random_field()
    np.testing.assert_array_equal(field.sample(1e6, -1e6), field.sample(2000.0, -1000.0))


def test_sample_keeps_the_shape_of_its_points():
    x, y = np.zeros((3, 1)), np.zeros((1, 4))
    assert random_field().sample(x, y).shape == (3, 4, 2)
    assert random_field().sample(0.0, 0.0).shape == (2,)


@settings(max_examples=60)
@given(st.floats(-5000, 4999.999), st.floats(-5000, 4999.999))
def test_cell_mode_is_the_published_lookup(x, y):
    """Dillard 2014, App. C: the value of the lower-left node, on 21 × 21 nodes 500 m apart."""
    field = published_vortex(interpolation="cell")
    column, row = int((x + 5000) // 500), int((y + 5000) // 500)
    np.testing.assert_array_equal(field.sample(x, y), field.velocity[0, row, column])


def test_cell_mode_at_nodes_and_at_the_far_edge():
    field = published_vortex(interpolation="cell")
    x, y = field.grid.nodes(21, 21)
    np.testing.assert_array_equal(field.sample(x, y), field.velocity[0])


def test_layers_are_told_apart():
    field = random_field()
    stack = np.stack([field.velocity, 2 * field.velocity])
    np.testing.assert_allclose(
        current_at(stack, 1, field.axes, 700.0, 10.0, 20.0),
        2 * np.array(current_at(stack, 0, field.axes, 700.0, 10.0, 20.0)),
        rtol=1e-15,
    )


def test_a_field_cannot_be_changed_afterwards():
    velocity = np.zeros((1, 2, 2, 2), dtype=np.float32)
    field = CurrentField(velocity=velocity, grid=GRID)
    with pytest.raises(ValueError, match="read-only"):
        field.velocity[0] = 1


@pytest.mark.parametrize(
    "change, words",
    [
        ({"velocity": np.zeros((1, 3, 3))}, "shape"),
        ({"velocity": np.zeros((0, 3, 3, 2))}, "frames >= 1"),
        ({"velocity": np.zeros((1, 1, 3, 2))}, "rows >= 2"),
        ({"velocity": np.full((1, 3, 3, 2), np.nan)}, "18 values that are NaN.*Fill land"),
        ({"velocity": np.full((1, 3, 3, 2), np.inf)}, "finite velocities"),
        ({"time_step_s": 0.0}, "time_step_s: got 0.0"),
        ({"time_step_s": np.nan}, "positive number of seconds"),
        ({"grid": Grid(0.0, 0.0, 0.0)}, "positive spacing"),
        ({"grid": Grid(np.nan, 0.0, 1.0)}, "finite origin"),
        ({"interpolation": "cells"}, "Did you mean 'cell'"),
    ],
)
def test_refusals_say_why(change, words):
    good = {"velocity": np.zeros((1, 3, 3, 2)), "grid": GRID}
    with pytest.raises(InvalidParameterError, match=words):
        CurrentField(**{**good, **change})

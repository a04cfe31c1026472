"""Grids and the one bilinear interpolation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.physics.grids import Grid, bilinear, locate

GRID = Grid(-3000.0, -2000.0, 250.0)
ROWS, COLUMNS = 17, 25
X_MAX, Y_MAX = GRID.x0 + (COLUMNS - 1) * GRID.spacing, GRID.y0 + (ROWS - 1) * GRID.spacing


def test_rows_go_north_and_columns_east():
    x, y = GRID.nodes(ROWS, COLUMNS)
    assert x.shape == y.shape == (ROWS, COLUMNS)
    assert (np.diff(x, axis=1) == GRID.spacing).all() and (np.diff(x, axis=0) == 0).all()
    assert (np.diff(y, axis=0) == GRID.spacing).all() and (np.diff(y, axis=1) == 0).all()
    assert (x[0, 0], y[0, 0]) == (GRID.x0, GRID.y0)


@given(
    half_width=st.floats(10, 1e6),
    spacing_share=st.floats(0.002, 1.5),
)
def test_square_covers_its_box(half_width, spacing_share):
    grid, side = Grid.square(half_width, spacing_share * half_width)
    x, y = grid.nodes(side, side)
    assert side >= 2
    for axis in (x, y):
        assert axis.min() == -half_width
        assert axis.max() == pytest.approx(half_width, rel=1e-12)


coefficients = st.tuples(*[st.floats(-10, 10)] * 4)


@settings(max_examples=60)
@given(coefficients, st.floats(GRID.x0, X_MAX), st.floats(GRID.y0, Y_MAX))
def test_exact_for_bilinear_functions(c, x, y):
    def f(x, y):
        return c[0] + c[1] * x / 1000 + c[2] * y / 1000 + c[3] * x * y / 1e6

    values = np.stack([np.zeros((ROWS, COLUMNS)), f(*GRID.nodes(ROWS, COLUMNS))])
    assert bilinear(values, 1, GRID, x, y) == pytest.approx(f(x, y), abs=1e-11)
    assert bilinear(values, 0, GRID, x, y) == 0


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(-1e7, 1e7), st.floats(-1e7, 1e7))
def test_held_at_the_edges_and_within_the_values(seed, x, y):
    values = np.random.default_rng(seed).normal(size=(1, ROWS, COLUMNS))
    got = bilinear(values, 0, GRID, x, y)
    held = bilinear(values, 0, GRID, min(max(x, GRID.x0), X_MAX), min(max(y, GRID.y0), Y_MAX))
    assert got == held
    assert values.min() - 1e-12 <= got <= values.max() + 1e-12


def test_every_node_returns_its_own_value():
    values = np.random.default_rng(0).normal(size=(1, ROWS, COLUMNS))
    x, y = GRID.nodes(ROWS, COLUMNS)
    got = [
        [bilinear(values, 0, GRID, a, b) for a, b in zip(*row, strict=True)] for row in zip(x, y, strict=True)
    ]
    np.testing.assert_allclose(got, values[0], atol=1e-12)


@given(st.integers(2, 500), st.floats(allow_nan=False))
def test_located_indices_lie_inside(size, position):
    index, fraction = locate(-10.0, 0.7, size, position)
    assert 0 <= index <= size - 2
    assert 0.0 <= fraction <= 1.0

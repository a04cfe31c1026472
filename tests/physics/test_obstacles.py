"""Signed distances of rectangles, polygons and masks, against shapely and brute force."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import FAR_M, ObstacleMap, clearance_at, nearest_direction

GRID, SIDE = Grid.square(1000.0, 50.0)
X, Y = GRID.nodes(SIDE, SIDE)


def signed(shape):
    """Signed distance of the nodes to a shapely shape."""
    points = shapely.points(X, Y)
    with np.errstate(all="ignore"):  # shapely divides by zero on the way for corners of 1e-300 m
        edge = shapely.distance(points, shape.boundary)
    return np.where(shapely.contains_properly(shape, points), -edge, edge)


def at(made, x, y):
    return clearance_at(made.distance[None], 0, made.grid, x, y)


span = st.tuples(st.floats(-1500, 1500), st.floats(1, 1500)).map(lambda pair: (pair[0], pair[0] + pair[1]))
rectangles = st.tuples(span, span).map(lambda s: (s[0][0], s[1][0], s[0][1], s[1][1]))


@settings(max_examples=40)
@given(rectangles)
def test_a_rectangle_is_exact(rectangle):
    made = ObstacleMap.from_rectangles([rectangle], grid=GRID, side=SIDE)
    np.testing.assert_allclose(made.distance, signed(shapely.box(*rectangle)), atol=1e-9)


@settings(max_examples=20)
@given(st.lists(rectangles, min_size=2, max_size=5))
def test_of_several_rectangles_the_nearest_counts(several):
    made = ObstacleMap.from_rectangles(several, grid=GRID, side=SIDE)
    golden = signed(shapely.union_all([shapely.box(*r) for r in several]))
    outside = golden > 1e-9
    np.testing.assert_allclose(made.distance[outside], golden[outside], atol=1e-9)
    # Edges that lie within rounding of each other leave a residue of the order of 1e-9 m.
    assert (made.distance[~outside] <= 1e-6).all()


@settings(max_examples=20)
@given(rectangles)
def test_polygons_and_rectangles_agree(rectangle):
    x0, y0, x1, y1 = rectangle
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for order in (corners, corners[::-1]):
        made = ObstacleMap.from_polygons([order], grid=GRID, side=SIDE, margin_m=30.0)
        golden = ObstacleMap.from_rectangles([rectangle], grid=GRID, side=SIDE, margin_m=30.0)
        np.testing.assert_allclose(made.distance, golden.distance, atol=1e-9)


def test_overlapping_polygons_are_one_obstacle():
    """Deep inside the union the way out is to the union's edge, not to the shared inner edges."""
    left = [(-600, -300), (100, -300), (100, 300), (-600, 300)]
    right = [(-100, -300), (600, -300), (600, 300), (-100, 300)]
    made = ObstacleMap.from_polygons([left, right], grid=GRID, side=SIDE)
    assert at(made, 0.0, 0.0) == pytest.approx(-300.0)


def test_a_triangle_by_hand():
    made = ObstacleMap.from_polygons([[(0, 0), (400, 0), (0, 400)]], grid=GRID, side=SIDE)
    assert at(made, -300.0, -400.0) == pytest.approx(500.0)
    assert at(made, 400.0, 400.0) == pytest.approx(400.0 / np.sqrt(2))
    assert at(made, 50.0, 50.0) == pytest.approx(-50.0)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 0.6))
def test_a_mask_agrees_with_brute_force(seed, share):
    land = np.random.default_rng(seed).uniform(size=(13, 17)) < share
    if not land.any() or land.all():
        return
    grid = Grid(5.0, -7.0, 20.0)
    x, y = grid.nodes(13, 17)
    made = ObstacleMap.from_mask(land, grid=grid, margin_m=3.0)
    for i, j in np.ndindex(land.shape):
        far = np.hypot(x - x[i, j], y - y[i, j])
        golden = -(far[~land].min() - 10.0) if land[i, j] else far[land].min() - 10.0
        assert made.distance[i, j] == pytest.approx(golden - 3.0, abs=1e-9)


def test_rows_of_a_mask_go_north():
    land = np.zeros((5, 5), dtype=bool)
    land[4] = True
    made = ObstacleMap.from_mask(land, grid=Grid(0.0, 0.0, 10.0))
    assert at(made, 20.0, 0.0) == pytest.approx(35.0)
    assert at(made, 20.0, 40.0) == pytest.approx(-5.0)
    assert nearest_direction(made.distance[None], 0, made.grid, 20.0, 10.0) == pytest.approx((0.0, 1.0))


def test_the_margin_grows_obstacles():
    plain = ObstacleMap.from_rectangles([(-100, -100, 100, 100)], grid=GRID, side=SIDE)
    grown = ObstacleMap.from_rectangles([(-100, -100, 100, 100)], grid=GRID, side=SIDE, margin_m=75.0)
    np.testing.assert_allclose(grown.distance, plain.distance - 75.0)


def test_nothing_is_far():
    for made in (
        ObstacleMap.empty(GRID),
        ObstacleMap.from_rectangles([], grid=GRID, side=SIDE),
        ObstacleMap.from_polygons([], grid=GRID, side=SIDE),
        ObstacleMap.from_mask(np.zeros((4, 4), dtype=bool), grid=GRID),
    ):
        assert (made.distance == FAR_M).all()
        assert nearest_direction(made.distance[None], 0, made.grid, 3.0, 4.0) == (0.0, 0.0)
    assert ObstacleMap.from_polygons([], grid=GRID, side=SIDE).distance.shape == (SIDE, SIDE)


points = st.tuples(st.floats(-1000, 1000), st.floats(-1000, 1000))


@settings(max_examples=60)
@given(st.lists(rectangles, min_size=1, max_size=4), points, points)
def test_clearance_changes_no_faster_than_one_moves(several, a, b):
    """Nodes are 1-Lipschitz; between them each axis is, hence √2 in all."""
    made = ObstacleMap.from_rectangles(several, grid=GRID, side=SIDE)
    for axis in (0, 1):
        assert np.abs(np.diff(made.distance, axis=axis)).max() <= GRID.spacing * (1 + 1e-12)
    apart = np.hypot(a[0] - b[0], a[1] - b[1])
    assert abs(at(made, *a) - at(made, *b)) <= np.sqrt(2) * apart + 1e-9


@settings(max_examples=40)
@given(points)
def test_the_direction_points_at_the_obstacle(point):
    rectangle = (-200.0, -100.0, 300.0, 250.0)
    made = ObstacleMap.from_rectangles([rectangle], grid=GRID, side=SIDE)
    if at(made, *point) < 120.0 or max(map(abs, point)) > 950:
        return
    direction = np.array(nearest_direction(made.distance[None], 0, GRID, *point))
    nearest = np.clip(point, (-200.0, -100.0), (300.0, 250.0))
    towards = (nearest - point) / np.hypot(*(nearest - point))
    assert np.hypot(*direction) == pytest.approx(1.0)
    assert direction @ towards > 0.97


@pytest.mark.parametrize(
    "call, words",
    [
        (
            lambda **g: ObstacleMap.from_rectangles([(0, 0, 1, 1), (3, 0, 1, 1)], **g),
            r"rectangles\[1\].*min < max",
        ),
        (lambda **g: ObstacleMap.from_rectangles([(0, 0, np.nan, 1)], **g), r"rectangles\[0\]"),
        (lambda **g: ObstacleMap.from_rectangles([(0, 0, 1, 1)], margin_m=-1.0, **g), "margin_m: got -1.0"),
        (lambda **g: ObstacleMap.from_polygons([[(0, 0), (1, 1)]], **g), "at least three"),
        (lambda **g: ObstacleMap.from_polygons([[(0, 0), (9, 9), (9, 0), (0, 9)]], **g), "Self-intersection"),
        (lambda **g: ObstacleMap.from_polygons([[(0, 0), (1, 1), (2, 2)]], **g), "polygon with area"),
        (lambda **g: ObstacleMap.from_mask(np.ones((3, 3), dtype=bool), grid=GRID), "land everywhere"),
        (lambda **g: ObstacleMap.from_mask(np.ones(3, dtype=bool), grid=GRID), "two-dimensional"),
        (lambda **g: ObstacleMap(distance=np.full((3, 3), np.nan), grid=GRID), "finite"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call(grid=GRID, side=SIDE)

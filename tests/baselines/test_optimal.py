"""The value function against closed forms, an independent Dijkstra, grid refinement, and the world itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.physics.current_formulas import from_formula, published_vortex, uniform
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap
from aquaquad_envs.tasks.batch import make_world_batch
from baselines.optimal import Optimal, solve
from baselines.problem import DriftHopProblem
from baselines.value_solver import solve_timed

SQUARE = (-1000.0, -1000.0, 1000.0, 1000.0)
RADIUS = 100.0
AIRSPEED = 100.0 / 9.0


def problem(field, rectangles=(), start=(-4000.0, 4000.0), goal=(3000.0, -3000.0), **settings):
    grid, side = Grid.square(5000.0, 100.0)
    obstacles = ObstacleMap.from_rectangles(rectangles, grid=grid, side=side)
    return DriftHopProblem.of(field, obstacles, start=start, goal=goal, **settings)


@pytest.fixture(scope="module")
def vortex():
    return solve(problem(published_vortex(), [SQUARE]))


def test_without_current_v_is_the_distance_to_the_goal_disc():
    found = solve(problem(uniform(0.0, 0.0)), spacing_m=200.0)
    x, y = np.random.default_rng(1).uniform(-5000, 5000, (2, 500))
    expected = np.maximum(np.hypot(x - 3000, y + 3000) - RADIUS, 0)
    np.testing.assert_allclose(found.at(x, y), expected, atol=0.01)


def test_flight_passes_over_an_obstacle_that_one_hop_can_cross():
    found = solve(problem(uniform(0.0, 0.0), [(-500.0, -500.0, 500.0, 500.0)]), spacing_m=100.0)
    straight = np.hypot(7000, 7000) - RADIUS
    assert straight - 0.01 <= found.at(-4000.0, 4000.0) <= straight * 1.002


def test_a_wide_obstacle_makes_a_detour_because_hops_must_land():
    wall = problem(
        uniform(0.0, 0.0), [(-2000.0, -1000.0, 2000.0, 1000.0)], start=(0.0, 3000.0), goal=(0.0, -3000.0)
    )
    needed = solve(wall, spacing_m=100.0).at(0.0, 3000.0)
    around = 2 * np.hypot(2000, 2000) + 2000 - RADIUS
    assert 6000 - RADIUS < needed <= around * 1.01
    # Hops of up to 1333 m may cut the corners of the wall, but not cross its 2000 m.
    cut = 2 * np.hypot(2000 - 1333, 3000)
    assert needed > cut


def test_downstream_only_the_offset_across_the_current_is_flown():
    found = solve(problem(uniform(0.3, 0.0), start=(-3000.0, 0.0), goal=(3000.0, 500.0)))
    assert found.at(-3000.0, 0.0) == pytest.approx(500 - RADIUS, abs=2.0)
    assert found.at(-3000.0, 450.0) < 2.0  # drifts into the disc; only time is priced
    assert found.energy_wh(-3000.0, 0.0) == pytest.approx((500 - RADIUS) / 200, abs=0.01)


def test_upstream_drift_never_helps():
    found = solve(problem(uniform(0.3, 0.0), start=(3000.0, 0.0), goal=(-3000.0, 500.0)))
    assert found.at(3000.0, 0.0) == pytest.approx(np.hypot(6000, 500) - RADIUS, abs=0.01)


def test_a_deadline_turns_drift_into_flight():
    speed, horizon = 0.3, 3 * 3600.0
    found = solve(
        problem(uniform(speed, 0.0), start=(-3000.0, 0.0), goal=(3000.0, 0.0), horizon_s=horizon),
        spacing_m=200.0,
    )
    assert len(found.times_s) > 1
    # V metres of flight take V / airspeed; the rest of the horizon carries: V + speed (H - V / a) = D - R.
    ideal = (6000 - RADIUS - speed * horizon) / (1 - speed / AIRSPEED)
    # Take-off comes at the end of a slice of 600 s.
    assert ideal - 1 <= found.at(-3000.0, 0.0) <= ideal + speed * 600 + 20
    assert found.follow()[1] <= horizon


def dijkstra(velocity_at, goal, spacing, period, periods, blocked):
    """V at grid nodes by NumPy and SciPy alone: all pairs of nodes joined by "drift k periods, then fly"."""
    from scipy.sparse.csgraph import dijkstra as shortest_paths

    axis = np.arange(-5000, 5001, spacing)
    nodes = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2).astype(float)
    water = ~blocked(nodes)
    cost = np.full((len(nodes) + 1, len(nodes) + 1), np.inf)

    def offer(places, alive):
        apart = np.hypot(*(places[:, None] - nodes[None]).transpose(2, 0, 1))
        apart[:, ~water] = np.inf
        home = np.maximum(np.hypot(*(places - goal).T) - RADIUS, 0)
        step = np.concatenate([apart, home[:, None]], 1)
        cost[:-1][alive] = np.minimum(cost[:-1][alive], step[alive])

    places, alive = nodes.copy(), water.copy()
    offer(places, alive)
    for _ in range(periods):
        for _ in range(10):
            dt = period / 10
            k1 = velocity_at(places)
            k2 = velocity_at(places + dt / 2 * k1)
            k3 = velocity_at(places + dt / 2 * k2)
            k4 = velocity_at(places + dt * k3)
            places = places + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            alive &= (np.abs(places) <= 5000).all(1) & ~blocked(places)
            places[~alive] = 0.0
            arrived = alive & (np.hypot(*(places - goal).T) <= RADIUS)
            cost[:-1][arrived, -1] = 0.0
        offer(places, alive)
    cost[-1, :-1] = np.inf
    # SciPy reads 0 as "no edge"; distances to the goal are distances from it in the reversed graph.
    graph = np.where(np.isfinite(cost), np.maximum(cost, 1e-6), 0.0)
    return shortest_paths(graph.T, indices=len(nodes))[:-1].reshape(len(axis), -1)


@pytest.mark.parametrize("rectangles", [(), (SQUARE,)])
def test_agrees_with_an_independent_dijkstra(rectangles):
    # A shear and a strain, linear in space: bilinear interpolation reproduces it exactly.
    def formula(x, y, t):
        return 0.2 + 4e-5 * y - 1e-5 * x, -0.1 + 3e-5 * x + 1e-5 * y

    def blocked(points):
        return (np.abs(points) < 1000).all(1) if rectangles else np.zeros(len(points), dtype=bool)

    goal = np.array([3000.0, -3000.0])
    expected = dijkstra(lambda p: np.stack(formula(*p.T, 0), -1), goal, 500, 600.0, 72, blocked)
    field = from_formula(formula, half_width_m=5000.0, spacing_m=500.0)
    # Hops without limit, as in the graph, which flies over everything; a start whose plan meets the deadline.
    found = solve(
        problem(field, rectangles, max_hop_m=1e5, start=(2500.0, -2500.0)),
        spacing_m=500.0,
        action_period_s=600.0,
    )
    assert len(found.times_s) == 1
    mine, water = found.distance[0], np.isfinite(expected)
    assert np.isinf(mine[~water]).all()
    error = mine[water] - expected[water]
    # The graph knows every pair of nodes, so it is the lower one; obstacles' corners differ by a cell's rounding.
    assert error.min() > (-25.0 if rectangles else -0.01)
    assert np.abs(error).mean() < 5.0
    assert error.max() < (150.0 if rectangles else 50.0)


def test_published_optimum_and_grid_convergence():
    free = solve(problem(published_vortex()))
    assert free.energy_wh(-4000.0, 4000.0) == pytest.approx(18.9, abs=0.1)
    values = [
        float(solve(problem(published_vortex(), [SQUARE]), spacing_m=spacing).energy_wh(-4000.0, 4000.0))
        for spacing in (400.0, 200.0, 100.0, 50.0)
    ]
    # From above and monotone (grids are nested); 20.24 Wh at 25 m.
    assert values == sorted(values, reverse=True)
    assert values[1] == pytest.approx(20.24, rel=0.02)
    assert values[2] == pytest.approx(20.24, rel=0.01)
    assert values[3] == pytest.approx(20.24, rel=0.005)


def test_stated_tolerance_is_reached(vortex):
    assert 0 <= vortex.change_m < 1.0
    finer = solve(vortex.problem, tolerance_m=0.01)
    assert finer.iterations >= vortex.iterations
    known = np.isfinite(vortex.distance)
    assert np.abs(finer.distance[known] - vortex.distance[known]).max() < 2.0


def test_following_the_plan_flies_what_v_says(vortex):
    flown, duration = vortex.follow()
    assert flown == pytest.approx(float(vortex.at(-4000.0, 4000.0)), abs=3.0)
    assert 5 * 3600 < duration < 8 * 3600  # SPEC: "about 6 hours"


point = st.tuples(st.floats(-4999, 4999), st.floats(-4999, 4999))


@settings(max_examples=60, deadline=None)
@given(a=point, step=st.tuples(st.floats(-250, 250), st.floats(-250, 250)))
def test_v_is_no_steeper_than_flight_and_infinite_only_off_the_water(vortex, a, step):
    b = np.add(a, step)
    va, vb = float(vortex.at(*a)), float(vortex.at(*b))
    for (x, y), v in ((a, va), (b, vb)):
        outside = max(abs(x), abs(y)) > 5000
        inside = max(abs(x), abs(y)) < 999.0
        assert np.isinf(v) == (outside or inside) or max(abs(x), abs(y)) < 1001.0
    if np.isfinite(va + vb):
        assert abs(va - vb) <= np.hypot(*step) + 40.0  # the grid's error, at 100 m
        assert 0 <= va <= np.hypot(a[0] - 3000, a[1] + 3000) * 1.25


def test_swept_in_time_agrees_with_the_fixed_point(vortex):
    timed = solve_timed(vortex.problem, 150.0, 600.0)
    steady = float(vortex.at(-4000.0, 4000.0))
    assert float(timed.at(-4000.0, 4000.0)) == pytest.approx(steady, rel=0.02)
    x, y = np.random.default_rng(2).uniform(-4500, 4500, (2, 60))
    both = np.isfinite(vortex.at(x, y))
    early, ever = timed.at(x[both], y[both]), vortex.at(x[both], y[both])
    # A deadline can only cost (up to the grids' errors), and costs more the later it is.
    assert (early > ever - 60).all()
    late = timed.at(x[both], y[both], 39_000.0)
    assert (late > early - 60).all()
    assert late.mean() > early.mean() + 100


def run(policy, batch):
    policy.reset(np.arange(batch.num_worlds))
    while not (batch.worlds["outcome"] != 0).all():
        actions = policy.act(batch.observations, batch.worlds)
        assert actions.dtype == np.float32
        assert actions.shape == (batch.num_worlds, 2)
        assert np.isfinite(actions).all()
        assert (np.hypot(*actions.T) < 1.00001).all()
        batch.step(actions)
    return batch.worlds


def test_rolled_out_within_two_percent_of_the_bound():
    batch = make_world_batch("drift-hop", 2)
    batch.reset(0)
    policy = Optimal(batch)
    bound = policy.bound_wh()
    worlds = run(policy, batch)
    assert (worlds["outcome"] == 1).all()
    assert (worlds["flight_wh"] <= 1.02 * bound).all()
    assert (worlds["flight_wh"] >= 0.99 * bound).all()
    assert worlds["flight_wh"][0] == worlds["flight_wh"][1]
    np.testing.assert_array_equal(bound, policy.bound_wh())  # of the start, wherever the world is now


def test_each_world_has_its_own_value_function():
    batch = make_world_batch("drift-hop", 3, scenario="vortex-perturbed")
    policy = Optimal(batch, spacing_m=200.0)
    together, bounds = [], []
    for seed in (0, 10):  # the second round replaces the functions of the first
        batch.reset(seed)
        bounds.append(policy.bound_wh())
        together.append(run(policy, batch)["flight_wh"].copy())
    assert len(np.unique(together)) == 6
    assert (np.array(together) <= 1.03 * np.array(bounds)).all()
    alone = make_world_batch("drift-hop", 1, scenario="vortex-perturbed")
    alone.reset(11)
    assert run(Optimal(alone, spacing_m=200.0), alone)["flight_wh"][0] == together[1][1]


def test_changing_currents():
    batch = make_world_batch("drift-hop", 4, scenario="gyres", num_fields=4)
    batch.reset(0)
    policy = Optimal(batch, spacing_m=250.0)
    bound = policy.bound_wh(spacing_m=250.0)
    worlds = run(policy, batch)
    direct = 200 * np.hypot(*(worlds[f"goal_{a}"] - worlds[f"start_{a}"] for a in "xy")) / AIRSPEED / 3600
    assert (worlds["outcome"] == 1).all()
    assert (bound < direct).all()
    assert (worlds["flight_wh"] < direct).all()
    assert worlds["flight_wh"].sum() < 1.1 * bound.sum()


def test_refuses_what_it_cannot_do():
    discrete = make_world_batch("drift-hop", 1, action_type="discrete")
    with pytest.raises(InvalidParameterError, match="continuous"):
        Optimal(discrete)
    batch = make_world_batch("drift-hop", 1)
    with pytest.raises(InvalidParameterError, match="forecast, truth"):
        Optimal(batch, field="guess")
    for bad in ({"spacing_m": 0.0}, {"tolerance_m": 0.0}, {"spacing_m": float("nan")}):
        with pytest.raises(AquaQuadError):
            solve(problem(uniform(0.1, 0.0)), **bad)

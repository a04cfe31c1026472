"""DR-RRT*: plans re-simulated by hand, determinism, invalid input, and the policy in its world."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError, PlanningError
from aquaquad_envs.physics.current_formulas import published_vortex, random_gyres, uniform
from aquaquad_envs.physics.grids import Grid
from aquaquad_envs.physics.obstacles import ObstacleMap, clearance_at
from aquaquad_envs.physics.randomness import seed_streams
from aquaquad_envs.physics.vehicle import drift_step, flight_energy_wh
from baselines import dr_rrt_star_published as published
from baselines.dr_rrt_star import DrRrtStar, plan, plan_published
from baselines.dr_rrt_star_table import published_table
from baselines.forecast_check import ForecastCheck
from baselines.plan import DRIFT
from baselines.problem import DriftHopProblem

SQUARE = (-1000.0, -1000.0, 1000.0, 1000.0)
TEAM = np.array([[5000.0, 5000.0], [5000.0, -5000.0], [-5000.0, -5000.0]])


def problem(rectangles=(SQUARE,), *, currents=None, interpolation="bilinear", **changes):
    grid, side = Grid.square(5000.0, 100.0)
    values = {
        "start": (-4000.0, 4000.0),
        "goal": (3000.0, -3000.0),
        "team": TEAM,
        "target": (3100.0, -2900.0),
    }
    return DriftHopProblem.of(
        currents or published_vortex(interpolation=interpolation),
        ObstacleMap.from_rectangles(rectangles, grid=grid, side=side),
        **(values | changes),
    )


def gyre_problem(seed, **changes):
    rng = np.random.default_rng(seed)
    currents = random_gyres(rng, turnover_s=86400.0, duration_s=86400.0)
    return problem([(-1500.0, 500.0, 0.0, 1200.0)], currents=currents, **changes)


def rolled_out(task, found, *, euler, step_s, frozen=False):
    """Fly and drift the plan with the world's kernels: (energy, clearances while adrift and landed, arrived)."""
    x, y = task.start
    t = energy = 0.0
    clearances = []

    def arrived():
        return np.hypot(x - task.goal[0], y - task.goal[1]) <= task.goal_radius_m + 1e-9

    def look():
        assert max(abs(x), abs(y)) <= task.half_width_m
        clearances.append(clearance_at(task.clearance, task.obstacle_index, task.clearance_grid, x, y))

    for leg in found.legs:
        assert not arrived()
        np.testing.assert_allclose((x, y, t), (leg["x0"], leg["y0"], leg["t0"]), atol=1e-6)
        if leg["kind"] == DRIFT:
            steps = (leg["t1"] - leg["t0"]) / step_s
            assert steps == pytest.approx(round(steps), abs=1e-6)
            for _ in range(round(steps)):
                now = task.time_s if frozen else task.time_s + t
                x, y = drift_step(
                    task.velocity, task.field_index, task.axes, now, x, y, step_s, euler
                )  # fmt: skip
                t += step_s
                look()
        else:
            distance = np.hypot(leg["x1"] - x, leg["y1"] - y)
            energy += flight_energy_wh(distance, task.airspeed_m_s, task.flight_power_w)
            pieces = int(np.ceil(distance / task.max_hop_m - 1e-9))
            dx, dy = (leg["x1"] - x) / pieces, (leg["y1"] - y) / pieces
            for _ in range(pieces):
                x, y = x + dx, y + dy
                look()
            t += distance / task.airspeed_m_s
    return energy, np.array(clearances), arrived()


@pytest.mark.parametrize("variant", ["single", "seeking"])
@pytest.mark.parametrize("seed", range(5))
def test_published_plan_costs_what_its_rollout_costs(variant, seed):
    task = problem(interpolation="cell")
    found = plan_published(task, seed=seed, variant=variant, iterations=8000)
    assert found.success
    energy, _, arrived = rolled_out(task, found, euler=True, step_s=60.0, frozen=True)
    assert arrived
    assert energy == pytest.approx(found.flight_energy_wh, rel=1e-12)
    kinds = found.legs["kind"]
    # Consecutive hops are one flight, consecutive drifts one drift.
    assert (np.diff(kinds) != 0).all()


@pytest.mark.parametrize("seed", range(6))
def test_plan_costs_what_its_rollout_costs(seed):
    for task in (problem(), gyre_problem(seed)):
        found = plan(task, seed=seed, iterations=1000)
        assert found.success
        energy, clearances, arrived = rolled_out(task, found, euler=False, step_s=60.0)
        assert arrived
        assert energy == pytest.approx(found.flight_energy_wh, rel=1e-12)
        assert clearances.min() >= 25.0 - 1e-6
        assert found.duration_s <= task.horizon_s
        drifts = found.legs[found.legs["kind"] == DRIFT]
        periods = (drifts["t1"] - drifts["t0"])[:-1] / 600.0
        np.testing.assert_allclose(periods, np.round(periods), atol=1e-9)
        lengths = np.hypot(
            found.flights["x1"] - found.flights["x0"], found.flights["y1"] - found.flights["y0"]
        )
        assert (lengths >= 0.1 * task.max_hop_m).all()


def test_plan_stays_near_the_bound_in_the_vortex():
    # SPEC §6: the bound is 18.9 Wh without obstacles and 20.2 Wh with the square.
    for rectangles, bound in (((), 18.9), ((SQUARE,), 20.2)):
        energies = [plan(problem(rectangles), seed=seed).flight_energy_wh for seed in range(8)]
        assert bound * 0.98 < np.mean(energies) <= 1.05 * bound


def test_more_iterations_do_not_hurt_on_average():
    task = problem()
    few = np.mean([plan(task, seed=seed, iterations=100).flight_energy_wh for seed in range(10)])
    many = np.mean([plan(task, seed=seed, iterations=2000).flight_energy_wh for seed in range(10)])
    assert many < few


def test_plans_drift_for_nothing_where_the_current_leads_to_the_goal():
    task = problem((), currents=uniform(0.5, -0.5), goal=(3000.0, -3000.0))
    found = plan(task, seed=0, iterations=300)
    assert found.success
    assert found.flight_energy_wh == 0.0
    assert (found.legs["kind"] == DRIFT).all()


def test_still_water_is_flown_straight():
    task = problem((), currents=uniform(0.0, 0.0), goal=(0.0, 0.0), start=(-2000.0, 1000.0))
    found = plan(task, seed=0, iterations=300)
    distance = np.hypot(2000.0, 1000.0)
    assert found.flight_energy_wh == pytest.approx(task.flight_energy_wh(distance - 99.0), rel=1e-9)


def test_short_horizon_is_kept():
    loose, tight = problem(), problem(horizon_s=2 * 3600.0)
    found = plan(tight, seed=1, iterations=1000)
    assert found.success
    assert found.duration_s <= 2 * 3600.0
    assert found.flight_energy_wh > plan(loose, seed=1, iterations=1000).flight_energy_wh
    assert not plan(problem(horizon_s=60.0), seed=1, iterations=200).success


def test_field_time_matters():
    """A current that turns after three hours is used while it runs towards the goal."""
    velocity = np.zeros((3, 2, 2, 2))
    velocity[0, ..., 0], velocity[1:, ..., 0] = 0.4, -0.4
    from aquaquad_envs.physics.currents import CurrentField

    currents = CurrentField(velocity=velocity, grid=Grid(-5000.0, -5000.0, 10_000.0), time_step_s=10_800.0)
    east = {"start": (-2000.0, 0.0), "goal": (2000.0, 0.0)}
    early = plan(problem((), currents=currents, **east), seed=0, iterations=500)
    late = plan(problem((), currents=currents, time_s=10_800.0, **east), seed=0, iterations=500)
    assert late.flight_energy_wh == pytest.approx(
        flight_energy_wh(3901.0, 100 / 9, 200.0), rel=1e-6
    )  # flown at once: any drift leads away
    # Mean speed 0.4 m/s falling to 0 at 5400 s: at most 1080 m for nothing.
    assert 0.0 < late.flight_energy_wh - early.flight_energy_wh <= flight_energy_wh(1081.0, 100 / 9, 200.0)
    assert late.flight_energy_wh - early.flight_energy_wh > flight_energy_wh(1000.0, 100 / 9, 200.0)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**63))
def test_same_seed_same_plan(seed):
    for task in (problem(), gyre_problem(3)):
        assert plan(task, seed=seed, iterations=200) == plan(task, seed=seed, iterations=200)
    for variant in ("single", "seeking"):
        first = plan_published(problem(), seed=seed, variant=variant, iterations=3000)
        assert first == plan_published(problem(), seed=seed, variant=variant, iterations=3000)


def test_seeds_differ():
    task = problem()
    assert len({plan_published(task, seed=seed).flight_energy_wh for seed in range(10)}) > 5


def grown(seed, iterations=6000):
    """The published tree itself, and how many of its nodes are in use."""
    task = problem(interpolation="cell")
    tree = published.Tree.allocate(iterations)
    tree.parent[:] = -1
    mission = published.Mission(
        task.velocity, 0, task.axes, task.clearance, 0, task.clearance_grid, 0.0, 5000.0, *task.goal, 100.0,
        task.max_hop_m, task.airspeed_m_s, task.team, *task.target,
    )  # fmt: skip
    path = np.empty((len(tree.x), 3))
    published.grow_published(
        tree, mission, *task.start, iterations, True, seed_streams(seed)[0], path
    )  # fmt: skip
    return tree, int(np.sum(tree.parent >= 0)), mission


@pytest.mark.parametrize("seed", range(3))
def test_published_tree_is_a_tree_whose_costs_add_up(seed):
    tree, count, mission = grown(seed)
    parent, cost = tree.parent[:count], tree.cost[:count]
    depth = np.zeros(count, dtype=int)
    at = np.arange(count)
    for _ in range(count):
        depth += at != 0
        at = parent[at]
        if not at.any():
            break
    assert not at.any()  # every node leads to the root: no cycle
    # Rewired nodes break the order of creation, which is what makes cycles possible at all.
    assert (parent > np.arange(count)).any()
    for node in range(1, count):
        dx, dy = tree.x[node] - tree.x[parent[node]], tree.y[node] - tree.y[parent[node]]
        edge = 0.95 * np.hypot(dx, dy) / mission.max_hop
        if not tree.hop[node]:
            hdop = published.bearing_hdop(tree.x[node], tree.y[node], TEAM, 3100.0, -2900.0)
            to_goal = np.hypot(tree.x[node] - 3000.0, tree.y[node] + 3000.0)
            edge = 60.0 * (0.0225 * hdop / 9000.0 + 0.0225 * to_goal / np.hypot(1e4, 1e4) - 0.005)
        assert cost[node] - cost[parent[node]] == pytest.approx(edge, abs=1e-6)


def test_nearest_nodes_are_the_nearest():
    tree, count, mission = grown(1, 3000)
    rng = np.random.default_rng(0)
    found, squared = np.empty(5, np.int64), np.empty(5)
    for x, y in rng.uniform(-5000, 5000, (200, 2)):
        n = published._nearest(tree, mission, x, y, -1, found, squared)
        distance = np.hypot(tree.x[:count] - x, tree.y[:count] - y)
        np.testing.assert_allclose(np.sqrt(squared[:n]), np.sort(distance)[:5], rtol=1e-9)


@pytest.mark.parametrize("planner", [plan, plan_published])
def test_bad_problems_are_refused_by_name(planner):
    with pytest.raises(PlanningError, match=r"goal.*box of half-width 5000"):
        planner(problem(goal=(6000.0, 0.0)), seed=0)
    with pytest.raises(PlanningError, match=r"start.*inside an obstacle"):
        planner(problem(start=(0.0, 0.0)), seed=0)
    task = problem()
    broken = task.velocity.copy()
    broken[0, 0, 3, 3, 0] = np.nan
    with pytest.raises(PlanningError, match="NaN"):
        planner(
            DriftHopProblem(
                velocity=broken, axes=task.axes, clearance=task.clearance, clearance_grid=task.clearance_grid,
                start=task.start, goal=task.goal,
            ),
            seed=0,
        )  # fmt: skip
    with pytest.raises(InvalidParameterError, match="iterations"):
        planner(task, seed=0, iterations=0)


def test_bad_options_are_refused_by_name():
    with pytest.raises(InvalidParameterError, match=r"action_period_s.*multiple"):
        plan(problem(), seed=0, action_period_s=610.0)
    with pytest.raises(InvalidParameterError, match=r"variant.*Did you mean 'seeking'"):
        plan_published(problem(), seed=0, variant="seekin")
    batch = aquaquad_envs.make_world_batch("drift-hop", 1)
    with pytest.raises(InvalidParameterError, match="variant"):
        DrRrtStar(batch, variant="published")


def test_walled_in_goal_has_no_plan():
    # Walls wider than the longest hop: nothing can land between them and the goal's surroundings.
    walls = [(-5000.0, -5000.0, 5000.0, -3400.0), (-5000.0, -2600.0, 5000.0, 0.0),
             (-5000.0, -5000.0, 2600.0, 0.0), (3400.0, -5000.0, 5000.0, 0.0)]  # fmt: skip
    found = plan(problem(walls), seed=0, iterations=300)
    assert not found.success
    assert found.flight_energy_wh == np.inf


def test_published_table_reports_every_variant_and_obstacle_set():
    rows = published_table(runs=3)
    assert {row["variant"] for row in rows} == {"single", "seeking"}
    for row in rows:
        assert row["success"] == 1.0
        assert 15.0 < row["energy_mean_wh"] < 50.0
        assert row["time_mean_ms"] > 0.0
        assert row["published_energy_mean_wh"] in (38.69, 36.26)


def rollout(policy, batch, seeds):
    batch.reset([int(seed) for seed in seeds])
    policy.reset(np.array(seeds))
    claimed = None
    while not (batch.terminated | batch.truncated).all():
        actions = policy.act(batch.observations, batch.worlds)
        assert actions.dtype == np.float32
        claimed = claimed or [found.flight_energy_wh for found in policy.plans]
        batch.step(actions)
    return batch.metrics(), np.array(claimed)


@pytest.mark.parametrize("scenario", ["vortex-perturbed", "gyres"])
def test_executed_energy_is_the_planned_energy(scenario):
    batch = aquaquad_envs.make_world_batch("drift-hop", 4, scenario=scenario, num_fields=8)
    policy = DrRrtStar(batch, iterations=1000)
    metrics, claimed = rollout(policy, batch, range(4))
    assert metrics["success"].all()
    assert (policy.plan_counts == 1).all()
    np.testing.assert_allclose(metrics["flight_energy_wh"], claimed, atol=1e-4)


def test_policy_replans_when_the_forecast_is_wrong_and_repeats_itself():
    def run():
        batch = aquaquad_envs.make_world_batch(
            "drift-hop", 4, scenario="forecast-error", num_fields=8, forecast_error=0.2, horizon_s=6 * 3600.0
        )
        policy = DrRrtStar(batch, iterations=300)
        metrics, _ = rollout(policy, batch, range(4))
        return metrics["flight_energy_wh"], policy.plan_counts.copy()

    energy, counts = run()
    assert counts.max() > 1
    again, counts_again = run()
    np.testing.assert_array_equal(energy, again)
    np.testing.assert_array_equal(counts, counts_again)


def test_a_world_fares_the_same_alone_and_in_a_batch():
    def run(seeds):
        batch = aquaquad_envs.make_world_batch(
            "drift-hop", len(seeds), scenario="forecast-error", num_fields=8, horizon_s=6 * 3600.0
        )
        metrics, _ = rollout(DrRrtStar(batch, iterations=200), batch, seeds)
        return metrics["flight_energy_wh"], batch.worlds["x"].copy()

    together = run([3, 4, 5, 6, 7])
    for i in range(5):
        alone = run([3 + i])
        for one, all_ in zip(alone, together, strict=True):
            assert one[0] == all_[i]


def adrift(error, steps=3):
    """A batch of one adrift for ``steps`` decisions in the vortex, its forecast wrong by a constant (u, v)."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 1)
    batch.reset([0])
    true = batch.ocean.velocity
    batch.ocean = batch.ocean._replace(velocity=np.concatenate([true, true - np.array(error)]))
    batch.worlds["forecast"] = 1
    check = ForecastCheck(batch)
    for _ in range(steps):
        check.observe(batch.worlds)
        danger = check.dangers(batch.worlds, np.array([True]), 0.0)
        batch.step(np.zeros((1, 2), np.float32))
    check.observe(batch.worlds)
    return batch, check, danger


def test_forecast_check_measures_a_constant_error():
    error = (0.06, -0.03)
    batch, check, _ = adrift(error)
    assert len(check.maps[0]) == 3
    np.testing.assert_allclose(check.latest[0], error, atol=2e-3)
    corrected = check.corrected(0, 1)
    assert corrected.shape == (1, *batch.ocean.velocity.shape[1:])
    truth = batch.ocean.velocity[0]
    wrong = np.abs(batch.ocean.velocity[1] - truth)
    # Better everywhere, most of all where it drifted; hardly changed at the far corner.
    better = np.abs(corrected[0] - truth)
    assert (better <= wrong + 1e-12).all()
    assert better[0, 18, 2].max() < 0.2 * wrong[0, 18, 2].max()
    assert better[0, 0, -1].max() > 0.9 * wrong[0, 0, -1].max()


def test_exact_forecast_is_left_alone():
    _, check, danger = adrift((0.0, 0.0))
    assert check.corrected(0, 1) is None
    assert not danger.any()


def test_forecast_check_warns_of_the_edge_that_the_forecast_misses():
    batch, check, _ = adrift((0.0, 0.0), steps=1)
    batch.worlds["x"], batch.worlds["y"] = -4000.0, 4950.0  # the forecast goes south here, at 0.1 m/s
    assert not check.dangers(batch.worlds, np.array([True]), 0.0)[0]
    check.latest[0] = 0.0, 0.3  # but was seen to be wrong
    assert check.dangers(batch.worlds, np.array([True]), 0.0)[0]
    assert not check.dangers(batch.worlds, np.array([False]), 0.0)[0]
    batch.worlds["y"] = 4000.0
    assert not check.dangers(batch.worlds, np.array([True]), 0.0)[0]


def test_policy_notices_a_world_that_was_reset_alone():
    batch = aquaquad_envs.make_world_batch("drift-hop", 2)
    policy = DrRrtStar(batch, iterations=200)
    batch.reset([1, 2])
    policy.reset(np.array([1, 2]))
    for _ in range(3):
        batch.step(policy.act(batch.observations, batch.worlds))
    kept, old = policy.plans[0], policy.plans[1]
    batch.reset([1, 2], mask=np.array([False, True]))
    policy.act(batch.observations, batch.worlds)
    assert policy.plans[0] is kept
    assert policy.plans[1] is not old

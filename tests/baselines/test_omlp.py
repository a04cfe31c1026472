"""Look-ahead planning: its value, that it finds the best plan, ties, limits, and what it may know."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import aquaquad_envs
from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.map_estimator import pack
from aquaquad_envs.tasks.rollout import rollout
from baselines import knows, make_policy
from baselines.omlp_images import MAX_PLACES
from baselines.omlp_search import MOST_BLOCKS, make_grids, scene_of
from baselines.omlp_value import Worth, make_trail, value_and_slope

TURNING, FREE = "yaw-rate", "greedy"


def scene(w, c, images=False):
    room = np.zeros((MAX_PLACES, 3)), np.zeros((MAX_PLACES, 6)), np.zeros(MAX_PLACES)
    return scene_of(w, w["forecast"], 1.0, images, *room, c)


def worlds_of(vehicle=TURNING, num_worlds=1, scenario="random", moves=0, **params):
    """Worlds after ``moves`` random decisions."""
    batch = aquaquad_envs.make_world_batch(
        "transponder-localization", num_worlds, scenario=scenario, vehicle=vehicle, **params
    )
    seeds = 100 + np.arange(num_worlds)
    batch.reset(seeds)
    policy = make_policy("random", batch)
    policy.reset(seeds)
    for _ in range(moves):
        batch.step(policy.act(batch.observations, batch.worlds))
    return batch


def log_dets(batch, plans, k=0):
    """Σ ln det after each of ``plans`` (n, steps, size) from world k in still water, by NumPy."""
    w, c = batch.worlds[k], batch.constants
    plans = np.asarray(plans, dtype=float)
    x, y, heading = (np.full(len(plans), float(w[name])) for name in ("x", "y", "heading"))
    number = int(w["num_transponders"])
    information = np.zeros((number, 3, 3))
    rows, columns = np.triu_indices(3)
    information[:, rows, columns] = information[:, columns, rows] = w["information"][:number]
    total = np.repeat(information[None], len(plans), axis=0)
    for j in range(plans.shape[1]):
        if batch.params.vehicle == TURNING:
            heading = heading + plans[:, j, 0] * c.yaw_limit * c.period
            x, y = x + c.speed * c.period * np.cos(heading), y + c.speed * c.period * np.sin(heading)
        else:
            x, y = x + c.max_step * plans[:, j, 0], y + c.max_step * plans[:, j, 1]
        arm = w["estimate"][None, :number] - np.stack([x, y, np.zeros_like(x)], -1)[:, None]
        arm /= np.linalg.norm(arm, axis=-1, keepdims=True)
        total += arm[..., :, None] * arm[..., None, :] / c.sigma**2
    return np.linalg.slogdet(total)[1].sum(-1)


def disc(count):
    axis = np.linspace(-1.0, 1.0, count)
    points = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    edge = np.linspace(0.0, 2 * np.pi, 8 * count)
    return np.concatenate([points[np.hypot(*points.T) <= 1], np.stack([np.cos(edge), np.sin(edge)], -1)])


def planned(batch, steps, images=False):
    """After its decision, as published about the estimates alone unless ``images``."""
    policy = make_policy(f"omlp-{steps}", batch, images=images)
    policy.act(batch.observations, batch.worlds)
    return policy


def slopes(batch, u, images=False):
    """J of ``u`` from the first world, its slope, and that by central differences."""
    worth = Worth(1.0 / batch.constants.sigma**2, 0.3, 1.0)
    here, trail, slope, unused = (
        scene(batch.worlds[0], batch.constants, images),
        make_trail(len(u)),
        np.zeros(u.shape),
        np.zeros(u.shape),
    )

    def value(plan, out):
        return value_and_slope(here, plan, len(u), out, trail, batch.ocean, batch.constants, worth)

    found, expected = value(u, slope), np.zeros(u.shape)
    for j in range(len(u)):
        for i in range(batch.action_spec.size):
            step = np.zeros_like(u)
            step[j, i] = 1e-5
            expected[j, i] = (value(u + step, unused) - value(u - step, unused)) / 2e-5
    return found, slope, expected


@pytest.mark.parametrize("vehicle", [TURNING, FREE])
@pytest.mark.parametrize("scenario", ["random", "current"])
def test_the_value_of_a_plan_and_its_slope(vehicle, scenario):
    batch = worlds_of(vehicle, scenario=scenario, moves=4)
    u = np.random.default_rng(3).uniform(-0.6, 0.6, (5, 2))
    value, slope, expected = slopes(batch, u)
    if scenario == "random":
        assert value == pytest.approx(log_dets(batch, u[None])[0], rel=1e-10)
    assert slope == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_the_slope_of_hops_and_their_price():
    batch = worlds_of("aquaquad", scenario="deep", moves=2)
    _, slope, expected = slopes(batch, np.random.default_rng(3).uniform(-0.6, 0.6, (4, 2)))
    # What is left out: a longer flight leaves less time to drift.
    assert np.abs(slope - expected).max() < 0.15 * np.abs(expected).max()
    assert (np.sign(slope) == np.sign(expected))[np.abs(expected) > 0.3 * np.abs(expected).max()].all()


@pytest.mark.parametrize("vehicle", [TURNING, FREE])
def test_one_step_is_the_closed_form(vehicle):
    # Σ log(1 + h Y⁻¹ hᵀ / σ²), the greatest over a fine grid, against the general search.
    batch = worlds_of(vehicle, 6, moves=3)
    policy = planned(batch, 1)
    grid = np.linspace(-1, 1, 4001)[:, None] if vehicle == TURNING else disc(81)
    for k in range(6):
        w = batch.worlds[k]
        number = int(w["num_transponders"])
        # Of one range more the gain is that of the lemma.
        before = log_dets(batch, np.zeros((1, 0, 2)), k)[0]
        gain = np.zeros(len(grid))
        rows, columns = np.triu_indices(3)
        for m in range(number):
            y = np.zeros((3, 3))
            y[rows, columns] = y[columns, rows] = w["information"][m]
            if vehicle == TURNING:
                heading = w["heading"] + grid[:, 0] * batch.constants.yaw_limit * batch.constants.period
                way = batch.constants.speed * batch.constants.period
                x, north = w["x"] + way * np.cos(heading), w["y"] + way * np.sin(heading)
            else:
                x, north = (w[name] + batch.constants.max_step * grid[:, i] for i, name in enumerate("xy"))
            h = w["estimate"][m] - np.stack([x, north, np.zeros_like(x)], -1)
            h /= np.linalg.norm(h, axis=-1, keepdims=True)
            quadratic = np.einsum("ni,ij,nj->n", h, np.linalg.inv(y), h)
            gain += np.log1p(quadratic / batch.constants.sigma**2)
        assert policy.values[k] - before >= gain.max() - 1e-7
        assert policy.values[k] - before == pytest.approx(gain.max(), abs=2e-3)


@pytest.mark.parametrize("vehicle", [TURNING, FREE])
@pytest.mark.parametrize("moves", [0, 5])
def test_two_steps_beat_every_pair_of_a_fine_grid(vehicle, moves):
    batch = worlds_of(vehicle, 4, moves=moves)
    policy = planned(batch, 2)
    grid = np.stack([np.linspace(-1, 1, 161), np.zeros(161)], -1) if vehicle == TURNING else disc(13)
    pairs = np.stack(np.broadcast_arrays(grid[:, None], grid[None]), axis=2).reshape(-1, 2, 2)
    for k in range(4):
        assert policy.values[k] == pytest.approx(log_dets(batch, policy.plans[k : k + 1], k)[0], rel=1e-9)
        assert policy.values[k] >= log_dets(batch, pairs, k).max() - 1e-6


@settings(max_examples=12, deadline=None)
@given(moves=st.integers(0, 10), vehicle=st.sampled_from([TURNING, FREE]))
def test_k_steps_are_never_worth_less_than_one_fewer_and_the_best_last(moves, vehicle):
    batch = worlds_of(vehicle, 2, moves=moves)
    last = np.stack([np.linspace(-1, 1, 61), np.zeros(61)], -1) if vehicle == TURNING else disc(9)
    for steps in (2, 3, 4):
        longer, shorter = planned(batch, steps), planned(batch, steps - 1)
        for k in range(2):
            extended = np.concatenate(
                [np.repeat(shorter.plans[k : k + 1], len(last), axis=0), last[:, None]], axis=1
            )
            assert longer.values[k] >= log_dets(batch, extended, k).max() - 1e-6


def test_a_wide_step_looks_along_the_least_known_direction():
    # The direction of most uncertainty: largest eigenvalue of the covariance, smallest of Y. (The source, and SPEC §8
    # after it, name the largest of "Y"; its figures draw the major axis of the error ellipse, which is this one.)
    batch = worlds_of(FREE, scenario="single", max_step_m=5000.0, half_width_m=1e5)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = np.eye(3)
    covariance[:2, :2] = turn @ np.diag([9.0, 0.5]) @ turn.T
    batch.worlds["information"][0, 0] = pack(np.linalg.inv(covariance))
    batch.worlds["estimate"][0, 0] = (4.0, -3.0, 6.0)
    policy = planned(batch, 1)
    place = np.array([batch.worlds["x"][0], batch.worlds["y"][0]]) + 5000.0 * policy.plans[0, 0]
    look = np.array([4.0, -3.0]) - place
    look /= np.linalg.norm(look)
    assert abs(look @ turn[:, 0]) == pytest.approx(1.0, abs=1e-4)
    values, vectors = np.linalg.eigh(np.linalg.inv(covariance)[:2, :2])
    assert abs(look @ vectors[:, np.argmin(values)]) == pytest.approx(1.0, abs=1e-4)


def test_ties_go_to_the_least_turn_then_to_the_left():
    batch = worlds_of(scenario="single")
    w = batch.worlds[0]
    w["heading"], w["x"], w["y"] = 0.0, 0.0, 0.0
    batch.worlds["information"][0, 0] = pack(np.diag([1.0, 0.01, 1.0]))
    # Dead ahead: left and right are mirror images, and better than straight on.
    batch.worlds["estimate"][0, 0] = (20.0, 0.0, 6.0)
    for steps in (1, 2, 3):
        policy = planned(batch, steps)
        mirrored = policy.plans[0] * [-1.0, 1.0]
        assert policy.plans[0, 0, 0] > 0.1
        assert log_dets(batch, mirrored[None])[0] == pytest.approx(policy.values[0], abs=1e-7)
    # Under the vehicle's circle of places, all turns are equal.
    batch.worlds["information"][0, 0] = pack(np.eye(3))
    batch.worlds["estimate"][0, 0] = (0.0, 0.0, 6.0)
    assert planned(batch, 1).plans[0, 0, 0] == 0.0


def test_names_with_a_number():
    batch = worlds_of()
    assert make_policy("omlp-5", batch).steps == 5
    assert make_policy("omlp-greedy", batch).steps == 1
    assert knows("transponder-localization", "omlp-12") and not knows("drift-hop", "omlp-12")
    with pytest.raises(InvalidParameterError, match=r"steps: got 0.*number in the policy's name"):
        make_policy("omlp-0", batch)
    with pytest.raises(InvalidParameterError, match="Did you mean 'omlp-"):
        make_policy("omlp-x", batch)
    other = aquaquad_envs.make_world_batch("drift-hop", 1)
    with pytest.raises(InvalidParameterError, match="policy: got 'omlp-3'"):
        make_policy("omlp-3", other)
    with pytest.raises(InvalidParameterError, match="continuous"):
        make_policy("omlp-1", worlds_of(action_type="discrete"))


@pytest.mark.parametrize("turning", [True, False])
def test_the_blocks_of_a_long_horizon_add_up(turning):
    grids = make_grids(20, turning=turning)
    assert np.array_equal(grids.blocks.sum(1), np.arange(1, 21))
    leaves = grids.sizes.astype(float) ** grids.levels
    assert leaves.max() <= 4096 and grids.levels.max() == MOST_BLOCKS
    for d, size in enumerate(grids.sizes):
        points = grids.points[d, :size]
        lengths = np.round(np.hypot(*points.T), 9)
        assert not points[0].any() and (np.diff(lengths) >= 0).all(), "in the order of ties"
        assert len(np.unique(points.round(9), axis=0)) == size and lengths.max() == 1.0


def test_it_knows_neither_targets_nor_truth_and_no_other_world():
    batch = worlds_of(num_worlds=5, moves=3, scenario="current")
    first = make_policy("omlp-3", batch).act(batch.observations, batch.worlds)
    told = batch.worlds.copy()
    told["target"] += 7.0
    told["truth"] = 0
    assert np.array_equal(make_policy("omlp-3", batch).act(batch.observations, told), first)
    alone = aquaquad_envs.make_world_batch("transponder-localization", 1, scenario="current")
    for k in range(5):
        action = make_policy("omlp-3", alone).act(batch.observations[k : k + 1], batch.worlds[k : k + 1])
        assert np.array_equal(action[0], first[k])


@pytest.mark.parametrize("vehicle, scenario", [(TURNING, "current"), (FREE, "current"), ("aquaquad", "deep")])
def test_the_planned_place_is_the_world_s_next_place(vehicle, scenario):
    batch = worlds_of(vehicle, 6, scenario=scenario, moves=2)
    assert np.array_equal(batch.worlds["truth"], batch.worlds["forecast"])
    policy = make_policy("omlp-1", batch)
    actions = policy.act(batch.observations, batch.worlds)
    expected = []
    for k, w in enumerate(batch.worlds):
        trail = make_trail(1)
        plan = np.zeros((1, 2))
        plan[0, : actions.shape[1]] = actions[k]
        value_and_slope(
            scene(w, batch.constants),
            plan,
            1,
            np.zeros((1, 2)),
            trail,
            batch.ocean,
            batch.constants,
            policy.worth,
        )
        expected.append(trail.places[1].copy())
    before = np.stack([batch.worlds["x"], batch.worlds["y"]], -1)
    batch.step(actions)
    after = np.stack([batch.worlds["x"], batch.worlds["y"]], -1)
    moved = np.hypot(*(after - before).T).max()
    # The world integrates the drift of an AquaQuad in shorter steps.
    assert np.hypot(*(after - expected).T).max() < (1e-2 if vehicle == "aquaquad" else 1e-9) * moved


@pytest.mark.parametrize("steps", [1, 3])
def test_an_aquaquad_stays_in_its_box(steps):
    batch = worlds_of("aquaquad", 4, scenario="deep", energy_weight=0.0, battery_wh=1000.0)
    batch.worlds["x"] = 4500.0
    policy = make_policy(f"omlp-{steps}", batch)
    farthest = 0.0
    for _ in range(12):
        # Believed beyond the edge.
        batch.worlds["estimate"] = (9000.0, 500.0, 1000.0)
        batch.step(policy.act(batch.observations, batch.worlds))
        farthest = max(farthest, np.abs(batch.worlds["x"]).max())
        assert (batch.worlds["outcome"] == 0).all()
    assert 4000.0 < farthest < 5000.0


def test_an_aquaquad_hops_where_it_pays_and_its_battery_allows():
    def hops(**params):
        batch = worlds_of("aquaquad", 8, scenario="deep", **params)
        return batch, make_policy("omlp-2", batch).act(batch.observations, batch.worlds)

    batch, free = hops(energy_weight=0.0)
    assert (np.hypot(*free.T) > batch.params.drift_threshold).all()
    _, dear = hops(energy_weight=1000.0)
    assert not dear.any()
    batch.worlds["battery_wh"] = 1.0
    assert not make_policy("omlp-2", batch).act(batch.observations, batch.worlds).any()


def test_it_localizes_better_than_random_and_longer_horizons_pay():
    batch = aquaquad_envs.make_world_batch("transponder-localization", 24, scenario="single")
    found = {
        name: rollout(make_policy(name, batch), batch, np.arange(24)).metrics["log_det_true"].mean()
        for name in ("random", "omlp-1", "omlp-3")
    }
    assert found["random"] + 0.5 < found["omlp-1"] < found["omlp-3"] - 0.5

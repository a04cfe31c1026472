"""Readings, memory, messages, plume, reward and end of a plume tracing world."""

import numpy as np
import pytest

from aquaquad_envs.sensing.plume import steady_field
from aquaquad_envs.sensing.plume_puffs import plume_concentration
from aquaquad_envs.tasks import plume_tracing
from aquaquad_envs.tasks.plume_tracing_data import NEVER, TIME, VALUE
from aquaquad_envs.tasks.plume_tracing_observation import HALF_DISTANCE_M, OBSERVATION_NAMES, STATE_NAMES
from tests.tasks.plume_tracing_worlds import outcome, places, remembered, seen, stay, team, terms

PLUME = {"scenario": "turbulent", "num_fields": 4, "plume_age_s": 40.0}


@pytest.mark.parametrize("field", ["light", "oriented-light", "rational"])
def test_readings_are_the_field_at_the_robots(field):
    batch = stay(team(field=field, source_strength=3.0))
    w = batch.worlds[0]
    wanted = steady_field(field, places(batch) - (0, 0, 10), strength=3.0)
    np.testing.assert_allclose(w["reading"][:10], wanted, rtol=1e-12)
    np.testing.assert_allclose(w["distance"][:10], np.linalg.norm(places(batch) - (0, 0, 10), axis=1))


def test_plumes_are_read_where_their_puffs_are():
    batch = team(**PLUME, detection_floor=0.0)
    w = batch.worlds[0]
    batch.worlds["x"][0, :10] = w["puff_x"][5:15] + 0.1
    batch.worlds["y"][0, :10] = w["puff_y"][5:15]
    batch.worlds["z"][0, :10] = w["puff_z"][5:15]
    stay(batch)
    alive = int(w["released"])
    puffs = np.stack([w[f"puff_{name}"][:alive] for name in ("x", "y", "z", "birth")], -1)
    wanted = plume_concentration(batch.constants.puffs, puffs, places(batch), w["time_s"])
    np.testing.assert_allclose(w["reading"][:10], wanted, rtol=1e-12)
    assert (wanted > 0.1).all()


def test_a_plume_goes_with_the_current_at_its_age():
    still = {"dispersion_m2_s": 0.0, "meander_std_m_s": 0.0}
    batch = team(scenario="turbulent", num_fields=4, plume_age_s=100.0, current=(0.15, -0.1), **still)
    for _ in range(2):
        w = batch.worlds[0]
        alive = int(w["released"])
        assert alive == 51 + int(w["time_s"]) // 2
        age = w["time_s"] - w["puff_birth"][:alive]
        assert (age >= 0).all() and age.max() == pytest.approx(100 + w["time_s"])
        np.testing.assert_allclose(w["puff_x"][:alive], w["source_x"] + 0.15 * age, atol=1e-9)
        np.testing.assert_allclose(w["puff_y"][:alive], w["source_y"] - 0.1 * age, atol=1e-9)
        assert (w["puff_z"][:alive] == w["source_z"]).all()
        stay(batch, 11)


def test_old_puffs_make_room_for_new_ones():
    batch = stay(team(scenario="advected", num_fields=4, num_puffs=20, plume_age_s=60.0), 10)
    w = batch.worlds[0]
    assert w["released"] == 36
    assert sorted(w["time_s"] - w["puff_birth"][:20]) == pytest.approx([2.0 * k for k in range(20)])


def test_the_meander_has_its_spread_and_memory():
    batch = team(300, scenario="turbulent", num_fields=4, num_puffs=2, plume_age_s=4.0, meander_time_s=10.0)
    early = batch.worlds["meander_u"].copy()
    stay(batch, 10)
    late = batch.worlds["meander_u"]
    for values in (early, late, batch.worlds["meander_v"]):
        assert abs(values.mean()) < 4 * 0.06 / np.sqrt(300)
        assert values.std() == pytest.approx(0.06, rel=0.15)
    assert np.corrcoef(early, late)[0, 1] == pytest.approx(np.exp(-1), abs=0.16)


def test_both_integrators_follow_a_turning_current_alike():
    far = []
    for integrator in ("euler", "rk4"):
        batch = team(**{**PLUME, "scenario": "advected"}, current_variation=1.0, integrator=integrator)
        w = stay(batch, 5).worlds[0]
        far.append(np.stack([w["puff_x"][:22], w["puff_y"][:22]]))
    assert 0.0 < np.abs(far[0] - far[1]).max() < 0.5


def test_sensor_noise_and_what_lies_below_the_floor():
    quiet = stay(team(50)).worlds["reading"][:, :10]
    noisy = stay(team(50, sensor_noise=0.1)).worlds["reading"][:, :10]
    share = noisy / quiet - 1
    assert np.abs(share).max() <= 0.1 + 1e-12 and share.std() == pytest.approx(0.1 / np.sqrt(3), rel=0.1)
    batch = stay(team(detection_floor=float(np.median(quiet))))
    reading = batch.worlds["reading"][0, :10]
    assert 0 < (reading == 0).sum() < 10
    assert len(remembered(batch)) == (reading > 0).sum()
    silent = int(np.argmin(reading))
    assert seen(batch, "level", silent) == -1 and seen(batch, "detects", silent) == 0
    assert batch.worlds["own_whiff"][0, silent, TIME] == NEVER and seen(batch, "own whiff mask", silent) == 0


def walk(batch, steps):
    """Random moves; the readings of all robots at each step, the reset included: (steps + 1, n, 5)."""
    rng, log = np.random.default_rng(0), []
    for step in range(steps + 1):
        if step:
            batch.step(rng.uniform(-1, 1, batch.action_shape))
        w = batch.worlds[0]
        log.append(
            np.stack([w[name][: batch.num_agents] for name in ("seen_x", "seen_y", "seen_z", "reading")], -1)
        )
    return np.array(log)


def test_memory_holds_the_best_twenty_best_first():
    batch = team(memory_spacing_m=0.0)
    read = walk(batch, 9).reshape(-1, 4)
    best = read[np.argsort(-read[:, 3], kind="stable")[:20]]
    got = remembered(batch)
    np.testing.assert_array_equal(got[:, VALUE], best[:, 3])
    np.testing.assert_array_equal(got[:, :3], best[:, :3])
    assert (batch.worlds["memory_of"][0, :10] == 0).all(), "all hear all: one table serves them"


def test_memory_forgets_what_is_old_and_replaces_what_is_near():
    batch = team(memory_age_s=3.0, memory_spacing_m=0.0)
    walk(batch, 9)
    assert remembered(batch)[:, TIME].min() >= batch.worlds["time_s"][0] - 3.0
    batch = stay(team(memory_spacing_m=0.05), 5)
    assert len(remembered(batch)) == 10 and (remembered(batch)[:, TIME] == 5.0).all()
    batch = team(memory_spacing_m=0.05, memory_rows=4)
    walk(batch, 5)
    values = remembered(batch)[:, VALUE]
    assert len(values) == 4 and (np.diff(values) <= 0).all()


def test_robots_out_of_reach_or_out_of_luck_are_not_heard():
    batch = stay(team(comm_radius_m=15.0))
    here = places(batch)
    gaps = np.linalg.norm(here[:, None] - here, axis=-1)
    np.testing.assert_array_equal(batch.worlds["heard"][0, :10, :10], gaps <= 15.0)
    assert (batch.worlds["memory_of"][0, :10] == np.arange(10)).all()
    for robot in range(10):
        heard = batch.worlds["heard"][0, robot, :10].astype(bool)
        assert sorted(remembered(batch, robot)[:, VALUE]) == sorted(batch.worlds["reading"][0, :10][heard])
        rows = [seen(batch, f"robot {k} mask", robot) for k in range(1, 6)]
        assert sum(rows) == min(heard.sum() - 1, 5)
    lossy = stay(team(60, comm_loss=0.3)).worlds["heard"][:, :10, :10]
    assert (lossy[:, np.arange(10), np.arange(10)] == 1).all()
    assert lossy.sum() / 60 - 10 == pytest.approx(90 * 0.7, rel=0.04)


def test_reward_terms_are_progress_bonus_and_costs():
    batch = team(num_robots=2, at=[(0, 0, 6.0), (0, 4.0, 10.0)], source=(0, 0, 10), own_weight=1.0)
    stay(batch)
    batch.step(np.array([[[0, 0, 1], [0, -0.4, 0]]], dtype=float))
    for robot, own in enumerate((0.5, 0.2)):
        got = terms(batch, robot)
        assert got["closest"] == pytest.approx(0.1 * 0.5 / 0.5)
        assert got["mean"] == pytest.approx(0.05 * 0.35 / 0.5)
        assert got["own"] == pytest.approx(own / 0.5)
        assert got["reached"] == got["blocked"] == 0 and got["time"] == -0.02
        assert batch.rewards[0, robot] == pytest.approx(sum(got.values()))


@pytest.mark.parametrize("stops", [True, False])
def test_the_source_is_reached_by_staying_near_it(stops):
    batch = team(
        num_robots=2, at=[(0, 0, 9.2), (5, 0, 5)], source=(0, 0, 10), stop_at_source=stops, horizon_updates=6
    )
    for update in range(1, 7):
        away = update == 2
        if away:
            batch.worlds["z"][0, 0] = 8.5
        stay(batch)
        batch.worlds["z"][0, 0] = 9.2
        # Near at 1, away at 2: three seconds without a break are over at 5.
        assert (terms(batch)["reached"] == 10) == (update == 5)
        if update == 5 and stops:
            break
    assert outcome(batch) == ("reached" if stops else "time out")
    assert (batch.terminated.all(), batch.truncated.all()) == (stops, not stops)
    metrics = {name: value[0] for name, value in batch.metrics().items()}
    assert metrics["success"] == 1 and metrics["updates_to_source"] == 5
    assert metrics["closest_m"] == pytest.approx(0.8) and metrics["furthest_m"] == pytest.approx(
        np.hypot(5, 5)
    )
    assert metrics["center_of_mass_m"] == pytest.approx((0.8 + np.hypot(5, 5)) / 2)
    assert metrics["last_moved"] == 0
    assert batch.observations.any(), "the last step is seen"
    if not stops:
        assert terms(batch)["time"] == 0, "after the source is reached, time costs nothing"
    stay(batch)
    assert not batch.observations.any() and not batch.rewards.any()


def test_metrics_of_a_team_that_never_arrives():
    batch = stay(team(horizon_updates=4), 4)
    metrics = batch.metrics()
    assert metrics["success"] == 0 and metrics["updates_to_source"] == 4 and metrics["updates"] == 4
    batch = team(horizon_updates=4)
    batch.step(np.ones(batch.action_shape))
    stay(batch, 3)
    assert batch.metrics()["last_moved"] == 1


def test_observations_do_not_tell_where_the_source_is():
    """The same team about a source elsewhere sees the same."""
    one, other = team(current=(0, 0)), team(current=(0, 0))
    for name, shift in (("x", 12.0), ("y", -7.0)):
        other.worlds[f"source_{name}"] += shift
        other.worlds[name][:, :10] += shift
    for batch in (one, other):
        batch.worlds["memory_count"][:] = 0
        batch.worlds["heard_whiff"][..., TIME] = NEVER
        rng = np.random.default_rng(1)
        for _ in range(3):
            batch.step(rng.uniform(-1, 1, batch.action_shape))
    np.testing.assert_allclose(one.observations, other.observations, atol=1e-5)


def test_what_a_robot_sees():
    batch = team(num_robots=4, at=[(0, 0, 1.0), (3, 0, 5), (0, -4, 5), (20, 20, 5)], source=(0, 0, 10))
    stay(batch)
    w = batch.worlds[0]

    def vector(name, robot=0):
        return np.array([seen(batch, f"{name} d{axis}", robot) for axis in "xyz"])

    def squashed(d):
        return np.array(d) / (np.linalg.norm(d) + HALF_DISTANCE_M)

    assert seen(batch, "robot 1 mask") == 1 and seen(batch, "robot 4 mask") == 0
    np.testing.assert_allclose(vector("robot 1"), squashed((3, 0, 4)), atol=1e-6)
    np.testing.assert_allclose(vector("robot 2"), squashed((0, -4, 4)), atol=1e-6)
    assert seen(batch, "level") == pytest.approx(w["level"][0]) and w["level"][0] > w["level"][3]
    assert seen(batch, "wall z") == pytest.approx(-(1 - 1.0 / 5.0)) and seen(batch, "wall x") == 0
    best = remembered(batch)[0]
    np.testing.assert_allclose(vector("reading 1", 3), squashed(best[:3] - (20, 20, 5)), atol=1e-6)
    assert seen(batch, "reading 1 age", 3) == pytest.approx((1 - best[TIME]) / (11 - best[TIME]))
    assert seen(batch, "time left") == pytest.approx(1 - 1 / 50) and seen(batch, "turn") == 1
    angles = [
        np.arctan2(seen(batch, "identity sine", k), seen(batch, "identity cosine", k)) for k in range(4)
    ]
    assert len(set(np.round(angles, 3))) == 4


def test_whiffs_of_a_plume_are_told_with_flow_and_age():
    batch = team(**PLUME, current=(0.0, 0.2), detection_floor=1e-9, meander_std_m_s=0.0)
    w = batch.worlds[0]
    batch.worlds["x"][0, 0], batch.worlds["y"][0, 0], batch.worlds["z"][0, 0] = (
        w[f"puff_{n}"][3] for n in "xyz"
    )
    stay(batch)
    assert (
        seen(batch, "detects") == 1
        and seen(batch, "own whiff mask") == 1
        and seen(batch, "own whiff age") == 0
    )
    assert (seen(batch, "flow direction x"), seen(batch, "flow direction y")) == (0.0, 1.0)
    assert seen(batch, "flow speed") == pytest.approx(0.2 / 0.7)
    assert seen(batch, "latest whiff mask", 5) == 1
    heard = np.array([seen(batch, f"latest whiff d{axis}", 5) for axis in "xyz"])
    gap = places(batch)[0] - places(batch)[5]
    np.testing.assert_allclose(heard, gap / (np.linalg.norm(gap) + HALF_DISTANCE_M), atol=1e-6)
    batch.worlds["x"][0, 0] += 30
    stay(batch, 4)
    assert seen(batch, "detects") == 0 and seen(batch, "own whiff age") == pytest.approx(4 / 14)


def test_observations_and_state_stay_in_bounds_whatever_happens():
    harsh = {"sensor_noise": 0.5, "position_error_m": 2.0, "heading_error_deg": 90.0, "current_noise_m_s": 1.0,
             "comm_radius_m": 8.0, "comm_loss": 0.3, "step_limit_m": 3.0, "horizon_updates": 40}  # fmt: skip
    for params in ({**PLUME, **harsh}, {"field": "light", **harsh}, {"updates": "sequential", **harsh}):
        batch = team(4, **params)
        rng = np.random.default_rng(2)
        for _ in range(30):
            batch.step(rng.uniform(-1, 1, batch.action_shape))
            for array in (batch.observations, batch.state()):
                assert np.isfinite(array).all() and np.abs(array).max() <= 1
    assert batch.observations.shape == (4, 10, len(OBSERVATION_NAMES))
    assert batch.state().shape == (4, len(STATE_NAMES))


def test_the_central_view_knows_the_source():
    batch = stay(team(source=(5.0, -10.0, 10.0)))
    view = dict(zip(STATE_NAMES, batch.state()[0], strict=True))
    assert view["source x"] == pytest.approx(0.1) and view["source y"] == pytest.approx(-0.2)
    gap = np.array([5.0, -10.0, 10.0]) - places(batch)[2]
    got = [view[f"robot 3 source d{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(got, gap / (np.linalg.norm(gap) + HALF_DISTANCE_M), atol=1e-6)
    assert view["robot 11 mask"] == 0


def test_level_scales():
    assert plume_tracing.level_scale(
        plume_tracing.Params(scenario="surround", field="light")
    ) == pytest.approx(1 / 400)
    assert plume_tracing.level_scale(
        plume_tracing.Params(scenario="surround", field="rational", rational_offset_m2=100.0)
    ) == pytest.approx(1 / 500)

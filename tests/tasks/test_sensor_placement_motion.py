"""How vehicles, targets and the fence of sensor placement move, what it costs, and how missions end."""

import numpy as np
import pytest

from aquaquad_envs.tasks.sensor_placement_data import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.sensor_placement_targets import equivalent_density
from tests.tasks.sensor_placement_worlds import drift, outcomes, sea, seen, terms

SQUARE = [(-2000.0, -2000.0), (2000.0, -2000.0), (2000.0, 2000.0), (-2000.0, 2000.0)]


def act(batch, **hops):
    """One decision: ``v0=(x, y)`` and so on hop, the others drift, in every world."""
    actions = np.zeros(batch.action_shape)
    for name, hop in hops.items():
        actions[:, int(name[1:])] = hop
    batch.step(actions)


def test_a_drift_goes_with_the_current_and_costs_no_flight():
    batch = sea(u=0.5, v=-0.25, at=SQUARE)
    drift(batch)
    w = batch.worlds[0]
    assert w["x"][:4] == pytest.approx(np.array(SQUARE)[:, 0] + 150)
    assert w["y"][:4] == pytest.approx(np.array(SQUARE)[:, 1] - 75)
    assert (w["drift_s"][:4] == 300).all() and not w["flight_wh"].any() and not w["hops"].any()
    assert terms(batch)["energy"] == 0 and (w["on_water"][:4] == 1).all()


def test_a_hop_flies_its_way_and_drifts_the_rest():
    batch = sea(u=0.5, at=SQUARE)
    act(batch, v0=(0.6, -0.8), v1=(0.0, 0.5))
    w = batch.worlds[0]
    length = 4000 / 3
    assert (w["x"][0], w["y"][0]) == pytest.approx((-2000 + 0.6 * length + 90.0, -2000 - 0.8 * length))
    assert (w["x"][1], w["y"][1]) == pytest.approx((2000 + 0.5 * 240, -2000 + 0.5 * length))
    assert w["flight_s"][:4] == pytest.approx([120, 60, 0, 0])
    assert w["drift_s"][:4] == pytest.approx([180, 240, 300, 300])
    assert w["flight_wh"][:4] == pytest.approx([200 / 30, 100 / 30, 0, 0])
    assert list(w["hops"][:4]) == [1, 1, 0, 0]
    assert w["on_water"][:4] == pytest.approx([0.6, 0.8, 1, 1])
    assert terms(batch)["energy"] == pytest.approx(-0.5 * 10 / 40)
    assert batch.metrics()["flight_energy_wh"][0] == pytest.approx(10.0)


def test_energy_is_conserved():
    batch = sea(64, scenario="gyres", num_fields=8, num_vehicles=5, initial_charge=0.3, solar="constant")
    rng = np.random.default_rng(0)
    start = batch.worlds["battery_wh"].copy()
    for _ in range(72):
        hop = rng.uniform(size=(64, 5, 1)) < 0.4
        batch.step(np.where(hop, rng.uniform(-1, 1, (64, 5, 2)), 0.0))
    w = batch.worlds
    gained = w["solar_wh"] - w["spent_wh"] - w["clipped_wh"]
    assert np.allclose(w["battery_wh"], start + gained, atol=1e-9)
    assert (w["battery_wh"] >= 0).all() and (w["battery_wh"] <= 178).all()
    alive = batch.outcomes == OUTCOMES.index("time out")
    time_s = np.broadcast_to(w["time_s"][:, None], alive.shape)
    flown = (w["drift_s"] + w["flight_s"])[:, :5]
    assert np.allclose(flown[alive], time_s[alive])
    assert np.allclose((w["spent_wh"] - w["flight_wh"])[:, :5][alive], 7.5 * time_s[alive] / 3600)
    ends = {OUTCOMES[k] for k in np.unique(batch.outcomes)}
    assert ends == {"time out", "left box", "collision", "battery empty"}


def test_vehicles_die_alone_and_stay_dead():
    batch = sea(
        at=[(4500.0, 0.0), (0.0, 3500.0), (0.0, -3500.0), (-3500.0, 0.0)],
        obstacles=((-200, 4200, 200, 4800),),
    )
    act(batch, v0=(1.0, 0.0), v1=(0.0, 0.75))
    assert outcomes(batch) == ["left box", "collision", "running", "running"]
    assert batch.terminated[0].tolist() == [True, True, False, False] and not batch.truncated.any()
    assert terms(batch)["failure"] == terms(batch, 3)["failure"] == pytest.approx(-2.5)
    assert np.ptp(batch.rewards[0]) == 0 and batch.worlds["outcome"][0] == 0
    place = batch.worlds["x"][0, :2].copy()
    act(batch, v0=(1.0, 0.0), v2=(0.1, 0.0))
    assert (batch.worlds["x"][0, :2] == place).all() and batch.worlds["hops"][0, 0] == 1
    assert not batch.observations[0, :2].any() and batch.observations[0, 2:].any()
    assert not batch.rewards[0, :2].any() and batch.terminated[0].tolist() == [True, True, False, False]
    assert seen(batch, "vehicles", 2) == pytest.approx(2 / 8)
    assert seen(batch, "vehicle 1 alive", 2) == 1 and seen(batch, "vehicle 2 alive", 2) == 0
    assert seen(batch, "vehicle 2 mask", 2) == 1 and seen(batch, "vehicle 4 mask", 2) == 0
    assert seen(batch, "HDOP", 2) > 0.999, "two vehicles and one time difference fix nothing"


def test_the_mission_ends_by_time_or_with_the_last_vehicle():
    batch = drift(sea(horizon_s=600.0), 2)
    assert outcomes(batch) == ["time out"] * 4 and batch.truncated.all() and batch.finished.all()
    assert OUTCOMES[batch.worlds["outcome"][0]] == "time out"
    assert batch.observations.any(-1).all() and seen(batch, "time left") == 0, (
        "the last observation is a real one"
    )
    assert batch.rewards.all()
    drift(batch)
    assert not batch.observations.any() and not batch.rewards.any() and batch.truncated.all()
    assert batch.worlds["time_s"][0] == 600
    lost = sea(at=[(4900.0, 0.0)] * 4)
    act(lost, **{f"v{k}": (1.0, 0.0) for k in range(4)})
    assert (
        OUTCOMES[lost.worlds["outcome"][0]] == "team lost" and lost.terminated.all() and lost.finished.all()
    )


def test_an_empty_battery_ends_a_vehicle_in_the_air():
    batch = sea(at=SQUARE, initial_charge=0.02, start_time="2014-06-21T08:00")
    act(batch, v0=(1.0, 0.0))
    assert outcomes(batch) == ["battery empty", "running", "running", "running"]
    assert batch.worlds["battery_wh"][0, 0] == 0


def test_the_grid_steers_at_its_speed_and_costs_nothing():
    batch = sea(scenario="grid", at=[(0.0, 0.0), (0.0, 0.0), (990.0, 0.0)])
    act(batch, v0=(0.6, -0.8), v1=(0.5, 0.0), v2=(3.0, 4.0))
    w = batch.worlds[0]
    assert w["x"][:3] == pytest.approx([18.0, 15.0, 1000.0]) and w["y"][:3] == pytest.approx(
        [-24.0, 0.0, 24.0]
    )
    assert not w["flight_wh"].any() and (w["battery_wh"][:3] == 178).all()


def start_and_move(decisions, **params):
    """Velocities of the targets (decisions + 1, worlds, 2)."""
    batch = sea(
        400, num_vehicles=3, half_width_m=30_000.0, max_hop_m=600.0, sub_steps=1, horizon_s=6e4, **params
    )
    log = []
    for _ in range(decisions + 1):
        log.append(np.stack([batch.worlds["target_u"][:, 0], batch.worlds["target_v"][:, 0]], -1))
        drift(batch)
    return np.array(log), batch


def test_constant_velocity_is_disturbed_by_white_acceleration():
    q = 1e-5
    velocity, _ = start_and_move(30, action_period_s=60.0, target_noise_m2_s3=q)
    assert np.var(np.diff(velocity, axis=0)) == pytest.approx(q * 60, rel=0.06)
    straight, batch = start_and_move(5, action_period_s=60.0, target_noise_m2_s3=0.0)
    assert np.ptp(straight, axis=0).max() == 0 and np.hypot(*straight[0].T) == pytest.approx(0.3)
    edge = 0.8 * 30_000 + 1e-6
    ahead = batch.worlds["target_x"][:, 0] + straight[-1][:, 0] * (6e4 - 360)
    assert (abs(ahead) <= edge).all(), "a course was chosen that leaves the box"


@pytest.mark.parametrize("motion", ["manoeuvring", "stop-and-go"])
def test_manoeuvres_have_the_stated_speeds_and_density(motion):
    params = {"manoeuvre_interval_s": 1500.0, "stop_time_s": 700.0, "target_speed_m_s": 0.4}
    velocity, _ = start_and_move(200, action_period_s=60.0, target_motion=motion, **params)
    speed = np.hypot(*velocity[1:].reshape(-1, 2).T)
    if motion == "manoeuvring":
        assert speed.min() >= 0.2 - 1e-9 and speed.max() <= 0.4 + 1e-9 and np.ptp(speed) > 0.19
    else:
        assert (np.isclose(speed, 0.4) | (speed == 0)).all()
        assert np.mean(velocity[75:].any(-1)) == pytest.approx(1500 / 2200, abs=0.06)
    change = np.mean(np.diff(velocity[75:], axis=0) ** 2) / 60
    assert change == pytest.approx(equivalent_density(motion, 0.4, 0.0, 1500.0, 700.0), rel=0.1)


@pytest.mark.parametrize("motion", ["constant-velocity", "manoeuvring", "stop-and-go"])
def test_fast_targets_stay_in_the_box(motion):
    batch = sea(32, target_motion=motion, target_speed_m_s=5.0, num_targets=5)
    farthest = 0.0
    for _ in range(72):
        drift(batch)
        farthest = max(farthest, abs(batch.worlds["target_x"]).max(), abs(batch.worlds["target_y"]).max())
    assert 0.9 * 5000 < farthest <= 0.95 * 5000 + 5.1 * 60


def fence_batch(**params):
    return sea(scenario="fence", num_fields=2, **params)


def test_the_fence_moves_slowly_and_keeps_its_shape():
    batch = fence_batch(worlds=50, fence_speed_m_s=0.2)
    before = batch.worlds["fence"].copy()
    pieces = np.hypot(*np.diff(before, axis=1).transpose(2, 0, 1))
    assert pieces.sum(1) == pytest.approx(6000.0) and pieces == pytest.approx(2000.0)
    drift(batch)
    moved = batch.worlds["fence"] - before
    assert np.allclose(np.hypot(*moved[:, 0].T), 60.0) or np.hypot(*moved[:, 0].T).max() <= 60.0 + 1e-9
    assert np.ptp(moved, axis=1) == pytest.approx(0.0, abs=1e-9)
    drift(batch, 71)
    assert abs(batch.worlds["fence"]).max() <= 5000


def test_coverage_counts_the_vehicles_on_their_nodes():
    """On the nodes of the stated density all is covered; half the team covers half."""
    batch = fence_batch(fence_speed_m_s=0.0)
    batch.constants = batch.constants._replace(still_water=True)
    w = batch.worlds[0]

    def node(share):
        along = share * 3
        k = min(int(along), 2)
        return w["fence"][k] + (along - k) * (w["fence"][k + 1] - w["fence"][k])

    w["x"][:4], w["y"][:4] = np.transpose([node((k + 0.5) / 4) for k in range(4)])
    drift(batch)
    assert seen(batch, "coverage") == 1 == terms(batch)["coverage"]
    assert seen(batch, "gap dx") == 0 == seen(batch, "gap dy") or seen(batch, "fence dx") == pytest.approx(
        0, abs=0.03
    )
    w["x"][1], w["y"][1] = w["x"][0], w["y"][0]
    w["x"][3], w["y"][3] = w["x"][2], w["y"][2]
    drift(batch)
    assert 0.5 <= seen(batch, "coverage") <= 0.75
    gap = np.array([seen(batch, "gap dx"), seen(batch, "gap dy")]) * 10_000
    place = np.array([w["x"][0], w["y"][0]]) + gap
    reach = [np.hypot(*(place - [w["x"][k], w["y"][k]])) for k in range(1, 4)]
    assert min(reach) > batch.params.fence_cover_m, "the gap is out of the reach of all others"
    covered = batch.metrics()["coverage"][0]
    assert covered == pytest.approx(0.5 + 0.5 * seen(batch, "coverage"))
    assert np.isnan(batch.metrics()["tracking_rmse_m"][0]) and np.isfinite(batch.observations).all()


def test_a_rough_fix_is_paid_for_on_request():
    plain, hurried = (sea(8, acquisition_weight=weight) for weight in (0.0, 5.0))
    term = REWARD_TERMS.index("acquisition")
    for batch in (plain, hurried):
        drift(batch)
    assert not plain.reward_terms[..., term].any()
    scale = 20.0 * hurried.constants.fix_scale
    error = np.sqrt(hurried.worlds["error2_sum"] / hurried.worlds["cycles"])
    assert hurried.reward_terms[:, 0, term] == pytest.approx(5.0 * scale / (scale + error))


def test_terms_are_named_and_sum_to_the_reward():
    batch = sea(16, num_targets=2)
    act(batch, v0=(0.5, 0.5))
    assert batch.reward_terms.shape == (16, 4, len(REWARD_TERMS))
    assert batch.rewards == pytest.approx(batch.reward_terms.sum(-1))


def test_room_is_the_way_to_the_edge_or_to_an_obstacle():
    batch = drift(sea(20, at=[(4000.0, 100.0), (0.0, -4990.0), (2500.0, 2500.0), (-3000.0, 0.0)]))
    walled = drift(sea(1, at=[(1500.0, 0.0)], obstacles=((-1000.0, -1000.0, 1000.0, 1000.0),)))
    reach = batch.params.max_hop_m
    assert seen(walled, "room") == pytest.approx(500.0 / reach, rel=0.02)
    for world in range(20):
        w = batch.worlds[world]
        for vehicle in range(4):
            here = np.array([w["x"][vehicle], w["y"][vehicle]])
            towards = w["estimate"][0, :2] - here
            heading = np.arctan2(towards[1], towards[0])
            assert seen(batch, "room", vehicle, world) == pytest.approx(
                min((5000.0 - np.abs(here).max()) / reach, 1.0), abs=1e-5
            )
            for turn in (0, 90, 225):
                angle = heading + np.radians(turn)
                landing = here + batch.constants.short_hop * np.array([np.cos(angle), np.sin(angle)])
                room = np.clip((5000.0 - np.abs(landing).max()) / reach, -1.0, 1.0)
                assert seen(batch, f"room after hop {turn}°", vehicle, world) == pytest.approx(room, abs=1e-5)

"""The tracker and its bound inside the world of sensor placement: consistent, bounded, robust."""

import numpy as np
import pytest
from scipy import stats

from aquaquad_envs.estimation.posterior_bound import posterior_bound
from tests.tasks.sensor_placement_worlds import bounds, drift, errors, sea, seen, squashed_hdop

KINDS = ("bearing", "range", "tdoa")


def position_nees(batch):
    w = batch.worlds
    e = np.stack([w["estimate"][:, 0, k] - w[f"target_{axis}"][:, 0] for k, axis in enumerate("xy")], -1)
    return np.einsum("wi,wij,wj->w", e, np.linalg.inv(w["covariance"][:, 0, :2, :2]), e)


def ring(batch, radius=2500.0, turn=0.0):
    """Put all vehicles evenly around the first target."""
    n = batch.num_agents
    angle = turn + 2 * np.pi * np.arange(n) / n
    batch.worlds["x"][:, :n] = batch.worlds["target_x"][:, :1] + radius * np.cos(angle)
    batch.worlds["y"][:, :n] = batch.worlds["target_y"][:, :1] + radius * np.sin(angle)
    return batch


@pytest.mark.parametrize("tracker", ["ukf", "ekf"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_matched_tracker_is_consistent_and_reaches_its_bound(kind, tracker):
    """Four vehicles that hold still about the target: NEES is χ², and the error that of the bound."""
    batch = ring(
        sea(600, measurement=kind, tracker=tracker, half_width_m=10_000.0, initial_position_std_m=20.0)
    )
    drift(batch, 20)
    nees = position_nees(batch).sum()
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], 2 * 600)
    assert low < nees < high
    # Error² over bound², two degrees of freedom a world.
    ratio = np.mean(errors(batch) ** 2 / bounds(batch) ** 2)
    assert 1 - 4 / np.sqrt(600) < ratio < 1 + 4 / np.sqrt(600)
    assert not batch.worlds["times_lost"].any() and not batch.worlds["repairs"].any()


@pytest.mark.parametrize("kind", KINDS)
def test_no_tracker_beats_the_bound_along_an_episode(kind):
    batch = sea(400, measurement=kind)
    rng = np.random.default_rng(1)
    for _ in range(40):
        hop = rng.uniform(size=(400, 4, 1)) < 0.1
        batch.step(np.where(hop, rng.uniform(-0.3, 0.3, (400, 4, 2)), 0.0))
    m = batch.metrics()
    ratio = m["tracking_rmse_m"] / m["bound_rmse_m"]
    assert 0.95 < np.sqrt(np.mean(ratio**2)) < 1.3 and 0.9 < np.median(ratio) < 1.1


@pytest.mark.parametrize("pairs", ["reference", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_bound_is_the_posterior_bound_of_the_geometry(kind, pairs):
    batch = sea(
        3,
        measurement=kind,
        sub_steps=1,
        num_vehicles=5,
        tdoa_pairs=pairs,
        noise_level=0.5,
        half_width_m=20_000.0,
    )
    c, p, rng = batch.constants, batch.params, np.random.default_rng(0)
    prior = np.diag([100.0**2, 100.0**2, 0.2**2, 0.2**2])
    log = []
    for _ in range(6):
        batch.step(rng.uniform(-0.5, 0.5, batch.action_shape))
        w = batch.worlds
        log.append(
            (np.stack([w["target_x"][:, 0], w["target_y"][:, 0]], -1), np.stack([w["x"], w["y"]], -1)[:, :5])
        )
    targets, vehicles = (np.stack(part, 1) for part in zip(*log, strict=True))
    away = np.linalg.norm(vehicles - targets[:, :, None], axis=-1)
    if kind != "tdoa":
        here = there = vehicles
        mean2 = away**2
    else:
        near = away.argmin(-1)[..., None]
        if pairs == "all":
            first, second = (np.broadcast_to(k, (*near.shape[:2], 10)) for k in np.triu_indices(5, 1))
        else:
            first, second = np.broadcast_to(np.arange(5), away.shape), np.broadcast_to(near, away.shape)
        here, there = (np.take_along_axis(vehicles, k[..., None], 2) for k in (first, second))
        mean2 = 0.5 * sum(np.take_along_axis(away, k, 2) ** 2 for k in (first, second))
    stds = p.measurement_std * np.sqrt(1 + (0.5 / 1000) ** 2 * mean2)
    expected = posterior_bound(c.truth_motion, prior, 300.0, targets, kind, here, stds, others=there)
    assert bounds(batch)[:, 0] == pytest.approx(expected.position_rmse_m[:, -1], rel=1e-9)


@pytest.mark.parametrize("pairs", ["reference", "all"])
@pytest.mark.parametrize("kind", KINDS)
def test_observed_hdop_is_that_of_the_team_about_the_estimate(kind, pairs):
    batch = drift(sea(measurement=kind, num_vehicles=5, tdoa_pairs=pairs, seed=3))
    w, c = batch.worlds[0], batch.constants
    place = np.stack([w["x"], w["y"]], -1)[:5]
    target = w["estimate"][0, :2]

    def squashed(points):
        return squashed_hdop(points, target, kind, pairs, c, c.fix_scale)

    now = squashed(place)
    assert seen(batch, "HDOP") == pytest.approx(now, rel=1e-5)
    for i in (0, 3):
        assert seen(batch, "HDOP share", i) == pytest.approx(squashed(np.delete(place, i, 0)) - now, abs=1e-6)
        ahead = (target - place[i]) / np.linalg.norm(target - place[i])
        for degrees in (0, 45, 270):
            turn = np.radians(degrees)
            hop = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]] @ ahead * c.short_hop
            after = place.copy()
            after[i] += hop
            change = seen(batch, f"HDOP after hop {degrees}°", i)
            assert change == pytest.approx(squashed(after) - now, abs=1e-6), degrees


def test_mean_hdop_is_that_of_the_vehicles_on_the_water():
    batch = ring(sea(measurement="range", target_speed_m_s=0.0, target_noise_m2_s3=0.0))
    drift(batch)
    assert batch.metrics()["mean_hdop"][0] == pytest.approx(50.0, rel=1e-6), "2σ/√4"
    # Two take off for two of five steps, one at the end of which they are still in the air, and come back.
    hop = np.zeros((1, 4, 2))
    hop[0, :2] = (0.0, 0.7)
    batch.step(hop)
    assert batch.metrics()["mean_hdop"][0] > 50.0


def test_tracks_are_seen_from_the_vehicle():
    batch = drift(sea(measurement="range", num_targets=3, seed=5))
    w = batch.worlds[0]
    for i in range(4):
        dx, dy = (w["estimate"][:3, k] - w[name][i] for k, name in enumerate("xy"))
        order = np.argsort(np.hypot(dx, dy))
        for row, j in enumerate(order, 1):
            e = np.array([dx[j], dy[j]]) / np.hypot(dx[j], dy[j])
            turn = np.array([e, [-e[1], e[0]]])
            p = turn @ w["covariance"][j, :2, :2] @ turn.T
            s = batch.constants.fix_scale
            expected = {
                "dx": dx[j] / 1e4, "dy": dy[j] / 1e4, "distance": np.hypot(dx[j], dy[j]) / 1.5e4, "direction x": e[0],
                "direction y": e[1], "std along": np.sqrt(p[0, 0]) / (np.sqrt(p[0, 0]) + s),
                "std across": np.sqrt(p[1, 1]) / (np.sqrt(p[1, 1]) + s), "mask": 1, "lost": 0, "age": 0,
                "correlation": p[0, 1] / np.sqrt(p[0, 0] * p[1, 1]),
            }  # fmt: skip
            for name, value in expected.items():
                assert seen(batch, f"target {row} {name}", i) == pytest.approx(value, abs=1e-5), name
        assert seen(batch, "target 4 mask", i) == 0


def test_the_numbering_of_vehicles_does_not_matter():
    """Geometry, energy and bound of a permuted team are the same; only the draws of noise are dealt otherwise."""
    order = np.array([2, 0, 4, 1, 3])
    kinds = {}
    for kind in KINDS:
        plain, other = (sea(8, u=0.3, measurement=kind, num_vehicles=5, seed=9) for _ in range(2))
        for name in ("x", "y", "start_x", "start_y"):
            other.worlds[name][:, :5] = plain.worlds[name][:, order]
        rng = np.random.default_rng(2)
        for _ in range(5):
            actions = rng.uniform(-0.6, 0.6, (8, 5, 2))
            plain.step(actions)
            other.step(actions[:, order])
        for name in ("x", "y", "battery_wh", "flight_wh", "agent_outcome"):
            assert np.array_equal(other.worlds[name][:, :5], plain.worlds[name][:, order]), name
        assert np.allclose(bounds(other), bounds(plain), rtol=1e-9)
        assert np.allclose(other.worlds["hdop_s"], plain.worlds["hdop_s"], rtol=1e-9)
        kinds[kind] = bounds(plain).mean()
    assert kinds["tdoa"] < kinds["range"] < kinds["bearing"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_lost_track_is_found_again(kind):
    batch = ring(sea(100, measurement=kind))
    drift(batch, 3)
    batch.worlds["estimate"][:, 0, :2] += [3000.0, -2500.0]
    drift(batch)
    assert (batch.worlds["times_lost"][:, 0] >= 1).mean() > 0.97
    drift(batch, 8)
    assert (errors(batch)[:, 0] < 4 * bounds(batch)[:, 0]).mean() > 0.9
    assert batch.worlds["lost"][:, 0].mean() < 0.1
    assert np.median(position_nees(batch)) < 5


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_a_broken_track_is_mended(value):
    batch = ring(sea(4))
    batch.worlds["estimate"][0, 0, 0] = value
    batch.worlds["covariance"][1, 0, :4, :4] = value
    drift(batch, 3)
    assert np.isfinite(batch.worlds["estimate"]).all() and np.isfinite(batch.worlds["covariance"]).all()
    assert np.isfinite(batch.observations).all() and np.isfinite(batch.rewards).all()
    assert (errors(batch) < 100).all()


def test_measurements_that_come_late_are_taken_back_to_their_time():
    """Without that a target at 1 m/s would be tracked 60 m, half a minute and more, behind itself."""
    params = {
        "target_speed_m_s": 1.0,
        "target_noise_m2_s3": 0.0,
        "initial_velocity_std_m_s": 0.05,
        "horizon_s": 3600.0,
    }
    late, prompt = (ring(sea(300, half_width_m=10_000.0, sharing_delay_s=d, **params)) for d in (30.0, 0.0))
    drift(late, 10)
    drift(prompt, 10)
    assert np.sqrt(np.mean(errors(late) ** 2)) < 2.5 * np.sqrt(np.mean(errors(prompt) ** 2)) < 10
    # It has all that was measured but for the last minutes: χ² as ever, if a little wider.
    assert 1.2 < position_nees(late).mean() < 2.6
    assert (late.worlds["pending_count"] < 20).all() and not late.worlds["pending_lost"].any()
    assert bounds(late) == pytest.approx(bounds(prompt), rel=1e-3), "the bound does not wait"


def test_travel_times_are_taken_off():
    """Sound takes seconds from 10 km away, in which a target at 5 m/s goes 33 m; the track does not lag by them."""
    params = {
        "target_speed_m_s": 5.0, "target_noise_m2_s3": 0.0, "initial_velocity_std_m_s": 0.05, "horizon_s": 3600.0,
        "half_width_m": 30_000.0,
    }  # fmt: skip
    batch = ring(sea(200, travel_time_level=1.0, **params), radius=10_000.0)
    drift(batch, 8)
    w = batch.worlds
    course = np.stack([w["target_u"][:, 0], w["target_v"][:, 0]], -1) / 5.0
    error = np.stack([w["estimate"][:, 0, k] - w[f"target_{axis}"][:, 0] for k, axis in enumerate("xy")], -1)
    behind = -(error * course).sum(-1)
    assert abs(behind.mean()) < 4.0


def test_links_fail_in_bursts():
    batch = sea(500, dropout=0.3, dropout_burst_s=900.0, sub_steps=1, target_noise_m2_s3=0.0)
    log = []
    for _ in range(40):
        drift(batch)
        log.append(batch.worlds["link_down"][:, :4].copy())
    down = np.array(log) == 1
    assert down.mean() == pytest.approx(0.3, abs=0.02)
    # A link that is down is down 300 s later with π + (1 - π) exp(-Δt / (burst (1 - π))).
    stays = (down[1:] & down[:-1]).sum() / down[:-1].sum()
    assert stays == pytest.approx(0.3 + 0.7 * np.exp(-300 / (900 * 0.7)), abs=0.02)
    prompt = drift(sea(500, sub_steps=1, target_noise_m2_s3=0.0), 40)
    assert np.median(bounds(batch)) > 1.1 * np.median(bounds(prompt)), "what is lost helps nobody"


def test_levels_at_zero_change_nothing():
    plain = drift(sea(6), 4)
    zero = {
        "noise_reference_m": 10.0,
        "source_level_db": 0.0,
        "dropout_burst_s": 10.0,
        "emission_period_s": 7.0,
    }
    other = drift(sea(6, **zero), 4)
    assert np.array_equal(plain.worlds["estimate"], other.worlds["estimate"])
    assert np.array_equal(plain.observations, other.observations)


def test_what_is_not_heard_ages():
    silent = drift(sea(detection_level=1.0, source_level_db=-100.0), 2)
    assert silent.worlds["measured_s"][0, 0] == 0 and seen(silent, "target 1 age") == pytest.approx(2 / 6)
    pinging = drift(sea(100, emissions="periodic", emission_period_s=1200.0), 4)
    assert (pinging.worlds["measured_s"][:, 0] > 0).all()
    assert 300 < np.mean(1200 - pinging.worlds["measured_s"][:, 0]) < 900
    assert bounds(silent)[0, 0] > 1.5 * np.median(bounds(pinging))


def test_vehicles_in_flight_are_deaf():
    batch = ring(sea(max_hop_m=3333.0))
    before = bounds(batch)[0, 0]
    hops = np.zeros((1, 4, 2))
    hops[0, ::2, 0], hops[0, 1::2, 0] = 1.0, -1.0
    batch.step(hops)
    assert batch.worlds["measured_s"][0, 0] in (0.0, 300.0)
    assert batch.worlds["on_water"][0, :4] == pytest.approx(0.0, abs=1e-3)
    assert before == pytest.approx(100 * np.sqrt(2))

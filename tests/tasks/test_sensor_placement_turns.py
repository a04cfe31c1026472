"""What a team agrees on: hops in turn, and regrouping while it is badly placed."""

import numpy as np
import pytest

from aquaquad_envs.tasks.sensor_placement_turns import AHEAD, BADLY_PLACED, KEPT
from tests.tasks.sensor_placement_worlds import drift, sea, seen, squashed_hdop

KINDS = ("bearing", "range", "tdoa")


def turned(arm, degrees):
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ arm


def squash_gain(gain):
    return gain / (abs(gain) + 0.01)


def after_hops(i, points, target, kind, c, scale):
    """HDOP without a hop of vehicle i and after each short one, the hop it makes, and the places after each."""
    ahead = (target - points[i]) / np.linalg.norm(target - points[i])
    places = [points]
    for degrees in range(0, 360, 45):
        moved = points.copy()
        moved[i] += c.short_hop * turned(ahead, degrees)
        places.append(moved)
    found = np.array([squashed_hdop(p, target, kind, "reference", c, scale) for p in places])
    rooms = np.array([(5000.0 - np.abs(p[i]).max()) / c.longest_step for p in places])
    if rooms[0] >= 0.15:
        worth = np.where((rooms > 0.15) | (np.arange(9) == 0), -found, -np.inf)
    else:
        worth = np.where(rooms > rooms[0], 0.3 * np.minimum(rooms, 0.5) - found, -np.inf)
    return found, int(worth.argmax()), places


def turns(place, target, kind, c):
    """Vehicles in the order of their turns: the one whose best hop alone is best goes first."""
    alone = []
    for i in range(len(place)):
        found, best, _ = after_hops(i, place, target, kind, c, c.fix_scale)
        alone.append(found[best])
    assert len(set(np.round(alone, 9))) == len(place), "no ties to be broken by rounding"
    return np.argsort(alone)


def believed(batch, vehicles):
    """Places (vehicles, 2), and the target's believed one."""
    w = batch.worlds[0]
    return np.stack([w["x"], w["y"]], -1)[:vehicles], w["estimate"][0, :2]


def good_track(batch):
    """The target is amid the team where it is believed to be, so surely that the team need not regroup."""
    w = batch.worlds
    n = batch.num_agents
    w["target_x"][:, 0], w["target_y"][:, 0] = w["x"][:, :n].mean(1), w["y"][:, :n].mean(1)
    for k, name in enumerate(("target_x", "target_y", "target_u", "target_v")):
        w["estimate"][:, 0, k] = w[name][:, 0]
    w["covariance"] = np.diag([1e-3, 1e-3, 1e-9, 1e-9, 1e-9, 1e-9])
    return batch


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_hops_in_turn_against_plain_loops(kind, seed):
    """The best placed hops first; the next knows where it went. Near the edge some hops have no room to land."""
    batch = sea(measurement=kind, num_vehicles=5, seed=seed)
    batch.worlds["x"][:, :2] = [[4900.0, 4300.0]]
    drift(good_track(batch))
    c = batch.constants
    points, target = believed(batch, 5)
    room = (5000.0 - np.abs(points).max(1)) / c.longest_step
    assert room[0] < 0.15 < room[1]
    for turn, i in enumerate(turns(points, target, kind, c)):
        found, best, places = after_hops(i, points, target, kind, c, 20.0 * c.fix_scale)
        assert seen(batch, "turn", i) == pytest.approx((1 + turn) / 8)
        assert seen(batch, "HDOP before turn", i) == pytest.approx(found[0], abs=1e-6)
        for k, degrees in enumerate(range(0, 360, 45)):
            change = seen(batch, f"HDOP after hop {degrees}° in turn", i)
            assert change == pytest.approx(found[1 + k] - found[0], abs=1e-6), (turn, degrees)
        hop = (places[best][i] - points[i]) / c.longest_step
        assert [seen(batch, f"turn hop d{axis}", i) for axis in "xy"] == pytest.approx(list(hop), abs=1e-6)
        assert seen(batch, "turn hop gain", i) == pytest.approx(squash_gain(found[0] - found[best]), abs=1e-5)
        points = places[best]


def information(kind, points, target, c):
    """Information (2, 2), 1/m², that vehicles at ``points`` gather about the target."""
    arm = target - points
    far = np.linalg.norm(arm, axis=1)
    look = arm / far[:, None]
    rows = look
    if kind == "tdoa":
        rows = (look - look[far.argmin()]) / c.sound_speed
    elif kind == "bearing":
        rows = np.stack([-look[:, 1], look[:, 0]], -1) / far[:, None]
    return rows.T @ rows / c.std**2


def predicted_log_error(kind, points, flying, target, covariance, c):
    """Of a track whose first step is without those ``flying``."""
    total, known = 0.0, np.linalg.inv(covariance)
    for step in range(AHEAD):
        known = KEPT * known + information(kind, points[~flying] if step == 0 else points, target, c)
        total += np.trace(np.linalg.inv(known))
    return 0.5 * np.log(total / AHEAD)


def badly_placed(kind, seed):
    """A team in a corner, its target far off, its track as wide as a fix of theirs."""
    batch = sea(measurement=kind, num_vehicles=4, seed=seed)
    w, rng = batch.worlds, np.random.default_rng(seed)
    w["x"][0, :4], w["y"][0, :4] = rng.uniform(-4200.0, -2500.0, (2, 4))
    w["target_x"][0, 0], w["target_y"][0, 0] = 2000.0, 2600.0
    w["estimate"][0, 0, :2] = 2050.0, 2570.0
    w["covariance"][0, 0, :2, :2] = max(100.0, 5.0 * batch.constants.fix_scale) ** 2 * np.eye(2)
    return drift(batch)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_regrouping_against_plain_loops(kind, seed):
    """From the hops in turn, each vehicle once more: it stays, goes far towards the target, or keeps to its hop."""
    batch = badly_placed(kind, seed)
    c = batch.constants
    place, target = believed(batch, 4)
    covariance = batch.worlds["covariance"][0, 0, :2, :2]
    order = np.argsort([seen(batch, "turn", i) for i in range(4)])
    plan = place
    for i in order:
        _, best_hop, places = after_hops(i, plan, target, kind, c, 20.0 * c.fix_scale)
        plan = places[best_hop].copy()
    flying, gains = np.zeros(4, dtype=bool), np.zeros(4)
    best = predicted_log_error(kind, plan, flying, target, covariance, c)
    assert best > np.log(BADLY_PLACED * c.fix_scale)

    def price(i, point):
        flown_s = np.linalg.norm(point - place[i]) / c.airspeed
        return 0.01 * c.flight_power * flown_s / 3600.0

    for i in order:
        ahead = (target - place[i]) / np.linalg.norm(target - place[i])
        options = [(place[i], False)]
        options += [(place[i] + 2.0 * c.short_hop * turned(ahead, d), True) for d in (0, 45, 90, 270, 315)]
        least, found, values = best + price(i, plan[i]) - 1e-3, None, []
        for point, far in options:
            points, air = plan.copy(), flying.copy()
            points[i], air[i] = point, far
            values.append(predicted_log_error(kind, points, air, target, covariance, c))
            room = (5000.0 - np.abs(point).max()) / c.longest_step
            if values[-1] + price(i, point) < least and (not far or room > 0.15):
                least, found = values[-1] + price(i, point), (point, far, values[-1])
        if found is not None:
            plan[i], flying[i], best = found
        gains[i] = values[0] - best
    assert flying.any(), "somebody goes ahead"
    for i in range(4):
        hop = (plan[i] - place[i]) / c.longest_step
        assert [seen(batch, f"turn hop d{axis}", i) for axis in "xy"] == pytest.approx(list(hop), abs=1e-6)
        assert seen(batch, "turn hop gain", i) == pytest.approx(squash_gain(gains[i]), abs=1e-5)


def test_a_team_that_hears_well_does_not_regroup():
    """The long hops of a badly placed team miss a measurement; those of a good one are short."""
    far = badly_placed("tdoa", 3)
    near = drift(good_track(sea(measurement="tdoa", num_vehicles=4, seed=3)))
    lengths = [
        max(np.hypot(seen(batch, "turn hop dx", i), seen(batch, "turn hop dy", i)) for i in range(4))
        for batch in (far, near)
    ]
    short = far.constants.short_hop / far.constants.longest_step
    assert lengths[0] == pytest.approx(2.0 * short) and lengths[1] <= short + 1e-6

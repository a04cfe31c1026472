"""Plans and how they are followed: hand-made plans in a toy sea whose motion is known exactly."""

import dataclasses

import numpy as np
import pytest

from baselines.plan import DRIFT, FOLLOWING, HOP, LEG, NEEDS_PLAN, FollowSettings, Plan, PlanFollower

PERIOD, MAX_HOP, MIN_HOP, SPEED = 600.0, 1000.0, 100.0, 10.0
SETTINGS = FollowSettings(
    watch_radius=150.0, deviation=400.0, patience=1200.0, period=PERIOD, max_hop=MAX_HOP, min_hop=MIN_HOP
)


def make_plan(*corners, current=0.5):
    """Legs along the x axis: ("drift", seconds) with ``current`` or ("hop", x, y)."""
    legs, track = [], [(0.0, 0.0, 0.0)]
    for kind, *values in corners:
        t, x, y = track[-1]
        if kind == "drift":
            end = (t + values[0], x + current * values[0], y)
            legs.append((DRIFT, x, y, end[1], end[2], t, end[0]))
        else:
            end = (t + np.hypot(values[0] - x, values[1] - y) / SPEED, *values)
            legs.append((HOP, x, y, values[0], values[1], t, end[0]))
        track.append(end)
    return Plan(
        legs=np.array(legs, LEG), track=np.array(track), flight_energy_wh=1.0, success=True, iterations=1
    )


class ToySea:
    """One world in a uniform current."""

    def __init__(self, follower, current=(0.5, 0.0), at=(0.0, 0.0)):
        self.follower, self.current = follower, np.array(current)
        self.position, self.time, self.hops = np.array(at, dtype=float), 0.0, []

    def decide(self):
        action = np.zeros((1, 2), np.float32)
        x, y = self.position
        self.follower.act(np.array([x]), np.array([y]), np.array([self.time]), np.array([True]), action)
        return action[0].astype(float)

    def step(self):
        action = self.decide()
        if np.hypot(*action) < MIN_HOP / MAX_HOP * 0.999:
            self.position += self.current * PERIOD
            self.time += PERIOD
        else:
            self.position += action * MAX_HOP
            self.time += np.hypot(*action) * MAX_HOP / SPEED
            self.hops.append(np.hypot(*action) * MAX_HOP)


def follower_of(plan):
    follower = PlanFollower(1, SETTINGS)
    follower.follow(0, plan)
    return follower


def test_plan_equality_ignores_the_time_it_took():
    plan = make_plan(("drift", 1200.0), ("hop", 700.0, 2500.0))
    assert plan == dataclasses.replace(plan, planning_time_s=9.0)
    assert plan != dataclasses.replace(plan, flight_energy_wh=2.0)
    other = plan.legs.copy()
    other["x1"][0] += 1e-9
    assert plan != dataclasses.replace(plan, legs=other)
    assert plan.duration_s == plan.legs["t1"][-1]
    assert len(plan.flights) == 1


def test_perfect_forecast_reaches_every_landing_exactly():
    plan = make_plan(("drift", 1800.0), ("hop", 900.0, 3500.0), ("drift", 600.0), ("hop", 1200.0, 3000.0))
    sea = ToySea(follower_of(plan))
    for _ in range(3 + 4 + 1 + 1):
        sea.step()
    np.testing.assert_allclose(sea.position, (1200.0, 3000.0), atol=1e-3)
    # 3500 m take four equal pieces, none longer than the longest hop.
    np.testing.assert_allclose(sea.hops[:4], 875.0, atol=1e-3)
    assert sea.time == pytest.approx(plan.duration_s, abs=1e-3)
    # The plan is used up: the next decision asks for a new one.
    sea.decide()
    assert sea.follower.status[0] == NEEDS_PLAN


def test_landing_takes_the_drift_error_back():
    plan = make_plan(("drift", 1200.0), ("hop", 600.0, 800.0))
    sea = ToySea(follower_of(plan), current=(0.5, 0.1))  # 120 m off at take-off: inside the circle
    for _ in range(3):
        sea.step()
    np.testing.assert_allclose(sea.position, (600.0, 800.0), atol=1e-3)


def test_missed_circle_asks_for_a_new_plan():
    plan = make_plan(("drift", 1200.0), ("hop", 600.0, 800.0))
    sea = ToySea(follower_of(plan), current=(0.3, 0.0))  # 240 m short, and getting nearer
    while not sea.hops and sea.time < 10_000:
        sea.step()
    # It waits a period, in which it drifts into the circle, and then takes off.
    assert sea.time == pytest.approx(1800.0 + sea.hops[0] / SPEED)
    sea = ToySea(follower_of(plan), current=(0.5, 0.2))  # 240 m aside, and getting farther
    while sea.follower.status[0] == FOLLOWING and sea.time < 10_000:
        sea.step()
    assert sea.follower.status[0] == NEEDS_PLAN
    assert not sea.hops


def test_deviation_asks_for_a_new_plan_before_the_take_off_is_due():
    plan = make_plan(("drift", 12_000.0), ("hop", 6000.0, 800.0))
    sea = ToySea(follower_of(plan), current=(0.5, 0.2))  # 120 m aside each period: beyond 400 m at 2400 s
    while sea.follower.status[0] == FOLLOWING and sea.time < 12_000:
        sea.step()
    assert sea.time <= 3000.0


def test_tiny_flights_are_flown_at_the_least_hop():
    plan = make_plan(("hop", 20.0, 0.0), ("drift", 600.0), ("hop", 320.0, 500.0))
    sea = ToySea(follower_of(plan))
    sea.step()
    np.testing.assert_allclose(sea.position, (MIN_HOP, 0.0), atol=1e-3)
    sea.step()
    assert len(sea.hops) == 1  # it drifts next and does not hop back
    sea.step()
    np.testing.assert_allclose(sea.position, (320.0, 500.0), atol=1e-3)


def test_off_schedule_take_off_rounds_to_the_nearest_decision():
    plan = make_plan(("drift", 1380.0), ("hop", 690.0, 800.0))  # decisions fall at 1200 and 1800 s
    sea = ToySea(follower_of(plan))
    for _ in range(3):
        sea.step()
    assert sea.time == pytest.approx(1200.0 + sea.hops[0] / SPEED)


def test_worlds_that_do_not_run_are_left_alone():
    follower = PlanFollower(2, SETTINGS)
    long_plan = make_plan(*[("hop", 500.0 * i, 0.0) for i in range(1, 30)])  # outgrows the first arrays
    follower.follow(1, make_plan(("hop", 500.0, 0.0)))
    follower.follow(0, long_plan)
    actions = np.zeros((2, 2), np.float32)
    zeros = np.zeros(2)
    follower.act(zeros, zeros, zeros, np.array([False, True]), actions)
    np.testing.assert_allclose(actions, [(0, 0), (0.5, 0)])
    follower.act(zeros, zeros, zeros, np.array([True, False]), actions)
    np.testing.assert_allclose(actions, [(0.5, 0), (0.5, 0)])  # what another call wrote stays
    follower.clear(np.array([1]))
    assert list(follower.status) == [FOLLOWING, NEEDS_PLAN]

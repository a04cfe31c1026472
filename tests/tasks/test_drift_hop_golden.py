"""The drift/hop world against a second, plain-Python writing of the same rules, step by step."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import aquaquad_envs
from aquaquad_envs.tasks.drift_hop_kernels import OUTCOMES, REWARD_TERMS
from aquaquad_envs.tasks.drift_hop_observation import OBSERVATION_NAMES

CASES = {
    "vortex": {"scenario": "vortex"},
    "published variant": {
        "scenario": "vortex",
        "integrator": "euler",
        "interpolation": "cell",
        "solar": "constant",
    },
    "perturbed, 2016": {"scenario": "vortex-perturbed", "energy": "2016", "initial_charge": 0.2},
    "gyres": {"scenario": "gyres", "num_fields": 6, "sub_steps": 7, "action_period_s": 900.0},
    "forecast error": {
        "scenario": "forecast-error",
        "num_fields": 4,
        "team": ((1000.0, 4000.0), (-3000.0, -100.0)),
        "start_time_spread_s": 20_000.0,
        "goal_radius_m": 800.0,
    },
    "tide": {
        "scenario": "tide",
        "num_fields": 3,
        "battery_wh": 30.0,
        "progress_weight": 0.3,
        "failure_penalty": 2.0,
    },
}


class Reference:
    """Rules of the world on Python floats; nothing is shared with the kernels but the gridded data."""

    def __init__(self, batch):
        self.p, self.ocean = batch.params, batch.ocean

    @staticmethod
    def bilinear(table, x, y, x0, y0, spacing):
        rows, columns = len(table), len(table[0])
        a = min(max((x - x0) / spacing, 0.0), columns - 1.0)
        b = min(max((y - y0) / spacing, 0.0), rows - 1.0)
        j, i = min(int(a), columns - 2), min(int(b), rows - 2)
        a, b = a - j, b - i
        return (
            table[i][j] * (1 - a) * (1 - b)
            + table[i][j + 1] * a * (1 - b)
            + table[i + 1][j] * (1 - a) * b
            + table[i + 1][j + 1] * a * b
        )

    def current(self, field, t, x, y):
        frames, axes = self.ocean.velocity[field], self.ocean.axes
        if axes.by_cell:
            column = min(max(int((x - axes.x0) // axes.spacing), 0), frames.shape[2] - 1)
            row = min(max(int((y - axes.y0) // axes.spacing), 0), frames.shape[1] - 1)
            return tuple(frames[0, row, column])
        s = min(max((t - axes.time0) / axes.time_step, 0.0), len(frames) - 1.0)
        first = min(int(s), max(len(frames) - 2, 0))
        now = [self.bilinear(frames[first, ..., c], x, y, axes.x0, axes.y0, axes.spacing) for c in (0, 1)]
        if len(frames) == 1:
            return tuple(now)
        later = [
            self.bilinear(frames[first + 1, ..., c], x, y, axes.x0, axes.y0, axes.spacing) for c in (0, 1)
        ]
        return tuple(a + (s - first) * (b - a) for a, b in zip(now, later, strict=True))

    def clearance(self, layer, x, y):
        return self.bilinear(self.ocean.clearance[layer], x, y, *self.ocean.clearance_grid)

    def charge(self, start, end):
        times = self.ocean.solar_step * np.arange(len(self.ocean.collected_wh))
        return np.interp(end, times, self.ocean.collected_wh) - np.interp(
            start, times, self.ocean.collected_wh
        )

    def drifted(self, w, t, dt):
        def velocity(after, x, y):
            return np.array(self.current(w.truth, t + after, x, y))

        here = np.array([w.x, w.y])
        k1 = velocity(0.0, *here)
        if self.p.integrator == "euler":
            return here + dt * k1
        k2 = velocity(dt / 2, *(here + dt / 2 * k1))
        k3 = velocity(dt / 2, *(here + dt / 2 * k2))
        k4 = velocity(dt, *(here + dt * k3))
        return here + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def outcome(self, w):
        if max(abs(w.x), abs(w.y)) > self.p.half_width_m:
            return "left box"
        if self.clearance(w.obstacle, w.x, w.y) < 0:
            return "collision"
        return "goal" if math.dist((w.x, w.y), (w.goal_x, w.goal_y)) <= self.p.goal_radius_m else "running"

    def use(self, w, start, seconds, power):
        """Charge and spend over ``seconds``; whether the battery could not give what was asked."""
        charged, wanted = self.charge(start, start + seconds), power * seconds / 3600
        spent = min(wanted, w.battery_wh + charged)
        kept = w.battery_wh + charged - spent
        w.battery_wh = min(kept, self.p.battery_wh)
        w.solar_wh += charged
        w.spent_wh += spent
        w.clipped_wh += kept - w.battery_wh
        return wanted > spent

    def hdop(self, w):
        target = (w.goal_x + self.p.target_offset[0], w.goal_y + self.p.target_offset[1])
        sensors = np.array([*self.p.team, (w.x, w.y)])
        if not self.p.team:
            return 0.0
        d = np.array(target) - sensors
        h = np.stack([-d[:, 1], d[:, 0]], -1) / (d**2).sum(1, keepdims=True)
        try:
            return min(math.sqrt(np.trace(np.linalg.inv(h.T @ h))), 9000.0)
        except np.linalg.LinAlgError:
            return 9000.0

    def step(self, w, action):
        """Advance ``w`` in place; the reward's terms by name."""
        p = self.p
        size = math.hypot(*action)
        before, hdop, began, flown = math.dist((w.x, w.y), (w.goal_x, w.goal_y)), self.hdop(w), w.time_s, 0.0
        if size < p.drift_threshold:
            outcome, dt = "running", p.action_period_s / p.sub_steps
            for _ in range(p.sub_steps):
                now = w.clock_s + w.time_s
                w.x, w.y = self.drifted(w, now, dt)
                empty = self.use(w, now, dt, p.base_power_w)
                w.time_s += dt
                w.drift_s += dt
                outcome = self.outcome(w)
                if outcome == "running" and empty:
                    outcome = "battery empty"
                if outcome != "running":
                    break
        else:
            length = p.max_hop_m * min(size, 1.0)
            seconds = length / p.airspeed_m_s
            w.x += length * action[0] / size
            w.y += length * action[1] / size
            empty = self.use(w, w.clock_s + w.time_s, seconds, p.base_power_w + p.flight_power_w)
            w.time_s += seconds
            w.flight_s += seconds
            w.hops += 1
            flown = p.flight_power_w * seconds / 3600
            w.flight_wh += flown
            outcome = "battery empty" if empty else self.outcome(w)
        if outcome == "running" and w.time_s >= p.horizon_s:
            outcome = "time out"
        w.steps += 1
        w.hdop_s += hdop * (w.time_s - began)
        w.outcome = OUTCOMES.index(outcome)
        gained = (
            (before - math.dist((w.x, w.y), (w.goal_x, w.goal_y))) / p.airspeed_m_s * p.flight_power_w / 3600
        )
        return {
            "flight": -flown / 10,
            "progress": p.progress_weight * gained / 10,
            "arrival": p.arrival_bonus if outcome == "goal" else 0.0,
            "failure": -p.failure_penalty if outcome not in ("running", "goal", "time out") else 0.0,
        }

    def observation(self, w):
        """Every observation by name, from its meaning in docs/drift_hop.md."""
        p, now, half = self.p, w.clock_s + w.time_s, self.p.half_width_m
        dx, dy = w.goal_x - w.x, w.goal_y - w.y
        distance = math.hypot(dx, dy)
        # Local solar time: UTC of the mission's start, plus 4 minutes a degree east.
        start = np.datetime64(p.start_time)
        utc = (start - start.astype("datetime64[D]")) / np.timedelta64(1, "s")
        angle = 2 * math.pi * (utc + now + p.longitude * 240) / 86_400
        u, v = self.current(w.truth, now, w.x, w.y)
        fu, fv = self.current(w.forecast, now, w.x, w.y)
        h = self.ocean.clearance_grid.spacing / 2
        slope = np.array([
            self.clearance(w.obstacle, w.x + h, w.y) - self.clearance(w.obstacle, w.x - h, w.y),
            self.clearance(w.obstacle, w.x, w.y + h) - self.clearance(w.obstacle, w.x, w.y - h),
        ])  # fmt: skip
        steepness = np.hypot(*slope)
        near = -slope / steepness if steepness > 1e-9 else np.zeros(2)
        seen = {
            "x": w.x / half, "y": w.y / half, "goal dx": dx / half / 2, "goal dy": dy / half / 2,
            "goal distance": distance / half / 3, "goal direction x": dx / distance,
            "goal direction y": dy / distance, "goal hop x": dx / max(distance, p.max_hop_m),
            "goal hop y": dy / max(distance, p.max_hop_m), "battery": w.battery_wh / p.battery_wh,
            "sin local time": math.sin(angle), "cos local time": math.cos(angle),
            "time left": 1 - w.time_s / p.horizon_s, "current u": u / 2, "current v": v / 2,
            "obstacle distance": self.clearance(w.obstacle, w.x, w.y) / p.max_hop_m,
            "obstacle direction x": near[0], "obstacle direction y": near[1], "HDOP": self.hdop(w) / 9000,
            "forecast u": fu / 2, "forecast v": fv / 2,
        }  # fmt: skip
        x, y, t = w.x, w.y, now
        for hours in (1, 2, 4):
            while t < now + hours * 3600 - 1:
                a, b = self.current(w.forecast, t, x, y)
                x, y, t = x + 1200 * a, y + 1200 * b, t + 1200
            seen[f"drift dx in {hours} h"], seen[f"drift dy in {hours} h"] = (
                (x - w.x) / half,
                (y - w.y) / half,
            )
        for degrees in range(0, 360, 45):
            heading = math.atan2(dy, dx) + math.radians(degrees)
            hop = p.max_hop_m * np.array([math.cos(heading), math.sin(heading)])
            far, half_way = np.add((w.x, w.y), hop), np.add((w.x, w.y), hop / 2)
            a, b = self.current(w.forecast, now, *far)
            seen[f"forecast u {degrees}°"], seen[f"forecast v {degrees}°"] = a / 2, b / 2
            seen[f"obstacle distance {degrees}°"] = self.clearance(w.obstacle, *far) / p.max_hop_m
            seen[f"obstacle distance half-way {degrees}°"] = (
                self.clearance(w.obstacle, *half_way) / p.max_hop_m
            )
        return {name: min(max(value, -1.0), 1.0) for name, value in seen.items()}


def plain(record):
    return SimpleNamespace(**{n: record[n].item() for n in record.dtype.names if not n.startswith("rng")})


def action_near(rng, batch, i):
    """Half the time adrift, else a hop, at times straight to the goal."""
    w, kind = batch.worlds[i], rng.uniform()
    if kind < 0.5:
        return rng.uniform(-0.07, 0.07, 2)
    if kind < 0.7:
        beside = rng.uniform(-40, 40, 2)
        return (np.array([w["goal_x"] - w["x"], w["goal_y"] - w["y"]]) + beside) / batch.params.max_hop_m
    return rng.uniform(-1.5, 1.5, 2)


@pytest.mark.parametrize("name", CASES)
def test_every_step_of_whole_episodes(name):
    """Records, rewards and observations; the reference starts each step from the kernels' record."""
    batch = aquaquad_envs.make_world_batch("drift-hop", 6, **CASES[name])
    reference, rng = Reference(batch), np.random.default_rng(4)
    batch.reset(3)
    outcomes, decisions = set(), 0
    for _ in range(60):
        before = [plain(record) for record in batch.worlds]
        actions = np.array([action_near(rng, batch, i) for i in range(6)])
        batch.step(actions)
        for i, w in enumerate(before):
            terms = reference.step(w, actions[i])
            after = plain(batch.worlds[i])
            for field in vars(w):
                assert getattr(after, field) == pytest.approx(getattr(w, field), rel=1e-12, abs=2e-9), field
            assert dict(zip(REWARD_TERMS, batch.reward_terms[i], strict=True)) == pytest.approx(
                terms, abs=1e-11
            )
            assert batch.rewards[i] == pytest.approx(sum(terms.values()), abs=1e-11)
            seen = reference.observation(w)
            assert tuple(seen) == OBSERVATION_NAMES
            np.testing.assert_allclose(batch.observations[i], list(seen.values()), atol=2e-7, err_msg=name)
            decisions += 1
        ended = batch.terminated | batch.truncated
        outcomes |= {OUTCOMES[k] for k in batch.worlds["outcome"][ended]}
        batch.reset(mask=ended)
    assert decisions == 360 and outcomes, "no episode ended: nothing of the ends was compared"


def test_the_cases_reach_every_kind_of_end():
    """What the golden runs above compare is worth stating: together they meet every outcome."""
    met = set()
    for case in CASES.values():
        batch = aquaquad_envs.make_world_batch("drift-hop", 6, **case)
        rng = np.random.default_rng(4)
        batch.reset(3)
        for _ in range(60):
            batch.step(np.array([action_near(rng, batch, i) for i in range(6)]))
            ended = batch.terminated | batch.truncated
            met |= {OUTCOMES[k] for k in batch.worlds["outcome"][ended]}
            batch.reset(mask=ended)
    assert met >= {"goal", "collision", "left box", "battery empty"}

"""What is observed: against formulas of NumPy's own, and unchanged when the map is turned or enlarged."""

import numpy as np
import pytest

from aquaquad_envs.tasks.transponder_localization_observation import FAN, LOOKS, OBSERVATION_NAMES
from tests.tasks.transponder_worlds import DEEP, flow, play, seen, unpacked, water

HALFWAY = [0.5, -0.2, 0.9, 0.0] * 3


def rows(batch, what, world=0):
    return np.array([seen(batch, f"transponder {m} {what}", world) for m in range(1, 7)])


def length(value, step=3.0):
    """A length as observed."""
    logarithm = np.log(1 + value / step)
    return logarithm / (logarithm + 2)


def gains(world, path, sigma=0.12):
    """Gain in the sum of ln det Y, of ranges taken along ``path`` (n, 2)."""
    total = 0.0
    for m in range(world["num_transponders"]):
        before = unpacked(world["information"][m])
        after = before.copy()
        for x, y in path:
            line = world["estimate"][m] - (x, y, 0.0)
            after += np.outer(line, line) / (line @ line) / sigma**2
        total += np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]
    return total


def test_transponders_stand_least_certain_first_in_the_frame_of_the_heading():
    batch = play(water(scenario="four"), HALFWAY)
    w = batch.worlds[0]
    order = np.argsort([np.linalg.slogdet(unpacked(w["information"][m]))[1] for m in range(4)])
    assert rows(batch, "mask").tolist() == [1, 1, 1, 1, 0, 0]
    frame = np.array(
        [[np.cos(w["heading"]), np.sin(w["heading"])], [-np.sin(w["heading"]), np.cos(w["heading"])]]
    )
    line = (w["estimate"][order, :2] - (w["x"], w["y"])) @ frame.T
    away = np.hypot(*line.T)
    assert rows(batch, "direction ahead")[:4] == pytest.approx(line[:, 0] / away, abs=1e-6)
    assert rows(batch, "direction left")[:4] == pytest.approx(line[:, 1] / away, abs=1e-6)
    assert rows(batch, "distance")[:4] == pytest.approx(length(away), abs=1e-6)
    assert rows(batch, "depth")[:4] == pytest.approx(length(w["estimate"][order, 2]), abs=1e-6)
    assert not rows(batch, "replies")[4:].any() and rows(batch, "replies")[:4].tolist() == [1, 1, 1, 1]


def test_axes_are_those_of_the_ellipsoid_whatever_their_sign():
    batch = play(water(), HALFWAY)
    w = batch.worlds[0]
    values, vectors = np.linalg.eigh(unpacked(w["information"][0]))
    logarithm = np.log(0.12**2 * values[::-1])
    for k in range(3):
        assert seen(batch, f"transponder 1 information {k + 1}") == pytest.approx(
            logarithm[k] / (abs(logarithm[k]) + 8), abs=1e-5
        )
    cos, sin = np.cos(w["heading"]), np.sin(w["heading"])
    for name, k in (("best", 2), ("worst", 0)):
        for sign in (1.0, -1.0):
            x, y, down = sign * vectors[:, k]
            ahead, left = cos * x + sin * y, cos * y - sin * x
            expected = (ahead**2 - left**2, 2 * ahead * left, down**2, 2 * ahead * down, 2 * left * down)
            parts = ("along", "diagonal", "down", "ahead down", "left down")
            for part, value in zip(parts, expected, strict=True):
                assert seen(batch, f"transponder 1 {name} axis {part}") == pytest.approx(value, abs=1e-4)


@pytest.mark.parametrize("scenario", ["single", "four"])
def test_gains_are_those_of_the_steps_they_stand_for(scenario):
    batch = play(water(scenario=scenario), HALFWAY)
    w = batch.worlds[0]
    paths = {look: [] for look in LOOKS}
    for rate in np.linspace(-1, 1, FAN):
        turns = np.cumsum(np.full(3, np.radians(30.0) * rate))
        steps = 3.0 * np.stack([np.cos(w["heading"] + turns), np.sin(w["heading"] + turns)], -1)
        here = np.array([w["x"], w["y"]])
        for count, look in ((1, "1 step"), (3, "3 steps"), (8, "8 steps")):
            paths[look].append(here + np.arange(1, count + 1)[:, None] * steps[0])
        paths["3 turns"].append(here + np.cumsum(steps, axis=0))
    for look in LOOKS:
        gain = np.array([gains(w, path) for path in paths[look]])
        share = [seen(batch, f"action {a} in {look}") for a in range(1, FAN + 1)]
        assert share == pytest.approx((gain - gain.min()) / np.ptp(gain), abs=1e-4)
        best, choice = gain.max() / w["num_transponders"], np.ptp(gain) / w["num_transponders"]
        assert seen(batch, f"gain in {look}") == pytest.approx(best / (1 + best), abs=1e-5)
        assert seen(batch, f"choice in {look}") == pytest.approx(choice / (choice + 0.1), abs=1e-4)


def test_gains_of_free_steps_in_a_current():
    batch = play(flow(water(vehicle="greedy"), 0.4, -0.3), [[0.5, 0.5], [-0.2, 0.7], [0.0, 0.1]])
    w = batch.worlds[0]
    angles = np.arange(8) * np.pi / 4
    free = 5.0 * np.stack([np.cos(angles), np.sin(angles)], -1)
    steps = np.concatenate([free, np.zeros((1, 2))]) + np.array([0.4, -0.3])
    gain = np.array(
        [gains(w, np.array([w["x"], w["y"]]) + np.arange(1, 4)[:, None] * step) for step in steps]
    )
    share = [seen(batch, f"action {a} in 3 steps") for a in range(1, FAN + 1)]
    assert share == pytest.approx((gain - gain.min()) / np.ptp(gain), abs=1e-4)
    assert not any(seen(batch, f"action {a} in 3 turns") for a in range(1, FAN + 1))
    assert (seen(batch, "current ahead"), seen(batch, "current left")) == pytest.approx(
        (0.08 / 1.08, -0.06 / 1.06)
    )


def test_looks_end_with_the_last_measurement():
    batch = play(water(num_measurements=5), [0.2] * 2)
    assert seen(batch, "time left") == pytest.approx(0.5)
    two = [seen(batch, f"action {a} in 3 steps") for a in range(1, FAN + 1)]
    assert two == [seen(batch, f"action {a} in 8 steps") for a in range(1, FAN + 1)]
    assert two != [seen(batch, f"action {a} in 1 step") for a in range(1, FAN + 1)]
    play(batch, [0.2] * 2)
    assert seen(batch, "time left") == 0.0 and seen(batch, "gain in 1 step") == 0.0


def turned(angle, scale=1.0):
    """The world of four transponders, turned about the origin and enlarged."""
    cos, sin = np.cos(angle), np.sin(angle)

    def turn(x, y):
        return scale * (cos * x - sin * y), scale * (sin * x + cos * y)

    places = ((17.0, 15.0, 6.0), (-2.0, -1.0, 7.0), (5.0, 5.0, 10.0))
    batch = water(
        scenario="random", transponders=tuple((*turn(x, y), scale * z) for x, y, z in places),
        start=turn(-3.0, 9.0), start_heading_deg=float(np.degrees(angle)) - 30.0, period_s=scale,
        range_std_m=0.12 * scale, prior_std_m=(20.0 * scale, 20.0 * scale, 2.0 * scale), half_width_m=60.0 * scale,
    )  # fmt: skip
    # The draw of the first estimates knows east from north: give all worlds the same, turned.
    w = batch.worlds[0]
    errors = ((5.0, -3.0, 1.0), (2.0, 4.0, -1.0), (-6.0, 1.0, 0.5))
    for m, ((x, y, z), (ex, ey, ez)) in enumerate(zip(places, errors, strict=True)):
        w["prior_mean"][m] = w["estimate"][m] = (*turn(x + ex, y + ey), scale * (z + ez))
    return play(batch, HALFWAY)


@pytest.mark.parametrize("angle, scale", [(1.0, 1.0), (-2.5, 1.0), (0.0, 100.0), (2.0, 50.0)])
def test_a_turned_or_enlarged_map_looks_the_same(angle, scale):
    plain, other = turned(0.0), turned(angle, scale)
    assert other.observations == pytest.approx(plain.observations, abs=2e-4)
    assert plain.observations.std() > 0.1


def test_only_the_aquaquad_observes_its_life():
    names = ("x", "y", "battery", "cos local time", "obstacle distance")
    batch = play(water(**DEEP), [[0.5, 0.5]])
    w = batch.worlds[0]
    assert seen(batch, "x") == pytest.approx(w["x"] / 5000) and seen(batch, "battery") == pytest.approx(
        w["battery_wh"] / 178
    )
    assert all(seen(batch, name) != 0.0 for name in names)
    assert not any(seen(play(water(scenario="current", num_fields=2), [0.5]), name) for name in names)


def test_scales_of_own_numbers():
    batch = water(scenario="four")
    assert seen(batch, "transponders") == pytest.approx(4 / 6)
    assert seen(batch, "greatest turn") == pytest.approx(1 / 6)
    assert seen(batch, "measurements left") == pytest.approx(29 / 39) and seen(batch, "time left") == 1.0
    assert seen(batch, "step over noise") == pytest.approx(np.log(25) / (np.log(25) + 4))
    noisy = water(300, scenario="current", num_fields=2, current_level=0.0, current_noise_m_s=0.3)
    ahead = noisy.observations[:, OBSERVATION_NAMES.index("current ahead")]
    assert np.std(3.0 * ahead / (1 - np.abs(ahead))) == pytest.approx(0.3, rel=0.15)

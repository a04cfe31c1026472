"""The bank of hypotheses, and the particles beside it: first light to a sure centre."""

import math

import numpy as np
import pytest
from scipy import stats

from aquaquad_envs.errors import InvalidParameterError
from aquaquad_envs.estimation.kalman_motion import make_motion
from aquaquad_envs.estimation.laser_bank import (
    BANK,
    HYPOTHESES,
    bank_begin,
    bank_begin_line,
    bank_cycle,
)
from aquaquad_envs.estimation.laser_ekf import WORK, LaserEkf, make_laser_model
from aquaquad_envs.estimation.laser_particles import LaserParticles, process_noise
from aquaquad_envs.sensing.laser import detectable_radius, intensity, make_beam

BEAM, HEIGHT, DT = make_beam(), 8.0, 0.1
W = detectable_radius(BEAM, HEIGHT)
MODEL = make_laser_model(BEAM, HEIGHT, intensity_std=5e-4)
MOTION = make_motion("constant-velocity", density=1e-5, step_variances=(2.5e-5, 0.0, 0.0))


def new_bank(course=(1.0, 0.0), r=1.2 * W):
    bank = np.zeros(1, dtype=BANK)[0]
    bank_begin(bank, r, 0.1 * W, *course, 0.0, 0.0, 0.02)
    return bank


def moments(bank):
    n = bank["count"]
    weights, states = bank["weights"][:n], bank["states"][:n]
    mean = weights @ states
    apart = states - mean
    return mean, np.einsum("k,kij->ij", weights, bank["covariances"][:n] + apart[:, :, None] * apart[:, None])


def cross(offset, *, steps=40, speed=0.5, seed=0):
    """A receiver meets the disc at ``offset`` (in W) beside its centre and flies straight on: centre seen, readings."""
    rng = np.random.default_rng(seed)
    start = math.sqrt(1.2**2 - offset**2) * W
    d = np.stack([start - speed * DT * np.arange(steps + 1), np.full(steps + 1, offset * W)], axis=-1)
    return d, [intensity(BEAM, math.hypot(*p), HEIGHT) + MODEL.std * rng.normal() for p in d]


def test_first_light_is_an_arc_ahead():
    bank = new_bank(course=(0.0, 2.0))
    assert bank["count"] == HYPOTHESES and bank["weights"].sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.hypot(*bank["states"][:, :2].T), 1.2 * W)
    mean, spread = moments(bank)
    # Of a chord at random π/4 r ahead, but for the share that is taken to lie anywhere; nothing to the side.
    assert mean[:2] == pytest.approx([0.0, 0.9 * math.pi / 4 * 1.2 * W], rel=0.02, abs=1e-9)
    assert spread[0, 0] == pytest.approx((0.9 / 3 + 0.1 / 2) * (1.2 * W) ** 2, rel=0.1)
    assert (np.linalg.eigvalsh(bank["covariances"]) > 0).all()


@pytest.mark.parametrize("offset", [-0.7, 0.3, 0.9])
def test_a_crossing_finds_the_centre_up_to_its_side(offset):
    """A straight course cannot tell left from right: both sides stay, and one of them is the centre."""
    d, readings = cross(offset)
    bank, work = new_bank(), np.zeros(WORK)
    for k in range(1, len(d)):
        bank_cycle(bank, work, DT, *(d[k - 1] - d[k]), MOTION, MODEL, readings[k])
        n = bank["count"]
        assert bank["weights"][:n].sum() == pytest.approx(1.0)
    states = bank["states"][: bank["count"], :2]
    assert np.hypot(*(states - d[-1]).T).min() < 0.25 * W
    mirrored = np.hypot(*(states - d[-1] * [1, -1]).T).min()
    assert mirrored < 0.25 * W


def test_a_turn_leaves_one():
    """After the crossing a turn towards one side: light comes or stays away, and the other side is dropped."""
    d, _ = cross(0.6, steps=16)
    turn = d[-1] + np.stack([0.01 * np.arange(30), -0.05 * np.arange(30)], axis=-1)
    path = np.vstack([d, turn])
    rng = np.random.default_rng(1)
    bank, work = new_bank(), np.zeros(WORK)
    for k in range(1, len(path)):
        reading = intensity(BEAM, math.hypot(*path[k]), HEIGHT) + MODEL.std * rng.normal()
        bank_cycle(bank, work, DT, *(path[k - 1] - path[k]), MOTION, MODEL, reading)
    assert bank["count"] == 1
    assert np.hypot(*(bank["states"][0, :2] - path[-1])) < 0.3 * W


def test_one_hypothesis_is_the_filter():
    bank, work = np.zeros(1, dtype=BANK)[0], np.zeros(WORK)
    ours = LaserEkf(1, MODEL, motion=MOTION)
    ours.place([0.9 * W, 0.1, 0.0, 0.01], 0.01 * np.eye(4))
    bank["count"], bank["weights"][0] = 1, 1.0
    bank["states"][0], bank["covariances"][0] = ours.states[0], ours.covariances[0]
    rng = np.random.default_rng(2)
    for reading in rng.uniform(0, MODEL.peak, 20):
        ours.cycle(DT, reading, moved=[0.01, -0.02])
        bank_cycle(bank, work, DT, 0.01, -0.02, MOTION, MODEL, reading)
    np.testing.assert_array_equal(bank["states"][0], ours.states[0])
    np.testing.assert_array_equal(bank["covariances"][0], ours.covariances[0])


def test_on_a_line_it_is_ahead_or_behind():
    bank, work = np.zeros(1, dtype=BANK)[0], np.zeros(WORK)
    bank_begin_line(bank, 1.2 * W, 0.1 * W, -0.5, 0.0, 0.02)
    assert sorted(bank["states"][:2, 0]) == pytest.approx([-1.2 * W, 1.2 * W])
    assert bank["states"][0, 0] < 0 < bank["weights"][1] < bank["weights"][0]
    for k in range(1, 8):
        reading = intensity(BEAM, 1.2 * W - 0.05 * k, HEIGHT)
        bank_cycle(bank, work, DT, -0.05, 0.0, MOTION, MODEL, reading)
    assert bank["count"] == 1 and bank["states"][0, 0] == pytest.approx(-1.2 * W + 0.35, abs=0.1 * W)


# --- particles ---------------------------------------------------------------------------------------------


def test_process_noise_is_that_of_white_acceleration():
    motion = make_motion("constant-velocity", density=0.3, step_variances=(1e-3, 2e-3, 0.0))
    rest, kick, along = process_noise(motion, 0.5)
    q, dt = 0.3, 0.5
    assert kick**2 == pytest.approx(q * dt + 2e-3)
    assert along * kick**2 == pytest.approx(q * dt**2 / 2)
    assert rest**2 + along**2 * kick**2 == pytest.approx(q * dt**3 / 3 + 1e-3)


def cloud(count, seed=0, r=1.2 * W):
    rng = np.random.default_rng(seed)
    angle = np.arcsin(rng.uniform(-1, 1, count))
    place = r + 0.1 * W * rng.normal(size=count)
    return np.stack(
        [place * np.cos(angle), place * np.sin(angle), *(0.02 * rng.normal(size=(2, count)))], axis=-1
    )


def test_particles_move_as_they_should():
    ours = LaserParticles(1, MODEL._replace(std=1e3), particles=4000, motion=MOTION, seed=3)
    start = np.tile([0.3, -0.2, 0.1, 0.05], (4000, 1))
    ours.place(start)
    ours.cycle(2.0, 0.0, moved=[0.05, 0.1])
    expected = np.array([0.3 + 0.2 - 0.05, -0.2 + 0.1 - 0.1, 0.1, 0.05])
    spread = np.sqrt(np.diag(ours.covariances()[0]))
    np.testing.assert_allclose(spread[2:], math.sqrt(2e-5), rtol=0.05)
    assert (np.abs(ours.means()[0] - expected) < 5 * spread / math.sqrt(4000)).all()
    assert ours.redrawn[0] == 0


def test_particles_weigh_by_the_likelihood_and_redraw():
    ours = LaserParticles(1, MODEL, particles=2000, motion=make_motion("constant-velocity"), spread=0.0)
    first = cloud(2000)
    ours.place(first)
    reading = intensity(BEAM, 1.1 * W, HEIGHT)
    ours.cycle(0.0, reading)
    expected = stats.norm.pdf(
        [intensity(BEAM, math.hypot(*p[:2]), HEIGHT) for p in first], loc=reading, scale=MODEL.std
    )
    mean = expected @ first / expected.sum()
    assert ours.redrawn[0] == 1 and ours.weights[0] == pytest.approx(1 / 2000)
    assert ours.means()[0] == pytest.approx(mean, abs=0.02 * W)


def test_bank_and_particles_agree_on_a_crossing():
    """The bank's mixture against the posterior in full, after a crossing to one side of the centre."""
    d, readings = cross(0.5, steps=25)
    bank, work = new_bank(), np.zeros(WORK)
    ours = LaserParticles(1, MODEL, particles=4000, motion=MOTION, seed=1)
    ours.place(cloud(4000))
    for k in range(1, len(d)):
        moved = d[k - 1] - d[k]
        bank_cycle(bank, work, DT, *moved, MOTION, MODEL, readings[k])
        ours.cycle(DT, readings[k], moved=moved)
    mean, spread = moments(bank)
    full, cover = ours.means()[0], ours.covariances()[0]
    # Along the course; across it both hold two sides.
    assert mean[0] == pytest.approx(full[0], abs=0.25 * W)
    assert d[-1, 0] == pytest.approx(full[0], abs=0.15 * W)
    assert math.sqrt(spread[1, 1]) > 0.3 * W and math.sqrt(cover[1, 1]) > 0.3 * W


def test_worlds_draw_apart_and_alone():
    many = LaserParticles(2, MODEL, particles=50, motion=MOTION, seed=5)
    alone = LaserParticles(1, MODEL, particles=50, motion=MOTION, seed=6)
    for ours in (many, alone):
        ours.place(cloud(50))
        ours.cycle(DT, 0.01)
    assert not np.array_equal(many.particles[0], many.particles[1])
    np.testing.assert_array_equal(many.particles[1], alone.particles[0])


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: LaserParticles(0, MODEL), "num_worlds: got 0"),
        (lambda: LaserParticles(1, MODEL, particles=1), "particles: got 1"),
        (lambda: LaserParticles(1, MODEL, spread=-1.0), "spread"),
        (lambda: LaserParticles(1, MODEL, motion=make_motion()), "constant-velocity"),
        (lambda: LaserParticles(1, MODEL).place(np.full((512, 4), np.nan)), "particles"),
        (lambda: LaserParticles(1, MODEL).cycle(0.1, math.inf), "readings"),
    ],
)
def test_refusals_say_why(call, words):
    with pytest.raises(InvalidParameterError, match=words):
        call()

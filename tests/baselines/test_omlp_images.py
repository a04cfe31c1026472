"""Images that ranges leave of a transponder, and plans that reckon with them."""

import numpy as np
import pytest

import aquaquad_envs
from baselines import make_policy
from baselines.omlp_images import AROUND, MAX_PLACES, possible_places
from tests.baselines.test_omlp import log_dets, planned, slopes, worlds_of


def after(turns, scenario="single", num_worlds=1, **params):
    """Worlds after these turns, each share of the greatest yaw rate."""
    batch = aquaquad_envs.make_world_batch(
        "transponder-localization", num_worlds, scenario=scenario, **params
    )
    batch.reset(40 + np.arange(num_worlds))
    for turn in turns:
        batch.step(np.full(batch.action_shape, turn, dtype=np.float32))
    return batch


def places(batch, k=0):
    """Places (P, 3), information (P, 6), shares (P,) of world k, and how unsure it is."""
    targets, information, share = np.zeros((MAX_PLACES, 3)), np.zeros((MAX_PLACES, 6)), np.zeros(MAX_PLACES)
    count, unsure = possible_places(batch.worlds[k], batch.constants, targets, information, share)
    return targets[:count], information[:count], share[:count], unsure


def cost(batch, place, m=0):
    """Half the sum of squares of prior and ranges, in standard deviations, by NumPy."""
    w, p = batch.worlds[0], batch.params
    n = int(w["count"])
    here = np.stack([w["place_x"][:n], w["place_y"][:n], np.zeros(n)], -1)
    misfit = (w["ranges"][m, :n] - np.linalg.norm(place - here, axis=1)) / p.range_std_m
    return 0.5 * (np.sum(((place - w["prior_mean"][m]) / p.prior_std_m) ** 2) + np.sum(misfit**2))


def test_one_range_leaves_a_circle():
    batch = after([])
    w = batch.worlds[0]
    found, _, share, unsure = places(batch)
    assert len(found) == AROUND and share.sum() == pytest.approx(1.0)
    assert found[0] == pytest.approx(w["estimate"][0])
    arm = found - [w["x"], w["y"], 0.0]
    assert np.linalg.norm(arm, axis=1) == pytest.approx(w["ranges"][0, 0], abs=0.5)
    angles = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
    assert np.diff(angles) == pytest.approx(2 * np.pi / AROUND)
    # The first estimate is too wide to tell one side from another.
    weights = np.exp([-cost(batch, place) for place in found])
    assert share == pytest.approx(weights / weights.sum(), rel=1e-9) and share.min() > 0.5 / AROUND
    assert unsure == pytest.approx(1.0 - share[0])


def test_two_places_leave_two_sides_and_a_bent_track_tells():
    batch = after([0.0])
    found, _, share, unsure = places(batch)
    assert len(found) == 2 and unsure == pytest.approx(share[1])
    weights = np.exp([-cost(batch, place) for place in found])
    assert share == pytest.approx(weights / weights.sum(), rel=1e-9)
    # Mirror images: the line that joins them crosses the track at a right angle, half-way.
    w = batch.worlds[0]
    along = np.array([np.cos(w["heading"]), np.sin(w["heading"])])
    middle = found[:, :2].mean(0) - [w["x"], w["y"]]
    assert (found[1] - found[0])[:2] @ along == pytest.approx(0.0, abs=1e-9)
    assert middle @ [-along[1], along[0]] == pytest.approx(0.0, abs=1e-9)
    bent = after([-1.0, -1.0, -1.0])
    found, information, share, unsure = places(bent)
    assert len(found) == 1 and share[0] == 1.0 and unsure == 0.0
    assert found[0] == pytest.approx(bent.worlds["estimate"][0, 0])
    assert information[0] == pytest.approx(bent.worlds["information"][0, 0])


def test_without_a_reply_there_is_the_first_estimate_alone():
    found, _, share, unsure = places(after([0.5], miss_share=1.0))
    assert len(found) == 1 and share[0] == 1.0 and unsure == 0.0


@pytest.mark.parametrize("moves", [0, 1])
def test_the_value_weighs_places_by_their_shares_and_has_its_slope(moves):
    batch = worlds_of(scenario="four", moves=moves)
    u = np.random.default_rng(3).uniform(-0.6, 0.6, (3, 2))
    value, slope, expected = slopes(batch, u, images=True)
    assert slope == pytest.approx(expected, rel=1e-4, abs=1e-5)
    found, information, share, _ = places(batch)
    assert len(found) == (4 * AROUND if moves == 0 else 8)
    total = 0.0
    for place, known, weight in zip(found, information, share, strict=True):
        one = worlds_of(scenario="single", moves=moves)
        one.worlds[0] = batch.worlds[0]
        one.worlds["num_transponders"] = 1
        one.worlds["estimate"][0, 0], one.worlds["information"][0, 0] = place, known
        total += weight * log_dets(one, u[None])[0]
    assert value == pytest.approx(total, rel=1e-10)


def test_where_the_side_is_open_it_turns_right_and_where_it_is_known_plans_as_published():
    for turns, right in (([], True), ([-1.0, -1.0, -1.0], False)):
        batch = after(turns, num_worlds=12)
        with_images = planned(batch, 3, images=True)
        if right:
            assert (with_images.plans[:, 0, 0] < 0).all()
            published = planned(batch, 3).plans[:, 0, 0]
            assert (published > 0).any() and (published < 0).any(), "wherever the estimate happens to be"
        else:
            assert np.array_equal(with_images.plans, planned(batch, 3).plans)


def test_two_turns_that_reckon_with_images_tell_more():
    errors = {}
    for images in (True, False):
        batch = aquaquad_envs.make_world_batch("transponder-localization", 200, scenario="single")
        policy = make_policy("omlp-3", batch, images=images)
        batch.reset(7000)
        for _ in range(2):
            batch.step(policy.act(batch.observations, batch.worlds))
        errors[images] = batch.worlds["log_det"].mean()
    assert errors[True] > errors[False] + 0.3

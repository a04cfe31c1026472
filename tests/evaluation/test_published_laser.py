"""The published laser simulations: scenarios, numbers and what is concluded from them."""

import json

import numpy as np
import pytest

from aquaquad_envs.errors import InvalidParameterError
from evaluation import published_laser
from evaluation.published_laser import CASES, fly, passes, search_pattern, statements, tables


@pytest.fixture(scope="module")
def made():
    ticks = []
    with pytest.MonkeyPatch.context() as patch:
        short = tuple(
            published_laser.Case(**{**vars(case), "params": {**case.params, "horizon_s": 40.0}})
            for case in CASES
        )
        patch.setattr(published_laser, "CASES", short)
        found, pictures = published_laser.reproduce(3, 1, lambda: ticks.append(1))
    assert len(ticks) == published_laser.steps(3)
    return found, pictures


def test_everything_is_there_and_can_be_written(made):
    found, pictures = made
    assert json.loads(json.dumps(found)) == found
    assert set(pictures) == {"laser", "quadrotor-steps", "rov-steps"}
    assert all(png.startswith(b"\x89PNG") for png in pictures.values())
    page = published_laser.section(found, pictures)
    for case in CASES:
        assert f"<td>{case.figure}</td>" in page or case.figure in page
    assert len(tables(found)[0][3]) == len(found["statements"]) == 9


def test_the_worlds_are_the_published_ones():
    for case in CASES:
        assert case.params["axes"] == 1
        assert ("moving" in case.title) == (case.params["scenario"] == "moving") or case.figure == "6.10"
    started = [case for case in CASES if case.figure.startswith(("6.6", "6.7", "6.8", "6.9", "6.10"))]
    assert all(case.params["start_altitude_m"] == 0.0 for case in started)


def test_statements_follow_from_the_numbers(made):
    found, _ = made
    agrees = {line["figure"]: line["agrees"] for line in statements(found)}
    # What does not depend on luck in three runs.
    assert agrees["6.2"] and agrees["6.4"] and agrees["6.10"]
    turned = json.loads(json.dumps(found))
    for row in turned["rows"]:
        row["time_in_lda"], row["time_in_lda_acquired"], row["final_error_w"] = 0.5, 0.5, 3.0
    turned["search"]["periods_grow"] = False
    turned["passes"][0]["rate_on_slope"] = 1.0
    assert not any(line["agrees"] for line in statements(turned) if line["figure"] != "6.5")


def test_variance_grows_inside_and_shrinks_on_the_slope_in_both_forms():
    for form in ("polar", "cartesian"):
        found, traces = passes(form, 2)
        assert found["rate_inside"] > 0 > found["rate_on_slope"]
        assert found["rms_error_w"] < 0.2
        assert (traces["light"][np.abs(traces["x"]) > 1.9 * traces["radius"]] < 0.01).all()


def test_search_amplitudes_are_a_spacing_apart():
    found, _ = search_pattern(4)
    assert found["circles"] >= 4
    assert found["amplitude_growth_w"] == pytest.approx(1.0, abs=0.15)


def test_runs_depend_on_their_seeds_only():
    case = CASES[-1]
    pair, single = fly(case, 2, 5), fly(case, 1, 6)
    np.testing.assert_array_equal(pair["x"][:, 1], single["x"][:, 0])


def test_refusals_say_why():
    with pytest.raises(InvalidParameterError, match="runs: got 0"):
        published_laser.reproduce(0, 0, lambda: None)

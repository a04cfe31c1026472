"""Policies that choose among the recorded places of a survey, and the command that shows them."""

import json

import numpy as np
import pytest

import evaluate
from aquaquad_envs.errors import InvalidParameterError
from evaluation.survey import run_survey, survey_policies, write_survey
from evaluation.survey_file import read_survey
from evaluation.survey_replay import SURVEY_ORDER, prepare, replay
from evaluation.survey_solution import solve_survey
from tests.evaluation.survey_files import make_survey, write_survey_file

OWN = "tests.evaluation.survey_policies:"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    rows = make_survey(np.random.default_rng(40), outliers=0.05)
    return write_survey_file(tmp_path_factory.mktemp("survey") / "survey.txt", rows)


@pytest.fixture(scope="module")
def setup(path):
    survey = read_survey(path)
    return prepare(survey, solve_survey(survey, "all"), reach_m=60.0, measurements=15, runs=12, seed=3)


@pytest.fixture(scope="module")
def replays(setup):
    return {name: replay(setup, name) for name in ("random", SURVEY_ORDER, "omlp-1", OWN + "East")}


def test_every_step_is_to_an_unused_place_within_reach(setup, replays):
    for name, found in replays.items():
        assert all(len(set(row)) == len(row) for row in found.chosen.tolist())
        steps = np.linalg.norm(np.diff(setup.places[found.chosen][..., :2], axis=1), axis=-1)
        if name != SURVEY_ORDER:
            assert (steps > 60.0 + 1e-9).sum() == found.beyond
        np.testing.assert_allclose(found.sailed_m[:, -1], steps.sum(axis=1))
        assert (found.chosen[:, 0] == setup.first).all()


def test_the_end_of_a_step_is_matched_to_the_nearest_place(setup, replays):
    found = replays[OWN + "East"]
    places = setup.places[:, :2]
    for row in found.chosen[:4]:
        for n in range(1, len(row)):
            here = places[row[n - 1]]
            free = np.ones(len(places), dtype=bool)
            free[row[:n]] = False
            near = free & (np.linalg.norm(places - here, axis=1) <= setup.reach_m)
            if near.any():
                off = np.linalg.norm(places - (here + np.array([setup.reach_m, 0.0])), axis=1)
                assert off[row[n]] == off[near].min()


def test_the_survey_in_its_own_order(setup, replays):
    chosen = replays[SURVEY_ORDER].chosen
    assert (np.diff(chosen, axis=1) % len(setup.places) == 1).all()


def test_errors_are_distances_that_shrink(setup, replays):
    for found in replays.values():
        np.testing.assert_allclose(
            found.errors_m, np.linalg.norm(found.estimates - setup.shift - setup.reference, axis=-1)
        )
        assert found.unconverged == 0
    medians = {name: np.median(found.errors_m, axis=0) for name, found in replays.items()}
    assert medians["omlp-1"][-1] < 0.05 * medians["omlp-1"][0]
    # A policy that looks ahead knows more in the end than one that does not, and than a stretch of the survey.
    for other in ("random", SURVEY_ORDER):
        assert replays["omlp-1"].log_det[:, -1].mean() > replays[other].log_det[:, -1].mean() + 1


def test_the_same_seed_gives_the_same_replay(setup, replays):
    again = replay(setup, "random")
    assert (again.chosen == replays["random"].chosen).all()
    assert (again.estimates == replays["random"].estimates).all()


def test_a_policy_for_a_vehicle_that_turns_gets_one(setup):
    found = replay(setup, OWN + "Straight")
    assert found.vehicle == "yaw-rate"
    # It goes on the way it came, as far as the places allow.
    steps = np.diff(setup.places[found.chosen][..., :2], axis=1)
    turns = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(steps[..., 1], steps[..., 0]), axis=1))))
    assert np.median(turns) < np.radians(60)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"reach_m": 0.0}, "survey-reach: got 0.0"),
        ({"measurements": 1}, "survey-measurements: got 1"),
        ({"measurements": 129}, "survey-measurements: got 129"),
        ({"runs": 0}, "episodes: got 0"),
    ],
)
def test_setups_that_make_no_sense(path, options, words):
    survey = read_survey(path)
    with pytest.raises(InvalidParameterError, match=words):
        prepare(survey, solve_survey(survey, "all"), **options)


def test_names_of_policies_are_checked():
    default = survey_policies(())
    assert default[:2] == ["random", SURVEY_ORDER] and {"omlp-1", "omlp-2", "omlp-3"} <= set(default)
    assert survey_policies(["omlp-2", SURVEY_ORDER, "omlp-2"]) == ["omlp-2", SURVEY_ORDER]
    with pytest.raises(InvalidParameterError, match="Did you mean 'random'"):
        survey_policies(["randon"])


def test_the_report_holds_the_numbers(path, tmp_path):
    run = run_survey(path, policies=["random", SURVEY_ORDER], measurements=5, runs=3, reach_m=50.0)
    page = write_survey(run, tmp_path).read_text()
    found = json.loads((tmp_path / "survey.json").read_text())
    assert (tmp_path / "survey.png").read_bytes()[:4] == b"\x89PNG"
    first = found["solutions"][0]
    north, east, up = first["north_east_up_m"]
    np.testing.assert_allclose([east, north, -up], run.reference.position_m)
    np.testing.assert_allclose([north, east, up], [-20, 10, -80], atol=0.5)
    after = found["replay"]["policies"][0]["after"]["5"]
    errors = run.replays[0].errors_m[:, 4]
    assert after["rms_error_m"] == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert after["median_error_m"] == pytest.approx(np.median(errors))
    assert page.count("<table>") == 3 and "survey-order" in page and f"{after['rms_error_m']:.2f}" in page


def test_the_command(path, tmp_path, capsys):
    arguments = ["--task", "transponder-localization", "--survey", str(path), "--output", str(tmp_path)]
    short = ["--policies", "random,survey-order", "--episodes", "2", "--survey-measurements", "4"]
    assert evaluate.main([*arguments, *short, "--survey-reach", "40"]) == 0
    shown = capsys.readouterr().out
    assert "survey-order" in shown and "n = 4" in shown and (tmp_path / "survey.html").exists()
    for wrong, words in (
        (["--survey", str(tmp_path / "absent")], "No such file"),
        (["--survey", str(tmp_path / "survey.json")], "columns, expected 15"),
        ([*arguments, "--suite", "single"], "nothing beside --survey"),
        (["--survey", str(path), "--task", "drift-hop"], "task: got 'drift-hop'"),
    ):
        assert evaluate.main(wrong) == 2
        assert words in capsys.readouterr().err

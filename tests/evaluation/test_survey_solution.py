"""Recorded surveys: reading them, and where their transponder is."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from aquaquad_envs.errors import AquaQuadError, InvalidParameterError
from aquaquad_envs.estimation.map_estimator_statistics import nees
from evaluation.survey_file import SurveyFileError, read_survey
from evaluation.survey_solution import solutions, solve_survey
from tests.evaluation.survey_files import make_survey, write_survey_file

REAL = sorted((Path(__file__).parents[3] / "shared" / "data" / "range").glob("*.txt"))


def survey_of(tmp_path, seed=0, **options):
    return read_survey(
        write_survey_file(tmp_path / "survey.txt", make_survey(np.random.default_rng(seed), **options))
    )


def test_columns_come_out_east_north_down(tmp_path):
    rows = make_survey(np.random.default_rng(0), count=20, height=5.0)
    found = read_survey(write_survey_file(tmp_path / "s.txt", rows))
    np.testing.assert_allclose(found.transmit, rows[:, [2, 1, 3]] * [1, 1, -1], atol=1e-6)
    np.testing.assert_allclose(found.receive, rows[:, [9, 8, 10]] * [1, 1, -1], atol=1e-6)
    np.testing.assert_allclose(found.transmit_std, rows[:, [5, 4, 6]], atol=1e-6)
    np.testing.assert_allclose(found.two_way_s, rows[:, 14], atol=1e-6)
    assert found.places[:, 2].mean() == pytest.approx(-5.0, abs=0.3) and "time0_transmit" in found.comments[0]
    assert len(read_survey(write_survey_file(tmp_path / "s.txt", rows, header="")).comments) == 0


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda lines: [*lines[:5], "1 2 3", *lines[5:]], "line 6: got 3 columns, expected 15"),
        (lambda lines: [line.replace(" ", ",") for line in lines], "line 2: got 1 columns.*spaces, not commas"),
        (lambda lines: [*lines[:7], lines[7].replace(" ", " nan ", 1).rsplit(" ", 1)[0]], "line 8: N_tx: got nan"),
        (lambda lines: [*lines[:7], "late " + lines[7].split(" ", 1)[1]], "line 8: t_tx: got 'late'"),
        (lambda lines: lines[:6], "got 5 replies, expected at least 10"),
        (lambda lines: [*lines[:9], lines[9].rsplit(" ", 1)[0] + " -0.1", *lines[10:]], "line 10: TWTT"),
        (lambda lines: [lines[0], *("9e9 " + line.split(" ", 1)[1] for line in lines[1:])], "line 2: t_rx.*such lines"),
        (lambda lines: [_scaled(line, 14, 1000.0) for line in lines], "expected seconds"),
        (lambda lines: [_scaled(line, 1, 1e6) for line in lines], "positions"),
        (lambda lines: [_scaled(line, 4, -1.0) for line in lines], "standard deviations"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_named_by_line(tmp_path, spoil, words):
    path = write_survey_file(tmp_path / "s.txt", make_survey(np.random.default_rng(1), count=30))
    path.write_text("\n".join(spoil(path.read_text().splitlines())))
    with pytest.raises(SurveyFileError, match=words):
        read_survey(path)


def _scaled(line, column, factor):
    if line.startswith("#"):
        return line
    words = line.split()
    words[column] = str(float(words[column]) * factor)
    return " ".join(words)


def test_files_that_are_none(tmp_path):
    with pytest.raises(OSError):
        read_survey(tmp_path / "absent.txt")
    (tmp_path / "picture").write_bytes(b"\x89PNG\xff\xfe\x00")
    with pytest.raises(SurveyFileError, match="is no text"):
        read_survey(tmp_path / "picture")


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"shape": "lawn", "height": 53.0},
        {"shape": "line", "transponder": (10.0, 60.0, 80.0)},
        {"transponder": (300.0, 200.0, 50.0)},
        {"transponder": (5.0, 5.0, 2000.0), "extent": 1500.0, "noise_s": 2e-4},
        {"transponder": (0.0, 1.0, 1.2), "extent": 10.0},
        {"fix_std": (1.0, 0.8, 2.0), "speed": 3.0},
        {"outliers": 0.1},
        {"outliers": 0.3, "outlier_s": 0.5},
    ],
)
def test_surveys_of_all_kinds_are_solved_to_their_own_accuracy(tmp_path, options):
    truth = np.array(options.get("transponder", (10.0, -20.0, 80.0))) - [0, 0, options.get("height", 0.0)]
    squared = []
    for seed in range(8):
        found = solve_survey(survey_of(tmp_path, seed, **options), "tried")
        squared.append(nees(found.position_m, truth, found.covariance))
    # χ² with 24 degrees of freedom; many outliers leave a bias of a fraction of the deviation.
    assert chi2(24).ppf(1e-6) < sum(squared) < chi2(24).ppf(1 - 1e-6) * (2 if options.get("outliers") else 1)


def test_noise_is_told_from_the_receivers_errors(tmp_path):
    found = [
        solve_survey(survey_of(tmp_path, seed, noise_s=4e-4, fix_std=(0.2, 0.2, 0.2), count=400), "tried")
        for seed in range(4)
    ]
    assert np.mean([one.range_std_m for one in found]) == pytest.approx(4e-4 * 1495 / 2, rel=0.1)
    assert all(one.stds_m == pytest.approx(np.hypot(one.range_std_m, 0.2), rel=1e-6) for one in found)


def test_the_speed_of_sound_is_found_or_taken(tmp_path):
    survey = survey_of(tmp_path, 3, sound_speed=1520.0)
    free = solutions(survey)
    assert next(iter(free)) == "free"
    assert free["free"].sound_speed_m_s == pytest.approx(1520.0, abs=5 * free["free"].sound_speed_std_m_s)
    # A wrong one deepens or lifts the transponder and leaves residuals.
    assert free["given"].sound_speed_m_s == 1500.0
    assert free["given"].residual_rms_m > 1.5 * free["free"].residual_rms_m
    given = solutions(survey, 1520.0)
    assert next(iter(given)) == "given"
    np.testing.assert_allclose(given["given"].position_m, [10, -20, 80], atol=0.1)
    with pytest.raises(InvalidParameterError, match="survey-sound-speed: got 15"):
        solutions(survey, 15.0)


def test_plain_least_squares_is_what_outliers_spoil(tmp_path):
    found = solutions(survey_of(tmp_path, 4, outliers=0.15))
    off = {key: np.linalg.norm(one.position_m - [10, -20, 80]) for key, one in found.items()}
    assert off["free"] < 0.15 and off["plain"] > 10 * off["free"]
    assert 10 < found["free"].outliers.sum() < 35


def test_a_survey_that_fixes_nothing_is_refused(tmp_path):
    rows = make_survey(np.random.default_rng(5), count=40)
    rows[:, 1:4] = rows[0, 1:4]
    rows[:, 8:11] = rows[0, 8:11]
    rows[:, 14] = rows[0, 14]
    survey = read_survey(write_survey_file(tmp_path / "s.txt", rows))
    try:
        found = solve_survey(survey, "tried")
    except AquaQuadError as error:
        assert "no solution" in str(error)
    else:  # the prior fixes what the replies do not, and says how badly
        assert np.sqrt(np.linalg.eigvalsh(found.covariance)[-1]) > 100


@pytest.mark.skipif(not REAL, reason="no recorded surveys beside the project (../shared/data/range)")
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_recorded_surveys_agree_with_the_published_position(path):
    found = solutions(read_survey(path))
    for key in ("free", "plain"):
        assert np.linalg.norm(found[key].position_m) < 0.1
        assert 0.02 < found[key].residual_rms_m < 0.11
    assert np.linalg.norm(found["given"].position_m) < 0.5
    assert found["free"].outliers.mean() < 0.05

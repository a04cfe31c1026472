"""The published tables of transponder localization, run again: settings, cells, marks, files."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

from evaluation import published, published_localization, published_localization_tables
from evaluation.published_localization_values import EPOCHS, FIXED, PLANNING_S, TABLES

RUNS = 10


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    output, ticks = tmp_path_factory.mktemp("published"), []
    found = published.reproduce(
        RUNS, 0, output, ["published"], lambda: ticks.append(1), tasks=("transponder-localization",)
    )
    return found["localization"], output, len(ticks)


def test_the_settings_are_the_published_ones():
    from aquaquad_envs.tasks.batch import make_world_batch

    batch = make_world_batch("transponder-localization", 1, scenario="four")
    batch.reset(0)
    w, c = batch.worlds[0], batch.constants
    assert (w["place_x"][0], w["place_y"][0]) == (-3.0, 9.0) and w["heading"] == pytest.approx(
        np.radians(-30)
    )
    assert (c.sigma, c.speed, c.period) == (0.12, 3.0, 1.0) and c.yaw_limit == pytest.approx(np.radians(30))
    assert w["target"][:4].tolist() == [[17, 15, 6], [-2, -1, 7], [5, 5, 10], [-9, 13, 8]]
    assert c.prior_information[[0, 3, 5]].tolist() == [1e-4, 1e-4, 0.25]
    greedy = make_world_batch("transponder-localization", 1, scenario="single", vehicle="greedy")
    assert greedy.constants.max_step == 5.0
    field = make_world_batch("transponder-localization", 1, scenario="field", vehicle="greedy")
    assert (field.constants.sigma, field.constants.max_step) == (1.006, 10.0)


def test_every_row_is_run_and_set_beside_the_published_one(made):
    found, _, ticks = made
    assert ticks == published_localization.steps() == published.steps(RUNS, 2, ("transponder-localization",))
    for name, table in TABLES.items():
        part = found["tables"][name]
        assert [(row["M"], row["k"]) for row in part["rows"]] == list(table["cells"])
        assert part["runs"] == max(2, round(table["runs"] * RUNS / 1000))
        for row in part["rows"]:
            assert row["diverged"] == 0 or row["k"] == 0
            # More measurements, more information.
            values = [cell["log_det"] for cell in row["cells"]]
            assert values == sorted(values) and [cell["epoch"] for cell in row["cells"]] == list(EPOCHS)
    msla = {(row["M"], row["k"]): row for row in found["tables"]["msla"]["rows"]}
    for M in (1, 4):
        random, planned = msla[M, 0]["cells"][-1], msla[M, 3]["cells"][-1]
        assert planned["log_det"] > random["log_det"] + 1 and planned["log_det_true"] > random["log_det_true"]
        # Against 0.9 and 1.6 s a run.
        assert msla[M, 3]["planning_s_a_run"] < PLANNING_S[M][2] / 5
        # A random walk is a random walk: the world is the published one.
        assert abs(msla[M, 0]["cells"][1]["apart"]["log_det"]) < 4


def test_the_marks_are_three_standard_errors():
    assert published_localization_tables.mark(2.9) == "" and published_localization_tables.mark(None) == ""
    assert (
        published_localization_tables.mark(3.1) == " ▲" and published_localization_tables.mark(-3.1) == " ▼"
    )
    draw = np.random.default_rng(0)
    squares = draw.normal(size=4000) ** 2
    # Delta method: var of the mean square is 2 / n, halved twice by the root.
    assert published_localization.rms_error(squares, 0) == pytest.approx(np.sqrt(2 / 4000) / 2, rel=0.15)


def test_consistency_from_four_fixed_places():
    found, drawn = published_localization.reproduce_fixed(FIXED["runs"], 1)
    assert found["diverged"] == 0 and found["nees"]["4"]["degrees"] == 12
    for M in (1, 4):
        assert found["nees"][str(M)]["p"] > 1e-3
        assert found["nees"][str(M)]["ks"] < 1.95 / np.sqrt(FIXED["runs"])
        assert drawn[f"nees_{M}"].mean() == pytest.approx(3 * M, rel=0.15)
    assert abs(found["inside_own_ellipse"]["mean"] - 0.95) < 4 * np.sqrt(0.95 * 0.05 / FIXED["runs"])
    assert found["estimated_axes_m"] == pytest.approx(found["actual_axes_m"], rel=0.15)
    assert found["estimated_axes_m"][0] == pytest.approx(
        np.sqrt(chi2.ppf(0.95, 2) * np.linalg.eigvalsh(drawn["covariance"])[-1])
    )


def test_the_files_and_the_terminal_hold_the_tables(made):
    from rich.console import Console

    found, output, _ = made
    names = {path.name for path in output.iterdir()}
    assert names == {"published.json", "published.html"} | {
        f"published-{name}.png" for name in published_localization_tables.CAPTIONS
    }
    content = json.loads((output / "published.json").read_text())["localization"]
    assert content["fixed"] == found["fixed"]
    page = (output / "published.html").read_text()
    assert page.count("data:image/png;base64,") == len(published_localization_tables.CAPTIONS)
    assert "76.30 (0.33)" in page and "18.55 (0.95)" in page and "χ²" in page
    again = published.section_in(output)
    assert again is not None and published_localization_tables.section(found) in again
    console = Console(width=120, record=True)
    published.print_table({"localization": found}, console)
    text = console.export_text()
    for piece in ("76.30 (0.33)", "Four", "at or above", "diverged"):
        assert piece.lower() in text.lower(), piece
    assert "…" not in text

"""The published study of plume tracing: its settings are as printed, the numbers computed."""

import json

import numpy as np
import pytest

from aquaquad_envs.tasks.batch import make_world_batch
from baselines import make_policy
from evaluation import published, published_plume, published_plume_orientation, published_plume_tables
from evaluation import published_plume_values as values
from evaluation.published_plume import PRINTED, OneFactor, apart
from evaluation.published_plume_orientation import courses_off, first_within


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """All of it with few runs, levels and squares."""
    output = tmp_path_factory.mktemp("published")
    ticks = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(values, "NOISE", {level: values.NOISE[level] for level in (0.0, 0.1)})
        patch.setattr(values, "POSITION", {level: values.POSITION[level] for level in (0.0, 1.0)})
        patch.setattr(values, "HEADING_DEG", (20.0,))
        patch.setattr(published_plume_orientation, "SQUARES_M", (10.0, 30.0))
        table = published.reproduce(
            40, 0, output, ["published"], lambda: ticks.append(1), tasks=("plume-tracing",)
        )
        assert len(ticks) == published.steps(40, 2, ("plume-tracing",)) == published_plume.steps()
    return table["plume"], output


def rows_of(table, name, variant):
    return {(row["start"], row["level"]): row for row in table[name] if row["variant"] == variant}


def test_the_world_is_the_published_one():
    batch = make_world_batch("plume-tracing", 40, scenario="surround", updates="sequential")
    batch.reset(0)
    w = batch.worlds
    assert batch.params.num_robots == 10 and batch.params.step_limit_m == batch.params.spacing_m == 0.5
    assert batch.params.horizon_updates == values.NOISE_UPDATES
    assert batch.params.field == "oriented-light"
    x, y = (w[name][:, :10] - w[f"source_{name}"][:, None] for name in "xy")
    np.testing.assert_allclose(np.hypot(x, y), 20.0, rtol=0.001 + 1e-9)
    np.testing.assert_allclose(np.arctan2(y, x)[:, 1], np.deg2rad(36.0))
    height = w["source_z"][:, None] - w["z"][:, :10]
    assert 7.2 <= height.min() < 7.3 and 8.7 < height.max() <= 8.8


def test_one_factor_for_all_does_not_move_the_minimum():
    batch = make_world_batch("plume-tracing", 3, scenario="corner", updates="sequential")
    batch.reset(0)
    policy = make_policy("quadratic-fit", batch, **PRINTED)
    noisy = OneFactor(policy, 0.1)
    noisy.reset(np.arange(3))
    kept = batch.worlds["reading"].copy()
    plain = policy.act(batch.observations, batch.worlds).copy()
    np.testing.assert_allclose(noisy.act(batch.observations, batch.worlds), plain, atol=1e-4)
    np.testing.assert_array_equal(batch.worlds["reading"], kept)


def test_differences_are_in_errors_of_five_runs_and_ours():
    ours = {"mean": 2.0, "std": 3.0}
    assert apart(1.0, ours, 20) == pytest.approx(1.0 / (3.0 * np.sqrt(1 / 5 + 1 / 20)))
    assert np.isnan(apart(1.0, {"mean": 2.0, "std": 0.0}, 20))
    assert published_plume_tables.mark(3.1) == " ▲" and published_plume_tables.mark(-3.1) == " ▼"
    assert published_plume_tables.mark(2.9) == published_plume_tables.mark(None) == ""
    assert published_plume_tables.mark(float("nan")) == ""


def test_courses_are_measured_from_the_direction_of_the_source():
    places = np.array([[[2.0, 0, 0], [2.0, 0, 0], [2.0, 0, 0]], [[1.0, 0, 0], [2.0, 1, 0], [2.0, 0, 0]]])
    off = courses_off(places)
    np.testing.assert_allclose(off[0, :2], [0.0, np.pi / 2], atol=1e-7)
    assert np.isnan(off[0, 2])
    np.testing.assert_array_equal(first_within(np.array([[3.0, 3], [1, 2], [0, 2]]), 1.0), [1, np.nan])


def test_the_rows_are_those_that_were_run(made):
    table, _ = made
    for name in ("noise", "position"):
        for (start, level), row in rows_of(table, name, "published").items():
            theirs = getattr(values, name.upper())[level][start]
            assert tuple(row["published"].values()) == theirs and row["runs"] == 8
    walk = rows_of(table, "position", "published")
    for start in values.STARTS:
        assert walk[start, 0.0]["success"] > 0.5
        assert walk[start, 1.0]["ours"]["center_of_mass_m"]["mean"] > 5.0
        assert table["locked"][start]["published"] == values.LOCKED[start]
    common, alone = rows_of(table, "noise", "one factor"), rows_of(table, "noise", "published")
    for start in values.STARTS:  # noise as printed does nothing; noise of every reading does
        means = [
            row["ours"]["center_of_mass_m"]["mean"]
            for row in (alone[start, 0.0], common[start, 0.1], alone[start, 0.1])
        ]
        assert abs(means[1] - means[0]) < 1.0 < means[2] - means[0]


def test_light_is_met_head_on_and_oriented_light_after_a_detour(made):
    rows = {row["field"]: row for row in made[0]["orientation"]["rows"]}
    plain, oriented = rows["light"], rows["oriented-light"]
    assert (
        plain["course_off_deg"]["1"] < 45 and oriented["course_off_deg"]["1"] > plain["course_off_deg"]["1"]
    )
    assert plain["reached_at"] <= oriented["reached_at"]
    squares = made[0]["orientation"]["squares"]
    assert all(square["reached"] == 1.0 for square in squares if square["field"] == "light")


def test_the_files_hold_tables_and_figures(made):
    from rich.console import Console

    table, output = made
    captions = published_plume_tables.CAPTIONS
    assert {path.name for path in output.iterdir()} == {"published.json", "published.html"} | {
        f"published-{name}.png" for name in captions
    }
    content = json.loads((output / "published.json").read_text())["plume"]
    assert content["noise"][0]["ours"] == table["noise"][0]["ours"]
    page = (output / "published.html").read_text()
    assert page.count("data:image/png;base64,") == len(captions) and "DR-RRT*" not in page
    again = published.section_in(output)
    assert again is not None and again in published_plume_tables.section(table)
    console = Console(width=120, record=True)
    published.print_table({"plume": table}, console)
    text = console.export_text()
    for piece in ("position error", "one factor", "corner", "oriented-light", "25.30"):
        assert piece in text, piece
    assert "…" not in text  # no cell is cut

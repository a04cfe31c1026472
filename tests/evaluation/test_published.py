"""The published table: both variants, beside ours."""

import json

import pytest

from evaluation import published


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    output = tmp_path_factory.mktemp("published")
    ticks = []
    return published.reproduce(6, 0, output, ["published"], lambda: ticks.append(1)), output, ticks


def test_the_problem_is_the_published_one():
    task, bound = published.problem()
    assert (task.start, task.goal) == ((-4000.0, 4000.0), (3000.0, -3000.0))
    assert task.direct_energy_wh == pytest.approx(49.497, abs=1e-3)
    assert task.team.tolist() == [[5000, 5000], [5000, -5000], [-5000, -5000]]
    assert task.target == (3100.0, -2900.0)
    assert task.axes.by_cell
    assert 15 < bound < 25  # SPEC: 20.2 Wh on the bilinear field


def test_both_variants_are_tabulated_with_energy_and_time(made):
    table, _, ticks = made
    assert len(ticks) == 12
    assert [row["variant"] for row in table["rows"]] == ["single", "seeking"]
    single, seeking = table["rows"]
    for row in (single, seeking):
        assert row["energy_wh"]["n"] == 6 and row["arrived"]["mean"] == 1.0
        assert table["bound_wh"] < row["energy_wh"]["mean"] < table["direct_wh"]
        assert row["time_ms"]["mean"] > 0
    assert seeking["iterations"]["mean"] == 25_000 > single["iterations"]["mean"]
    assert seeking["published"]["energy_wh"] == (36.26, 3.93)
    assert seeking["published"]["saving_vs_direct"] == pytest.approx(0.27, abs=0.005)
    assert single["published"]["saving_vs_direct"] == pytest.approx(0.22, abs=0.005)


def test_the_files_hold_the_table(made):
    table, output, _ = made
    content = json.loads((output / "published.json").read_text())
    assert content["rows"][1]["energy_wh"]["mean"] == table["rows"][1]["energy_wh"]["mean"]
    page = (output / "published.html").read_text()
    assert "4964 ± 18" in page and "36.26 ± 3.93" in page
    assert published.section_in(output) == published.section(table)
    assert published.section_in(output / "elsewhere") is None
    (output / "published.json").write_text("{")
    assert published.section_in(output) is None


def test_the_terminal_shows_it(made):
    from rich.console import Console

    console = Console(width=120, record=True)
    published.print_table(made[0], console)
    text = console.export_text()
    assert "optimality-seeking" in text and "38.69 ± 6.81" in text and "grid optimum" in text

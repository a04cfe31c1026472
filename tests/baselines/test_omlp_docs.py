"""The page of the planners says what the grids are."""

import re
from pathlib import Path

from baselines.omlp_search import MOST_BLOCKS, TIE, make_grids

PAGE = (Path(__file__).parents[2] / "docs" / "omlp.md").read_text(encoding="utf-8")


def test_the_table_of_grids():
    rows = re.findall(r"^\| (\d)(?: and more)? \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|$", PAGE, re.MULTILINE)
    assert [int(row[0]) for row in rows] == list(range(1, MOST_BLOCKS + 1))
    grids = [make_grids(MOST_BLOCKS, turning=turning) for turning in (True, False)]
    for d, row in enumerate(rows):
        for k, grid in enumerate(grids):
            size = int(grid.sizes[d])
            assert (size, size ** int(grid.levels[d])) == (int(row[1 + 2 * k]), int(row[2 + 2 * k]))
    assert f"cut into {MOST_BLOCKS} blocks" in PAGE and TIE == 1e-7 and "10⁻⁷" in PAGE

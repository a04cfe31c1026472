"""Tables of the documentation, for tests that hold them to the code."""

import re


def table_of(page, heading):
    """Rows of the first table under a heading of ``page``, cells stripped of spaces and backticks."""
    section = re.search(rf"^## {heading}$(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)[1]
    rows = []
    for line in section[section.index("|---") :].splitlines()[1:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().strip("`") for cell in line.strip("|").split(" | ")])
    return rows

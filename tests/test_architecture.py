"""The house stays in order: imports go down only, files stay short, nothing points at one machine."""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("aquaquad_envs", "baselines", "agents", "evaluation")
LONGEST_FILE = 500

# Each floor may import the floors below it (and its own). Interfaces and rendering stand side by side.
BASE = {"errors", "compilation"}
FLOORS = {
    "physics": 1,
    "sensing": 2,
    "estimation": 3,
    "tasks": 4,
    "interfaces": 5,
    "rendering": 5,
    "aquaquad_envs": 6,  # the package's own __init__: registers and exports
    "baselines": 7,
    "agents": 8,  # may imitate a baseline
    "evaluation": 9,
    "train": 10,
    "evaluate": 10,
}
# What a learning library brings has no place in the world itself.
LEARNING = {"gymnasium", "pettingzoo", "stable_baselines3", "torch"}


def sources() -> list[Path]:
    found = [path for name in PACKAGES for path in (ROOT / name).rglob("*.py")]
    return sorted(found) + [path for path in (ROOT / "train.py", ROOT / "evaluate.py") if path.exists()]


def module_of(path: Path) -> str:
    parts = list(path.relative_to(ROOT).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path: Path) -> list[tuple[str, int]]:
    """Every module that a file imports, also inside functions, with its line."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = module_of(path).split(".")
                package = package if path.name == "__init__.py" else package[:-1]
                kept = package[: len(package) - node.level + 1]
                base = ".".join(kept + ([node.module] if node.module else []))
            # `from aquaquad_envs import tasks` imports aquaquad_envs.tasks.
            found += [(f"{base}.{alias.name}", node.lineno) for alias in node.names]
    return found


def floor_of(module: str) -> str | None:
    """Name of the floor that a module stands on; None for the base and for other people's modules."""
    top, _, rest = module.partition(".")
    if top != "aquaquad_envs":
        return top if top in FLOORS else None
    below = rest.partition(".")[0]
    if below in BASE:
        return None
    return below if below in FLOORS else "aquaquad_envs"


def faults_in(path: Path) -> list[str]:
    here = floor_of(module_of(path))
    height = 0 if here is None else FLOORS[here]
    faults = []
    for name, line in imports_of(path):
        there = floor_of(name)
        where = f"{path.relative_to(ROOT)}:{line} imports {name}"
        if there is not None and there != here and FLOORS[there] >= height:
            # A Gymnasium env draws itself: interfaces may reach rendering, which sits beside them.
            if (here, there) == ("interfaces", "rendering"):
                continue
            faults.append(f"{where}: {there} does not lie below {here or 'the base'}")
        if height < FLOORS["interfaces"] and name.partition(".")[0] in LEARNING:
            faults.append(f"{where}: only interfaces and what stands above them may")
    return faults


def test_imports_go_down_only():
    files = sources()
    assert len(files) > 10, "the walk found no sources"
    faults = [fault for path in files for fault in faults_in(path)]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    "folder, line, fault",
    [
        ("aquaquad_envs/physics", "from aquaquad_envs.tasks import drift_hop", True),
        ("aquaquad_envs/physics", "from aquaquad_envs.errors import AquaQuadError", False),
        ("aquaquad_envs/tasks", "def f():\n    import gymnasium", True),
        ("aquaquad_envs/tasks", "from ..interfaces import sb3", True),
        ("aquaquad_envs/tasks", "from aquaquad_envs import rendering", True),
        ("aquaquad_envs/rendering", "from aquaquad_envs.interfaces import vector", True),
        ("aquaquad_envs/interfaces", "from aquaquad_envs.rendering import draw", False),
        ("aquaquad_envs/interfaces", "import baselines.optimal", True),
        ("baselines", "import aquaquad_envs", False),
        ("baselines", "from agents import loading", True),
        ("agents", "from baselines import optimal", False),
        ("evaluation", "from agents import loading", False),
    ],
)
def test_the_import_check_sees_what_it_should(tmp_path, monkeypatch, folder, line, fault):
    monkeypatch.setattr(sys.modules[__name__], "ROOT", tmp_path)
    path = tmp_path / folder / "example.py"
    path.parent.mkdir(parents=True)
    path.write_text(line)
    assert bool(faults_in(path)) == fault


def test_every_folder_of_code_is_a_known_floor():
    folders = {path.name for path in (ROOT / "aquaquad_envs").iterdir() if path.is_dir()} - {"__pycache__"}
    assert folders <= set(FLOORS), f"give {folders - set(FLOORS)} a floor in FLOORS"


def test_files_stay_short():
    long = {
        str(path.relative_to(ROOT)): lines
        for path in sources()
        if (lines := len(path.read_text().splitlines())) > LONGEST_FILE
    }
    assert not long, f"split these files (at most {LONGEST_FILE} lines): {long}"


def test_public_things_have_docstrings():
    missing = []
    for path in sources():
        tree = ast.parse(path.read_text())
        if ast.get_docstring(tree) is None:
            missing.append(str(path.relative_to(ROOT)))
        for node in tree.body:
            named = isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_")
            if named and ast.get_docstring(node) is None:
                missing.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}")
    assert not missing, "\n".join(missing)


def tracked_text() -> list[Path]:
    suffixes = {".py", ".md", ".toml", ".txt", ".json", ".cff", ".html", ""}
    skip = {".git", "__pycache__", "runs", "build", "dist"}
    found = []
    for path in ROOT.rglob("*"):
        parts = path.relative_to(ROOT).parts
        hidden = any(part in skip or part.startswith(".venv") or part.endswith("_cache") for part in parts)
        if path.is_file() and not hidden and path.suffix in suffixes and ".hypothesis" not in parts:
            found.append(path)
    return found


def test_no_file_names_a_place_on_one_machine():
    # Spelt in pieces, so that this file passes its own test.
    absolute = re.compile(
        r"(?<![\w./])/(?:" + "|".join(["work", "home", "root", "Users", "opt", "mnt"]) + r")/\w"
    )
    faults = []
    for path in tracked_text():
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            if absolute.search(line):
                faults.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}")
    assert not faults, "\n".join(faults)


def test_the_changelog_has_an_entry_for_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    text = (ROOT / "CHANGELOG.md").read_text()
    entry = re.search(rf"^## .*{re.escape(version)}.*?(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert entry is not None, f"CHANGELOG.md has no heading for {version}"
    assert re.search(r"^- \w", entry[0], re.MULTILINE) or "- `" in entry[0], (
        f"the entry for {version} is empty"
    )

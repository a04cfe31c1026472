"""What pyproject.toml promises agrees with the code, the pins and the other front-page files."""

import ast
import re
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = ("aquaquad_envs", "baselines", "agents", "evaluation")
OWN = {*PACKAGES, "train", "evaluate"}
CORE = [Requirement(text) for text in PROJECT["dependencies"]]
EXTRAS = {
    name: [Requirement(text) for text in texts]
    for name, texts in PROJECT["optional-dependencies"].items()
    if name != "all"
}
ALL = CORE + [need for needs in EXTRAS.values() for need in needs]


def read_pins(name: str) -> dict[str, str]:
    lines = (ROOT / name).read_text().splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(package): version for package, version in pairs}


PINNED = read_pins("constraints.txt")
LOWEST = read_pins("constraints-lowest.txt")


def lower_bound(requirement: Requirement) -> Version:
    (bound,) = [Version(part.version) for part in requirement.specifier if part.operator == ">="]
    return bound


def names(requirements: list[Requirement]) -> set[str]:
    return {canonicalize_name(requirement.name) for requirement in requirements}


@pytest.mark.parametrize("requirement", ALL, ids=str)
def test_the_pinned_version_meets_the_bound(requirement):
    assert PINNED[canonicalize_name(requirement.name)] in requirement.specifier


@pytest.mark.parametrize(
    "requirement",
    [*CORE, *(need for name, needs in EXTRAS.items() if name != "dev" for need in needs)],
    ids=str,
)
def test_the_lowest_version_is_the_bound_itself(requirement):
    assert Version(LOWEST[canonicalize_name(requirement.name)]) == lower_bound(requirement)


def test_an_extra_repeats_no_bound_differently():
    seen: dict[str, Requirement] = {}
    for requirement in ALL:
        other = seen.setdefault(canonicalize_name(requirement.name), requirement)
        assert other.specifier == requirement.specifier, f"{other} and {requirement}"


def closure(requirements: list[Requirement]) -> set[str]:
    """Names of the distributions that these requirements install in this environment."""
    found: set[tuple[str, frozenset[str]]] = set()
    todo = list(requirements)
    while todo:
        requirement = todo.pop()
        key = (canonicalize_name(requirement.name), frozenset(requirement.extras))
        if key in found:
            continue
        found.add(key)
        for text in metadata.requires(requirement.name) or []:
            need = Requirement(text)
            extras = requirement.extras or {""}
            if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in extras):
                todo.append(need)
    return {name for name, _ in found}


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the pins are those of CPython 3.11")
def test_everything_that_is_installed_with_the_project_is_pinned():
    needed = closure(ALL)
    assert needed <= set(PINNED), f"not pinned: {sorted(needed - set(PINNED))}"
    spare = set(PINNED) - needed - {"pip"}
    assert not spare, f"pinned, but needed by nothing: {sorted(spare)}"


def third_party_imports(path: Path, *, top_level_only: bool) -> set[str]:
    """Other people's packages that a file imports; ``top_level_only`` leaves out those in functions."""
    found = set()
    tree = ast.parse(path.read_text())
    lazy = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        or (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test))
        for inner in ast.walk(node)
        if inner is not node
    }
    for node in ast.walk(tree):
        if top_level_only and id(node) in lazy:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            found.add(node.module.split(".")[0])
    return {name for name in found if name not in sys.stdlib_module_names and name not in OWN}


INSTALLED = metadata.packages_distributions()


def distribution_of(module: str) -> str:
    known = INSTALLED.get(module)
    assert known, f"{module} is imported but not installed"
    return canonicalize_name(known[0])


def test_every_import_is_declared():
    declared = names(CORE) | names([need for name in EXTRAS if name != "dev" for need in EXTRAS[name]])
    files = [*(path for name in PACKAGES for path in (ROOT / name).rglob("*.py")), *ROOT.glob("*.py")]
    faults = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in files
        for module in third_party_imports(path, top_level_only=False)
        if distribution_of(module) not in declared
    ]
    assert files
    assert not faults, "declare in pyproject.toml: " + ", ".join(faults)


def test_the_core_imports_only_core_dependencies_at_the_top():
    """``import aquaquad_envs`` must work without any extra; what needs one imports it in a function."""
    core = names(CORE)
    optional = {Path("aquaquad_envs/interfaces/sb3.py")}  # a subclass of SB3's VecEnv: loaded on first use
    faults = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in (ROOT / "aquaquad_envs").rglob("*.py")
        for module in third_party_imports(path, top_level_only=True)
        if distribution_of(module) not in core and path.relative_to(ROOT) not in optional
    ]
    assert not faults, ", ".join(faults)


def test_every_core_dependency_is_imported():
    files = [path for name in PACKAGES[:2] for path in (ROOT / name).rglob("*.py")]
    used = {
        distribution_of(module)
        for path in files
        for module in third_party_imports(path, top_level_only=False)
    }
    assert names(CORE) <= used, f"needed by nothing: {sorted(names(CORE) - used)}"


def test_every_folder_with_code_is_a_package():
    bare = {
        str(path.parent.relative_to(ROOT))
        for name in PACKAGES
        for path in (ROOT / name).rglob("*.py")
        if not (path.parent / "__init__.py").exists()
    }
    assert not bare, f"without __init__.py the wheel leaves them out: {sorted(bare)}"


def test_front_page_files_agree_on_version_and_licence():
    citation = (ROOT / "CITATION.cff").read_text()
    assert re.search(rf"^version: {re.escape(PROJECT['version'])}$", citation, re.MULTILINE)
    assert re.search(rf"^license: {PROJECT['license']}$", citation, re.MULTILINE)
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")


def test_links_in_the_documentation_lead_somewhere():
    dead = []
    for page in [ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text()):
            if "://" not in target and not (page.parent / target).exists():
                dead.append(f"{page.relative_to(ROOT)}: {target}")
    assert not dead, "\n".join(dead)

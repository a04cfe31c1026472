"""Build the wheel; check that it installs, imports and runs alone, with the lowest and the pinned versions.

Each run gets an empty virtual environment and an empty folder outside the checkout, with the
core dependencies only: what imports there imports for a user who typed ``pip install``.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROBE = Path(__file__).with_name("wheel_probe.py")
CONSTRAINTS = {"lowest": "constraints-lowest.txt", "pinned": "constraints.txt"}
SOURCES = ("aquaquad_envs", "baselines", "agents", "evaluation")
FILES = ("train.py", "evaluate.py", "pyproject.toml", "README.md", "LICENSE")


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command and return what it printed; raise ``SystemExit`` with its output if it fails."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"FAILED: {' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}")
    return done.stdout


def build_wheel(work: Path) -> Path:
    """Build from a copy of the sources, so that no earlier build leaks in; return the wheel."""
    copy = work / "source"
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for folder in SOURCES:
        shutil.copytree(ROOT / folder, copy / folder, ignore=skip)
    for name in FILES:
        shutil.copy(ROOT / name, copy / name)
    # The pinned setuptools of this environment builds; an isolated build would fetch the newest.
    options = ("--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir")
    run(sys.executable, "-m", "pip", "wheel", *options, work / "dist", copy, cwd=work)
    (wheel,) = (work / "dist").glob("*.whl")
    return wheel


def check_contents(wheel: Path) -> int:
    """Check that the wheel holds every source file and data file, and nothing else; return the count."""
    held = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    wanted = {"train.py", "evaluate.py"}
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                wanted.add(path.relative_to(ROOT).as_posix())
    if held != wanted:
        raise SystemExit(f"wheel: missing {sorted(wanted - held)}, not expected {sorted(held - wanted)}.")
    return len(held)


def try_in_empty_environment(wheel: Path, constraints: Path, work: Path) -> dict:
    """Install the wheel under ``constraints`` into a new environment and run the probe there."""
    home = work / constraints.stem
    empty = home / "empty"
    empty.mkdir(parents=True)
    venv.create(home / "venv", with_pip=True)
    python = home / "venv" / "bin" / "python"
    pip = (python, "-m", "pip", "--disable-pip-version-check")
    run(*pip, "install", "--quiet", "--only-binary", ":all:", "-c", constraints, wheel, cwd=empty)
    run(*pip, "check", cwd=empty)
    # -I: neither the current folder nor PYTHONPATH can lend a module.
    return json.loads(run(python, "-I", PROBE, cwd=empty).splitlines()[-1])


def compare(outcomes: dict[str, dict]) -> None:
    """Check that the same episode came out under every set of versions (libraries may round differently)."""
    (first, one), *others = outcomes.items()
    for name, other in others:
        for key, value in one["episode"].items():
            if not math.isclose(value, other["episode"][key], rel_tol=1e-6, abs_tol=1e-6):
                raise SystemExit(
                    f"{key}: {value!r} with the {first} versions, {other['episode'][key]!r} with the {name} ones"
                )


def main() -> None:
    """Run the check from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=CONSTRAINTS, help="one set of versions instead of both")
    only = parser.parse_args().only
    with tempfile.TemporaryDirectory(prefix="aquaquad-wheel-") as folder:
        work = Path(folder)
        wheel = build_wheel(work)
        print(
            f"{wheel.name}: {check_contents(wheel)} files, {wheel.stat().st_size / 1024:.0f} KiB", flush=True
        )
        outcomes = {}
        for name in [only] if only else CONSTRAINTS:
            start = time.monotonic()
            outcomes[name] = outcome = try_in_empty_environment(wheel, ROOT / CONSTRAINTS[name], work)
            print(
                f"{name}: {outcome['modules']} modules imported, episode run; "
                f"{', '.join(outcome['versions'])} ({time.monotonic() - start:.0f} s)",
                flush=True,
            )
        compare(outcomes)
    print("wheel check passed")


if __name__ == "__main__":
    main()

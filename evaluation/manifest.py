"""What a run was made with: machine, versions, commit, command."""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGES = (
    "aquaquad-envs", "numpy", "numba", "scipy", "gymnasium", "pettingzoo", "pvlib", "pandas", "shapely",
    "xarray", "netCDF4", "stable-baselines3", "torch", "safetensors", "matplotlib", "rich", "tyro",
)  # fmt: skip
_ROOT = Path(__file__).resolve().parents[1]


def machine() -> dict[str, Any]:
    """The machine and the versions that numbers and times depend on."""
    return {
        "platform": platform.platform(),
        "cpu": _cpu(),
        "cores": _cores(),
        "memory_gib": _memory_gib(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in _PACKAGES},
    }


def run_manifest(arguments: list[str]) -> dict[str, Any]:
    """How the run came about; ``arguments`` are those of the command line."""
    return {
        "command": " ".join(["python evaluate.py", *arguments]),
        "commit": commit(),
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def commit() -> str | None:
    """The commit of the checkout that this file lies in, "+" if the tree differs; None where there is none."""
    try:
        head = _git("rev-parse", "--short=12", "HEAD")
        return head + ("+" if _git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(*command: str) -> str:
    # A wheel in somebody else's repository must not take that repository's commit for its own.
    if not (_ROOT / ".git").exists():
        raise FileNotFoundError(".git")
    done = subprocess.run(
        ["git", *command], cwd=_ROOT, capture_output=True, text=True, timeout=10, check=True
    )
    return done.stdout.strip()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _memory_gib() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    except (ValueError, OSError):
        return None

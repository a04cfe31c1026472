"""Checkpoints: weights as safetensors beside a JSON card; loading never unpickles.

A policy checkpoint is a folder with ``weights.safetensors`` and ``card.json``. The card tells the
task, its parameters, seed, steps, versions and results, and holds the SHA-256 of the weights, so
that a truncated or altered file is refused by name.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from aquaquad_envs.errors import CheckpointError

SCHEMA = 1
WEIGHTS, CARD = "weights.safetensors", "card.json"
SHIPPED = Path(__file__).parent / "checkpoints"


def write_atomically(path: Path, data: bytes) -> None:
    """Write ``data`` so that ``path`` holds either its old or its new content, whatever interrupts."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    with beside.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    found = {"python": platform.python_version()}
    for package in ("aquaquad-envs", "gymnasium", "numpy", "numba", "stable-baselines3", "torch"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def save(folder: Path, tensors: dict[str, np.ndarray], card: dict[str, Any]) -> None:
    """Write a checkpoint. The card is written last: without it a folder is no checkpoint."""
    from safetensors.numpy import save as serialise

    data = serialise({name: np.ascontiguousarray(value) for name, value in tensors.items()})
    card = {"schema": SCHEMA, **card, "sha256": hashlib.sha256(data).hexdigest()}
    write_atomically(folder / WEIGHTS, data)
    write_atomically(folder / CARD, (json.dumps(card, indent=1) + "\n").encode())


def load(
    folder: str | Path, *, task: str | None = None, kind: str | None = None
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors and card of a checkpoint folder.

    Raises ``CheckpointError`` that names the file where it is missing, truncated, altered, of
    another schema, or made for another ``task`` or as another ``kind`` ("policy" or "training").
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load as deserialise

    folder = Path(folder)
    card_path, weights_path = folder / CARD, folder / WEIGHTS
    for path in (card_path, weights_path):
        if not path.is_file():
            raise CheckpointError(f"{path}: not found; a checkpoint is a folder with {WEIGHTS} and {CARD}.")
    try:
        card = json.loads(card_path.read_text())
        schema, digest = card["schema"], card["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{card_path}: not a readable card ({error}); the file is damaged.") from error
    if schema != SCHEMA:
        raise CheckpointError(
            f"{card_path}: got schema {schema}, expected {SCHEMA}; made by another version."
        )
    if task is not None and card.get("task") != task:
        raise CheckpointError(f"{card_path}: made for task {card.get('task')!r}, expected {task!r}.")
    if kind is not None and card.get("kind") != kind:
        raise CheckpointError(f"{card_path}: holds a {card.get('kind')!r} checkpoint, expected {kind!r}.")
    data = weights_path.read_bytes()
    if hashlib.sha256(data).hexdigest() != digest:
        raise CheckpointError(
            f"{weights_path}: its content does not match the card (truncated or altered); fetch it again."
        )
    try:
        return deserialise(data), card
    except SafetensorError as error:
        raise CheckpointError(f"{weights_path}: not a safetensors file ({error}).") from error


def shipped(task: str, scenario: str) -> Path:
    """Folder of the checkpoint in the repository for ``task`` on ``scenario``.

    The vortex scenarios share one; every other scenario uses the one trained on random gyres. Each other
    task has one for all its scenarios.
    """
    alone = {
        "sensor-placement": "vortex", "transponder-localization": "random", "laser-tracking": "flat-top",
        "plume-tracing": "turbulent",
    }  # fmt: skip
    if task in alone:
        return SHIPPED / task / alone[task]
    return SHIPPED / task / ("vortex" if scenario.startswith("vortex") else "gyres")

"""The published study of plume tracing (SAND2003-2643, sections 5 to 8; SPEC §9), run again in our worlds.

The published variant is the printed script: ten robots in turn, each fits the ten readings of the moment by least
squares, whatever the condition number. Beside it runs ours: all at once, the best twenty readings remembered,
SVD, fall-back to the plane.

Two readings of the script matter. What it tabulates as the distance of the centre of mass is the mean of the robots'
distances. And as printed it multiplies a column of readings by a row of random factors and keeps the first column of
the product: one factor for all. A step -H⁻¹g does not depend on the scale of F, so that such noise does nothing, and
that is what its tables show; :func:`reproduce_plume` runs noise both ways.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from aquaquad_envs.errors import check_range
from aquaquad_envs.tasks.batch import make_world_batch
from aquaquad_envs.tasks.rollout import rollout
from baselines import make_policy
from evaluation import published_plume_values as values
from evaluation.published_plume_orientation import reproduce_orientation

#: Standard errors beyond which a difference is marked.
MARK = 3.0
#: The printed script as options of ``quadratic-fit``.
PRINTED: dict[str, Any] = {
    "method": "qr", "readings": "now", "condition_limit": 1e300, "without_fit": "hold"
}  # fmt: skip
#: Seeds of our two uses of a run's seed that must not be equal.
_NOISE_STREAM = 0x4E4F4953


class OneFactor:
    """A policy whose team reads everything with one random error, as the script has it: uniform within ± ``noise``."""

    def __init__(self, policy: Any, noise: float) -> None:
        self.policy, self.noise = policy, noise
        self.information = policy.information

    def reset(self, seeds: np.ndarray) -> None:
        """Begin an episode in every world."""
        self.generator = np.random.default_rng([_NOISE_STREAM, *(int(seed) for seed in seeds)])
        self.policy.reset(seeds)

    def act(self, observations: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """The policy's actions on readings that are all wrong by the same factor; the worlds keep theirs."""
        kept = worlds["reading"].copy()
        worlds["reading"] *= 1.0 + self.noise * self.generator.uniform(-1.0, 1.0, (len(worlds), 1))
        actions = self.policy.act(observations, worlds)
        worlds["reading"] = kept
        return actions


def _run(
    runs: int, seed: int, params: dict[str, Any], options: dict[str, Any], factor: float = 0.0
) -> dict[str, Any]:
    """Metrics of ``runs`` episodes: mean and standard deviation of each."""
    batch = make_world_batch("plume-tracing", runs, **params)
    policy: Any = make_policy("quadratic-fit", batch, **options)
    if factor > 0.0:
        policy = OneFactor(policy, factor)
    metrics = rollout(policy, batch, seed + np.arange(runs)).metrics
    return {
        "runs": runs,
        **{
            name: {"mean": float(found.mean()), "std": float(found.std(ddof=1))}
            for name, found in metrics.items()
        },
    }


def apart(published: float, ours: dict[str, float], runs: int) -> float:
    """Ours less the published mean, in standard errors of the difference; the spread of both is taken from ours.

    The source gives no spread: its means are taken for those of :data:`values.RUNS` runs like ours. NaN without spread.
    """
    error = ours["std"] * np.sqrt(1.0 / values.RUNS + 1.0 / runs)
    return float((ours["mean"] - published) / error) if error > 0.0 else float("nan")


def _row(start: str, variant: str, level: float, published: Any, found: dict[str, Any]) -> dict[str, Any]:
    """A row of a table: published and ours by column."""
    theirs = None if published is None else dict(zip(values.COLUMNS, published, strict=True))
    return {
        "start": start, "variant": variant, "level": level, "runs": found["runs"], "published": theirs,
        "ours": {name: found[name] for name in values.COLUMNS}, "success": found["success"]["mean"],
        "last_moved": found["last_moved"], "updates_to_source": found["updates_to_source"],
        "apart": None if theirs is None else {
            name: apart(theirs[name], found[name], found["runs"]) for name in values.COLUMNS
        },
    }  # fmt: skip


def _settings() -> list[tuple[str, dict[str, Any]]]:
    """Every row to run, with the name of its table."""
    rows: list[tuple[str, dict[str, Any]]] = []
    for start in values.STARTS:
        for noise, theirs in values.NOISE.items():
            world = {"horizon_updates": values.NOISE_UPDATES, "sensor_noise": noise}
            rows.append(("noise", {"start": start, "level": noise, "theirs": theirs[start], "world": world}))
            if noise > 0.0:
                still = {"horizon_updates": values.NOISE_UPDATES}
                common = {"level": noise, "theirs": theirs[start], "world": still, "factor": noise}
                rows.append(("noise", {"start": start, **common}))
            rows.append(("noise", {"start": start, "level": noise, "world": world, "product": True}))
        for error, theirs in values.POSITION.items():
            world = {"horizon_updates": values.POSITION_UPDATES, "position_error_m": error}
            walk = {**world, "position_error_kind": "random-walk"}
            rows.append(
                ("position", {"start": start, "level": error, "theirs": theirs[start], "world": walk})
            )
            rows.append(("position", {"start": start, "level": error, "world": world, "product": True}))
        for degrees in values.HEADING_DEG:
            world = {"horizon_updates": values.POSITION_UPDATES, "heading_error_deg": degrees}
            rows.append(("heading", {"start": start, "level": degrees, "world": world}))
            rows.append(("heading", {"start": start, "level": degrees, "world": world, "product": True}))
    return rows


def steps() -> int:
    """How often :func:`reproduce_plume` calls ``advance``."""
    return len(_settings()) + 1


def reproduce_plume(
    runs: int, seed: int, advance: Callable[[], None]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """All tables as JSON can hold them, and what the figures draw.

    ``runs`` of each published row, a quarter of them of the others, from ``seed`` on. ``advance`` is called
    :func:`steps` times.
    Raises ``InvalidParameterError`` for runs or seeds out of bounds.
    """
    check_range("plume-runs", runs, 4, 100_000)
    check_range("seed", seed, 0, 2**62)
    fewer = max(runs // values.FEWER, 2)
    found: dict[str, Any] = {
        "runs": runs, "fewer": fewer, "seed": seed, "published_runs": values.RUNS, "source": values.SOURCE,
        "noise": [], "position": [],
        "heading": [], "locked": {},
    }  # fmt: skip
    for table, row in _settings():
        product = row.get("product", False)
        world = {
            **row["world"], "scenario": row["start"], "updates": "simultaneous" if product else "sequential"
        }  # fmt: skip
        count = runs if not product and table != "heading" else fewer
        made = _run(count, seed, world, {} if product else PRINTED, row.get("factor", 0.0))
        variant = "product" if product else "one factor" if "factor" in row else "published"
        found[table].append(_row(row["start"], variant, row["level"], row.get("theirs"), made))
        if table == "position" and not product and row["level"] == 0.0:
            found["locked"][row["start"]] = {
                "published": values.LOCKED[row["start"]], "ours": made["last_moved"],
                "horizon": values.POSITION_UPDATES,
            }  # fmt: skip
        advance()
    found["orientation"], drawn = reproduce_orientation(fewer, seed, PRINTED)
    advance()
    return found, drawn

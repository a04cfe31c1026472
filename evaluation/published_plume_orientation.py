"""The orientation study of plume tracing (SAND2003-2643, section 5, figure 5), and how far from a lamp it works.

A lamp's light is taken for k/R², though the sensor of a vehicle that keeps its pitch at zero reads k |sin γ|/R².
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aquaquad_envs.compilation import loop_kernel
from aquaquad_envs.tasks.batch import WorldBatch, make_world_batch
from aquaquad_envs.tasks.plume_tracing_data import SCRATCH
from aquaquad_envs.tasks.plume_tracing_sensing import forget_all, sense
from baselines import make_policy
from evaluation import published_plume_values as values

KINDS = ("light", "oriented-light")
#: m; half widths of the squares in which teams begin, and heights above the lamp, as in figure 5.
SQUARES_M = (10.0, 20.0, 30.0, 40.0, 60.0, 80.0)
HEIGHTS_M = (0.5, 9.5)
#: Updates given beyond those of a straight line from the corner of the square.
_SPARE = 60
#: Updates at which courses are compared with the direction of the source.
COURSES_AT = (1, 5, 10)


@loop_kernel
def _place_teams(worlds, places, ocean, c):
    """Put the robots of every world at ``places`` (worlds, robots, 3), m from the source, and let them read anew."""
    scratch = np.empty(1, SCRATCH)
    s = scratch[0]
    for k in range(worlds.size):
        w = worlds[k]
        for i in range(c.num_robots):
            w.x[i] = w.start_x[i] = w.source_x + places[k, i, 0]
            w.y[i] = w.start_y[i] = w.source_y + places[k, i, 1]
            w.z[i] = w.start_z[i] = w.source_z + places[k, i, 2]
        forget_all(w, c)
        sense(w, ocean, c, s)
    scratch[0].blocked = 0  # a record does not keep its array alive: this does


def _worlds(kind: str, places: np.ndarray, seed: int, step_limit: float, horizon: int) -> WorldBatch:
    """Worlds whose teams begin at ``places`` (worlds, robots, 3), m from the source, z up."""
    batch = make_world_batch(
        "plume-tracing", len(places), scenario="surround", field=kind, num_robots=places.shape[1], half_width_m=200.0,
        step_limit_m=step_limit, horizon_updates=horizon,
    )  # fmt: skip
    batch.reset(seed)
    _place_teams(batch.worlds, places * np.array([1.0, 1.0, -1.0]), batch.ocean, batch.constants)
    return batch


def _trace(batch: WorldBatch, updates: int, options: dict[str, Any]) -> np.ndarray:
    """Places relative to the source, m, z up: (updates + 1, worlds, robots, 3)."""
    policy = make_policy("quadratic-fit", batch, **options)
    policy.reset(np.zeros(batch.num_worlds, dtype=np.int64))
    places = [_places(batch)]
    for _ in range(updates):
        batch.step(policy.act(batch.observations, batch.worlds))
        places.append(_places(batch))
    return np.stack(places)


def _places(batch: WorldBatch) -> np.ndarray:
    relative = [batch.worlds[a][:, : batch.num_agents] - batch.worlds[f"source_{a}"][:, None] for a in "xyz"]
    return np.stack([relative[0], relative[1], -relative[2]], axis=-1)


def courses_off(places: np.ndarray) -> np.ndarray:
    """Angle, rad, between each move and the direction of the source: (updates, ...); NaN of robots that rest."""
    moves, towards = np.diff(places, axis=0), -places[:-1]
    lengths = np.linalg.norm(moves, axis=-1) * np.linalg.norm(towards, axis=-1)
    cosines = np.divide(
        (moves * towards).sum(-1), lengths, out=np.full(lengths.shape, np.nan), where=lengths > 0
    )
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def first_within(distances: np.ndarray, radius: float) -> np.ndarray:
    """Update at which ``distances`` (updates + 1, ...) are first within ``radius``; NaN where never."""
    inside = distances <= radius
    return np.where(inside.any(axis=0), inside.argmax(axis=0), np.nan)


def reproduce_orientation(
    teams: int, seed: int, options: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The study with the published starts, and with ``teams`` random teams a square: table, and tracks to draw."""
    study = values.ORIENTATION
    limit = study["step_limit_m"]
    drawn: dict[str, Any] = {"tracks": {}}
    rows, squares = [], []
    for kind in KINDS:
        updates = study["updates"][kind]
        places = _trace(_worlds(kind, study["starts"][None], seed, limit, 500), 60, options)[:, 0]
        drawn["tracks"][kind] = places[: updates + 1]
        distances = np.linalg.norm(places, axis=-1)
        off = np.degrees(courses_off(places))
        rows.append(
            {
                "field": kind, "published_updates": updates,
                "closest_then_m": float(distances[updates].min()),
                "reached_at": float(first_within(distances.min(axis=1), 1.0)),
                "course_off_deg": {str(at): float(np.nanmean(off[at - 1])) for at in COURSES_AT},
            }
        )  # fmt: skip
        squares += [_square(kind, half, teams, seed, limit, options) for half in SQUARES_M]
    drawn["squares"] = squares
    furthest = float(np.linalg.norm(study["starts"], axis=1).max())
    found = {
        "source": study["source"], "works_up_to_m": study["works_up_to_m"], "furthest_start_m": furthest,
        "step_limit_m": limit, "rows": rows, "squares": squares, "teams": teams,
    }  # fmt: skip
    return found, drawn


def _square(
    kind: str, half: float, teams: int, seed: int, limit: float, options: dict[str, Any]
) -> dict[str, Any]:
    """Teams that begin anywhere in a square about the source, the same for both kinds of light."""
    rng = np.random.default_rng([seed, int(half)])
    low, high = np.array([-half, -half, HEIGHTS_M[0]]), np.array([half, half, HEIGHTS_M[1]])
    starts = rng.uniform(low, high, (teams, len(values.ORIENTATION["starts"]), 3))
    updates = int(half / limit) + _SPARE
    distances = np.linalg.norm(
        _trace(_worlds(kind, starts, seed, limit, 2 * updates), updates, options), axis=-1
    )
    reached = first_within(distances.min(axis=-1), 1.0)
    found = np.isfinite(reached)
    return {
        "field": kind, "half_width_m": half, "furthest_m": float(distances[0].max(axis=-1).mean()), "given": updates,
        "reached": float(found.mean()), "updates": float(reached[found].mean()) if found.any() else None,
    }  # fmt: skip

"""A batch of worlds of one task: arrays in, arrays out. Every interface is a thin view of one."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np

from aquaquad_envs.errors import InvalidActionError, InvalidParameterError
from aquaquad_envs.physics.randomness import SOURCES, seed_streams
from aquaquad_envs.tasks.task import Task, load_task

#: Greatest action component that kernels may square.
_SQUARABLE = 1e100
#: Worlds that must begin anew at once before threads pay.
_WORTH_A_THREAD = 512

Seeds = int | Sequence[int | None] | np.ndarray | None


class WorldBatch:
    """``num_worlds`` worlds of one task.

    Where the task is one of a team, all arrays but ``worlds`` have an axis of ``num_agents`` agents after
    that of worlds.

    Attributes
    ----------
    worlds: structured array (num_worlds,) of the task's record; a copy of it is a snapshot.
    observations: float32 (num_worlds, observation size), in [-1, 1].
    rewards: float64 (num_worlds,); reward_terms: float64 (num_worlds, terms).
    terminated, truncated: bool (num_worlds,).
    ocean, constants: immutable data and scalars that the kernels read; notes: what was assumed.

    The arrays are reused by every step: copy what you keep. A finished world stays as it is
    until it is reset, and so does an agent that is done while its world goes on.
    """

    def __init__(self, task: Task, num_worlds: int, params: Any, *, threads: int = 1) -> None:
        if not isinstance(num_worlds, int | np.integer) or num_worlds < 1:
            raise InvalidParameterError("num_worlds", num_worlds, "a whole number of at least 1")
        if not isinstance(threads, int | np.integer) or not 1 <= threads <= 256:
            raise InvalidParameterError("threads", threads, "a whole number in [1, 256]")
        self.task = task
        self.params = params
        self.num_worlds = int(num_worlds)
        self.threads = int(threads)
        self.ocean, self.constants, self.notes = task.build(params)
        self.action_spec = task.action_spec(params)
        self.num_agents = 1 if task.num_agents is None else int(task.num_agents(params))
        #: Shape of one number a decision-maker: (num_worlds,), or (num_worlds, num_agents).
        self.rows = (self.num_worlds,) if task.num_agents is None else (self.num_worlds, self.num_agents)
        self.worlds = np.zeros(num_worlds, dtype=task.world)
        self.observations = np.zeros((*self.rows, len(task.observation_names)), dtype=np.float32)
        self.rewards = np.zeros(self.rows)
        self.reward_terms = np.zeros((*self.rows, len(task.reward_terms)))
        self.terminated = np.zeros(self.rows, dtype=bool)
        self.truncated = np.zeros(self.rows, dtype=bool)
        self._actions = np.zeros((*self.rows, self.action_spec.size))
        self._seeded = np.zeros(num_worlds, dtype=bool)

    @property
    def done(self) -> np.ndarray:
        """Which decision-makers are terminated or truncated: bool, of shape ``rows``."""
        return self.terminated | self.truncated

    @property
    def finished(self) -> np.ndarray:
        """Which worlds have ended, with all their agents: bool (num_worlds,)."""
        return np.logical_and.reduce(self.done.reshape(self.num_worlds, -1), axis=1)

    @property
    def outcomes(self) -> np.ndarray:
        """How it ended for each decision-maker, 0 while it goes on: indices into ``task.outcomes``."""
        if self.task.num_agents is None:
            return self.worlds["outcome"]
        return self.worlds["agent_outcome"][:, : self.num_agents]

    @property
    def action_shape(self) -> tuple[int, ...]:
        """Shape of what ``step`` takes: ``rows`` of indices, or of ``size`` numbers each."""
        return self.rows if self.action_spec.table is not None else (*self.rows, self.action_spec.size)

    @property
    def state_size(self) -> int:
        """Numbers in the central view of a world."""
        names = self.task.state_names
        return self.observations[0].size if names is None else len(names(self.params))

    def reset(self, seeds: Seeds = None, *, mask: np.ndarray | None = None) -> np.ndarray:
        """Begin a new episode in every world, or in those where ``mask`` (num_worlds,) is true.

        ``seeds``: None goes on with each world's streams (drawn afresh in a world never seeded);
        an int s seeds world i with s + i; a sequence gives one seed (or None) a world.
        Returns ``observations``.
        """
        mask = np.ones(self.num_worlds, dtype=bool) if mask is None else self._checked_mask(mask)
        for i, seed in self._seed_pairs(seeds, mask):
            streams = seed_streams(seed)
            for source, name in enumerate(SOURCES):
                self.worlds[f"rng_{name}"][i] = streams[source]
            self._seeded[i] = True
        # A few worlds are sooner reset than shared among threads.
        threads = self.threads if mask.sum() >= _WORTH_A_THREAD else 1
        self._run(self.task.reset, self.worlds, mask, self.observations, threads=threads)
        self.terminated[mask] = False
        self.truncated[mask] = False
        return self.observations

    def step(self, actions: Any) -> None:
        """Advance every running world by one decision and refresh the arrays.

        ``actions``: (num_worlds, size) finite numbers, longer than the unit disc allows are
        shortened to it; or (num_worlds,) indices in the discrete variant; of a team for each agent. Raises
        ``InvalidActionError`` naming shape, dtype or value otherwise; the worlds are then untouched.
        """
        if not self._seeded.all():
            raise InvalidActionError("step: worlds that were never reset; expected reset() before step().")
        self._run(
            self.task.step, self.worlds, self._checked_actions(actions), self.observations, self.rewards,
            self.reward_terms, self.terminated, self.truncated, threads=self.threads,
        )  # fmt: skip

    def metrics(self, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """The task's metrics of the episodes so far: (num_worlds,), or of the worlds where ``mask`` is true."""
        worlds = self.worlds if mask is None else self.worlds[self._checked_mask(mask)]
        return self.task.metrics(worlds, self.params)

    def state(self) -> np.ndarray:
        """The central view of each world, a fresh float32 (num_worlds, ``state_size``) in [-1, 1].

        What trainers of teams may know; without one of its own, a task shows all agents' observations.
        """
        if self.task.state is None:
            return self.observations.reshape(self.num_worlds, -1).copy()
        view = np.zeros((self.num_worlds, self.state_size), dtype=np.float32)
        self._run(self.task.state, self.worlds, view, threads=self.threads)
        return view

    def take_observations(self) -> np.ndarray:
        """Hand ``observations`` over without a copy; later steps write to another array.

        For callers that reset every finished world before they read observations again: rows that
        neither a step nor a reset writes are undefined from now on.
        """
        taken = self.observations
        self.observations = np.empty_like(taken)
        return taken

    def snapshot(self) -> np.ndarray:
        """A copy of all worlds, random streams included."""
        return self.worlds.copy()

    def restore(self, snapshot: np.ndarray) -> None:
        """Go back to a :meth:`snapshot`; observations are those of the next reset or step."""
        if snapshot.dtype != self.worlds.dtype or snapshot.shape != self.worlds.shape:
            raise InvalidParameterError(
                "snapshot", f"{snapshot.dtype.name} {snapshot.shape}", f"this batch's own {self.worlds.shape}"
            )
        self.worlds[:] = snapshot
        self._seeded[:] = True

    def __getstate__(self) -> dict[str, Any]:
        # Immutable data are rebuilt from the parameters: pickles stay small.
        state = self.__dict__.copy()
        for name in ("ocean", "constants", "notes"):
            del state[name]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.ocean, self.constants, self.notes = self.task.build(self.params)

    def _run(self, loop: Callable[..., None], *arrays: np.ndarray, threads: int) -> None:
        """Run ``loop`` over all worlds: in one go, or a slice of the worlds in each thread.

        Kernels hold no GIL, and plain threads share nothing but the processor: unlike an OpenMP
        team they do not spin, survive a fork, and run the very machine code of the serial loop.
        """
        if threads == 1:
            loop(*arrays, self.ocean, self.constants)
            return
        edges = np.linspace(0, self.num_worlds, threads + 1).astype(int)
        slices = [slice(first, last) for first, last in itertools.pairwise(edges)]
        others = [
            _pool(threads - 1).submit(loop, *(array[part] for array in arrays), self.ocean, self.constants)
            for part in slices[1:]
        ]
        loop(*(array[slices[0]] for array in arrays), self.ocean, self.constants)
        for other in others:
            other.result()

    def _checked_mask(self, mask: np.ndarray) -> np.ndarray:
        mask = np.asarray(mask)
        if mask.dtype != bool or mask.shape != (self.num_worlds,):
            raise InvalidParameterError(
                "mask", f"{mask.dtype} {mask.shape}", f"a boolean array of shape ({self.num_worlds},)"
            )
        return mask

    def _seed_pairs(self, seeds: Seeds, mask: np.ndarray) -> list[tuple[int, Any]]:
        chosen = np.flatnonzero(mask)
        if seeds is None:
            new = chosen[~self._seeded[chosen]]
            if not len(new):
                return []
            return list(zip(new, np.random.SeedSequence().spawn(len(new)), strict=True))
        if isinstance(seeds, int | np.integer) and not isinstance(seeds, bool):
            seeds = [int(seeds) + i for i in range(self.num_worlds)]
        values = list(seeds) if isinstance(seeds, Sequence | np.ndarray) else [seeds]
        if len(values) != self.num_worlds:
            raise InvalidParameterError("seeds", seeds, f"an int, or {self.num_worlds} of them")
        for value in values:
            whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
            if value is not None and not (whole and value >= 0):
                raise InvalidParameterError("seed", value, "a whole number of 0 or more, or None")
        entropy = np.random.SeedSequence()
        return [
            (int(i), int(values[i]) if values[i] is not None else entropy.spawn(1)[0])
            for i in chosen
            if values[i] is not None or not self._seeded[i]
        ]

    def _checked_actions(self, actions: Any) -> np.ndarray:
        table = self.action_spec.table
        actions = action_array(actions, self.action_shape, discrete=table is not None)
        if table is not None:
            if actions.min() < 0 or actions.max() >= len(table):
                raise InvalidActionError(
                    f"action: got {actions.min()} to {actions.max()}, expected indices in [0, {len(table) - 1}]."
                )
            return table[actions]
        self._actions[...] = actions
        if not np.abs(self._actions).max() <= _SQUARABLE:  # NaN, infinity, or a square that would overflow
            finite = np.isfinite(self._actions).all(axis=-1)
            if not finite.all():
                world, *agent = np.unravel_index(np.argmin(finite), self.rows)
                whose = f" of {self.task.agent_name}_{agent[0]}" if agent else ""
                raise InvalidActionError(
                    f"action: got {actions[(world, *agent)]}{whose} in world {world}, "
                    "expected finite numbers in [-1, 1]."
                )
            largest = np.abs(self._actions).max(axis=-1, keepdims=True)
            self._actions /= np.where(largest > _SQUARABLE, largest, 1.0)
        return self._actions


def action_array(values: Any, shape: tuple[int, ...], *, discrete: bool, agent: str = "") -> np.ndarray:
    """``values`` as an array of ``shape`` of real numbers, or of whole ones where ``discrete``.

    Raises ``InvalidActionError`` naming shape or dtype, and the ``agent`` if given, for anything else.
    """
    source = f" from {agent}" if agent else ""
    try:
        array = np.asarray(values)
    except ValueError:
        raise InvalidActionError(
            f"action: got rows of unequal length{source}, expected shape {shape}."
        ) from None
    if array.shape != shape:
        raise InvalidActionError(f"action: got shape {array.shape}{source}, expected {shape}.")
    if array.dtype.kind not in ("iu" if discrete else "fiu"):
        numbers = "whole" if discrete else "real"
        raise InvalidActionError(f"action: got dtype {array.dtype}{source}, expected {numbers} numbers.")
    return array


def _pool(workers: int) -> ThreadPoolExecutor:
    # Keyed by process: a forked child has none of its parent's threads.
    return _pool_of(os.getpid(), workers)


@lru_cache(maxsize=4)
def _pool_of(_process: int, workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="aquaquad")


def make_world_batch(task: str, num_worlds: int, *, threads: int = 1, **params: Any) -> WorldBatch:
    """A batch of ``num_worlds`` worlds of ``task`` (a name such as "drift-hop").

    ``threads`` above 1 pays from about 512 worlds. ``params`` are
    the task's parameters. Raises ``InvalidParameterError`` for anything out of bounds.
    """
    loaded = load_task(task)
    return WorldBatch(loaded, num_worlds, loaded.make_params(**params), threads=threads)

"""Errors raised at the edge of the package: kernels below assume clean data."""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Iterable


class AquaQuadError(ValueError):
    """Base of every error that invalid input raises; a ``ValueError``."""


class InvalidParameterError(AquaQuadError):
    """A parameter is outside its bound: names the value, the bound and the remedy."""

    def __init__(self, name: str, value: object, expected: str, remedy: str = "") -> None:
        self.name = name
        super().__init__(f"{name}: got {value!r}, expected {expected}." + (f" {remedy}" if remedy else ""))


class InvalidActionError(AquaQuadError):
    """An action has the wrong shape or dtype, or is not finite."""


class CurrentFileError(AquaQuadError):
    """A file of ocean currents cannot be read; the message says what was found in it."""


class PlanningError(AquaQuadError):
    """A planner was given a problem that it cannot start on; the message says why."""


class CheckpointError(AquaQuadError):
    """A checkpoint is truncated, altered, or made for something else."""


def check_choice(name: str, value: object, choices: Iterable[str]) -> None:
    """Raise ``InvalidParameterError`` unless ``value`` is one of ``choices``; suggests the nearest."""
    known = list(choices)
    if value in known:
        return
    close = difflib.get_close_matches(str(value), known, n=1)
    raise InvalidParameterError(
        name, value, "one of " + ", ".join(known), f"Did you mean {close[0]!r}?" if close else ""
    )


def check_range(
    name: str, value: float, low: float, high: float, *, open_low: bool = False, remedy: str = ""
) -> None:
    """Raise ``InvalidParameterError`` unless ``low <= value <= high`` (``low <`` if ``open_low``)."""
    number = isinstance(value, numbers.Real) and not isinstance(value, bool)  # NumPy's scalars too
    if not number or not (low < value if open_low else low <= value) or not value <= high:
        bracket = "(" if open_low else "["
        raise InvalidParameterError(name, value, f"a number in {bracket}{low:g}, {high:g}]", remedy)

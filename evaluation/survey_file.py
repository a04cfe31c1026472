"""Reads recorded two-way travel times of one transponder: a text file, a line a reply.

    t_tx  N  E  U  σN  σE  σU   t_rx  N  E  U  σN  σE  σU   TWTT

Times in s; north, east and up in m, of the antenna when the signal was sent and when the reply came, in any local
frame; their standard deviations, m; the two-way time in s without the transponder's turn-around delay. Spaces or tabs
between; lines that begin with # are comments, of which the first few are kept.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from aquaquad_envs.errors import AquaQuadError

COLUMNS = (
    "t_tx", "N_tx", "E_tx", "U_tx", "sigN_tx", "sigE_tx", "sigU_tx", "t_rx", "N_rx", "E_rx", "U_rx", "sigN_rx",
    "sigE_rx", "sigU_rx", "TWTT",
)  # fmt: skip
#: Replies without which nothing can be said: unknowns, and as many again.
LEAST_REPLIES = 10
#: m: no survey is wider, no transponder farther; what is beyond was written in another unit.
_MOST_M, _MOST_RANGE_M = 1e6, 15_000.0
_NOMINAL_M_S = 1500.0
_KEPT_COMMENTS = 5


class SurveyFileError(AquaQuadError):
    """A survey cannot be read; the message tells file, line and what was expected."""


class Survey(NamedTuple):
    """A recorded survey, x east, y north, z down, in the frame of the file (its origin kept)."""

    name: str
    comments: tuple[str, ...]
    sent_s: np.ndarray  # (n,)
    received_s: np.ndarray  # (n,)
    transmit: np.ndarray  # (n, 3) m
    receive: np.ndarray  # (n, 3) m
    transmit_std: np.ndarray  # (n, 3) m
    receive_std: np.ndarray  # (n, 3) m
    two_way_s: np.ndarray  # (n,)

    @property
    def places(self) -> np.ndarray:
        """(n, 3) m: halfway between sending and receiving, where half the two-way path is to better than a millimetre
        the range, for a vehicle that moved no more than decimetres.
        """
        return 0.5 * (self.transmit + self.receive)

    @property
    def place_std(self) -> np.ndarray:
        """(n, 3) m: of both fixes together, whose errors within a second are taken to be the same."""
        return np.sqrt(0.5 * (self.transmit_std**2 + self.receive_std**2))


def read_survey(path: str | Path) -> Survey:
    """The survey in ``path``. Raises ``SurveyFileError`` naming the line, ``OSError`` where there is no such file."""
    path = Path(path)
    rows: list[list[float]] = []
    lines: list[int] = []
    comments: list[str] = []
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise SurveyFileError(f"{path}: is no text ({error.reason} at byte {error.start}).") from None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if stripped.startswith("#"):
            comments.append(stripped.lstrip("# "))
        elif stripped:
            rows.append(_row(stripped, f"{path}, line {number}"))
            lines.append(number)
    if len(rows) < LEAST_REPLIES:
        raise SurveyFileError(
            f"{path}: got {len(rows)} replies, expected at least {LEAST_REPLIES} lines of numbers."
        )
    table = np.array(rows)
    _check(table, np.array(lines), path)
    return Survey(
        path.name, tuple(comments[:_KEPT_COMMENTS]), table[:, 0], table[:, 7], _down(table[:, 1:4]),
        _down(table[:, 8:11]), table[:, [5, 4, 6]], table[:, [12, 11, 13]], table[:, 14],
    )  # fmt: skip


def _row(line: str, where: str) -> list[float]:
    words = line.split()
    if len(words) != len(COLUMNS):
        hint = " Separate them by spaces, not commas." if "," in line else ""
        raise SurveyFileError(
            f"{where}: got {len(words)} columns, expected {len(COLUMNS)} ({' '.join(COLUMNS)}).{hint}"
        )
    values = []
    for name, word in zip(COLUMNS, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            raise SurveyFileError(f"{where}: {name}: got {word!r}, expected a number.") from None
        if not np.isfinite(value):
            raise SurveyFileError(
                f"{where}: {name}: got {word}, expected a finite number. Leave out replies that did not come."
            )
        values.append(value)
    return values


def _down(north_east_up: np.ndarray) -> np.ndarray:
    return np.stack([north_east_up[:, 1], north_east_up[:, 0], -north_east_up[:, 2]], axis=-1)


def _check(table: np.ndarray, lines: np.ndarray, path: Path) -> None:
    """What must hold on every line, then of the whole: units."""
    positions, stds = table[:, [1, 2, 3, 8, 9, 10]], table[:, [4, 5, 6, 11, 12, 13]]
    for bad, words in (
        (table[:, 14] <= 0, "TWTT: expected more than 0 s"),
        (table[:, 7] < table[:, 0], "t_rx: expected no less than t_tx"),
        ((stds < 0).any(axis=1), "standard deviations: expected 0 m or more"),
        (
            (np.abs(positions) > _MOST_M).any(axis=1),
            f"positions: expected within {_MOST_M:g} m of the origin",
        ),
    ):
        if bad.any():
            more = f" ({bad.sum()} such lines)" if bad.sum() > 1 else ""
            raise SurveyFileError(f"{path}, line {lines[np.argmax(bad)]}: {words}.{more}")
    usual, between = np.median(table[:, 14]), np.median(table[:, 7] - table[:, 0])
    if between > 0 and usual > 1.01 * between:
        raise SurveyFileError(
            f"{path}: TWTT is {usual:g} on most lines, more than the {between:g} s from t_tx to t_rx: expected seconds."
        )
    if usual * _NOMINAL_M_S / 2 > _MOST_RANGE_M:
        raise SurveyFileError(
            f"{path}: TWTT is {usual:g} on most lines, a range of {usual * _NOMINAL_M_S / 2e3:g} km: expected seconds."
        )

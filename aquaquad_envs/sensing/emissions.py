"""When a source makes a sound that can be heard: always, in pings, or on and off at random.

The state of a source is three numbers inside a world: ``nominal`` (s), ``next_time`` (s) and ``on``
(0 or 1). Between two calls of :func:`advance_emission` nothing is drawn but what the clock passes, so
that the emissions of a world do not depend on the length of its time steps.

======== ==== =====================================================================================
kind     code emissions
======== ==== =====================================================================================
always   0    at the end of every step
periodic 1    pings at t_k = φ + k P + J P u_k, φ uniform in [0, P), u_k uniform in [-1/2, 1/2)
random   2    on and off for exponentially distributed times of means ``mean_on``, ``mean_off``, begun in
              equilibrium: on with probability mean_on / (mean_on + mean_off). Heard at the end of a
              step if on by then.
======== ==== =====================================================================================

The published work has a source that is always heard (Dillard 2014); the other kinds are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquaquad_envs.compilation import kernel
from aquaquad_envs.errors import check_choice, check_range
from aquaquad_envs.physics.randomness import uniform

ALWAYS = 0
PERIODIC = 1
RANDOM = 2
#: Code of each kind by the name that users write.
KINDS = {"always": ALWAYS, "periodic": PERIODIC, "random": RANDOM}


class EmissionTerms(NamedTuple):
    """What kernels need of an :class:`Emissions`: kind, period (s), jitter, mean times on and off (s)."""

    kind: int
    period: float
    jitter: float
    mean_on: float
    mean_off: float


@dataclass(frozen=True, kw_only=True)
class Emissions:
    """How a source emits (see the table of the module); raises ``InvalidParameterError`` outside the bounds."""

    kind: str = "always"
    period_s: float = 60.0  # P, periodic only
    jitter: float = 0.0  # J in [0, 1]: width of the jitter as a share of the period, periodic only
    mean_on_s: float = 600.0  # random only
    mean_off_s: float = 600.0  # random only; 0 is on for ever

    def __post_init__(self) -> None:
        check_choice("kind", self.kind, KINDS)
        check_range("period_s", self.period_s, 1e-3, 1e9)
        check_range("jitter", self.jitter, 0, 1)
        check_range("mean_on_s", self.mean_on_s, 1e-3, 1e9)
        check_range("mean_off_s", self.mean_off_s, 0, 1e9)

    def terms(self) -> EmissionTerms:
        """The numbers that the kernels read."""
        # Never off is the same as always, and a switching time of 0 would never pass.
        kind = "always" if self.kind == "random" and self.mean_off_s == 0 else self.kind
        return EmissionTerms(
            KINDS[kind],
            float(self.period_s),
            float(self.jitter),
            float(self.mean_on_s),
            float(self.mean_off_s),
        )


@kernel
def _holding_time(mean, stream):
    """Exponentially distributed time of the given mean."""
    return -mean * np.log(1.0 - uniform(stream))


@kernel
def _jittered(terms, nominal, stream):
    return nominal + terms.jitter * terms.period * (uniform(stream) - 0.5)


@kernel
def start_emission(terms, time, stream):
    """State ``(nominal, next_time, on)`` of a source at the mission's beginning, ``time`` s."""
    if terms.kind == PERIODIC:
        nominal = time + terms.period * uniform(stream)
        next_time = _jittered(terms, nominal, stream)
        # Jitter may put the first ping before the beginning: it was not heard.
        while next_time < time:
            nominal += terms.period
            next_time = _jittered(terms, nominal, stream)
        return nominal, next_time, 0
    if terms.kind == RANDOM:
        on = 1 if uniform(stream) * (terms.mean_on + terms.mean_off) < terms.mean_on else 0
        return time, time + _holding_time(terms.mean_on if on else terms.mean_off, stream), on
    return time, np.inf, 1


@kernel
def advance_emission(terms, end, nominal, next_time, on, stream):
    """Advance a source to time ``end``: ``(emitted, when, nominal, next_time, on)``.

    ``emitted`` tells whether it was heard since the last call, that is in (last end, end], and ``when``
    (s) the latest such moment; ``when`` is ``end`` where nothing was emitted. Several pings in
    one step count as the last of them.
    """
    emitted = on == 1
    when = end
    if terms.kind == PERIODIC:
        emitted = False
        while next_time <= end:
            emitted = True
            when = next_time
            nominal += terms.period
            next_time = _jittered(terms, nominal, stream)
    elif terms.kind == RANDOM:
        while next_time <= end:
            on = 1 - on
            next_time += _holding_time(terms.mean_on if on == 1 else terms.mean_off, stream)
        emitted = on == 1
    return emitted, when, nominal, next_time, on

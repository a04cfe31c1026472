"""Random numbers that live in a world: xoshiro256++ streams, one per world and source.

Blackman and Vigna, "Scrambled linear pseudorandom number generators", ACM TOMS 47(4), 2021.
A stream is four ``uint64`` words inside the world's record, so that a copy of the record
replays the same future, and a draw added to one source shifts no other.
"""

from __future__ import annotations

import numpy as np

from aquaquad_envs.compilation import kernel

#: Sources in the order of their words in a seed; append new ones at the end only.
SOURCES = ("initial", "field", "sensor", "target")
WORDS = 4


def seed_streams(seed: int | np.random.SeedSequence) -> np.ndarray:
    """Initial words of every source for one world: shape (len(SOURCES), 4), uint64."""
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    return sequence.generate_state(len(SOURCES) * WORDS, np.uint64).reshape(len(SOURCES), WORDS)


@kernel
def _rotate(word, bits):
    return (word << np.uint64(bits)) | (word >> np.uint64(64 - bits))


@kernel
def random_bits(state):
    """Next 64 random bits of stream ``state`` (4,) uint64, advanced in place."""
    result = _rotate(state[0] + state[3], 23) + state[0]
    shifted = state[1] << np.uint64(17)
    state[2] ^= state[0]
    state[3] ^= state[1]
    state[1] ^= state[2]
    state[0] ^= state[3]
    state[2] ^= shifted
    state[3] = _rotate(state[3], 45)
    return result


@kernel
def uniform(state):
    """Uniform float64 in [0, 1) with 53 bits."""
    return np.float64(random_bits(state) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def normal(state):
    """Standard normal draw (Box–Muller, one value per two uniforms: no hidden state)."""
    radius = np.sqrt(-2.0 * np.log(1.0 - uniform(state)))
    return radius * np.cos(2.0 * np.pi * uniform(state))


@kernel
def uniform_in_disc(state):
    """A point (x, y) uniform in the unit disc."""
    while True:
        x = 2.0 * uniform(state) - 1.0
        y = 2.0 * uniform(state) - 1.0
        if x * x + y * y <= 1.0:
            return x, y

"""The discrete variant of the hops of all worlds."""

from __future__ import annotations

import numpy as np


def discrete_hops() -> np.ndarray:
    """Hop vectors (33, 2): 0 drifts, then 16 headings (from east, anticlockwise) at half and at full length."""
    angle = np.arange(16) * np.pi / 8
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    return np.concatenate([np.zeros((1, 2)), 0.5 * ring, ring])

"""Runs of ranges, and the estimator's cost written once more with NumPy, for the tests of the MAP estimator."""

import numpy as np

TRANSPONDER = np.array([17.0, 15.0, 6.0])
SQUARE = np.array([[5.0, 5.0, 0.0], [-5.0, 5.0, 0.0], [-5.0, -5.0, 0.0], [5.0, -5.0, 0.0]])
FOUR = np.array([[17.0, 15.0, 6.0], [-2.0, -1.0, 7.0], [5.0, 5.0, 10.0], [-9.0, 13.0, 8.0]])


def random_tracks(rng, runs, count, *, start=(-3.0, 9.0), speed=3.0, turn=np.pi / 6):
    """Places (runs, count, 3) of the published vehicle that turns at random."""
    heading = -np.pi / 6 + np.concatenate(
        [np.zeros((runs, 1)), np.cumsum(rng.uniform(-turn, turn, (runs, count - 1)), axis=1)], axis=1
    )
    steps = speed * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=-1)
    steps[:, 0] = [*start, 0.0]
    return np.cumsum(steps, axis=1)


def ranges_of(positions, transponder, rng=None, std=0.0):
    exact = np.linalg.norm(positions - np.asarray(transponder)[..., None, :], axis=-1)
    return exact if rng is None else exact + std * rng.standard_normal(exact.shape)


def roots(point, positions, ranges, mean, covariance, std, huber=0.0):
    """Residuals whose half squared norm is the cost: prior, then ranges (Huber's loss by its root)."""
    prior = np.linalg.solve(np.linalg.cholesky(covariance), point - mean)
    heard = np.isfinite(ranges)
    u = ((ranges - np.linalg.norm(point - positions, axis=-1)) / std)[heard]
    if huber:
        far = np.abs(u) > huber
        u = np.where(far, np.sign(u) * np.sqrt(np.maximum(2 * huber * np.abs(u) - huber**2, 0)), u)
    return np.concatenate([prior, u])


def cost(*arguments, **options):
    return 0.5 * np.sum(roots(*arguments, **options) ** 2)

"""Summaries with intervals, and paired differences between policies that met the same seeds."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

#: Bootstrap resamples of an interval, and the seed that draws them.
RESAMPLES = 2000
SEED = 0
_LEVEL = 0.95

Interval = tuple[float, float]
_NONE: Interval = (float("nan"), float("nan"))


def iqm(values: np.ndarray, axis: int = -1) -> Any:
    """Interquartile mean: the mean of the middle half (Agarwal et al., NeurIPS 2021)."""
    from scipy.stats import trim_mean

    return trim_mean(values, 0.25, axis=axis)


def interval(values: np.ndarray, statistic: Callable[..., Any] = np.mean) -> Interval:
    """95 % bootstrap interval of ``statistic`` (called with ``axis``): bias-corrected and accelerated.

    The percentile interval stands in where BCa is undefined; a constant sample gives that constant twice,
    fewer than two values NaN.
    """
    from scipy.stats import bootstrap

    values = np.asarray(values, dtype=np.float64)
    if len(values) < 2:
        return _NONE
    if np.ptp(values) == 0:
        return float(values[0]), float(values[0])
    for method in ("BCa", "percentile"):
        with warnings.catch_warnings():
            # A degenerate sample warns and gives NaN: the next method is for that.
            warnings.simplefilter("ignore")
            found = bootstrap(
                (values,), statistic, n_resamples=RESAMPLES, confidence_level=_LEVEL, vectorized=True,
                method=method, random_state=np.random.default_rng(SEED),
            ).confidence_interval  # fmt: skip
        if np.isfinite([found.low, found.high]).all():
            break
    return float(found.low), float(found.high)


def proportion_interval(values: np.ndarray) -> Interval:
    """95 % Wilson interval of a share, from zeros and ones; not of zero width where all agree."""
    from scipy.stats import binomtest

    if not len(values):
        return _NONE
    found = binomtest(int(np.sum(values)), len(values)).proportion_ci(_LEVEL, method="wilson")
    return float(found.low), float(found.high)


def summary(values: np.ndarray, *, share: bool = False, robust: bool = False) -> dict[str, Any]:
    """Mean, standard deviation (n - 1), median, IQM, 95 % interval of the mean, and n of the finite ``values``.

    ``share``: zeros and ones, with Wilson's interval. ``robust``: the interval of the IQM too, ``iqm_ci95``.
    """
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    n = len(values)
    nan = float("nan")
    result: dict[str, Any] = {
        "mean": float(np.mean(values)) if n else nan,
        "std": float(np.std(values, ddof=1)) if n > 1 else nan,
        "median": float(np.median(values)) if n else nan,
        "iqm": float(iqm(values)) if n else nan,
        "ci95": list(proportion_interval(values) if share else interval(values)),
        "n": n,
    }
    if robust:
        result["iqm_ci95"] = list(interval(values, iqm))
    return result


def paired(a: np.ndarray, b: np.ndarray, *, less_is_better: bool) -> dict[str, Any]:
    """How ``a`` differs from ``b`` on the same seeds, where both are finite.

    ``difference``: mean of a - b, ``ci95`` its 95 % interval; ``probability_of_improvement``:
    the share of seeds on which a is better than b, ties counted half, with its own interval.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    both = np.isfinite(a) & np.isfinite(b)
    difference = a[both] - b[both]
    better = difference < 0 if less_is_better else difference > 0
    wins = better + 0.5 * (difference == 0)
    n = len(difference)
    return {
        "n": n,
        "difference": float(np.mean(difference)) if n else float("nan"),
        "ci95": list(interval(difference)),
        "probability_of_improvement": float(np.mean(wins)) if n else float("nan"),
        "probability_ci95": list(interval(wins)),
    }

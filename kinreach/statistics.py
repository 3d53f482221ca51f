"""Confidence intervals: Wilson's for rates, the percentile bootstrap for everything else. Pure functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError
from kinreach.inputs import check_count, shown

Floats = NDArray[np.float64]

#: A bound on both sides, (low, high).
Interval = tuple[float, float]

#: Reduces samples along an axis, as `numpy.median(values, axis=axis)` does.
Statistic = Callable[..., Any]

CONFIDENCE = 0.95
#: Sums of larger values could overflow.
LARGEST = 1e150
RESAMPLES = 2000

#: Resampled values held in memory at a time.
_BLOCK = 2_000_000


def median(values: Floats, *, axis: int = -1) -> Any:
    """The value in the middle."""
    return np.median(values, axis=axis)


def p95(values: Floats, *, axis: int = -1) -> Any:
    """The 95th percentile, interpolated linearly."""
    return np.percentile(values, 95, axis=axis)


def mean(values: Floats, *, axis: int = -1) -> Any:
    """The arithmetic mean."""
    return np.mean(values, axis=axis)


def wilson_interval(successes: int, total: int, *, confidence: float = CONFIDENCE) -> Interval:
    r"""Wilson's score interval of a rate.

    With $\hat p = k / n$ and $z$ the normal quantile,
    $\frac{\hat p + z^2 / 2n \pm z \sqrt{\hat p (1 - \hat p) / n + z^2 / 4n^2}}{1 + z^2 / n}$
    (Wilson 1927, J. Am. Stat. Assoc. 22). It stays inside [0, 1] and has a width also at 0 of n and n of n.

    Args:
        successes: How many, $k$.
        total: Out of how many, $n$.
        confidence: Share of experiments whose interval holds the true rate.

    Returns:
        Low and high bound of the rate.

    Raises:
        InputError: `total` is not positive, or `successes` is not in 0 … `total`.
    """
    total, successes = check_count("total", total, least=-(2**63)), check_count("successes", successes, least=-(2**63))
    if total < 1 or not 0 <= successes <= total:
        raise InputError(f"a rate needs 0 <= successes <= total and total >= 1, got {successes} of {total}")
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    rate = successes / total
    centre = rate + z * z / (2 * total)
    spread = z * math.sqrt(rate * (1 - rate) / total + z * z / (4 * total * total))
    scale = 1 + z * z / total
    low = 0.0 if successes == 0 else (centre - spread) / scale
    high = 1.0 if successes == total else (centre + spread) / scale
    return low, high


def bootstrap_intervals(
    values: ArrayLike,
    statistics: Sequence[Statistic],
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> list[Interval]:
    """Percentile bootstrap of several statistics on the same resamples (Efron 1979).

    Args:
        values: Measured values, shape (n,), n >= 1, finite.
        statistics: Functions that reduce an array along `axis`.
        resamples: How many samples of n, drawn with replacement.
        seed: Of the resampling, so that the same values give the same interval.
        confidence: Share of experiments whose interval holds the true value.

    Returns:
        Low and high bound of each statistic.

    Raises:
        InputError: `values` is empty, not one-dimensional or not finite.
    """
    try:
        sample = np.asarray(values)
    except Exception:  # whatever the conversion of somebody else's object raises
        sample = np.empty(0)
    if sample.ndim != 1 or sample.size == 0 or sample.dtype.kind not in "biuf" or not np.isfinite(sample).all():
        raise InputError(f"the bootstrap needs a list of finite values, got shape {sample.shape}: {shown(values)}")
    sample = sample.astype(np.float64)
    if np.abs(sample).max() > LARGEST:
        raise InputError(f"the bootstrap needs values within ±{LARGEST:g}, got {np.abs(sample).max():g}")
    rng = np.random.default_rng(seed)
    rows = max(1, _BLOCK // sample.size)
    estimates: list[list[Floats]] = [[] for _ in statistics]
    for start in range(0, resamples, rows):
        drawn = sample[rng.integers(sample.size, size=(min(rows, resamples - start), sample.size))]
        for collected, statistic in zip(estimates, statistics, strict=True):
            collected.append(statistic(drawn, axis=1))
    tail = (1 - confidence) / 2
    bounds = (np.quantile(np.concatenate(collected), (tail, 1 - tail)) for collected in estimates)
    return [(float(low), float(high)) for low, high in bounds]

"""Confidence intervals of independent values: Wilson's for rates, the percentile bootstrap for everything else."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import check_count, shown
from kinreach.errors import InputError

Floats = NDArray[np.float64]

#: A bound on both sides, (low, high).
Interval = tuple[float, float]

#: Reduces samples along an axis, as `numpy.median(values, axis=axis)` does.
Statistic = Callable[..., Any]

CONFIDENCE = 0.95
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
    """Wilson's score interval of a rate (Wilson 1927, J. Am. Stat. Assoc. 22).

    It stays inside [0, 1] and has a width also at 0 of n and n of n.

    Args:
        successes: How many.
        total: Out of how many.
        confidence: Share of experiments whose interval holds the true rate.

    Returns:
        Low and high bound of the rate.

    Raises:
        InputError: `total` is not positive, or `successes` is not in 0 … `total`.
    """
    total = check_count("total", total, most=2**53)
    successes = check_count("successes", successes, least=0, most=total)
    from scipy.stats import binomtest  # half a second to import

    interval = binomtest(successes, total).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


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
        values: Measured values, shape (n,), n >= 1, finite; of several rows, shape (m, n), columns are drawn and each
            statistic is the mean of the rows' statistics.
        statistics: Functions that reduce an array along `axis`.
        resamples: How many samples of n, drawn with replacement.
        seed: Of the resampling: the same values give the same interval.
        confidence: Share of experiments whose interval holds the true value.

    Returns:
        Low and high bound of each statistic.

    Raises:
        InputError: `values` is empty, not a list or a table of numbers, or not finite.
    """
    sample = _finite(values)
    count = sample.shape[1]
    if count == 1:
        return [(value, value) for value in (float(statistic(sample, axis=-1).mean()) for statistic in statistics)]
    from scipy.stats import bootstrap  # half a second to import

    def estimates(columns: NDArray[np.int64], axis: int) -> Floats:
        drawn = sample[:, columns.astype(np.int64)]
        return np.stack([np.mean(statistic(drawn, axis=axis), axis=0) for statistic in statistics])

    found = bootstrap(
        (np.arange(count),),
        estimates,
        n_resamples=resamples,
        batch=max(1, _BLOCK // sample.size),
        vectorized=True,
        method="percentile",
        confidence_level=confidence,
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return [(float(low), float(high)) for low, high in zip(found.low, found.high, strict=True)]


def _finite(values: ArrayLike) -> Floats:
    """Values as a table, shape (rows, n)."""
    try:
        sample = np.asarray(values)
    except Exception:  # whatever the conversion of somebody else's object raises
        sample = np.empty(0)
    if sample.ndim not in (1, 2) or not sample.size or sample.dtype.kind not in "biuf" or not np.isfinite(sample).all():
        raise InputError(f"the bootstrap needs finite values, got shape {sample.shape}: {shown(values)}")
    return np.atleast_2d(sample.astype(np.float64))

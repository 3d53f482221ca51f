"""Confidence intervals: Wilson's for rates, the percentile bootstrap for everything else. Pure functions.

Both take their values for independent. Goals are, trainings of the same recipe on the same goals are not:
`trainings_interval` is for those.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.checks import check_count, check_number, shown
from kinreach.errors import InputError

Floats = NDArray[np.float64]

#: A bound on both sides, (low, high).
Interval = tuple[float, float]

#: Reduces samples along an axis, as `numpy.median(values, axis=axis)` does.
Statistic = Callable[..., Any]

CONFIDENCE = 0.95
#: Sums of larger values could overflow.
LARGEST = 1e150
RESAMPLES = 2000
MOST_RESAMPLES = 10**7

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
        InputError: `total` is not positive, `successes` is not in 0 … `total`, or `confidence` not in 0 … 1.
    """
    total, successes = (
        check_count(name, value, least=-(2**63), most=2**63)
        for name, value in (("total", total), ("successes", successes))
    )
    if total < 1 or not 0 <= successes <= total:
        raise InputError(f"a rate needs 0 <= successes <= total and total >= 1, got {successes} of {total}")
    _check_confidence(confidence)
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
        InputError: `values` is empty, not one-dimensional or not finite; `resamples` or `seed` is not a count, or
            `confidence` not in 0 … 1.
    """
    _check_options(resamples, seed, confidence)
    sample = _finite("the bootstrap", values, dimensions=1)
    return _resampled(sample[None], statistics, resamples=resamples, seed=seed, confidence=confidence)


def trainings_interval(
    values: ArrayLike,
    statistic: Statistic = mean,
    *,
    least: float = -math.inf,
    most: float = math.inf,
    resamples: int = RESAMPLES,
    seed: int = 0,
    confidence: float = CONFIDENCE,
) -> Interval:
    r"""What a recipe achieves, from several trainings of it (seeds) that were evaluated on the same goals.

    The estimate is the mean over the trainings of each one's statistic, $m$. Its interval has two parts. Chance in
    training: Student's $m \pm t_{n - 1} s / \sqrt n$ over the n trainings, for the training is what was repeated
    independently, not the episode (Henderson et al. 2018, arXiv:1709.06560; Colas, Sigaud and Oudeyer 2018,
    arXiv:1806.08295; Agarwal et al. 2021, arXiv:2108.13264). Chance in the goals, which all trainings share: Wilson's
    interval of the mean share among the goals of one training where values are truth values, otherwise the percentile
    bootstrap that draws goals, with what all trainings did on each. Distances of the bounds from m add up by their
    squares, on each side by itself (Zou and Donner 2008, Stat. Med. 27), so neither part is wider than the result.

    One training gives the second part only, and says nothing about other trainings. Equal trainings have no spread:
    five of them that all succeed do not exclude that one in ten fails. Where one training in five fails altogether, a
    third of all groups of five have none that does, and the interval holds the true mean in 67 % of the groups, not in
    95 %: give the results of the single trainings beside it.

    Args:
        values: What each training did on each goal, shape (trainings, goals), finite; the mean
            of truth values is a share.
        statistic: Of the values of a training.
        least: No value can be less; the interval ends there. Of shares 0.
        most: No value can be more. Of shares 1.
        resamples: Of the bootstrap.
        seed: Of the bootstrap.
        confidence: Share of experiments whose interval holds the true value.

    Returns:
        Low and high bound of the mean over all possible trainings, on all possible goals.

    Raises:
        InputError: `values` are empty, not two-dimensional, not finite, or not between `least` and `most`; one of the
            options is not of its kind.
    """
    _check_options(resamples, seed, confidence)
    for name, bound in (("least", least), ("most", most)):
        if bound not in (-math.inf, math.inf):
            check_number(name, bound)
    if least > most:
        raise InputError(f"least must not be above most, got {least:g} and {most:g}")
    from scipy.special import stdtrit  # takes longer to import than the rest of this module

    sample = _finite("the interval of trainings", values, dimensions=2)
    shares = statistic is mean and np.asarray(values).dtype == np.bool_
    least, most = (max(least, 0.0), min(most, 1.0)) if shares else (least, most)
    if sample.min() < least or sample.max() > most:
        raise InputError(f"values must be from {least:g} to {most:g}, got {sample.min():g} to {sample.max():g}")
    each = np.asarray(statistic(sample, axis=1), dtype=np.float64)
    trainings, goals = sample.shape
    middle = float(each.mean())
    if shares:
        mean_successes = sample.sum() / trainings  # no integer, so the bounds are those of its neighbours
        low = wilson_interval(math.floor(mean_successes), goals, confidence=confidence)[0]
        high = wilson_interval(math.ceil(mean_successes), goals, confidence=confidence)[1]
    else:
        ((low, high),) = _resampled(sample, (statistic,), resamples=resamples, seed=seed, confidence=confidence)
    spread = 0.0
    if trainings > 1:
        spread = stdtrit(trainings - 1, 0.5 + confidence / 2) * float(each.std(ddof=1)) / math.sqrt(trainings)
    below, above = math.hypot(spread, max(0.0, middle - low)), math.hypot(spread, max(0.0, high - middle))
    return max(least, middle - below), min(most, middle + above)


def _check_options(resamples: object, seed: object, confidence: object) -> None:
    check_count("resamples", resamples, most=MOST_RESAMPLES)
    check_count("seed", seed, least=0)
    _check_confidence(confidence)


def _check_confidence(confidence: object) -> None:
    """Refuse what is not a share above 0 and below 1."""
    if check_number("confidence", confidence, above=0.0, most=1.0) == 1.0:
        raise InputError("confidence must be below 1: only an interval without bounds holds always")


def _finite(what: str, values: ArrayLike, *, dimensions: int) -> Floats:
    try:
        sample = np.asarray(values)
    except Exception:  # whatever the conversion of somebody else's object raises
        sample = np.empty(0)
    if (
        sample.ndim != dimensions
        or sample.size == 0
        or sample.dtype.kind not in "biuf"
        or not np.isfinite(sample).all()
    ):
        shape = "a list" if dimensions == 1 else "rows of equal length"
        raise InputError(f"{what} needs {shape} of finite values, got shape {sample.shape}: {shown(values)}")
    sample = sample.astype(np.float64)
    if np.abs(sample).max() > LARGEST:
        raise InputError(f"{what} needs values within ±{LARGEST:g}, got {np.abs(sample).max():g}")
    return sample


def _resampled(
    sample: Floats, statistics: Sequence[Statistic], *, resamples: int, seed: int, confidence: float
) -> list[Interval]:
    """Columns are drawn with replacement; each statistic is that of a row, averaged over the rows."""
    rng = np.random.default_rng(seed)
    columns = sample.shape[1]
    block = max(1, _BLOCK // sample.size)
    estimates: list[list[Floats]] = [[] for _ in statistics]
    for start in range(0, resamples, block):
        drawn = sample[:, rng.integers(columns, size=(min(block, resamples - start), columns))]
        for collected, statistic in zip(estimates, statistics, strict=True):
            collected.append(np.mean(statistic(drawn, axis=-1), axis=0))
    tail = (1 - confidence) / 2
    bounds = (np.quantile(np.concatenate(collected), (tail, 1 - tail)) for collected in estimates)
    return [(float(low), float(high)) for low, high in bounds]

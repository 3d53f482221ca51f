"""Statistics of trials: confidence intervals, columns of a report, and how their numbers are written.

Intervals are of independent values: Wilson's for rates, the percentile bootstrap for everything else. A *trial* is a
flat row of one policy in one episode: name -> number, truth value, text, or list of numbers. A `Column` reads a value
from each trial and summarises those of one method. Tables, JSON, CSV and HTML are generic over columns.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.table import Table
from rich.text import Text

from kinreach._checks import check_count, check_known, check_number, printable, shown
from kinreach.errors import InputError

Floats = NDArray[np.float64]

#: A bound on both sides, (low, high).
Interval = tuple[float, float]

#: Reduces samples along an axis, as `numpy.median(values, axis=axis)` does.
Statistic = Callable[..., Any]

CONFIDENCE = 0.95
RESAMPLES = 2000
#: Most resamples of a bootstrap.
MAX_RESAMPLES = 10**7

#: Resampled values held in memory at a time.
_BLOCK = 2_000_000


def median(values: Floats, *, axis: int = -1) -> Any:
    """Return the median along an axis."""
    return np.median(values, axis=axis)


def p95(values: Floats, *, axis: int = -1) -> Any:
    """Return the 95th percentile along an axis, interpolated linearly."""
    return np.percentile(values, 95, axis=axis)


def mean(values: Floats, *, axis: int = -1) -> Any:
    """Return the arithmetic mean along an axis."""
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
        InputError: `total` is not positive, `successes` is not in 0 … `total`, or `confidence` is not between 0 and 1.

    Examples:
        >>> from kinreach.compare import wilson_interval
        >>> [round(bound, 3) for bound in wilson_interval(48, 50)]
        [0.865, 0.989]
    """
    total = check_count("total", total, most=2**53)
    successes = check_count("successes", successes, least=0, most=total)
    confidence = _as_confidence(confidence)
    from scipy.stats import binomtest  # half a second to import

    interval = binomtest(successes, total).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def paired_p(better: int, worse: int) -> float:
    """Return the two-sided p value of pairs in which one of two is better, or worse; pairs without a difference aside.

    Of goals that only one of two methods reaches it is McNemar's exact test, of differences the sign test.
    """
    if not better + worse:
        return 1.0
    from scipy.stats import binomtest  # half a second to import

    return float(binomtest(better, better + worse, 0.5).pvalue)


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
        InputError: `values` is empty, not a list or a table of numbers, or not finite; `resamples` or `seed` is not a
            count, or `confidence` is not between 0 and 1.
    """
    resamples, seed = check_count("resamples", resamples, most=MAX_RESAMPLES), check_count("seed", seed, least=0)
    confidence = _as_confidence(confidence)
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


def _as_confidence(value: float) -> float:
    """Check for a share above 0 and below 1: only an interval without bounds always holds."""
    confidence = check_number("confidence", value, above=0.0, most=1.0)
    if confidence == 1.0:
        raise InputError("confidence must be below 1, got 1")
    return confidence


def _finite(values: ArrayLike) -> Floats:
    """Values as a table, shape (rows, n)."""
    try:
        sample = np.asarray(values)
    except Exception:  # of the object's own code
        sample = np.empty(0)
    if sample.ndim not in (1, 2) or not sample.size or sample.dtype.kind not in "biuf" or not np.isfinite(sample).all():
        raise InputError(f"the bootstrap needs finite values, got shape {sample.shape}: {shown(values)}")
    return np.atleast_2d(sample.astype(np.float64))


#: One policy in one episode: name -> number, truth value, text, list of numbers, or None where it was not measured.
Trial = dict[str, Any]
#: Status of a trial whose episode ended with the goal, and of one without it and without anything impossible.
COMPLETED, MISSED = "completed", "missed"

#: Tolerances at which the share of goals within them is reported [mm].
TOLERANCES_MM = (50, 20, 10, 5, 2, 1, 0.5)
#: Summaries of a column: the statistics that it reports, by name; a rate and a mean are one number each.
RATE, MEAN, QUANTILES, SPREAD = "rate", "mean", "quantiles", "spread"
_STATISTICS: Mapping[str, Mapping[str, Statistic]] = {
    MEAN: {"mean": mean},
    QUANTILES: {"median": median, "p95": p95},
    SPREAD: {"median": median, "p95": p95, "mean": mean},
}


@dataclass(frozen=True)
class Column:
    """One measure of a report.

    Attributes:
        key: Where its summary stands in the results; `"group.part"` stands in a group, as `"success_at_mm.1"` does.
            Its 95 % interval stands beside it, under the key or the group with `_ci`.
        value: From a trial to its value, None where it does not count; a name stands for the trial's entry of it.
        summary: `"rate"`: the share of true values with Wilson's interval; `"mean"`; `"quantiles"`: median and 95th
            percentile; `"spread"`: these and the mean; the latter three with bootstrapped intervals.
        heading: In tables, with its unit; a line break where it may be broken.
        show: What of it a table for people shows: `"interval"` and `"share"` of a rate in percent, `"mean"`,
            `"median"`, `"quantiles"` as median / p95; empty: it is in the HTML report and in the files only.
        table: Title of the table it stands in, if that is not the first one.
        digits: Significant digits of counts; None for the usual two or three of measured values.
    """

    key: str
    value: Callable[[Trial], float | bool | None] | str
    summary: str
    heading: str = ""
    show: str = ""
    table: str = ""
    digits: int | None = None

    def __post_init__(self) -> None:
        check_known("summary of a column", self.summary, (RATE, *_STATISTICS))

    def of(self, trial: Trial) -> float | bool | None:
        """Return the value of a trial."""
        return trial.get(self.value) if isinstance(self.value, str) else self.value(trial)

    def check(self, trial: Trial) -> None:
        """Check that a trial's value can be summarised.

        Raises:
            InputError: It is not a truth value under a rate, not a number elsewhere, or its function fails.
        """
        try:
            value = self.of(trial)
        except Exception as error:
            raise InputError(f"column {self.key!r} fails: {type(error).__name__}: {error}") from error
        numeric = isinstance(value, Real | np.bool_)
        if self.summary == RATE and not (value is None or (numeric and value in (0, 1))):
            raise InputError(f"column {self.key!r} is a rate: values must be True, False or None, got {shown(value)}")
        if not (value is None or numeric):
            raise InputError(f"column {self.key!r} must have numbers or None, got {shown(value)}")

    def summarise(self, trials: Sequence[Trial], *, resamples: int = RESAMPLES) -> tuple[Any, Any]:
        """Return the summary of a method's trials and its 95 % interval; None, or a dict of None, if nothing counts."""
        values = [value for value in map(self.of, trials) if value is not None]
        if self.summary == RATE:
            return (
                (sum(values) / len(values), list(wilson_interval(int(sum(values)), len(values))))
                if values
                else (None, None)
            )
        statistics = _STATISTICS[self.summary]
        estimates: dict[str, Any] = dict.fromkeys(statistics)
        intervals: dict[str, Any] = dict.fromkeys(statistics)
        if values:
            sample = np.array(values, dtype=np.float64)
            found = bootstrap_intervals(sample, tuple(statistics.values()), resamples=resamples)
            for (name, statistic), interval in zip(statistics.items(), found, strict=True):
                estimates[name], intervals[name] = float(statistic(sample)), list(interval)
        return (estimates["mean"], intervals["mean"]) if self.summary == MEAN else (estimates, intervals)

    def read(self, entry: Mapping[str, Any]) -> Any:
        """Return its summary from an entry of the results; None where the entry lacks it."""
        return _read(entry, self.key)

    def interval(self, entry: Mapping[str, Any]) -> Any:
        """Return the 95 % interval of its summary from an entry of the results."""
        return _read(entry, _ci(self.key))

    def measured(self, entry: Mapping[str, Any]) -> bool:
        """Return whether a trial of the entry had a value."""
        found = self.read(entry)
        return found is not None and (not isinstance(found, Mapping) or found["median"] is not None)

    def number(self, entry: Mapping[str, Any], part: str = "") -> float | None:
        """Return the number to sort by: the rate in percent, the mean, or a part of the quantiles, or the median."""
        found = self.read(entry)
        if found is None or self.summary == MEAN:
            return found
        return 100 * found if self.summary == RATE else found[part or "median"]

    def text(self, entry: Mapping[str, Any], show: str = "", *, count: int | None = None) -> str:
        """Return the cell of a table for an entry of the results, `-` if nothing was measured.

        Args:
            entry: Of a method.
            show: Instead of the column's own.
            count: Trials that have a value, as far as known: a rate of one is no share.
        """
        show = show or self.show
        if not self.measured(entry):
            return "-"
        if self.summary == RATE and (entry.get("goals") if count is None else count) == 1:
            return "yes" if self.read(entry) else "no"
        if show == "interval":
            low, high = self.interval(entry)
            return f"{self.number(entry):.1f} [{100 * low:.1f}, {100 * high:.1f}]"
        if show == "share":
            return f"{self.number(entry):.1f}"
        parts = ("median", "p95") if show == "quantiles" else (show,)
        return " / ".join(number(self.number(entry, part), self.digits) for part in parts)


def summarise(columns: Sequence[Column], trials: Sequence[Trial], *, resamples: int = RESAMPLES) -> dict[str, Any]:
    """Return one entry of the results: summaries of a method's trials, and their intervals, by the columns' keys."""
    entry: dict[str, Any] = {}
    for column in columns:
        for key, value in zip(
            (column.key, _ci(column.key)), column.summarise(trials, resamples=resamples), strict=True
        ):
            group, dot, part = key.partition(".")
            if dot:
                entry.setdefault(group, {})[part] = value
            else:
                entry[key] = value
    return entry


def thousandfold(name: str) -> Callable[[Trial], float | None]:
    """Return a trial's entry in millimetres or milliseconds, from metres or seconds."""

    def value(trial: Trial) -> float | None:
        found = trial.get(name)
        return None if found is None else 1e3 * found

    return value


def success_columns(completed: Callable[[Trial], bool]) -> tuple[Column, ...]:
    """Return columns for the shares of goals that completed trials ended within, one for each of `TOLERANCES_MM`.

    Trials without a distance are not counted.
    """

    def within(tolerance: float) -> Callable[[Trial], bool | None]:
        def found(trial: Trial) -> bool | None:
            if "distance" not in trial:
                return None
            distance = trial["distance"]  # None where it was no number
            return completed(trial) and distance is not None and 1e3 * distance <= tolerance

        return found

    return tuple(
        Column(f"success_at_mm.{mm:g}", within(mm), RATE, f"< {mm:g} mm\n%", "share" if mm == 1 else "")
        for mm in TOLERANCES_MM
    )


def tables(columns: Sequence[Column], entries: Sequence[Mapping[str, Any]], *, title: str, width: int) -> list[Table]:
    """Return tables for people, with a row for each method.

    Args:
        columns: Those that are shown; a column in which nothing was measured is left out.
        entries: One a method, with its `name`.
        title: Of the first table; the columns name the others.
        width: What a table should fit into [characters]; a wider one has its columns closer together.
    """
    found: dict[str, list[Column]] = {}
    for column in columns:
        if column.show and any(map(column.measured, entries)):
            found.setdefault(column.table, []).append(column)
    drawn = []
    for name, chosen in found.items():
        table = Table(
            title=name or title, title_style="bold", title_justify="left", box=None, pad_edge=False, header_style="bold"
        )
        table.add_column("method", no_wrap=True)
        for column in chosen:
            table.add_column(column.heading, justify="right", no_wrap=True)
        for entry in entries:
            table.add_row(Text(entry["name"]), *(Text(column.text(entry)) for column in chosen))
        if Console(width=2 * width).measure(table).maximum > width:
            table.padding = (0, 1, 0, 0)
        drawn.append(table)
    return drawn


def trials_csv(trials: Sequence[Trial]) -> str:
    """Return all trials as CSV with a header; a list is one column, its numbers separated by spaces."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = list(dict.fromkeys(name for trial in trials for name in trial))
    writer.writerow(names)
    for trial in trials:
        writer.writerow([_cell(trial.get(name)) for name in names])
    return printable(text.getvalue())


def number(value: float | None, digits: int | None = None) -> str:
    """Return a number in two or three significant digits, or in `digits`; `-` for None."""
    if value is None:
        return "-"
    if digits is not None:
        return f"{value:.{digits}g}"
    size = abs(value)
    if 0 < size < 1e-3:
        mantissa, exponent = f"{value:.0e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    if 0 < size < 0.1:
        return f"{value:#.2g}"
    return f"{value:.{0 if size >= 100 else 1 if size >= 10 else 2}f}"


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return " ".join(map(repr, value)) if isinstance(value, list) else value


def _ci(key: str) -> str:
    group, dot, part = key.partition(".")
    return f"{group}_ci{dot}{part}"


def _read(entry: Mapping[str, Any], key: str) -> Any:
    group, dot, part = key.partition(".")
    found = entry.get(group)
    return found.get(part) if dot and found is not None else found

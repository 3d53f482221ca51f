"""The results as tables: one row per trial for machines, one row per method for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from kinreach.compare.trials import Trial

#: Width that the table for people fits into [characters].
TABLE_WIDTH = 100


def trials_csv(trials: Sequence[Trial]) -> str:
    """All trials, of one class, as CSV with a header; a tuple is one column, its numbers separated by spaces."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(trials[0])]
    writer.writerow(names)
    for trial in trials:
        writer.writerow([_cell(getattr(trial, name)) for name in names])
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return " ".join(map(repr, value)) if isinstance(value, tuple) else value


def new_table(title: str, *headings: str) -> Table:
    """A table with a column of methods and others that are aligned to the right."""
    table = Table(title=title, title_style="bold", title_justify="left", box=None, pad_edge=False, header_style="bold")
    table.add_column("method", no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def narrowed(table: Table) -> Table:
    """The table, its columns one space apart instead of two if it is wider than `TABLE_WIDTH`."""
    if Console(width=2 * TABLE_WIDTH).measure(table).maximum > TABLE_WIDTH:
        table.padding = (0, 1, 0, 0)
    return table


def share(rate: float, interval: Sequence[float]) -> str:
    """A rate with its interval, in percent."""
    low, high = interval
    return f"{100 * rate:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def ending(results: Mapping[str, Any], out: Path, figures: Sequence[str]) -> list[str]:
    """The last lines under the tables: the command that gives the same again, and where everything was written."""
    return [
        f"Again: {results['settings']['command']}",
        f"In {out}: results.json, results.csv, report.html, {{{','.join(figures)}}}.png",
    ]


def number(value: float | None) -> str:
    """Two or three significant digits; `-` for None."""
    if value is None:
        return "-"
    size = abs(value)
    if 0 < size < 1e-3:
        mantissa, exponent = f"{value:.0e}".split("e")
        return f"{mantissa}e{int(exponent)}"
    if 0 < size < 0.1:
        return f"{value:#.2g}"
    return f"{value:.{0 if size >= 100 else 1 if size >= 10 else 2}f}"


def pair(summary: Mapping[str, float | None]) -> str:
    """Median and 95th percentile."""
    return f"{number(summary['median'])} / {number(summary['p95'])}"

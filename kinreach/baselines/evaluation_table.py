"""Summaries of evaluations as a table for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

#: Width that the table fits into [characters].
TABLE_WIDTH = 110


def evaluation_table(summaries: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """One row per policy; which columns depends on what the environment measures.

    Args:
        summaries: `Evaluation.summary()` by the name of the policy.
        title: Of the table.
    """
    table = Table(title=title, title_style="bold", title_justify="left", box=None, pad_edge=False, header_style="bold")
    first = next(iter(summaries.values()))
    reach = "success_at_mm" in first
    headings = ["reached % [95 % CI]", "impossible %", "distance mm\nmedian / p95"]
    headings += ["< 1 mm\n%", "< 2 mm\n%", "r_e\np95"] if reach else ["wrong\npresses", "energy\nmedian"]
    table.add_column("policy", no_wrap=True)
    for heading in [*headings, "steps\nmedian", "return\nmean"]:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, summary in summaries.items():
        low, high = summary["reached_ci"]
        distance = summary["distance_mm"]
        cells = [
            f"{100 * summary['reached']:.2f} [{100 * low:.2f}, {100 * high:.2f}]",
            f"{100 * summary['impossible']:.2f}",
            f"{distance['median']:.3g} / {distance['p95']:.3g}",
        ]
        if reach:
            success = summary["success_at_mm"]
            cells += [
                f"{100 * success['1']:.2f}",
                f"{100 * success['2']:.2f}",
                f"{summary['posture_error']['p95']:.3f}",
            ]
        else:
            cells += [f"{summary['wrong_presses']['mean']:.2f}", f"{summary['energy']['median']:.3g}"]
        cells += [f"{summary['steps']['median']:.0f}", f"{summary['return']['mean']:.2f}"]
        table.add_row(name, *cells)
    return table

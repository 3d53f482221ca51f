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
from rich.text import Text

from kinreach.compare.budget import Budget
from kinreach.compare.observation import CameraSettings
from kinreach.compare.trials import COMPLETED, Trial

#: Width that the table for people fits into [characters].
TABLE_WIDTH = 100


def trials_csv(trials: Sequence[Trial]) -> str:
    """All trials as CSV with a header; a posture is one column of numbers separated by spaces, None is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(Trial)]
    writer.writerow(names)
    for trial in trials:
        writer.writerow([_cell(getattr(trial, name)) for name in names])
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return " ".join(map(repr, value)) if isinstance(value, tuple) else value


def methods_table(results: Mapping[str, Any], *, title: str) -> Table:
    """One row per method, at most `TABLE_WIDTH` characters wide; a column more where the cameras looked."""
    looked = results["settings"].get("camera") is not None
    table = _table(
        title, "reached % [95 % CI]", *(["seen\nmm"] if looked else []), "distance mm\nmedian / p95", "< 1 mm\n%",
        "impos-\nsible %", "reward\nmean", "solve ms\nmedian / p95", "move s\nmedian",
    )  # fmt: skip
    for method in results["methods"]:
        low, high = method["reached_ci"]
        table.add_row(
            Text(method["name"]),
            Text(f"{100 * method['reached']:.1f} [{100 * low:.1f}, {100 * high:.1f}]"),
            *([number(method["observed_error_mm"]["median"])] if looked else []),
            _pair(method["distance_mm"]),
            f"{100 * method['success_at_mm']['1']:.1f}",
            f"{100 * method['impossible']:.1f}",
            number(method["reward_mean"]),
            _pair(method["solve_ms"]),
            number(method["move_s"]["median"]),
        )
    if Console(width=2 * TABLE_WIDTH).measure(table).maximum > TABLE_WIDTH:
        table.padding = (0, 1, 0, 0)  # one space between columns instead of two
    return table


def budget_table(results: Mapping[str, Any]) -> Table:
    """What each method's mean distance consists of, and what its decisions took; as wide as `methods_table` at most."""
    table = _table(
        "Where the distance comes from", "seeing\nmm", "+ deciding\nmm", "+ moving\nmm", "= distance\nmean mm",
        "iterations\nmedian / p95", "restarts\nmedian / p95",
    )  # fmt: skip
    for method in results["methods"]:
        parts = (number(method["budget_mm"][name]) for name in (*Budget._fields, "distance"))
        table.add_row(Text(method["name"]), *parts, _counts(method["iterations"]), _counts(method["restarts"]))
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_style="bold", title_justify="left", box=None, pad_edge=False, header_style="bold")
    table.add_column("method", no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def footnotes(results: Mapping[str, Any], out: Path) -> list[str]:
    """What the table's numbers mean, the command that gives them again, and where everything was written."""
    settings = results["settings"]
    reached = settings["terms"]["reached"]
    return [
        *_impossible(results["methods"]),
        f"{settings['goals']} goals, seed {settings['seed']}. Reached: {reached}; its 95 % interval is Wilson's.",
        *_seen(results),
        "Distance, move: simulated in MuJoCo. Solve: wall time on one thread, acceptance tests included.",
        "Iterations: a solver's steps, a policy's decisions. Seeing, deciding and moving sum to the distance:",
        "the component of each error along the line from the goal to the tip, mean over completed moves.",
        f"Again: {settings['command']}",
        f"In {out}: results.json, results.csv, {{errors,success,times,budget}}.png",
    ]


def _seen(results: Mapping[str, Any]) -> list[str]:
    """What the column of what the cameras saw means, if they looked."""
    camera, method = results["settings"].get("camera"), results["methods"][0]
    if camera is None:
        return []
    error, look = method["observed_error_mm"], method["look_ms"]
    return [
        f"Seen: the cameras' median error ({CameraSettings(**camera)}); p95 {number(error['p95'])} mm.",
        f"One look per goal, {number(look['median'])} ms beside solve, alike for all; judged against the true ball.",
    ]


def _impossible(methods: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line per method that says what made goals impossible, if any were."""
    causes = {
        m["name"]: [f"{n} {status}" for status, n in m["outcomes"].items() if status != COMPLETED] for m in methods
    }
    return [f"Impossible for {name}: {', '.join(found)}." for name, found in causes.items() if found]


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


def _pair(summary: Mapping[str, float | None]) -> str:
    return f"{number(summary['median'])} / {number(summary['p95'])}"


def _counts(summary: Mapping[str, float | None]) -> str:
    return " / ".join("-" if count is None else f"{count:.3g}" for count in (summary["median"], summary["p95"]))

"""The table of the report: a row for each method, and what its columns are sorted by."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from kinreach.compare.tables import number, share

#: One entry of `methods` in `results.json`.
Method = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes:
        heading: With its unit.
        value: What it is sorted by; None where nothing was measured.
        show: What is written.
        numeric: Whether values are numbers, otherwise they are words.
    """

    heading: str
    value: Callable[[Method], float | str | None]
    show: Callable[[Method], str]
    numeric: bool = True


def _rate(heading: str, key: str) -> Column:
    return Column(heading, lambda method: method[key], lambda method: share(method[key], method[f"{key}_ci"]))


def _part(heading: str, key: str, part: str) -> Column:
    """A column of one of the numbers that are kept together; results of other tasks, and older ones, lack it."""

    def value(method: Method) -> float | None:
        return (method.get(key) or {}).get(part)

    return Column(heading, value, lambda method: number(value(method)))


def _spread(name: str, key: str) -> tuple[Column, Column]:
    return _part(f"{name}\nmedian", key, "median"), _part(f"{name}\np95", key, "p95")


def _words(heading: str, key: str) -> Column:
    return Column(heading, lambda method: method.get(key), lambda method: str(method.get(key, "-")), numeric=False)


#: From left to right; one in which no method has a value is left out.
COLUMNS: Sequence[Column] = (
    _words("method", "name"),
    _words("kind", "kind"),
    _rate("reached, %\n[95 % CI]", "reached"),
    *_spread("seen, mm", "observed_error_mm"),
    *_spread("distance, mm", "distance_mm"),
    Column(
        "within\n1 mm, %",
        lambda method: None if "pressed" in method else method["success_at_mm"]["1"],
        lambda method: f"{100 * method['success_at_mm']['1']:.1f}",
    ),
    _rate("impossible, %\n[95 % CI]", "impossible"),
    Column("reward,\nmean", lambda method: method["reward_mean"], lambda method: number(method["reward_mean"])),
    *_spread("posture\nerror, rad", "posture_error"),
    *_spread("solve, ms", "solve_ms"),
    _part("move, s\nmedian", "move_s", "median"),
    *_spread("iterations", "iterations"),
    *_spread("steps", "steps"),
    _part("wrong\npresses, mean", "wrong_presses", "mean"),
    *_spread("energy, N²m²s", "energy"),
    *_spread("decision, ms", "decision_ms"),
    _part("seeing,\nmm", "budget_mm", "seeing"),
    _part("+ deciding,\nmm", "budget_mm", "deciding"),
    _part("+ moving,\nmm", "budget_mm", "moving"),
    _part("= distance,\nmean mm", "budget_mm", "distance"),
)


def headings_and_rows(methods: Sequence[Method]) -> tuple[str, str]:
    """The cells of the head and the rows of the body, as HTML.

    Args:
        methods: `methods` of `results.json`.
    """
    columns = [column for column in COLUMNS if any(column.value(method) is not None for method in methods)]
    return "".join(map(_heading, columns)), "\n".join(_row(method, columns) for method in methods)


def _heading(column: Column) -> str:
    kind = "number" if column.numeric else "text"
    return f'<th scope="col" data-kind="{kind}"><button type="button">{escape(column.heading)}</button></th>'


def _row(method: Method, columns: Sequence[Column]) -> str:
    cells = []
    for index, column in enumerate(columns):
        value = column.value(method)
        tag, scope = ("td", "") if index else ("th", ' scope="row"')
        by = "" if value is None else escape(str(value))
        cells.append(f'<{tag}{scope} data-value="{by}">{escape(column.show(method))}</{tag}>')
    return f"<tr>{''.join(cells)}</tr>"

"""Tables in Markdown, printed row by row while they are measured."""

from __future__ import annotations


def head(*names: str) -> str:
    """The two lines above the rows."""
    return f"{line(*names)}\n{'|---' * len(names)}|"


def line(*cells: object) -> str:
    """A line of cells."""
    return f"| {' | '.join(map(str, cells))} |"

"""Text and tables on a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich import console
from rich.segment import Segment

from kinreach._checks import printable


class Console(console.Console):
    """Rich's console without markup, emoji and highlights; it writes out escape codes, as in names of files.

    Args:
        **options: Of rich's console.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, highlight=False, **options)

    def note(self, text: str) -> None:
        """Print a line in faint letters, unbroken however long it is."""
        self.print(text, style="dim", soft_wrap=True)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """Render as rich does, in printable characters."""
        for text, style, control in super().render(*arguments, **options):
            yield Segment(text if control else printable(text), style, control)

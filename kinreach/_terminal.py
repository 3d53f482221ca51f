"""What is shown on a terminal: texts and tables, none of which a terminal obeys."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich import console
from rich.segment import Segment

from kinreach._checks import printable


class Console(console.Console):
    """Rich's console; escape codes in texts, such as names of files, are written out."""

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """As rich does it, with texts that can be printed."""
        for text, style, control in super().render(*arguments, **options):
            yield Segment(text if control else printable(text), style, control)

"""Tables in Markdown, printed row by row while they are measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median

from kinreach._statistics import wilson_interval


def head(*names: str) -> str:
    """The two lines above the rows."""
    return f"{line(*names)}\n{'|---' * len(names)}|"


def line(*cells: object) -> str:
    """A line of cells."""
    return f"| {' | '.join(map(str, cells))} |"


def share(successes: int, total: int) -> str:
    """In percent, with Wilson's 95 % interval."""
    low, high = wilson_interval(successes, total)
    return f"{100 * successes / total:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def spread(values: Sequence[float], digits: int) -> str:
    """The median and the range, or the one value that they all are; what never was (NaN) is `-`, and the last."""
    ordered = sorted(math.inf if math.isnan(value) else value for value in values)
    middle, low, high = (
        "-" if value == math.inf else f"{value:.{digits}f}" for value in (median(ordered), ordered[0], ordered[-1])
    )
    return middle if low == high else f"{middle} [{low}, {high}]"

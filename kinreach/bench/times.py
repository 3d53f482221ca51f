"""Rows of tables of times, and what the figure and the JSON file keep of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kinreach.bench.measure import Contender, EachContender, Timings, ratios
from kinreach.bench.suite import Cell


def time_cells(timings: Timings, name: str, reference: str) -> list[Cell]:
    """Median and p95 [us] of one contender, and its time as a multiple of another's.

    Returns:
        The two times; the median over the rounds of the ratio to `reference`, and its lowest and highest round; None
        where the reference is missing.
    """
    us = 1e6 * timings[name]
    cells: list[Cell] = [float(np.median(us)), float(np.percentile(us, 95))]
    if reference not in timings:
        return [*cells, None, None]
    each = ratios(timings, name, reference)
    return [*cells, float(np.median(each)), f"{each.min():.3g} ... {each.max():.3g}"]


def batch_rows(contenders: Sequence[Contender], timings: Timings, reference: str) -> list[list[Cell]]:
    """A row for each contender that was timed: name, `time_cells`, and the cores that it had."""
    return [
        [c.name, *time_cells(timings, c.name, reference), round(timings.cores[c.name], 2)]
        for c in contenders
        if c.name in timings
    ]


def median_ratio(timings: Timings, of: str, to: str) -> float:
    """Median over the rounds of the time of one contender as a multiple of another's."""
    return float(np.median(ratios(timings, of, to)))


def medians(timings: Timings) -> dict[str, float]:
    """Median time [us] by name, for the figure."""
    return {name: float(1e6 * np.median(seconds)) for name, seconds in timings.items()}


def samples(timings: Timings, prefix: str = "") -> dict[str, list[float]]:
    """What was measured in every round [s per unit]; where it was call by call, the median of the round."""
    per_round: Mapping[str, np.ndarray] = {
        name: seconds if seconds.ndim == 1 else np.median(seconds, axis=1) for name, seconds in timings.items()
    }
    return {prefix + name: [float(value) for value in seconds] for name, seconds in per_round.items()}


def calls(contenders: Sequence[Contender | EachContender]) -> str:
    """A sentence that says how each contender is called."""
    return "How each is called: " + "; ".join(f"{c.name}: `{c.note}`" for c in contenders if c.note) + "."

"""Rows of tables of steps per second, and of times with the cores that there were for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.speed.measure import Timings
from benchmarks.speed.suite import Cell
from benchmarks.speed.times import median_ratio, slow


def rate_row(name: str, timings: Timings, references: Sequence[str] = (), *, note: str = "") -> list[Cell]:
    """One contender: its rate, how it compares, and how many cores it had.

    Args:
        name: Of the contender.
        timings: Of all.
        references: Contenders whose time is divided by its time, round by round; one that is missing leaves its cell
            empty.
        note: How many cores, in words, where it was not measured: other processes are not.

    Returns:
        Name, median rate [units/s], the rate of the worst round, the median ratio to each reference, cores.
    """
    seconds = timings[name]
    faster: list[Cell] = [
        median_ratio(timings, reference, name) if reference in timings else None for reference in references
    ]
    cores: Cell = note or round(timings.cores[name], 2)
    return [name, float(1 / np.median(seconds)), float(1 / seconds.max()), *faster, cores]


def median_rates(timings: Timings) -> dict[str, float]:
    """Median rate [units/s] by name, for the figure."""
    return {name: float(1 / np.median(seconds)) for name, seconds in timings.items()}


def time_row(name: str, timings: Timings, unit: float) -> list[Cell]:
    """One contender: name, median and slow end of its time in units of `unit` seconds, and how many cores it had."""
    times = timings[name] / unit
    return [name, float(np.median(times)), slow(times), round(timings.cores[name], 2)]


def short_of_cores(timings: Timings, name: str, wanted: int) -> str:
    """Why a number of a busy machine is not that of a quiet one; empty if there were cores enough."""
    had = timings.cores[name]
    if had > 0.9 * wanted:
        return ""
    return f"the machine was busy: of {wanted} core{'s' * (wanted > 1)} the measurement had {had:.2f}"

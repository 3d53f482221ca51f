"""Rows of tables of times and of rates, and what the figure and the JSON file keep of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.speed.measure import Contender, EachContender, Timings, ratios
from benchmarks.speed.sections import Cell, Target


def slow(times: np.ndarray) -> float:
    """The slow end of what was timed: p95 of calls, (rounds, calls); the worst of rounds, (rounds,), which are few."""
    return float(times.max() if times.ndim == 1 else np.percentile(times, 95))


def time_cells(timings: Timings, name: str, *references: str) -> list[Cell]:
    """Median and slow end [us] of one contender, and its time as a multiple of others'.

    Returns:
        The two times, the second as of `slow`; for each reference the median over the rounds of the ratio to it, and
        its lowest and highest round; None where the reference is missing.
    """
    us = 1e6 * timings[name]
    cells: list[Cell] = [float(np.median(us)), slow(us)]
    for reference in references:
        if reference in timings:
            each = ratios(timings, name, reference)
            cells += [float(np.median(each)), f"{each.min():.3g} ... {each.max():.3g}"]
        else:
            cells += [None, None]
    return cells


def batch_rows(contenders: Sequence[Contender], timings: Timings, *references: str) -> list[list[Cell]]:
    """A row for each contender that was timed: name, `time_cells`, and the cores that it had."""
    return [
        [c.name, *time_cells(timings, c.name, *references), round(timings.cores[c.name], 2)]
        for c in contenders
        if c.name in timings
    ]


def median_ratio(timings: Timings, of: str, to: str) -> float:
    """Median over the rounds of the time of one contender as a multiple of another's."""
    return float(np.median(ratios(timings, of, to)))


def times_as_fast(
    timings: Timings, ours: str, ways: Sequence[str], *, what: str, bound: float, why: str = ""
) -> list[Target]:
    """The target that ours is so many times as fast as a peer, held against the quickest way in which it was timed.

    Args:
        timings: Of all.
        ours: Name of the contender that is judged.
        ways: Names of the contenders that are the peer's.
        what: As of `Target`, as all that follow.
        bound: How many times.
        why: Where it falls short.

    Returns:
        The target with the smallest of the medians over the rounds; none if the peer was not timed.
    """
    found = [(median_ratio(timings, way, ours), way) for way in ways if way in timings]
    return [Target(what, bound, "at least", measured, f"x {way}", why) for measured, way in sorted(found)[:1]]


def medians(timings: Timings) -> dict[str, float]:
    """Median time [us] by name, for the figure."""
    return {name: float(1e6 * np.median(seconds)) for name, seconds in timings.items()}


def samples(timings: Timings) -> dict[str, list[float]]:
    """What was measured in every round [s per unit]; where it was call by call, the median of the round."""
    per_round: Mapping[str, np.ndarray] = {
        name: seconds if seconds.ndim == 1 else np.median(seconds, axis=1) for name, seconds in timings.items()
    }
    return {name: [float(value) for value in seconds] for name, seconds in per_round.items()}


def calls(contenders: Sequence[Contender | EachContender]) -> str:
    """A sentence that says how each contender is called."""
    return "How each is called: " + "; ".join(f"{c.name}: `{c.note}`" for c in contenders if c.note) + "."


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

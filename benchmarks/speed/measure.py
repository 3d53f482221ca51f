"""Timing side by side: contenders take turns in every round, and ratios are taken pair by pair within a round.

A busy machine slows a whole round down, so a ratio within one round is steadier than the times themselves. The order
rotates from round to round: nobody always runs on the caches that the same other one left behind.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinreach.errors import InputError

#: What a turn of short calls should last at least [s].
LAP = 0.25
#: (finished rounds, all rounds)
OnRound = Callable[[int, int], None]


@dataclass(frozen=True)
class Contender:
    """One row of a benchmark.

    Attributes:
        name: Name in the table.
        run: What is timed; its result is dropped.
        units: Poses, steps, ... that one call does.
        note: How it is called, in a few words.
        peer: Somebody else's code: if it raises, that is reported and the others go on. What our own raises is raised.
    """

    name: str
    run: Callable[[], object]
    units: int
    note: str = ""
    peer: bool = False


@dataclass(frozen=True)
class EachContender:
    """A contender that is timed call by call, so that the spread over its inputs shows.

    Attributes:
        name: Name in the table.
        solve: What is timed, called with one input; its result is dropped.
        inputs: What it is called with, in this order.
        note: How it is called, in a few words.
        peer: As of `Contender`.
    """

    name: str
    solve: Callable[[Any], object]
    inputs: Sequence[Any]
    note: str = ""
    peer: bool = False


class Timings(dict[str, np.ndarray]):
    """Seconds by contender, those left out that failed.

    Attributes:
        failed: Name of each contender that raised -> what it said.
        cores: Name -> processor time over wall time: 1 is one core, less is waiting, more is threads.
    """

    def __init__(self) -> None:
        super().__init__()
        self.failed: dict[str, str] = {}
        self.cores: dict[str, float] = {}


@dataclass
class _Record:
    laps: list[Any] = field(default_factory=list)
    processor: float = 0.0
    wall: float = 0.0


def interleaved(
    contenders: Sequence[Contender],
    rounds: int,
    *,
    lap: float = 0.0,
    on_round: OnRound | None = None,
) -> Timings:
    """Time contenders in turns, after a round that does not count.

    Args:
        contenders: Who takes part; names are unique.
        rounds: How often each is timed.
        lap: Calls are repeated within a turn until it has lasted so long [s]; their mean counts. One goes before them
            that does not: it finds the caches full of what others left, and its memory given back.
        on_round: Called after every round.

    Returns:
        Seconds per unit, shape (rounds,), by name.

    Raises:
        InputError: No rounds, or a name that occurs twice.
    """

    def play(contender: Contender) -> float:
        if lap:
            contender.run()
        calls, start = 0, time.perf_counter()
        while True:
            contender.run()
            calls += 1
            seconds = time.perf_counter() - start
            if seconds >= lap:
                return seconds / (calls * contender.units)

    return _take_turns(contenders, play, rounds, on_round)


def interleaved_each(contenders: Sequence[EachContender], rounds: int, *, on_round: OnRound | None = None) -> Timings:
    """Time contenders in turns, call by call, after a round that does not count.

    Returns:
        Seconds per call, shape (rounds, inputs), by name.

    Raises:
        InputError: No rounds, or a name that occurs twice.
    """

    def play(contender: EachContender) -> list[float]:
        solve, clock, laps = contender.solve, time.perf_counter, []
        for given in contender.inputs:
            start = clock()
            solve(given)
            laps.append(clock() - start)
        return laps

    return _take_turns(contenders, play, rounds, on_round)


def _take_turns(
    contenders: Sequence[Contender | EachContender],
    play: Callable[[Any], Any],
    rounds: int,
    on_round: OnRound | None,
) -> Timings:
    if rounds < 1:
        raise InputError(f"rounds must be at least 1, got {rounds}")
    records = {contender.name: _Record() for contender in contenders}
    if len(records) < len(contenders):
        raise InputError(f"names of contenders must differ, got {', '.join(c.name for c in contenders)}")
    timings = Timings()
    collecting = gc.isenabled()
    try:
        for number in range(-1, rounds):
            gc.collect()
            gc.disable()
            turn = number % max(len(contenders), 1)
            for contender in (*contenders[turn:], *contenders[:turn]):
                if contender.name not in timings.failed:
                    _one_turn(contender, play, records[contender.name], timings, counts=number >= 0)
            if collecting:
                gc.enable()
            if on_round is not None and number >= 0:
                on_round(number + 1, rounds)
    finally:
        if collecting:
            gc.enable()
    for name, record in records.items():
        if name not in timings.failed:
            timings[name] = np.array(record.laps)
            timings.cores[name] = record.processor / record.wall
    return timings


def _one_turn(
    contender: Contender | EachContender, play: Callable[[Any], Any], record: _Record, timings: Timings, *, counts: bool
) -> None:
    processor, wall = time.process_time(), time.perf_counter()
    try:
        laps = play(contender)
    except Exception as error:
        if not contender.peer:
            raise
        timings.failed[contender.name] = f"failed with {type(error).__name__}: {error}"
        return
    if counts:
        record.laps.append(laps)
        record.wall += time.perf_counter() - wall
        record.processor += time.process_time() - processor


def clock_seconds() -> float:
    """What reading the clock adds to a call that is timed on its own, at most [s]."""
    clock = time.perf_counter
    readings = [clock() for _ in range(10_001)]
    return float(np.median(np.diff(readings)))


def ratios(times: dict[str, np.ndarray], of: str, to: str) -> np.ndarray:
    """Time of one contender as a multiple of another's, round by round: below 1 means that `of` is faster.

    Where times were taken call by call, (rounds, inputs), the medians over a round's calls are compared.

    Returns:
        Shape (rounds,).
    """
    mine, theirs = (t if t.ndim == 1 else np.median(t, axis=1) for t in (times[of], times[to]))
    return mine / theirs

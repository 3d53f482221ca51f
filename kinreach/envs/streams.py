"""Random starts of one episode after another, drawn ahead so that thousands of environments cost little."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from kinreach.kinematics.goals import Floats

#: Rows drawn at a time. Part of what a seed means: changing it may change the goals that follow from a seed.
AHEAD = 256
#: Environments for which they are drawn before they are put in place: as many as stay in the cache. An array of that
#: size has a use when it is freed, too: from then on glibc keeps the memory that every step takes and gives back.
TOGETHER = 256


class Sampler(Protocol):
    """What rows of numbers are drawn from; a `GoalRegion` is one, with rows of three."""

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw `count` rows, shape (count, size)."""
        ...


class RowStreams:
    """An endless sequence of rows for each of a number of environments: goals, or whatever an episode starts with.

    A sequence depends on its own generator alone, not on how many environments there are.

    Args:
        sampler: Draws the rows.
        count: Number of environments.
        size: Numbers in a row.
    """

    def __init__(self, sampler: Sampler, count: int, *, size: int = 3) -> None:
        self._sampler = sampler
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._ahead = np.empty((AHEAD, count, size))  # environments in step read what lies side by side
        self._next = np.full(count, AHEAD)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Start an environment's sequence afresh with a generator that it then owns."""
        self._rngs[index] = rng
        self._next[index] = AHEAD

    def draw(self, ids: np.ndarray) -> Floats:
        """The next row of each of the given environments, shape (len(ids), size)."""
        return self._taken(ids).copy()

    def _taken(self, ids: np.ndarray) -> Floats:
        """As `draw`; holds until the next call."""
        turns = self._next[ids]
        empty = ids[turns == AHEAD]
        for start in range(0, len(empty), TOGETHER):
            some = empty[start : start + TOGETHER]
            run = some[-1] - some[0] == len(some) - 1
            self._ahead[:, slice(some[0], some[-1] + 1) if run else some] = self._drawn(some).swapaxes(0, 1)
        turns[turns == AHEAD] = 0
        self._next[ids] = turns + 1
        in_step = len(ids) == len(self._next) and (turns == turns[0]).all()
        rows: Floats = self._ahead[turns[0]] if in_step else self._ahead[turns, ids]
        return rows

    def _drawn(self, ids: np.ndarray) -> Floats:
        """The next AHEAD rows of some environments, shape (len(ids), AHEAD, size)."""
        return np.array([self._sampler.sample(self._rngs[index], AHEAD) for index in ids])

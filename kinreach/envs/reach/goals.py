"""Goals of one episode after another, drawn ahead so that thousands of environments cost little more than one."""

from __future__ import annotations

import numpy as np

from kinreach.kinematics.goals import Floats
from kinreach.robots.workcell import GoalRegion

#: Goals drawn at a time. Part of what a seed means: changing it may change the goals that follow from a seed.
AHEAD = 256


class GoalStreams:
    """An endless sequence of goals for each of a number of environments.

    A sequence depends on its own generator alone, not on how many environments there are.

    Args:
        region: Where goals are.
        count: Number of environments.
    """

    def __init__(self, region: GoalRegion, count: int) -> None:
        self._region = region
        self._rngs = [np.random.default_rng() for _ in range(count)]
        self._ahead = np.empty((AHEAD, count, 3))  # environments in step read what lies side by side
        self._next = np.full(count, AHEAD)

    def seed(self, index: int, rng: np.random.Generator) -> None:
        """Start an environment's sequence afresh with a generator that it then owns."""
        self._rngs[index] = rng
        self._next[index] = AHEAD

    def draw(self, ids: np.ndarray) -> Floats:
        """The next goal of each of the given environments, in the world frame [m], shape (len(ids), 3)."""
        for index in ids[self._next[ids] == AHEAD]:
            self._ahead[:, index] = self._region.sample(self._rngs[index], AHEAD)
            self._next[index] = 0
        goals: Floats = self._ahead[self._next[ids], ids]
        self._next[ids] += 1
        return goals

"""Goals of one episode after another, drawn ahead so that thousands of environments cost little more than one."""

from __future__ import annotations

import numpy as np

from kinreach.envs.streams import AHEAD, RowStreams
from kinreach.errors import InputError
from kinreach.kinematics.goals import Floats
from kinreach.robots.workcell import BoxRegion, GoalRegion


class GoalStreams(RowStreams):
    """What `BoxRegion.sample` draws for each of a number of environments, to the bit, in a third of the time.

    Args:
        region: Where goals are.
        count: Number of environments.

    Raises:
        InputError: The region is not a box.
    """

    def __init__(self, region: GoalRegion, count: int) -> None:
        if not isinstance(region, BoxRegion):
            raise InputError(f"goals of the reach tasks are drawn in a box, not in {region}")
        super().__init__(region, count)
        self._low, high = np.array([region.x, region.y, region.z]).T
        self._size = high - self._low

    def draw(self, ids: np.ndarray) -> Floats:
        """The next goal of each of the given environments, in the world frame [m], shape (len(ids), 3)."""
        goals = self._size * self._taken(ids)
        goals += self._low
        return goals

    def _drawn(self, ids: np.ndarray) -> Floats:
        """Places in a box from 0 to 1; they are brought into the region when their turn comes."""
        places = np.empty((len(ids), AHEAD, 3))
        for index, place in zip(ids, places, strict=True):
            self._rngs[index].random(out=place)
        return places

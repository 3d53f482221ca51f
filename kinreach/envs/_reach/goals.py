"""Where the balls of many episodes are: each environment draws from a sequence of its own."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats
from kinreach.envs._batch import ROWS_AHEAD, RowStreams
from kinreach.robots import BoxRegion, Workcell


class GoalStreams(RowStreams):
    """What `BoxRegion.sample` draws for each of a number of environments, to the bit, in a third of the time."""

    def __init__(self, region: BoxRegion, count: int) -> None:
        super().__init__(region.sample, count)
        self._low, high = np.array([region.x, region.y, region.z]).T
        self._size = high - self._low

    def draw(self, ids: np.ndarray) -> Floats:
        goals = self._size * self._taken(ids)
        goals += self._low
        return goals

    def _drawn(self, ids: np.ndarray) -> Floats:
        """Places in a box from 0 to 1; they are brought into the region when their turn comes."""
        places = np.empty((len(ids), ROWS_AHEAD, 3))
        for index, place in zip(ids, places, strict=True):
            self._rngs[index].random(out=place)
        return places


def goal_streams(cell: Workcell, count: int) -> RowStreams:
    return GoalStreams(cell.goals, count) if isinstance(cell.goals, BoxRegion) else RowStreams(cell.draw_goals, count)

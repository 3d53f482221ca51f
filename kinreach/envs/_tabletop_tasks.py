"""Tasks with an object on the table: `kinreach/Push-v0` and `kinreach/PickAndPlace-v0`."""

from __future__ import annotations

import numpy as np

from kinreach._checks import Floats, check_number
from kinreach.envs._batch import Flags
from kinreach.envs._tabletop import TabletopState, TabletopTask
from kinreach.robots import THESIS_ARM, ArmDescription, BoxRegion
from kinreach.sim.inside import CUBE

#: The object is at its goal when it is nearer than this [m].
WITHIN = 0.02
#: Least and greatest way from the object to the goal of a push [m].
PUSHES = (0.06, 0.20)
#: So far from the edge of the region are object and goal of a push [m]: the fingers have to get behind the object.
EDGE = 0.05
#: Greatest height of a goal above an object that stands on the table [m], and the share of goals on the table.
HIGHEST, ON_TABLE = 0.20, 0.5


class _Moved(TabletopTask):
    """An object is brought to a place; a row of draws is a place, a yaw and a goal.

    Args:
        arm: Name of a UR or `so101`, or an `ArmDescription`; a UR without a gripper gets it.
        shape: Of the object: `"cube"`, `"cylinder"` or `"ball"`.
        size: Its radius, or half the edge of a cube [m].
        mass: [kg].
        friction: Coefficient with everything that it touches.
        within: How near it has to be to the goal [m].
    """

    def __init__(
        self,
        arm: str | ArmDescription = THESIS_ARM,
        *,
        shape: str = CUBE,
        size: float = 0.025,
        mass: float = 0.05,
        friction: float = 1.0,
        within: float = WITHIN,
    ) -> None:
        self.arm, self.shape, self.size, self.mass, self.friction = arm, shape, size, mass, friction
        self.within = check_number("within [m]", within, least=1e-3, most=0.05)

    def achieved(self, state: TabletopState) -> Floats:
        """Return where the object is."""
        return state.position

    def success(self, achieved: Floats, goals: Floats) -> Flags:
        """Return whether it is at the goal."""
        near: Flags = np.linalg.norm(achieved - goals, axis=1) < self.within
        return near


class Push(_Moved):
    """Push an object over the table to a place, with closed fingers."""

    fingers, opening = False, 0.0

    def sample(self, rng: np.random.Generator, count: int, region: BoxRegion) -> tuple[Floats, Floats, Floats]:
        """Draw places and goals on the table, 6 to 20 cm apart."""
        inner = region.wider(-EDGE)
        places, goals = inner.sample(rng, count)[:, :2], np.empty((count, 2))
        missing = np.arange(count)
        while len(missing):
            goals[missing] = inner.sample(rng, len(missing))[:, :2]
            ways = np.linalg.norm(goals[missing] - places[missing], axis=1)
            missing = missing[(ways < PUSHES[0]) | (ways > PUSHES[1])]
        yaws = rng.uniform(-np.pi, np.pi, count)
        return places, yaws, np.column_stack([goals, np.full(count, region.z[0] + self.size)])


class PickAndPlace(_Moved):
    """Grasp an object and bring it to a place, on the table or in the air."""

    def sample(self, rng: np.random.Generator, count: int, region: BoxRegion) -> tuple[Floats, Floats, Floats]:
        """Draw places on the table, and goals of which half are on it, the others up to 20 cm higher."""
        places, goals = region.sample(rng, count)[:, :2], np.empty((count, 2))
        missing = np.arange(count)
        while len(missing):
            goals[missing] = region.sample(rng, len(missing))[:, :2]
            missing = missing[np.linalg.norm(goals[missing] - places[missing], axis=1) < PUSHES[0]]
        yaws = rng.uniform(-np.pi, np.pi, count)
        heights = rng.uniform(0.0, HIGHEST, count) * (rng.random(count) >= ON_TABLE)
        return places, yaws, np.column_stack([goals, region.z[0] + self.size + heights])

"""What is seen of a goal: true geometry, what the cameras find, or the pictures themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.envs.reach.worlds import Ids
from kinreach.robots import ArmDescription
from kinreach.sim.simulation import ArmSimulation
from kinreach.vision.goal_view import CameraGoalView, geometric_goal_view

Flags = NDArray[np.bool_]


class GoalObserver(Protocol):
    """Looks for balls, the arm being in its start pose."""

    def look(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> tuple[Floats, Flags]:
        """Measure goals.

        Args:
            goals: Where the balls are in the world [m], shape (k, 3).
            ids: Whose goals they are, shape (k,).
            rngs: Everybody's generators for the sensors' noise.

        Returns:
            Position of each ball in the front and in the wrist camera [m], shape (k, 6), and which of the
            two cameras found it, shape (k, 2).
        """
        ...

    def close(self) -> None:
        """Let go of what the observer holds."""
        ...


class GeometricObserver:
    """What perfect cameras would say; nothing is rendered."""

    def __init__(self, arm: ArmDescription) -> None:
        self._arm = arm

    def look(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> tuple[Floats, Flags]:
        """The true positions; both cameras always find the ball."""
        return geometric_goal_view(self._arm, goals), np.ones((len(goals), 2), dtype=np.bool_)

    def close(self) -> None:
        """Nothing to let go of."""


class CameraObserver:
    """What is found in the rendered images of both cameras.

    Args:
        arm: The arm whose cameras look.
        view: Renders and finds.
    """

    def __init__(self, arm: ArmDescription, view: CameraGoalView) -> None:
        self._simulation = ArmSimulation(arm)
        self._view = view

    def look(self, goals: Floats, ids: Ids, rngs: Sequence[np.random.Generator]) -> tuple[Floats, Flags]:
        """Render both cameras for every goal; a ball that is not found has the documented value of `CameraGoalView`."""
        views, found = np.empty((len(goals), 6)), np.empty((len(goals), 2), dtype=np.bool_)
        for row, (goal, index) in enumerate(zip(goals, ids, strict=True)):
            self._simulation.place_ball(goal)
            seen = self._view.look(self._simulation, rngs[index])
            views[row], found[row] = seen.values, seen.found
        return views, found

    def close(self) -> None:
        """Free the renderer."""
        self._view.close()

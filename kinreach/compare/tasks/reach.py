"""Tasks that are done by moving to a posture: the question to a solver, the test a posture must pass, the verdict."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from kinreach.checks import Floats
from kinreach.compare.tasks.base import Task
from kinreach.kinematics.closed_form import ClosedFormKinematics
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.goals import Goal


@dataclass(frozen=True)
class Verdict:
    """What the task thinks of where the arm ended up.

    Attributes:
        reached: The task's own criterion.
        reward: The task's reward.
        posture_error: The thesis's r_e [rad], or None where the task has none.
    """

    reached: bool
    reward: float
    posture_error: float | None


class ReachTask(Task):
    """A goal is a position for the tip; a controller moves the joints to the posture that a method decides on.

    Attributes:
        home: Start posture, and the seed of every solver [rad], shape (n,).
        kinematics: World frame, the arm's default tip.
    """

    def __init__(self) -> None:
        super().__init__()
        self.home: Floats = np.array(self.arm.home)
        self.kinematics = self.new_kinematics()
        self._collisions = CollisionChecker(self.kinematics)

    @abstractmethod
    def new_kinematics(self) -> ClosedFormKinematics:
        """A kinematics of the task's arm in the world frame; every solver gets its own."""

    @abstractmethod
    def ik_goal(self, position: Floats) -> Goal:
        """What a solver is asked for to reach a position in the world [m], shape (3,)."""

    @abstractmethod
    def judge(self, distance: float, q: Floats, *, impossible: bool) -> Verdict:
        """Reward and criterion, from the distance [m] and the posture [rad] in which the arm stands."""

    def accept(self, q: Floats) -> bool:
        """The test that every method's posture must pass: the arm collides neither with itself nor its surroundings."""
        return self._collisions.free(q)

    def usable(self, position: Floats) -> bool:
        """Whether a drawn position [m] is kept as a goal."""
        return True

    def goals(self, count: int, seed: int) -> Floats:
        """Goal positions in the world [m], shape (count, 3); the first ones do not depend on `count`."""
        rng = np.random.default_rng(seed)
        kept: list[Floats] = []
        while len(kept) < count:
            position = self.arm.workcell.goals.sample(rng, 1)[0]
            if self.usable(position):
                kept.append(position)
        return np.array(kept)

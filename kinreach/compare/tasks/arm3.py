"""The reaching part of the button task: the 3-DOF arm puts its end effector on a target in space."""

from __future__ import annotations

from collections.abc import Mapping

from kinreach.checks import Floats
from kinreach.compare.tasks.reach import ReachTask, Verdict
from kinreach.envs.button.task import PRESS_RADIUS
from kinreach.kinematics import Arm3Kinematics
from kinreach.kinematics.goals import Goal, PositionGoal
from kinreach.kinematics.solvers.base import ClosedFormSolver


class Arm3Task(ReachTask):
    """End effector at the target; the reward is the environment's distance term, the criterion its press radius."""

    name = "arm3"
    title = "3-DOF arm: end effector on the target"
    arm_name = "arm3"
    reached_means = "d < 50 mm, the press radius"

    def __init__(self) -> None:
        super().__init__()
        self._exhaustive = ClosedFormSolver(self.new_kinematics())

    def new_kinematics(self) -> Arm3Kinematics:
        """The 3-DOF arm to its end effector, in the world frame."""
        return Arm3Kinematics(base="world")

    def ik_goal(self, position: Floats) -> Goal:
        """The end effector at the target; its orientation is free."""
        return PositionGoal(position)

    def usable(self, position: Floats) -> bool:
        """Whether one of the arm's (at most four) postures for this target is within limits and free of collisions.

        The closed form decides because it knows all of them; the limits make about 1 % of the region unreachable.
        """
        return self._exhaustive.solve(self.ik_goal(position), self.home, accept=self.accept).success

    def judge(self, distance: float, q: Floats, *, impossible: bool) -> Verdict:
        """Reward -d; reached is d < 50 mm at the end of a completed move."""
        return Verdict(reached=not impossible and distance < PRESS_RADIUS, reward=-distance, posture_error=None)

    def terms(self) -> Mapping[str, str]:
        """What every method is given alike."""
        return {
            "goal": "point in the world, uniform in the button task's four quadrants, kept if some posture reaches it",
            "seed_posture": "the start posture of the arm, the same for every goal",
            "accept": "no collision (self, floor)",
            "distance": "end effector to the target after the move, in the simulation",
            "reached": self.reached_means,
            "reward": "-distance [m], also where the move was impossible",
        }

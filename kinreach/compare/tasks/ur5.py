"""The thesis's task: the UR5 puts its gripper, pointing down and in a natural posture, on a ball on the table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kinreach.checks import Floats
from kinreach.compare.tasks.reach import ReachTask, Verdict
from kinreach.envs.reach.task import TOOL_DOWN
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.goals import AxisGoal, Goal
from kinreach.thesis.reward import REACHED_POSTURE_ERROR, posture_error, reach_reward


class UR5Task(ReachTask):
    """Tool down at the ball's centre, by one of the thesis's two natural branches; scored by the thesis's reward."""

    name = "ur5"
    title = "UR5: gripper on the ball, tool down, natural posture"
    arm_name = "ur5"
    reached_means = "d < 10 mm and r_e < 0.15"
    observations = ("geometric", "camera")

    def new_kinematics(self) -> UR5Kinematics:
        """The UR5 to its tcp, in the world frame."""
        return UR5Kinematics(tip="tcp", base="world")

    def ik_goal(self, position: Floats) -> Goal:
        """The tcp in the ball's centre, pointing down; rotation about the tool axis is free."""
        return AxisGoal(position, np.array(TOOL_DOWN))

    def accept(self, q: Floats) -> bool:
        """Free of collisions, and within the task's own posture criterion."""
        return float(posture_error(q)) < REACHED_POSTURE_ERROR and super().accept(q)

    def judge(self, distance: float, q: Floats, *, impossible: bool) -> Verdict:
        """The thesis's reward and its criterion, d < 10 mm and r_e < 0.15."""
        thesis = reach_reward(distance, q, impossible=impossible)
        return Verdict(bool(thesis.reached), float(thesis.reward), float(thesis.posture_error))

    def terms(self) -> Mapping[str, str]:
        """What every method is given alike."""
        return {
            "goal": "ball's centre in the world, uniform on the table area; tcp there, z axis down, free about it",
            "seed_posture": "the start posture of the arm, the same for every goal",
            "accept": "solvers' postures: no collision (self, table, mount, pedestal, floor) and r_e < 0.15",
            "distance": "tcp to the ball's centre after the last move, in the simulation",
            "reached": self.reached_means,
            "reward": "the thesis's, of the last move; impossible -100",
        }

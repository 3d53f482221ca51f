"""The closed form as a smooth map from goals to postures, in batches."""

from __future__ import annotations

import math

import numpy as np

from kinreach._checks import Floats
from kinreach.kinematics import URKinematics
from kinreach.robots import ArmDescription

#: Points around the gripper of the thesis's arm, from the tip [m]: of the palm, and below and beside both fingers.
#: These end 10 mm beyond the tip, 124 mm apart outside: with the points above the table the gripper is clear of it.
GRIPPER = np.array(
    [[x, y, 0.012] for x in (-0.016, 0.016) for y in (-0.083, -0.062, 0.062, 0.083)]
    + [[x, y, -0.09] for x in (-0.08, 0.08) for y in (-0.08, 0.08)]
)


def table_top(arm: ArmDescription) -> float:
    """Return the height of the table in the world [m]; minus infinity without one."""
    tops = [box.position[2] + box.size[2] / 2 for box in arm.workcell.obstacles if box.name == "table"]
    return max(tops, default=-math.inf)


def tool_down_postures(kinematics: URKinematics, goals: Floats, turns: Floats | float = 0.0) -> Floats:
    """Return postures [rad], shape (n, 6), that reach goals in the world [m], (n, 3), with the gripper straight down.

    It is turned outwards with the goal, and by `turns` [rad], shape (n,). Each posture is the one nearest to the start
    pose; over the table area they are of one branch and change smoothly. Unreachable goals have NaN.
    """
    home = np.array(kinematics.arm.home)
    outwards = np.arctan2(goals[:, 1], goals[:, 0]) + turns
    poses = np.tile(np.eye(4), (len(goals), 1, 1))
    quarter_turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    poses[:, :2, :2] = np.cos(outwards)[:, None, None] * np.eye(2) + np.sin(outwards)[:, None, None] * quarter_turn
    poses[:, :3, :3] = poses[:, :3, :3] @ kinematics.fk(home)[:3, :3]
    poses[:, :3, 3] = goals
    return kinematics.nearest_batch(poses, home).q

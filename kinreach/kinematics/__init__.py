"""Analytic and numeric kinematics: FK, Jacobians, limits, closed-form IK, collisions, reward geometry."""

from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import AxisGoal, PoseGoal, PositionGoal
from kinreach.kinematics.result import IKResult, Status
from kinreach.kinematics.solutions import IKSolutions
from kinreach.kinematics.ur5 import IKBatch, IKBatchNearest, UR5Kinematics

__all__ = [
    "ArmKinematics",
    "AxisGoal",
    "IKBatch",
    "IKBatchNearest",
    "IKResult",
    "IKSolutions",
    "PoseGoal",
    "PositionGoal",
    "Status",
    "UR5Kinematics",
]

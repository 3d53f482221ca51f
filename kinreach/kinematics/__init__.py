"""Analytic and numeric kinematics: FK, Jacobians, limits, closed-form IK, collisions."""

from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.arm3 import Arm3Kinematics
from kinreach.kinematics.closed_form import kinematics_of
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.goals import AxisGoal, PoseGoal, PositionGoal
from kinreach.kinematics.six_axis import SixAxisKinematics
from kinreach.kinematics.solutions import IKBatch, IKBatchNearest, IKResult, IKSolutions, Status
from kinreach.kinematics.ur.kinematics import CalibratedURKinematics, UR5Kinematics, URKinematics

__all__ = [
    "Arm3Kinematics",
    "ArmKinematics",
    "AxisGoal",
    "CalibratedURKinematics",
    "CollisionChecker",
    "IKBatch",
    "IKBatchNearest",
    "IKResult",
    "IKSolutions",
    "PoseGoal",
    "PositionGoal",
    "SixAxisKinematics",
    "Status",
    "UR5Kinematics",
    "URKinematics",
    "kinematics_of",
]

"""Analytic and numeric kinematics: FK, Jacobians, limits, closed-form IK, collisions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kinreach.errors import InputError
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.arm3 import Arm3Kinematics
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.goals import AxisGoal, PoseGoal, PositionGoal
from kinreach.kinematics.solutions import IKBatch, IKBatchNearest, IKResult, IKSolutions, Status
from kinreach.kinematics.ur.kinematics import UR5Kinematics, URKinematics

if TYPE_CHECKING:
    from kinreach.robots import ArmDescription


def kinematics_of(arm: str | ArmDescription, *, tip: str | None = None, base: str = "base_link") -> ArmKinematics:
    """Kinematics of an arm, with its closed form where it has one: that of a UR, or of a turning base with two links.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; the arm's own tool centre point by default.
        base: `"base_link"` or `"world"`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
    """
    plain = ArmKinematics(arm, tip=tip, base=base)
    try:
        if plain.n == URKinematics.joints:
            return URKinematics(plain.arm, tip=plain.tip, base=base)
        if plain.n == Arm3Kinematics.joints:
            return Arm3Kinematics(arm=plain.arm, tip=plain.tip, base=base)
    except InputError:  # as many joints, another geometry
        pass
    return plain


__all__ = [
    "Arm3Kinematics",
    "ArmKinematics",
    "AxisGoal",
    "CollisionChecker",
    "IKBatch",
    "IKBatchNearest",
    "IKResult",
    "IKSolutions",
    "PoseGoal",
    "PositionGoal",
    "Status",
    "UR5Kinematics",
    "URKinematics",
    "kinematics_of",
]

"""Analytic and numeric kinematics: FK, Jacobians, limits, closed-form IK, solvers, collisions.

- `ArmKinematics.of`, `ArmKinematics.from_urdf`: the kinematics of an arm, of the class that lists all postures of
  a pose where there is one: `URKinematics`, `Arm3Kinematics`, a closed form or elimination for other six-axis arms,
  and curves for seven axes.
- `PoseGoal`, `AxisGoal`, `PositionGoal`: goals of a solver; `IKResult`: its result.
- `ClosedFormSolver`, `PlacoSolver`, `LevenbergMarquardtSolver`, `QPSolver`: solvers with the same interface.
- `pose`, `pose_vector`: poses as six numbers, as a UR's pendant writes them.
- `CollisionChecker`: which links touch each other, or an obstacle.
- `plan_path`, `joint_line`, `tool_line`: paths as waypoints, around obstacles, straight in joint space, and straight
  for the tool.
- `time_waypoints`, `time_path`: motions along them within the `MotionLimits` of the arm.
- `check`: measurements of an arm before you rely on it.

Closed forms, solvers and `check` are imported when they are first used. The modules are internal.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from kinreach._lazy import on_first_use
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._collision import CollisionChecker
from kinreach.kinematics._goals import AxisGoal, PoseGoal, PositionGoal
from kinreach.kinematics._solutions import IKResult
from kinreach.robots._rotations import pose, pose_vector

if TYPE_CHECKING:
    from kinreach.kinematics import _check as check
    from kinreach.kinematics._arm3 import Arm3Kinematics
    from kinreach.kinematics._planning import joint_line, plan_path
    from kinreach.kinematics._solvers import ClosedFormSolver, LevenbergMarquardtSolver, PlacoSolver, QPSolver
    from kinreach.kinematics._timing import MotionLimits, time_path, time_waypoints
    from kinreach.kinematics._tool_line import tool_line
    from kinreach.kinematics._ur.kinematics import UR5Kinematics, URKinematics

#: Name -> its module, imported when the name is first used: an environment loads no closed form and no solver.
_MODULES = {
    "Arm3Kinematics": "_arm3",
    "ClosedFormSolver": "_solvers",
    "LevenbergMarquardtSolver": "_solvers",
    "MotionLimits": "_timing",
    "PlacoSolver": "_solvers",
    "QPSolver": "_solvers",
    "UR5Kinematics": "_ur.kinematics",
    "URKinematics": "_ur.kinematics",
    "joint_line": "_planning",
    "plan_path": "_planning",
    "time_path": "_timing",
    "time_waypoints": "_timing",
    "tool_line": "_tool_line",
}

__all__ = [
    "Arm3Kinematics",
    "ArmKinematics",
    "AxisGoal",
    "ClosedFormSolver",
    "CollisionChecker",
    "IKResult",
    "LevenbergMarquardtSolver",
    "MotionLimits",
    "PlacoSolver",
    "PoseGoal",
    "PositionGoal",
    "QPSolver",
    "UR5Kinematics",
    "URKinematics",
    "check",
    "joint_line",
    "plan_path",
    "pose",
    "pose_vector",
    "time_path",
    "time_waypoints",
    "tool_line",
]

_get = on_first_use(__name__, _MODULES)


def __getattr__(name: str) -> Any:
    if name == "check":
        return importlib.import_module(f"{__name__}._check")
    return _get(name)

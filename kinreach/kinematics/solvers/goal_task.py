"""Error of a goal and its Jacobian: what the iterative solvers drive to zero.

All is written in the tip's own axes. With the tip at (R, p) and the goal at (R*, p*), Siciliano et al., Robotics,
section 3.7, gives

    e_p = R^T (p* - p)          [m]     J_p = rows 0-2 of the body Jacobian
    e_o = log(R^T R*)^vee       [rad]   J_o = rows 3-5

An axis goal asks for R z = a. The shortest turn that takes the tip's z axis to a has, in the tip's axes, the rotation
vector theta (z x R^T a) / |z x R^T a|, which never has a z component: two rows are left, and turning about the tool's
axis costs nothing. A position goal keeps the first three rows.

The step J dq = e is Gauss-Newton up to the left Jacobian of SO(3), which leaves the gradient J^T e exact: the
derivative of |e_o|^2 / 2 is -e_o . omega, because e_o is its own eigenvector there.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kinreach.engines import load
from kinreach.errors import InputError
from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import AxisGoal, Floats, Goal, PoseGoal, PositionGoal
from kinreach.kinematics.solvers.base import Tolerance

pin: Any = load("pinocchio")

#: Sine of the angle between two axes below which the plane they span is not defined.
PARALLEL = 1e-12


class GoalTask:
    """The error of one goal as a function of the posture.

    Args:
        kin: The arm; the goal is in its base frame and for its tip.
        goal: What to reach.
        tolerance: When the goal counts as reached.

    Raises:
        InputError: `goal` is not a goal.
    """

    def __init__(self, kin: ArmKinematics, goal: Goal, tolerance: Tolerance) -> None:
        self._model, self._data, self._frame = kin.model, kin.data, kin.tip_frame
        self._position_bound = tolerance.position**2
        self._orientation_bound = tolerance.orientation**2
        self._axis_only = isinstance(goal, AxisGoal)
        self._target = pin.SE3(kin.T_world_base @ goal_frame(goal))
        self._rows = 6 if isinstance(goal, PoseGoal) else 5 if self._axis_only else 3

    def linearise(self, q: Floats) -> tuple[Floats, Floats]:
        """Error (m,) and Jacobian (m, n) at `q`, with m = 6, 5 or 3 rows for a pose, an axis or a position goal."""
        pin.computeJointJacobians(self._model, self._data, q)
        J = pin.getFrameJacobian(self._model, self._data, self._frame, pin.LOCAL)
        ahead = pin.updateFramePlacement(self._model, self._data, self._frame).actInv(self._target)
        e = np.empty(self._rows)
        e[:3] = ahead.translation
        if self._axis_only:
            e[3:] = _turn_to(*ahead.rotation[:, 2])
        elif self._rows == 6:
            e[3:] = pin.log3(ahead.rotation)
        return e, J[: self._rows]

    def reached(self, e: Floats) -> bool:
        """Whether an error is within the tolerance."""
        position, orientation = e[:3], e[3:]
        near = position.dot(position) <= self._position_bound
        return bool(near and orientation.dot(orientation) <= self._orientation_bound)


def goal_frame(goal: Goal) -> Floats:
    """A transform (4, 4) that meets the goal; what the goal leaves free is chosen.

    Raises:
        InputError: `goal` is not a goal.
    """
    if isinstance(goal, PoseGoal):
        return goal.T
    if not isinstance(goal, AxisGoal | PositionGoal):
        raise InputError(f"goal must be a PoseGoal, an AxisGoal or a PositionGoal, got {type(goal).__name__}")
    T = np.eye(4)
    T[:3, 3] = goal.position
    if isinstance(goal, AxisGoal):
        T[:3, :3] = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), goal.axis).toRotationMatrix()
    return T


def _turn_to(x: float, y: float, z: float) -> tuple[float, float]:
    """First two components of the rotation vector [rad] that takes the z axis to the unit vector (x, y, z)."""
    sine = math.hypot(x, y)
    angle = math.atan2(sine, z)
    if sine < PARALLEL:  # aligned, or opposite: then any axis in the plane will do
        return angle, 0.0
    return -y * angle / sine, x * angle / sine

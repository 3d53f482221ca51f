"""The 3-DOF arm: closed-form inverse kinematics, one point or many; the formulas are in the core (`yaw_planar.c`)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag, auto
from math import atan2, hypot
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import (
    MAX_DISTANCE,
    Floats,
    as_floats,
    as_pose,
    check_entries,
    check_poses,
    check_tolerance,
    is_tensor,
)
from kinreach.errors import InputError
from kinreach.kinematics._closed_form import TOLERANCE, ClosedFormKinematics, core_goal
from kinreach.kinematics._core import NULL, Struct, doubles, flags, lib, longs
from kinreach.kinematics._goals import PoseGoal, PositionGoal
from kinreach.kinematics._solutions import ANGLES, Accept, IKBatch, IKBatchNearest, IKResult, IKSolutions, Status
from kinreach.robots import ArmDescription, Tool

#: Frames are parallel whose rotations differ by less in every entry.
PARALLEL = 1e-9


class Singularity(IntFlag):
    """What was clamped or free in a solution."""

    #: The target lies on the cylinder of radius |L| around the first axis: front and back are one.
    BASE = 1
    #: The elbow is stretched or folded: both bends are one.
    ELBOW = 2


class Miss(IntFlag):
    """What kept a branch from reaching."""

    BASE_CYLINDER = auto()
    ELBOW_OUT = auto()
    ELBOW_IN = auto()


_MISS_TEXT = {
    Miss.BASE_CYLINDER: "closer to the first axis than the arm's sideways offset",
    Miss.ELBOW_OUT: "too far away for the stretched elbow",
    Miss.ELBOW_IN: "too close for the folded elbow",
}


def miss_text(miss: int) -> str:
    return "; ".join(text for flag, text in _MISS_TEXT.items() if miss & flag)


@dataclass(frozen=True)
class YawPlanarGeometry:
    """Lengths of a base that turns about z and two links that turn about y.

    Attributes:
        shoulder: Second axis in the turning frame, which is the first joint's: x and z [m].
        upper: Second axis to third, in the plane (x, z) at zero angles [m].
        fore: Third axis to the tip, likewise [m].
        offset: Sideways offset L of the tip along y of the turning frame [m].
    """

    shoulder: tuple[float, float]
    upper: tuple[float, float]
    fore: tuple[float, float]
    offset: float

    @classmethod
    def from_model(cls, model: Any, tip_frame: int) -> YawPlanarGeometry:
        """Read the lengths from a Pinocchio model with joints about z, y, y, their frames parallel at zero angles."""
        kinds = [model.joints[i].shortname() for i in range(1, model.njoints)]
        if kinds != ["JointModelRZ", "JointModelRY", "JointModelRY"]:
            raise InputError(f"needs joints about z, y, y; the model has {kinds}")
        if not all(np.allclose(model.jointPlacements[i].rotation, np.eye(3), rtol=0, atol=PARALLEL) for i in (2, 3)):
            raise InputError("needs joints about z, y, y with parallel frames; those of the model are turned")
        shoulder, elbow = (model.jointPlacements[i].translation for i in (2, 3))
        tip = model.frames[tip_frame].placement.translation
        return cls(
            shoulder=(float(shoulder[0]), float(shoulder[2])),
            upper=(float(elbow[0]), float(elbow[2])),
            fore=(float(tip[0]), float(tip[2])),
            offset=float(shoulder[1] + elbow[1] + tip[1]),
        )


class Arm3Kinematics(ClosedFormKinematics):
    r"""Kinematics of a turning base with a planar two-link arm, by default that of the button task.

    .. math::

        p(q) = R_z(q_1) \begin{pmatrix} s_x + l_1 \sin(q_2 + \varphi_1) + l_2 \sin(q_2 + q_3 + \varphi_2) \\ L \\
        s_z + l_1 \cos(q_2 + \varphi_1) + l_2 \cos(q_2 + q_3 + \varphi_2) \end{pmatrix}

    in the frame of the first joint, with the shoulder at s, links of lengths l that are turned by phi from z towards x
    where the joints are at 0, and the tip L aside. Three joints place the tip but cannot choose its orientation: goals
    are positions. Where a pose is given, its translation is the goal. Threads may share an instance.

    Args:
        arm: Name or description of an arm with joints about z, y, y, whose frames are parallel at zero angles.
        tip: Short name of the tip frame; default is the arm's own, `"end_effector"` of the `arm3`.
        base: `"base_link"` or `"world"`.

    Attributes:
        geometry: Lengths [m].

    Raises:
        InputError: The arm is not of this kind.
    """

    joints, branches = 3, 4
    unsolved = "a three-joint arm cannot choose its orientation; give a PositionGoal"

    def __init__(
        self,
        arm: str | ArmDescription = "arm3",
        *,
        tip: str | None = None,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
    ) -> None:
        super().__init__(arm, tip=tip, base=base, tool=tool)
        self.geometry = YawPlanarGeometry.from_model(self.model, self.tip_frame)
        base_of_joint = self.model.jointPlacements[1].inverse().homogeneous @ self.T_world_base
        g = self.geometry
        self._prepared = Struct(  # angles from z towards x, as a joint about y turns
            "kr_yaw_planar", base=base_of_joint[:3].ravel().tolist(), shoulder=g.shoulder, offset=g.offset,
            upper=hypot(*g.upper), upper_angle=atan2(*g.upper), fore=hypot(*g.fore), fore_angle=atan2(*g.fore),
        )  # fmt: skip

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = TOLERANCE
    ) -> IKSolutions:
        """Compute every posture that brings the tip to a point.

        Args:
            T: Position of the tip in the base frame [m], shape (3,), or a pose (4, 4) whose translation is used.
            seed: Posture [rad], shape (3,). With it, each solution is given in the winding nearest to it, and they are
                sorted by distance from it; without it, they are in the order of the branch index.
            limits: Leave out what the joint limits forbid.
            tol: Largest position error of a solution in which something was clamped [m], 1e-9 to 1.

        Returns:
            Up to four solutions, or the reason why there is none.

        Raises:
            InputError: Malformed target or seed.
        """
        start = self._posture_or_none(seed)
        target, tol = as_floats("T", T), check_tolerance(tol)
        goal = PositionGoal(as_pose("T", target)[:3, 3] if target.shape == (4, 4) else target)
        rows, count = self._rows(goal.position, start, limits=limits, tol=tol)
        status, reason = Status.OK, ""
        if not count and not rows[0, 0]:
            status, reason = Status.OUT_OF_REACH, miss_text(int(rows[0, 1]))
        elif not count:
            every, all_of_them = self._rows(goal.position, None, limits=False, tol=tol)
            status, reason = Status.OUT_OF_LIMITS, self._all_outside(every[:all_of_them])
        return IKSolutions(rows[:count], status, reason, (self._errors, core_goal(goal)))

    def _rows(self, p: Floats, seed: Floats | None, *, limits: bool, tol: float) -> tuple[Floats, int]:
        """Rows of the postures, and how many; where there is none, as `kr_yaw_planar_solutions` leaves the first."""
        rows, near = np.empty((self.branches, self.n + ANGLES.start)), NULL if seed is None else doubles(seed)
        point = doubles(np.ascontiguousarray(p))
        return rows, lib.kr_yaw_planar_solutions(*self._arguments, point, near, limits, tol, doubles(rows))

    @property
    def _arguments(self) -> tuple[Any, Any]:
        return self._prepared.pointer, self._core.pointer

    def _solve_pose(self, goal: PoseGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        raise InputError(self.unsolved)

    def _solve_position(self, goal: PositionGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return self.nearest(goal.position, seed, accept=accept)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = TOLERANCE) -> IKBatch:
        """Compute every posture of many goals; as `ClosedFormKinematics.batch`."""
        if is_tensor(T):
            return super().batch(T, limits=limits, tol=tol)
        p, tol = self._targets(as_floats("T", T)), check_tolerance(tol)
        q, valid = np.empty((len(p), self.branches, self.n)), np.empty((len(p), self.branches), dtype=np.bool_)
        lib.kr_yaw_planar_solutions_of_each(*self._arguments, doubles(p), len(p), limits, tol, doubles(q), flags(valid))
        return IKBatch(q, valid)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = TOLERANCE) -> IKBatchNearest:
        """Compute for each of many goals the posture nearest to its seed; as `ClosedFormKinematics.nearest_batch`."""
        p, tol = self._targets(as_floats("T", T)), check_tolerance(tol)
        start = np.ascontiguousarray(self._as_seeds(seeds, len(p)))
        q, branch = np.empty((len(p), self.n)), np.empty(len(p), dtype=np.int64)
        found = tol, doubles(q), longs(branch)
        lib.kr_yaw_planar_nearest_of_each(*self._arguments, doubles(p), doubles(start), len(p), *found)
        return IKBatchNearest(q, branch, branch >= 0)

    def _targets(self, T: Floats) -> Floats:
        """Check positions (count, 3) or poses (count, 4, 4); return the positions in the order of C."""
        if T.ndim == 3 and T.shape[1:] == (4, 4):
            check_poses("T", T)
            T = T[:, :3, 3]
        if T.ndim != 2 or T.shape[1] != 3:
            raise InputError(f"targets must have shape (count, 3) or (count, 4, 4), got {T.shape}")
        check_entries("targets", T, MAX_DISTANCE)
        return np.ascontiguousarray(T)

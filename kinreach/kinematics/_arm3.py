"""The 3-DOF arm: closed-form inverse kinematics, one pose or many.

The third link's tip has to be at a point. In the frame that turns with the first joint the tip's sideways offset L
is constant, so that -x sin q1 + y cos q1 = L gives two values of q1 (front and back); in the plane of the links the
law of cosines gives two values of the elbow. The branch index is `2 * back + elbow`, elbow 0 for the bend
that turns the same way as the joint's positive direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag, auto
from math import atan2, copysign, hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_DISTANCE,
    Floats,
    as_floats,
    as_pose,
    check_entries,
    check_poses,
    check_tolerance,
)
from kinreach._rotations import wrap, wrapped
from kinreach.errors import InputError
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._goals import PoseGoal, PositionGoal
from kinreach.kinematics._solutions import Accept, IKBatch, IKResult, IKSolutions, Row
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
        upper_polar, fore_polar: Length [m] of either link, and its angle from z towards x [rad], the direction in
            which a joint about y turns.
    """

    shoulder: tuple[float, float]
    upper: tuple[float, float]
    fore: tuple[float, float]
    offset: float
    upper_polar: tuple[float, float] = field(init=False)
    fore_polar: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "upper_polar", (hypot(*self.upper), atan2(*self.upper)))
        object.__setattr__(self, "fore_polar", (hypot(*self.fore), atan2(*self.fore)))

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


def solve_position(p: Sequence[float], g: YawPlanarGeometry, *, tol: float = 1e-7) -> tuple[list[Row], int]:
    """Compute all postures that put the tip at a point p of the first joint's frame [m].

    A point outside the reach by up to `tol` [m] counts as on its border.

    Returns:
        The solutions in the order of their branch index, and the `Miss` flags of the branches that have none.
    """
    x, y, z = p
    (a, angle_a), (b, angle_b) = g.upper_polar, g.fore_polar
    r, v = hypot(x, y), z - g.shoulder[1]
    if r < abs(g.offset) - tol:
        return [], int(Miss.BASE_CYLINDER)
    if r > abs(g.offset):
        m = sqrt((r - g.offset) * (r + g.offset))
        sides: tuple[tuple[int, int, float], ...] = ((0, 0, m), (2, 0, -m))
    else:
        sides = ((0, int(Singularity.BASE), 0.0),)
    found: list[Row] = []
    miss = 0
    for branch, flags, radial in sides:
        u = radial - g.shoulder[0]
        rho = hypot(u, v)
        if rho > a + b + tol:
            miss |= Miss.ELBOW_OUT
            continue
        if rho < abs(a - b) - tol:
            miss |= Miss.ELBOW_IN
            continue
        cosine = (rho * rho - a * a - b * b) / (2.0 * a * b)
        q1, phi = wrap(atan2(y, x) - atan2(g.offset, radial)), atan2(u, v) - angle_a
        if -1.0 < cosine < 1.0:
            sine = sqrt(1.0 - cosine * cosine)
            bends: tuple[tuple[int, float], ...] = ((0, sine), (1, -sine))
        else:
            cosine, bends, flags = copysign(1.0, cosine), ((0, 0.0),), flags | int(Singularity.ELBOW)
        for elbow, sine in bends:
            q2 = wrap(phi - atan2(b * sine, a + b * cosine))
            q3 = wrap(atan2(sine, cosine) - (angle_b - angle_a))
            found.append((branch + elbow, flags, q1, q2, q3))
    return found, int(miss)


BRANCHES = 4


@np.errstate(over="ignore", invalid="ignore")  # points at astronomic distances are just out of reach
def solve_positions(p: Floats, g: YawPlanarGeometry, *, tol: float = 1e-7) -> tuple[Floats, NDArray[np.bool_]]:
    """As `solve_position`, by the same formulas, for many points, shape (3, count).

    Returns:
        q [rad] in [-pi, pi], shape (3, 4, count), NaN where not valid; and valid, shape (4, count).
    """
    x, y, z = p
    r = np.hypot(x, y)
    near = r <= abs(g.offset)
    outside = r < abs(g.offset) - tol
    m = np.sqrt(np.maximum(r * r - g.offset**2, 0.0))
    heading, v = np.arctan2(y, x), z - g.shoulder[1]
    (a, angle_a), (b, angle_b) = g.upper_polar, g.fore_polar
    q = np.empty((3, BRANCHES, p.shape[1]))
    valid = np.empty((BRANCHES, p.shape[1]), dtype=np.bool_)
    for back, radial in enumerate((m, -m)):
        u = radial - g.shoulder[0]
        rho = np.hypot(u, v)
        too_far, too_near = rho > a + b + tol, rho < abs(a - b) - tol
        cosine = (rho * rho - a * a - b * b) / (2 * a * b)
        edge = np.abs(cosine) >= 1.0
        bend = np.arccos(np.clip(cosine, -1.0, 1.0))
        reached = ~(outside | too_far | too_near) & ~(near & (back == 1))
        for elbow, theta in enumerate((bend, -bend)):
            branch = 2 * back + elbow
            q[0, branch] = heading - np.arctan2(g.offset, radial)
            q[1, branch] = np.arctan2(u, v) - angle_a - np.arctan2(b * np.sin(theta), a + b * np.cos(theta))
            q[2, branch] = theta - (angle_b - angle_a)
            valid[branch] = reached & ~(edge & (elbow == 1))
    q = wrapped(q)
    np.copyto(q, np.nan, where=~valid)
    return q, valid


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

    joints, branches = 3, BRANCHES
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
        self._T_joint_base: Floats = self.model.jointPlacements[1].inverse().homogeneous @ self.T_world_base

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
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
        p = self._in_joint_frame(goal.position[None])[:, 0]
        found, miss = solve_position(p.tolist(), self.geometry, tol=tol)
        return self._solutions(found, "" if found else miss_text(miss), goal, start, limits, tol)

    def _solve_pose(self, goal: PoseGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        raise InputError(self.unsolved)

    def _solve_position(self, goal: PositionGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return self.nearest(goal.position, seed, accept=accept)

    def _few(self, T: Floats, tol: float, *, limits: bool) -> IKBatch:
        """As `all_solutions`, whose checks of each pose take longer than the formulas."""
        targets = self._targets(T)
        q, valid = np.full((len(T), BRANCHES, 3), np.nan), np.zeros((len(T), BRANCHES), dtype=np.bool_)
        for index, p in enumerate(self._in_joint_frame(targets).T.tolist()):
            found, _ = solve_position(p, self.geometry, tol=tol)
            within = self._solutions(found, "", PositionGoal(targets[index]), None, limits, tol)
            for branch, _, *angles in within.rows.tolist():
                q[index, int(branch)], valid[index, int(branch)] = angles, True
        return IKBatch(q, valid)

    def _batch(self, T: Floats, seeds: Floats | None, tol: float, *, limits: bool) -> tuple[Floats, NDArray[np.bool_]]:
        return solve_positions(self._in_joint_frame(self._targets(T)), self.geometry, tol=tol)

    def _targets(self, T: Floats) -> Floats:
        """Check positions (count, 3) or poses (count, 4, 4); return the positions."""
        if T.ndim == 3 and T.shape[1:] == (4, 4):
            check_poses("T", T)
            T = T[:, :3, 3]
        if T.ndim != 2 or T.shape[1] != 3:
            raise InputError(f"targets must have shape (count, 3) or (count, 4, 4), got {T.shape}")
        check_entries("targets", T, MAX_DISTANCE)
        return T

    def _in_joint_frame(self, p: Floats) -> Floats:
        """Express points of the base frame (count, 3) in the first joint's (3, count)."""
        return self._T_joint_base[:3, :3] @ p.T + self._T_joint_base[:3, 3:]

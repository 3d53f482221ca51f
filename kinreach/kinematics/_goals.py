"""Goals of inverse kinematics, in the base frame of the kinematics they belong to."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, dist, hypot
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_DISTANCE, Floats, as_pose, as_vector, check_poses
from kinreach.errors import InputError
from kinreach.kinematics._chain import blocks
from kinreach.kinematics._tensors import like
from kinreach.robots.inside import pose as pose  # public in both rooms
from kinreach.robots.inside import pose_vector as pose_vector

#: How far products of a rotation's columns may be off by rounding alone.
ROUNDING = 1e-12


@dataclass(frozen=True)
class PoseGoal:
    """A full pose of the tip: position [m] and orientation. `T` has shape (4, 4).

    Examples:
        >>> from kinreach.kinematics import LevenbergMarquardtSolver, PoseGoal, URKinematics
        >>> kin = URKinematics("ur5e")
        >>> goal = PoseGoal(kin.fk([0.1, -1.4, 1.5, -1.6, -1.5, 0.2]))
        >>> LevenbergMarquardtSolver(kin).solve(goal, kin.arm.home).success
        True
    """

    T: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", as_pose("T", self.T).copy())

    @property
    def position(self) -> Floats:
        """Position of the tip [m], shape (3,)."""
        return self.T[:3, 3]


@dataclass(frozen=True)
class AxisGoal:
    """The tip's origin is at `position` [m] and its z axis points along `axis`; rotation about it is free.

    Examples:
        >>> from kinreach.kinematics import AxisGoal, QPSolver, URKinematics
        >>> kin = URKinematics("ur5e", base="world")
        >>> down = AxisGoal([0.5, 0.1, 0.3], [0, 0, -1])
        >>> QPSolver(kin).solve(down, kin.arm.home).success
        True
    """

    position: Floats
    axis: Floats = (0.0, 0.0, -1.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _as_point(self.position))
        axis = as_vector("axis", self.axis, 3, most=MAX_DISTANCE)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise InputError("axis must not be the zero vector")
        object.__setattr__(self, "axis", axis / length)


@dataclass(frozen=True)
class PositionGoal:
    """The tip's origin is at `position` [m], shape (3,); its orientation is free."""

    position: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _as_point(self.position))


def _as_point(position: ArrayLike) -> Floats:
    """Return a copy, which the caller cannot change later."""
    return as_vector("position", position, 3, most=MAX_DISTANCE).copy()


Goal = PoseGoal | AxisGoal | PositionGoal


def goal_error(goal: Goal, T: Floats) -> tuple[float, float]:
    """Return how far a tip pose is from a goal: position [m] and orientation [rad] (0 where it is free)."""
    if isinstance(goal, PoseGoal):
        return pose_error(goal.T, T)
    position = dist(goal.position.tolist(), T[:3, 3].tolist())
    if isinstance(goal, AxisGoal):
        return position, _angle_between(T[:3, 2].tolist(), goal.axis.tolist())
    return position, 0.0


def pose_error(T_wanted: Floats, T: Floats) -> tuple[float, float]:
    """Return the distance [m] and the angle [rad] between two poses, shape (4, 4)."""
    position = dist(T_wanted[:3, 3].tolist(), T[:3, 3].tolist())
    return position, rotation_angle(T[:3, :3], T_wanted[:3, :3])


def nearest_rotations(R: Any) -> Any:
    """Return the rotations nearest to matrices (..., 3, 3) that almost are, by two Newton steps of the polar form."""
    for _ in range(2):
        R = R @ (1.5 * like(R, np.eye(3)) - 0.5 * R.swapaxes(-1, -2) @ R)
    return R


def skewed(entries: Any) -> Any:
    """Return which poses are no rigid motions to rounding, last rows apart, for entries (12, count) of the others."""
    nx, ox, ax, px, ny, oy, ay, py, nz, oz, az, pz = entries
    off = abs(nx * nx + ny * ny + nz * nz - 1.0)
    off += abs(ox * ox + oy * oy + oz * oz - 1.0)
    off += abs(nx * ox + ny * oy + nz * oz)
    off += abs(ny * oz - nz * oy - ax)
    off += abs(nz * ox - nx * oz - ay)
    off += abs(nx * oy - ny * ox - az)
    near = abs(px) + abs(py) + abs(pz) < MAX_DISTANCE
    return ~(near & (off < ROUNDING))


def rigid_poses(T: Floats) -> Floats:
    """Return poses (count, 4, 4) with rotations that are exact to rounding."""
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise InputError(f"T must have shape (count, 4, 4), got {T.shape}")
    off = np.empty(len(T), dtype=np.bool_)
    with np.errstate(invalid="ignore", over="ignore"):
        for rows in blocks(len(T)):
            off[rows] = skewed(np.ascontiguousarray(T[rows, :3].reshape(-1, 12).T))
    if off.any() or (T[:, 3] != (0.0, 0.0, 0.0, 1.0)).any():
        check_poses("T", T)
        T = T.copy()
        T[off, :3, :3] = nearest_rotations(T[off, :3, :3])
        T[:, 3] = (0.0, 0.0, 0.0, 1.0)
    return T


def rotation_angle(R_a: Floats, R_b: Floats) -> float:
    """Return the angle [rad] of the rotation from `R_a` to `R_b`, exact also where it is tiny."""
    (_, b, c), (d, _, f), (g, h, _) = rows = (R_a.T @ R_b).tolist()
    sine = hypot(h - f, c - g, d - b)
    return atan2(sine, rows[0][0] + rows[1][1] + rows[2][2] - 1.0)


def _angle_between(a: list[float], b: list[float]) -> float:
    """Angle [rad] between two vectors, exact also where it is tiny."""
    (ax, ay, az), (bx, by, bz) = a, b
    sine = hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return atan2(sine, ax * bx + ay * by + az * bz)

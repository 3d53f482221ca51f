"""Kinematics of the UR5 and its siblings: closed-form inverse for poses and tool directions, one or many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError
from kinreach.kinematics.closed_form import ClosedFormKinematics
from kinreach.kinematics.goals import (
    AxisGoal,
    Floats,
    Goal,
    PoseGoal,
    PositionGoal,
    as_pose,
    check_poses,
    nearest_rotations,
)
from kinreach.kinematics.result import Accept, IKResult
from kinreach.kinematics.solutions import IKSolutions, nearest_windings
from kinreach.kinematics.ur_batch import solve_poses
from kinreach.kinematics.ur_geometry import Rows, URGeometry, ur_fk
from kinreach.kinematics.ur_ik import Branch, solve_axis, solve_pose
from kinreach.robots import ArmDescription

#: base_link of the URDF is the DH base frame turned by pi about z.
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])
#: A rotation block that is off by more than rounding is brought back to a rotation first.
ROUNDING = 1e-12
FIT_TOLERANCE = 1e-8


@dataclass(frozen=True)
class IKBatch:
    """All postures of many poses.

    Attributes:
        q: Postures [rad], shape (count, 8, 6), by branch index; NaN where there is no solution.
        valid: Which branches have a solution, shape (count, 8).
    """

    q: Floats
    valid: NDArray[np.bool_]


@dataclass(frozen=True)
class IKBatchNearest:
    """One posture for each of many poses.

    Attributes:
        q: Postures [rad], shape (count, 6); NaN where `success` is False.
        branch: Branch index, shape (count,); -1 where `success` is False.
        success: Shape (count,).
    """

    q: Floats
    branch: NDArray[np.int64]
    success: NDArray[np.bool_]


class UR5Kinematics(ClosedFormKinematics):
    """Kinematics of a UR-type arm, by default the UR5 within +-pi.

    Link lengths are read from the URDF, so a calibrated description brings its own.

    Args:
        arm: Name or description of a UR-type arm with a frame `tool0`.
        tip: `"tool0"` (the flange) or `"tcp"` (between the finger tips).
        base: `"base_link"` or `"world"`.

    Attributes:
        geometry: Denavit-Hartenberg lengths [m].

    Raises:
        InputError: The arm's geometry is not that of a UR.
    """

    def __init__(self, *, tip: str = "tcp", base: str = "base_link", arm: str | ArmDescription = "ur5") -> None:
        super().__init__(arm, tip=tip, base=base)
        flange = self.model.getFrameId(self.arm.tips["tool0"])
        self.geometry = URGeometry.from_model(self.model, flange)
        T_flange_tip = self.model.frames[flange].placement.inverse() * self.model.frames[self.tip_frame].placement
        T_world_arm = self.model.frames[self.model.getFrameId(self.arm.base)].placement.homogeneous
        self._T_dh_base: Floats = FLIP @ np.linalg.inv(T_world_arm) @ self.T_world_base
        self._T_tip_flange: Floats = T_flange_tip.inverse().homogeneous
        # with tool0 in base_link only two rows change their sign
        self._plain = bool(np.allclose(self._T_dh_base, FLIP, atol=0) and np.allclose(self._T_tip_flange, np.eye(4), atol=0))
        self._reach = _reach_along_tool(T_flange_tip.homogeneous)
        self._check_fit()

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
    ) -> IKSolutions:
        """Every posture that brings the tip to a pose, singular cases included.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad], shape (6,). With it, each solution is given in the winding nearest to it, they are
                sorted by distance from it, and wrist_3 keeps its value where it is free. Without it,
                they are in the order of the branch index, and a free wrist_3 stays near 0.
            limits: Leave out what the joint limits forbid.
            tol: Largest error of a solution in which something was clamped [m, rad].

        Returns:
            Up to eight solutions, or the reason why there is none.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        start = self._posture_or_none(seed)
        rows = self._flange_rows(T)
        found, miss = solve_pose(rows, self.geometry, tol=tol, q6=0.0 if start is None else float(start[5]))
        return self._solutions(found, miss, lambda q: self._error_of(PoseGoal(np.asarray(T)))(q), start, limits)

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """The posture for a pose that is nearest to a seed, over all branches and windings.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad], shape (6,).
            accept: Called with candidates in the order of their distance until it returns True.

        Raises:
            InputError: As `all_solutions`.
        """
        start = self.as_posture("seed", seed)
        return self._choose(self.all_solutions(T, seed=start), start, accept)

    def axis_solutions(
        self, position: ArrayLike, axis: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
    ) -> IKSolutions:
        """Every posture that brings the tip to a point with its z axis along a direction (rotation about it is free).

        Args:
            position: In the base frame [m], shape (3,).
            axis: Direction of the tip's z axis in the base frame, shape (3,); need not be normalised.
            seed: As in `all_solutions`; wrist_3 takes its value (0 without a seed).
            limits: As in `all_solutions`.
            tol: As in `all_solutions`.

        Raises:
            InputError: Malformed input, or a tip that is not on the axis of wrist_3.
        """
        start = self._posture_or_none(seed)
        goal = AxisGoal(np.asarray(position), np.asarray(axis))
        if self._reach is None:
            raise InputError(f"tip {self.tip!r} is not on the axis of the last joint, which an axis goal needs")
        p = self._T_dh_base[:3, :3] @ goal.position + self._T_dh_base[:3, 3]
        a = self._T_dh_base[:3, :3] @ goal.axis
        pitch, q6 = (0.0, 0.0) if start is None else (float(start[1:4].sum()), float(start[5]))
        found, miss = solve_axis(
            p.tolist(), a.tolist(), self.geometry, reach=self._reach, tol=tol, pitch=pitch, q6=q6
        )
        return self._solutions(found, miss, self._error_of(goal), start, limits)

    def axis_goal(
        self, position: ArrayLike, axis: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None
    ) -> IKResult:
        """The posture nearest to a seed among `axis_solutions`; see `nearest` for `accept`."""
        start = self.as_posture("seed", seed)
        return self._choose(self.axis_solutions(position, axis, seed=start), start, accept)

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Any goal this arm has a closed form for: `PoseGoal` or `AxisGoal`.

        Raises:
            InputError: A `PositionGoal`, which leaves three of six joints free.
        """
        if isinstance(goal, PositionGoal):
            raise InputError("a six-joint arm has no closed form for a bare position; give an AxisGoal or a PoseGoal")
        if isinstance(goal, AxisGoal):
            return self.axis_goal(goal.position, goal.axis, seed, accept=accept)
        return self.nearest(goal.T, seed, accept=accept)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = 1e-7) -> IKBatch:
        """Every posture of many poses.

        Args:
            T: Poses of the tip in the base frame, shape (count, 4, 4).
            limits: Leave out what the joint limits forbid.
            tol: As in `all_solutions`.

        Raises:
            InputError: A pose is not a finite rigid motion; the message says which.
        """
        q, valid = self._batch(T, None, tol)
        if limits and not self._full_turn:
            q, within = nearest_windings(q, np.zeros(()), self.lower, self.upper)
            valid &= within
        q[:, ~valid] = np.nan
        return IKBatch(q.transpose(2, 1, 0), valid.T)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = 1e-7) -> IKBatchNearest:
        """For each of many poses the posture nearest to its seed, over all branches and windings within the limits.

        Args:
            T: Poses of the tip in the base frame, shape (count, 4, 4).
            seeds: Postures [rad], shape (count, 6), or (6,) for all.
            tol: As in `all_solutions`.

        Raises:
            InputError: Malformed poses or seeds.
        """
        count = len(np.asarray(T))
        try:
            start = np.broadcast_to(np.asarray(seeds, dtype=np.float64), (count, self.n))
        except (TypeError, ValueError):
            raise InputError(f"seeds must have shape ({count}, {self.n}) or ({self.n},)") from None
        if not np.isfinite(start).all():
            raise InputError("seeds must be finite")
        q, valid = self._batch(T, start, tol)
        q, within = nearest_windings(q, start.T[:, None], self.lower, self.upper)
        distance = ((q - start.T[:, None]) ** 2).sum(axis=0)
        distance[~(valid & within)] = np.inf
        best = distance.argmin(axis=0)
        rows = np.arange(count)
        success = np.isfinite(distance[best, rows])
        chosen = np.where(success, q[:, best, rows], np.nan)
        return IKBatchNearest(chosen.T, np.where(success, best, -1), success)

    def _batch(self, T: ArrayLike, seeds: Floats | None, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures (6, 8, count) and their validity (8, count), before limits."""
        m = self._flange_columns(T)
        q, valid, singular = solve_poses(m, self.geometry, tol=tol)
        for row in np.flatnonzero(singular):
            rows = m[:, row].reshape(3, 4).tolist()
            q6 = 0.0 if seeds is None else float(seeds[row, 5])
            found, _ = solve_pose(rows, self.geometry, tol=tol, q6=q6)
            valid[:, row] = False
            for code, *angles in found:
                q[:, code & 7, row] = angles
                valid[code & 7, row] = True
        return q, valid

    def _flange_rows(self, T: ArrayLike) -> Rows:
        """Pose of the flange in the DH base frame, from a checked pose of the tip in the base frame."""
        T = np.asarray(T, dtype=np.float64)
        if T.shape != (4, 4):
            as_pose("T", T)
        (nx, ox, ax, px), (ny, oy, ay, py), (nz, oz, az, pz), last = rows = T.tolist()
        exact = (
            -ROUNDING < nx * nx + ny * ny + nz * nz - 1.0 < ROUNDING
            and -ROUNDING < ox * ox + oy * oy + oz * oz - 1.0 < ROUNDING
            and -ROUNDING < nx * ox + ny * oy + nz * oz < ROUNDING
            and -ROUNDING < ny * oz - nz * oy - ax < ROUNDING
            and -ROUNDING < nz * ox - nx * oz - ay < ROUNDING
            and -ROUNDING < nx * oy - ny * ox - az < ROUNDING
            and -np.inf < px + py + pz < np.inf
            and last == [0.0, 0.0, 0.0, 1.0]
        )
        if exact and self._plain:
            return (-nx, -ox, -ax, -px), (-ny, -oy, -ay, -py), (nz, oz, az, pz)
        if not exact:
            T = as_pose("T", T).copy()
            T[:3, :3] = nearest_rotations(T[:3, :3])
        rows = (self._T_dh_base @ T @ self._T_tip_flange).tolist()
        return rows[:3]

    def _flange_columns(self, T: ArrayLike) -> Floats:
        """The same for many poses, as the twelve entries of each, shape (12, count)."""
        T = np.asarray(T, dtype=np.float64)
        if T.ndim != 3 or T.shape[1:] != (4, 4):
            raise InputError(f"T must have shape (count, 4, 4), got {T.shape}")
        m = np.ascontiguousarray(T[:, :3].reshape(-1, 12).T)
        off = _off_rotation(m)
        if not (off < ROUNDING).all() or not np.isfinite(m[3::4]).all() or (T[:, 3] != (0.0, 0.0, 0.0, 1.0)).any():
            check_poses("T", T)
            T = T.copy()
            T[:, :3, :3] = nearest_rotations(T[:, :3, :3])
            m = np.ascontiguousarray(T[:, :3].reshape(-1, 12).T)
        return _transformed(m, self._T_dh_base, self._T_tip_flange)

    def _check_fit(self) -> None:
        """The closed form describes this arm: its forward kinematics agrees with Pinocchio's."""
        for q in (np.zeros(self.n), np.linspace(0.3, 1.3, self.n)):
            rows = np.array(ur_fk(q, self.geometry))
            expected = (self._T_dh_base @ self.fk(q) @ self._T_tip_flange)[:3]
            if np.abs(rows - expected).max() > FIT_TOLERANCE:
                raise InputError(f"arm {self.arm.name!r} does not have the geometry of a UR-type arm")


def _reach_along_tool(T_flange_tip: Floats) -> float | None:
    """Distance of the tip along the flange's z axis [m], or None if it is not on it or turned away from it."""
    aligned = np.allclose(T_flange_tip[:2, 3], 0.0, atol=1e-12) and np.isclose(T_flange_tip[2, 2], 1.0, atol=1e-12)
    return float(T_flange_tip[2, 3]) if aligned else None


def _off_rotation(m: Floats) -> Floats:
    """How far each 3x3 block is from a right-handed rotation, shape (count,); NaN where it is not finite."""
    nx, ox, ax, _, ny, oy, ay, _, nz, oz, az, _ = m
    off = np.abs(nx * nx + ny * ny + nz * nz - 1.0)
    np.maximum(off, np.abs(ox * ox + oy * oy + oz * oz - 1.0), out=off)
    np.maximum(off, np.abs(nx * ox + ny * oy + nz * oz), out=off)
    np.maximum(off, np.abs(ny * oz - nz * oy - ax), out=off)
    np.maximum(off, np.abs(nz * ox - nx * oz - ay), out=off)
    return np.maximum(off, np.abs(nx * oy - ny * ox - az), out=off)


def _transformed(m: Floats, left: Floats, right: Floats) -> Floats:
    """Entries of left @ T @ right for many T given by their twelve entries, shape (12, count)."""
    count = m.shape[1]
    rows = left[:3, :3] @ m.reshape(3, 4 * count)
    rows = rows.reshape(3, 4, count)
    rows[:, 3] += left[:3, 3:]
    if not np.array_equal(right, np.eye(4)):
        rows = np.einsum("ijc,jk->ikc", rows, right) if right[:3, 3].any() else rows
    return rows.reshape(12, count)


__all__ = ["Branch", "IKBatch", "IKBatchNearest", "UR5Kinematics"]

"""Kinematics of the 3-DOF arm of the button task, with a closed-form inverse for positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError
from kinreach.inputs import shown
from kinreach.kinematics.arm3_batch import solve_positions
from kinreach.kinematics.arm3_ik import YawPlanarGeometry, miss_text, solve_position
from kinreach.kinematics.closed_form import ClosedFormKinematics
from kinreach.kinematics.goals import (
    MOST_DISTANCE,
    Floats,
    Goal,
    PositionGoal,
    as_floats,
    as_pose,
    check_entries,
    check_poses,
    check_tolerance,
)
from kinreach.kinematics.result import Accept, IKResult
from kinreach.kinematics.solutions import IKSolutions
from kinreach.robots import ArmDescription


class Arm3Kinematics(ClosedFormKinematics):
    """Kinematics of a turning base with a planar two-link arm, by default that of the button task.

    One per thread. Three joints place the tip but cannot choose its orientation: goals are positions. Where a pose is
    given, its translation is the goal.

    Args:
        arm: Name or description of an arm with joints about z, y, y.
        tip: `"end_effector"`.
        base: `"base_link"` or `"world"`.

    Attributes:
        geometry: Lengths [m].

    Raises:
        InputError: The arm is not of this kind.
    """

    def __init__(
        self, *, tip: str = "end_effector", base: str = "base_link", arm: str | ArmDescription = "arm3"
    ) -> None:
        super().__init__(arm, tip=tip, base=base)
        self.geometry = YawPlanarGeometry.from_model(self.model, self.tip_frame)
        T_world_arm = self.model.frames[self.model.getFrameId(self.arm.base)].placement.homogeneous
        self._T_arm_base: Floats = np.linalg.inv(T_world_arm) @ self.T_world_base

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
    ) -> IKSolutions:
        """Every posture that brings the tip to a point.

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
        p = self._in_arm_frame(goal.position[None])[:, 0]
        found, miss = solve_position(p.tolist(), self.geometry, tol=tol)
        return self._solutions(found, "" if found else miss_text(miss), self._error_of(goal), start, limits)

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """A `PositionGoal`.

        Raises:
            InputError: Any other goal, which asks for an orientation that three joints cannot choose.
        """
        if not isinstance(goal, PositionGoal):
            raise InputError(f"a three-joint arm cannot choose its orientation; give a PositionGoal, not {shown(goal)}")
        return self.nearest(goal.position, seed, accept=accept)

    def _batch(self, T: Floats, seeds: Floats | None, tol: float) -> tuple[Floats, NDArray[np.bool_]]:
        if T.ndim == 3 and T.shape[1:] == (4, 4):
            check_poses("T", T)
            T = T[:, :3, 3]
        if T.ndim != 2 or T.shape[1] != 3:
            raise InputError(f"targets must have shape (count, 3) or (count, 4, 4), got {T.shape}")
        check_entries("targets", T, MOST_DISTANCE)
        return solve_positions(self._in_arm_frame(T), self.geometry, tol=tol)

    def _in_arm_frame(self, p: Floats) -> Floats:
        """Points of the base frame (count, 3) in the arm's own frame (3, count)."""
        return self._T_arm_base[:3, :3] @ p.T + self._T_arm_base[:3, 3:]

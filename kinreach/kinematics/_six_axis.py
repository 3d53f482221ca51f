"""Kinematics of arms with any six revolute joints: every posture of a pose, by elimination.

`General6R` finds them. It is singular for some arrangements of axes, such as three that meet in a wrist, and then it is
not from the arm's other end: which way it goes is decided by trying both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, check_poses, check_tolerance, shown
from kinreach.errors import InputError
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._chain import about_z, poses_about
from kinreach.kinematics._closed_form import TURNS_ABOUT, ClosedFormKinematics
from kinreach.kinematics._general_6r import MAX_POSTURES, Chain, General6R
from kinreach.kinematics._goals import AxisGoal, Goal, PoseGoal, PositionGoal, nearest_rotations
from kinreach.kinematics._solutions import Accept, IKResult, IKSolutions
from kinreach.robots import ArmDescription, Tool

#: Random postures by which the direction is chosen, and the share of them that has to be found again.
TRIALS, MIN_SHARE = 100, 0.98
#: How far the tip may be from the last joint's axis for that joint to turn about it [m, and sine of an angle].
ON_AXIS = 1e-9
UNREACHED = "no posture reaches the goal"


class SixAxisKinematics(ClosedFormKinematics):
    """Kinematics of an arm with any six revolute joints. Threads may share an instance.

    Postures miss their pose by less than 1e-9 m and rad, unless none does that: then those that miss it by up to `tol`
    are returned. The branch index only counts the postures of a pose; there are up to sixteen.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: `"base_link"` or `"world"`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm does not have six joints, or axes for which the elimination is singular.
    """

    joints = 6

    def __init__(
        self,
        arm: str | ArmDescription,
        *,
        tip: str | None = None,
        base: str | ArrayLike = "base_link",
        tool: Tool | str | ArrayLike | None = None,
    ) -> None:
        super().__init__(arm, tip=tip, base=base, tool=tool)
        if self.n != self.joints:
            raise InputError(f"arm {self.arm.name!r} has {self.n} joints; six are needed")
        placements, axes = self._joint_frames()
        placements[0] = self.T_base_world @ placements[0]
        self._placements = about_z(placements, axes, self.model.frames[self.tip_frame].placement.homogeneous)
        self._backwards, self._general = self._direction()

    def _direction(self) -> tuple[bool, General6R]:
        """Whether the arm is solved from its tip, and the method."""
        q = np.random.default_rng(0).uniform(-np.pi, np.pi, (TRIALS, self.joints))
        back: Floats = np.asarray(np.linalg.inv(self._placements[::-1]), dtype=np.float64)
        ways = (self._placements, q), (back, -q[:, ::-1])
        methods = [General6R(Chain(placements)) for placements, _ in ways]
        shares = [method.tried(postures) for method, (_, postures) in zip(methods, ways, strict=True)]
        best = int(np.argmax(shares))
        if shares[best] < MIN_SHARE:
            raise InputError(
                f"arm {self.arm.name!r}: its axes make the elimination singular; of random postures it finds "
                f"{100 * shares[best]:.0f} % again, and {100 * MIN_SHARE:.0f} % are needed"
            )
        return bool(best), methods[best]

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
    ) -> IKSolutions:
        """Compute every posture that brings the tip to a pose.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad], shape (6,). With it, each solution is given in the winding nearest to it, and they are
                sorted by distance from it.
            limits: Leave out what the joint limits forbid.
            tol: Where no posture reaches the pose exactly, the most by which one may miss it [m, rad], 1e-9 to 1.

        Returns:
            Up to sixteen solutions, or the reason why there is none.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        start = self._posture_or_none(seed)
        goal = PoseGoal(T)  # type: ignore[arg-type]
        return self._among(goal, goal.T[None], start, None, limits=limits, tol=tol)

    def axis_solutions(
        self,
        position: ArrayLike,
        axis: ArrayLike,
        *,
        seed: ArrayLike | None = None,
        limits: bool = True,
        tol: float = 1e-7,
    ) -> IKSolutions:
        """Compute postures with the tip at a point and its z axis along a direction; rotation about it is free.

        If the tip is on the last joint's axis, they are all there are. If not, they are those at 36 turns about the
        direction, 10 degrees apart.

        Args:
            position: In the base frame [m], shape (3,).
            axis: Direction of the tip's z axis in the base frame, shape (3,); need not be normalised.
            seed: As in `all_solutions`; a last joint that is free takes its value (0 without a seed), or the limit
                nearest to that.
            limits: As in `all_solutions`.
            tol: As in `all_solutions`.

        Raises:
            InputError: Malformed input.
        """
        start = self._posture_or_none(seed)
        goal = AxisGoal(position, axis)  # type: ignore[arg-type]
        free = self._last_turns_tip()
        T = poses_about(goal.position, goal.axis, np.zeros(1) if free else TURNS_ABOUT)
        last = None
        if free:
            last = 0.0 if start is None else float(start[-1])
            if limits:
                last = min(max(last, self._low[-1]), self._high[-1])
        return self._among(goal, T, start, last, limits=limits, tol=tol)

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture nearest to a seed for a `PoseGoal` or an `AxisGoal`.

        Raises:
            InputError: A `PositionGoal`, which leaves three of six joints free, or an object of another kind.
        """
        if isinstance(goal, PositionGoal):
            raise InputError("a six-joint arm has no finite list of postures for a bare position; give its direction")
        if isinstance(goal, AxisGoal):
            start = self.as_posture("seed", seed)
            return self._choose(self.axis_solutions(goal.position, goal.axis, seed=start), start, accept)
        if not isinstance(goal, PoseGoal):
            raise InputError(f"goal must be a PoseGoal or an AxisGoal, got {shown(goal)}")
        return self.nearest(goal.T, seed, accept=accept)

    def _among(
        self, goal: Goal, T: Floats, start: Floats | None, last: float | None, *, limits: bool, tol: float
    ) -> IKSolutions:
        """Solutions for a goal out of the postures of some poses (m, 4, 4), the last joint set if it is free."""
        lists = self._postures(T, check_tolerance(tol))
        postures = [q.tolist() if last is None else [*q[:-1].tolist(), last] for found in lists for q in found]
        rows = [(index, 0, *q) for index, q in enumerate(postures)]
        return self._solutions(rows, "" if rows else UNREACHED, self._error_of(goal), start, limits, tol)

    def _batch(self, T: Floats, seeds: Floats | None, tol: float, *, limits: bool) -> tuple[Floats, NDArray[np.bool_]]:
        if T.ndim != 3 or T.shape[1:] != (4, 4):
            raise InputError(f"T must have shape (count, 4, 4), got {T.shape}")
        check_poses("T", T)
        q, valid = (
            np.full((self.joints, MAX_POSTURES, len(T)), np.nan),
            np.zeros((MAX_POSTURES, len(T)), dtype=np.bool_),
        )
        for row, found in enumerate(self._postures(T, tol)):
            q[:, : len(found), row], valid[: len(found), row] = found.T, True
        return q, valid

    def _postures(self, T: Floats, tol: float) -> list[Floats]:
        """All postures (k, 6) for each of many poses of the tip in the base frame (m, 4, 4)."""
        T = T.copy()
        T[:, :3, :3] = nearest_rotations(T[:, :3, :3])
        if not self._backwards:
            return self._general.solve(T, tol=tol)
        back: Floats = np.asarray(np.linalg.inv(T), dtype=np.float64)
        return [wrapped(-q[:, ::-1]) for q in self._general.solve(back, tol=tol)]

    def _last_turns_tip(self) -> bool:
        """Whether the last joint turns the tip about its own z axis, either way, and moves it nowhere."""
        after = self._placements[-1]
        return bool(max(np.abs(after[:2, 2:]).max(), 1.0 - abs(after[2, 2])) < ON_AXIS)

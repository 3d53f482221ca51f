"""Kinematics of arms with any six revolute joints: every posture of a pose."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import Floats, as_floats, check_tolerance
from kinreach._rotations import joints_apart
from kinreach.errors import InputError
from kinreach.kinematics._chain import poses_about, turns_and_own
from kinreach.kinematics._closed_form import TURNS_ABOUT, core_goal
from kinreach.kinematics._compiled import CompiledKinematics
from kinreach.kinematics._core import NULL, as_rows, doubles, lib, new_rows
from kinreach.kinematics._goals import (
    AxisGoal,
    Goal,
    rigid_pose,
    rigid_poses,
)
from kinreach.kinematics._six_axis.methods import EXACTLY, FAR, MIN_SHARE, MISSED, NEARLY, SINGULAR, WAYS, method_of
from kinreach.kinematics._six_axis.reach import WristReach
from kinreach.kinematics._solutions import (
    ANGLES,
    BRANCH,
    FLAGS,
    Accept,
    IKResult,
    IKSolutions,
    Row,
    Tolerance,
)
from kinreach.kinematics._solvers.iterative import GoalTask

#: How far the tip may be from the last joint's axis for that joint to turn about it [m, and sine of an angle]: a right
#: angle in a URDF is often written as 1.5708. From `OFF_AXIS` on, the other joints make up for it, in so many steps.
ON_AXIS, OFF_AXIS, AXIS_STEPS = 1e-5, 1e-12, 6
#: Up to this far off, joints 1 to 5 have nothing to make up for.
ON_AXIS_EXACTLY = 1e-10
UNREACHED = "no posture reaches the goal"


class SixAxisKinematics(CompiledKinematics):
    """Kinematics of an arm with any six revolute joints. Threads may share an instance.

    An arm with a spherical wrist, or with axes 2, 3 and 4 parallel, seen from its base or from its tip, has a closed
    form, with up to eight postures; their branch index tells shoulder, wrist and elbow apart. One that is a millimetre
    off that is solved by Newton's method from there. All others have up to sixteen postures, found by elimination;
    their branch index only counts.

    Postures miss their pose by less than 1e-9 m and rad, unless none does that: then those that miss it by up to `tol`
    are returned. Where a pose is singular, a joint that is free keeps the seed's value.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: `"base_link"` or `"world"`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm does not have six joints, or is singular in every posture, or nearly.
    """

    unsolved = "a six-axis arm has no finite list of postures for a bare position; give its direction"

    def _prepare(self) -> None:
        super()._prepare()
        if self.n != self.joints:
            raise InputError(f"arm {self.arm.name!r} has {self.n} joints; six are needed")
        method = method_of(self._placements)
        if method == SINGULAR:
            why = self._coinciding(EXACTLY) or "its six joints move the tip in five directions or fewer"
            raise InputError(
                f"arm {self.arm.name!r} is singular in every posture: {why}; a pose has no posture or infinitely many"
            )
        if isinstance(method, float):
            why = self._coinciding(NEARLY) or "its axes make the elimination singular"
            raise InputError(
                f"arm {self.arm.name!r}: {why}; of random postures elimination finds {100 * method:.0f} % again, and "
                f"{100 * MIN_SHARE:.0f} % are needed"
            )
        self._method, self.branches = method, method.branches
        self._is_compiled = method.compiled is not None
        if method.compiled is not None:
            self._way, self._prepared = method.compiled

    @cached_property
    def _wrist_reach(self) -> WristReach:
        return WristReach(self._placements)

    @property
    def solved(self) -> str:
        """How postures are found, in closed form, by Newton's method from one, or by elimination."""
        return WAYS[self._method.rank]

    @property
    def has_named_branches(self) -> bool:
        return bool(self._method.special_axes[0])

    @property
    def special_axes(self) -> str:
        """Which axes give the arm its closed form, and how nearly; empty without one."""
        axes, what = self._method.special_axes
        if not axes:
            return ""
        *most, last = axes
        named, off = f"axes {', '.join(map(str, most))} and {last} {what}", self._method.off
        return named.format("nearly ") + f": poses differ by up to {off:.1e} m or rad" if off else named.format("")

    def _coinciding(self, nearer: tuple[float, float]) -> str:
        """Which neighbouring axes are one line, or nearer than that [m, rad]; empty if none are."""
        for joint, placement in enumerate(self._placements[1:-1], start=1):
            length, angle = (float(np.hypot(*placement[:2, column])) for column in (3, 2))
            if length < nearer[0] and angle < nearer[1]:
                names = self.arm.joints[joint - 1 : joint + 1]
                how = "coincide" if nearer == EXACTLY else f"nearly coincide ({length:.1e} m, {angle:.1e} rad)"
                return f"axes {joint} and {joint + 1} ({names[0]}, {names[1]}) {how}"
        return ""

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
            Up to sixteen solutions, or the reason why there is none. "Too far" and "too close" are measured from the
            shoulder, on axis 1 next to axis 2, to the wrist, on axis 6 next to axis 5.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        if self._is_compiled:
            return self._every(T, seed, limits=limits, tol=tol)
        start = self._posture_or_none(seed)
        T = as_floats("T", T).copy()
        rigid = rigid_pose(T)
        tol = check_tolerance(tol)
        rows = self._rows(rigid, start, limits=limits, tol=tol)
        return self._solutions(rows, "" if len(rows) else self._miss_text(rigid, 0), T, start, limits, tol)

    def _miss_text(self, T: Floats, miss: int) -> str:
        return self._wrist_reach.why(T) or UNREACHED

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

        If the tip is on the last joint's axis, they are all there are. If not, or if it is beside it by up to 1e-5 m
        and rad and only some turns reach, they are those at 36 turns about the direction, 10 degrees apart, and with a
        seed at its own.

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
        tol = check_tolerance(tol)

        def rows_at(turns: Floats, *, limits: bool) -> list[Row]:
            poses = poses_about(goal.position, goal.axis, turns)
            return [row for T in poses for row in self._rows(T, start, limits=limits, tol=tol).tolist()]

        found: list[Row] = []
        if free:
            last = 0.0 if start is None else float(start[-1])
            if limits:
                last = min(max(last, self._low[-1]), self._high[-1])
            for row in rows_at(np.zeros(1), limits=False):
                turned = self._made_up_for((*row[:-1], last), goal)
                if turned is None:
                    turn = math.copysign(last - row[-1], (last - row[-1]) * self._placements[-1][2, 2])
                    near = rows_at(np.array([turn]), limits=False)
                    turned = min(
                        near, key=lambda other: joints_apart(other[ANGLES][:-1], row[ANGLES][:-1]), default=row
                    )
                found.append((row[BRANCH], *turned[FLAGS:]))
        if not found and not self._last_turns_tip(ON_AXIS_EXACTLY):
            turns = TURNS_ABOUT if start is None else turns_and_own(TURNS_ABOUT, goal.axis, self.fk(start))
            found = [(index, *row[1:]) for index, row in enumerate(rows_at(turns, limits=limits))]
        found = [row for row in found if self._missed_by(row, goal) <= MISSED] or found
        (T,) = poses_about(goal.position, goal.axis, np.zeros(1))
        unreached = "" if found else (free and self._wrist_reach.why(T)) or UNREACHED
        return self._solutions(found, unreached, goal, start, limits, tol)

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = self.as_posture("seed", seed)
        return self._choose(self.axis_solutions(goal.position, goal.axis, seed=start), start, accept)

    def _rows(self, T: Floats, start: Floats | None, *, limits: bool, tol: float) -> Floats:
        """Postures for a pose; free joints take values with which the posture is within the limits, if there are."""
        pose = np.ascontiguousarray(T)
        if not self._is_compiled:
            q, valid = self._method.many(pose[None], np.zeros((1, self.n)) if start is None else start[None], tol)
            (branch,) = np.nonzero(valid[:, 0])
            return np.column_stack([branch, np.zeros(len(branch)), q[:, branch, 0].T])
        rows, near = new_rows(self.branches), NULL if start is None else doubles(start)
        count = lib.kr_solutions(*self._arguments, doubles(pose), near, False, tol, rows)
        found = as_rows(rows)[:count].copy()
        if limits and found[:, FLAGS].any():
            count = lib.kr_solutions(*self._arguments, doubles(pose), near, True, tol, rows)
            for row in as_rows(rows)[:count]:
                found[found[:, BRANCH] == row[BRANCH]] = row
        return found

    def _batch(self, T: Floats, seeds: Floats | None, tol: float, *, limits: bool) -> tuple[Floats, NDArray[np.bool_]]:
        T = rigid_poses(T)
        return self._method.many(T, np.zeros((len(T), self.n)) if seeds is None else seeds, tol)

    def _last_turns_tip(self, off: float = ON_AXIS) -> bool:
        """Whether the last joint turns the tip about its own z axis, either way, and moves it nowhere, or hardly."""
        after = self._placements[-1]
        return bool(np.abs(after[:2, 2:]).max() < off)

    def _made_up_for(self, row: Row, goal: AxisGoal) -> Row | None:
        """Move all joints but the last so that the tip meets a goal that it misses as little as it is off that axis.

        None if it does not come to meet it from there.
        """
        task, q = GoalTask(self, goal, Tolerance()), np.array(row[ANGLES])
        for _ in range(AXIS_STEPS):
            error, J = task.linearise(q)
            if np.abs(error).max() < OFF_AXIS:
                break
            q[:-1] += np.linalg.lstsq(J[:, :-1], error, rcond=None)[0]
        moved = (row[BRANCH], row[FLAGS], *q.tolist())
        return moved if np.abs(q - row[ANGLES]).max() < FAR and self._missed_by(moved, goal) < MISSED else None

    def _missed_by(self, row: Row, goal: Goal) -> float:
        """The larger of position [m] and orientation [rad] error."""
        return float(self._errors(core_goal(goal), np.array([row])).max())

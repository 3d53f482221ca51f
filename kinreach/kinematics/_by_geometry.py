"""What arms with slides and arms with rods share: postures by their geometry, brought to a pose by Newton's method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_tolerance, is_tensor
from kinreach._rotations import rotation_angle, small_motion, turn
from kinreach.errors import InputError
from kinreach.kinematics._arm import POSE_JOINTS
from kinreach.kinematics._chain import TURNS, poses_about, turns_and_own
from kinreach.kinematics._closed_form import TOLERANCE, ClosedFormKinematics
from kinreach.kinematics._goals import AxisGoal, Goal, PositionGoal, rigid_pose, rigid_poses
from kinreach.kinematics._solutions import (
    ANGLES,
    Accept,
    IKBatch,
    IKBatchNearest,
    IKResult,
    IKSolutions,
    Status,
    Tolerance,
    check_accept,
    nearest_windings,
    past_limits,
)

#: A length [m], and the sine of an angle, below which a joint is free: what it would have to turn has no direction.
NOWHERE = 1e-9
#: The sine of an angle between two axes below which a turn about one does not change the other.
NOT_TURNED = 1e-4
#: Steps of Newton's method, for postures that miss by less than this, and by more [m, rad]; a joint that moves the tip
#: by less than this share of what another does is left where it is.
STEPS, NEAR, EXACT, FREE = 2, 1e-5, 1e-12, 1e-6
#: How far a joint that keeps its value may be from it [rad].
KEPT = 1e-4
#: Flag of a posture in which a joint is free, or that only just reaches.
SINGULAR = 1


class Found(NamedTuple):
    """Postures of a pose: a branch index and a flag for each, shape (k,), and places (k, n) [rad, m]; and why none."""

    branch: list[int]
    flags: list[int]
    q: list[Floats]
    reason: str = ""


class ByGeometry(ClosedFormKinematics):
    """Arms that slide, or have rods: postures by their geometry, brought to a pose by Newton's method."""

    #: Finds the postures of a pose; with `hold` those of its point, and `_last_turning` keeps its value.
    _find: Callable[..., Found]
    #: The tip's pose in the posture 0; the axis about which alone the tip turns, or None, and the last joint about it.
    _still: Floats
    _axis: Any = None
    #: Steps of Newton's method, and the largest miss that they begin with [m, rad].
    _steps, _near = STEPS, NEAR
    _last_turning: int

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = TOLERANCE
    ) -> IKSolutions:
        """Compute every posture that brings the tip to a pose.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4).
            seed: Posture [rad, m], shape (n,). With it, joints that turn are in the winding nearest to it, and the
                solutions are sorted by distance from it.
            limits: Leave out what the joint limits forbid.
            tol: Where a pose is out of reach, the most by which a posture may miss it [m, rad], 1e-9 to 1.

        Returns:
            The solutions, or the reason why there is none.

        Raises:
            InputError: `T` is not a finite rigid motion, or the seed is malformed.
        """
        start, tol = self._posture_or_none(seed), check_tolerance(tol)
        pose = rigid_pose(T)
        near = np.zeros(self.n) if start is None else start
        found = self._find(pose, near)
        places = self._polished(np.reshape(found.q, (-1, self.n)), pose)
        rows = np.column_stack([found.branch, found.flags, places])
        errors = self._errors, (0, pose)
        rows = rows[(self._errors((0, pose), rows) <= tol).all(axis=1)]
        if not len(rows):
            return IKSolutions(rows, Status.OUT_OF_REACH, found.reason or self._why(pose), errors)
        wide = np.full(self.n, np.inf)
        ends = (self.lower, self.upper) if limits else (-wide, wide)
        wound, within = nearest_windings(rows[:, ANGLES].T, near[:, None], *ends, turns=~self.slides)
        kept = rows.copy()
        kept[:, ANGLES] = wound.T
        kept = kept[within]
        if not len(kept):
            return IKSolutions(kept, Status.OUT_OF_LIMITS, self._all_outside(rows), errors)
        if start is not None:
            kept = kept[np.argsort(np.linalg.norm(kept[:, ANGLES] - start, axis=1), kind="stable")]
        return IKSolutions(kept, Status.OK, "", errors)

    def _solve_position(self, goal: PositionGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = self.as_posture("seed", seed)
        pose = self.fk(start)
        pose[:3, 3] = goal.position
        if self._axis is None:
            return self._nearest_of(goal, pose[None], start, accept)
        found = self._find(pose, start, hold=True)
        poses = self.fk(np.reshape(found.q, (-1, self.n)))
        poses[:, :3, 3] = goal.position
        return self._nearest_of(goal, poses, start, accept, keeps=self._last_turning, reason=found.reason)

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = self.as_posture("seed", seed)
        axis = self._axis
        if axis is not None:
            now, wanted = (z - axis * (axis @ z) for z in (self._still[:3, 2], goal.axis))
            if min(np.linalg.norm(now), np.linalg.norm(wanted)) < NOT_TURNED:  # no turn about its axis changes it
                held = self._solve_position(PositionGoal(goal.position), start, accept)
                return self._with_direction(goal, held)
            heading = float(np.arctan2(axis @ np.cross(now, wanted), now @ wanted))
            pose = self._still.copy()
            pose[:3, :3] = turn(axis, heading) @ pose[:3, :3]
            pose[:3, 3] = goal.position
            return self._with_direction(goal, self._nearest_of(goal, pose[None], start, accept))
        if self.n < POSE_JOINTS:
            raise InputError(self.unsolved)
        turns = turns_and_own(TURNS, goal.axis, self.fk(start))
        return self._nearest_of(goal, poses_about(goal.position, goal.axis, turns), start, accept)

    def _with_direction(self, goal: AxisGoal, found: IKResult) -> IKResult:
        """A result for a goal's position, which has its direction, too, or says that it cannot."""
        position, left = goal.error(self.fk(found.q))
        found = replace(found, position_error=position, orientation_error=left)
        if not found.success or left <= Tolerance().orientation:
            return found
        reason = f"its joints leave {left:.3g} rad of this direction"
        return replace(found, status=Status.OUT_OF_REACH, reason=reason, branch=-1)

    def _nearest_of(
        self,
        goal: Goal,
        poses: Floats,
        start: Floats,
        accept: Accept | None,
        *,
        keeps: int | None = None,
        reason: str = "",
    ) -> IKResult:
        """The accepted posture of several poses (m, 4, 4) that is nearest to the start, with the value of a joint."""
        check_accept(accept)
        every = [self.all_solutions(pose, seed=start) for pose in poses]
        found = [each for one in every for each in one if keeps is None or abs(each.q[keeps] - start[keeps]) < KEPT]
        found.sort(key=lambda each: float(np.linalg.norm(each.q - start)))
        for each in found:
            if accept is None or accept(each.q.copy()):
                return IKResult.of(self, goal, each.q, branch=each.branch)
        if found:
            status, reason = Status.REJECTED, f"accept refused all {len(found)} postures"
            return IKResult(found[0].q, status, *goal.error(self.fk(found[0].q)), reason)
        limited = any(one.status is Status.OUT_OF_LIMITS for one in every)
        status = Status.OUT_OF_LIMITS if limited else Status.OUT_OF_REACH
        reason = next((one.reason for one in every if one.status is status), reason)
        return IKResult(start.copy(), status, *goal.error(self.fk(start)), reason)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = TOLERANCE) -> IKBatch:
        """Compute every posture of many poses, one after the other; as `ClosedFormKinematics.batch`."""
        if is_tensor(T):
            return self._tensor_batch(T, check_tolerance(tol), limits=limits)
        T = rigid_poses(as_floats("T", T))
        if not len(T):
            return IKBatch(np.empty((0, self.branches, self.n)), np.empty((0, self.branches), dtype=np.bool_))
        return self._few(T, check_tolerance(tol), limits=limits)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = TOLERANCE) -> IKBatchNearest:
        """Compute the posture nearest to its seed for many poses; as `ClosedFormKinematics.nearest_batch`."""
        T = as_floats("T", T)
        start = self._as_seeds(seeds, len(np.atleast_1d(T)))
        return self._few_nearest(T, start, tol)

    def _polished(self, q: Floats, T: Floats) -> Floats:
        """Postures (k, n) after steps of Newton's method: next to a singular one an arc cosine has half its digits."""
        for _ in range(self._steps if len(q) else 0):
            errors = [small_motion(T, pose) for pose in self.chain.fk(q)]
            off = np.abs(errors).max(axis=1)
            for row in np.flatnonzero((off > EXACT) & (off < self._near)):
                q[row] += np.linalg.lstsq(self.chain.jacobian(q[row : row + 1])[0], errors[row], rcond=FREE)[0]
        return q

    def _errors(self, goal: tuple[int, Floats], rows: Floats) -> Floats:
        T = goal[1]
        poses = self.chain.fk(np.ascontiguousarray(rows[:, ANGLES]))
        turned_by = [rotation_angle(pose[:3, :3], T[:3, :3]) for pose in poses]
        return np.column_stack([np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1), turned_by])

    def _heading(self, T: Floats) -> float:
        """The turn about the one axis that brings the tip nearest to an orientation: other turns do not matter."""
        axis, R = self._axis, T[:3, :3] @ self._still[:3, :3].T
        return float(np.arctan2(2.0 * axis @ small_motion(T, self._still)[3:], np.trace(R) - axis @ R @ axis))

    def _all_outside(self, rows: Floats) -> str:
        q, _ = nearest_windings(rows[:, ANGLES].T, 0.0, self.lower, self.upper, turns=~self.slides)
        past = past_limits(q.T, self.lower, self.upper)
        blocked = [name for name, out in zip(self.arm.joints, past.T, strict=True) if out.any()]
        return f"all {len(rows)} postures are outside the joint limits ({', '.join(blocked)})"

    def _why(self, T: Floats) -> str:
        return "its joints cannot turn the tip to this orientation"


def elbow_bend(upper: complex, fore: complex, way: complex) -> tuple[float, float, float]:
    """How far two links of a plane are bent that go a way together, and by how much it is too far and too close.

    Returns:
        The angle between the links, 0 where they are stretched or nearly reach and pi where they are folded [rad]; the
        two lengths [m], which are negative where the way is within reach.
    """
    long, short, length = abs(upper), abs(fore), abs(way)
    cosine = (length**2 - long**2 - short**2) / (2.0 * long * short)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0))), length - long - short, abs(long - short) - length


def how_far(far: float, close: float) -> str:
    """Say by how much `elbow_bend` misses; empty if it does not."""
    if max(far, close) <= NOWHERE:
        return ""
    return f"{far:.3g} m too far from" if far > close else f"{close:.3g} m too close to"

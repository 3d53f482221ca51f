"""Kinematics of SCARAs and gantries, whose joints turn or slide, in closed form; what palletizers share with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_floats, check_tolerance, is_tensor
from kinreach._rotations import rotation_angle, small_motion, turn, turns_about_z, wrapped
from kinreach.errors import InputError
from kinreach.kinematics._arm import POSE_JOINTS
from kinreach.kinematics._chain import TURNS, poses_about
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

#: How far axes may be from parallel, by the sine of their angle, and slides from a plane, by their volume.
PARALLEL, FLAT = 1e-6, 1e-3
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
        return self._nearest_of(goal, poses_about(goal.position, goal.axis, TURNS), start, accept)

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


class SlidingKinematics(ByGeometry):
    """Kinematics of a SCARA, or of a gantry with a wrist. Threads may share an instance.

    A SCARA has three joints that turn about parallel axes, and one that slides along them, in any order. Its postures
    are two, by the side of its elbow. A gantry has three joints that slide, and on them up to three that turn. Its
    postures are two with three joints that turn, by the side of its wrist, else one. With fewer, and for a SCARA, a
    pose has postures only if its orientation is one that the arm can have.

    Postures miss their pose by less than 1e-9 m and rad. Where a pose is singular, a joint that is free keeps the
    seed's value, or is at 0. For a `PositionGoal` a SCARA's last joint that turns keeps the seed's value, of a gantry
    every joint that turns. For an `AxisGoal` a gantry with three of them tries turns about the direction in steps of
    3 degrees.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: As in `ArmKinematics`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm is neither.
    """

    unsolved = (
        "a gantry with fewer than three joints that turn has a closed form for poses and positions; give a PoseGoal, "
        "or use a numeric solver"
    )

    def _prepare(self) -> None:
        slides, self._still = self.slides, self.chain.fk(np.zeros((1, self.n)))[0]
        J = self.chain.jacobian(np.zeros((1, self.n)))[0]
        self._ways = J[:3]
        if len(self.moves) == self.n == 4 and slides.sum() == 1 and self._is_scara(J):
            self.branches, self._find = 2, self._scara_postures
        elif len(self.moves) == self.n <= 6 and slides[:3].all() and slides.sum() == 3:
            if abs(np.linalg.det(J[:3, :3])) < FLAT:
                raise InputError(f"arm {self.arm.name!r}: the three slides move it in a plane, or nearly")
            self._turns = self._wrist()
            self.branches, self._find = 1 + (self.n == 6), self._gantry_postures
        else:
            raise InputError(
                f"arm {self.arm.name!r}: of arms with slides, SCARAs have a closed form (three parallel axes "
                f"and a slide along them), and three slides with a wrist; with {self._sliding_names} held, others may"
            )

    @property
    def _sliding_names(self) -> str:
        return ", ".join(name for name, slides in zip(self.arm.joints, self.slides, strict=True) if slides)

    def _is_scara(self, J: Floats) -> bool:
        axes = np.where(self.slides, J[:3], J[3:]).T
        first = axes[0]
        if np.linalg.norm(np.cross(axes, first), axis=1).max() > PARALLEL:
            return False
        self._axis, self._sign = first, np.where(axes @ first > 0.0, 1.0, -1.0)
        across = np.linalg.svd(first[None])[2][1:]
        across = across if np.linalg.det(np.vstack([across, first])) > 0.0 else across[::-1]
        self._plane = across[0] + 1j * across[1]  # of a point, as a complex number
        turning = np.flatnonzero(~self.slides)
        # a joint moves the tip by axis x (tip - its own axis)
        radii = [self._sign[i] * 1j * -(self._plane @ self._ways[:, i]) for i in turning]
        tip = complex(self._plane @ self._still[:3, 3])
        shoulder, elbow, wrist = (tip - radius for radius in radii)
        self._last_turning = int(turning[2])
        self._shoulder, self._links = shoulder, (elbow - shoulder, wrist - elbow, tip - wrist)
        if min(map(abs, self._links[:2])) < NOWHERE:
            raise InputError(f"arm {self.arm.name!r}: two of its three axes are one")
        return True

    def _wrist(self) -> Floats:
        """Rotations B0 to Bm of the tip, R = B0 Rz(q4) B1 Rz(q5) ... Bm, shape (m + 1, 3, 3)."""
        A, found = self.chain.placements[:, :3, :3], [np.eye(3)]
        for joint, rotation in enumerate(A):
            found[-1] = found[-1] @ rotation
            if 3 <= joint < self.n:
                found.append(np.eye(3))
        return np.array(found)

    def _scara_postures(self, T: Floats, near: Floats, *, hold: bool = False) -> Found:
        """Postures of a pose; with `hold` of its point, and the last joint that turns keeps its value."""
        heading = self._heading(T)
        target = complex(self._plane @ T[:3, 3])
        turning = np.flatnonzero(~self.slides)
        upper, fore, hand = self._links
        held = float(self._sign[self._last_turning] * near[self._last_turning])
        if hold:
            fore, hand = fore + np.exp(1j * held) * hand, 0j
            if abs(fore) < NOWHERE:
                return Found([], [], [], f"with {self.arm.joints[self._last_turning]} there the tip is on another axis")
        way = target - self._shoulder - np.exp(1j * heading) * hand
        between = np.conj(upper) * fore
        cosine = (abs(way) ** 2 - abs(upper) ** 2 - abs(fore) ** 2) / (2.0 * abs(between))
        far, close = abs(way) - abs(upper) - abs(fore), abs(abs(upper) - abs(fore)) - abs(way)
        reason = ""
        if max(far, close) > NOWHERE:
            what = f"{far:.3g} m too far from" if far > close else f"{close:.3g} m too close to"
            reason = f"the goal is {what} the axis of {self.arm.joints[int(np.flatnonzero(~self.slides)[0])]}"
        bend, straight = float(np.arccos(np.clip(cosine, -1.0, 1.0))), abs(cosine) >= 1.0
        slide = int(np.flatnonzero(self.slides)[0])
        found = Found([], [], [], reason)
        for branch, angle in enumerate((bend,) if straight else (bend, -bend)):
            second = angle - np.angle(between)
            arm = upper + np.exp(1j * second) * fore
            free = abs(way) < NOWHERE
            first = self._sign[turning[0]] * near[turning[0]] if free else np.angle(way / arm)
            q = np.zeros(self.n)
            third = held if hold else heading - first - second
            q[turning] = self._sign[turning] * wrapped(np.array([first, second, third]))
            q[slide] = self._sign[slide] * (self._axis @ (T[:3, 3] - self._still[:3, 3]))
            found.branch.append(branch)
            found.flags.append(SINGULAR if free or straight else 0)
            found.q.append(q)
        return found

    def _gantry_postures(self, T: Floats, near: Floats) -> Found:
        B = self._turns
        G = B[0].T @ T[:3, :3] @ B[-1].T
        found = Found([], [], [])
        for branch, (angles, free) in enumerate(_wrist_angles(G, B[1:-1], near[3:])):
            q = np.concatenate([np.zeros(3), angles])
            beside = T[:3, 3] - self.chain.fk(q[None])[0, :3, 3]
            q[:3] = np.linalg.solve(self._ways[:, :3], beside)
            found.branch.append(branch)
            found.flags.append(SINGULAR if free else 0)
            found.q.append(q)
        return found


def _wrist_angles(G: Floats, B: Floats, near: Floats) -> list[tuple[Floats, bool]]:
    """Angles with which Rz(a) B[0] Rz(b) B[1] Rz(c) is a rotation, or as near as it gets, and whether one is free.

    Args:
        G: The rotation, shape (3, 3).
        B: Between the joints, shape (joints - 1, 3, 3).
        near: Values of joints that are free, shape (joints,).
    """
    if not len(near):
        return [(np.empty(0), False)]
    if len(near) == 1:
        return [(np.array([_about_z(G)]), False)]
    if len(near) == 2:
        middle, others = B[0], [(np.empty(0), np.eye(3))]
    else:
        u, v = B[0][2], B[1][:, 2]  # G's last entry is u Rz(b) v
        along, across = u[0] * v[0] + u[1] * v[1], u[1] * v[0] - u[0] * v[1]
        size = np.hypot(along, across)
        if size < NOWHERE:
            bends = [float(near[1])]
        else:
            bend = np.arccos(np.clip((G[2, 2] - u[2] * v[2]) / size, -1.0, 1.0))
            bends = [float(np.arctan2(across, along) + side) for side in ((bend, -bend) if bend % np.pi else (bend,))]
        middle = B[1]
        others = [(np.array([b]), B[0] @ _rz(b)) for b in bends]
    found = []
    for known, before in others:
        M = before @ middle  # what the first joint turns, whose z axis is to be G's
        free = min(np.hypot(*M[:2, 2]), np.hypot(*G[:2, 2])) < NOWHERE
        a = float(near[0]) if free else float(np.arctan2(G[1, 2], G[0, 2]) - np.arctan2(M[1, 2], M[0, 2]))
        c = _about_z((_rz(a) @ M).T @ G)
        found.append((wrapped(np.concatenate([[a], known, [c]])), free))
    return found


def _rz(angle: float) -> Floats:
    return turns_about_z(np.array([angle]))[0, :3, :3]


def _about_z(R: Floats) -> float:
    """The turn about z that is nearest to a rotation [rad]."""
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))

"""Kinematics of arms with five revolute joints, or four: the point exactly, the orientation as near as it goes.

The core searches (`_core/nearest_orientation.c`, `_core/pitched.c`). Postures with the tip at a point are a surface for
five joints, a curve for four. On it the orientation error has minima, saddles and maxima; joint limits cut it, and add
minima at their edge. All of them are found, and polished by Newton's method until they are stationary to rounding.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import degrees, inf
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_DISTANCE,
    Floats,
    as_floats,
    as_pose,
    as_vector,
    check_entries,
    check_number,
    check_tolerance,
    is_tensor,
)
from kinreach.errors import InputError
from kinreach.kinematics._closed_form import TOLERANCE, ClosedFormKinematics
from kinreach.kinematics._core import NULL, Struct, doubles, lib
from kinreach.kinematics._goals import (
    AxisGoal,
    NearestOrientationGoal,
    PoseGoal,
    PositionGoal,
    rigid_pose,
    rigid_poses,
)
from kinreach.kinematics._solutions import (
    ANGLES,
    FLAGS,
    Accept,
    IKBatch,
    IKBatchNearest,
    IKResult,
    IKSolutions,
    Status,
    Tolerance,
    check_accept,
    known_errors,
)

#: What a stationary orientation error is, by its number in the core.
KINDS = ("minimum", "saddle", "maximum", "minimum at a limit")
MINIMA = (0.0, 3.0)
#: What counts of a pose, by its number in the core.
ORIENTATION, AXIS = 0, 1
#: Directions all around, to the faces, edges and corners of a cube, not normalised.
DIRECTIONS = [axis for axis in product((-1.0, 0.0, 1.0), repeat=3) if any(axis)]
#: Poses beside one, as differences, for a tolerance of 1 m.
BESIDE = np.zeros((6, 4, 4))
BESIDE[:, :3, 3] = 0.9 * np.concatenate([np.eye(3), -np.eye(3)])


class NearestSolutions(IKSolutions):
    """Postures with the tip at a point, at which what is left of its orientation is stationary; the least first.

    Of those that leave the same, the nearest to the seed comes first. `residual` has what is left beside the error of
    the position.
    """

    __slots__ = ()

    @property
    def kind(self) -> tuple[str, ...]:
        """What is left of each among all postures with the tip there: "minimum", "saddle" or "maximum".

        Or "minimum at a limit", where a joint's limit keeps it from becoming less.
        """
        return tuple(KINDS[int(kind)] for kind in self.rows[:, FLAGS])

    @property
    def left(self) -> Floats:
        """Angle that is left of the orientation, or of the direction [rad], shape (k,)."""
        return self.residual[:, 1]

    @property
    def minima(self) -> NearestSolutions:
        """Those of the kinds "minimum" and "minimum at a limit"."""
        chosen, residual = np.isin(self.rows[:, FLAGS], MINIMA), self.residual
        return type(self)(self.rows[chosen], self.status, self.reason, (known_errors, residual[chosen]))

    @property
    def singularity(self) -> NDArray[np.int64]:
        """Zeros, shape (k,): no posture is clamped or moved."""
        return np.zeros(len(self), dtype=np.int64)


class FiveAxisKinematics(ClosedFormKinematics):
    """Kinematics of an arm with five revolute joints, or four. Threads may share an instance.

    Such an arm brings its tip to a point, and cannot choose all of its orientation. Postures meet the point to 1e-9 m,
    and what is left of the orientation is as little as it can be: `all_solutions` lists every posture at which it is
    stationary. `axis_solutions` does the same for the direction of the tip's z axis alone.

    `solve` meets a `NearestOrientationGoal` by the posture that leaves least of the orientation, a `PositionGoal` by
    the one that leaves least of the seed's; if `accept` refuses that, by the nearest accepted one that leaves least of
    one of 26 directions all around. A `PoseGoal` or an `AxisGoal` has to be met exactly; if the arm cannot,
    the result has the posture that leaves least, and its reason says how much.

    Arms whose axes 2, 3 and 4 are parallel (SO-101, Koch, WidowX, ViperX, xArm5) are solved in closed form but for one
    angle, which is searched; others by a search over two angles, 100 to 400 times slower.

    Args:
        arm: Name of a registered arm, or a description.
        tip: Short name of the tip frame; default is the arm's own tool centre point.
        base: `"base_link"` or `"world"`.

    Raises:
        UnknownNameError: The arm, the tip or the base does not exist.
        InputError: The arm has another number of joints, or they move the tip in less than three directions.

    Examples:
        >>> import numpy as np
        >>> from kinreach.kinematics import ArmKinematics
        >>> kin = ArmKinematics.of("so101")
        >>> found = kin.all_solutions(kin.fk(np.full(5, 0.3)))
        >>> found.kind[0], bool(found.left[0] < 1e-9)
        ('minimum', True)
    """

    joints, branches = 5, lib.KR_MAX_STATIONARY
    #: Numbers of joints of such arms.
    counts: ClassVar[tuple[int, ...]] = (4, 5)

    def _prepare(self) -> None:
        super()._prepare()
        if self.n not in self.counts:
            raise InputError(f"arm {self.arm.name!r} has {self.n} joints; four or five are needed")
        self._five = Struct("kr_five_axis")
        if not lib.kr_five_axis_prepare(self._core.pointer, self._five.pointer):
            raise InputError(
                f"arm {self.arm.name!r} is singular in every posture: its joints do not move the tip freely"
            )

    @property
    def solved(self) -> str:
        """How postures are found: by a search over one angle, or over two."""
        return "by a search over one angle" if self._five.pointer.pitched else "by a search over two angles"

    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = TOLERANCE
    ) -> NearestSolutions:
        """Compute every posture with the tip at a pose's point at which what is left of the orientation is stationary.

        Maxima of half a turn are left out.

        Args:
            T: Pose of the tip in the base frame, shape (4, 4); or a position [m], shape (3,), which means the
                orientation of the seed, or of the arm's home.
            seed: Posture [rad], shape (n,). With it, each solution is given in the winding nearest to it.
            limits: Leave out what the joint limits forbid, and add the minima at limits.
            tol: If no posture meets the point exactly, the most by which one may miss it [m], 1e-9 to 1.

        Returns:
            Up to 64 postures with what is left and its kind, the least first; or the reason why there is none.

        Raises:
            InputError: `T` is not a finite rigid motion or position, or the seed is malformed.
        """
        start = self._posture_or_none(seed)
        return self._stationary(ORIENTATION, self._pose_of(T, start), start, limits, check_tolerance(tol))

    def axis_solutions(
        self,
        position: ArrayLike,
        axis: ArrayLike,
        *,
        seed: ArrayLike | None = None,
        limits: bool = True,
        tol: float = TOLERANCE,
    ) -> NearestSolutions:
        """Compute every posture with the tip at a point at which the angle of its z axis to a direction is stationary.

        Args:
            position: In the base frame [m], shape (3,).
            axis: Direction of the tip's z axis in the base frame, shape (3,); need not be normalised.
            seed: As in `all_solutions`; a last joint that only turns the tip about its z axis takes its value.
            limits: As in `all_solutions`.
            tol: As in `all_solutions`.

        Raises:
            InputError: Malformed input.
        """
        goal = AxisGoal(position, axis)  # type: ignore[arg-type]
        return self._along(goal, self._posture_or_none(seed), limits, check_tolerance(tol))

    def _along(self, goal: AxisGoal, start: Floats | None, limits: bool, tol: float) -> NearestSolutions:
        T = np.eye(4)
        T[:3, 2], T[:3, 3] = goal.axis, goal.position
        return self._stationary(AXIS, T, start, limits, tol)

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None, margin: float = 0.0) -> IKResult:
        """Compute the posture with the tip at a pose's point that leaves least of the orientation.

        Args:
            T: As in `all_solutions`.
            seed: Posture [rad], shape (n,). Of the postures that leave the same, the nearest to it is returned.
            accept: Called with minima, the least first, until it returns True.
            margin: How much more than the least may be left [rad], for a posture that is nearer to the seed: any
                minimum with `math.inf`. An arm that follows a path does not jump then.

        Raises:
            InputError: As `all_solutions`, or a negative margin.
        """
        start = self.as_posture("seed", seed)
        margin = check_number("margin", margin, least=0.0) if margin != inf else inf
        return self._first(self.all_solutions(T, seed=start), start, accept, margin)

    def _solve_nearest_orientation(
        self, goal: NearestOrientationGoal, seed: ArrayLike, accept: Accept | None
    ) -> IKResult:
        return self.nearest(goal.T, seed, accept=accept)

    def _solve_pose(self, goal: PoseGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = self.as_posture("seed", seed)
        return self._exactly(self.all_solutions(goal.T, seed=start), start, accept)

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = np.ascontiguousarray(self.as_posture("seed", seed))
        return self._exactly(self._along(goal, start, True, TOLERANCE), start, accept)

    def _solve_position(self, goal: PositionGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        start = self.as_posture("seed", seed)
        found = self.nearest(goal.position, start)
        if found.success and accept is not None and not accept(found.q.copy()):
            found = self._in_any_direction(goal, start, accept) or self.nearest(goal.position, start, accept=accept)
        return IKResult.of(self, goal, found.q, branch=found.branch) if found.success else found

    def _in_any_direction(self, goal: PositionGoal, seed: Floats, accept: Accept) -> IKResult | None:
        """The accepted posture nearest to the seed, of those that leave least of one of `DIRECTIONS`."""
        every = [self.axis_solutions(goal.position, axis, seed=seed).minima for axis in DIRECTIONS]
        found = [posture for minima in every for posture in minima]
        found.sort(key=lambda posture: float(np.linalg.norm(posture.q - seed)))
        return next((posture for posture in found if accept(posture.q.copy())), None)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = TOLERANCE) -> IKBatch:
        """Compute every stationary posture of many poses, the least first; as `ClosedFormKinematics.batch`."""
        if is_tensor(T):
            return self._tensor_batch(T, check_tolerance(tol), limits=limits)
        poses, tol = self._poses_of(T, np.array(self.arm.home)), check_tolerance(tol)
        q = np.full((len(poses), self.branches, self.n), np.nan)
        valid = np.zeros(q.shape[:2], dtype=np.bool_)
        for row, pose in enumerate(poses):
            found = self._stationary(ORIENTATION, pose, None, limits, tol).q
            q[row, : len(found)], valid[row, : len(found)] = found, True
        return IKBatch(q, valid)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = TOLERANCE) -> IKBatchNearest:
        """Compute `nearest` for each of many poses; as `ClosedFormKinematics.nearest_batch`."""
        start, tol = self._as_seeds(seeds, len(np.atleast_1d(as_floats("T", T)))), check_tolerance(tol)
        poses = self._poses_of(T, start)
        q, branch = np.full((len(poses), self.n), np.nan), np.full(len(poses), -1, dtype=np.int64)
        for row, (pose, seed) in enumerate(zip(poses, start, strict=True)):
            found = self._stationary(ORIENTATION, pose, np.ascontiguousarray(seed), True, tol).minima
            if found:
                q[row], branch[row] = found.q[0], found.branch[0]
        return IKBatchNearest(q, branch, branch >= 0)

    def _poses_of(self, T: ArrayLike, start: Floats) -> Floats:
        """Poses, of positions with the orientation of start postures (n,) or (count, n)."""
        given = as_floats("T", T)
        if given.ndim != 2 or given.shape[1] != 3:
            return rigid_poses(given)
        check_entries("T", given, MAX_DISTANCE)
        poses = np.tile(np.eye(4), (len(given), 1, 1))
        poses[:] = self.fk(start)
        poses[:, :3, 3] = given
        return poses

    def _pose_of(self, T: ArrayLike, start: Floats | None) -> Floats:
        given = as_floats("T", T)
        if given.shape != (3,):
            return np.ascontiguousarray(given) if given.shape == (4, 4) else as_pose("T", given)
        pose = self.fk(np.array(self.arm.home) if start is None else start)
        pose[:3, 3] = as_vector("T", given, 3, most=MAX_DISTANCE)
        return pose

    def _stationary(
        self, kind: int, T: Floats, start: Floats | None, limits: bool, tol: float, *, exact: bool = False
    ) -> NearestSolutions:
        """Postures of a pose (4, 4), which is checked, and made exact to rounding, if the core says that it is not."""
        rows, errors = np.empty((self.branches, self.n + ANGLES.start)), np.empty((self.branches, 2))
        near = NULL if start is None else doubles(start)

        def count_at(pose: Floats) -> int:
            given = self._five.pointer, self._core.pointer, kind, doubles(pose)
            return int(lib.kr_nearest_orientations(*given, near, limits, doubles(rows), doubles(errors)))

        count = count_at(T)
        if count < 0 and not exact:
            return self._stationary(kind, np.ascontiguousarray(rigid_pose(T)), start, limits, tol, exact=True)
        if not count:  # at the very edge of reach rounding decides
            count = next(filter(None, map(count_at, T + tol * BESIDE)), 0)
            errors = self._errors((kind, T), rows[:count])
        if count > 0:
            return NearestSolutions(rows[:count], Status.OK, "", (known_errors, errors[:count]))
        miss = self._errors, (kind, T)
        if limits and (every := self._stationary(kind, T, None, False, tol)):
            return NearestSolutions(rows[:0], Status.OUT_OF_LIMITS, self._all_outside(every.rows), miss)
        return NearestSolutions(rows[:0], Status.OUT_OF_REACH, self._too_far(T[:3, 3]), miss)

    def _too_far(self, position: Floats) -> str:
        first = (self.T_base_world @ self.model.jointPlacements[1].homogeneous)[:3, 3]
        away = float(np.linalg.norm(position - first))
        return f"the tip does not come to this point, {away:.3f} m from {self.arm.joints[0]}"

    def _first(self, solutions: NearestSolutions, seed: Floats, accept: Accept | None, margin: float) -> IKResult:
        """The first minimum that the caller accepts: by what is left, and within a margin of the least by distance."""
        check_accept(accept)
        if not len(solutions):
            position, orientation = solutions.errors(np.array([[0.0, 0.0, *seed]]))[0].tolist()
            return IKResult(seed.copy(), solutions.status, position, orientation, solutions.reason)
        kinds = solutions.rows[:, FLAGS].tolist()
        order = [index for index, kind in enumerate(kinds) if kind in MINIMA] or list(range(len(kinds)))
        if margin > 0.0:
            left, away = solutions.left[order], np.linalg.norm(solutions.q[order] - seed, axis=1)
            order = np.array(order)[np.lexsort([away, np.where(left <= left[0] + margin, 0.0, left)])].tolist()
        for index in order:
            found = solutions[index]
            if accept is None or accept(found.q.copy()):
                return found
        reason = f"accept refused all {len(order)} postures"
        return replace(solutions[order[0]], status=Status.REJECTED, reason=reason, branch=-1)

    def _exactly(self, solutions: NearestSolutions, seed: Floats, accept: Accept | None) -> IKResult:
        found = self._first(solutions, seed, accept, 0.0)
        if found.position_error > Tolerance().position or found.orientation_error <= Tolerance().orientation:
            return found
        left = found.orientation_error
        reason = f"{self.n} joints leave {left:.3g} rad ({degrees(left):.1f} degrees) of the orientation at this point"
        return IKResult(found.q, Status.OUT_OF_REACH, found.position_error, left, reason)

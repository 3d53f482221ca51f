"""Limits, windings and batches of every arm with a closed-form inverse kinematics, without the formulas."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import pi
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_ANGLE,
    Floats,
    as_floats,
    check_entries,
    check_tolerance,
    is_tensor,
    torch_module,
)
from kinreach._rotations import TURN
from kinreach._tensors import blocks, like, namespace, on_host
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._chain import about_z
from kinreach.kinematics._core import NULL, Struct, doubles, lib
from kinreach.kinematics._goals import AxisGoal, Goal, NearestOrientationGoal, PoseGoal, SolvesGoals, check_goal
from kinreach.kinematics._solutions import (
    ANGLES,
    BRANCH,
    NEAR_LIMIT,
    SLACK,
    Accept,
    IKBatch,
    IKBatchNearest,
    IKResult,
    IKSolutions,
    Row,
    Status,
    check_accept,
    nearest_windings,
    past_limits,
)

#: By how much a clamped posture may miss, unless the caller says it [m, rad].
TOLERANCE = 1e-7
#: What is asked of the tip, as the core has it.
CoreGoal = tuple[int, Floats]
#: Up to so many poses are solved one by one: a batch takes as long for two as for fifteen.
FEW_POSES = 8
#: Turns about the tip's z axis that are tried where the last joint does not do them alone [rad].
TURNS_ABOUT = np.linspace(-np.pi, np.pi, 36, endpoint=False)


class ClosedFormKinematics(SolvesGoals, ArmKinematics):
    """Limits, windings and the choice of a branch, shared by the arms with a closed form.

    Attributes:
        joints: How many joints the arms have that this closed form is for.
        branches: Most postures of a pose.
    """

    joints: ClassVar[int]
    branches: int
    _closed_forms: ClassVar = {}
    knows_all_postures = True

    def _prepare(self) -> None:
        self._check_turns_alone()
        self._low: list[float] = self.lower.tolist()
        self._high: list[float] = self.upper.tolist()
        # where every joint covers a full turn, a principal value is always within the limits,
        # and where it covers no more than that, the only one there is (its two ends apart)
        self._full_turn = bool((self.lower <= -pi + SLACK).all() and (self.upper >= pi - SLACK).all())
        one_turn = self._full_turn and bool((self.upper - self.lower <= TURN + SLACK).all())
        placements, axes = self._joint_frames()
        placements[0] = self.T_base_world @ placements[0]
        self._placements = about_z(placements, axes, self.model.frames[self.tip_frame].placement.homogeneous)
        self._core = Struct(
            "kr_arm", n=self.n, full_turn=self._full_turn, one_turn=one_turn, lower=self._low, upper=self._high,
            placements=self._placements[:, :3].ravel().tolist(),
        )  # fmt: skip

    @property
    def has_named_branches(self) -> bool:
        """Whether a branch index says how the arm is bent, at every pose; else it only counts the postures of one."""
        return True

    def branch_words(self, branch: int) -> tuple[str, ...]:
        """Return words for how the arm is bent in a branch, by its index; none where there are no words."""
        return ()

    @abstractmethod
    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = TOLERANCE
    ) -> IKSolutions:
        """Compute every posture that reaches a goal."""

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a goal that is nearest to a seed, over all branches and windings.

        Args:
            T: Goal as in `all_solutions`.
            seed: Posture [rad], shape (n,).
            accept: Called with candidates in the order of their distance until it returns True.

        Raises:
            InputError: As `all_solutions`.
        """
        start = self.as_posture("seed", seed)
        return self._choose(self.all_solutions(T, seed=start), start, accept)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = TOLERANCE) -> IKBatch:
        """Compute every posture of many poses.

        Args:
            T: Goals in the base frame: poses of the tip, shape (count, 4, 4), or for a 3-DOF arm positions (count, 3).
            limits: Leave out what the joint limits forbid.
            tol: As in `all_solutions`.

        Returns:
            Postures, and which exist; as tensors on the device of `T` and in its precision where `T` is a tensor of
            torch. Nothing is differentiated here: the gradient of a solution is the inverse of `jacobian`.

        Raises:
            InputError: A pose is not a finite rigid motion; the message has its index.
        """
        if is_tensor(T):
            return self._tensor_batch(T, check_tolerance(tol), limits=limits)
        T, tol = as_floats("T", T), check_tolerance(tol)
        if T.ndim > 1 and 0 < len(T) <= FEW_POSES:
            with suppress(InputError):  # the batch names the pose that is refused
                return self._few(T, tol, limits=limits)
        q, valid = self._batch(T, None, tol, limits=limits)
        return self._batch_within(T, q, valid, tol, limits=limits)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = TOLERANCE) -> IKBatchNearest:
        """Compute for each of many poses the posture nearest to its seed, over all branches and windings.

        Args:
            T: Goals in the base frame: poses of the tip, shape (count, 4, 4), or for a 3-DOF arm positions (count, 3).
            seeds: Postures [rad], shape (count, n), or (n,) for all.
            tol: As in `all_solutions`.

        Raises:
            InputError: Malformed poses or seeds.
        """
        T = as_floats("T", T)
        count = len(np.atleast_1d(T))
        start, tol = self._as_seeds(seeds, count), check_tolerance(tol)
        if T.ndim > 1 and 0 < count <= FEW_POSES:
            with suppress(InputError):
                return self._few_nearest(T, start, tol)
        q, valid = self._batch(T, start, tol, limits=True)
        chosen, branch = np.empty((count, self.n)), np.empty(count, dtype=np.int64)
        for rows in blocks(count):
            chosen[rows], branch[rows] = self._nearest(T[rows], q[..., rows], valid[..., rows], start[rows], tol)
        return IKBatchNearest(chosen, branch, branch >= 0)

    def _as_seeds(self, seeds: ArrayLike, count: int) -> Floats:
        """Check seeds, one for each of so many poses or one for all; return one for each, shape (count, n)."""
        start = as_floats("seeds", seeds)
        if start.shape not in ((self.n,), (count, self.n)):
            raise InputError(f"seeds must have shape ({count}, {self.n}) or ({self.n},), got {start.shape}")
        check_entries("seeds", start, MAX_ANGLE)
        return start if start.ndim == 2 else np.broadcast_to(start, (count, self.n))

    def _few(self, T: Floats, tol: float, *, limits: bool) -> IKBatch:
        """`batch`, one pose after the other."""
        found = [self.all_solutions(pose, limits=limits, tol=tol).rows for pose in T]
        q, rows = np.full((len(T), self.branches, self.n), np.nan), np.concatenate(found)
        valid = np.zeros(q.shape[:2], dtype=np.bool_)
        slots = np.repeat(np.arange(len(T)), [len(each) for each in found]), rows[:, BRANCH].astype(np.int64)
        q[slots], valid[slots] = rows[:, ANGLES], True
        return IKBatch(q, valid)

    def _few_nearest(self, T: Floats, seeds: Floats, tol: float) -> IKBatchNearest:
        """`nearest_batch`, one pose after the other."""
        found = [self.all_solutions(pose, seed=seed, tol=tol) for pose, seed in zip(T, seeds, strict=True)]
        q = np.array([each.q[0] if each else [np.nan] * self.n for each in found]).reshape(-1, self.n)
        branch = np.array([each.branch[0] if each else -1 for each in found], dtype=np.int64)
        return IKBatchNearest(q, branch, branch >= 0)

    def _batch_within(self, T: Any, q: Any, valid: Any, tol: float, *, limits: bool) -> IKBatch:
        """Wind the postures of `_batch` into the limits."""
        if limits and not self._full_turn:
            wound, within, near = self._windings(q, like(q, 0.0), valid)
            q = namespace(q).where(within, wound, np.nan)
            valid = within
            for row in near:
                exact, exists = np.full((self.n, len(valid)), np.nan), np.zeros(len(valid), dtype=np.bool_)
                found = self.all_solutions(on_host(T[row]), tol=tol)
                exact[:, found.branch], exists[found.branch] = found.q.T, True
                q[..., row], valid[..., row] = like(q, exact), like(valid, exists)
        return IKBatch(q.swapaxes(0, 2), valid.T)

    def _windings(self, q: Any, start: Any, valid: Any) -> tuple[Any, Any, NDArray[np.int64]]:
        """Nearest windings, which of them are within the limits, and which poses have one next to a limit."""
        lower, upper = like(q, self.lower), like(q, self.upper)
        shifted, within = nearest_windings(q, start, lower, upper, slack=NEAR_LIMIT)
        axes = (-1, *[1] * (q.ndim - 1))
        past = past_limits(shifted, lower.reshape(axes), upper.reshape(axes))
        near = np.flatnonzero(on_host((past.any(axis=0) & valid & within).any(axis=0)))  # the caller solves them alone
        return shifted, within & valid, near

    def _tensor_batch(self, T: Any, tol: float, *, limits: bool) -> IKBatch:
        """`batch` for a tensor, by way of the processor."""
        found = self.batch(on_host(T), limits=limits, tol=tol)
        tensor = torch_module().tensor
        q = tensor(found.q, dtype=T.dtype if T.is_floating_point() else None, device=T.device)
        return IKBatch(q, tensor(found.valid, device=T.device))

    def _nearest(
        self, T: Floats, q: Floats, valid: NDArray[np.bool_], seeds: Floats, tol: float
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Nearest postures (count, n), NaN where there is none, and their branches (count,), -1 there."""
        start = seeds.T[:, None]
        q, within, near = self._windings(q, start, valid)
        distance = ((q - start) ** 2).sum(axis=0)
        distance[~within] = np.inf
        best = distance.argmin(axis=0)
        columns = np.arange(q.shape[-1])
        found = np.isfinite(distance[best, columns])
        chosen, branch = np.where(found, q[:, best, columns], np.nan).T, np.where(found, best, -1)
        for row in near:
            every = self.all_solutions(T[row], seed=seeds[row], tol=tol)
            chosen[row], branch[row] = (every.q[0], every.branch[0]) if every else (np.nan, -1)
        return chosen, branch

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a goal that is nearest to a seed.

        Args:
            goal: In the base frame, for the tip: a `PoseGoal` or an `AxisGoal`; of a 3-DOF arm a `PositionGoal`.
            seed: Posture [rad], shape (n,).
            accept: Called with candidates in the order of their distance until it returns True.

        Raises:
            InputError: Malformed input, or a kind of goal for which the arm has no closed form.
        """
        return check_goal(goal).solved_by(self, seed, accept)

    def _batch(self, T: Floats, seeds: Floats | None, tol: float, *, limits: bool) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures (n, branches, count), NaN where not valid, and validity (branches, count), before limits.

        With `limits`, what the goal leaves free is chosen so that the posture is within them. Classes with a `batch`
        and a `nearest_batch` of their own need none.
        """
        raise NotImplementedError

    def _solutions(
        self,
        found: Sequence[Row] | Floats,
        unreached: str,
        goal: Goal | Floats,
        seed: Floats | None,
        limits: bool,
        tol: float,
    ) -> IKSolutions:
        """Apply limits and windings; sort by distance where there is a seed."""
        rows = np.array(found, dtype=np.float64).reshape(-1, self.n + ANGLES.start)
        kind, T = core_goal(goal)
        errors = self._errors, (kind, T)
        if not len(rows):
            return IKSolutions(rows, Status.OUT_OF_REACH, unreached, errors)
        kept = rows.copy()
        start = NULL if seed is None else doubles(seed)
        count = lib.kr_within(self._core.pointer, kind, doubles(T), start, limits, tol, doubles(kept), len(kept))
        if not count:
            return IKSolutions(kept[:0], Status.OUT_OF_LIMITS, self._all_outside(rows), errors)
        return IKSolutions(kept[:count], Status.OK, "", errors)

    def _errors(self, goal: CoreGoal, rows: Floats) -> Floats:
        """Position [m] and orientation [rad] errors of rows of postures, shape (k, 2)."""
        errors, (kind, T) = np.empty((len(rows), 2)), goal
        lib.kr_errors(self._core.pointer, kind, doubles(T), doubles(rows), len(rows), doubles(errors))
        return errors

    def _all_outside(self, rows: Floats) -> str:
        """Why no posture of some rows is within the limits."""
        q, _ = nearest_windings(rows[:, ANGLES].T, 0.0, self.lower, self.upper)
        past = (q > self.upper[:, None] + SLACK).any(axis=1)
        blocked = [name for name, out in zip(self.arm.joints, past, strict=True) if out]
        return f"all {len(rows)} postures are outside the joint limits ({', '.join(blocked)})"

    def _choose(self, solutions: IKSolutions, seed: Floats, accept: Accept | None) -> IKResult:
        """Return the first of the sorted solutions that the caller accepts."""
        check_accept(accept)
        for row in solutions.rows:
            q = row[ANGLES].copy()
            if accept is None or accept(q.copy()):
                position, orientation = solutions.errors(row[None])[0].tolist()
                return IKResult(q, Status.OK, position, orientation, branch=int(row[BRANCH]))
        if solutions.success:
            reason = f"accept refused all {len(solutions)} postures"
            return replace(solutions[0], status=Status.REJECTED, reason=reason, branch=-1)
        position, orientation = solutions.errors(np.array([[0.0, 0.0, *seed]]))[0].tolist()
        return IKResult(seed.copy(), solutions.status, position, orientation, solutions.reason)

    def _posture_or_none(self, seed: ArrayLike | None) -> Floats | None:
        return None if seed is None else np.ascontiguousarray(self.as_posture("seed", seed))


def core_goal(goal: Goal | Floats) -> CoreGoal:
    """A goal, or the pose (4, 4) that is one, as the core has it: its kind, and a pose that has what it asks."""
    if isinstance(goal, np.ndarray):
        return 0, np.ascontiguousarray(goal)
    if isinstance(goal, PoseGoal | NearestOrientationGoal):
        return 0, np.ascontiguousarray(goal.T)
    T = goal.frame()
    if isinstance(goal, AxisGoal):
        T[:3, 2] = goal.axis
        return 1, T
    return 2, T

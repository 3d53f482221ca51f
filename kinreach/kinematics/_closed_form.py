"""Limits, windings and batches of every arm with a closed-form inverse kinematics, without the formulas."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property
from itertools import chain
from math import dist, pi
from struct import pack
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import (
    MAX_ANGLE,
    MIN_TOLERANCE,
    Floats,
    as_floats,
    check_entries,
    check_tolerance,
    is_tensor,
    torch_module,
)
from kinreach.errors import InputError
from kinreach.kinematics._angles import TURN
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._chain import blocks
from kinreach.kinematics._goals import Goal, goal_error
from kinreach.kinematics._solutions import (
    ANGLES,
    BRANCH,
    FLAGS,
    NEAR_LIMIT,
    SLACK,
    Accept,
    ErrorOf,
    IKBatch,
    IKBatchNearest,
    IKResult,
    IKSolutions,
    Row,
    Status,
    check_accept,
    nearest_winding,
    nearest_windings,
)
from kinreach.kinematics._tensors import like, namespace, on_host

#: Steps with which a posture is moved into the limits, and the error at which it has arrived [m, rad].
STEPS, ARRIVED = 10, 1e-12
#: Joints that a full pose needs.
POSE_JOINTS = 6
#: Up to so many poses are solved one by one: a batch takes as long for two as for fifteen.
FEW_POSES = 8
#: Turns about the tip's z axis that are tried where the last joint does not do them alone [rad].
TURNS_ABOUT = np.linspace(-np.pi, np.pi, 36, endpoint=False)


class ClosedFormKinematics(ArmKinematics, ABC):
    """Limits, windings and the choice of a branch, shared by the arms with a closed form.

    Attributes:
        joints: How many joints the arms have that this closed form is for.
    """

    joints: ClassVar[int]
    _closed_forms: ClassVar = {}
    knows_all_postures = True

    def _prepare(self) -> None:
        self._low: list[float] = self.lower.tolist()
        self._high: list[float] = self.upper.tolist()
        # where every joint covers a full turn, a principal value is always within the limits,
        # and where it covers no more than that, the only one there is (its two ends apart)
        self._full_turn = bool((self.lower <= -pi + SLACK).all() and (self.upper >= pi - SLACK).all())
        self._one_turn = self._full_turn and bool((self.upper - self.lower <= TURN + SLACK).all())

    @abstractmethod
    def all_solutions(
        self, T: ArrayLike, *, seed: ArrayLike | None = None, limits: bool = True, tol: float = 1e-7
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

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = 1e-7) -> IKBatch:
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
            try:
                return self._few(T, tol, limits=limits)
            except InputError:  # the batch names the pose that is refused
                pass
        q, valid = self._batch(T, None, tol, limits=limits)
        return self._batch_within(T, q, valid, tol, limits=limits)

    def nearest_batch(self, T: ArrayLike, seeds: ArrayLike, *, tol: float = 1e-7) -> IKBatchNearest:
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
        start = as_floats("seeds", seeds)
        if start.shape not in ((self.n,), (count, self.n)):
            raise InputError(f"seeds must have shape ({count}, {self.n}) or ({self.n},), got {start.shape}")
        check_entries("seeds", start, MAX_ANGLE)
        start = np.broadcast_to(start, (count, self.n))
        tol = check_tolerance(tol)
        if T.ndim > 1 and 0 < count <= FEW_POSES:
            with suppress(InputError):
                pairs = zip(T, start, strict=True)
                found = [self.all_solutions(pose, seed=seed, tol=tol).found for pose, seed in pairs]
                q = np.array([rows[0][ANGLES] if rows else [np.nan] * self.n for rows in found])
                branch = np.array([rows[0][BRANCH] if rows else -1 for rows in found])
                return IKBatchNearest(q, branch, branch >= 0)
        q, valid = self._batch(T, start, tol, limits=True)
        chosen, branch = np.empty((count, self.n)), np.empty(count, dtype=np.int64)
        for rows in blocks(count):
            chosen[rows], branch[rows] = self._nearest(T[rows], q[..., rows], valid[..., rows], start[rows], tol)
        return IKBatchNearest(chosen, branch, branch >= 0)

    def _few(self, T: Floats, tol: float, *, limits: bool) -> IKBatch:
        """`batch`, one pose after the other."""
        branches, columns = self._branches, ANGLES.start + self.n
        none: Row = (-1, 0, *[np.nan] * self.n)
        slots: list[Row] = []
        for pose in T:
            found = self._found(pose, tol, limits=limits)  # in the order of the branch index
            if len(found) == branches:
                slots += found
            else:
                some = [none] * branches
                for row in found:
                    some[row[BRANCH]] = row
                slots += some
        packed = pack(f"{columns * len(slots)}d", *chain.from_iterable(slots))  # half the time of an array of a list
        rows = np.frombuffer(bytearray(packed)).reshape(len(T), branches, columns)
        return IKBatch(rows[..., ANGLES], rows[..., BRANCH] >= 0)

    def _found(self, T: Floats, tol: float, *, limits: bool) -> Sequence[Row]:
        """`all_solutions` without a seed, and without the reason where there are none."""
        return self.all_solutions(T, limits=limits, tol=tol).found

    @cached_property
    def _branches(self) -> int:
        """Most postures of a pose."""
        low, high = np.maximum(self.lower, -pi), np.minimum(self.upper, pi)
        T = self.fk(low + np.linspace(0.3, 0.4, self.n) * (high - low))
        return int(self._batch(T[None], None, MIN_TOLERANCE, limits=False)[1].shape[0])

    def _batch_within(self, T: Any, q: Any, valid: Any, tol: float, *, limits: bool) -> IKBatch:
        """Wind the postures of `_batch` into the limits."""
        if limits and not self._full_turn:
            found, within, near = self._windings(q, like(q, 0.0), valid)
            q = namespace(q).where(within, found, np.nan)
            valid = within
            for row in near:
                exact, exists = np.full((self.n, len(valid)), np.nan), np.zeros(len(valid), dtype=np.bool_)
                for branch, _, *angles in self.all_solutions(on_host(T[row]), tol=tol).found:
                    exact[:, branch], exists[branch] = angles, True
                q[..., row], valid[..., row] = like(q, exact), like(valid, exists)
        return IKBatch(q.swapaxes(0, 2), valid.T)

    def _windings(self, q: Any, start: Any, valid: Any) -> tuple[Any, Any, NDArray[np.int64]]:
        """Nearest windings, which of them are within the limits, and which poses have one next to a limit."""
        lower, upper = like(q, self.lower), like(q, self.upper)
        shifted, within = nearest_windings(q, start, lower, upper, slack=NEAR_LIMIT)
        axes = (-1, *[1] * (q.ndim - 1))
        past = (shifted > (upper + SLACK).reshape(axes)) | (shifted < (lower - SLACK).reshape(axes))
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
            rows = self.all_solutions(T[row], seed=seeds[row], tol=tol).found
            chosen[row], branch[row] = (rows[0][ANGLES], rows[0][BRANCH]) if rows else (np.nan, -1)
        return chosen, branch

    @abstractmethod
    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a goal that is nearest to a seed.

        Args:
            goal: In the base frame, for the tip.
            seed: Posture [rad], shape (n,).
            accept: Called with candidates in the order of their distance until it returns True.

        Raises:
            InputError: Malformed input, or a kind of goal for which the arm has no closed form.
        """

    @abstractmethod
    def _batch(self, T: Floats, seeds: Floats | None, tol: float, *, limits: bool) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures (n, branches, count), NaN where not valid, and validity (branches, count), before limits.

        With `limits`, what the goal leaves free is chosen so that the posture is within them.
        """

    def _error_of(self, goal: Goal) -> ErrorOf:
        return lambda q: goal_error(goal, self.fk(q))

    def _solutions(
        self,
        found: Sequence[Row],
        unreached: str,
        error_of: ErrorOf,
        seed: Floats | None,
        limits: bool,
        tol: float,
    ) -> IKSolutions:
        """Apply limits and windings; sort by distance where there is a seed."""
        if not found:
            return IKSolutions((), Status.OUT_OF_REACH, unreached, error_of, self.n)
        kept = self._within(found, error_of, seed, limits, tol)
        if not kept:
            reason = f"all {len(found)} postures are outside the joint limits ({self._limiting_joints(found)})"
            return IKSolutions((), Status.OUT_OF_LIMITS, reason, error_of, self.n)
        return IKSolutions(kept, Status.OK, "", error_of, self.n)

    def _within(
        self, found: Sequence[Row], error_of: ErrorOf, seed: Floats | None, limits: bool, tol: float
    ) -> Sequence[Row]:
        """Solutions within the limits, in the winding nearest to a seed, and sorted by distance from it."""
        if seed is None and (self._full_turn or not limits):
            return found
        wanted = [0.0] * self.n if seed is None else seed.tolist()
        low, high = (self._low, self._high) if limits else ([-np.inf] * self.n, [np.inf] * self.n)
        single = limits and self._one_turn
        kept: list[Row] = []
        for row in found:
            if single and _inside_turn(row[ANGLES]):
                kept.append(row)
            elif (q := self._wound(row[ANGLES], wanted, low, high, error_of, tol)) is not None:
                kept.append((row[BRANCH], row[FLAGS], *q))
        if seed is not None:
            kept.sort(key=lambda row: dist(row[ANGLES], wanted))
        return kept

    def _wound(
        self,
        angles: Sequence[float],
        wanted: Sequence[float],
        low: Sequence[float],
        high: Sequence[float],
        error_of: ErrorOf,
        tol: float,
    ) -> list[float] | None:
        """`nearest_winding`; one that is barely past a limit is moved into the limits if it then reaches the goal."""
        q = nearest_winding(angles, wanted, low, high, slack=NEAR_LIMIT)
        if q is None or all(
            bottom - SLACK <= angle <= top + SLACK for angle, bottom, top in zip(q, low, high, strict=True)
        ):
            return q
        moved = self._moved_into_limits(q)
        return moved.tolist() if max(error_of(moved)) <= tol else nearest_winding(angles, wanted, low, high)

    def _moved_into_limits(self, q: Sequence[float]) -> Floats:
        """Return the posture within the limits whose pose of the tip is nearest to that of another, by damped Newton.

        Fewer than six joints keep the position alone.
        """
        target = self.fk(q)
        task = slice(6 if self.n >= POSE_JOINTS else 3)
        found = best = np.clip(q, self.lower, self.upper)
        least = np.inf
        for _ in range(STEPS):
            T = self.fk(found)
            turn = target[:3, :3] @ T[:3, :3].T
            twist = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            error = np.concatenate([target[:3, 3] - T[:3, 3], twist])[task]
            size = float(np.abs(error).max())
            if size < least:
                best, least = found, size
            if size < ARRIVED:
                break
            J = self.jacobian(found)[task]
            down = J.T @ error
            J[:, ((found <= self.lower) & (down < 0.0)) | ((found >= self.upper) & (down > 0.0))] = 0.0
            damping = (size + ARRIVED) * np.eye(len(error))
            found = np.clip(found + J.T @ np.linalg.solve(J @ J.T + damping, error), self.lower, self.upper)
        return best

    def _limiting_joints(self, found: Sequence[Row]) -> str:
        def blocked(j: int) -> bool:
            low, high = self._low[j : j + 1], self._high[j : j + 1]
            return any(nearest_winding([row[ANGLES][j]], [0.0], low, high) is None for row in found)

        return ", ".join(name for j, name in enumerate(self.arm.joints) if blocked(j))

    def _choose(self, solutions: IKSolutions, seed: Floats, accept: Accept | None) -> IKResult:
        """Return the first of the sorted solutions that the caller accepts."""
        check_accept(accept)
        for row in solutions.found:
            q = np.array(row[ANGLES])
            if accept is None or accept(q.copy()):
                return IKResult(q, Status.OK, *solutions.error_of(q), branch=row[BRANCH])
        if solutions.success:
            q = np.array(solutions.found[0][ANGLES])
            reason = f"accept refused all {len(solutions)} postures"
            return IKResult(q, Status.REJECTED, *solutions.error_of(q), reason)
        return IKResult(seed.copy(), solutions.status, *solutions.error_of(seed), solutions.reason)

    def _posture_or_none(self, seed: ArrayLike | None) -> Floats | None:
        return None if seed is None else self.as_posture("seed", seed)


def _inside_turn(q: Sequence[float]) -> bool:
    """Whether no joint is at an end of (-pi, pi)."""
    return max(q) < pi - NEAR_LIMIT and min(q) > NEAR_LIMIT - pi

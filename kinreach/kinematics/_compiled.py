"""Every posture of a pose by the compiled core, one pose or many, for the arms whose postures it finds.

An arm of such a class for which it does not find them goes the way of `ClosedFormKinematics`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_THREADS, Floats, as_floats, as_pose, check_count, check_tolerance, is_tensor
from kinreach.errors import InputError
from kinreach.kinematics._closed_form import TOLERANCE, ClosedFormKinematics
from kinreach.kinematics._core import NULL, ROW, Struct, doubles, ffi, flags, lib, longs, new_rows
from kinreach.kinematics._goals import rigid_pose, rigid_poses
from kinreach.kinematics._solutions import Accept, IKBatch, IKBatchNearest, IKResult, IKSolutions, Status


class CompiledKinematics(ClosedFormKinematics):
    """Kinematics of arms with six joints whose postures the core finds."""

    joints = 6
    #: Whether it does; how the core finds postures, and what it needs for that.
    _is_compiled = True
    _way: int
    _prepared: Struct

    @abstractmethod
    def _miss_text(self, T: Floats, miss: int) -> str:
        """Why no posture reaches a pose, from the parts that missed."""

    def _every(self, T: ArrayLike, seed: ArrayLike | None, *, limits: bool, tol: float) -> IKSolutions:
        """`all_solutions`."""
        T, tol = as_floats("T", T).copy(), check_tolerance(tol)
        if T.shape != (4, 4):
            as_pose("T", T)
        start = self._posture_or_none(seed)
        rows, near = new_rows(self.branches), NULL if start is None else doubles(start)
        count = lib.kr_solutions(
            self._way, self._prepared.pointer, self._core.pointer, doubles(T), near, limits, tol, rows
        )
        if count > 0:
            return IKSolutions((rows, count), Status.OK, "", (self._errors, (0, T)))
        exact, status, reason = np.ascontiguousarray(rigid_pose(T)), Status.OK, ""
        if count < 0:
            count = lib.kr_solutions(*self._arguments, doubles(exact), near, limits, tol, rows)
        if not count and not rows[0]:
            status, reason = Status.OUT_OF_REACH, self._miss_text(exact, int(rows[1]))
        elif not count:
            status, reason = Status.OUT_OF_LIMITS, self._all_outside(self._every(T, None, limits=False, tol=tol).rows)
        return IKSolutions((rows, count), status, reason, (self._errors, (0, T)))

    @property
    def _arguments(self) -> tuple[int, Any, Any]:
        return self._way, self._prepared.pointer, self._core.pointer

    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a pose that is nearest to a seed; as `ClosedFormKinematics.nearest`."""
        pose, start = as_floats("T", T), as_floats("seed", seed)
        usual = accept is None and pose.shape == (4, 4) and start.shape == (6,) and pose.flags.c_contiguous
        if usual and self._is_compiled:
            rows, near = new_rows(self.branches), doubles(np.ascontiguousarray(start))
            found = lib.kr_nearest(
                self._way, self._prepared.pointer, self._core.pointer, doubles(pose), near, TOLERANCE, rows
            )
            if found > 0:
                branch, _, *q, position, orientation = ffi.unpack(rows, ROW + 2)
                return IKResult(np.array(q), Status.OK, position, orientation, branch=int(branch))
        return super().nearest(pose, start, accept=accept)

    def batch(self, T: ArrayLike, *, limits: bool = True, tol: float = TOLERANCE, threads: int = 1) -> IKBatch:
        """Compute every posture of many poses; as `ClosedFormKinematics.batch`.

        Args:
            T: As there.
            limits: As there.
            tol: As there.
            threads: Each takes a share of the poses; the results have the same bits. A tensor has one, and so has an
                arm that is solved by Newton's method from a closed form.
        """
        if threads != 1:
            check_count("threads", threads, most=MAX_THREADS)
        if is_tensor(T) or not self._is_compiled:
            return super().batch(T, limits=limits, tol=tol)
        T, tol = _as_poses(T), check_tolerance(tol)
        q, valid = np.empty((len(T), self.branches, self.n)), np.empty((len(T), self.branches), dtype=np.bool_)

        def solve(poses: Floats, q: Floats, valid: NDArray[np.bool_]) -> int:
            found = limits, tol, self.branches, doubles(q), flags(valid)
            return int(lib.kr_solutions_of_each(*self._arguments, doubles(poses), len(poses), *found))

        _over(solve, threads, T, q, valid)
        return IKBatch(q, valid)

    def nearest_batch(
        self, T: ArrayLike, seeds: ArrayLike, *, tol: float = TOLERANCE, threads: int = 1
    ) -> IKBatchNearest:
        """Compute for each of many poses the posture nearest to its seed; as `ClosedFormKinematics.nearest_batch`.

        Args:
            T: As there.
            seeds: As there.
            tol: As there.
            threads: As in `batch`.
        """
        if threads != 1:
            check_count("threads", threads, most=MAX_THREADS)
        if not self._is_compiled:
            return super().nearest_batch(T, seeds, tol=tol)
        T, tol = _as_poses(T), check_tolerance(tol)
        start = np.ascontiguousarray(self._as_seeds(seeds, len(T)))
        q, branch = np.empty((len(T), self.n)), np.empty(len(T), dtype=np.int64)

        def solve(poses: Floats, start: Floats, q: Floats, branch: NDArray[np.int64]) -> int:
            given, found = (doubles(poses), doubles(start), len(poses)), (tol, doubles(q), longs(branch))
            return int(lib.kr_nearest_of_each(*self._arguments, *given, *found))

        _over(solve, threads, T, start, q, branch)
        return IKBatchNearest(q, branch, branch >= 0)


def _over(solve: Callable[..., int], threads: int, T: Floats, *arrays: NDArray[Any]) -> None:
    """Solve poses in parts; once more with exact rotations if one has none: `solve` returns its row, else -1.

    Args:
        solve: Takes rows of the poses and the same rows of the other arrays.
        threads: In which the parts are solved.
        T: Poses, shape (count, 4, 4).
        arrays: What else `solve` reads and fills in, a row for each pose.
    """

    def run(T: Floats) -> int:
        if threads == 1 or len(T) < 2:
            return solve(T, *arrays)
        cuts = np.linspace(0, len(T), min(threads, len(T)) + 1).astype(int).tolist()
        parts = [[each[slice(*ends)] for each in (T, *arrays)] for ends in pairwise(cuts)]
        with ThreadPoolExecutor(len(parts)) as pool:  # the core is called without Python's lock
            return max(pool.map(lambda part: solve(*part), parts))

    if run(T) >= 0:
        run(np.ascontiguousarray(rigid_poses(T)))


def _as_poses(T: ArrayLike) -> Floats:
    """Poses (count, 4, 4) in the order of C, unchecked."""
    T = np.ascontiguousarray(as_floats("T", T))
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise InputError(f"T must have shape (count, 4, 4), got {T.shape}")
    return T

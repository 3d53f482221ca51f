"""Every posture of an arm that is close to one with a closed form, such as a calibrated UR.

1. The closed form has the postures of the other arm. It also tells whether a pose may have a different number of
   postures on this arm, because a singular pose is close. If not, each branch has exactly one posture.
2. Newton's method goes from the closed form's postures to those of this arm. Each has to stay on its branch.
3. The postures of all other poses are found by elimination, which knows no branches.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.kinematics._angles import wrapped
from kinreach.kinematics._chain import blocks
from kinreach.kinematics._general_6r import EXACT, MAX_POSTURES, Chain, newton
from kinreach.kinematics._solutions import Row

#: Newton's method moves a joint less than this on the way to the posture of the same branch [rad].
FAR = 0.1


class NearClosedForm(ABC):
    """Every posture of an arm for poses of its tip."""

    branches, rank, starts_all = MAX_POSTURES, 1, True

    def __init__(self, placements: Floats) -> None:
        self.chain = Chain(placements)

    def one(self, T: Floats, seed: Floats, tol: float) -> list[Row]:
        """Compute the postures for a pose (4, 4), rotation exact: branch index, flags and angles, by branch index.

        A free joint keeps the seed's value as far as it can. If no posture reaches the pose exactly, those that miss it
        by at most `tol` [m, rad] are returned.
        """
        branches, q, doubtful = self._start(T, seed)
        if not doubtful:
            if not branches:
                return []
            found, off = newton(self.chain, q, np.broadcast_to(T, (len(q), 4, 4)))
            if off.max() < EXACT and self._stays(found.T, q.T, branches).all():
                rows = zip(branches, wrapped(found).tolist(), strict=True)
                return sorted((branch, 0, *angles) for branch, angles in rows)
        found, _, index = self._every(T[None], seed[None], tol)
        return sorted((branch, 0, *angles) for branch, angles in zip(index.tolist(), found.tolist(), strict=True))

    def many(
        self, T: Floats, seeds: Floats, tol: float, free: list[int] | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Compute the postures (6, 16, m) for poses (m, 4, 4), NaN where there is none, and which there are (16, m).

        Arguments are those of `one`, for each pose; no joint is free, so that `free` learns nothing.
        """
        q, valid = no_postures(len(T))
        doubtful = np.empty(len(T), dtype=np.bool_)
        for part in blocks(len(T)):
            starts, exists, doubtful[part] = self._starts(T[part])
            branch, row = np.nonzero(exists & ~doubtful[part])
            start = starts[:, branch, row]
            found, arrived = self._refined(start, row, T[part])
            arrived &= self._stays(found, start, branch)
            row += part.start
            q[:, branch, row], valid[branch, row] = wrapped(found), True
            doubtful[row[~arrived]] = True
        rows = np.flatnonzero(doubtful)
        q[..., rows], valid[:, rows] = np.nan, False
        if len(rows):
            postures, pose, index = self._every(T[rows], seeds[rows], tol)
            q[:, index, rows[pose]], valid[index, rows[pose]] = postures.T, True
        return q, valid

    @abstractmethod
    def _start(self, T: Floats, seed: Floats) -> tuple[list[int], Floats, bool]:
        """The closed form's branches and postures (k, 6) for a pose, and whether the arm itself may have others."""

    @abstractmethod
    def _starts(self, T: Floats) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
        """As `_start`, for poses (m, 4, 4): postures (6, 8, m), which there are (8, m), and the poses in doubt (m,)."""

    @abstractmethod
    def _every(self, T: Floats, seeds: Floats, tol: float) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
        """All postures (k, 6) of poses in doubt, the row of each one's pose (k,), and its branch (k,)."""

    def _refined(self, q: Floats, row: NDArray[np.int64], T: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Postures near starts (6, k) for poses by their row (k,) in T, and which have arrived (k,)."""
        found, off = newton(self.chain, q.T, T[row])
        return found.T, off < EXACT

    def _stays(self, found: Floats, start: Floats, branch: Sequence[int] | NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which postures (6, k) are still on the branch of their start (6, k)."""
        return np.abs(found - start).max(axis=0, initial=0.0) < FAR


def no_postures(count: int) -> tuple[Floats, NDArray[np.bool_]]:
    return np.full((6, MAX_POSTURES, count), np.nan), np.zeros((MAX_POSTURES, count), dtype=np.bool_)

"""What every arm with a closed-form inverse kinematics offers; the formulas themselves are elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import Floats, Goal, goal_error
from kinreach.kinematics.result import Accept, IKResult, Status
from kinreach.kinematics.solutions import LIMIT_TOLERANCE, ErrorOf, IKSolutions, nearest_winding
from kinreach.kinematics.ur_ik import MISS_TEXT, Miss
from kinreach.robots import ArmDescription


class ClosedFormKinematics(ArmKinematics):
    """Limits, windings and the choice of a branch, shared by the arms with a closed form."""

    def __init__(self, arm: str | ArmDescription, *, tip: str | None, base: str) -> None:
        super().__init__(arm, tip=tip, base=base)
        self._low: list[float] = self.lower.tolist()
        self._high: list[float] = self.upper.tolist()
        # where every joint covers a full turn, a principal value is always within the limits
        self._full_turn = bool((self.lower <= -pi + LIMIT_TOLERANCE).all() and (self.upper >= pi - LIMIT_TOLERANCE).all())

    def _error_of(self, goal: Goal) -> ErrorOf:
        return lambda q: goal_error(goal, self.fk(q))

    def _solutions(
        self,
        found: Sequence[tuple[Any, ...]],
        miss: int,
        error_of: ErrorOf,
        seed: Floats | None,
        limits: bool,
    ) -> IKSolutions:
        """Apply limits and windings; sort by distance where there is a seed."""
        if not found:
            return IKSolutions((), Status.OUT_OF_REACH, _why(miss), error_of, self.n)
        if seed is None and (self._full_turn or not limits):
            return IKSolutions(found, Status.OK, "", error_of, self.n)
        wanted = [0.0] * self.n if seed is None else seed.tolist()
        low, high = (self._low, self._high) if limits else ([-np.inf] * self.n, [np.inf] * self.n)
        kept = [
            (row[0], *shifted) for row in found if (shifted := nearest_winding(row[1:], wanted, low, high)) is not None
        ]
        if not kept:
            reason = f"all {len(found)} postures are outside the joint limits ({self._limiting_joints(found)})"
            return IKSolutions((), Status.OUT_OF_LIMITS, reason, error_of, self.n)
        if seed is not None:
            kept.sort(key=lambda row: sum((a - b) ** 2 for a, b in zip(row[1:], wanted, strict=True)))
        return IKSolutions(kept, Status.OK, "", error_of, self.n)

    def _limiting_joints(self, found: Sequence[tuple[Any, ...]]) -> str:
        def blocked(j: int) -> bool:
            low, high = self._low[j : j + 1], self._high[j : j + 1]
            return any(nearest_winding(row[1 + j : 2 + j], [0.0], low, high) is None for row in found)

        return ", ".join(name for j, name in enumerate(self.arm.joints) if blocked(j))

    def _choose(self, solutions: IKSolutions, seed: Floats, accept: Accept | None) -> IKResult:
        """The first of the sorted solutions that the caller accepts."""
        for row in solutions.found:
            q = np.array(row[1:])
            if accept is None or accept(q):
                return IKResult(q, Status.OK, *solutions.error_of(q), branch=row[0] & 7)
        if solutions.success:
            q = np.array(solutions.found[0][1:])
            reason = f"accept refused all {len(solutions)} postures"
            return IKResult(q, Status.REJECTED, *solutions.error_of(q), reason)
        return IKResult(seed.copy(), solutions.status, *solutions.error_of(seed), solutions.reason)

    def _posture_or_none(self, seed: ArrayLike | None) -> Floats | None:
        return None if seed is None else self.as_posture("seed", seed)


def _why(miss: int) -> str:
    return "; ".join(text for flag, text in MISS_TEXT.items() if miss & flag)


__all__ = ["ClosedFormKinematics", "Miss"]

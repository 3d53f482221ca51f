"""Where iterative solvers may search: joints that turn full circle are not held at their limits while they move.

A revolute joint whose range covers 2 pi has no posture that it cannot take: q and q +- 2 pi are the same one. Held at
its limits on the way, it would stop on the wrong side of a seam that is not there (measured on the UR5 within +-pi,
random poses: placo's first attempt then succeeds in 31 % instead of 82 %). So such joints are searched without limits
and folded back at the end; the others keep theirs at every step.
"""

from __future__ import annotations

import math

import numpy as np

from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import Floats

TWO_PI = 2.0 * np.pi


class JointSpace:
    """Limits of an arm as a search sees them.

    Args:
        kin: The arm.

    Attributes:
        search_lower, search_upper: The arm's limits [rad], shape (n,); -inf and +inf where a joint turns full circle.
    """

    def __init__(self, kin: ArmKinematics) -> None:
        full_circle = kin.upper - kin.lower >= TWO_PI
        self.search_lower: Floats = np.where(full_circle, -np.inf, kin.lower)
        self.search_upper: Floats = np.where(full_circle, np.inf, kin.upper)
        self._joints = list(zip(kin.lower.tolist(), kin.upper.tolist(), full_circle.tolist(), strict=True))

    def fold(self, q: Floats) -> Floats:
        """The posture within the limits that is the same as `q`, or the nearest where none is.

        Args:
            q: Posture [rad], shape (n,).

        Returns:
            A new array: full-circle joints turned by the fewest multiples of 2 pi, the others clamped.
        """
        return np.array([_fold(angle, *joint) for angle, joint in zip(q.tolist(), self._joints, strict=True)])


def _fold(angle: float, lower: float, upper: float, full_circle: bool) -> float:
    if lower <= angle <= upper:
        return angle
    if full_circle:
        turns = math.ceil((lower - angle) / TWO_PI) if angle < lower else -math.ceil((angle - upper) / TWO_PI)
        angle += turns * TWO_PI
    return min(max(angle, lower), upper)

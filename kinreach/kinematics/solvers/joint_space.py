"""Where iterative solvers may search: joints that turn full circle are not held at their limits while they move.

A revolute joint whose range covers 2 pi has no posture that it cannot take: q and q +- 2 pi are the same one. Held at
its limits on the way, it would stop on the wrong side of a seam that is not there (measured on the UR5 within +-pi,
random poses: placo's first attempt then succeeds in 31 % instead of 82 %). So such joints are searched without limits
and folded back at the end; the others keep theirs at every step.
"""

from __future__ import annotations

import numpy as np

from kinreach.kinematics.arm import ArmKinematics
from kinreach.kinematics.goals import Floats

TWO_PI = 2.0 * np.pi


class JointSpace:
    """Limits of an arm as a search sees them.

    Args:
        kin: The arm.

    Attributes:
        lower, upper: The arm's limits [rad], shape (n,).
        search_lower, search_upper: The same with -inf and +inf for joints that turn full circle.
    """

    def __init__(self, kin: ArmKinematics) -> None:
        self.lower, self.upper = kin.lower, kin.upper
        full_circle = self.upper - self.lower >= TWO_PI
        self.search_lower = np.where(full_circle, -np.inf, self.lower)
        self.search_upper = np.where(full_circle, np.inf, self.upper)

    def fold(self, q: Floats) -> Floats:
        """The posture within the limits that is the same as `q`, or the nearest where none is.

        Full-circle joints are turned by the fewest multiples of 2 pi, the others are clamped.
        """
        above = np.ceil(np.maximum(q - self.upper, 0.0) / TWO_PI)
        below = np.ceil(np.maximum(self.lower - q, 0.0) / TWO_PI)
        turned = np.where(np.isinf(self.search_upper), q + TWO_PI * (below - above), q)
        return np.clip(turned, self.lower, self.upper)

    def random(self, rng: np.random.Generator) -> Floats:
        """A posture drawn evenly from within the limits [rad], shape (n,)."""
        return rng.uniform(self.lower, self.upper)

"""Prints how a solver of your own, scipy's least squares, does beside the closed form.

    python examples/02_own_solver.py
    kinreach compare --methods closed-form,examples.02_own_solver:LeastSquares

Needs no extra.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from kinreach.compare import compare
from kinreach.kinematics import ArmKinematics, AxisGoal, IKResult


class LeastSquares:
    """Brings the tip to the goal's point, and its z axis to the goal's axis.

    Args:
        kin: The arm; a comparison that is given the class hands its own.
    """

    name = "scipy"

    def __init__(self, kin: ArmKinematics) -> None:
        self.kin = kin

    def solve(
        self,
        goal: AxisGoal,
        seed: ArrayLike,
        *,
        accept: Callable[[np.ndarray], bool] | None = None,
    ) -> IKResult:
        """Search from the seed, then from random postures, until one is accepted."""

        def error(q: np.ndarray) -> np.ndarray:
            T = self.kin.fk(q)
            position, direction = T[:3, 3] - goal.position, T[:3, 2] - goal.axis
            return np.concatenate([position, 0.1 * direction])

        rng, start = np.random.default_rng(0), np.asarray(seed)
        limits = self.kin.lower, self.kin.upper
        for restarts in range(20):
            found = least_squares(error, start, bounds=limits, xtol=1e-12)
            counts = {"iterations": found.nfev, "restarts": restarts}
            result = IKResult.of(self.kin, goal, found.x, accept=accept, **counts)
            if result.success:
                break
            start = rng.uniform(*limits)
        return result


if __name__ == "__main__":
    results = compare("ur5", methods=["closed-form", LeastSquares], goals=50)
    for row in results["methods"]:
        print(
            f"{row['name']}: {100 * row['reached']:.0f} % reached, "
            f"{row['distance_mm']['median']:.3f} mm and "
            f"{row['solve_ms']['median']:.2f} ms in the median"
        )

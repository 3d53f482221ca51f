"""scipy's least squares as a solver beside the closed form: `python examples/02_own_solver.py`.

On the command line the same:

    python -m kinreach.compare --methods closed-form,examples.02_own_solver:LeastSquares --goals 50
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from kinreach.compare import compare
from kinreach.kinematics import IKResult, Status, UR5Kinematics
from kinreach.kinematics.goals import Goal, goal_error
from kinreach.kinematics.solutions import Accept


class LeastSquares:
    """Brings the tip to the goal's point, and its z axis to the goal's axis."""

    name = "scipy"

    def __init__(self) -> None:
        self.kin = UR5Kinematics(tip="tcp", base="world")

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        kin = self.kin

        def error(q: np.ndarray) -> np.ndarray:
            T = kin.fk(q)
            return np.concatenate([T[:3, 3] - goal.position, 0.1 * (T[:3, 2] - goal.axis)])

        rng, start = np.random.default_rng(0), np.clip(seed, kin.lower + 1e-6, kin.upper - 1e-6)
        for restarts in range(20):
            found = least_squares(error, start, bounds=(kin.lower, kin.upper), xtol=1e-12)
            position, orientation = goal_error(goal, kin.fk(found.x))
            if position < 1e-4 and orientation < 1e-3 and (accept is None or accept(found.x)):
                return IKResult(found.x, Status.OK, position, orientation, iterations=found.nfev, restarts=restarts)
            start = rng.uniform(kin.lower, kin.upper)
        return IKResult(found.x, Status.NOT_CONVERGED, position, orientation, reason="no start converged")


if __name__ == "__main__":
    for row in compare("ur5", methods=["closed-form", LeastSquares()], goals=50)["methods"]:
        print(
            f"{row['name']}: {100 * row['reached']:.0f} % reached, {row['distance_mm']['median']:.3f} mm and "
            f"{row['solve_ms']['median']:.2f} ms in the median"
        )

"""The closed form behind the solver protocol."""

from __future__ import annotations

from numpy.typing import ArrayLike

from kinreach.kinematics.closed_form import ClosedFormKinematics
from kinreach.kinematics.goals import Goal
from kinreach.kinematics.result import Accept, IKResult


class ClosedFormSolver:
    """Takes the nearest of all exact postures; see `kinreach.kinematics.solvers.base.Solver`. One per thread."""

    name = "closed-form"

    def __init__(self, kin: ClosedFormKinematics) -> None:
        self.kin = kin

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """The posture nearest to the seed that reaches the goal and is accepted."""
        return self.kin.solve(goal, seed, accept=accept)

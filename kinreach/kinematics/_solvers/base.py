"""The protocol of inverse-kinematics solvers, their short names, and the closed form as one of them."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike

from kinreach._checks import check_known, shown
from kinreach.errors import InputError
from kinreach.kinematics import _solvers
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._goals import Goal
from kinreach.kinematics._solutions import Accept, IKResult, Tolerance

__all__ = ["SOLVERS", "ClosedFormSolver", "Solver", "Tolerance", "new_solver"]


class Solver(Protocol):
    """Turns a goal and a seed posture into a posture.

    Any object with this `name` and this `solve` is one:

        class MySolver:
            name = "mine"

            def __init__(self, kin):
                self.kin: Any = kin

            def solve(self, goal, seed, *, accept=None):
                q = ...  # anything that starts from `seed`
                return IKResult.of(self.kin, goal, q, accept=accept)

    `IKResult.of` computes the errors, checks limits and `accept`, and sets whether `q` reaches the goal.

    Threads may share the solvers of kinreach.
    """

    @property
    def name(self) -> str:
        """Name of the solver, as on the command line."""
        ...

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Find a posture for `goal`, starting from `seed`.

        Args:
            goal: In the base frame of the solver's kinematics.
            seed: Posture to start from, or to stay near to [rad], shape (n,).
            accept: Test that a posture must also pass; a refused one sends the solver on to the next.

        Returns:
            The posture with errors computed on it, or the reason why there is none.

        Raises:
            InputError: The goal or the seed is malformed, or the arm cannot serve this kind of goal.
        """
        ...


class ClosedFormSolver:
    """Return the nearest of all exact postures. Threads may share an instance.

    Args:
        kin: Kinematics that list every posture of a goal: a closed form, or the curves of a seven-axis arm.

    Raises:
        InputError: The arm has none.
    """

    name = "closed-form"

    def __init__(self, kin: ArmKinematics) -> None:
        if not getattr(kin, "knows_all_postures", False):
            reason = getattr(kin, "no_closed_form", "")
            because = f": {reason}" if reason else ""
            raise InputError(f"{shown(kin)} has no closed form; the solvers placo, lm and qp take any arm{because}")
        self.kin: Any = kin

    def solve(self, goal: Goal, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture nearest to the seed that reaches the goal and is accepted."""
        return self.kin.solve(goal, seed, accept=accept)


#: Short names of the solvers -> their classes.
SOLVERS = {
    "closed-form": "ClosedFormSolver",
    "placo": "PlacoSolver",
    "lm": "LevenbergMarquardtSolver",
    "qp": "QPSolver",
}


def new_solver(name: str, kinematics: ArmKinematics) -> Solver:
    """Make a solver by its short name, one of `SOLVERS`; its package is loaded now.

    Raises:
        UnknownNameError: Unknown solver.
        InputError: The closed form of an arm that has none.
    """
    check_known("solver", name, SOLVERS)
    if name == "closed-form" and not kinematics.knows_all_postures:
        because = f": {kinematics.no_closed_form}" if kinematics.no_closed_form else ""
        raise InputError(
            f"the arm {kinematics.arm.name!r} has no closed form; its solvers are placo, lm and qp{because}"
        )
    return getattr(_solvers, SOLVERS[name])(kinematics)

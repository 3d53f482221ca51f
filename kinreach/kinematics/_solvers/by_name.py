"""Solvers by their short names."""

from __future__ import annotations

from kinreach._checks import check_known
from kinreach.errors import InputError
from kinreach.kinematics import _solvers
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._solvers.base import Solver

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

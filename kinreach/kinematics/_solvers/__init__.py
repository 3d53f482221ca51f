"""Inverse-kinematics solvers behind one protocol: the closed form, and three iterative ones to compare it with."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from kinreach._checks import check_known
from kinreach._lazy import on_first_use
from kinreach.errors import InputError
from kinreach.kinematics._arm import ArmKinematics
from kinreach.kinematics._solvers.base import ClosedFormSolver, Solver, Tolerance

if TYPE_CHECKING:
    from kinreach.kinematics._solvers.levenberg_marquardt import LevenbergMarquardtSolver
    from kinreach.kinematics._solvers.placo_solver import PlacoSolver
    from kinreach.kinematics._solvers.qp_solver import QPSolver

__all__ = [
    "ClosedFormSolver",
    "LevenbergMarquardtSolver",
    "PlacoSolver",
    "QPSolver",
    "Solver",
    "Tolerance",
    "new_solver",
]

#: Iterative solvers -> their modules, loaded on first use: each needs its own package.
_ITERATIVE = {
    "LevenbergMarquardtSolver": "levenberg_marquardt",
    "PlacoSolver": "placo_solver",
    "QPSolver": "qp_solver",
}
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
    return getattr(importlib.import_module(__name__), SOLVERS[name])(kinematics)


__getattr__ = on_first_use(__name__, _ITERATIVE)

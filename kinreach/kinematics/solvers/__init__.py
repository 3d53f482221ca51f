"""Inverse-kinematics solvers behind one protocol: the closed form, and three iterative ones to compare it with."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from kinreach.kinematics.solvers.base import ClosedFormSolver, Solver, Tolerance

if TYPE_CHECKING:
    from kinreach.kinematics.solvers.levenberg_marquardt import LevenbergMarquardtSolver
    from kinreach.kinematics.solvers.placo_solver import PlacoSolver
    from kinreach.kinematics.solvers.qp_solver import QPSolver

__all__ = ["ClosedFormSolver", "LevenbergMarquardtSolver", "PlacoSolver", "QPSolver", "Solver", "Tolerance"]

#: Iterative solvers -> their modules, loaded when asked for: each needs a package of its own.
_ITERATIVE = {
    "LevenbergMarquardtSolver": "levenberg_marquardt",
    "PlacoSolver": "placo_solver",
    "QPSolver": "qp_solver",
}


def __getattr__(name: str) -> Any:
    if name not in _ITERATIVE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_ITERATIVE[name]}"), name)

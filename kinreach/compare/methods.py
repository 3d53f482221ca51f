"""The methods that can be compared. To add one, add a line to `METHODS` under the tasks that it can do.

A method turns a goal into a posture: its factory gets the task's kinematics (world frame, task's tip) and returns a
`kinreach.kinematics.solvers.base.Solver`. Every method gets its own kinematics object, and factories import what
they need themselves, so that one missing package does not disable the other methods.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from kinreach.kinematics.solvers.base import Solver

Factory = Callable[[Any], Solver]


def _closed_form(kinematics: Any) -> Solver:
    from kinreach.kinematics.solvers.closed_form import ClosedFormSolver

    return ClosedFormSolver(kinematics)


def _placo(kinematics: Any) -> Solver:
    from kinreach.kinematics.solvers.placo_solver import PlacoSolver

    return PlacoSolver(kinematics)


def _levenberg_marquardt(kinematics: Any) -> Solver:
    from kinreach.kinematics.solvers.levenberg_marquardt import LevenbergMarquardtSolver

    return LevenbergMarquardtSolver(kinematics)


def _qp(kinematics: Any) -> Solver:
    from kinreach.kinematics.solvers.qp_solver import QPSolver

    return QPSolver(kinematics)


_INVERSE_KINEMATICS: Mapping[str, Factory] = {
    "closed-form": _closed_form,
    "placo": _placo,
    "lm": _levenberg_marquardt,
    "qp": _qp,
}

#: Methods by task and name, in the order in which reports show them.
METHODS: Mapping[str, Mapping[str, Factory]] = {
    "ur5": {**_INVERSE_KINEMATICS},
    "button": {**_INVERSE_KINEMATICS},
}

"""The methods that can be compared. To add one, add a line to `METHODS` under the tasks that it can do.

A factory gets the task. Where a posture is to be decided on, it returns a `kinreach.compare.deciding.Method`:
`SolverMethod` around a `kinreach.kinematics.solvers.base.Solver`, `PolicyMethod` around a trained policy, or another.
Where episodes are to be played, it returns a `kinreach.compare.button.players.Player`. Every method gets its own
kinematics object, and factories import what they need themselves, so that one missing package does not disable the
other methods.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, overload

from kinreach.compare.button import players
from kinreach.compare.button.players import Player
from kinreach.compare.deciding import Method
from kinreach.compare.policies import PolicyMethod, is_policy_file
from kinreach.compare.solving import SeededMethod, SolverMethod
from kinreach.compare.tasks import ButtonTask, ReachTask, UR5Task

Factory = Callable[[ReachTask], Method]


def _closed_form(task: ReachTask) -> Method:
    from kinreach.kinematics.solvers.base import ClosedFormSolver

    return SolverMethod(task, ClosedFormSolver(task.new_kinematics()))


def _placo(task: ReachTask) -> Method:
    from kinreach.kinematics.solvers.placo_solver import PlacoSolver

    return SolverMethod(task, PlacoSolver(task.new_kinematics()))


def _levenberg_marquardt(task: ReachTask) -> Method:
    from kinreach.kinematics.solvers.levenberg_marquardt import LevenbergMarquardtSolver

    return SolverMethod(task, LevenbergMarquardtSolver(task.new_kinematics()))


def _qp(task: ReachTask) -> Method:
    from kinreach.kinematics.solvers.qp_solver import QPSolver

    return SolverMethod(task, QPSolver(task.new_kinematics()))


def _policy(name: str) -> Factory:
    return lambda task: PolicyMethod(task.arm, name)


def _hybrid(task: ReachTask) -> Method:
    return SeededMethod(PolicyMethod(task.arm, "single"), _levenberg_marquardt(task))


_INVERSE_KINEMATICS: Mapping[str, Factory] = {
    "closed-form": _closed_form,
    "placo": _placo,
    "lm": _levenberg_marquardt,
    "qp": _qp,
}

#: Methods by task and name, in the order in which reports show them.
METHODS: Mapping[str, Mapping[str, Callable[[Any], Any]]] = {
    "ur5": {
        **_INVERSE_KINEMATICS,
        "ppo-single": _policy("ppo-single"),
        "ppo-multi": _policy("ppo-multi"),
        "ranked-single": _policy("single"),
        "ranked-multi": _policy("multi"),
        "thesis-ppo-single": _policy("thesis-single"),
        "hybrid": _hybrid,
    },
    "arm3": {**_INVERSE_KINEMATICS},
    "button": {
        "analytic": players.analytic,
        "ppo": players.learned(players.PRETRAINED),
        "random": players.chance,
    },
}
#: Of tasks that policies can be trained for: what makes a method of a policy's file.
_FILES: Mapping[str, Callable[[str], Callable[[Any], Any]]] = {
    UR5Task.name: _policy,
    ButtonTask.name: players.learned,
}


def known(task: str, name: str) -> bool:
    """Whether a task has a method of this name: one of `METHODS`, or a file with a policy where there are any."""
    return name in METHODS[task] or (task in _FILES and is_policy_file(name))


def short_name(name: str) -> str:
    """What results call a method: its name; of a policy's file without folder and ending."""
    return Path(name).stem if is_policy_file(name) else name


@overload
def new_method(task: ReachTask, name: str) -> Method: ...


@overload
def new_method(task: ButtonTask, name: str) -> Player: ...


def new_method(task: ReachTask | ButtonTask, name: str) -> Any:
    """Make a method that is `known`.

    Raises:
        InstallationError: Its packages are missing.
        InputError: A policy that the package does not have, a file that is no policy, or one for another task.
    """
    factory = METHODS[task.name].get(name) or _FILES[task.name](name)
    return factory(task)

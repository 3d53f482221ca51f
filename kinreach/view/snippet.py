"""A program that reproduces what is on the screen."""

from __future__ import annotations

from collections.abc import Sequence

from kinreach.checks import Floats
from kinreach.kinematics import AxisGoal, PoseGoal
from kinreach.kinematics.closed_form import ClosedFormKinematics
from kinreach.kinematics.goals import Goal
from kinreach.view.target import TargetModel


def program(model: TargetModel, goal: Goal, seed: Floats, *, arm: str) -> str:
    """Python code that prints the postures of a target and what touches in them.

    Args:
        model: Of the arm.
        goal: What is on the screen.
        seed: Posture the arm stands in [rad].
        arm: An expression for the arm, such as `"'ur5'"`.
    """
    kinematics = model.kinematics
    lines = ["import numpy as np", ""]
    names = ["kinematics_of"] if model.checker is None else ["CollisionChecker", "kinematics_of"]
    solver = ""
    if not isinstance(kinematics, ClosedFormKinematics):
        kind = type(goal).__name__
        names = sorted([*names, kind])
        solver = "from kinreach.kinematics.solvers import LevenbergMarquardtSolver"
    lines.append(f"from kinreach.kinematics import {', '.join(sorted(names, key=str.lower))}")
    lines += [solver] if solver else []
    lines += ["from kinreach.robots import get_arm"] if "get_arm" in arm else []
    lines += ["", f"kin = kinematics_of({arm}, tip={kinematics.tip!r}, base='world')"]
    lines += [f"seed = np.array({_numbers(seed)})", *_question(goal, closed=not solver)]
    lines += [] if model.checker is None else ["checker = CollisionChecker(kin)"]
    postures = "[(0, solution.q)] if solution.success else []" if solver else "zip(solution.branch, solution.q)"
    lines += ["", "print(solution.status.value, solution.reason)", f"for branch, q in {postures}:"]
    touching = "" if model.checker is None else ", checker.contacts(q)"
    lines += [f"    print(branch, np.degrees(q).round(1){touching})"]
    return "\n".join(lines) + "\n"


def _question(goal: Goal, *, closed: bool) -> list[str]:
    if isinstance(goal, PoseGoal):
        rows = [f"    {_numbers(row)}," for row in goal.T]
        asked = ["T = np.array([", *rows, "])"]
        return [*asked, "solution = kin.all_solutions(T, seed=seed)" if closed else _search("PoseGoal(T)")]
    position = f"position = {_numbers(goal.position)}"
    if isinstance(goal, AxisGoal):
        asked = [position, f"axis = {_numbers(goal.axis)}"]
        solve = "solution = kin.axis_solutions(position, axis, seed=seed)"
        return [*asked, solve if closed else _search("AxisGoal(position, axis)")]
    return [
        position,
        "solution = kin.all_solutions(position, seed=seed)" if closed else _search("PositionGoal(position)"),
    ]


def _search(goal: str) -> str:
    return f"solution = LevenbergMarquardtSolver(kin).solve({goal}, seed)"


def _numbers(values: Floats | Sequence[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"

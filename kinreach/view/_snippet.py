"""Programs that reproduce what is on the screen."""

from __future__ import annotations

from collections.abc import Sequence

from kinreach._checks import Floats, as_floats
from kinreach.deploy.inside import TriedMotion
from kinreach.kinematics import AxisGoal, Goal, PoseGoal
from kinreach.robots import Tool
from kinreach.view._real_arm import RealArm
from kinreach.view._results import Results
from kinreach.view._target import TargetModel

#: Of numbers in a program, after the point: a frame stays a rigid motion, and what is only rounding is left out.
DIGITS = 12


def program(model: TargetModel, goal: Goal, seed: Floats, *, arm: str) -> str:
    """Write Python code that prints the postures of a target; `arm` is an expression such as `"'ur5'"`."""
    kinematics, complete = model.kinematics, model.complete(goal)
    arm = _limited(model, arm)
    names = ["ArmKinematics"] if model.checker is None else ["ArmKinematics", "CollisionChecker"]
    names += [] if complete else [type(goal).__name__, "LevenbergMarquardtSolver"]
    lines = ["import numpy as np", ""]
    lines.append(f"from kinreach.kinematics import {', '.join(sorted(names, key=str.lower))}")
    lines += robots(arm)
    lines += ["", f"kin = ArmKinematics.of({arm}, tip={kinematics.tip!r}, base='world')"]
    lines += [f"seed = np.array({_numbers(seed)})", *_question(goal, complete=complete)]
    lines += [] if model.checker is None else ["checker = CollisionChecker(kin)"]
    postures = "zip(solution.branch, solution.q)" if complete else "[(0, solution.q)] if solution.success else []"
    lines += ["", "print(solution.status.value, solution.reason)", f"for branch, q in {postures}:"]
    touching = "" if model.checker is None else ", checker.contacts(q)"
    shown = "np.degrees(q).round(1)" if model.turns.all() else "q.round(4)"
    lines += [f"    print(branch, {shown}{touching})"]
    return "\n".join(lines) + "\n"


def _limited(model: TargetModel, arm: str) -> str:
    """An expression for the arm with the joint limits that count."""
    kinematics = model.kinematics
    limits = list(zip(model.lower.tolist(), model.upper.tolist(), strict=True))
    own = zip(kinematics.lower.tolist(), kinematics.upper.tolist(), strict=True)
    other = {name: pair for name, pair, at in zip(kinematics.arm.joints, limits, own, strict=True) if pair != at}
    if not other:
        return arm
    bound = limits[0][1]
    alike = all(pair == (-bound, bound) for pair in limits)
    return f"{described(arm)}.with_limits({bound if alike else other})"


def described(arm: str) -> str:
    """Return an expression for an arm's description, from one for the arm, which may be its name."""
    return f"get_arm({arm})" if arm.startswith(("'", '"')) else arm


def calibrated(sheet: str, file: str, *, repair: bool = False) -> str:
    """An expression for a calibrated arm, from one for its data sheet's arm and the path of the calibration."""
    return f"{described(sheet)}.calibrated({file!r}{', repair=True' * repair})"


def with_tool(arm: str, tool: Tool) -> str:
    """An expression for an arm with a tool, from one for the arm."""
    if not (tool.mass or tool.shapes or tool.mesh):
        return f"{described(arm)}.with_tool({as_floats('tool', tool.centre).tolist()})"
    return f"{described(arm)}.with_tool({tool!r})"


def robots(*arms: str) -> list[str]:
    """The imports of expressions for arms; none for names."""
    names = ("ArmDescription.", "Tool(", "get_arm(")
    needed = [name[:-1] for name in names if any(name in arm for arm in arms)]
    lines = ["from importlib import import_module"] if any(arm.startswith("import_module(") for arm in arms) else []
    return lines + ([f"from kinreach.robots import {', '.join(needed)}"] if needed else [])


def real_arm_program(model: RealArm, T: Floats, seed: Floats, *, sheet: str, arm: str) -> str:
    """Write Python code that prints the tip error of a calibrated arm in the data sheet's posture.

    `sheet` and `arm` are expressions for the data sheet's arm and for the calibrated one.
    """
    where = f"tip={model.nominal.tip!r}, base='world'"
    lines = [
        "import numpy as np",
        "",
        "from kinreach.kinematics import ArmKinematics",
        *robots(sheet, arm),
        "",
        f"sheet = ArmKinematics.of({sheet}, {where})",
        f"real = ArmKinematics.of({arm}, {where})",
        *_frame(T),
        f"result = sheet.nearest(T, {_numbers(seed)})",
        "print(result.status.value, result.reason)",
        "print(1000 * (real.fk(result.q) - sheet.fk(result.q))[:3, 3])",
    ]
    return "\n".join(lines) + "\n"


def motion_program(motion: TriedMotion, *, arm: str) -> str:
    """Write Python code that prints the program of a motion; `arm` is an expression such as `"'ur5e'"`."""
    kinematics, program = motion.kinematics, motion.program
    lines = [
        "from kinreach.deploy import Move, Program",
        "from kinreach.kinematics import ArmKinematics",
        *robots(arm),
        "",
        f"kin = ArmKinematics.of({arm}, tip={kinematics.tip!r}, base='base')",
        f"start = {list(program.start)!r}",
        "moves = [",
        *(
            f"    Move({move.command!r}, {move.target!r}, {move.speed!r}, {move.acceleration!r}, {move.blend!r}),"
            for move in program.moves
        ),
        "]",
        f"program = Program.of(kin, start, moves, tolerance={program.tolerance!r})",
        "print(program.text, end='')",
        "# URClient(ADDRESS).run(program) moves the robot.",
    ]
    return "\n".join(lines) + "\n"


def results_program(results: Results, index: int) -> str:
    """Write Python code that prints the end of each method on a goal."""
    return "\n".join(
        [
            "from kinreach.view import read_results",
            "",
            f"results = read_results({str(results.file)!r})",
            f"print(results.goals[{index}])",
            f"for method, end in results.ends[{index}].items():",
            "    print(method, end.reached, end.distance, end.reason, end.q)",
            "",
        ]
    )


def _frame(T: Floats) -> list[str]:
    return ["T = np.array([", *(f"    {_numbers(row)}," for row in T), "])"]


def _question(goal: Goal, *, complete: bool) -> list[str]:
    if isinstance(goal, PoseGoal):
        return [*_frame(goal.T), "solution = kin.all_solutions(T, seed=seed)" if complete else _search("PoseGoal(T)")]
    position = f"position = {_numbers(goal.frame()[:3, 3])}"
    if isinstance(goal, AxisGoal):
        asked = [position, f"axis = {_numbers(goal.axis)}"]
        solve = "solution = kin.axis_solutions(position, axis, seed=seed)"
        return [*asked, solve if complete else _search("AxisGoal(position, axis)")]
    return [
        position,
        "solution = kin.all_solutions(position, seed=seed)" if complete else _search("PositionGoal(position)"),
    ]


def _search(goal: str) -> str:
    return f"solution = LevenbergMarquardtSolver(kin).solve({goal}, seed)"


def _numbers(values: Floats | Sequence[float]) -> str:
    rounded = [round(float(value), DIGITS) + 0.0 for value in values]  # + 0.0: no minus before a zero
    return repr(rounded)

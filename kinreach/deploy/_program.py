"""Programs for a UR: moves or a trajectory, as URScript and back.

A program sets the tool centre point, checks that the robot's own kinematics is that of the arm it was planned for and
that the arm stands at the start posture, and moves only then: first to that posture exactly, so that what follows is
what was tried. It writes its progress to an integer register, which RTDE shows: 1 begun, 2 finished, 3 not at the start
posture, 4 another arm. A second register has the number of its run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import kinreach
from kinreach._checks import as_vector, check_known, check_number, shown
from kinreach.deploy._commanded import Commanded, check_moves, check_trajectory, commanded
from kinreach.deploy._controller import (
    BEGUN,
    FINISHED,
    NOT_AT_START,
    OTHER_ARM,
    REGISTER,
    RUN_REGISTER,
    check_is_ur,
    payload_of,
    rate_of,
    tcp_of,
)
from kinreach.deploy._model import ModelCheck
from kinreach.deploy._script_tree import (
    Assignment,
    Call,
    Choice,
    Constant,
    Expression,
    Name,
    Numbers,
    Operation,
    Place,
    ScriptError,
    Statement,
    list_text,
    number_text,
)
from kinreach.deploy._urscript import parse
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, Trajectory, pose, pose_vector
from kinreach.robots import ArmDescription
from kinreach.robots.inside import FLANGE, JOINTS

#: How far a joint may be from the start posture for the program to move [rad]: by default, at least, and at most.
#: Encoders of a standing UR are read within 2e-4 rad. At the default the tool of a UR5e is within 2 mm.
AT_START, MIN_AT_START, MAX_AT_START = 5e-4, 2.5e-4, 0.01
#: The way there, in URScript.
TO_START = "movej(start, a=0.5, v=0.05)"
#: Largest speeds and accelerations of the tool [m/s], [m/s^2], and of a joint's acceleration [rad/s^2].
MAX_TOOL_SPEED, MAX_TOOL_ACCELERATION, MAX_ACCELERATION = 1.0, 5.0, 10.0
#: Shortest control cycle of a UR [s].
CYCLE = 0.002
#: Settings of `servoj`, those of Universal Robots' ROS driver; how long the end is held [s]; deceleration [rad/s^2].
LOOKAHEAD, GAIN, HOLD, STOP = 0.03, 2000.0, 0.3, 2.0
#: Decimals of the tool centre point [m, rad]: what is beyond them is rounding.
ROUNDED = 9
#: Variables of a program: how far the robot's own pose is from kinreach's, and whether that is too far; entries of the
#: first one that are lengths, and those that are angles.
OFF, OTHER = "off", "other_arm"
_PARTS = ((0, 1, 2), (3, 4, 5))
NAME, STOP_NAME = "kinreach_program", "kinreach_stop"
#: Deceleration of the joints when a program is stopped [rad/s^2].
STOPPING = 4


def name_of_run(run: int) -> str:
    """Return the name of a program in one of its runs; 0 is none."""
    return f"{NAME}_{run}" if run else NAME


def stop_script(run: int) -> str:
    """Return the program that stops a UR: one of its own, which ends the one that runs."""
    return f"def {STOP_NAME}():\n  write_output_integer_register({RUN_REGISTER}, {run})\n  stopj({STOPPING})\nend\n"


@dataclass(frozen=True)
class Move:
    """A move of a program.

    Attributes:
        command: `"movej"`, on a straight line in joint space, or `"movel"`, with the tool on a straight line.
        target: Joint angles [rad] of `movej`; of `movel` the pose of the tool centre point in the controller's frame
            `base`, `[x, y, z, rx, ry, rz]` [m, rad].
        speed: Of the joint with the longest way [rad/s], or of the tool [m/s].
        acceleration: As `speed` [rad/s^2], [m/s^2].
        blend: How far from the target the tool may begin with the next move [m]; 0 stops there.

    Raises:
        InputError: A value that cannot be used.
    """

    command: str
    target: tuple[float, ...]
    speed: float
    acceleration: float
    blend: float = 0.0

    def __post_init__(self) -> None:
        check_known("command", self.command, ("movej", "movel"))
        object.__setattr__(self, "target", tuple(as_vector("target", self.target, 6, most=100.0).tolist()))
        fastest = 100.0 if self.command == "movej" else MAX_TOOL_SPEED
        hardest = MAX_ACCELERATION if self.command == "movej" else MAX_TOOL_ACCELERATION
        check_number(f"speed of {self.command}", self.speed, above=0.0, most=fastest)
        check_number(f"acceleration of {self.command}", self.acceleration, above=0.0, most=hardest)
        check_number("blend [m]", self.blend, least=0.0, most=2.0)

    @property
    def text(self) -> str:
        """The line of URScript that makes this move."""
        target = list_text(self.target) if self.command == "movej" else f"p{list_text(self.target)}"
        numbers = (self.acceleration, self.speed, self.blend)
        return f"{self.command}({target}, a={{}}, v={{}}, r={{}})".format(*map(number_text, numbers))


@dataclass(frozen=True)
class Program:
    """A program for one UR: moves, or a trajectory that is streamed by `servoj`.

    Attributes:
        start: Posture in which it may begin [rad], shape (6,).
        tcp: Tool centre point on the flange, `[x, y, z, rx, ry, rz]` [m, rad].
        moves: In their order; empty if there is a trajectory.
        trajectory: With an even rate, from the start posture; None if there are moves.
        payload: Mass of the tool [kg], which the program sets; None leaves what is set on the robot.
        centre_of_mass: Of the tool, on the flange [m].
        arm: Which arm it is for, for the comment at its top.
        tolerance: How far a joint may be from the start posture for the program to move [rad], 2.5e-4 to 0.01.
        model: What the robot's own kinematics must be for the program to move it; None moves any.

    Raises:
        InputError: Neither moves nor a trajectory, or both; the last move has a blend radius; a trajectory of other
            joints, that does not begin in the start posture, or has no even rate.

    Examples:
        >>> from kinreach.deploy import Move, Program
        >>> from kinreach.kinematics import ArmKinematics
        >>> kin = ArmKinematics.of("ur5e", base="base")
        >>> home = kin.arm.home
        >>> program = Program.of(kin, home, [Move("movej", (0.5, *home[1:]), 1.0, 2.0)])
        >>> "movej" in program.text
        True
    """

    start: tuple[float, ...]
    tcp: tuple[float, ...]
    moves: tuple[Move, ...] = ()
    trajectory: Trajectory | None = None
    payload: float | None = None
    centre_of_mass: tuple[float, ...] = (0.0, 0.0, 0.0)
    arm: str = "UR"
    tolerance: float = AT_START
    model: ModelCheck | None = None

    def __post_init__(self) -> None:
        for name, size in (("start", 6), ("tcp", 6), ("centre_of_mass", 3)):
            object.__setattr__(self, name, tuple(as_vector(name, getattr(self, name), size, most=100.0).tolist()))
        object.__setattr__(self, "moves", tuple(self.moves))
        if self.payload is not None:
            check_number("payload [kg]", self.payload, least=0.0, most=100.0)
        check_number("tolerance [rad]", self.tolerance, least=MIN_AT_START, most=MAX_AT_START)
        if bool(self.moves) == (self.trajectory is not None):
            raise InputError("a program has moves or a trajectory, and not both")
        if self.moves and self.moves[-1].blend:
            raise InputError(f"the last move must stop, its blend is {self.moves[-1].blend:g} m")
        if self.trajectory is not None:
            _check_even(self.trajectory)
            if not np.abs(self.trajectory.q[0] - self.start).max() <= self.tolerance:
                raise InputError("the trajectory does not begin in the start posture")

    @classmethod
    def of(
        cls, kinematics: ArmKinematics, start: ArrayLike, motion: Sequence[Move] | Trajectory, **settings: Any
    ) -> Program:
        """Return the program for an arm: with its tool centre point, kinematics, title, and a trajectory at its rate.

        Args:
            kinematics: Of the UR with its tool. Its tip is the tool centre point.
            start: Posture in which the program may begin [rad], shape (6,).
            motion: Moves; or a trajectory, which is sampled 125 times a second for a CB3 and 500 times for later ones.
            settings: `payload` and `centre_of_mass`, by default those of the arm's tool, if it has a mass; `tolerance`;
                `model=None` lets the program move another arm, too.

        Raises:
            InputError: Not a UR, a motion faster than the arm's joints, blends that overlap, or as in the class.
        """
        arm = kinematics.arm
        check_is_ur(arm)
        if "payload" not in settings and (tool := payload_of(arm)) is not None:
            settings = {"payload": tool[0], "centre_of_mass": tool[1], **settings}
        tcp = tuple(pose_vector(tcp_of(replace(arm, default_tip=kinematics.tip))).round(ROUNDED).tolist())
        posture = tuple(kinematics.as_posture("start", start).tolist())
        settings = {"model": ModelCheck.of(arm), **settings}
        if isinstance(motion, Trajectory):
            program = cls(posture, tcp, trajectory=motion.resampled(rate_of(arm)), arm=arm.title, **settings)
        else:
            program = cls(posture, tcp, tuple(motion), arm=arm.title, **settings)
        if program.trajectory is not None:
            check_trajectory(kinematics, program.trajectory)
        else:
            check_moves(kinematics, program.moves, motion_of(program, arm))
        return program

    @property
    def text(self) -> str:
        """The program in URScript, as a UR runs it."""
        return self.text_of_run(0)

    def text_of_run(self, run: int) -> str:
        """Return the program as `URClient` sends it: `text` with the number of a run in its name and in a register."""
        most = number_text(self.tolerance)
        off = " or ".join(f"norm(q[{joint}] - start[{joint}]) > {most}" for joint in range(6))
        motion = _unless(off, NOT_AT_START, "The arm is not at the start posture of this program.", [
            f"write_output_integer_register({REGISTER}, {BEGUN})",
            TO_START,
            *self._motion(),
            f"write_output_integer_register({REGISTER}, {FINISHED})",
        ])  # fmt: skip
        if self.model is not None:
            warning = "This is not the arm that this program was planned for: another model or calibration."
            motion = _unless(OTHER, OTHER_ARM, warning, motion)
        lines = [
            *(f"# {line}" for line in self._header()),
            f"write_output_integer_register({REGISTER}, 0)",  # first: the last run's is not this one's
            f"write_output_integer_register({RUN_REGISTER}, {run})",
            f"set_tcp(p{list_text(self.tcp)})",
            *([] if self.payload is None else [f"set_payload({number_text(self.payload)}, {self._centre})"]),
            *([] if self.model is None else _comparison(self.model)),
            f"start = {list_text(self.start)}",
            "q = get_actual_joint_positions()",
            *motion,
        ]
        return "\n".join([f"def {name_of_run(run)}():", *(f"  {line}" for line in lines), "end"]) + "\n"

    @property
    def _centre(self) -> str:
        return list_text(self.centre_of_mass)

    def _header(self) -> list[str]:
        """Lines of the comment at the top."""
        degrees = ", ".join(f"{angle:.3f}" for angle in np.degrees(self.start))
        payload = "as it is set on the robot" if self.payload is None else f"{self.payload:g} kg at {self._centre} m"
        return [
            _one_line(f"Written by kinreach {kinreach.__version__} for: {self.arm}"),
            "Lengths in metres, angles in radians. Poses are those of the tool centre point in the frame base.",
            f"Tool centre point on the flange: {list_text(self.tcp)}. Payload: {payload}.",
            f"Begins only at the joint angles {degrees} degrees, each within {np.degrees(self.tolerance):.3f}.",
            *([] if self.model is None else ["Moves only an arm whose own kinematics is that of the one it is for."]),
            "Tried in simulation only. Keep a hand at the emergency stop, and begin with the speed slider low.",
        ]

    def _motion(self) -> list[str]:
        if self.trajectory is None:
            return [move.text for move in self.moves]
        period = number_text(float(self.trajectory.t[1]))
        how = f"lookahead_time={number_text(LOOKAHEAD)}, gain={number_text(GAIN)}"
        lines = [f"servoj({list_text(q)}, t={period}, {how})" for q in self.trajectory.q[1:]]
        end = f"servoj({list_text(self.trajectory.q[-1])}, t={number_text(HOLD)}, {how})"
        return [*lines, end, f"stopj({number_text(STOP)})"]

    @classmethod
    def parse(cls, text: str) -> Program:
        """Read a program that kinreach wrote.

        Args:
            text: The program; nothing is executed.

        Raises:
            InputError: It is not of the form that `text` has; the message names the line.
        """
        script = parse(text)
        start: tuple[float, ...] | None = None
        settings: dict[str, Any] = {}
        motion: tuple[Statement, ...] = ()
        comparisons: list[tuple[Assignment, Choice]] = []
        for statement, after in pairwise([*script.body, None]):
            if isinstance(statement, Assignment) and statement.name == "start":
                start = _constants(statement.value, statement.place)
            elif isinstance(statement, Assignment) and statement.name == OFF and isinstance(after, Choice):
                comparisons.append((statement, after))
            elif isinstance(statement, Call) and statement.function == "set_tcp":
                settings["tcp"] = _constants(statement.arguments["pose"], statement.place)
            elif isinstance(statement, Call) and statement.function == "set_payload":
                settings["payload"] = _constant(statement.arguments["m"], statement.place)
                settings["centre_of_mass"] = _constants(statement.arguments["cog"], statement.place)
            elif isinstance(statement, Choice) and statement.otherwise:
                choice = statement
                while isinstance(choice.otherwise[-1], Choice):  # the start posture is compared after the arm
                    choice = choice.otherwise[-1]
                settings["tolerance"], motion = _tolerance(choice), choice.otherwise
        if comparisons:
            settings["model"] = _model(comparisons)
        calls = [call for call in motion if isinstance(call, Call) and call.function in ("movej", "movel", "servoj")]
        if calls and calls[0].arguments.get("q") == Name("start"):
            del calls[0]
        if start is None or "tcp" not in settings or not calls:
            raise InputError("this is not a program of kinreach: it needs set_tcp, start = [...] and moves after else")
        if calls[0].function == "servoj":
            settings["trajectory"] = _trajectory(start, calls)
        else:
            settings["moves"] = tuple(map(_move, calls))
        return cls(start, **settings)


def motion_of(program: Program, arm: ArmDescription) -> Commanded:
    """Return what the moves of a program command the joints of an arm, cycle by cycle."""
    flange = ArmKinematics(arm, tip=FLANGE, base="base")
    return commanded(flange, pose(program.tcp), np.array(program.start), program.moves, 1.0 / rate_of(arm))


def _tolerance(choice: Choice) -> float:
    """Read how far a joint may be off, in a condition with a comparison for each."""
    comparisons, condition = list[float](), choice.condition
    while isinstance(condition, Operation):
        either = condition.sign == "or"
        comparison = condition.right if either else condition
        if isinstance(comparison, Operation) and comparison.sign == ">":
            comparisons.append(_constant(comparison.right, choice.place))
        condition = condition.left if either else Constant(True)
    if len(comparisons) != len(JOINTS) or len(set(comparisons)) > 1:
        raise ScriptError(choice.place, "the check of the start posture compares each of six joints with one tolerance")
    return comparisons[0]


def _unless(condition: str, status: int, warning: str, otherwise: Sequence[str]) -> list[str]:
    """Return lines that do something else under a condition: write a status, show a warning, and move nothing."""
    refusal = [
        f"write_output_integer_register({REGISTER}, {status})",
        f'popup("{warning} Nothing was moved.", title="kinreach", warning=True)',
        "sleep(0.1)",  # a client that reads the state every cycle sees that it ran
    ]
    inner = ([f"  {line}" for line in lines] for lines in (refusal, otherwise))
    return [f"if {condition}:", *next(inner), "else:", *next(inner), "end"]


def _comparison(model: ModelCheck) -> list[str]:
    """Return lines that set the variable `OTHER` if the robot's own kinematics is another one."""
    far, degrees = model.most
    most = number_text(far), number_text(round(float(np.radians(degrees)), ROUNDED))
    lines = [f"{OTHER} = False", f"flange = p{list_text((0.0,) * 6)}"]
    for q, here in zip(model.postures, model.poses, strict=True):
        there = f"get_forward_kin({list_text(q)}, flange)"
        distance, angle = (f"norm([{', '.join(f'{OFF}[{place}]' for place in places)}])" for places in _PARTS)
        lines += [
            f"{OFF} = pose_trans(pose_inv(p{list_text(here)}), {there})",
            f"if {distance} > {most[0]} or {angle} > {most[1]}:",
            f"  {OTHER} = True",
            "end",
        ]
    return lines


def _model(comparisons: Sequence[tuple[Assignment, Choice]]) -> ModelCheck:
    """Read what `_comparison` wrote."""
    postures, poses, most = [], [], (0.0, 0.0)
    for assignment, choice in comparisons:
        try:
            here, there = assignment.value.arguments.values()  # type: ignore[union-attr]
            poses.append(_constants(here.arguments["p_from"], assignment.place))  # type: ignore[union-attr]
            postures.append(_constants(there.arguments["q"], assignment.place))  # type: ignore[union-attr]
            far, turned = (side.right for side in (choice.condition.left, choice.condition.right))  # type: ignore[union-attr]
        except (AttributeError, KeyError, ValueError):
            raise ScriptError(assignment.place, "a comparison of the arm's kinematics is needed here") from None
        most = _constant(far, choice.place), round(float(np.degrees(_constant(turned, choice.place))), 6)
    return ModelCheck(tuple(postures), tuple(poses), most)


def _trajectory(start: tuple[float, ...], calls: Sequence[Call]) -> Trajectory:
    """Read the motion of `servoj` lines, without the last one, which holds the end."""
    for call in calls:
        if call.function != "servoj":
            raise ScriptError(call.place, f"{call.function} among the servoj of a trajectory")
    period = _constant(calls[0].arguments["t"], calls[0].place)
    steps = [call for call in calls if _constant(call.arguments["t"], call.place) == period]
    rows = [_constants(call.arguments["q"], call.place) for call in steps]
    for call, row in zip(steps, rows, strict=True):
        if len(row) != len(JOINTS):
            raise ScriptError(call.place, f"servoj takes six joint angles, got {len(row)}")
    q = np.array([start, *rows])
    t = period * np.arange(len(q), dtype=np.float64)
    qd = np.gradient(q, period, axis=0)
    qd[0] = qd[-1] = 0.0
    return Trajectory(JOINTS, t, q, qd)


def _move(call: Call) -> Move:
    numbers = {name: _constant(call.arguments[name], call.place) for name in ("a", "v", "t", "r")
               if name in call.arguments}  # fmt: skip
    if "a" not in numbers or numbers["t"]:
        raise ScriptError(call.place, f"{call.function} is not a move with a and v")
    target = call.arguments["q" if call.function == "movej" else "pose"]
    if not isinstance(target, Numbers) or target.is_pose is not (call.function == "movel"):
        raise ScriptError(
            call.place, f"{call.function} takes {'a pose' if call.function == 'movel' else 'joint angles'}"
        )
    return Move(call.function, _constants(target, call.place), numbers["v"], numbers["a"], numbers["r"])


def _constant(expression: Expression, place: Place) -> float:
    if isinstance(expression, Constant) and isinstance(expression.value, float):
        return expression.value
    raise ScriptError(place, "a number is needed here")


def _constants(expression: Expression, place: Place) -> tuple[float, ...]:
    if not isinstance(expression, Numbers):
        raise ScriptError(place, "a list of numbers is needed here")
    return tuple(_constant(entry, place) for entry in expression.entries)


def _one_line(text: str) -> str:
    return "".join(sign if sign.isprintable() else "?" for sign in text)


def _check_even(trajectory: Trajectory) -> None:
    if trajectory.joints != JOINTS:
        raise InputError(f"the joints of a UR's trajectory must be {', '.join(JOINTS)}; got {shown(trajectory.joints)}")
    steps = np.diff(trajectory.t)
    if not len(steps) or np.ptp(steps) > 1e-6 * steps[0]:
        raise InputError("the trajectory must have two samples or more at an even rate; `resampled` makes them")
    cycles = float(trajectory.t[1]) / CYCLE
    if abs(cycles - max(1, round(cycles))) > 1e-6:
        raise InputError(
            f"the trajectory has a sample every {1000 * steps[0]:.6g} ms, and a UR takes them in whole control cycles "
            "of 2 ms, or 8 ms for a CB3; `resampled(500)` or `resampled(125)` makes them"
        )

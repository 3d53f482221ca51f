"""`kinreach move`: plan a motion of a UR, try it in MuJoCo, and write it as a program or send it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import Floats, check_number, check_path, printable
from kinreach._files import replacing, write_text
from kinreach._flags import numbers_of, pose_numbers_of, posture_of
from kinreach._rotations import pose_error
from kinreach.cli import Parser, print_notes, say
from kinreach.deploy._client import URClient
from kinreach.deploy._controller import FINISHED, Controller, Recording, check_is_ur, tcp_of
from kinreach.deploy._model import (
    MAX_OFF_CALIBRATED,
    DhFigures,
    ModelCheck,
    allowed,
    apart,
    is_calibrated,
    nearest_models,
)
from kinreach.deploy._planning import SPEED, Leg, planned_program
from kinreach.deploy._primary import PRIMARY_PORT
from kinreach.deploy._program import Program
from kinreach.deploy._remarks import tool_note, why_none
from kinreach.deploy._rtde import RTDE_PORT
from kinreach.deploy._states import RobotState
from kinreach.deploy._surroundings import add_surroundings, surrounded
from kinreach.errors import InputError, PathError, RobotError
from kinreach.kinematics import (
    ArmKinematics,
    ClosedFormKinematics,
    CollisionChecker,
    Trajectory,
    joint_line,
    pose,
    pose_vector,
)
from kinreach.kinematics.inside import PATH_MARGIN, described, postures_of
from kinreach.robots import ArmDescription
from kinreach.robots.inside import ArmFlags

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Distance from everything that what is sent keeps [m], and how much more its samples keep, so that it does between
#: them, too.
KEEPS, SAMPLING = PATH_MARGIN, 2.5e-4
#: So long the robot may take to say the figures of its kinematics, which it does on connecting [s].
FIGURES_TIMEOUT = 1.0
HOME = "home"


def main(argv: Sequence[str], *, prog: str) -> int:
    """Plan, try, and write or send a motion; return 1 if the user does not agree to send it."""
    arguments = _parser(prog).parse_args(argv)
    script, picture = _output("--script", arguments.script), _output("--picture", arguments.picture)
    if arguments.robot is not None and arguments.start is not None:
        raise InputError("with --robot the motion begins where the robot stands; leave out --from")
    ports = [int(number) for number in numbers_of("--ports", arguments.ports, 2)]
    check_number("--speed", arguments.speed, above=0.0, most=1.0)
    goals = [pose(pose_numbers_of("--to", text, strict=True)) for text in arguments.to]
    arm = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(arm.notes)
    check_is_ur(arm)
    arm = surrounded(ArmKinematics(arm, base="base"), arguments, cell=not arguments.no_cell)
    job = _Job(
        arm, goals,
        linear=arguments.linear, speed=arguments.speed, blend=arguments.blend,
        branch=None if arguments.branch is None else _branch_of(arguments.branch),
        max_travel=_max_travel(arguments.max_travel, degrees=arguments.degrees),
    )  # fmt: skip
    if arguments.robot is None:
        start = _start(arguments.start, arm, degrees=arguments.degrees)
        job.tried(start, script, picture)
        return 0
    with URClient(arguments.robot, rtde_port=ports[0], script_port=ports[1]) as robot:
        figures = robot.wait_for_figures(FIGURES_TIMEOUT)
        state = robot.read()
        say(f"robot    {job.same_arm(state, figures, arguments.robot)}")
        program = job.tried(state.actual_q, script, picture)
        if not (arguments.yes or _agreed(arguments.robot)):
            say("nothing was sent")
            return 1
        return job.moved(robot, program)


def _output(flag: str, text: str | None) -> Path | None:
    path = None if text is None else check_path(flag, text)
    if path is not None and (path.is_dir() or not path.parent.is_dir()):
        raise InputError(f"{flag} must be a file in a folder that exists, got {path}")
    return path


class _Job:
    def __init__(
        self,
        arm: ArmDescription,
        goals: Sequence[Floats],
        *,
        linear: bool,
        speed: float,
        blend: float,
        branch: int | str | None = None,
        max_travel: float | None = None,
    ) -> None:
        kin = ArmKinematics.of(arm, base="base")
        if not isinstance(kin, ClosedFormKinematics):
            raise InputError(f"{arm.title} has not the geometry of a UR")
        self.arm, self.kinematics, self.goals = arm, kin, goals
        self.linear, self.speed, self.blend = linear, speed, blend
        self.branch, self.max_travel = branch, max_travel
        self.checker = CollisionChecker(kin, margin=KEEPS + SAMPLING)
        self.flange, self.tcp = ArmKinematics(arm, tip="tool0", base="base"), tcp_of(arm)
        self.model = ModelCheck.of(arm)

    def tried(self, start: Floats, script: Path | None, picture: Path | None) -> Program:
        """Plan from a posture, run the program in MuJoCo, print the outcome, and write program and picture.

        Raises:
            InputError: No way was found, or the program does not come to its end.
        """
        kin = self.kinematics
        legs, program, done = self._planned(start)
        for line in _cautions(kin, legs):
            say(line)
        say(f"{self.arm.title}: tip {kin.tip} in {kin.base}, degrees")
        say(f"from     {_degrees(start)}")
        for leg in legs:
            say(_described(kin, leg))
        if done.status != FINISHED or done.reason:
            raise InputError(f"the dry run did not come to its end, nothing is sent: {done.reason}")
        for line in self._measured(done):
            say(line)
        if script is not None:
            write_text(script, program.text)
            say(f"wrote    {script}")
        if picture is not None:
            figure = draw_motion(done.commanded, kin.velocity_limit, f"{self.arm.title}, tried in MuJoCo")
            with replacing(picture) as temporary:
                figure.savefig(temporary, facecolor="white", format="png")
            say(f"picture  {picture}")
        return program

    def _planned(self, start: Floats) -> tuple[list[Leg], Program, Recording]:
        """Plan from a posture, and run the program in MuJoCo.

        Raises:
            InputError: The way that was run comes nearer to something than it may.
        """
        legs, program = planned_program(
            self.kinematics, self.checker, start, self.goals,
            keeps=KEEPS, linear=self.linear, speed=self.speed, blend=self.blend,
            branch=self.branch, max_travel=self.max_travel,
        )  # fmt: skip
        done = Controller(self.arm, q=start.tolist()).run(program.text)
        if done.status == FINISHED and not done.reason:
            try:
                joint_line(self.checker, done.commanded.q, keeps=KEEPS)
            except PathError as error:
                raise InputError(f"the dry run comes too near to something, nothing is sent: {error}") from None
        return legs, program, done

    def _measured(self, done: Recording) -> Iterator[str]:
        kin = self.kinematics
        shares = np.abs(done.commanded.qd).max(axis=0) / kin.velocity_limit
        joint = int(shares.argmax())
        tips = kin.positions(done.commanded.q)
        tool = np.linalg.norm(np.diff(tips, axis=0), axis=1).max(initial=0.0) / done.commanded.t[1]
        name = kin.arm.joints[joint].removesuffix("_joint")
        yield (
            f"dry run  {done.commanded.duration:.2f} s; {name} at most {np.abs(done.commanded.qd[:, joint]).max():.2f} "
            f"rad/s, {100 * shares[joint]:.0f} % of its limit; tool at most {tool:.2f} m/s"
        )
        around = ", ".join(box.name for box in self.arm.workcell.obstacles)
        yield f"         no collision with itself{f', {around}' if around else '; nothing around it is known'}"
        yield f"         every way keeps {1e3 * KEEPS:g} mm from everything"
        if note := tool_note(self.checker):
            yield f"         {note}"
        yield f"         ends {self._miss(self.kinematics.fk(done.measured.q[-1]))} from the goal"

    def _miss(self, T: Floats) -> str:
        return _far(_difference(T, self.goals[-1]))

    def same_arm(self, state: RobotState, figures: DhFigures | None, address: str) -> str:
        """Compare the robot's tool and kinematics with kinreach's, and describe the difference.

        Args:
            state: Its newest state.
            figures: Of its kinematics, if it says them.
            address: For messages.

        Raises:
            RobotError: It has another tool centre point on its flange, or is another arm.
        """
        offset = state.tcp_offset
        if offset is not None and apart(MAX_OFF_CALIBRATED, *_difference(pose(offset), self.tcp)):
            there, here = (_listed(six) for six in (offset, pose_vector(self.tcp)))
            raise RobotError(
                f"the TCP of the robot at {address} is {there}; kinreach's tool is {here}. Give --tool {there}, with "
                "--tool-radius or --tool-mesh so that it can collide, or set the TCP on the robot"
            )
        tcp, seen = self.tcp if offset is None else pose(offset), pose(state.tcp_pose)
        off = _difference(self.flange.fk(state.actual_q) @ tcp, seen)
        self._check_model(off, "in its posture", None, address)
        advice = "" if is_calibrated(self.arm) else "; with --calibration it would be less"
        said = f"{address}: its tool centre point is {_far(off)} from kinreach's"
        # figures that do not give the robot's own pose are not understood
        if figures is None or apart(MAX_OFF_CALIBRATED, *_difference(figures.fk(state.actual_q) @ tcp, seen)):
            return said + advice
        anywhere = self.model.difference(figures.fk)
        self._check_model(anywhere, "in other postures", figures, address)
        return f"{said}, and at most {_far(anywhere)} in other postures{advice}"

    def _check_model(self, off: tuple[float, float], where: str, figures: DhFigures | None, address: str) -> None:
        """Refuse a robot whose flange is too far from kinreach's, or whose figures another data sheet fits better."""
        calibrated = is_calibrated(self.arm)
        names = [] if figures is None else nearest_models(figures.fk)
        nearer = bool(names) and not calibrated and names != nearest_models(self.flange.fk)
        if not nearer and not apart(allowed(self.arm), *off):
            return
        kind = "another calibration or another model" if calibrated else "another model"
        like = f"; its own figures are nearest to those of a {' or '.join(names)}" if names else ""
        raise RobotError(
            f"the robot at {address} is not this {self.arm.title}: {where} its tool is {_far(off)} from where kinreach "
            f"has it; it has {kind}{like}"
        )

    def moved(self, robot: URClient, program: Program) -> int:
        """Send a program if the robot is still as it was, wait for its end, and print how it ended."""
        done = robot.run(program, check=lambda state: self.same_arm(state, None, robot.address))
        off = 1000 * np.abs(done.measured.q - done.commanded.q).max()
        say(
            f"moved    {done.commanded.duration:.2f} s; joints at most {off:.1f} mrad from what was commanded; ends "
            f"{self._miss(pose(robot.read().tcp_pose))} from the goal"
        )
        if done.missing:
            cycles = len(done.commanded.t) + done.missing
            say(f"         the recording is cut: {done.missing} of {cycles} control cycles were not received")
        return 0


def _difference(one: Floats, other: Floats) -> tuple[float, float]:
    """Return the distance [m] and the angle [degrees] between two poses."""
    far, angle = pose_error(one, other)
    return far, float(np.degrees(angle))


def _far(off: tuple[float, float]) -> str:
    return f"{1000 * off[0]:.2f} mm and {off[1]:.2f}°"


def _listed(six: Floats) -> str:
    return ",".join(f"{number:.6g}" for number in six.round(6) + 0.0)


def _start(text: str | None, arm: ArmDescription, *, degrees: bool) -> Floats:
    if text in (None, HOME):
        return np.array(arm.home)
    kin = ArmKinematics.of(arm, base="base")
    words, row, numbers = str(text).rpartition("@")
    if not row:
        return posture_of("--from", numbers, 6, degrees=degrees, limits=(kin.lower, kin.upper))
    T, home = pose(pose_numbers_of("--from", numbers, strict=True)), np.array(arm.home)
    if not isinstance(kin, ClosedFormKinematics):
        raise InputError(f"{arm.title} has not the geometry of a UR")
    solutions = kin.all_solutions(T, seed=home)
    if not len(solutions):
        raise InputError(f"--from: the pose has no posture: {why_none(kin, T, solutions.reason)}")
    try:
        return postures_of(kin, solutions, _branch_of(words), home)[0]
    except InputError as error:
        raise InputError(f"--from: {error}") from None


def _degrees(q: Floats) -> str:
    return "  ".join(f"{angle:7.1f}" for angle in np.degrees(q))


def _branch_of(text: str) -> int | str:
    return int(text) if text.strip().isdecimal() else text


def _max_travel(text: str | None, *, degrees: bool) -> float | None:
    if text is None:
        return None
    most = numbers_of("--max-travel", text, 1)[0]
    check_number("--max-travel", most, above=0.0)
    return float(np.radians(most)) if degrees else most


def _cautions(kin: ClosedFormKinematics, legs: Sequence[Leg]) -> Iterator[str]:
    """Say of each way that it turns a joint by more than half a turn, or ends in another branch than it began in."""
    for number, leg in enumerate(legs, start=1):
        to = f"to goal {number} " if len(legs) > 1 else ""
        joint = int(leg.travels.argmax())
        if leg.travels[joint] > np.pi:
            name = kin.arm.joints[joint].removesuffix("_joint")
            yield f"caution  {to}{name} turns by {np.degrees(leg.travels[joint]):.0f}°, more than half a turn"
        if leg.branch != leg.before and min(leg.branch, leg.before) >= 0:
            before, after = (described(kin, branch) for branch in (leg.before, leg.branch))
            yield f"caution  {to}the arm leaves its branch: from {before} to {after}"


def _described(kin: ClosedFormKinematics, leg: Leg) -> str:
    last, widest = leg.moves[-1], max(move.blend for move in leg.moves)
    branch = f"branch {described(kin, leg.branch)}" if leg.branch >= 0 else "no branch of the closed form"
    count = f"{len(leg.moves)} x " if len(leg.moves) > 1 else ""
    blend = f", blend {1000 * widest:.0f} mm" if widest else ""
    if leg.reduced:
        blend += f" (reduced from {1000 * leg.reduced:.0f} mm, to keep {1e3 * KEEPS:g} mm from everything)"
    speed = f"{last.speed:.2f} {'rad/s' if last.command == 'movej' else 'm/s'}"
    return (
        f"to       {_degrees(leg.end)}\n"
        f"         {branch}, {leg.free} of {leg.postures} postures free; {count}{last.command}, {speed}{blend}; "
        f"a joint turns by {np.degrees(leg.travels.max()):.0f}° at most"
    )


def _agreed(address: str) -> bool:
    try:
        return input(f"Move the robot at {printable(address)} now? Ctrl-C stops it. [y/N] ").strip().lower() == "y"
    except EOFError:
        raise InputError("nobody answers whether the robot may move; give --yes") from None


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Plan a motion of a UR, try it in MuJoCo, and write it as URScript or send it. Without --script "
        "and --robot it is only tried.",
    )
    parser.add_argument("--arm", required=True, metavar="NAME|FILE", help="a UR: ur3 to ur30, or its URDF")
    parser.add_argument(
        "--to",
        required=True,
        action="append",
        metavar="X,Y,Z,RX,RY,RZ",
        help="goal of the tool in the frame base, as on the pendant: metres, rotation vector in radians; repeat it for "
        "further goals",
    )
    parser.add_argument(
        "--from",
        dest="start",
        metavar="Q1,...,Q6|BRANCH@POSE",
        help=f"start posture in radians; or a row of `kinreach ik`: its branch, @, and the pose; or {HOME} (default)",
    )
    parser.add_argument("--degrees", action="store_true", help="the angles of --from and --max-travel are degrees")
    parser.add_argument(
        "--branch",
        metavar="N|WORDS|same",
        help="how the arm is bent at every goal: the number or words of `kinreach ik`, such as "
        "'right, up, straight' or only 'up'; or as in the start posture (default: whichever is nearest along the way)",
    )
    parser.add_argument(
        "--max-travel", metavar="RAD", help="largest way of a joint to a goal, in radians or with --degrees in degrees"
    )
    parser.add_argument("--linear", action="store_true", help="move the tool on straight lines")
    parser.add_argument(
        "--speed", type=float, default=SPEED, metavar="PART", help="of the joints' limits, or of 1 m/s (%(default)s)"
    )
    parser.add_argument(
        "--blend",
        type=float,
        default=0.0,
        metavar="M",
        help="radius at all goals but the last, and where a way around obstacles turns if it stays free (0: stop)",
    )
    parser.add_argument("--script", metavar="FILE", help="write the program")
    parser.add_argument("--picture", metavar="FILE.png", help="draw joint angles and speeds of the dry run")
    parser.add_argument("--robot", metavar="ADDRESS", help="read the start posture from this robot, ask, and move it")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument(
        "--ports", default=f"{RTDE_PORT},{PRIMARY_PORT}", metavar="RTDE,SCRIPT", help="of the robot (%(default)s)"
    )
    parser.add_argument("--no-cell", action="store_true", help="no table and no floor around the arm")
    add_surroundings(parser, "the frame base, as on the pendant")
    ArmFlags.add_to(parser)
    return parser


def draw_motion(trajectory: Trajectory, speed_limit: Floats, title: str) -> Figure:
    """Draw joint angles and speeds over time.

    Args:
        trajectory: The motion.
        speed_limit: Of the joints [rad/s], shape (n,).
        title: Of the figure.
    """
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    from kinreach.plots import label_ends, new_figure
    from kinreach.plots.inside import name_label

    figure, (angles, speeds) = new_figure(name_label(title), columns=2, size=(9.0, 4.0))
    names = [name_label(joint.removesuffix("_joint")) for joint in trajectory.joints]
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(names)))
    colours = {name: to_hex(shade) for name, shade in zip(names, shades, strict=True)}
    degrees, shares = np.degrees(trajectory.q), 100.0 * trajectory.qd / speed_limit
    for joint, name in enumerate(names):
        angles.plot(trajectory.t, degrees[:, joint], color=colours[name])
        speeds.plot(trajectory.t, shares[:, joint], color=colours[name])
    for axes in (angles, speeds):
        axes.set_xlim(0.0, trajectory.duration)
        axes.set_xlabel("time [s]")
    angles.set_ylabel("joint angle [degrees]")
    speeds.set_ylabel("joint speed [% of its limit]")
    ends = {name: (trajectory.duration, end) for name, end in zip(names, degrees[-1], strict=True)}
    label_ends(angles, ends, colours)
    return figure

"""`kinreach move`: plan a motion of a UR, try it in MuJoCo, and write it as a program or send it."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from kinreach._checks import Floats, check_number, check_path, printable
from kinreach._files import replacing, write_text
from kinreach.cli import Parser, say
from kinreach.deploy._client import RobotState, URClient
from kinreach.deploy._controller import FINISHED, Controller, Recording, check_is_ur, tcp_of
from kinreach.deploy._planning import SPEED, Leg, planned_program
from kinreach.deploy._program import Program
from kinreach.deploy._rtde import RTDE_PORT
from kinreach.deploy._server import PRIMARY_PORT
from kinreach.errors import InputError, PathError, RobotError
from kinreach.kinematics import ArmKinematics, CollisionChecker, joint_line, pose, pose_vector
from kinreach.kinematics._closed_form import ClosedFormKinematics
from kinreach.kinematics._collision import PATH_MARGIN
from kinreach.kinematics._goals import pose_error
from kinreach.kinematics._remarks import tool_note
from kinreach.kinematics._surroundings import add_surroundings, surrounded
from kinreach.robots import ArmDescription
from kinreach.robots._flags import (
    add_arm_flags,
    arm_of,
    numbers_of,
    pose_numbers_of,
    posture_of,
    print_notes,
)

#: Largest distance of the robot's own tool centre point from kinreach's [m, degrees]: with its calibration (0.08 mm on
#: the one controller whose poses are known), and by the data sheet.
MAX_OFF_CALIBRATED, MAX_OFF = (5e-4, 0.1), (2e-2, 2.0)
#: Distance from everything that what is sent keeps [m], and how much more its samples keep, so that it does between
#: them, too.
KEEPS, SAMPLING = PATH_MARGIN, 2.5e-4
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
    print_notes(arm := arm_of(arguments.arm, arguments))
    check_is_ur(arm)
    arm = surrounded(ArmKinematics(arm, base="base"), arguments, cell=not arguments.no_cell)
    job = _Job(arm, goals, linear=arguments.linear, speed=arguments.speed, blend=arguments.blend)
    if arguments.robot is None:
        start = _start(arguments.start, arm, degrees=arguments.degrees)
        job.tried(start, script, picture)
        return 0
    with URClient(arguments.robot, rtde_port=ports[0], script_port=ports[1]) as robot:
        state = robot.read()
        say(job.same_arm(state, arguments.robot))
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
    ) -> None:
        kin = ArmKinematics.of(arm, base="base")
        if not isinstance(kin, ClosedFormKinematics):
            raise InputError(f"{arm.title} has not the geometry of a UR")
        self.arm, self.kinematics, self.goals = arm, kin, goals
        self.linear, self.speed, self.blend = linear, speed, blend
        self.checker = CollisionChecker(kin, margin=KEEPS + SAMPLING)

    def tried(self, start: Floats, script: Path | None, picture: Path | None) -> Program:
        """Plan from a posture, run the program in MuJoCo, print the outcome, and write program and picture.

        Raises:
            InputError: No way was found, or the program does not come to its end.
        """
        kin = self.kinematics
        legs, program, done = self._planned(start)
        say(f"{self.arm.title}: tip {kin.tip} in {kin.base}, degrees")
        say(f"from     {_degrees(start)}")
        for leg in legs:
            say(_described(leg))
        if done.status != FINISHED or done.reason:
            raise InputError(f"the dry run did not come to its end, nothing is sent: {done.reason}")
        for line in self._measured(done):
            say(line)
        if script is not None:
            write_text(script, program.text)
            say(f"wrote    {script}")
        if picture is not None:
            from kinreach.plots._motion import draw_motion

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
        return _difference(T, self.goals[-1])[2]

    def same_arm(self, state: RobotState, address: str) -> str:
        """Compare the robot's tool and where its centre point is with kinreach's, and describe the difference.

        Raises:
            RobotError: It has another tool centre point on its flange, or is another arm.
        """
        own, offset = tcp_of(self.arm), state.tcp_offset
        if offset is not None and _apart(MAX_OFF_CALIBRATED, *_difference(pose(offset), own)[:2]):
            there, here = (_listed(six) for six in (offset, pose_vector(own)))
            raise RobotError(
                f"the TCP of the robot at {address} is {there}; kinreach's tool is {here}. Give --tool {there}, with "
                "--tool-radius or --tool-mesh so that it can collide, or set the TCP on the robot"
            )
        tcp = own if offset is None else pose(offset)
        flange = ArmKinematics(self.arm, tip="tool0", base="base")
        far, turned, off = _difference(flange.fk(state.actual_q) @ tcp, pose(state.tcp_pose))
        calibrated = "_calibrated" in self.arm.name
        if _apart(MAX_OFF_CALIBRATED if calibrated else MAX_OFF, far, turned):
            hint = "another calibration or another model" if calibrated else "another model"
            raise RobotError(
                f"the robot at {address} is not this {self.arm.title}: its tool centre point is {off} from where "
                f"kinreach has it; it has {hint}"
            )
        advice = "" if calibrated else "; with --calibration it would be less"
        return f"robot    {address}: its tool centre point is {off} from kinreach's{advice}"

    def moved(self, robot: URClient, program: Program) -> int:
        """Send a program, wait for its end, and print how it ended."""
        with _stopped_by_signals():
            try:
                done = robot.run(program)
            except KeyboardInterrupt:
                raise KeyboardInterrupt("stopped; the robot stands") from None
        off = 1000 * np.abs(done.measured.q - done.commanded.q).max()
        say(
            f"moved    {done.commanded.duration:.2f} s; joints at most {off:.1f} mrad from what was commanded; ends "
            f"{self._miss(pose(robot.read().tcp_pose))} from the goal"
        )
        return 0


def _difference(one: Floats, other: Floats) -> tuple[float, float, str]:
    far, angle = pose_error(one, other)
    turned = float(np.degrees(angle))
    return far, turned, f"{1000 * far:.2f} mm and {turned:.2f}°"


def _apart(most: tuple[float, float], far: float, turned: float) -> bool:
    """Return whether a distance [m] or an angle [degrees] is above the largest ones."""
    return far > most[0] or turned > most[1]


def _listed(six: Floats) -> str:
    return ",".join(f"{number:.6g}" for number in six.round(6) + 0.0)


def _start(text: str | None, arm: ArmDescription, *, degrees: bool) -> Floats:
    if text in (None, HOME):
        return np.array(arm.home)
    kin = ArmKinematics(arm)
    return posture_of("--from", str(text), 6, degrees=degrees, limits=(kin.lower, kin.upper))


def _degrees(q: Floats) -> str:
    return "  ".join(f"{angle:7.1f}" for angle in np.degrees(q))


def _described(leg: Leg) -> str:
    last, widest = leg.moves[-1], max(move.blend for move in leg.moves)
    branch = f"branch {leg.branch}" if leg.branch >= 0 else "no branch of the closed form"
    count = f"{len(leg.moves)} x " if len(leg.moves) > 1 else ""
    blend = f", blend {1000 * widest:.0f} mm" if widest else ""
    if leg.reduced:
        blend += f" (reduced from {1000 * leg.reduced:.0f} mm, to keep {1e3 * KEEPS:g} mm from everything)"
    speed = f"{last.speed:.2f} {'rad/s' if last.command == 'movej' else 'm/s'}"
    return (
        f"to       {_degrees(leg.end)}\n"
        f"         {branch}, {leg.free} of {leg.postures} postures free; {count}{last.command}, {speed}{blend}"
    )


def _agreed(address: str) -> bool:
    try:
        return input(f"Move the robot at {printable(address)} now? Ctrl-C stops it. [y/N] ").strip().lower() == "y"
    except EOFError:
        raise InputError("nobody answers whether the robot may move; give --yes") from None


@contextmanager
def _stopped_by_signals() -> Iterator[None]:
    """Let the signals that end a process stop the robot first, as Ctrl-C does."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
        "--from", dest="start", metavar="Q1,...,Q6", help=f"start posture in radians, or {HOME} (default)"
    )
    parser.add_argument("--degrees", action="store_true", help="the angles of --from are degrees")
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
    add_arm_flags(parser)
    return parser

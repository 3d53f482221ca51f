"""`kinreach move`: plan a motion of a UR, try it in MuJoCo, and write it as a program or send it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinreach._checks import Floats, check_out_file, printable
from kinreach._files import replacing, write_text
from kinreach._flags import numbers_of
from kinreach.cli import Parser, print_notes, say, subcommand
from kinreach.deploy._client import URClient
from kinreach.deploy._controller import check_is_ur, tcp_of
from kinreach.deploy._model import (
    MAX_OFF_CALIBRATED,
    DhFigures,
    ModelCheck,
    allowed,
    apart,
    is_calibrated,
    nearest_models,
)
from kinreach.deploy._moving import MotionFlags, TriedMotion, difference, far
from kinreach.deploy._primary import PRIMARY_PORT
from kinreach.deploy._rtde import RTDE_PORT
from kinreach.deploy._states import RobotState
from kinreach.errors import InputError, RobotError
from kinreach.kinematics import ArmKinematics, Trajectory, pose, pose_vector
from kinreach.robots import ArmDescription
from kinreach.robots.inside import ArmFlags

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: So long the robot may take to say the figures of its kinematics, which it does on connecting [s].
FIGURES_TIMEOUT = 1.0


def main(argv: Sequence[str], *, prog: str) -> int:
    """Plan, try, show, and write or send a motion; return 1 if the user does not agree to send it."""
    arguments = _parser(prog).parse_args(argv)
    script, picture = (
        None if text is None else check_out_file(flag, text)
        for flag, text in (("--script", arguments.script), ("--picture", arguments.picture))
    )
    if arguments.robot is not None and arguments.start is not None:
        raise InputError("with --robot the motion begins where the robot stands; leave out --from")
    if arguments.robot is not None and arguments.show and arguments.yes:
        raise InputError("--show is for looking before the robot moves; leave out --yes")
    ports = [int(number) for number in numbers_of("--ports", arguments.ports, 2)]
    flags = MotionFlags.of(arguments)
    bare = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(bare.notes)
    check_is_ur(bare)
    arm = flags.surrounded(bare)
    planner = flags.planner(arm)
    with ExitStack() as pages:

        def show(flags: MotionFlags, motion: TriedMotion) -> None:
            words = ["--arm", arguments.arm, *ArmFlags.words(arguments)]
            shown = (arguments.arm, ArmFlags.of(arguments), words, flags, motion)
            pages.callback(subcommand("view").open_motion(*shown, sends=arguments.robot is not None).stop)

        if arguments.robot is None:
            motion = planner.tried(flags.posture(planner.kinematics))
            _report(motion, script, picture)
            if arguments.show:
                show(flags, motion)
                threading.Event().wait()
            return 0
        with URClient(arguments.robot, rtde_port=ports[0], script_port=ports[1]) as robot:
            comparison = Comparison(arm)
            figures = robot.wait_for_figures(FIGURES_TIMEOUT)
            state = robot.read()
            say(f"robot    {comparison.same_arm(state, figures, arguments.robot)}")
            motion = planner.tried(state.actual_q)
            _report(motion, script, picture)
            if arguments.show:
                show(flags.starting_at(state.actual_q), motion)
            if not (arguments.yes or _agreed(arguments.robot)):
                say("nothing was sent")
                return 1
            return _moved(robot, motion, comparison)


def _report(motion: TriedMotion, script: Path | None, picture: Path | None) -> None:
    """Print a motion and its dry run, and write program and picture.

    Raises:
        InputError: The program does not come to its end.
    """
    for line in motion.cautions:
        say(f"caution  {line}")
    for line in motion.plan:
        say(line)
    motion.check_finished()
    for line in motion.dry_run:
        say(line)
    if script is not None:
        write_text(script, motion.program.text)
        say(f"wrote    {script}")
    if picture is not None:
        title = f"{motion.kinematics.arm.title}, tried in MuJoCo"
        figure = draw_motion(motion.done.commanded, motion.kinematics.velocity_limit, title)
        with replacing(picture) as temporary:
            figure.savefig(temporary, facecolor="white", format="png")
        say(f"picture  {picture}")


def _moved(robot: URClient, motion: TriedMotion, comparison: Comparison) -> int:
    """Send a program if the robot is still as it was, wait for its end, and print how it ended."""
    done = robot.run(motion.program, check=lambda state: comparison.same_arm(state, None, robot.address))
    off = 1000 * np.abs(done.measured.q - done.commanded.q).max()
    say(
        f"moved    {done.commanded.duration:.2f} s; joints at most {off:.1f} mrad from what was commanded; ends "
        f"{motion.miss(pose(robot.read().tcp_pose))} from the goal"
    )
    if done.missing:
        cycles = len(done.commanded.t) + done.missing
        say(f"         the recording is cut: {done.missing} of {cycles} control cycles were not received")
    return 0


class Comparison:
    """Compares a robot with an arm, which must be what it was planned for."""

    def __init__(self, arm: ArmDescription) -> None:
        self.arm = arm
        self.flange, self.tcp = ArmKinematics(arm, tip="tool0", base="base"), tcp_of(arm)
        self.model = ModelCheck.of(arm)

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
        if offset is not None and apart(MAX_OFF_CALIBRATED, *difference(pose(offset), self.tcp)):
            there, here = (_listed(six) for six in (offset, pose_vector(self.tcp)))
            raise RobotError(
                f"the TCP of the robot at {address} is {there}; kinreach's tool is {here}. Give --tool {there}, with "
                "--tool-radius or --tool-mesh so that it can collide, or set the TCP on the robot"
            )
        tcp, seen = self.tcp if offset is None else pose(offset), pose(state.tcp_pose)
        off = difference(self.flange.fk(state.actual_q) @ tcp, seen)
        self._check_model(off, "in its posture", None, address)
        advice = "" if is_calibrated(self.arm) else "; with --calibration it would be less"
        said = f"{address}: its tool centre point is {far(off)} from kinreach's"
        # figures that do not give the robot's own pose are not understood
        if figures is None or apart(MAX_OFF_CALIBRATED, *difference(figures.fk(state.actual_q) @ tcp, seen)):
            return said + advice
        anywhere = self.model.difference(figures.fk)
        self._check_model(anywhere, "in other postures", figures, address)
        return f"{said}, and at most {far(anywhere)} in other postures{advice}"

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
            f"the robot at {address} is not this {self.arm.title}: {where} its tool is {far(off)} from where kinreach "
            f"has it; it has {kind}{like}"
        )


def _listed(six: Floats) -> str:
    return ",".join(f"{number:.6g}" for number in six.round(6) + 0.0)


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
    MotionFlags.add_to(parser)
    parser.add_argument("--script", metavar="FILE", help="write the program")
    parser.add_argument("--picture", metavar="FILE.png", help="draw joint angles and speeds of the dry run")
    parser.add_argument(
        "--show",
        action="store_true",
        help="show the motion in the browser: play it, look at its speeds, choose another",
    )
    parser.add_argument("--robot", metavar="ADDRESS", help="read the start posture from this robot, ask, and move it")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument(
        "--ports", default=f"{RTDE_PORT},{PRIMARY_PORT}", metavar="RTDE,SCRIPT", help="of the robot (%(default)s)"
    )
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

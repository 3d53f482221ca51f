"""`kinreach simulate-ur`: a UR to connect to, simulated on this machine."""

from __future__ import annotations

import os
import queue
import select
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from kinreach._checks import check_number, printable
from kinreach._files import read_text
from kinreach._flags import posture_of
from kinreach.cli import Parser, print_notes, say
from kinreach.deploy._controller import Controller, check_is_ur, outlasting, rate_of
from kinreach.deploy._remarks import fastest, tool_note, untouched
from kinreach.deploy._rtde import RTDE_PORT, SCRIPT_PORT
from kinreach.deploy._server import SimulatedUR
from kinreach.deploy._surroundings import add_surroundings, surrounded
from kinreach.deploy._urscript import MAX_CHARACTERS
from kinreach.errors import InputError
from kinreach.kinematics import ArmKinematics, CollisionChecker
from kinreach.robots import ArmDescription
from kinreach.robots.inside import ArmFlags

_ABOUT = (
    "This is not URSim: it runs URScript, without sockets and forces.\n"
    "ur_rtde reads and controls it; the dashboard has no program to load."
)
#: Lines of the log that may wait to be printed, and how long they are waited for at the end [s].
MAX_LINES, PATIENCE = 1000, 1.0
#: How long a program runs unless told otherwise, and at most [s].
LONGEST, MOST = 60.0, 600.0


def main(argv: Sequence[str], *, prog: str) -> int:
    """Serve a simulated UR until Ctrl-C."""
    arguments = _parser(prog).parse_args(argv)
    arm = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(arm.notes)
    check_is_ur(arm)
    kin = ArmKinematics(arm, base="base")
    arm = surrounded(kin, arguments.table, arguments.box, cell=not arguments.no_cell)
    start = None
    if arguments.start is not None:
        limits = kin.lower, kin.upper
        start = posture_of("--from", arguments.start, 6, degrees=arguments.degrees, limits=limits).tolist()
    speed = check_number("--speed", arguments.speed, above=0.0, most=1e6)
    log = _Log()
    if arguments.program is not None:
        return _try_program(arm, start, Path(arguments.program), arguments.longest)
    robot = SimulatedUR(
        arm, q=start, address=arguments.address, rtde_port=arguments.rtde_port, script_port=arguments.script_port,
        speed=speed, log=log.add,
    )  # fmt: skip
    ports = f"RTDE {robot.rtde_port}, script port {robot.script_port}, dashboard {robot.dashboard_port}"
    say(f"{robot.address}: {ports}, {rate_of(arm)} Hz")
    say(arm.title)
    print(_ABOUT, flush=True)
    if sys.stdin is not None and sys.stdin.isatty():
        say("Enter releases a protective stop, Ctrl-C ends.")
        threading.Thread(target=_release_by_enter, args=(robot,), daemon=True).start()
    try:
        robot.serve()
    finally:
        robot.close()
        log.close()
    return 0


def _try_program(arm: ArmDescription, start: Sequence[float] | None, file: Path, longest: float) -> int:
    """Run a program to its end, as fast as it goes, and print what it did.

    Raises:
        InputError: It cannot be read, is refused, or is stopped.
    """
    check_number("--longest", longest, above=0.0, most=MOST)
    if file.suffix.lower() in (".urp", ".urpx"):
        raise InputError(
            f"{file} is PolyScope's own file; its URScript stands beside it: {file.with_suffix('.script')}"
        )
    text = read_text(file, "the program", most=MAX_CHARACTERS)
    robot = Controller(arm, q=start, log=say)
    done = robot.run(text, longest=longest)
    kin = ArmKinematics(arm, base="base")
    say(f"dry run  {fastest(kin, done.measured)}")
    goes_on = done.reason == outlasting(longest)
    if goes_on or not done.reason:
        say(f"         {untouched(box.name for box in arm.workcell.obstacles)}")
    if note := tool_note(CollisionChecker(kin)):
        say(f"         {note}")
    q, tool = done.measured.q[-1], robot.tcp_pose(done.measured.q[-1])
    say(f"ends     {', '.join(f'{angle:.4f}' for angle in q)} rad")
    say(f"         tool {', '.join(f'{number:.4f}' for number in tool)}")
    if goes_on:
        say(f"         it goes on after these {longest:g} s; --longest lets it run longer")
    elif done.reason:
        raise InputError(f"{file} does not come to its end: {done.reason}")
    return 0


class _Log:
    """Prints lines in a thread of its own: if nobody reads them, they wait, are left out, and stop nobody."""

    def __init__(self) -> None:
        self._lines: queue.Queue[str | None] = queue.Queue(MAX_LINES)
        self._left_out = 0
        try:
            self._file: int | None = sys.stdout.fileno()
        except (AttributeError, OSError, ValueError):  # not a file, but a text in memory
            self._file = None
        self._thread = threading.Thread(target=self._print, name="log of a simulated UR", daemon=True)
        self._thread.start()

    def add(self, text: str) -> None:
        try:
            self._lines.put_nowait(text)
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Wait until all is printed, if it is read."""
        with suppress(queue.Full):
            self._lines.put(None, timeout=PATIENCE)
        self._thread.join(PATIENCE)

    def _print(self) -> None:
        with suppress(OSError):  # who has read it is gone
            while (text := self._lines.get()) is not None:
                self._write(text)
                if self._lines.empty():
                    self._say_left_out()
            self._say_left_out()  # of what came while the last lines waited

    def _say_left_out(self) -> None:
        left_out, self._left_out = self._left_out, 0
        if left_out:
            self._write(f"{left_out} lines are left out here, since nobody read them")

    def _write(self, text: str) -> None:
        if self._file is None:
            say(text)
            return
        # past Python's buffer: the interpreter ends while this waits
        os.write(self._file, f"{printable(text)}\n".encode(sys.stdout.encoding, "backslashreplace"))


def _release_by_enter(robot: SimulatedUR) -> None:
    while select.select([sys.stdin], [], [])[0] and sys.stdin.readline():
        robot.release()


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description=f"A UR that is simulated in MuJoCo and answers like a real one. {_ABOUT}")
    parser.add_argument("--arm", required=True, metavar="NAME|FILE", help="a UR: ur3 to ur30, or its URDF")
    parser.add_argument("--from", dest="start", metavar="Q1,...,Q6", help="start posture in radians (the arm's home)")
    parser.add_argument("--degrees", action="store_true", help="the angles of --from are degrees")
    parser.add_argument(
        "--address", default="127.0.0.1", help="of this machine, such as 127.0.0.2 for a second robot (%(default)s)"
    )
    parser.add_argument(
        "--rtde-port", type=int, default=RTDE_PORT, metavar="N", help="port of RTDE, 0 for a free one (%(default)s)"
    )
    parser.add_argument(
        "--script-port",
        type=int,
        default=SCRIPT_PORT,
        metavar="N",
        help="port that takes programs, 0 for a free one (%(default)s, and 30001, 30003 and 29999 with it)",
    )
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="times faster than real time (%(default)s)"
    )
    parser.add_argument(
        "--program",
        metavar="FILE",
        help="run this URScript once, as fast as it goes, say what it does, and end; no port is opened",
    )
    parser.add_argument(
        "--longest", type=float, default=LONGEST, metavar="S", help="end a --program after this time (%(default)s s)"
    )
    parser.add_argument("--no-cell", action="store_true", help="no table and no floor around the arm")
    add_surroundings(parser, "the frame base, as on the pendant")
    ArmFlags.add_to(parser)
    return parser

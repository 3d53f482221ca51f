"""`kinreach calibrate`: an arm's calibration from the files or the robot of its owner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import monotonic

import numpy as np

from kinreach._checks import Floats, check_count, check_out_file, check_path, printable
from kinreach._files import replacing
from kinreach._flags import numbers_of
from kinreach.cli import Parser, complain, in_flags, say
from kinreach.deploy._client import URClient
from kinreach.deploy._primary import PRIMARY_PORT
from kinreach.deploy._rtde import RTDE_PORT
from kinreach.errors import InputError, RobotError
from kinreach.kinematics import pose
from kinreach.robots import PosePairs, calibrate

#: Postures that are read from a robot by default, how much a joint must turn between two [rad], and how long nothing
#: may happen [s].
ROWS, APART, PATIENCE = 20, 0.25, 120.0
#: Exit code where the rows do not determine the calibration.
UNDETERMINED = 1
#: Endings of sources: without one of these, and no file of that name, a source is a robot's address.
_FILES = (".urp", ".script", ".csv", ".txt", ".tsv", ".yaml", ".yml", ".conf", ".urdf", ".xml")


def main(argv: Sequence[str], *, prog: str) -> int:
    """Find a calibration, say what it is worth, and write it."""
    arguments = _parser(prog).parse_args(argv)
    out, picture = (
        None if text is None else check_out_file(flag, text)
        for flag, text in (("--out", arguments.out), ("--picture", arguments.picture))
    )
    tool = None if arguments.tool is None else numbers_of("--tool", arguments.tool, 6)
    sources = [check_path("SOURCE", source) for source in arguments.source]
    for flag, path in (("--out", out), ("--picture", picture)):
        if path is not None and path.exists() and any(each.exists() and each.samefile(path) for each in sources):
            raise InputError(f"{flag} must be another file than the source, which it would replace, got {path}")
    addresses = [str(source) for source in sources if not source.exists() and source.suffix.lower() not in _FILES]
    if addresses and len(sources) > 1:
        raise InputError(f"give the robot at {addresses[0]} alone, or only files")
    source: PosePairs | list[Path] = sources if not addresses else _read(addresses[0], arguments.ports, arguments.rows)
    result = calibrate(source, arm=arguments.arm, tool=tool, robot=arguments.robot)
    for line in result.statement():
        say(in_flags(line))
    if picture is not None:
        if result.fit is None:
            raise InputError("--picture shows the errors of a fit, and these figures were read")
        from kinreach.plots import draw_calibration

        with replacing(picture) as temporary:
            draw_calibration(result).savefig(temporary, format="png")
        print(printable(f"picture      {picture}"))
    if result.missing:
        complain(f"{prog}: no calibration{'' if out is None else f', {out} is not written'}: {result.missing}")
        return UNDETERMINED
    if out is not None:
        result.save(out)
        print(printable(f"written      {out}"))
    return 0


def _read(address: str, ports: str, rows: int) -> PosePairs:
    """Read postures and poses from a robot that somebody else moves; nothing is sent that moves it."""
    wanted = check_count("--rows", rows, least=3, most=10_000)
    rtde, script = (int(number) for number in numbers_of("--ports", ports, 2))
    kept: list[tuple[Floats, Floats, Floats | None]] = []
    try:
        robot = URClient(address, rtde_port=rtde, script_port=script)
    except RobotError as error:
        raise RobotError(f"{address} is no file here, and as an address: {error}") from None
    with robot as client:
        say(
            f"{address}: move the arm, by hand or by a program, to {wanted} postures in which every joint differs; "
            "Ctrl-C ends"
        )
        last = monotonic()
        try:
            while len(kept) < wanted:
                state = client.next_state()
                if all(np.abs(state.actual_q - q).max() > APART for q, *_ in kept):
                    kept.append((state.actual_q, state.tcp_pose, state.tcp_offset))
                    last = monotonic()
                    say(f"{len(kept):3d}  {'  '.join(f'{angle:7.1f}' for angle in np.degrees(state.actual_q))}")
                elif monotonic() - last > PATIENCE:
                    raise RobotError(f"{address} has not moved to another posture for {PATIENCE:g} s: {len(kept)} read")
        except KeyboardInterrupt:
            say(f"{len(kept)} postures read")
    offsets = [offset for *_, offset in kept]
    tcp = None if any(offset is None for offset in offsets) else pose(np.array(offsets))
    q, poses = np.array([q for q, *_ in kept]), pose(np.array([six for _, six, _ in kept]))
    return PosePairs(address, q, poses, tcp, tuple(f"posture {row + 1}" for row in range(len(kept))))


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Find the factory calibration of a UR in what its owner has, or the joint placements of any arm, "
        "and say how far it can be trusted.",
    )
    parser.add_argument(
        "source",
        nargs="+",
        metavar="SOURCE",
        help="a program of PolyScope (.urp), its export (.script), a recording of UR's RTDE client or of ur_rtde, a "
        "table of joint angles and poses; a calibration file; or the address of a robot that you move",
    )
    parser.add_argument(
        "--arm", metavar="NAME|FILE", help="a UR, if the rows fit several; for another arm its name or URDF"
    )
    parser.add_argument(
        "--tool",
        metavar="X,Y,Z,RX,RY,RZ",
        help="tool centre point of the rows, as on the pendant (default: what the source says; else it is fitted, too)",
    )
    parser.add_argument("--robot", type=int, metavar="N", help="of a .urp with the figures of several robots")
    parser.add_argument("--out", metavar="FILE", help="write the calibration: .yaml, .conf or .urdf")
    parser.add_argument("--picture", metavar="FILE.png", help="draw the errors before and after")
    parser.add_argument(
        "--rows", type=int, default=ROWS, metavar="N", help="postures to read from a robot (%(default)s)"
    )
    parser.add_argument(
        "--ports", default=f"{RTDE_PORT},{PRIMARY_PORT}", metavar="RTDE,SCRIPT", help="of the robot (%(default)s)"
    )
    return parser

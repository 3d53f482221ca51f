"""The command line of the page."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Sequence
from dataclasses import replace

from kinreach._checks import check_count
from kinreach.cli import Parser, print_notes, say
from kinreach.deploy.inside import MotionFlags, TriedMotion
from kinreach.robots import THESIS_ARM, arm_names
from kinreach.robots.inside import ArmFlags
from kinreach.view._motion import ShownMotion
from kinreach.view._server import Server
from kinreach.view._setup import setup_of

PORT, MAX_PORT = 8080, 65535


def open_motion(
    arm: str, choice: ArmFlags, words: Sequence[str], flags: MotionFlags, motion: TriedMotion, *, sends: bool
) -> Server:
    """Serve the page with a motion, print its address, and open a browser.

    Args:
        arm: Name or file.
        choice: What `words` say of it.
        words: The flags of the command line that choose the arm.
        flags: What the motion was asked for by.
        motion: To be shown.
        sends: Whether the terminal asks to send it.
    """
    setup = replace(setup_of(arm, **vars(choice)), words=tuple(words), motion=ShownMotion(flags, motion, sends))
    server = Server(setup, port=PORT)
    say(f"page     {server.address}  (only on this machine; Ctrl-C ends it)")
    webbrowser.open(server.address)
    return server


def main(argv: Sequence[str], *, prog: str) -> int:
    """Serve the page until Ctrl-C."""
    arguments = _parser(prog).parse_args(argv)
    check_count("port", arguments.port, least=1, most=MAX_PORT)
    setup = setup_of(
        arguments.arm,
        **vars(ArmFlags.of(arguments)),
        simple=arguments.simple,
        policy=arguments.policy,
        results=arguments.results,
        environment=arguments.environment,
    )
    setup = replace(setup, words=("--arm", arguments.arm, *ArmFlags.words(arguments)))
    print_notes(setup.arm.notes)
    server = Server(setup, port=arguments.port)
    try:
        print(f"{server.address}  (only on this machine; Ctrl-C ends it)", flush=True)
        if arguments.open:
            webbrowser.open(server.address)
        threading.Event().wait()
    finally:
        server.stop()
    return 0


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="An interactive page in the browser: arms, every posture for a target, and why a target has none.",
    )
    parser.add_argument(
        "--arm",
        default=THESIS_ARM,
        metavar="NAME",
        help=f"one of: {', '.join(arm_names())}; a URDF or MJCF; or module:attribute (default: %(default)s)",
    )
    parser.add_argument(
        "--policy",
        metavar="FILE",
        help="a policy to play episodes with: a file, the name of one, or module:attribute of a policy or solver",
    )
    parser.add_argument(
        "--environment", metavar="ID", help="an environment to play episodes of: a registered id, or module:id"
    )
    parser.add_argument("--results", metavar="FILE", help="the results.json of a comparison")
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="N", help="or the next that is free (default: %(default)s)"
    )
    parser.add_argument("--simple", action="store_true", help="draw fewer triangles, without a graphics card")
    parser.add_argument("--open", action="store_true", help="open a browser")
    ArmFlags.add_to(parser)
    return parser

"""`python -m kinreach.kinematics check FILE`, the same as `kinreach check FILE`."""

import sys

from kinreach.cli import Parser, finish, run_command

PROG = "python -m kinreach.kinematics"


def _usage() -> int:
    parser = Parser(prog=PROG, description="Commands for an arm's kinematics.")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    commands.add_parser("check", help="what an arm is and how its inverse kinematics does")
    parser.parse_args()
    return 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["check"]:
        raise SystemExit(run_command("check", sys.argv[2:], prog=f"{PROG} check"))
    raise SystemExit(finish(_usage, prog=PROG))

"""The console script `kinreach`: one subcommand for each job, and one way for all of them to end.

`kinreach compare ...`, `python -m kinreach compare ...` and `python -m kinreach.compare ...` are the same. A new job
is a line in `COMMANDS` and a module with a function `main(argv, *, prog) -> int`; `run_command` does the rest.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

from kinreach.errors import KinreachError

#: Exit codes: wrong input or installation, and Ctrl-C (as shells report it).
EXIT_ERROR = 2
EXIT_INTERRUPTED = 130
#: What a file system says that takes no more. Results are written through `kinreach.files`, which names the file; this
#: is for the rest, such as the terminal's output in a file, and the logs of libraries.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


@dataclass(frozen=True)
class Command:
    """A subcommand: the module whose `main(argv, *, prog)` does it, and one line of help."""

    module: str
    help: str


COMMANDS = {
    "compare": Command("kinreach.compare.cli", "put all methods on the same goals and report how they do"),
    "train": Command("kinreach.baselines.train_cli", "train a policy by a recipe"),
    "evaluate": Command("kinreach.baselines.evaluate_cli", "try policies on goals they were not trained on"),
    "bench": Command("benchmarks.speed.cli", "measure speed beside other packages"),
    "demo": Command("kinreach.demo.cli", "watch an environment with a policy, or film it"),
}


class Parser(argparse.ArgumentParser):
    """An argument parser that reports bad input in one line instead of a page of usage."""

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and leave with `EXIT_ERROR`."""
        self.exit(EXIT_ERROR, f"{self.prog}: error: {_line(message)} (see {self.prog} --help)\n")


def _line(text: object) -> str:
    """Text as one line; what a terminal would not print but obey is written out."""
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in " ".join(str(text).split()))


def run_command(name: str, argv: Sequence[str] | None = None, *, prog: str) -> int:
    """Run one subcommand; errors raised on purpose and Ctrl-C end in one line on stderr.

    Args:
        name: Key of `COMMANDS`.
        argv: Its arguments; those of the process if None.
        prog: How the user called it, for messages.

    Returns:
        The exit code of the process.
    """
    try:
        main_function = importlib.import_module(COMMANDS[name].module).main
        return int(main_function(sys.argv[1:] if argv is None else list(argv), prog=prog))
    except KinreachError as error:
        print(f"{prog}: error: {_line(error)}", file=sys.stderr)
        return EXIT_ERROR
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        print(f"{prog}: error: cannot write: {error.strerror}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt as interrupt:
        print(f"{prog}: {_line(interrupt) or 'interrupted'}", file=sys.stderr)
        return EXIT_INTERRUPTED


def main(argv: Sequence[str] | None = None, *, prog: str = "kinreach") -> int:
    """Entry point of the console script.

    Args:
        argv: Arguments, the first of which names the subcommand; those of the process if None.
        prog: How the user called it, for messages.

    Returns:
        The exit code of the process.
    """
    argv = sys.argv[1:] if argv is None else list(argv)
    if argv and argv[0] in COMMANDS:
        return run_command(argv[0], argv[1:], prog=f"{prog} {argv[0]}")
    parser = Parser(prog=prog, description="Analytic kinematics and learning, on the same reaching tasks.")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.help)
    parser.parse_args(argv)
    return EXIT_ERROR

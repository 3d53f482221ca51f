"""The console script `kinreach`.

`kinreach compare ...`, `python -m kinreach compare ...` and `python -m kinreach.compare ...` are the same. A new
subcommand is a line in `COMMANDS` and a module with a function `main(argv, *, prog) -> int`.
"""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import re
import select
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from shlex import quote
from typing import IO, Any, NoReturn

import kinreach
from kinreach._checks import printable
from kinreach.errors import KinreachError

#: Exit codes: wrong input or installation; Ctrl-C, as shells report it; a closed pipe.
EXIT_ERROR = 2
EXIT_INTERRUPTED = 130
EXIT_UNREAD = 1
#: Flags that ask for help.
HELP = ("-h", "--help")
#: Errors of a full file system, for what `kinreach._files` does not write: redirected output, logs of libraries.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)


@dataclass(frozen=True)
class Command:
    """A subcommand: the module whose `main(argv, *, prog)` does it, and one line of help."""

    module: str
    help: str


COMMANDS = {
    "compare": Command("kinreach.compare._cli", "put all methods on the same goals and report how they do"),
    "train": Command("kinreach.baselines._train_cli", "train a policy by a recipe"),
    "evaluate": Command("kinreach.baselines._evaluate_cli", "try policies on goals they were not trained on"),
    "demonstrate": Command("kinreach.compare._demonstrate_cli", "record a method's episodes as a Minari dataset"),
    "ik": Command("kinreach.deploy._ik_cli", "joint angles for poses of an arm's tool"),
    "calibrate": Command("kinreach.deploy._calibrate_cli", "find a UR's calibration in the files of its owner"),
    "check": Command("kinreach.deploy._check_cli", "what an arm is and how its inverse kinematics does"),
    "demo": Command("kinreach.demo._cli", "watch an environment with a policy, or film it"),
    "move": Command("kinreach.deploy._move_cli", "plan a motion of a UR, try it, and write or send it"),
    "simulate-ur": Command("kinreach.deploy._simulate_cli", "simulate a UR that other programs connect to"),
    "view": Command("kinreach.view._cli", "see postures, and why there are none, in the browser"),
}


#: Python's keyword arguments in messages, which are flags of the command line.
_KEYWORD = re.compile(r"\b(repair|tip|joints|package_dirs|tool|base|mesh_scale|arm|robot|held)=(True\b)?( ?)")
#: Python's mapping of a joint to its place, which is a flag of the command line.
_HELD = re.compile(r"\bheld=\{(['\"])(.+?)\1: ([^}]+)\}")
#: A list of numbers of which the first is negative.
_NEGATIVE = re.compile(r"-[\d.][\d.eE+-]*,")


class Parser(argparse.ArgumentParser):
    """An argument parser that reports bad input in one line instead of a page of usage."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse arguments; -0.4,0.1 after a flag is its value, which argparse would read as a flag."""
        words = list(sys.argv[1:] if args is None else args)
        for place in range(len(words) - 1, 0, -1):
            if _NEGATIVE.match(words[place]) and words[place - 1].startswith("--") and "=" not in words[place - 1]:
                words[place - 1 : place + 1] = [f"{words[place - 1]}={words[place]}"]
        return super().parse_known_args(words, namespace)

    def print_help(self, file: IO[str] | None = None) -> None:  # type: ignore[override]
        """Print the help, and raise if it cannot be written, unlike argparse."""
        print(self.format_help(), end="", file=file)

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and leave with `EXIT_ERROR`."""
        complain(f"{self.prog}: error: {message} (see {self.prog} --help)")
        raise SystemExit(EXIT_ERROR)


def quoted(word: str) -> str:
    """Quote a word for a shell, in printable characters."""
    if word.isprintable():
        return quote(word)
    return "$'" + "".join(map(_in_quotes, word)) + "'"


def _in_quotes(sign: str) -> str:
    if sign in "\\'":
        return f"\\{sign}"
    return sign if sign.isprintable() else "".join(f"\\x{byte:02x}" for byte in sign.encode())


def run(module: str, argv: Sequence[str] | None = None, *, prog: str) -> int:
    """Import a module and `finish` its `main(argv, *, prog)`.

    Args:
        module: Full name of the module.
        argv: Its arguments; those of the process if None.
        prog: How the user called it, for messages.

    Returns:
        The exit code of the process.
    """
    arguments = sys.argv[1:] if argv is None else list(argv)
    return finish(lambda: int(importlib.import_module(module).main(arguments, prog=prog)), prog=prog)


def finish(job: Callable[[], int], *, prog: str) -> int:
    """Run a job and write out what it printed; errors raised on purpose and Ctrl-C end in one line on stderr.

    Args:
        job: What to do; returns an exit code.
        prog: How the user called it, for messages.

    Returns:
        The exit code of the process.
    """
    try:
        try:
            return job()
        except KinreachError as error:
            complain(f"{prog}: error: {in_flags(str(error))}")
            return EXIT_ERROR
        except KeyboardInterrupt as interrupt:
            complain(f"{prog}: {str(interrupt) or 'interrupted'}")
            return EXIT_INTERRUPTED
        finally:
            if sys.stdout is not None:  # a failure at the interpreter's end would be exit code 120
                sys.stdout.flush()
    except BrokenPipeError:
        if not _is_unread(sys.stdout):
            raise
        _discard(sys.stdout)
        return EXIT_UNREAD
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        _discard(sys.stdout)
        complain(f"{prog}: error: cannot write: {error.strerror}")
        return EXIT_ERROR


def in_flags(text: str) -> str:
    """Return a message with the flags of the command line for Python's keywords."""
    return _KEYWORD.sub(_as_flag, _HELD.sub(lambda held: f"--hold {quoted(f'{held[2]}={held[3]}')}", text))


def _as_flag(keyword: re.Match[str]) -> str:
    flag = keyword[1].replace("package_dirs", "package_dir").replace("mesh_scale", "tool_mesh_scale")
    flag = flag.replace("held", "hold")
    ends = keyword.end() == len(keyword.string) or keyword.string[keyword.end()] in ",;.)"
    return f"--{flag.replace('_', '-')}{keyword[3] if keyword[2] or ends else ' '}"


def say(text: str) -> None:
    """Print text on stdout at once, with control characters escaped."""
    print(printable(text), flush=True)


def complain(text: str) -> None:
    """Print text as one line on stderr, with control characters escaped, if it can be written."""
    line = printable(" ".join(text.split()))
    if _is_stuck(sys.stderr):
        return
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:
        _discard(sys.stderr)


def print_notes(notes: Iterable[str]) -> None:
    """Print on stderr what was left out or assumed, a line each."""
    for note in notes:
        complain(f"note: {in_flags(note)}")


def _is_stuck(stream: IO[str]) -> bool:
    """Return whether a stream is a pipe that is full, and that nobody reads for a second."""
    try:
        return not select.select([], [stream], [], 1.0)[1]
    except (OSError, TypeError, ValueError):  # closed, or not a file
        return False


def _is_unread(stream: IO[str]) -> bool:
    """Return whether a stream is a pipe whose reader is gone."""
    poll = select.poll()
    poll.register(stream, 0)  # errors are always reported
    return bool(poll.poll(0))


def _discard(stream: IO[str]) -> None:
    """Discard what a stream holds, which the interpreter would try to write again when it ends."""
    with suppress(OSError, ValueError), open(os.devnull, "w") as sink:  # not of a stream without a file
        os.dup2(sink.fileno(), stream.fileno())


def run_command(name: str, argv: Sequence[str] | None = None, *, prog: str) -> int:
    """Run a subcommand, as `run`.

    Args:
        name: Key of `COMMANDS`.
        argv: Its arguments; those of the process if None.
        prog: How the user called it, for messages.

    Returns:
        The exit code of the process.
    """
    if name == "view" and sys.stderr.isatty():  # its imports take seconds
        complain("starting ...")
    return run(COMMANDS[name].module, argv, prog=prog)


def subcommand(name: str) -> Any:
    """Import the module of a subcommand, for another one that goes on with it.

    Args:
        name: Key of `COMMANDS`.
    """
    return importlib.import_module(COMMANDS[name].module)


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
    return finish(lambda: _general(argv, prog), prog=prog)


def _general(argv: Sequence[str], prog: str) -> int:
    """Print the version, the help, or an error that lists the subcommands."""
    parser = Parser(prog=prog, description="Analytic kinematics and learning, on the same reaching tasks.")
    parser.add_argument("-V", "--version", action="store_true", help="show the version and exit")
    commands = parser.add_subparsers(metavar="COMMAND")
    for name, command in COMMANDS.items():
        commands.add_parser(name, help=command.help)
    if parser.parse_args(argv).version:
        print(f"kinreach {kinreach.__version__}")
    else:
        parser.print_help()
    return 0

"""The command line of the comparison."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from textwrap import fill
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from kinreach._checks import check_path
from kinreach._jobs import add_options
from kinreach._objects import load_object
from kinreach._provenance import digest
from kinreach._statistics import tables
from kinreach._terminal import Console
from kinreach.cli import HELP, Parser, print_notes, quoted
from kinreach.compare._motion import with_motion
from kinreach.compare._options import Flag, OptionFlags
from kinreach.compare._ranking import part_of
from kinreach.compare._runner import CAMERA, DEFAULT_GOALS, GEOMETRIC, compare, notes
from kinreach.compare._task import Task, get_task, register_task, task_names
from kinreach.errors import InputError, OtherResultsError
from kinreach.robots import ArmDescription, arm_names, get_arm
from kinreach.robots.inside import ArmFlags

#: Width that the tables for people fit into [characters].
TABLE_WIDTH = 100


def main(argv: Sequence[str], *, prog: str) -> int:
    """Run a comparison and print its tables."""
    parser = _parser(prog)
    known, _ = parser.parse_known_args([word for word in argv if word not in HELP])  # the task, whose flags follow
    task = task_of(known.task)
    flags = OptionFlags(task.environment, task.options, taken=("help", *vars(known)))
    flags.add_to(parser, f"options of the task {task.name}")
    arguments = parser.parse_args(argv)
    methods = [name.strip() for name in arguments.methods.split(",")] if arguments.methods is not None else []
    texts = flags.texts(arguments)
    arm = _arm(arguments)
    own = None if arguments.out is None else check_path("--out", arguments.out)
    default = Path("results") / _default_folder(task.name, "" if arm is None else get_arm(arm).name, arguments, texts)
    out, results = _measure(
        task,
        methods,
        iter([own]) if own is not None else chain([default], (Path(f"{default}-{number}") for number in count(2))),
        goals=arguments.goals,
        seed=arguments.seed,
        arm=arm,
        observation=arguments.observation,
        options=flags.options(texts, arguments.observation),
        motion=arguments.motion,
        fresh=arguments.fresh,
        engine=arguments.engine,
        address=arguments.address,
        command=_command(prog, arguments, flags, texts, own),
    )
    console = Console(width=10 * TABLE_WIDTH)  # a table that does not fit is printed whole
    columns = (with_motion(task) if arguments.motion else task).columns
    entries = sorted(results["methods"], key=part_of)
    for table in tables(columns, entries, title=results["settings"]["title"], width=TABLE_WIDTH):
        console.print(table)
        console.print()
    files = ["results.json", "results.csv", "report.html", *(f"{name}.png" for name in task.figures)]
    files += ["paths.png"] if task.paths is not None else []
    scene = out / "scene.png"
    lines = [
        *notes(task, results),
        f"Again: {results['settings']['command']}",
        f"In {out}: {', '.join(files)}",
        f"Scene: {scene}" if scene.is_file() else "No picture of the scene: the reason is in report.html.",
    ]
    for line in lines:
        console.note(line)
    return 0


def task_of(name: str) -> Task:
    """Return a registered task, or that of `"module:attribute"`."""
    known = task_names()
    if ":" not in name:
        return get_task(name)
    task = load_object("task", name)
    if not isinstance(task, Task):
        raise InputError(f"{name} is not a Task")
    return register_task(task) if task.name in known or task.name not in task_names() else get_task(task.name)


def _arm(arguments: argparse.Namespace) -> str | ArmDescription | None:
    """Return the arm of the flags, by its name if it is an unchanged registered one."""
    changed = [name for name in ArmFlags.NAMES if getattr(arguments, name)]
    if arguments.arm is None:
        if changed:
            raise InputError(f"--{changed[0].replace('_', '-')} needs --arm")
        return None
    if not changed and arguments.arm in arm_names():
        return str(arguments.arm)
    arm = ArmFlags.of(arguments).arm(arguments.arm)
    print_notes(arm.notes)
    return arm


def _default_folder(task: str, arm: str, arguments: argparse.Namespace, texts: Mapping[str, str]) -> str:
    """Return the name of the folder for results: the task, and settings other than the default.

    Text that is too long or not fit for a name is replaced by its digest.
    """
    methods = "" if arguments.methods is None else arguments.methods.replace(" ", "")
    given = [getattr(arguments, name) for name in ArmFlags.NAMES]
    about = digest(repr(given).encode())[:8] if any(given) else ""
    parts = [arm, about, "camera" if arguments.observation == CAMERA else "", methods]
    parts += [f"goals{arguments.goals}"] if arguments.goals != DEFAULT_GOALS else []
    parts += [f"seed{arguments.seed}"] if arguments.seed != 0 else []
    parts += ["motion"] if arguments.motion else []
    parts += [f"{name}{text}" for name, text in texts.items()]
    short = []
    for part in filter(None, parts):
        text = part.replace(",", "+")
        plain = len(text) <= 40 and re.fullmatch(r"[\w.+-]+", text, re.ASCII)
        short.append(text if plain else digest(text.encode())[:8])
    return "-".join([f"compare-{task}", *short])


def _measure(
    task: Task, methods: Sequence[str], folders: Iterator[Path], **arguments: Any
) -> tuple[Path, dict[str, Any]]:
    """Compare with a progress bar; Ctrl-C prints what is kept. Other arguments are those of `compare`.

    Results go into the first of the folders without those of another comparison, which is returned with them.
    """
    out = next(folders)
    columns = (TextColumn("comparing"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    errors = Console(stderr=True)
    # drawn between trials: a thread would disturb the timed decisions
    hidden = not errors.is_terminal
    with Progress(*columns, console=errors, transient=True, auto_refresh=False, disable=hidden) as bar:
        trials = bar.add_task("comparing", total=None)

        def update(done: int, total: int) -> None:
            if bar.tasks[trials].total is None and done:
                errors.print(f"Going on from an interrupted run: {done} of {total} trials kept (--fresh starts over).")
            bar.update(trials, completed=done, total=total, refresh=True)

        try:
            while True:
                try:
                    return out, compare(task, methods, out=out, progress=update, **arguments)
                except OtherResultsError:
                    following = next(folders, None)
                    if following is None:
                        raise
                    out = following
        except KeyboardInterrupt:
            kept = f"{bar.tasks[trials].completed:.0f} finished trials are kept in {out}"
            raise KeyboardInterrupt(f"interrupted; {kept}; the same command goes on from there") from None


def _command(
    prog: str, arguments: argparse.Namespace, flags: Mapping[str, Flag], texts: Mapping[str, str], out: Path | None
) -> str:
    """Return the command that repeats the comparison, without defaults."""
    words = [prog, "--task", arguments.task]
    for name in ("arm", "methods"):
        value = getattr(arguments, name)
        words += [] if value is None else [f"--{name}", quoted(value)]
    for name in ArmFlags.NAMES:
        given = getattr(arguments, name)
        for value in given if isinstance(given, list) else [given]:
            if value:
                words += [f"--{name.replace('_', '-')}", *([] if value is True else [quoted(value)])]
    words += ["--goals", str(arguments.goals), "--seed", str(arguments.seed)]
    words += [] if arguments.observation == GEOMETRIC else ["--observation", arguments.observation]
    words += ["--motion"] if arguments.motion else []
    for name, text in texts.items():
        words += [flags[name].spelled, quoted(text)]
    return " ".join([*words, *([] if out is None else ["--out", quoted(str(out))])])


class _Parser(Parser):
    def format_help(self) -> str:
        lines = [f"methods of {name}: {', '.join(get_task(name).methods)}" for name in task_names()]
        lines.append(
            "other methods: a policy's file (policy.safetensors), or module:attribute of a solver, a policy or a "
            "function of your own"
        )
        # filled here: argparse would break names at their hyphens
        self.epilog = "\n".join(fill(line, 79, subsequent_indent="  ", break_on_hyphens=False) for line in lines)
        return super().format_help()


def _parser(prog: str) -> Parser:
    parser = _Parser(
        prog=prog,
        description="Put all methods on the same goals and report how they do.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--task",
        default="ur5",
        help=f"one of: {', '.join(task_names())}; or module:attribute (default: %(default)s)",
    )
    parser.add_argument(
        "--arm",
        metavar="NAME",
        help="another arm for the tasks ur5, space and arm3: its name, a URDF or MJCF, or module:attribute; by default "
        "with solvers, and the policies that were trained for it",
    )
    ArmFlags.add_to(parser)
    parser.add_argument("--methods", metavar="A,B", help="methods to compare, see below (default: all of the task's)")
    parser.add_argument("--goals", type=int, default=DEFAULT_GOALS, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the goals (default: %(default)s)")
    parser.add_argument(
        "--observation",
        default=GEOMETRIC,
        help="what methods observe: the true goal (geometric), or what the cameras saw (camera: --task ur5 or space, "
        "needs OpenGL) (default: %(default)s)",
    )
    parser.add_argument(
        "--motion",
        action="store_true",
        help="also time each motion within the arm's limits of speed, acceleration and jerk (needs ruckig)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="where results go (default: results/compare-TASK, and the settings that are not the default, such as "
        "results/compare-ur5-lm-goals20)",
    )
    parser.add_argument(
        "--fresh",
        action="store_true",
        help="do not go on from an interrupted comparison in DIR, and write over another one's results",
    )
    add_options(parser)
    return parser

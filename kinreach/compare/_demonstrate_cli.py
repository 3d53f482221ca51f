"""The command line of demonstrations."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rich.progress import Progress

from kinreach._terminal import Console
from kinreach.cli import HELP, Parser, quoted
from kinreach.compare._cli import task_of
from kinreach.compare._demonstrate import demonstrate
from kinreach.compare._options import OptionFlags
from kinreach.compare._runner import CAMERA, GEOMETRIC
from kinreach.compare._task import task_names


def main(argv: Sequence[str], *, prog: str) -> int:
    """Record demonstrations and print how many reached their goals."""
    parser = _parser(prog)
    known, _ = parser.parse_known_args([word for word in argv if word not in HELP])  # the task, whose flags follow
    task = task_of(known.task)
    parser.add_argument("--method", required=True, help=f"one of: {', '.join(task.methods)}; or yours, as of compare")
    parser.add_argument(
        "--minari", required=True, metavar="NAME", help="name of the new dataset, such as push/script-v0"
    )
    flags = OptionFlags(task.environment, task.options, taken=("help", "method", "minari", *vars(known)))
    flags.add_to(parser, f"options of the task {task.name}")
    arguments = parser.parse_args(argv)
    texts = flags.texts(arguments)
    command = _command(prog, arguments, {flags[name].spelled: text for name, text in texts.items()})
    errors = Console(stderr=True)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as bar:
        shown = bar.add_task("recording", total=arguments.episodes)
        trials = demonstrate(
            task,
            arguments.method,
            arguments.minari,
            episodes=arguments.episodes,
            seed=arguments.seed,
            arm=arguments.arm,
            observation=arguments.observation,
            options=flags.options(texts, arguments.observation),
            command=command,
            progress=lambda done: bar.update(shown, completed=done),
        )
    console, reached = Console(), sum(trial["reached"] for trial in trials)
    console.note(f"{arguments.method}: {reached} of {len(trials)} goals reached")
    console.note(f"Again: {command}")
    console.note(f"Dataset: {arguments.minari}")
    return 0


def _command(prog: str, arguments: argparse.Namespace, options: dict[str, str]) -> str:
    given = {"--task": arguments.task, "--method": arguments.method, "--arm": arguments.arm}
    given |= {"--observation": CAMERA} if arguments.observation == CAMERA else {}
    given |= {"--episodes": arguments.episodes, "--seed": arguments.seed, **options, "--minari": arguments.minari}
    return " ".join([prog, *(f"{flag} {quoted(str(value))}" for flag, value in given.items() if value is not None)])


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description="Record the episodes of one method of a task as a Minari dataset.")
    parser.add_argument(
        "--task",
        default="ur5",
        help=f"one of: {', '.join(task_names())}; or module:attribute (default: %(default)s)",
    )
    parser.add_argument("--arm", metavar="NAME", help="another arm for the tasks ur5, space and arm3")
    parser.add_argument("--episodes", type=int, default=100, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the goals (default: %(default)s)")
    parser.add_argument(
        "--observation",
        default=GEOMETRIC,
        help="what the method observes: geometric, or camera (--task ur5 or space) (default: %(default)s)",
    )
    return parser

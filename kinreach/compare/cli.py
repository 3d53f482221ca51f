"""The command line of the comparison."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from textwrap import fill
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from kinreach.checks import check_path
from kinreach.cli import Parser
from kinreach.compare.comparison import compare
from kinreach.compare.contests import CONTESTS
from kinreach.compare.methods import METHODS
from kinreach.compare.observation import GEOMETRIC, CameraSettings
from kinreach.compare.scene_picture import write_scene
from kinreach.compare.settings import DEFAULT_GOALS, Settings
from kinreach.compare.tables import TABLE_WIDTH, ending
from kinreach.compare.tasks import TASKS
from kinreach.compare.tasks.button import EpisodeSettings
from kinreach.envs.button import ACTUATIONS
from kinreach.vision.ball_finder import PIPELINES

_METHODS = [f"methods of {task}: {', '.join(methods)}" for task, methods in METHODS.items()]
#: Filled here: argparse would break names at their hyphens.
_EPILOG = "\n".join(fill(line, 79, subsequent_indent="  ", break_on_hyphens=False) for line in _METHODS)


def main(argv: Sequence[str], *, prog: str) -> int:
    """Run a comparison and show its table.

    Args:
        argv: Arguments without the program's name.
        prog: How the user called it, for messages and for the command in the results.

    Returns:
        Exit code 0; anything else is raised.

    Raises:
        KinreachError: Bad input, a directory that cannot be written, a missing package.
        KeyboardInterrupt: With a message that says what was kept.
    """
    arguments = _parser(prog).parse_args(argv)
    names = tuple(name.strip() for name in arguments.methods.split(",")) if arguments.methods is not None else ()
    settings = Settings(
        task=arguments.task,
        methods=names,
        goals=arguments.goals,
        seed=arguments.seed,
        observation=arguments.observation,
        camera=_camera(arguments),
        episode=_episode(arguments),
    )
    suffix = "" if settings.camera is None else f"-{settings.observation}"
    default = Path("results") / f"compare-{settings.task}{suffix}"
    out = default if arguments.out is None else check_path("--out", arguments.out)
    everything = settings.methods == tuple(METHODS[settings.task])
    chosen = "" if everything else f" --methods {quote(','.join(settings.methods))}"
    command = (
        f"{prog} --task {settings.task}{chosen} --goals {settings.goals} --seed {settings.seed}"
        f"{_camera_arguments(settings)}{_episode_arguments(settings)}"
    )
    results = _measure(settings, out, fresh=arguments.fresh, command=command)
    scene_note = write_scene(settings, out / "scene.png")

    contest = CONTESTS[settings.task]
    console = Console(width=TABLE_WIDTH, highlight=False, markup=False, emoji=False)
    for table in contest.tables(results, title=TASKS[settings.task].title):
        console.print(table)
        console.print()
    for note in [*contest.notes(results), *ending(results, out, list(contest.figures)), scene_note]:
        console.print(note, style="dim", soft_wrap=True)
    return 0


def _measure(settings: Settings, out: Path, *, fresh: bool, command: str) -> dict[str, Any]:
    """Compare under a progress bar; Ctrl-C becomes a line that says what was kept."""
    columns = (TextColumn("comparing"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    errors = Console(stderr=True)
    # Drawn between trials, not by a thread of its own that would run into the solves that are timed.
    hidden = not errors.is_terminal
    with Progress(*columns, console=errors, transient=True, auto_refresh=False, disable=hidden) as bar:
        shown = bar.add_task("comparing", total=None)

        def show(done: int, total: int) -> None:
            if bar.tasks[shown].total is None and done:
                errors.print(f"Going on from an interrupted run: {done} of {total} trials kept (--fresh starts over).")
            bar.update(shown, completed=done, total=total, refresh=True)

        try:
            return compare(settings, out, fresh=fresh, command=command, progress=show)
        except KeyboardInterrupt:
            kept = f"{bar.tasks[shown].completed:.0f} finished trials are kept in {out}"
            raise KeyboardInterrupt(f"interrupted; {kept}; the same command goes on from there") from None


def _parser(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        description="Put all methods on the same goals and report how they do.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--task", default=Settings.task, help=f"one of: {', '.join(TASKS)} (default: %(default)s)")
    parser.add_argument(
        "--methods",
        metavar="A,B",
        help="methods to compare, or files of policies (default: all of the task's)",
    )
    parser.add_argument("--goals", type=int, default=DEFAULT_GOALS, metavar="N", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the goals (default: %(default)s)")
    parser.add_argument(
        "--observation",
        default=GEOMETRIC,
        help="what methods are told: the true goal (geometric), or what the cameras saw (camera: --task ur5, needs "
        "OpenGL) (default: %(default)s)",
    )
    parser.add_argument("--out", metavar="DIR", help="where results go (default: results/compare-TASK[-camera])")
    parser.add_argument("--fresh", action="store_true", help="do not go on from an interrupted comparison in DIR")
    cameras = parser.add_argument_group("with --observation camera")
    cameras.add_argument("--pipeline", help=f"one of: {', '.join(PIPELINES)} (default: {CameraSettings.pipeline})")
    cameras.add_argument(
        "--resolution",
        type=_resolution,
        metavar="WxH",
        help=f"of the pictures (default: {CameraSettings.width}x{CameraSettings.height}; the thesis's: 1280x720)",
    )
    cameras.add_argument("--rgb-noise", type=float, metavar="L", help="standard deviation, levels of 255 (default: 0)")
    cameras.add_argument("--depth-noise", type=float, metavar="M", help="standard deviation, metres (default: 0)")
    episodes = parser.add_argument_group("with --task button")
    default = EpisodeSettings()
    episodes.add_argument(
        "--max-steps",
        type=int,
        metavar="N",
        help=f"after which an episode is over, for all methods (default: {default.max_steps}; the environment's: 1000)",
    )
    episodes.add_argument("--actuation", help=f"one of: {', '.join(ACTUATIONS)} (default: {default.actuation})")
    return parser


def _resolution(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT in pixels, such as 640x360, got {text!r}")
    return int(width), int(height)


def _camera(arguments: argparse.Namespace) -> CameraSettings | None:
    """How the cameras look, if anything was said about it."""
    width, height = arguments.resolution or (None, None)
    said = _said(
        pipeline=arguments.pipeline, width=width, height=height, rgb_noise=arguments.rgb_noise,
        depth_noise=arguments.depth_noise,
    )  # fmt: skip
    return CameraSettings(**said) if said else None


def _episode(arguments: argparse.Namespace) -> EpisodeSettings | None:
    """How episodes are played, if anything was said about it."""
    said = _said(max_steps=arguments.max_steps, actuation=arguments.actuation)
    return EpisodeSettings(**said) if said else None


def _said(**options: Any) -> dict[str, Any]:
    """The options that were given."""
    return {name: value for name, value in options.items() if value is not None}


def _camera_arguments(settings: Settings) -> str:
    """The options that ask for this observation again; defaults are left out."""
    camera, default = settings.camera, CameraSettings()
    if camera is None:
        return ""
    options = [
        ("pipeline", camera.pipeline, default.pipeline),
        ("resolution", f"{camera.width}x{camera.height}", f"{default.width}x{default.height}"),
        ("rgb-noise", f"{camera.rgb_noise!r}", f"{default.rgb_noise!r}"),
        ("depth-noise", f"{camera.depth_noise!r}", f"{default.depth_noise!r}"),
    ]
    said = "".join(f" --{name} {value}" for name, value, usual in options if value != usual)
    return f" --observation {settings.observation}{said}"


def _episode_arguments(settings: Settings) -> str:
    """The options that ask for these episodes again; defaults are left out."""
    episode, default = settings.episode, EpisodeSettings()
    if episode is None:
        return ""
    options = [
        ("max-steps", episode.max_steps, default.max_steps),
        ("actuation", episode.actuation, default.actuation),
    ]
    return "".join(f" --{name} {value}" for name, value, usual in options if value != usual)

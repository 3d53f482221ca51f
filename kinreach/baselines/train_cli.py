"""The command line of training."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from shlex import join, quote
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from kinreach.baselines.evaluation import SPLITS, TABLE_WIDTH, evaluate, evaluation_table
from kinreach.baselines.recipes import RECIPES, Recipe, get_recipe
from kinreach.checks import MOST_THREADS, check_count, check_known, check_path
from kinreach.cli import Parser
from kinreach.errors import InputError, InstallationError

#: Goals that a finished policy is tried on; `evaluate` does it properly.
GOALS = 1000
#: Which of them, unless the user says so: a recipe may be changed because of what is printed.
SPLIT = "validation"


def main(argv: Sequence[str], *, prog: str) -> int:
    """Train one recipe with one seed or several.

    Args:
        argv: Arguments without the program's name.
        prog: How the user called it, for messages.

    Returns:
        Exit code 0; anything else is raised.

    Raises:
        KinreachError: Bad input, packages for training that are not installed, a folder that cannot be written.
        KeyboardInterrupt: With a message that says what was kept.
    """
    arguments = _parser(prog).parse_args(argv)
    recipe = get_recipe(arguments.recipe)
    for name in ("seeds", "steps", "threads"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InputError(f"--{name} must be at least 1, got {value}")
    if arguments.seed < 0:
        raise InputError(f"--seed must not be negative, got {arguments.seed}")
    check_count("--seed", arguments.seed + arguments.seeds, most=2**31)
    check_count("--threads", arguments.threads, most=MOST_THREADS)
    check_known("split", arguments.split, SPLITS)
    if arguments.resume and arguments.fresh:
        raise InputError("--resume goes on with a run, --fresh replaces it: one of them")
    if not arguments.out:
        raise InputError("--out must name a folder, got ''")
    out = check_path("--out", arguments.out)
    console = Console(width=TABLE_WIDTH, highlight=False, markup=False, emoji=False)
    evaluations = {}
    for seed in range(arguments.seed, arguments.seed + arguments.seeds):
        folder = out / recipe.name / f"seed-{seed}"
        run = _train(recipe, folder, seed, arguments, prog)
        console.print(f"{folder}: {run.seconds:.0f} s, {run.cpu_seconds:.0f} s of processor time", soft_wrap=True)
        options = {name: value for name, value in recipe.options.items() if name != "end_on_reached"}
        evaluations[f"seed {seed}"] = evaluate(
            run.policy, goals=GOALS, seed=SPLITS[arguments.split], options=options
        ).summary()
    console.print(evaluation_table(evaluations, title=f"{recipe.name}, {GOALS} {arguments.split} goals"))
    again = f"kinreach evaluate {quote(str(out / recipe.name))}/seed-*/policy.safetensors"
    console.print(f"Held-out goals, more of them, dynamics, cameras: {again}", style="dim", soft_wrap=True)
    return 0


def _train(recipe: Recipe, folder: Path, seed: int, arguments: argparse.Namespace, prog: str) -> Any:
    """Train under a progress bar; Ctrl-C becomes a line that says how to go on."""
    try:
        from kinreach.baselines.training import train  # the only import that needs the extra
    except ImportError as error:
        raise InstallationError(f"training needs more packages ({error.name}): pip install 'kinreach[train]'") from None
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[figures]}"),
    )
    errors = Console(stderr=True)
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        shown = bar.add_task(f"{recipe.name}, seed {seed}", total=None, figures="")

        def show(done: int, planned: int, row: dict[str, float | None]) -> None:
            bar.update(shown, completed=done, total=planned, figures=_figures(row))

        try:
            return train(
                recipe,
                folder,
                seed=seed,
                steps=arguments.steps,
                resume=arguments.resume,
                fresh=arguments.fresh,
                threads=arguments.threads,
                export=arguments.export,
                progress=show,
                notice=lambda text: errors.print(text, highlight=False, markup=False, emoji=False, soft_wrap=True),
            )
        except KeyboardInterrupt:
            again = f"{prog} {join(_again(arguments))}"
            raise KeyboardInterrupt(f"interrupted; what is in {folder} is kept; go on with: {again}") from None


def _again(arguments: argparse.Namespace) -> list[str]:
    """The arguments that go on with what was interrupted."""
    said = [arguments.recipe, "--seed", str(arguments.seed)]
    for name, default in (("seeds", 1), ("steps", None), ("threads", 1), ("split", SPLIT)):
        value = getattr(arguments, name)
        said += [] if value == default else [f"--{name}", str(value)]
    said += ["--export"] if arguments.export else []
    return [*said, "--out", str(arguments.out), "--resume"]


def _figures(row: dict[str, float | None]) -> str:
    """The last row of the learning curve, as far as it has something to say."""
    parts = []
    if row["reward"] is not None:
        parts.append(f"reward {row['reward']:.2f}")
    if row["reached"] is not None:
        parts.append(f"reached {100 * row['reached']:.0f} %")
    if row["distance"] is not None:
        parts.append(f"{1e3 * row['distance']:.1f} mm")
    return ", ".join(parts)


def _parser(prog: str) -> Parser:
    lines = [f"  {name:<{max(map(len, RECIPES))}}  {recipe.summary}" for name, recipe in RECIPES.items()]
    parser = Parser(
        prog=prog,
        description="Train a policy by a recipe; the folder gets policy.safetensors, curve.csv and run.json.",
        epilog="recipes:\n" + "\n".join(lines),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "recipe", metavar="RECIPE", help="what to train: one of those below, or module:RECIPE of your own"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="the first seed (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=1, metavar="K", help="how many seeds (default: %(default)s)")
    parser.add_argument("--steps", type=int, metavar="N", help="actions to train for (default: the recipe's)")
    parser.add_argument(
        "--out", metavar="DIR", default="results/train", help="runs go into DIR/RECIPE/seed-S (default: %(default)s)"
    )
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint; keep what is finished")
    parser.add_argument("--fresh", action="store_true", help="replace another run that is finished in the folder")
    parser.add_argument(
        "--export",
        action="store_true",
        help="write stable-baselines3's own model.zip too",
    )
    parser.add_argument(
        "--split",
        default=SPLIT,
        metavar="GOALS",
        help="goals that the policies are tried on: validation, by which settings may be chosen, or held-out, "
        "for which nothing may be chosen (default: %(default)s)",
    )
    parser.add_argument(
        "--threads",
        type=int,
        default=1,
        metavar="T",
        help="of torch; part of what a policy follows from (default: %(default)s)",
    )
    return parser

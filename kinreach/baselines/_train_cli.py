"""The command line of training."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from kinreach._checks import MAX_THREADS, check_count, check_known, check_out_file, check_path
from kinreach._files import replacing
from kinreach._jobs import SERIAL, Engine, add_options, open_engine
from kinreach._terminal import Console
from kinreach.baselines._evaluation import SPLITS, TABLE_WIDTH, evaluate, evaluation_table
from kinreach.baselines._learning_curve import read_curve
from kinreach.baselines._policies import LearnedPolicy
from kinreach.baselines._recipes import RECIPES, Recipe, get_recipe
from kinreach.cli import Parser, quoted
from kinreach.errors import InputError, InstallationError

if TYPE_CHECKING:
    from kinreach.baselines._training import Run

#: Goals of the evaluation after a training.
GOALS = 1000
#: Default goals, by which recipes may be changed.
SPLIT = "validation"


def main(argv: Sequence[str], *, prog: str) -> int:
    """Train one recipe with one seed or several."""
    arguments = _parser(prog).parse_args(argv)
    recipe = get_recipe(arguments.recipe)
    for name in ("seeds", "steps", "threads"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise InputError(f"--{name} must be at least 1, got {value}")
    if arguments.seed < 0:
        raise InputError(f"--seed must not be negative, got {arguments.seed}")
    check_count("--seed plus --seeds", arguments.seed + arguments.seeds, most=2**31)
    check_count("--threads", arguments.threads, most=MAX_THREADS)
    check_known("split", arguments.split, SPLITS)
    if arguments.resume and arguments.fresh:
        raise InputError("--resume goes on with a run, --fresh replaces it: one of them")
    if not arguments.out:
        raise InputError("--out must name a folder, got ''")
    out = check_path("--out", arguments.out)
    picture = None if arguments.picture is None else check_out_file("--picture", arguments.picture)
    console = Console(width=TABLE_WIDTH)
    seeds = range(arguments.seed, arguments.seed + arguments.seeds)
    folders = {seed: out / recipe.name / f"seed-{seed}" for seed in seeds}
    policies, curves = {}, {}
    with open_engine(arguments.engine, arguments.address) as engine:
        for run in _runs(recipe, folders, engine, arguments, prog):
            words = f"{run.folder}: {run.seconds:.0f} s, {run.cpu_seconds:.0f} s of processor time"
            words += "; model.zip is there too" if arguments.export else ""
            console.print(words, soft_wrap=True)
            policies[run.card.seed] = run.policy
            curves[f"seed {run.card.seed}"] = read_curve(run.folder / "curve.csv")
        judge = partial(_judge, arguments.recipe, arguments.split)
        found = sorted(engine.map(judge, [policies[seed] for seed in seeds]), key=itemgetter(0))
    evaluations = {f"seed {seeds[number]}": summary for number, summary in found}
    console.print(evaluation_table(evaluations, title=f"{recipe.name}, {GOALS} {arguments.split} goals"))
    if picture is not None:
        _draw(recipe, dict(sorted(curves.items())), picture)
        console.print(f"picture: {picture}", soft_wrap=True)
    again = f"kinreach evaluate {quoted(str(out / recipe.name))}/seed-*/policy.safetensors"
    console.note(f"On held-out goals: {again}")
    return 0


def _draw(recipe: Recipe, curves: Mapping[str, Mapping[str, Any]], picture: Path) -> None:
    """Write the learning curves as figures 5.1 to 5.4 of the thesis."""
    from kinreach.plots import draw_training  # matplotlib takes a second to import
    from kinreach.plots.inside import name_label

    title = f"{name_label(recipe.name)}, {len(curves)} {'seed' if len(curves) == 1 else 'seeds'}"
    figure = draw_training(curves, environment=recipe.environment, title=title)
    with replacing(picture) as temporary:
        figure.savefig(temporary, facecolor="white", format="png")


@contextmanager
def _needs_training() -> Iterator[None]:
    """Name the extra if an import fails; nothing but training needs it."""
    try:
        yield
    except ImportError as error:
        raise InstallationError(f"training needs more packages ({error.name}): pip install 'kinreach[train]'") from None


def _judge(name: str, split: str, policy: LearnedPolicy) -> Iterator[dict[str, Any]]:
    """Evaluate a policy that was trained by a recipe, as a job."""
    yield evaluate(policy, goals=GOALS, seed=SPLITS[split], options=get_recipe(name).judged_in).summary()


def _runs(
    recipe: Recipe, folders: Mapping[int, Path], engine: Engine, arguments: argparse.Namespace, prog: str
) -> Iterator[Run]:
    """Train with a progress bar; Ctrl-C prints how to resume."""
    with _needs_training():
        from kinreach.baselines._seeds import train_seeds
        from kinreach.baselines._training import train
    errors = Console(stderr=True)
    common: dict[str, Any] = {
        name: getattr(arguments, name) for name in ("steps", "resume", "fresh", "start", "threads", "export")
    }
    common["notice"] = partial(errors.print, soft_wrap=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[figures]}"),
    )
    writing = next(iter(folders.values())).parent
    try:
        with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
            shown = bar.add_task(f"{recipe.name}, {len(folders)} seeds", total=None, figures="")
            tenth = 0

            def show(done: int, planned: int, row: dict[str, float | None] | None = None) -> None:
                nonlocal tenth
                figures = _figures(row) if row else ""
                bar.update(shown, completed=done, total=planned, figures=figures)
                if not errors.is_terminal and 10 * done // planned != tenth:  # a log has lines
                    tenth = 10 * done // planned
                    errors.print(f"{bar.tasks[0].description}: {10 * tenth} % {figures}".rstrip(), soft_wrap=True)

            if arguments.engine != SERIAL:
                yield from train_seeds(arguments.recipe, folders, engine, progress=show, **common)
                return
            for seed, writing in folders.items():
                bar.reset(shown, description=f"{recipe.name}, seed {seed}")
                yield train(recipe, writing, seed=seed, progress=show, **common)
    except KeyboardInterrupt:
        again = f"{prog} {' '.join(map(quoted, _again(arguments)))}"
        raise KeyboardInterrupt(f"interrupted; what is in {writing} is kept; go on with: {again}") from None


def _again(arguments: argparse.Namespace) -> list[str]:
    """Return the arguments that resume an interrupted command."""
    words = [arguments.recipe, "--seed", str(arguments.seed)]
    defaults = {"seeds": 1, "steps": None, "threads": 1, "split": SPLIT, "engine": SERIAL, "address": None}
    for name, default in defaults.items():
        value = getattr(arguments, name)
        words += [] if value == default else [f"--{name}", str(value)]
    words += ["--picture", str(arguments.picture)] if arguments.picture is not None else []
    words += ["--from", str(arguments.start)] if arguments.start is not None else []
    words += ["--export"] if arguments.export else []
    return [*words, "--out", str(arguments.out), "--resume"]


def _figures(row: dict[str, float | None]) -> str:
    texts = (
        ("reward", "reward {:.2f} a step", 1),
        ("reached", "reached {:.0f} %", 100),
        ("distance", "{:.1f} mm", 1e3),
    )
    found = ((text, factor, row[name]) for name, text, factor in texts)
    return ", ".join(text.format(factor * value) for text, factor, value in found if value is not None)


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
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from the last checkpoint; keep what is finished, unless --steps asks for more",
    )
    parser.add_argument(
        "--from",
        dest="start",
        metavar="POLICY",
        help="begin with the weights of a policy: the name of one that ships, or a file",
    )
    parser.add_argument("--fresh", action="store_true", help="replace another run that is finished in the folder")
    parser.add_argument(
        "--export",
        action="store_true",
        help="write stable-baselines3's own model.zip too",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        help="draw rewards and goals reached of all seeds, as the thesis's figures 5.1 to 5.4; with --resume also of "
        "trainings that are finished",
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
    add_options(parser)
    return parser

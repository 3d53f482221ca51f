"""What trained reach policies do on held-out goals, over all seeds of every recipe.

The tables of docs/studies/appendix/trainings.md.

python -m kinreach.train ranked-single --seeds 5         (and the other recipes)
python -m benchmarks.studies.trained results/train --goals 10000
python -m benchmarks.studies.trained results/train --backend mujoco --recipes ranked-single,ppo-single
and `--observation camera --goals 200` beside `--backend mujoco`: goals as the cameras see them.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.studies.trainings import Trainings, decimals_for, finished, print_table, with_interval
from kinreach._registration import BUTTON
from kinreach._statistics import median, p95
from kinreach.baselines._recipes import RECIPES
from kinreach.cli import Parser, finish

PROG = "python -m benchmarks.studies.trained"

HEADINGS = (
    "reached, % [95 % CI over seeds]", "worst seed, %", "median, mm [95 % CI over seeds]", "p95, mm", "within 1 mm, %",
    "within 2 mm, %", "worst seed: median, mm", "impossible, %", "steps",
)  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, one row per recipe."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--recipes", metavar="A,B", help="default: all that were trained")
    parser.add_argument("--goals", type=int, default=1000, help="the same for every seed")
    parser.add_argument("--backend", help="default: kinematic, where there is another")
    parser.add_argument("--observation", help="default: geometric, or pixels where a policy sees pictures")
    parser.add_argument("--exposure", type=float, help="pictures are up to so much brighter or darker")
    arguments = parser.parse_args(argv)
    flags = {name: getattr(arguments, name) for name in ("backend", "observation", "exposure")}
    given = {name: value for name, value in flags.items() if value is not None}
    reach = [name for name, recipe in RECIPES.items() if recipe.environment != BUTTON]
    recipes = arguments.recipes.split(",") if arguments.recipes else reach
    rows = (
        Trainings.evaluated(recipe, folders, goals=arguments.goals, options=_fixed(recipe) | given)
        for recipe, folders in finished(arguments.runs, recipes).items()
    )
    print_table(HEADINGS, rows, cells)
    return 0


def _fixed(recipe: str) -> dict[str, Any]:
    """The options that a recipe is evaluated with by default."""
    options = RECIPES[recipe].options
    fixed = {"backend": "kinematic"} if "backend" in options else {}
    return {**fixed, **{name: value for name, value in options.items() if name == "collisions"}}


def cells(trainings: Trainings) -> tuple[str, ...]:
    """The cells of a row, in the order of the headings; what has no interval is of all seeds together."""
    reached, mm = trainings.reached, 1e3 * trainings.measured("distance")
    high, worst = p95(mm.ravel()), median(mm, axis=1).max()
    return (
        with_interval(reached, unit=100, decimals=2),
        f"{100 * reached.mean(axis=1).min():.2f}",
        with_interval(mm, median),
        f"{high:.{decimals_for(high)}f}",
        *(f"{100 * np.mean((mm <= limit) & ~trainings.impossible):.2f}" for limit in (1, 2)),
        f"{worst:.{decimals_for(worst)}f}",
        f"{100 * trainings.impossible.mean():.2f}",
        f"{np.median(trainings.measured('steps')):.0f}",
    )


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

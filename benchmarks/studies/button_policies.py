"""What trained policies press on held-out targets, over all seeds of every recipe.

The table of docs/studies/appendix/button.md.

python -m kinreach.train button --seeds 5         (and the other recipes)
python -m benchmarks.studies.button_policies results/train
"""

from __future__ import annotations

import argparse
from pathlib import Path

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.studies.trainings import Trainings, finished, print_table, with_interval
from kinreach._registration import BUTTON
from kinreach._statistics import median
from kinreach.baselines._recipes import RECIPES
from kinreach.cli import Parser, finish

PROG = "python -m benchmarks.studies.button_policies"

HEADINGS = (
    "pressed, % [95 % CI over seeds]", "every seed, %", "steps, median of every seed",
    "wrong presses an episode [95 % CI over seeds]", "every seed",
)  # fmt: skip


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each recipe that was trained."""
    button = [name for name, recipe in RECIPES.items() if recipe.environment == BUTTON]
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    parser.add_argument("--recipes", metavar="A,B", default=",".join(button), help="default: all that were trained")
    parser.add_argument("--goals", type=int, default=1000, help="targets, the same for every seed")
    arguments = parser.parse_args(argv)
    rows = (
        Trainings.evaluated(recipe, folders, goals=arguments.goals, options=RECIPES[recipe].options)
        for recipe, folders in finished(arguments.runs, arguments.recipes.split(",")).items()
    )
    print_table(HEADINGS, rows, cells)
    return 0


def cells(trainings: Trainings) -> tuple[str, ...]:
    """The cells of a row, in the order of the headings.

    Steps are those of the episodes in which the button was pressed. Those are other targets for every seed, so that the
    medians have no interval in common.
    """
    pressed, wrong = trainings.reached, trainings.measured("wrong_presses")
    steps = (row[flags] for row, flags in zip(trainings.measured("steps"), pressed, strict=True))
    return (
        with_interval(pressed, unit=100, decimals=1),
        ", ".join(f"{100 * share:.1f}" for share in pressed.mean(axis=1)),
        ", ".join(f"{median(needed):.0f}" if len(needed) else "-" for needed in steps),
        with_interval(wrong, decimals=2),
        ", ".join(f"{count:.2f}" for count in wrong.mean(axis=1)),
    )


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

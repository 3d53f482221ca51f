"""How many goals the thesis's trainings reach while they explore, recipe by recipe and seed by seed.

    python -m benchmarks.studies.reached_in_training thesis-ppo-single [RECIPE ...] [--runs results/train]

Of the logs in `benchmarks/logs`, or of own trainings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import benchmarks.learners  # noqa: F401 (registers its recipes)
from benchmarks.logs import load_logs
from benchmarks.studies.tables import head, line
from benchmarks.studies.thesis_curves import reached
from benchmarks.studies.trainings import trainings_interval
from kinreach.baselines._recipes import RECIPES
from kinreach.cli import Parser, finish

PROG = "python -m benchmarks.studies.reached_in_training"


def row(recipe: str, runs: Path | None = None) -> str:
    """A row of the table, as Markdown: episodes of a training, goals of each seed, mean with Student's interval."""
    logs = load_logs(recipe, runs=runs)
    counts = np.array([reached(log, slice(None)) for log in logs.values()])
    episodes = max(int(log["episodes"][-1]) for log in logs.values())
    low, high = trainings_interval(counts[:, None], most=float(episodes))
    each = " / ".join(f"{count:.0f}" for count in counts)
    return line(f"`{recipe}`", len(logs), episodes, each, f"{counts.mean():.0f} [{low:.0f}, {high:.0f}]")


def main(argv: list[str] | None = None) -> int:
    """Print the table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recipes", nargs="+", choices=RECIPES, metavar="RECIPE")
    parser.add_argument("--runs", type=Path, help="own trainings (default: benchmarks/logs)")
    arguments = parser.parse_args(argv)
    print(head("recipe", "seeds", "episodes", "goals reached in training, by seed", "mean [95 % CI over seeds]"))
    for recipe in arguments.recipes:
        print(row(recipe, arguments.runs), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

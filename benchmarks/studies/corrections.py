"""The learned correction of task `real-arm`, trained with several seeds, beside its rivals, on fresh workplaces.

python -m benchmarks.studies.corrections
"""

from __future__ import annotations

import argparse
from typing import Any

from benchmarks.studies.tables import head, line
from kinreach._checks import check_count
from kinreach.cli import Parser, finish
from kinreach.compare import compare
from kinreach.compare._methods.correction import LearnedCorrection
from kinreach.compare._methods.practice import LookingPolicy

PROG = "python -m benchmarks.studies.corrections"
LOOKS = (5, 10, 20, 50)
#: Of the workplaces: nothing was chosen on these.
SEED = 100


def trained_with(seed: int) -> type[LookingPolicy]:
    """A method whose training has another seed."""

    class Seeded(LookingPolicy):
        def __init__(self, env: Any) -> None:
            super().__init__(lambda own: LearnedCorrection(own.noise, seed), env)

    Seeded.__name__ = f"seed {seed}"
    return Seeded


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="of trainings (default: %(default)s)")
    parser.add_argument("--goals", type=int, default=40, help="workplaces (default: %(default)s)")
    arguments = parser.parse_args(argv)
    rivals: list[Any] = ["identified", "residual"]
    seeds, goals = check_count("--seeds", arguments.seeds), check_count("--goals", arguments.goals)
    print(head("method", *(f"{looks} looks, mm" for looks in LOOKS)))
    for method in (*rivals, *map(trained_with, range(seeds))):
        (found,) = compare("real-arm", [method], goals=goals, seed=SEED, options={"errors": ("all",)})["methods"]
        cells = (f"{found['all'][f'looks_{looks}_0']['median']:.3f}" for looks in LOOKS)
        print(line(found["name"], *cells), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

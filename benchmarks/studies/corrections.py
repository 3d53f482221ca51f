"""The learned corrections of task `real-arm`, trained with several seeds, beside their rivals, on fresh workplaces.

    python -m benchmarks.studies.corrections | python -m benchmarks.studies.tables corrections

With errors of frames alone ("all") the training of `correction`, with those that no frame describes too
("everything") that of `correction-joints`. A cell is the median over workplaces of the median distance of 50 balls;
the last row of each has Student's interval over the trainings. Finished rows are kept in `--out`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.parts import kept
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import with_interval
from kinreach._checks import check_count
from kinreach._files import make_writable
from kinreach.cli import Parser, finish
from kinreach.compare import compare
from kinreach.compare._methods.learned import LearnedCorrection
from kinreach.compare._methods.practice import LookingPolicy

PROG = "python -m benchmarks.studies.corrections"
LOOKS = (5, 10, 20, 50)
#: Of the workplaces: nothing was chosen on these.
SEED = 100
#: What is off, to the learned method there and its rivals.
ERRORS = {
    "all": ("correction", ("identified", "residual")),
    "everything": ("correction-joints", ("identified", "identified-joints", "residual")),
}


def trained_with(seed: int, *, joints: bool) -> type[LookingPolicy]:
    """A method whose training has another seed."""

    class Seeded(LookingPolicy):
        def __init__(self, env: Any) -> None:
            super().__init__(lambda own: LearnedCorrection(own.noise, seed, joints=joints), env)

    Seeded.__name__ = f"seed {seed}"
    return Seeded


def medians(errors: str, method: Any, goals: int) -> list[float]:
    """Return the method's distances [mm] after `LOOKS`."""
    (found,) = compare("real-arm", [method], goals=goals, seed=SEED, options={"errors": (errors,)})["methods"]
    return [float(found[errors][f"looks_{looks}_0"]["median"]) for looks in LOOKS]


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="of trainings (default: %(default)s)")
    parser.add_argument("--goals", type=int, default=40, help="workplaces (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("results/corrections"), help="where finished rows are kept")
    arguments = parser.parse_args(argv)
    seeds, goals = check_count("--seeds", arguments.seeds), check_count("--goals", arguments.goals)
    make_writable(arguments.out)
    print(head("what is off", "method", *(f"{looks} looks, mm" for looks in LOOKS)))
    for errors, (learned, rivals) in ERRORS.items():

        def row(name: str, method: Any, errors: str = errors) -> list[float]:
            key = {"errors": errors, "method": name, "goals": goals, "seed": SEED}
            found = kept(arguments.out, key, lambda: medians(errors, method, goals))
            print(line(errors, name, *(f"{value:.3f}" for value in found)), flush=True)
            return found

        for rival in rivals:
            row(f"`{rival}`", rival)
        trainings = [
            row(f"`{learned}`, seed {seed}", trained_with(seed, joints=learned != "correction"))
            for seed in range(seeds)
        ]
        cells = (with_interval(column[:, None], decimals=3) for column in np.transpose(trainings))
        print(line(errors, f"`{learned}`, mean of {seeds} trainings", *cells), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

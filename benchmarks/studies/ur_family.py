"""Singular poses of every model of the UR family: how often the closed form comes back empty or wrong.

python -m benchmarks.studies.ur_family [--engine ray]
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.speed.poses import CASES
from benchmarks.speed.suites.ik_edge_cases import judge
from benchmarks.studies.parts import each
from benchmarks.studies.tables import head, line
from kinreach._jobs import add_options
from kinreach.cli import Parser, finish
from kinreach.kinematics import URKinematics
from kinreach.robots._ur import UR_LENGTHS

PROG = "python -m benchmarks.studies.ur_family"


def row(name: str, poses: int, seed: int) -> str:
    """A row of the table, as Markdown."""
    arm = URKinematics(name)
    cells, worst = [], 0.0
    for make in CASES.values():
        tally = judge(lambda T: arm.all_solutions(T).q, make(np.random.default_rng(seed), poses, arm), arm)
        cells.append(f"{tally.empty:g} / {tally.spurious:g}")
        worst = max(worst, tally.worst)
    return line(f"`{name}`", *cells, f"{worst:.0e}")


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each model."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1000, help="of each model in each case")
    parser.add_argument("--seed", type=int, default=0)
    add_options(parser)
    arguments = parser.parse_args(argv)
    print(head("model", *CASES, "largest error"))
    for found in each(arguments, row, [(name, arguments.poses, arguments.seed) for name in UR_LENGTHS]):
        print(found, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

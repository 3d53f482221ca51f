"""Singular poses of every model of the UR family: how often the closed form comes back empty or wrong.

python -m benchmarks.studies.ur_family
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.speed.poses import CASES
from benchmarks.speed.suites.ik_edge_cases import judge
from benchmarks.studies.tables import head, line
from kinreach.cli import Parser, finish
from kinreach.kinematics import URKinematics
from kinreach.robots.ur import LENGTHS

PROG = "python -m benchmarks.studies.ur_family"


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each model."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1000, help="of each model in each case")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args(argv)
    print(head("model", *CASES, "largest error"))
    for name in LENGTHS:
        arm = URKinematics(name)
        cells, worst = [], 0.0
        for make in CASES.values():
            poses = make(np.random.default_rng(arguments.seed), arguments.poses, arm)
            tally = judge(lambda T, arm=arm: arm.all_solutions(T).q, poses, arm)  # type: ignore[misc]
            cells.append(f"{tally.empty:g} / {tally.spurious:g}")
            worst = max(worst, tally.worst)
        print(line(f"`{name}`", *cells, f"{worst:.0e}"), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

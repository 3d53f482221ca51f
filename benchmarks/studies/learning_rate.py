"""Whether multi-step's learning rate is too high, as 5.2 supposes: the most faithful reading at parts of the rate.

    python -m benchmarks.studies.learning_rate

All trainings run side by side, as those of `benchmarks.studies.ppo2`.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.studies.ppo2 import PLANS, Cell, measure
from benchmarks.studies.side_by_side import train_stack
from benchmarks.studies.tables import head, line
from kinreach._checks import check_count
from kinreach._registration import MULTI
from kinreach.cli import Parser, finish

PROG = "python -m benchmarks.studies.learning_rate"
#: Of the thesis's learning rate; rows of a learning curve.
PARTS, WINDOWS = (1.0, 0.25), 37


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="of each rate (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=150_000, help="of a training (default: %(default)s)")
    arguments = parser.parse_args(argv)
    seeds, steps = check_count("--seeds", arguments.seeds), check_count("--steps", arguments.steps)
    stack = replace(PLANS["multi"].stack, steps=steps, windows=WINDOWS)
    trained = [
        replace(one, rate=part * one.rate) for part in PARTS for one in (Cell().trained(MULTI, s) for s in range(seeds))
    ]
    networks, curves = train_stack(stack, trained)
    found = measure(networks, len(trained), MULTI)
    print(head("learning rate", "seed", "impossible steps, %", "reward of possible steps, last", "distance, mm"))
    for index, one in enumerate(trained):
        columns = curves.columns(index)
        impossible, reward = 100 * np.mean(columns["impossible"]), np.mean(columns["reward"][-4:])
        print(line(f"{one.rate:g}", one.seed, f"{impossible:.3f}", f"{reward:.2f}", f"{found[index]['distance']:.0f}"))
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

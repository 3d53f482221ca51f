"""Errors of an arm that no frame describes: least squares, a Gaussian process, learned corrections and policies.

    python -m benchmarks.studies.nongeometric | python -m benchmarks.studies.tables nongeometric all-errors

Gears that give way under a load, their hysteresis, encoders off their axes and a stand that bends: each alone, all
four, and all four with links, tool, base and cameras that are off. `kinreach.envs.real_arm` has their sizes and the
sources of these. Cells are medians over workplaces of the median distance of 50 balls. Where the links are off there
are four robots, all published calibrations of a UR5: the cell is the mean of their medians, with Student's interval
over the robots. Elsewhere the interval is the bootstrap's over workplaces. Finished rows are kept in `--out`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.studies.parts import kept
from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import with_interval
from kinreach._checks import check_count
from kinreach._files import make_writable
from kinreach._statistics import bootstrap_intervals, median
from kinreach.baselines._loop import as_policy, rollout
from kinreach.cli import Parser, finish
from kinreach.compare._task import get_task
from kinreach.envs.inside import in_doubles
from kinreach.envs.real_arm import ERRORS, LINKS, NONGEOMETRIC

PROG = "python -m benchmarks.studies.nongeometric"
KINDS = (*NONGEOMETRIC, "nongeometric", "everything")
METHODS = (
    "data-sheet",
    "look-again",
    "identified",
    "identified-joints",
    "residual",
    "correction",
    "correction-joints",
    "policy-tuned",
    "policy-informed",
)
#: Looks before and moves beside the ball of the columns.
CELLS = {"no look, mm": (0, 0), "5 looks, mm": (5, 0), "20 looks, mm": (20, 0), "50 looks, mm": (50, 0),
         "1 beside, mm": (0, 1)}  # fmt: skip
#: Of the workplaces: nothing was chosen on these.
SEED = 100


def measured(kind: str, name: str, goals: int) -> list[dict[str, Any]]:
    """Return, of each workplace, the robot's name and the distances [mm] in the order of `CELLS`."""
    task = get_task("real-arm")
    env = gym.make(task.environment, **{**in_doubles(task.environment), **task.options, "errors": (kind,), "again": 1})
    policy = as_policy(task.methods[name].make(env))
    return [
        {
            "robot": trial["calibration"],
            "mm": [1e3 * trial[f"error_{looks}_{again}"] for looks, again in CELLS.values()],
        }
        for trial in rollout(env, policy, task.resets(goals, SEED, env))
    ]


def cells(kind: str, found: list[dict[str, Any]]) -> list[str]:
    """Return the cells of a row."""
    values = np.array([trial["mm"] for trial in found])
    if LINKS in ERRORS[kind]:
        robots = np.array([trial["robot"] for trial in found])
        medians = [np.median(values[robots == robot], axis=0) for robot in sorted(set(robots))]
        return [with_interval(column[:, None], decimals=2) for column in np.transpose(medians)]
    return [
        f"{np.median(column):.2f} [{low:.2f}, {high:.2f}]"
        for column in values.T
        for low, high in bootstrap_intervals(column, (median,))
    ]


def main(argv: list[str] | None = None) -> int:
    """Print two Markdown tables: the errors that no frame describes, and all errors together."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=40, help="workplaces (default: %(default)s)")
    parser.add_argument("--errors", nargs="+", default=KINDS, choices=KINDS, help="some of the kinds")
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS, help="some of the methods")
    parser.add_argument("--out", type=Path, default=Path("results/nongeometric"), help="where finished rows are kept")
    arguments = parser.parse_args(argv)
    goals = check_count("--goals", arguments.goals)
    make_writable(arguments.out)
    for kinds in (KINDS[:-1], KINDS[-1:]):
        asked = [kind for kind in kinds if kind in arguments.errors]
        if asked:
            print(head(*("what is off",) * (len(kinds) > 1), "method", *CELLS))
        for kind in asked:
            for name in arguments.methods:
                key = {"errors": kind, "method": name, "goals": goals, "seed": SEED}
                found = kept(arguments.out, key, lambda kind=kind, name=name: measured(kind, name, goals))
                print(line(*(kind,) * (len(kinds) > 1), f"`{name}`", *cells(kind, found)), flush=True)
        print()
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

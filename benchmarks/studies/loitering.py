"""Do policies wait beside the goal instead of reaching it? The experiment of docs/studies/appendix/multi_step.md.

`python -m benchmarks.studies.loitering results/train` after training `ppo-multi` and `ppo-multi-ending`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.studies.tables import head, line
from benchmarks.studies.trainings import POLICY, finished
from kinreach._registration import MULTI
from kinreach.baselines._batch import make_batch
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import LearnedPolicy, load_policy
from kinreach.cli import Parser, finish
from kinreach.thesis import REACHED_DISTANCE

PROG = "python -m benchmarks.studies.loitering"

GOALS = 500


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, one row per seed of both recipes."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    found = finished(parser.parse_args(argv).runs, ("ppo-multi-ending", "ppo-multi"))
    print(head("recipe, seed", "reached, %", "came within 10 mm, %", "steps waited there", "r_e meanwhile, median"))
    for recipe, folders in found.items():
        for folder in folders:
            reached, near, waited, error = watch(load_policy(folder / POLICY, environment=MULTI))
            meanwhile = "-" if error is None else f"{error:.3f}"
            shares = (f"{value:.1f}" for value in (reached, near, waited))
            print(line(f"`{recipe}`, {folder.name[5:]}", *shares, meanwhile))
    return 0


def watch(policy: LearnedPolicy, goals: int = GOALS) -> tuple[float, float, float, float | None]:
    """Shares [%] of goals reached and come near to, mean steps near but not reached, median r_e in those if any."""
    near = np.zeros(goals, bool)
    errors = []

    def look(observations: Any, rewards: Any, info: Mapping[str, Any], pending: Any) -> None:
        beside = pending & (info["distance"] < REACHED_DISTANCE)
        errors.append(info["posture_error"][beside & ~info["reached"]])
        near[beside] = True

    with closing(make_batch(MULTI, goals, {"backend": "kinematic"})) as env:
        trials = rollout_batch(env, policy, seed=HELD_OUT, watch=look)
    waits = np.concatenate(errors)
    middle = float(np.median(waits)) if len(waits) else None
    reached = np.mean([trial["reached"] for trial in trials])
    return 100 * float(reached), 100 * near.mean(), len(waits) / goals, middle


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

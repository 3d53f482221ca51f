"""Do policies wait beside the goal instead of reaching it? The experiment of docs/training.md.

`python -m benchmarks.studies.loitering results/train` after training `ppo-multi` and `ppo-multi-ending`.
"""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

import gymnasium as gym
import numpy as np

from benchmarks.studies.trainings import POLICY, finished
from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.policies import LearnedPolicy, load_policy
from kinreach.cli import Parser, finish
from kinreach.registration import MULTI
from kinreach.thesis.reward import REACHED_DISTANCE

PROG = "python -m benchmarks.studies.loitering"

GOALS = 500


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, one row per seed of both recipes."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, help="the folder that `kinreach train --out` wrote to")
    found = finished(parser.parse_args(argv).runs, ("ppo-multi-ending", "ppo-multi"))
    print("| recipe, seed | reached, % | came within 10 mm, % | steps waited there | r_e meanwhile, median |")
    print("|---|---|---|---|---|")
    for recipe, folders in found.items():
        for folder in folders:
            reached, near, waited, error = watch(load_policy(folder / POLICY, environment=MULTI))
            meanwhile = "-" if error is None else f"{error:.3f}"
            print(f"| `{recipe}`, {folder.name[5:]} | {reached:.1f} | {near:.1f} | {waited:.1f} | {meanwhile} |")
    return 0


def watch(policy: LearnedPolicy, goals: int = GOALS) -> tuple[float, float, float, float | None]:
    """Shares [%] of goals reached and come near to, mean steps near but not reached, median r_e in those if any."""
    env = gym.make_vec(MULTI, num_envs=goals, vectorization_mode="vector_entry_point", backend="kinematic")
    live, reached, near = np.ones(goals, bool), np.zeros(goals, bool), np.zeros(goals, bool)
    errors = []
    with closing(env):
        observations, _ = env.reset(seed=HELD_OUT)
        while live.any():
            observations, _, terminated, truncated, info = env.step(policy.act(observations))
            beside = live & (info["distance"] < REACHED_DISTANCE)
            errors.append(info["posture_error"][beside & ~info["reached"]])
            near |= beside
            reached |= live & info["reached"]
            live &= ~(terminated | truncated)
    waits = np.concatenate(errors)
    middle = float(np.median(waits)) if len(waits) else None
    return 100 * reached.mean(), 100 * near.mean(), len(waits) / goals, middle


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

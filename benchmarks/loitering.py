"""Do policies wait beside the goal instead of reaching it? The experiment of docs/training.md.

`python -m benchmarks.loitering results/train` after training `ppo-multi` and `ppo-multi-ending`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np

from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.learned import LearnedPolicy, load_policy
from kinreach.baselines.recipes import MULTI
from kinreach.kinematics.reward_geometry import REACHED_DISTANCE

GOALS = 500


def main() -> None:
    """Print a Markdown table, one row per seed of both recipes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", help="the folder that `kinreach train --out` wrote to")
    runs = Path(parser.parse_args().runs)
    print("| recipe, seed | reached, % | came within 10 mm, % | steps waited there | r_e meanwhile, median |")
    print("|---|---|---|---|---|")
    for recipe in ("ppo-multi-ending", "ppo-multi"):
        for folder in sorted((runs / recipe).glob("seed-*")):
            reached, near, waited, error = watch(load_policy(folder / "policy.safetensors", environment=MULTI))
            print(f"| `{recipe}`, {folder.name[5:]} | {reached:.1f} | {near:.1f} | {waited:.1f} | {error:.3f} |")


def watch(policy: LearnedPolicy) -> tuple[float, float, float, float]:
    """Shares [%] of goals reached and come near to, mean steps near but not reached, median r_e in those."""
    env = gym.make_vec(MULTI, num_envs=GOALS, vectorization_mode="vector_entry_point", backend="kinematic")
    observations, _ = env.reset(seed=HELD_OUT)
    live, reached, near = np.ones(GOALS, bool), np.zeros(GOALS, bool), np.zeros(GOALS, bool)
    errors = []
    while live.any():
        observations, _, terminated, truncated, info = env.step(policy.act(observations))
        beside = live & (info["distance"] < REACHED_DISTANCE)
        errors.append(info["posture_error"][beside & ~info["reached"]])
        near |= beside
        reached |= live & info["reached"]
        live &= ~(terminated | truncated)
    waits = np.concatenate(errors)
    return 100 * reached.mean(), 100 * near.mean(), len(waits) / GOALS, float(np.median(waits))


if __name__ == "__main__":
    main()

"""Where policies for the button end when they do not press: which quadrants, how far away, which joint at a limit.

python -m kinreach.train button-report --seeds 5
python -m benchmarks.studies.button_failures results/train/button-report/seed-*/policy.safetensors
"""

from __future__ import annotations

import argparse
from contextlib import closing
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401  registers the environments
from kinreach.baselines.evaluation import HELD_OUT
from kinreach.baselines.policies import LearnedPolicy, load_policy
from kinreach.cli import Parser, finish
from kinreach.kinematics import Arm3Kinematics
from kinreach.registration import BUTTON

PROG = "python -m benchmarks.studies.button_failures"

HEADINGS = (
    "policy", "pressed, %: target at −x −y / −x +y / +x −y / +x +y", "not pressed: distance, mm, median",
    "not pressed: joint 1 / 2 / 3 at a limit, %",
)  # fmt: skip
#: Nearer to its limit than this a joint counts as being there [rad].
AT_LIMIT = 0.05


def last_observations(policy: LearnedPolicy, episodes: int) -> tuple[np.ndarray, np.ndarray]:
    """What was observed last, shape (episodes, 19), and whether the button was pressed, shape (episodes,)."""
    env: Any = gym.make_vec(
        BUTTON, num_envs=episodes, vectorization_mode="vector_entry_point", **policy.card.recipe["options"]
    )
    pressed, pending = np.zeros(episodes, dtype=bool), np.ones(episodes, dtype=bool)
    with closing(env):
        observations, _ = env.reset(seed=HELD_OUT)
        last = np.array(observations)
        while pending.any():
            observations, _, terminated, truncated, info = env.step(policy.act(observations))
            over = terminated | truncated
            seen = np.array(observations)
            if over.any():
                seen[over] = np.stack(info["final_obs"][over])
            last[pending] = seen[pending]
            pressed |= terminated & pending
            pending &= ~over
    return last, pressed


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each policy."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", metavar="POLICY")
    parser.add_argument("--goals", type=int, default=1000)
    arguments = parser.parse_args(argv)
    kinematics = Arm3Kinematics()
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
    for name in arguments.policies:
        policy = load_policy(name)
        last, pressed = last_observations(policy, arguments.goals)
        quadrants = 2 * (last[:, 6] > 0) + (last[:, 7] > 0)
        shares = " / ".join(f"{100 * pressed[quadrants == number].mean():.0f}" for number in range(4))
        missed = last[~pressed]
        q = np.arctan2(missed[:, 3:6], missed[:, :3])
        room = np.minimum(np.abs(q - kinematics.lower), np.abs(q - kinematics.upper))
        distance = "-" if pressed.all() else f"{1e3 * np.median(np.linalg.norm(missed[:, 15:18], axis=1)):.0f}"
        limits = "-" if pressed.all() else " / ".join(f"{100 * share:.0f}" for share in (room < AT_LIMIT).mean(axis=0))
        print(
            f"| `{policy.card.recipe['name']}`, seed {policy.card.seed} | {shares} | {distance} | {limits} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

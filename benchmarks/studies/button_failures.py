"""Where policies for the button end when they do not press: which quadrants, how far away, which joint at a limit.

python -m kinreach.train button-report --seeds 5
python -m benchmarks.studies.button_failures results/train/button-report/seed-*/policy.safetensors
"""

from __future__ import annotations

import argparse
from contextlib import closing

import numpy as np

import kinreach  # noqa: F401  registers the environments
from benchmarks.studies.tables import head, line
from kinreach._registration import BUTTON
from kinreach.baselines._batch import make_batch
from kinreach.baselines._evaluation import HELD_OUT
from kinreach.baselines._loop import rollout_batch
from kinreach.baselines._policies import load_policy
from kinreach.cli import Parser, finish
from kinreach.kinematics import Arm3Kinematics

PROG = "python -m benchmarks.studies.button_failures"

HEADINGS = (
    "policy", "pressed, %: target at −x −y / −x +y / +x −y / +x +y", "not pressed: distance, mm, median",
    "not pressed: joint 1 / 2 / 3 at a limit, %",
)  # fmt: skip
#: Nearer to its limit than this a joint counts as being there [rad].
AT_LIMIT = 0.05


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table, a row for each policy."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", metavar="POLICY")
    parser.add_argument("--goals", type=int, default=1000)
    arguments = parser.parse_args(argv)
    kinematics = Arm3Kinematics()
    print(head(*HEADINGS))
    for path in arguments.policies:
        policy = load_policy(path)
        with closing(make_batch(BUTTON, arguments.goals, policy.card.recipe["options"])) as env:
            trials = rollout_batch(env, policy, seed=HELD_OUT)
        pressed = np.array([trial["reached"] for trial in trials])
        goals = np.array([trial["goal"] for trial in trials])
        quadrants = 2 * (goals[:, 0] > 0) + (goals[:, 1] > 0)
        found = [pressed[quadrants == number] for number in range(4)]
        shares = " / ".join(f"{100 * there.mean():.0f}" if there.size else "-" for there in found)
        missed = [trial for trial in trials if not trial["reached"]]
        distance = limits = "-"
        if missed:
            q = np.array([trial["q"] for trial in missed])
            turned = (q + np.pi) % (2 * np.pi) - np.pi
            room = np.minimum(np.abs(turned - kinematics.lower), np.abs(turned - kinematics.upper))
            distance = f"{1e3 * np.median([trial['distance'] for trial in missed]):.0f}"
            limits = " / ".join(f"{100 * share:.0f}" for share in (room < AT_LIMIT).mean(axis=0))
        name = f"`{policy.card.recipe['name']}`, seed {policy.card.seed}"
        print(line(name, shares, distance, limits), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

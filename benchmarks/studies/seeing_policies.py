"""What the package's policies do with goals that they are told, and with goals that they see, by both pipelines.

    python -m benchmarks.studies.seeing_policies [--goals 200] [--engine ray]

MuJoCo's dynamics, held-out goals of each policy's task, both cameras at 640x360; of a policy that sees the pictures
themselves those of the size that it learned from. Left out are policies of tasks in which no camera looks for a ball
at rest.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.studies.parts import each
from benchmarks.studies.tables import head, line, share
from kinreach._jobs import add_options
from kinreach._registration import MULTI, SINGLE, SPACE
from kinreach._statistics import median, p95
from kinreach.baselines._evaluation import evaluate
from kinreach.baselines._policies import LearnedPolicy, load_policy, pretrained_names
from kinreach.cli import Parser, finish
from kinreach.robots import get_arm
from kinreach.vision._ball_finder import PIPELINES

PROG = "python -m benchmarks.studies.seeing_policies"

PICTURES = "pictures"
#: How a policy comes to know the goal, and the options of the environment for it.
SIGHTS: Mapping[str, Mapping[str, str]] = {
    "told": {},
    **{f"seen, {pipeline}": {"observation": "camera", "pipeline": pipeline} for pipeline in PIPELINES},
    PICTURES: {"observation": "pixels"},
}
HEADINGS = ("policy", "the goal is", "found by both cameras, %", "reached, % [95 % CI]", "median / p95, mm")


def sights(policy: LearnedPolicy) -> Sequence[str]:
    """In which of the `SIGHTS` a policy can act; none where no camera looks for a ball at rest."""
    reaches = policy.card.environment in (SINGLE, MULTI, SPACE)
    if not reaches or not get_arm(policy.arm or "ur5-thesis").goal_cameras:
        return []
    return [sight for sight in SIGHTS if (sight == PICTURES) == bool(policy.network.eyes)]


def row(name: str, sight: str, goals: int) -> str:
    """A row of the table, as Markdown."""
    found = evaluate(load_policy(name), goals=goals, options={"backend": "mujoco", **SIGHTS[sight]})
    both = 100 * np.mean([np.all(trial["ball_found"]) for trial in found.trials])
    mm = 1e3 * found.measures["distance"]
    seen = f"{both:.1f}" if sight.startswith("seen") else "-"
    reached = share(int(found.reached.sum()), goals)
    return line(f"`{name}`", sight, seen, reached, f"{median(mm):.2f} / {p95(mm):.2f}")


def main(argv: list[str] | None = None) -> int:
    """Print the table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=200)
    add_options(parser)
    arguments = parser.parse_args(argv)
    if arguments.goals < 1:
        parser.error(f"--goals must be at least 1, got {arguments.goals}")
    parts = [(name, sight, arguments.goals) for name in pretrained_names() for sight in sights(load_policy(name))]
    print(head(*HEADINGS))
    for found in each(arguments, row, parts):
        print(found, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

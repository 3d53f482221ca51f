"""How exactly an arm with friction, damping, an unknown load or noisy encoders stops, and what that costs.

    python -m benchmarks.studies.imperfect_arms [--goals 200] [--step 1] [--engine ray]

The closed form's postures are executed in two phases, as the thesis does; `ranked-single` and `ranked-multi` are the
package's policies. A small step is one of 1 degree in every joint, or of `--step` degrees, from the postures in which
the arm stands then.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping

import numpy as np

from benchmarks.studies.parts import each
from benchmarks.studies.tables import head, line, share
from kinreach._jobs import add_options
from kinreach._statistics import median
from kinreach.baselines._evaluation import HELD_OUT, evaluate
from kinreach.baselines._policies import load_policy
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.sim._simulation import BatchSimulation
from kinreach.thesis import REACHED_POSTURE_ERROR, posture_error, reach_reward

PROG = "python -m benchmarks.studies.imperfect_arms"

ARMS: Mapping[str, Mapping[str, float]] = {
    "ideal": {},
    "friction 2 %": {"friction": 0.02},
    "friction 5 %": {"friction": 0.05},
    "friction 10 %": {"friction": 0.1},
    "damping 5 % at 1 rad/s": {"damping": 0.05},
    "0.5 kg too many": {"payload": 0.5},
    "2 kg too many": {"payload": 2.0},
    "encoders 0.1 mrad": {"encoder_noise": 1e-4},
    "friction 5 %, damping 5 %, 0.5 kg, 0.1 mrad": {
        "friction": 0.05, "damping": 0.05, "payload": 0.5, "encoder_noise": 1e-4,
    },
}  # fmt: skip
POLICIES = ("ranked-single", "ranked-multi")
HEADINGS = (
    "arm",
    "joint error, mrad: median / worst",
    "tip off by, mm: median / worst",
    "step of {:g}° off by, %: median / worst",
    "reached, % [95 % CI]: closed form",
    *POLICIES,
)


def answers(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Held-out goals [m], shape (count, 3), and a natural posture of the closed form for each [rad], (count, 6)."""
    kin, collision = URKinematics("ur5-thesis", tip="tcp", base="world"), CollisionChecker("ur5-thesis")
    goals = kin.arm.workcell.draw_goals(np.random.default_rng(HELD_OUT), count)

    def natural(q: np.ndarray) -> bool:
        return posture_error(q) < REACHED_POSTURE_ERROR and not collision.free(q)

    home = np.array(kin.arm.home)
    return goals, np.array([kin.axis_goal(goal, (0.0, 0.0, -1.0), seed=home, accept=natural).q for goal in goals])


def row(name: str, goals: np.ndarray, postures: np.ndarray, step: float) -> str:
    """A row of the table, as Markdown, with a small step of so much [rad]."""
    flaws, everyone = ARMS[name], np.arange(len(goals))
    arms = BatchSimulation("ur5-thesis", len(goals), imperfections=flaws)
    moves = arms.move(everyone, postures)
    off = np.linalg.norm(arms.tip_positions - goals, axis=1)
    stuck = np.array([not move.reached for move in moves])
    reached = reach_reward(off, arms.q, impossible=stuck).reached
    errors = np.array([move.error for move in moves])
    start = arms.q
    change = step * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])  # upwards
    arms.move(everyone, start + change, two_phase=False)
    short = np.abs((arms.q - start) / change - 1.0).max(axis=1)
    options = {"backend": "mujoco", "imperfections": dict(flaws)}
    found = [evaluate(load_policy(policy), goals=len(goals), options=options).reached for policy in POLICIES]
    cells = (
        name,
        f"{1e3 * median(errors):.2f} / {1e3 * errors.max():.2f}",
        f"{1e3 * median(off):.2f} / {1e3 * off.max():.2f}",
        f"{100 * median(short):.1f} / {100 * short.max():.1f}",
        *(share(int(one.sum()), len(goals)) for one in (reached, *found)),
    )
    return line(*cells)


def main(argv: list[str] | None = None) -> int:
    """Print the table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--goals", type=int, default=200)
    parser.add_argument("--step", type=float, default=1.0, help="degrees")
    add_options(parser)
    arguments = parser.parse_args(argv)
    if arguments.goals < 1:
        parser.error(f"--goals must be at least 1, got {arguments.goals}")
    if not 0.1 <= arguments.step <= 5.0:
        parser.error(f"--step must be between 0.1 and 5 degrees, got {arguments.step:g}")
    answered = answers(arguments.goals)
    print(head(*(heading.format(arguments.step) for heading in HEADINGS)))
    for found in each(arguments, row, [(name, *answered, math.radians(arguments.step)) for name in ARMS]):
        print(found, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

"""Whether it matters that the shoulder moves last, as in the thesis's single-step, or all joints at once.

    python -m benchmarks.studies.joint_order

Moves from home under dynamics: to natural postures that reach a ball, to answers of `thesis-ppo-single` that explore,
and to random possible postures with the tip low over the table.
"""

from __future__ import annotations

import argparse
import math

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach._registration import SINGLE
from kinreach.baselines import load_policy
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.sim import ArmSimulation
from kinreach.thesis import REACHED_POSTURE_ERROR, posture_error

PROG = "python -m benchmarks.studies.joint_order"
#: Standard deviation of an answer that explores [rad]; where a tip is low over the table [m].
EXPLORING, LOW, IN_FRONT = 0.05, -0.08, 0.2


def targets(count: int) -> dict[str, Floats]:
    """Possible postures to move to [rad], by what they are, each of shape (n, 6) with n at most `count`."""
    kinematics, checker, rng = (
        URKinematics("ur5-thesis", tip="tcp", base="world"),
        CollisionChecker("ur5-thesis"),
        np.random.default_rng(0),
    )
    natural = []
    for goal in kinematics.arm.workcell.draw_goals(rng, count):
        found = kinematics.axis_solutions(goal, (0.0, 0.0, -1.0), seed=np.array(kinematics.arm.home)).q
        natural.append(found[posture_error(found) < REACHED_POSTURE_ERROR])
    policy, env, answers = load_policy("thesis-ppo-single"), gym.make(SINGLE, backend="kinematic", dtype="float64"), []
    for seed in range(count):
        observation, _ = env.reset(seed=seed)
        answers.append(math.pi * policy.act(observation) + EXPLORING * rng.normal(size=6))
    drawn = rng.uniform(-math.pi, math.pi, (1000 * count, 6))
    tips = kinematics.positions(drawn)
    low = drawn[(tips[:, 2] < LOW) & (tips[:, 0] > IN_FRONT)]
    named = {
        "natural, at a ball": np.concatenate(natural),
        "answers that explore": np.clip(np.array(answers), -math.pi, math.pi),
        "random, low over the table": low,
    }
    return {name: q[~checker.impossible(q)][:count] for name, q in named.items()}


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=60, help="of each kind (default: %(default)s)")
    count = check_count("--moves", parser.parse_args(argv).moves)
    simulation = ArmSimulation("ur5-thesis")
    home = np.array(simulation.arm.home)
    print(head("to", "moves", "executed, shoulder last", "executed, all at once", "the same in both"))
    for name, postures in targets(count).items():
        done = np.zeros((2, len(postures)), dtype=bool)
        for row, last in enumerate((True, False)):
            for index, q in enumerate(postures):
                simulation.reset(home)
                done[row, index] = simulation.move(q, two_phase=last).reached
        print(line(name, len(postures), *done.sum(axis=1), int((done[0] == done[1]).sum())), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

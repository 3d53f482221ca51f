"""Whether the thesis's reward has local optima: hill-climbing on it, with the distance alone and with the posture.

    python -m benchmarks.studies.local_optima

An arm changes all joints at random and keeps a change that is paid more; where none is for a while, changes become
smaller. It starts in random possible postures, one ball for all, and at home, one ball each. "Held" is a posture that
ends short of the ball with something impossible within half a degree that would be nearer.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach._checks import Floats, check_count
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.thesis import distance_reward, reach_reward

PROG = "python -m benchmarks.studies.local_optima"
#: The ball of all random postures [m]; within this the tip is at the ball [m].
BALL, NEAR = np.array([0.45, -0.1, -0.175]), 0.01
#: Standard deviation of the first changes and of the last [rad]; changes without a gain after which it is halved.
FIRST, LAST, PATIENCE = math.radians(4.0), 2e-5, 150
#: Changes around a posture that ended short of the ball, and their standard deviation [rad].
PROBES, NEARBY = 200, math.radians(0.5)


class Climber:
    """Climbs the reward from postures [rad], shape (n, 6), to balls [m], shape (n, 3)."""

    def __init__(self, *, posture: bool) -> None:
        self._kinematics, self._checker, self._posture = (
            URKinematics("ur5-thesis", tip="tcp", base="world"),
            CollisionChecker("ur5-thesis"),
            posture,
        )

    def paid(self, q: Floats, balls: Floats) -> tuple[Floats, Floats]:
        """Rewards and distances [m], each of shape (n,)."""
        d = np.linalg.norm(self._kinematics.positions(q) - balls, axis=1)
        impossible = self._checker.impossible(q)
        if self._posture:
            return np.asarray(reach_reward(d, q, impossible=impossible).reward), d
        return np.where(impossible, -100.0, np.where(d < NEAR, 10.0, distance_reward(np.maximum(d, 1e-6)))), d

    def climb(self, q: Floats, balls: Floats, steps: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """Postures in which it ends, and distances [m]."""
        q = q.copy()
        paid, d = self.paid(q, balls)
        size, failed = np.full(len(q), FIRST), np.zeros(len(q))
        for _ in range(steps):
            scale = size[:, None] * rng.choice([0.1, 0.3, 1.0], size=(len(q), 1))
            tried = q + scale * rng.normal(size=q.shape)
            gain, distance = self.paid(tried, balls)
            better = gain > paid
            q[better], paid[better], d[better] = tried[better], gain[better], distance[better]
            failed = np.where(better, 0, failed + 1)
            size = np.where(failed > PATIENCE, np.maximum(size / 2, LAST), size)
            failed = np.where(failed > PATIENCE, 0, failed)
        return q, d

    def held(self, q: Floats, balls: Floats, rng: np.random.Generator) -> int:
        """How many of these postures have something impossible nearby that would be nearer to the ball."""
        count = 0
        for posture, ball in zip(q, balls, strict=True):
            around = posture + NEARBY * rng.normal(size=(PROBES, 6))
            d = np.linalg.norm(self._kinematics.positions(around) - ball, axis=1)
            nearer = around[d < np.linalg.norm(self._kinematics.positions(posture[None])[0] - ball)]
            count += bool(len(nearer) and self._checker.impossible(nearer).any())
        return count


def main(argv: list[str] | None = None) -> int:
    """Print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--postures", type=int, default=300, help="random ones (default: %(default)s)")
    parser.add_argument("--balls", type=int, default=40, help="from home (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=3000, help="changes that are tried (default: %(default)s)")
    arguments = parser.parse_args(argv)
    postures, balls = check_count("--postures", arguments.postures), check_count("--balls", arguments.balls)
    steps = check_count("--steps", arguments.steps)
    arm = URKinematics("ur5-thesis", tip="tcp", base="world").arm
    checker = CollisionChecker("ur5-thesis")
    rng = np.random.default_rng(0)
    drawn = rng.uniform(-math.pi, math.pi, (20 * postures, 6))
    random = drawn[~checker.impossible(drawn)][:postures]
    goals = arm.workcell.draw_goals(np.random.default_rng(5), balls)
    print(head("from", "reward", "postures", "at the ball", "reached", "short of it", "held"))
    for start, q, points in (
        ("random postures", random, np.tile(BALL, (len(random), 1))),
        ("home", np.tile(np.array(arm.home), (balls, 1)), goals),
    ):
        for reward, posture in (("distance", False), ("with the posture", True)):
            climber = Climber(posture=posture)
            ends, d = climber.climb(q, points, steps, rng)
            short = d >= NEAR
            reached = int(np.sum(reach_reward(d, ends).reached))
            held = climber.held(ends[short], points[short], rng)
            print(line(start, reward, len(q), int((~short).sum()), reached, int(short.sum()), held), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

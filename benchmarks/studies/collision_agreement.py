"""How often a simulated move ends as the kinematic verdict on its target says.

    python -m benchmarks.studies.collision_agreement [--moves 300] [--seed 0]

Classes of postures: uniform in [-pi, pi]^6, and near solutions: closed-form postures, tool down, at goals of the work
cell, on either natural branch, plus Gaussian noise. The verdict is `CollisionChecker.impossible`. Moves are two-phase
moves from home in MuJoCo with full dynamics. One that ends off a free target was blocked on the way.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker, UR5Kinematics
from kinreach.sim.simulation import ArmSimulation
from kinreach.thesis.reward import posture_error

PROG = "python -m benchmarks.studies.collision_agreement"

NOISES = (0.02, 0.05, 0.1, 0.2)


def near_solutions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Tool-down postures at random goals, both natural branches in turn, any angle about the tool, shape (count, 6)."""
    kin = UR5Kinematics(tip="tcp", base="world")
    found: list[np.ndarray] = []
    while len(found) < count:
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        T[:3, 3] = kin.arm.workcell.goals.sample(rng, 1)[0]
        angle = rng.uniform(-np.pi, np.pi)
        T[:2, :2] = [[np.cos(angle), np.sin(angle)], [np.sin(angle), -np.cos(angle)]]
        found += [q for q in kin.all_solutions(T).q if posture_error(q) < 1e-6]
    return np.array(found[:count])


def classes(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Postures of every class by its name, each of shape (count, 6)."""
    solutions = near_solutions(rng, count)
    near = {f"near, noise {s:g} rad": solutions + s * rng.standard_normal(solutions.shape) for s in NOISES}
    return {**near, "random": rng.uniform(-np.pi, np.pi, (count, 6))}


def row(name: str, q: np.ndarray, checker: CollisionChecker, simulation: ArmSimulation) -> str:
    """A row of the table, as Markdown."""
    attained = []
    for target in q:
        simulation.reset()
        attained.append(simulation.move(target).reached)
    done, impossible = np.array(attained), checker.impossible(q)
    rates = (impossible, impossible != done, ~impossible & ~done, impossible & done)
    return line(name, len(q), *(f"{100 * rate.mean():.2f} %" for rate in rates))


def main(argv: list[str] | None = None) -> int:
    """Measure and print a Markdown table."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--moves", type=int, default=300, help="per class")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    checker, simulation = CollisionChecker("ur5"), ArmSimulation("ur5")
    columns = ("count", "impossible", "agreement", "free, blocked on the way", "impossible, attained")
    print(head("moves from home", *columns))
    for name, q in classes(np.random.default_rng(args.seed), args.moves).items():
        print(row(name, q, checker, simulation), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

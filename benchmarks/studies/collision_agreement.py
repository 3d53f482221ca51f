"""How often `FastCollision` gives the verdict of the exact meshes, and of a simulated move; and how fast it is.

    python -m benchmarks.studies.collision_agreement [--postures 2000] [--seed 0] [--moves 300]

Classes of postures: uniform in [-pi, pi]^6, and near solutions: closed-form postures, tool down, at goals of the work
cell, on either natural branch, plus Gaussian noise. The oracle is `CollisionChecker` (convex hulls, which agree with
MuJoCo's contacts in every posture tried) together with the joint limits. Rates are shares of all postures of a class.

Moves are two-phase moves from home in MuJoCo with full dynamics. One that ends off its target although the oracle finds
the target free was blocked on the way (a part of those that were judged free and not attained).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.studies.tables import head, line
from kinreach.cli import Parser, finish
from kinreach.kinematics import UR5Kinematics
from kinreach.kinematics.collision import CollisionChecker
from kinreach.kinematics.fast_collision import FastCollision
from kinreach.sim.simulation import ArmSimulation
from kinreach.thesis.reward import posture_error

PROG = "python -m benchmarks.studies.collision_agreement"

NOISES = (0.02, 0.05, 0.1, 0.2)
BATCH = 4096


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


def exact(checker: CollisionChecker, kin: UR5Kinematics, q: np.ndarray) -> np.ndarray:
    """Which postures are outside the limits or collide, by the meshes, shape (n,)."""
    return np.array([not kin.within_limits(row) or checker.in_collision(row) for row in q])


def best_ns(jobs: dict[str, Callable[[], object]], rounds: int = 30) -> dict[str, float]:
    """Best CPU time of each job per posture of a batch [ns], over interleaved rounds."""
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(rounds):
        for name, job in jobs.items():
            start = time.process_time()
            for _ in range(5):
                job()
            best[name] = min(best[name], (time.process_time() - start) / 5 / BATCH * 1e9)
    return best


def percent(part: np.ndarray) -> str:
    """A share as text."""
    return f"{100 * part.mean():.2f} %"


def report_postures(groups: dict[str, np.ndarray], fast: FastCollision) -> None:
    """Print the agreement for every class."""
    checker, kin = CollisionChecker("ur5"), UR5Kinematics(tip="tcp", base="world")
    print(head("postures", "count", "impossible", "agreement", "false free", "false collision"))
    for name, q in groups.items():
        truth, verdict = exact(checker, kin, q), fast.impossible(q)
        rates = (truth, truth == verdict, truth & ~verdict, verdict & ~truth)
        print(line(name, len(q), *map(percent, rates)), flush=True)


def report_speed(groups: dict[str, np.ndarray], fast: FastCollision) -> None:
    """Print the speed beside what else is computed for a batch, in one run."""
    kin = UR5Kinematics(tip="tcp", base="world")
    batches = {name: np.clip(np.resize(q, (BATCH, 6)), kin.lower, kin.upper) for name, q in groups.items()}
    near = next(iter(batches.values()))
    numbers, T = np.ones(BATCH), kin.fk(near)
    jobs: dict[str, Callable[[], object]] = {
        "numpy, a * b + c": lambda: numbers * numbers + numbers,
        "UR5Kinematics.fk": lambda: kin.fk(near),
        "UR5Kinematics.batch": lambda: kin.batch(T),
    }
    for name, q in batches.items():
        jobs[f"FastCollision.impossible, {name}"] = lambda q=q: fast.impossible(q)  # type: ignore[misc]
    times = best_ns(jobs)
    print(f"\n{head(f'one core, N = {BATCH}', 'ns per posture', 'multiply-adds')}")
    for name, ns in times.items():
        print(line(name, f"{ns:.1f}", f"{ns / times['numpy, a * b + c']:.0f}"))


def report_moves(groups: dict[str, np.ndarray], fast: FastCollision, count: int) -> None:
    """Print how often a simulated move ends as the kinematic verdict says."""
    checker, kin, simulation = CollisionChecker("ur5"), UR5Kinematics(tip="tcp", base="world"), ArmSimulation("ur5")
    columns = ("agreement", "free, not attained", "blocked on the way", "in collision, attained")
    print(f"\n{head('moves from home', 'count', *columns)}")
    for name, q in groups.items():
        attained = []
        for row in q[:count]:
            simulation.reset()
            attained.append(simulation.move(row).reached)
        done, verdict, truth = np.array(attained), fast.impossible(q[:count]), exact(checker, kin, q[:count])
        missed = ~verdict & ~done
        rates = (verdict != done, missed, missed & ~truth, verdict & done)
        print(line(name, len(done), *map(percent, rates)), flush=True)


def main(argv: list[str] | None = None) -> int:
    """Measure and print Markdown tables."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--postures", type=int, default=2000, help="per class")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--moves", type=int, default=300, help="simulated moves per class, at most --postures")
    args = parser.parse_args(argv)
    groups = classes(np.random.default_rng(args.seed), args.postures)
    fast = FastCollision("ur5")
    report_postures(groups, fast)
    report_speed(groups, fast)
    report_moves(groups, fast, args.moves)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

"""Whether `CollisionChecker`, which environments and solvers ask, agrees with MuJoCo: contacts of postures, and moves.

    python -m benchmarks.studies.collision_agreement [--postures 20000] [--edges 5000] [--moves 300] [--seed 0]

Contacts: uniform postures within the limits of four arms, and postures at the edge of a collision, half on either side
of it; counted are those in which MuJoCo finds a contact and the checker none, or the other way round, and those whose
verdict is another in a batch than alone.

Moves: two-phase moves of a UR5 from home in MuJoCo with full dynamics, to postures uniform in [-pi, pi]^6, and near
solutions: closed-form postures, tool down, at goals of the work cell, on either natural branch, plus Gaussian noise. A
move that ends off a free target was blocked on the way.
"""

from __future__ import annotations

import argparse

import mujoco
import numpy as np

from benchmarks.studies.tables import head, line
from kinreach.cli import Parser, finish
from kinreach.kinematics import CollisionChecker, URKinematics
from kinreach.robots import get_arm
from kinreach.sim._scene import build_scene
from kinreach.sim._simulation import ArmSimulation
from kinreach.thesis import posture_error

PROG = "python -m benchmarks.studies.collision_agreement"

ARMS = ("ur3-thesis", "ur5-thesis", "ur10-thesis", "panda")
#: Halvings of the way from a free posture to one in collision.
HALVINGS = 12
NOISES = (0.02, 0.05, 0.1, 0.2)


def near_solutions(rng: np.random.Generator, count: int) -> np.ndarray:
    """Tool-down postures at random goals, both natural branches in turn, any angle about the tool, shape (count, 6)."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
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


def uniform(checker: CollisionChecker, rng: np.random.Generator, count: int) -> np.ndarray:
    """Postures within the limits, shape (count, n)."""
    kin = checker.kinematics
    return rng.uniform(kin.lower, kin.upper, (count, kin.n))


def edges(checker: CollisionChecker, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Free postures and, some 1e-4 rad from each, one in collision, each of shape (count, n)."""
    free, hit = np.empty((2, 0, checker.kinematics.n))
    while len(free) < count:
        start = uniform(checker, rng, count)
        end = np.clip(start + rng.normal(0.0, 0.3, start.shape), checker.kinematics.lower, checker.kinematics.upper)
        rows = ~checker.impossible(start) & checker.impossible(end)
        free, hit = np.concatenate([free, start[rows]]), np.concatenate([hit, end[rows]])
    free, hit = free[:count], hit[:count]
    for _ in range(HALVINGS):
        middle = (free + hit) / 2
        inside = checker.impossible(middle)[:, None]
        free, hit = np.where(inside, free, middle), np.where(inside, middle, hit)
    return free, hit


def contacts(arm: str, q: np.ndarray) -> np.ndarray:
    """In which postures MuJoCo finds a contact, shape (m,)."""
    model = build_scene(get_arm(arm), visual=False).compile()
    data, held = mujoco.MjData(model), model.key("home").qpos[q.shape[1] :]
    found = []
    for posture in q:
        data.qpos[:] = [*posture, *held]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found.append(data.ncon > 0)
    return np.array(found)


def contact_row(arm: str, kind: str, q: np.ndarray, checker: CollisionChecker) -> str:
    """A row of the first table, as Markdown."""
    together, alone = checker.impossible(q), np.array([checker.in_collision(posture) for posture in q])
    other = (together != alone, alone != contacts(arm, q))
    return line(arm, kind, len(q), f"{100 * alone.mean():.1f} %", *(int(differs.sum()) for differs in other))


def move_row(name: str, q: np.ndarray, checker: CollisionChecker, simulation: ArmSimulation) -> str:
    """A row of the second table, as Markdown."""
    attained = []
    for target in q:
        simulation.reset()
        attained.append(simulation.move(target).reached)
    done, impossible = np.array(attained), checker.impossible(q)
    rates = (impossible, impossible != done, ~impossible & ~done, impossible & done)
    return line(name, len(q), *(f"{100 * rate.mean():.2f} %" for rate in rates))


def main(argv: list[str] | None = None) -> int:
    """Measure and print Markdown tables."""
    parser = Parser(prog=PROG, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--postures", type=int, default=20_000, help="uniform postures of each arm")
    parser.add_argument("--edges", type=int, default=5_000, help="postures of each arm at the edge of a collision")
    parser.add_argument("--moves", type=int, default=300, help="per class")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    print(head("arm", "postures", "count", "in collision", "another verdict in a batch", "another in MuJoCo"))
    for arm in ARMS:
        judge, rng = CollisionChecker(arm), np.random.default_rng(args.seed)
        for kind, q in (
            ("uniform", uniform(judge, rng, args.postures)),
            ("at the edge", np.concatenate(edges(judge, rng, args.edges // 2))),
        ):
            print(contact_row(arm, kind, q, judge), flush=True)
    checker, simulation = CollisionChecker("ur5-thesis"), ArmSimulation("ur5-thesis")
    columns = ("count", "impossible", "agreement", "free, blocked on the way", "impossible, attained")
    print(f"\n{head('moves from home', *columns)}")
    for name, q in classes(np.random.default_rng(args.seed), args.moves).items():
        print(move_row(name, q, checker, simulation), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(finish(main, prog=PROG))

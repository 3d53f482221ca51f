"""What threads and processes are given to do: a job makes its own tools and gives back numbers, the same every time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

import kinreach  # noqa: F401 (registers the environments)
from kinreach.baselines._policies import load_policy
from kinreach.envs._reach.reach_task import TOOL_DOWN
from kinreach.kinematics import Arm3Kinematics, AxisGoal, CollisionChecker, PositionGoal, URKinematics
from kinreach.kinematics._solvers import ClosedFormSolver, LevenbergMarquardtSolver, PlacoSolver, QPSolver
from kinreach.sim._simulation import ArmSimulation, BatchSimulation

SEED = 7
#: Postures or goals that a job looks at.
CASES = 24
#: An instance, and what to do with it.
Job = tuple[Callable[[], Any], Callable[[Any], Sequence[Any]]]


def _kinematics() -> Any:
    return URKinematics("ur5-thesis", tip="tcp", base="world")


def _postures() -> Any:
    return np.random.default_rng(SEED).uniform(-3.0, 3.0, (CASES, 6))


def _goals() -> Any:
    return _kinematics().arm.workcell.goals.sample(np.random.default_rng(SEED), CASES)


def _forward(kin: Any) -> list[Any]:
    return [part for q in _postures() for part in (kin.fk(q), kin.jacobian(q))]


def _inverse(kin: Any) -> list[Any]:
    poses = kin.fk(_postures())
    home = np.array(kin.arm.home)
    one_by_one = [part for T in poses for part in (kin.all_solutions(T).q, kin.nearest(T, home).q)]
    batch = kin.batch(poses)
    return [*one_by_one, np.where(batch.valid[..., None], batch.q, 0.0)]


def _inverse3(kin: Any) -> list[Any]:
    points = np.random.default_rng(SEED).uniform(-0.6, 0.6, (CASES, 3))
    return [kin.all_solutions(point).q for point in points]


def _solve(solver: Any) -> list[Any]:
    home = np.array(solver.kin.arm.home)
    return [solver.solve(AxisGoal(position, TOOL_DOWN), home).q for position in _goals()]


def _solve3(solver: Any) -> list[Any]:
    home = np.array(solver.kin.arm.home)
    points = np.random.default_rng(SEED).uniform(0.15, 0.5, (CASES, 3))
    return [solver.solve(PositionGoal(point), home).q for point in points]


def _check(checker: Any) -> list[Any]:
    alone = [part for q in _postures() for part in (checker.free(q), checker.distance(q).distance)]
    reasons = [np.frombuffer(checker.reason(q).encode(), dtype=np.uint8) for q in _postures()]
    return [*alone, *reasons, checker.causes(_postures())]


def _act(policy: Any) -> list[Any]:
    observations = np.random.default_rng(SEED).uniform(-1.0, 1.0, (CASES, 13))
    return [policy.act(observation) for observation in observations]


def _move(simulation: Any) -> list[Any]:
    found = []
    for target in _postures()[:3]:
        simulation.reset()
        found.append(simulation.move(target).q)
    return found


def _move_batch(simulation: Any) -> list[Any]:
    ids = np.arange(simulation.count)
    simulation.reset(ids)
    return [move.q for move in simulation.move(ids, _postures()[: simulation.count])]


def _play(env: Any) -> list[Any]:
    """A few steps of an environment, single or a batch."""
    env.action_space.seed(SEED)
    found = [env.reset(seed=SEED)[0]]
    for _ in range(8):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        found += [observation, reward]
        if np.ndim(reward) == 0 and (terminated or truncated):
            found.append(env.reset()[0])
    return found


def _solver(kind: Any, kinematics: Any) -> Callable[[], Any]:
    return lambda: kind(kinematics())


def _env(name: str, **options: Any) -> Callable[[], Any]:
    return lambda: gym.make(f"kinreach/{name}-v0", **options).unwrapped


def _batch(name: str, **options: Any) -> Callable[[], Any]:
    return lambda: (
        gym.make_vec(f"kinreach/{name}-v0", num_envs=6, vectorization_mode="vector_entry_point", **options).unwrapped
    )


#: By name.
JOBS: dict[str, Job] = {
    "UR5Kinematics, forward": (_kinematics, _forward),
    "UR5Kinematics, inverse": (_kinematics, _inverse),
    "Arm3Kinematics": (lambda: Arm3Kinematics(base="world"), _inverse3),
    "closed form": (_solver(ClosedFormSolver, _kinematics), _solve),
    "lm": (_solver(LevenbergMarquardtSolver, _kinematics), _solve),
    "placo": (_solver(PlacoSolver, _kinematics), _solve),
    "qp": (_solver(QPSolver, _kinematics), _solve),
    "lm, 3-DOF arm": (_solver(LevenbergMarquardtSolver, lambda: Arm3Kinematics(base="world")), _solve3),
    "CollisionChecker": (lambda: CollisionChecker("ur5-thesis"), _check),
    "LearnedPolicy": (lambda: load_policy("ranked-single"), _act),
    "ArmSimulation": (lambda: ArmSimulation("ur5-thesis"), _move),
    "BatchSimulation": (lambda: BatchSimulation("ur5-thesis", 6), _move_batch),
    "UR5SingleStep, kinematic": (_env("UR5SingleStep", backend="kinematic"), _play),
    "UR5MultiStep, dynamics": (_env("UR5MultiStep", backend="mujoco"), _play),
    "ButtonPress": (_env("ButtonPress"), _play),
    "UR5MultiStep, batch": (_batch("UR5MultiStep", backend="kinematic"), _play),
    "ButtonPress, batch": (_batch("ButtonPress"), _play),
}
#: What threads may share; of everything else each has its own.
SHARED = (
    "UR5Kinematics, forward",
    "UR5Kinematics, inverse",
    "Arm3Kinematics",
    "closed form",
    "lm",
    "placo",
    "qp",
    "lm, 3-DOF arm",
    "CollisionChecker",
    "LearnedPolicy",
)
#: What holds threads of MuJoCo's, and is made anew by every process.
UNPICKLED = ("BatchSimulation", "UR5MultiStep, batch", "ButtonPress, batch")

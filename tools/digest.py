"""Digests of a fixed set of results, to be compared between machines, Pythons and versions: `python -m tools.digest`.

Each line names a result and has the SHA-256 of its numbers, once to the last bit and once rounded. `--check` compares
with `tools/digest.txt`, `--check FILE` with what another run has printed into FILE; the exit code is 1 where a rounded
digest differs, or where only one of the two runs has a result. Last bits may differ: numpy, OpenBLAS and the C library
choose their code by the processor. Nothing here needs torch or OpenGL.
"""

from __future__ import annotations

import argparse
import hashlib
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

import kinreach
from kinreach._registration import BUTTON, MULTI, SINGLE
from kinreach.baselines._policies import load_policy
from kinreach.envs._reach.reach_task import TOOL_DOWN
from kinreach.kinematics import Arm3Kinematics, CollisionChecker, URKinematics
from kinreach.kinematics._goals import AxisGoal
from kinreach.kinematics._solvers import LevenbergMarquardtSolver, PlacoSolver, QPSolver
from kinreach.robots import PUBLISHED_CALIBRATIONS, get_arm
from kinreach.sim._scene import scene_model
from kinreach.sim._simulation import ArmSimulation, BatchSimulation
from kinreach.thesis import posture_error

#: What is rounded away before the second digest: metres, radians and rewards to a billionth.
DIGITS = 9
SEED = 20_24
#: Arms that are described: not all there are, so that a new one changes no digest.
ARMS = (
    "arm3", "panda", "ur3", "ur3e", "ur3-thesis", "ur5", "ur5e", "ur5-thesis", "ur7e", "ur8long", "ur10", "ur10e",
    "ur10-thesis", "ur12e", "ur15", "ur16e", "ur18", "ur20", "ur30",
)  # fmt: skip
#: Numbers of an arm's description, and of a MuJoCo model.
DESCRIBED = (
    "home", "workcell", "position_gains", "speed_limit", "acceleration_limit", "armature", "joint_damping", "gripper",
    "cameras",
)  # fmt: skip
PARTS = (
    "actuator_", "body_", "cam_", "dof_", "eq_", "exclude_", "geom_", "jnt_", "light_", "mat_", "site_", "tendon_",
)  # fmt: skip
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")
#: What a run on the machine of the project has printed.
REFERENCE = Path(__file__).with_suffix(".txt")
#: Verdicts that fail a check.
DIFFERENT, MISSING = FAILED = "DIFFERENT", "MISSING"
EXACT, ROUNDED = "same bits", f"same to 1e-{DIGITS}"


def forward() -> Iterator[Any]:
    """Poses of 1000 postures, and their Jacobians."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    for q in _postures(1000):
        yield kin.fk(q)
        yield kin.jacobian(q)


def descriptions() -> Iterator[Any]:
    """Every number that describes an arm, its gripper, cameras and work cell."""
    for name in ARMS:
        arm = get_arm(name)
        yield [float(number) for number in NUMBER.findall(arm.urdf)]
        yield from (list(_numbers(getattr(arm, part))) for part in DESCRIBED)


def scenes() -> Iterator[Any]:
    """The models that MuJoCo gets: bodies, shapes, joints, actuators, cameras, lights, and how they look."""
    for name, visual in (("ur5e", False), ("arm3", True), ("panda", False), ("ur5-thesis", False)):
        model = scene_model(get_arm(name), visual=visual)
        yield from (getattr(model, each) for each in sorted(dir(model)) if each.startswith(PARTS))
        yield [model.opt.timestep, model.opt.integrator, model.opt.cone, model.opt.impratio, *model.opt.gravity]
        yield [float(model.tex_data[part].mean()) for part in np.array_split(np.arange(len(model.tex_data)), 100)]


def family() -> Iterator[Any]:
    """All postures of five poses of every UR, and of those with a published calibration."""
    kinematics = [URKinematics(name) for name in ARMS[2:]]
    kinematics += [
        URKinematics.from_calibration(PUBLISHED_CALIBRATIONS[name], model=name.partition("_")[0])
        for name in sorted(PUBLISHED_CALIBRATIONS)
    ]
    for kin in kinematics:
        for T in kin.fk(_postures(5)):
            found = kin.all_solutions(T)
            yield found.q
            yield found.branch


def closed_form() -> Iterator[Any]:
    """All postures of 500 poses, one by one and as a batch, with their branches."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    poses = kin.fk(_postures(500))
    for T in poses:
        found = kin.all_solutions(T)
        yield found.q
        yield found.branch
    batch = kin.batch(poses)
    yield np.where(batch.valid[..., None], batch.q, 0.0)
    yield batch.valid


def nearest() -> Iterator[Any]:
    """The posture nearest to another one for each of 500 poses, some of them out of reach, and its branch."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    poses = kin.fk(_postures(500))
    poses[::10, :3, 3] += 1.0
    found = kin.nearest_batch(poses, np.roll(_postures(500), 1, axis=0))
    yield np.where(found.success[:, None], found.q, 0.0)
    yield found.branch


def arm3() -> Iterator[Any]:
    """All postures of the 3-DOF arm at 500 positions, and the ones nearest to zero."""
    kin = Arm3Kinematics(base="world")
    rng = np.random.default_rng(SEED)
    positions = rng.uniform(-0.8, 0.8, (500, 3))
    batch = kin.batch(positions)
    yield np.where(batch.valid[..., None], batch.q, 0.0)
    yield batch.valid
    found = kin.nearest_batch(positions, np.zeros(3))
    yield np.where(found.success[:, None], found.q, 0.0)
    yield found.branch


def solvers() -> Iterator[Any]:
    """What the numeric solvers find for 40 goals above the table."""
    kin = URKinematics("ur5-thesis", tip="tcp", base="world")
    home = np.array(kin.arm.home)
    for solver in (LevenbergMarquardtSolver(kin), PlacoSolver(kin), QPSolver(kin)):
        for position in _goals(40):
            found = solver.solve(AxisGoal(position, TOOL_DOWN), home)
            yield found.q
            yield found.success


def collisions() -> Iterator[Any]:
    """Whether 1000 postures are free, and the thesis's error of them."""
    checker = CollisionChecker("ur5-thesis")
    postures = _postures(1000)
    yield np.array([checker.free(q) for q in postures])
    yield posture_error(postures)


def kinematic_reaching() -> Iterator[Any]:
    """400 random steps of a batch of 64 arms without dynamics."""
    yield from _played(MULTI, 64, 400, backend="kinematic")


def dynamic_reaching() -> Iterator[Any]:
    """20 random steps of a batch of 8 arms with dynamics."""
    yield from _played(SINGLE, 8, 20, backend="mujoco")


def button() -> Iterator[Any]:
    """300 random steps of a batch of 32 arms under torque."""
    yield from _played(BUTTON, 32, 300)


def moves() -> Iterator[Any]:
    """10 moves, one by one and as a batch."""
    single, targets = ArmSimulation("ur5-thesis"), _postures(10)
    for target in targets:
        single.reset()
        yield single.move(target).q
    batch = BatchSimulation("ur5-thesis", len(targets))
    yield [move.q for move in batch.move(np.arange(len(targets)), targets)]


def policies() -> Iterator[Any]:
    """What the policies of the package do about 200 observations."""
    rng = np.random.default_rng(SEED)
    for name in ("ranked-single", "ranked-multi", "ppo-single"):
        policy = load_policy(name)
        for observation in rng.uniform(-1, 1, (200, 13)):
            yield policy.act(observation)


RESULTS: dict[str, Callable[[], Iterator[Any]]] = {
    part.__name__: part
    for part in (
        forward, closed_form, nearest, arm3, solvers, collisions, kinematic_reaching, dynamic_reaching, button, moves,
        policies, descriptions, scenes, family,
    )
}  # fmt: skip


def digests(results: Callable[[], Iterator[Any]]) -> tuple[str, str, int]:
    """Of the numbers of some results: the digest to the last bit, the rounded one, and how many numbers there were."""
    exact, rounded, count = hashlib.sha256(), hashlib.sha256(), 0
    for value in results():
        numbers = np.ascontiguousarray(value, dtype=np.float64)
        exact.update(numbers.tobytes())
        rounded.update((np.round(numbers, DIGITS) + 0.0).tobytes())  # + 0.0: no negative zero
        count += numbers.size
    return exact.hexdigest()[:16], rounded.hexdigest()[:16], count


def compare(name: str, found: tuple[str, str, int], known: Mapping[str, Sequence[str]]) -> str:
    """What there is to say about a result beside those of another run.

    Args:
        name: Of the result.
        found: Its digests.
        known: What `read` gives.
    """
    if name not in known:
        return MISSING
    exact, rounded = known[name]
    return EXACT if found[0] == exact else ROUNDED if found[1] == rounded else DIFFERENT


def read(path: Path) -> dict[str, list[str]]:
    """Both digests of every result, by its name, from what a run has printed."""
    rows = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return {row[0]: [*row[1:3], "", ""][:2] for row in rows if row}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the digests; compare them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--check", type=Path, nargs="?", const=REFERENCE, metavar="FILE", help="output of another run to compare with"
    )
    arguments = parser.parse_args(argv)
    known = None if arguments.check is None else read(arguments.check)
    print(f"# kinreach {kinreach.__version__}, Python {platform.python_version()}, numpy {np.__version__}, "
          f"mujoco {mujoco.__version__}, {platform.machine()}")  # fmt: skip
    failed = False
    for name, results in RESULTS.items():
        found = digests(results)
        verdict = "" if known is None else compare(name, found, known)
        failed |= verdict in FAILED
        print(f"{name:20} {found[0]} {found[1]} {found[2]:>9} {verdict}".rstrip(), flush=True)
    for name in sorted((known or {}).keys() - RESULTS.keys()):
        print(f"{name:20} {MISSING} here")
        failed = True
    return int(failed)


def _numbers(value: Any) -> Iterator[float]:
    """The numbers of a value: a number, a dataclass, a mapping or a sequence of such."""
    if isinstance(value, bool | int | float):
        yield float(value)
    elif is_dataclass(value):
        yield from (number for each in fields(value) for number in _numbers(getattr(value, each.name)))
    elif isinstance(value, Mapping):
        yield from (number for key in sorted(value) for number in _numbers(value[key]))
    elif isinstance(value, Sequence) and not isinstance(value, str):
        yield from (number for each in value for number in _numbers(each))


def _postures(count: int) -> Any:
    return np.random.default_rng(SEED).uniform(-np.pi, np.pi, (count, 6))


def _goals(count: int) -> Any:
    return URKinematics("ur5-thesis").arm.workcell.goals.sample(np.random.default_rng(SEED), count)


def _played(name: str, arms: int, steps: int, **options: Any) -> Iterator[Any]:
    env = gym.make_vec(name, num_envs=arms, vectorization_mode="vector_entry_point", dtype="float64", **options)
    env.action_space.seed(SEED)
    yield env.reset(seed=SEED)[0]
    for _ in range(steps):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        yield from (observation, reward, terminated, truncated)
    env.close()


if __name__ == "__main__":
    sys.exit(main())

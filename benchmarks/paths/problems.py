"""Problems: an arm, obstacles, where it starts and the posture that it shall reach, by whichever branch.

Generated ones are of three kinds: a table with objects, a bookshelf, and a cage. Those of MotionBenchMaker for the UR5
come from VAMP's repository, `resources/ur5/problems.tar.bz2`, and its `ur5.urdf` with the meshes beside it.
"""

from __future__ import annotations

import re
import tarfile
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from kinreach.kinematics import ArmKinematics, CollisionChecker, pose_vector
from kinreach.robots import ArmDescription, Obstacle, get_arm

KINDS = ("table", "bookshelf", "cage")
MARGIN = 0.005
START = (0.0, -2.0, 1.6, -1.2, -1.57, 0.0)


class Problem(NamedTuple):
    """One problem.

    Attributes:
        kind: Of which kind.
        index: Number within its kind.
        start, goal: Postures [rad].
        obstacles: What is around the arm, in the world.
    """

    kind: str
    index: int
    start: np.ndarray
    goal: np.ndarray
    obstacles: Sequence[Obstacle]


@cache
def ur5e() -> ArmKinematics:
    """The arm of the generated problems: a UR5e with a parallel gripper."""
    return ArmKinematics.of(get_arm("ur5e").with_tool("gripper"), base="world")


def generated(kind: str) -> Iterator[Problem]:
    """Problems without end, whose start is free, and the goal in at least one of its branches."""
    kin, start = ur5e(), np.array(START)
    for index in count():
        rng = np.random.default_rng([KINDS.index(kind), index])
        while True:
            obstacles, goal = _SCENES[kind](rng)
            solutions = kin.all_solutions(goal)
            if not solutions.success:
                continue
            checker = CollisionChecker(kin, obstacles=obstacles, margin=MARGIN)
            free = [q for q in solutions.q if checker.free(q)]
            if free and checker.free(start):
                yield Problem(kind, index, start, free[0], obstacles)
                break


def _placed(frame: np.ndarray, name: str, size: Sequence[float], xyz: Sequence[float]) -> Obstacle:
    T = frame.copy()
    T[:3, 3] = frame[:3, :3] @ np.asarray(xyz) + frame[:3, 3]
    return Obstacle(name, size, pose_vector(T))


def _frame(rng: np.random.Generator, distance: tuple[float, float], height: tuple[float, float]) -> np.ndarray:
    """In front of the arm, x away from it, within half a right angle to either side."""
    yaw = rng.uniform(-np.pi / 4, np.pi / 4)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, yaw]).as_matrix()
    T[:3, 3] = T[:3, :3] @ [rng.uniform(*distance), 0.0, 0.0] + [0.0, 0.0, rng.uniform(*height)]
    return T


def _tool(frame: np.ndarray, xyz: Sequence[float], approach: Sequence[float], turn: float) -> np.ndarray:
    """A pose of the tool, whose z is along `approach`; both in the frame."""
    z = np.asarray(approach) / np.linalg.norm(approach)
    x = np.cross([0.0, 1.0, 0.0], z)
    R = np.column_stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z])
    T = np.eye(4)
    T[:3, :3] = frame[:3, :3] @ R @ Rotation.from_rotvec([0, 0, turn]).as_matrix()
    T[:3, 3] = frame[:3, :3] @ np.asarray(xyz) + frame[:3, 3]
    return T


def _floor() -> Obstacle:
    return Obstacle("floor", (3.0, 3.0, 0.1), (0.0, 0.0, -0.06, 0.0, 0.0, 0.0))


def _table(rng: np.random.Generator) -> tuple[list[Obstacle], np.ndarray]:
    """Objects on a table top; the tool comes from above, between them."""
    frame = _frame(rng, (0.45, 0.6), (-0.05, 0.15))
    found = [_floor(), _placed(frame, "table", (0.7, 1.2, 0.04), (0.1, 0.0, -0.02))]
    at = rng.uniform((-0.15, -0.35), (0.2, 0.35))
    for number in range(rng.integers(6, 12)):
        height, spot = rng.uniform(0.08, 0.35), rng.uniform((-0.2, -0.5), (0.35, 0.5))
        if np.linalg.norm(spot - at) > 0.14:
            size = (rng.uniform(0.02, 0.05), height) if number % 2 else (*rng.uniform(0.04, 0.1, 2), height)
            found.append(_placed(frame, f"object {number}", size, (*spot, height / 2)))
    return found, _tool(frame, (*at, rng.uniform(0.03, 0.08)), (0.0, 0.0, -1.0), rng.uniform(-np.pi, np.pi))


def _bookshelf(rng: np.random.Generator) -> tuple[list[Obstacle], np.ndarray]:
    """Boards, sides and a back; the tool reaches into a compartment with objects at its sides."""
    frame = _frame(rng, (0.5, 0.65), (0.1, 0.3))
    width, depth, gap, boards = rng.uniform(0.6, 1.0), 0.3, rng.uniform(0.26, 0.34), 3
    found = [_floor(), _placed(frame, "back", (0.02, width, gap * (boards - 1)), (depth, 0.0, gap * (boards - 1) / 2))]
    found += [
        _placed(frame, f"board {number}", (depth, width, 0.02), (depth / 2, 0.0, number * gap))
        for number in range(boards)
    ]
    height = gap * (boards - 1)
    found += [
        _placed(frame, f"side {side}", (depth, 0.02, height), (depth / 2, side * width / 2, height / 2))
        for side in (-1, 1)
    ]
    level, across = rng.integers(boards - 1), rng.uniform(-0.5, 0.5) * (width - 0.4)
    for side in (-1, 1):
        spot = (rng.uniform(0.08, 0.2), across + side * rng.uniform(0.14, 0.2), level * gap + 0.09)
        found.append(_placed(frame, f"can {side}", (0.03, 0.15), spot))
    at = (rng.uniform(0.05, 0.15), across, (level + rng.uniform(0.4, 0.6)) * gap)
    return found, _tool(frame, at, (1.0, 0.0, rng.uniform(-0.2, 0.2)), rng.uniform(-np.pi, np.pi))


def _cage(rng: np.random.Generator) -> tuple[list[Obstacle], np.ndarray]:
    """The edges of a box, and bars in its sides; the tool reaches in through the top or the front."""
    frame = _frame(rng, (0.4, 0.5), (0.02, 0.2))
    size, bar = rng.uniform(0.36, 0.46), 0.02
    half = size / 2
    ends, sides = (0.0, size), (-half, half)
    along = [(y, z) for y in (-half, 0.0, half) for z in ends if y or not z]
    found = [_floor()]
    found += [_placed(frame, f"post {x:.1f} {y:.1f}", (bar, bar, size), (x, y, half)) for x in ends for y in sides]
    found += [_placed(frame, f"across {x:.1f} {z:.1f}", (bar, size, bar), (x, 0.0, z)) for x in ends for z in ends]
    found += [_placed(frame, f"along {y:.1f} {z:.1f}", (size, bar, bar), (half, y, z)) for y, z in along]
    found += [_placed(frame, f"side {y:.1f}", (bar, bar, size), (half, y, half)) for y in sides]
    top = rng.random() < 0.5
    at = (half + rng.uniform(-0.05, 0.05), rng.uniform(-0.06, 0.06), rng.uniform(0.12, 0.2))
    approach = (rng.uniform(-0.2, 0.2), 0.0, -1.0) if top else (1.0, rng.uniform(-0.2, 0.2), 0.0)
    return found, _tool(frame, at, approach, rng.uniform(-np.pi, np.pi))


_SCENES = {"table": _table, "bookshelf": _bookshelf, "cage": _cage}


@cache
def vamp_ur5(folder: Path) -> ArmKinematics:
    """The UR5 of VAMP's `resources/ur5`, meshes as their hulls."""
    arm = ArmDescription.from_urdf(folder / "ur5.urdf", tip="ee_link", package_dirs=[folder], meshes="hulls")
    return ArmKinematics.of(arm, base="world")


def vamp(folder: Path) -> Iterator[Problem]:
    """Convert MoveIt's scenes and requests in `problems.tar.bz2`, in the order of their names; nothing is unpickled."""
    joints = vamp_ur5(folder).arm.joints
    with tarfile.open(folder / "problems.tar.bz2", "r:bz2") as archive:
        texts = {item.name: archive.extractfile(item).read() for item in archive.getmembers() if item.isfile()}
    for name in sorted(name for name in texts if "/request" in name):
        kind, index = name.split("/")[1].removesuffix("_ur5"), int(re.findall(r"\d+", Path(name).name)[0])
        request = yaml.load(texts[name], yaml.CSafeLoader)
        scene = yaml.load(texts[name.replace("/request", "/scene")], yaml.CSafeLoader)
        state = request["start_state"]["joint_state"]
        start = dict(zip(state["name"], state["position"], strict=True))
        goal = {each["joint_name"]: each["position"] for each in request["goal_constraints"][0]["joint_constraints"]}
        obstacles = [_moveit(item) for item in scene["world"]["collision_objects"]]
        yield Problem(kind, index, *(np.array([each[joint] for joint in joints]) for each in (start, goal)), obstacles)


def _moveit(item: dict) -> Obstacle:
    """A collision object of MoveIt: one primitive, placed in the object's frame."""
    (solid,), (placed,) = item["primitives"], item["primitive_poses"]
    T = _transform(item["pose"]) @ _transform(placed) if "pose" in item else _transform(placed)
    sizes = solid["dimensions"]
    size = {"box": sizes, "cylinder": sizes[::-1], "sphere": sizes}[solid["type"]]  # MoveIt: height, then radius
    return Obstacle(item["id"], [float(value) for value in size], pose_vector(T))


def _transform(entry: dict) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(entry["orientation"]).as_matrix(), entry["position"]
    return T

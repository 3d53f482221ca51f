"""Universal Robots arms: all models of the maker, and the thesis's arm of three sizes.

`ur3` to `ur30` are the maker's robots: lengths, limits and speeds are those of `_ur.UR_MODELS`, shapes the cylinders
of `_ur.UR_SHAPES`. UR3, UR5 and UR10 are drawn by the meshes of example-robot-data, whose hulls are too coarse for
collisions (`docs/reference/accuracy.md`), the others by figures made from their cylinders (`_ur_figures`). Each
stands on a table, with a yaw of +90 degrees, so that its front is world +x (base_link -y). The frame `tcp` is 0.20 m
along z from the flange `tool0`.

`ur3-thesis`, `ur5-thesis` and `ur10-thesis` stand in the thesis's work cell: the joint-limited robots of
example-robot-data (all joints within ±pi) with its parallel gripper, whose fingers end at `tcp`, and its cameras.
"""

from __future__ import annotations

import importlib.util
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from kinreach.errors import InstallationError
from kinreach.robots._description import ArmDescription, no_package
from kinreach.robots._grippers import PARALLEL_GRIPPER, PARALLEL_GRIPPER_PAIRS, add_parallel_gripper
from kinreach.robots._ur import JOINTS, MOUNT_YAW, UR_LENGTHS, nominal_robot
from kinreach.robots._urdf import named, prune, set_origin
from kinreach.robots._workcell import Box, BoxRegion, CameraMount, Workcell

FLOOR = -0.75
PLATE = 0.02  # thickness of the plate under the arm [m]
BALL_RADIUS = 0.025
URDF_FILE = "example-robot-data/robots/ur_description/urdf/{}_joint_limited_robot.urdf"
#: The arm of the thesis's tasks; the other two are the same in other sizes.
THESIS_ARM = "ur5-thesis"
THESIS = "-thesis"
HOME = (-math.pi / 2, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0)


@dataclass(frozen=True)
class _Cell:
    """The work cell of the thesis's arm, and what its simulation needs. Lengths [m], in the world.

    Attributes:
        model: `MODEL_joint_limited_robot.urdf` is its file.
        table_top: Height of the table. If it is lower, the natural postures push wrist_1 across ±pi.
        table, table_x: Edges of the table top, and x of its centre.
        goals_x, goals_y: Ranges of the goals; both natural postures reach them with the tool down.
        plate, plate_x: Edges of the plate under the arm, and x of its centre.
        front_target, wrist_target: Targets of the cameras, in the world and in the frame of tool0.
        overview, overview_target: Viewpoint of pictures.
        position_gains: Stiffness of the position servos [N m/rad].
        speed_limit: Of the joints [rad/s].
    """

    model: str
    table_top: float
    table: tuple[float, float]
    table_x: float
    goals_x: tuple[float, float]
    goals_y: tuple[float, float]
    plate: tuple[float, float]
    plate_x: float
    front_target: tuple[float, float, float]
    wrist_target: tuple[float, float, float]
    overview: tuple[float, float, float]
    overview_target: tuple[float, float, float]
    position_gains: tuple[float, ...]
    speed_limit: float


_CELLS = (
    _Cell(
        model="ur3", table_top=-0.12, table=(0.50, 0.90), table_x=0.41, goals_x=(0.26, 0.42), goals_y=(-0.20, 0.20),
        plate=(0.24, 0.16), plate_x=-0.04, front_target=(0.34, 0.0, -0.14), wrist_target=(0.112, -0.041, 0.409),
        overview=(1.25, -0.95, 0.55), overview_target=(0.15, 0.0, 0.0),
        position_gains=(1200.0, 1200.0, 800.0, 300.0, 250.0, 200.0), speed_limit=2.16,
    ),
    _Cell(
        model="ur5", table_top=-0.20, table=(0.70, 1.20), table_x=0.53, goals_x=(0.30, 0.65), goals_y=(-0.30, 0.30),
        plate=(0.30, 0.18), plate_x=-0.06, front_target=(0.45, 0.0, -0.23), wrist_target=(0.109, 0.012, 0.607),
        overview=(1.75, -1.30, 0.70), overview_target=(0.25, 0.0, 0.0),
        position_gains=(4000.0, 4000.0, 2500.0, 800.0, 600.0, 400.0), speed_limit=math.pi,
    ),
    _Cell(
        model="ur10", table_top=-0.18, table=(0.90, 1.50), table_x=0.72, goals_x=(0.42, 0.90), goals_y=(-0.40, 0.40),
        plate=(0.36, 0.22), plate_x=-0.07, front_target=(0.62, 0.0, -0.23), wrist_target=(0.164, 0.028, 0.802),
        overview=(2.40, -1.80, 1.00), overview_target=(0.35, 0.0, 0.05),
        position_gains=(12000.0, 12000.0, 6000.0, 500.0, 400.0, 250.0), speed_limit=2.16,
    ),
)  # fmt: skip


def example_robot_data() -> str:
    """Find the `share` folder of example-robot-data without importing an engine."""
    spec = importlib.util.find_spec("example_robot_data")
    if spec is not None and spec.origin is not None:
        for parent in Path(spec.origin).resolve().parents:
            if (parent / "share" / URDF_FILE.format("ur5")).is_file():
                return str(parent / "share")
    raise InstallationError(
        "the descriptions of the arms are missing; install them with: "
        "pip install example-robot-data example-robot-data-loaders"
    )


def _from_example_robot_data(model: str) -> ET.Element:
    return ET.parse(Path(example_robot_data()) / URDF_FILE.format(model)).getroot()


def _thesis_robot(model: str) -> ET.Element:
    robot = _from_example_robot_data(model)
    prune(robot, tags=("gazebo", "transmission"), links=("ee_link", "base"))
    set_origin(robot, "world_joint", (0, 0, 0), (0, 0, MOUNT_YAW))
    add_parallel_gripper(robot, "tool0")
    ET.indent(robot)
    return robot


def _drawn_robot(model: str) -> ET.Element:
    """Build the URDF of a model, drawn by the meshes of example-robot-data."""
    robot = nominal_robot(model)
    for drawn in _from_example_robot_data(model).iterfind("link"):
        link = named(robot, "link", drawn.get("name", ""))
        if link is not None and (visuals := drawn.findall("visual")):
            for own in link.findall("visual"):
                link.remove(own)
            link.extend(visuals)
    ET.indent(robot)
    return robot


_SRDF_PAIRS = (
    ("base_link", "shoulder_link"),
    ("base_link", "upper_arm_link"),
    ("shoulder_link", "upper_arm_link"),
    ("upper_arm_link", "forearm_link"),
    ("forearm_link", "wrist_1_link"),
    ("forearm_link", "wrist_2_link"),
    ("forearm_link", "wrist_3_link"),
    ("wrist_1_link", "wrist_2_link"),
    ("wrist_1_link", "wrist_3_link"),
    ("wrist_2_link", "wrist_3_link"),
)
_GRIPPER_PAIRS = (("wrist_3_link", "gripper_palm"), ("wrist_2_link", "gripper_palm"), *PARALLEL_GRIPPER_PAIRS)


def _workcell(cell: _Cell) -> Workcell:
    top, (length, width) = cell.table_top, cell.plate
    back = cell.plate_x - length / 2
    pedestal = length * 0.4
    return Workcell(
        obstacles=(
            Box("table", (*cell.table, 0.04), (cell.table_x, 0.0, top - 0.02), legs=top - 0.04 - FLOOR),
            Box("mount", (length, width, PLATE), (cell.plate_x, 0.0, -PLATE / 2)),
            Box(
                "pedestal",
                (pedestal, width, -PLATE - FLOOR),
                (round(back + pedestal / 2, 3), 0.0, (FLOOR - PLATE) / 2),
            ),
            Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, FLOOR - 0.05)),
        ),
        touching=(("mount", "base_link"),),
        goals=BoxRegion(x=cell.goals_x, y=cell.goals_y, z=(top + BALL_RADIUS,) * 2),
        ball_radius=BALL_RADIUS,
    )


def _cameras(cell: _Cell) -> tuple[CameraMount, ...]:
    return (
        # Under the plate and 3 cm behind the arm's axis: further forward the nearest corners of the goal area, 45
        # degrees to the side, would leave the picture.
        CameraMount(
            "front", "world", (-0.03, 0.0, -0.05), cell.front_target, holder=(-0.05, 0.0, -PLATE), observed=True
        ),
        # Beside the fingers and far enough from them that they hide no goal; up in the picture is forward at home.
        CameraMount(
            "wrist",
            "tool0",
            (0.10, 0.0, 0.09),
            cell.wrist_target,
            up=(0, -1, 0),
            holder=(0.035, 0.0, 0.06),
            observed=True,
        ),
        CameraMount("overview", "world", cell.overview, cell.overview_target, fovy=37.0),
    )


def _describe_thesis(cell: _Cell) -> ArmDescription:
    return ArmDescription(
        name=f"{cell.model}{THESIS}",
        title=f"{cell.model.upper()} with parallel gripper",
        build_urdf=partial(_thesis_robot, cell.model),
        joints=JOINTS,
        home=HOME,
        base="base_link",
        tips={"tool0": "tool0", "tcp": "tcp"},
        default_tip="tcp",
        workcell=_workcell(cell),
        disabled_collisions=_SRDF_PAIRS + _GRIPPER_PAIRS,
        package_root=example_robot_data,
        position_gains=cell.position_gains,
        speed_limit=cell.speed_limit,
        acceleration_limit=10.0,
        armature=0.1,
        joint_damping=(0.0,) * 6,
        gripper=PARALLEL_GRIPPER,
        moves_last=("shoulder_lift_joint",),
        cameras=_cameras(cell),
    )


def _table(name: str) -> Workcell:
    """A table with goals, its sizes in proportion to the arm's reach."""
    lengths = UR_LENGTHS[name]
    reach = -lengths.a2 - lengths.a3
    return Workcell(
        obstacles=(
            Box("table", (1.5 * reach, 1.7 * reach, 0.04), (0.5 * reach, 0.0, -0.02), legs=-0.04 - FLOOR),
            Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, FLOOR - 0.05)),
        ),
        touching=(("table", "base_link"),),
        goals=BoxRegion(x=(0.45 * reach, 0.8 * reach), y=(-0.37 * reach, 0.37 * reach), z=(BALL_RADIUS,) * 2),
        ball_radius=BALL_RADIUS,
    )


def _describe(name: str) -> ArmDescription:
    """Describe a robot of the maker: the bare arm on a table."""
    meshes = name in DRAWN
    return ArmDescription(
        name=name,
        title=name.upper(),
        build_urdf=partial(_drawn_robot if meshes else nominal_robot, name),
        package_root=example_robot_data if meshes else no_package,
        joints=JOINTS,
        home=HOME,
        base="base_link",
        tips={"tool0": "tool0", "tcp": "tcp"},
        default_tip="tool0",
        workcell=_table(name),
    )


#: Models whose meshes example-robot-data has.
DRAWN = tuple(cell.model for cell in _CELLS)
#: What describes each arm, by its name.
DESCRIBED: dict[str, Callable[[], ArmDescription]] = {
    **{name: partial(_describe, name) for name in UR_LENGTHS},
    **{f"{cell.model}{THESIS}": partial(_describe_thesis, cell) for cell in _CELLS},
}

"""Universal Robots UR5 with a parallel gripper.

The arm is `ur5_limited` of example-robot-data (all joints within ±pi). kinreach mounts it with a yaw of +90
degrees, so that the front is world +x (base_link -y), and adds a gripper with the proportions of an OnRobot RG6:
160 mm stroke, made of boxes, with `tcp` between the finger tips, 0.20 m along z from `tool0`.
"""

from __future__ import annotations

import importlib.util
import math
import xml.etree.ElementTree as ET
from pathlib import Path

from kinreach.errors import InstallationError
from kinreach.robots.description import ArmDescription, Gripper
from kinreach.robots.urdf import Solid, add_joint, add_link, prune, set_origin
from kinreach.robots.workcell import Box, BoxRegion, CameraMount, Workcell

MOUNT_YAW = math.pi / 2
TCP_OFFSET = 0.20  # tool0 -> tcp along z [m]
STROKE = 0.16
TABLE_TOP = -0.20  # world z [m]; at -0.30 the natural postures would push wrist_1 across +-pi
FLOOR = -0.75
PLATE = 0.02  # thickness of the plate under the arm [m]
BALL_RADIUS = 0.025
URDF_FILE = "example-robot-data/robots/ur_description/urdf/ur5_joint_limited_robot.urdf"


def _package_root() -> str:
    """The `share` folder of example-robot-data, found without importing an engine."""
    spec = importlib.util.find_spec("example_robot_data")
    if spec is not None and spec.origin is not None:
        for parent in Path(spec.origin).resolve().parents:
            if (parent / "share" / URDF_FILE).is_file():
                return str(parent / "share")
    raise InstallationError(
        "the UR5's description is missing; install it with: "
        "pip install example-robot-data==4.4.0 example-robot-data-loaders==4.4.0"
    )


def _build_urdf() -> str:
    robot = ET.parse(Path(_package_root()) / URDF_FILE).getroot()
    prune(robot, tags=("gazebo", "transmission"), links=("ee_link", "base"))
    set_origin(robot, "world_joint", (0, 0, 0), (0, 0, MOUNT_YAW))
    _add_gripper(robot)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")


def _add_gripper(robot: ET.Element) -> None:
    """Palm and rail on tool0, two fingers that slide along ±y of tool0."""
    palm = Solid((0.07, 0.10, 0.085), (0, 0, 0.0425))
    rail = Solid((0.03, 0.20, 0.02), (0, 0, 0.095))
    add_link(robot, "gripper_palm", mass=0.9, solids=(palm, rail), rgba="0.62 0.64 0.67 1")
    add_joint(robot, "gripper_joint", "tool0", "gripper_palm")
    for side, sign in (("left", 1.0), ("right", -1.0)):
        finger = Solid((0.022, 0.012, 0.105), (0, sign * 0.006, 0.1575))
        add_link(robot, f"finger_{side}", mass=0.1, solids=(finger,), rgba="0.20 0.21 0.23 1")
        add_joint(
            robot,
            f"finger_{side}_joint",
            "gripper_palm",
            f"finger_{side}",
            kind="prismatic",
            axis=(0, sign, 0),
            limit=(0.0, STROKE / 2, 120.0, 0.2),
            mimic="finger_left_joint" if side == "right" else None,
        )
    add_link(robot, "tcp")
    add_joint(robot, "tcp_joint", "tool0", "tcp", xyz=(0, 0, TCP_OFFSET))


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
_GRIPPER_PAIRS = (
    ("wrist_3_link", "gripper_palm"),
    ("wrist_2_link", "gripper_palm"),
    ("gripper_palm", "finger_left"),
    ("gripper_palm", "finger_right"),
    ("finger_left", "finger_right"),
)

_CAMERAS = (
    # Under the plate and 3 cm behind the arm's axis: further forward the nearest corners of the goal area, 45 degrees
    # to the side, would leave the picture.
    CameraMount("front", "world", (-0.03, 0.0, -0.05), (0.45, 0.0, -0.23), holder=(-0.05, 0.0, -PLATE)),
    # Beside the fingers and far enough from them that they hide no goal; up in the picture is forward at home.
    CameraMount("wrist", "tool0", (0.10, 0.0, 0.09), (0.109, 0.012, 0.607), up=(0, -1, 0), holder=(0.035, 0.0, 0.06)),
    CameraMount("overview", "world", (1.75, -1.30, 0.70), (0.25, 0.0, 0.0), fovy=37.0),
)

ARM = ArmDescription(
    name="ur5",
    title="UR5 with parallel gripper",
    build_urdf=_build_urdf,
    joints=(
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ),
    home=(-math.pi / 2, -math.pi / 2, math.pi / 2, -math.pi / 2, -math.pi / 2, 0.0),
    base="base_link",
    tips={"tool0": "tool0", "tcp": "tcp"},
    default_tip="tcp",
    workcell=Workcell(
        obstacles=(
            Box("table", (0.70, 1.20, 0.04), (0.53, 0.0, TABLE_TOP - 0.02), legs=TABLE_TOP - 0.04 - FLOOR),
            Box("mount", (0.30, 0.18, PLATE), (-0.06, 0.0, -PLATE / 2)),
            Box("pedestal", (0.12, 0.18, -PLATE - FLOOR), (-0.15, 0.0, (FLOOR - PLATE) / 2)),
            Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, FLOOR - 0.05)),
        ),
        touching=(("mount", "base_link"),),
        goals=BoxRegion(x=(0.30, 0.65), y=(-0.30, 0.30), z=(TABLE_TOP + BALL_RADIUS,) * 2),
        ball_radius=BALL_RADIUS,
    ),
    disabled_collisions=_SRDF_PAIRS + _GRIPPER_PAIRS,
    package_root=_package_root,
    position_gains=(4000.0, 4000.0, 2500.0, 800.0, 600.0, 400.0),
    speed_limit=math.pi,
    acceleration_limit=10.0,
    armature=0.1,
    joint_damping=(0.0,) * 6,
    gripper=Gripper(
        joint="finger_left_joint", mimic_joint="finger_right_joint", stroke=STROKE, opening=0.10, force=120.0
    ),
    moves_last=("shoulder_lift_joint",),
    cameras=_CAMERAS,
)

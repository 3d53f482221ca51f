"""The SO-101 of The Robot Studio, which LeRobot drives: five joints, and a jaw that turns beside a fixed one.

Joints, their signs and limits, and the frame between the jaws are those of `so101_new_calib.urdf`, where each joint is
0 in the middle of its range, with right angles written out; masses are those of its links. The shapes are primitives
from lengths and servo sizes. Where the jaw's axis is, and its range, stand there too; where the faces of the jaws are
and how they are inclined is read off the contact shapes of `robotstudio_so101/so101.xml` in MuJoCo Menagerie: faces
7.9 mm from the wrist's axis, and 12.7 mm beside and 76 mm ahead of the jaw's. None of it is measured on an arm.

Its servos are Feetech's STS3215 at 7.4 V. A stall torque of 19.5 kg cm, which is 1.91 N m, and 0.222 s for 60 degrees
without load, which is 4.7 rad/s, are what is said of its data sheet, which we have not read. Moves use 3 rad/s and
10 rad/s^2.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from kinreach.robots._description import ArmDescription
from kinreach.robots._grippers import JawGripper
from kinreach.robots._urdf import Solid, add_joint, add_link
from kinreach.robots._workcell import Box, BoxRegion, CameraMount, Workcell

HALF = math.pi / 2
EFFORT, SPEED = 1.9, 4.7
#: A small motor's rotor, some 2e-7 kg m^2, behind the servo's gear of 345 [kg m^2]; an estimate.
ARMATURE = 0.024
#: Height of the table above the floor, and radius of the ball that marks a goal [m].
TABLE, BALL_RADIUS = 0.75, 0.015
#: A table that the arm stands on, with goals where it points straight down.
WORKCELL = Workcell(
    obstacles=(
        Box("table", (0.70, 0.80, 0.03), (0.22, 0.0, -0.015), legs=TABLE - 0.03),
        Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, -TABLE - 0.05)),
    ),
    touching=(("table", "base_link"),),
    goals=BoxRegion(x=(0.16, 0.28), y=(-0.12, 0.12), z=(BALL_RADIUS,) * 2),
    ball_radius=BALL_RADIUS,
)
#: In the frame of the link that carries them: the jaw's axis, and how far its middle is from the servo's face [m].
PIVOT, JAW_MIDDLE = (0.0202, 0.0188, -0.0234), 0.0189
#: Faces of the jaws, towards each other: the fixed one's place across, and the point of the other one that touches it
#: first, in the jaw's frame [m]. At 0.2 rad the faces are parallel.
FACE, TOUCH, PARALLEL = -0.0079, (-0.0127, -0.076), 0.2
#: Range of the jaw [rad].
JAW_RANGE = (-0.174533, 1.745329)
#: The jaws end 10 mm beyond the point between them, 17 mm from the fixed one [m].
JAW_END, BEYOND, BESIDE = -0.1034, 0.010, 0.017
JAW_THICK, JAW_WIDE, JAW_LONG = 0.010, 0.020, 0.055
GRIPPER = JawGripper(
    joint="gripper",
    tip="tcp",
    stroke=0.10,
    opening=0.07,
    torque=EFFORT,
    pivot=PIVOT[0] - FACE,
    length=math.hypot(*TOUCH),
    ahead=math.atan2(-TOUCH[0], -TOUCH[1]),
    least=JAW_RANGE[0],
    beside=BESIDE,
)
#: Half the width of an arm's link: its middle is there from the servo's face [m].
MIDDLE = 0.018


@dataclass(frozen=True)
class _Link:
    joint: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    limit: tuple[float, float]
    name: str
    mass: float
    solids: tuple[Solid, ...]


_LINKS = (
    _Link(
        "shoulder_pan", (0.0388353, 0.0, 0.0624), (math.pi, 0.0, -math.pi), (-1.91986, 1.91986),
        "shoulder_link", 0.100, (Solid((0.05, 0.05, 0.06), (-0.025, 0.0, -0.035)),),
    ),
    _Link(
        "shoulder_lift", (-0.0303992, -0.0182778, -0.0542), (-HALF, -HALF, 0.0), (-1.74533, 1.74533),
        "upper_arm_link", 0.103, (Solid((0.095, 0.03, 0.045), (-0.065, -0.010, MIDDLE), (0.0, 0.0, 0.244)),),
    ),
    _Link(
        "elbow_flex", (-0.11257, -0.028, 0.0), (0.0, 0.0, HALF), (-1.69, 1.69),
        "lower_arm_link", 0.104, (Solid((0.09, 0.03, 0.045), (-0.075, 0.003, MIDDLE)),),
    ),
    _Link(
        "wrist_flex", (-0.1349, 0.0052, 0.0), (0.0, 0.0, -HALF), (-1.65806, 1.65806),
        "wrist_link", 0.079, (Solid((0.03, 0.045, 0.045), (0.0, -0.035, MIDDLE)),),
    ),
    _Link(
        "wrist_roll", (0.0, -0.0611, 0.0181), (HALF, 0.0486795, math.pi), (-2.74385, 2.84121),
        "gripper_link", 0.087,
        (Solid((0.05, 0.04, 0.05), (0.0, 0.0, -0.025)),
         Solid((JAW_THICK, JAW_WIDE, JAW_LONG), (FACE - JAW_THICK / 2, 0.0, JAW_END + JAW_LONG / 2))),
    ),
)  # fmt: skip


def _jaw() -> Solid:
    """Return the jaw that turns: a box whose face goes through the point that touches, inclined."""
    ahead, aside = math.cos(PARALLEL), math.sin(PARALLEL)
    back = JAW_LONG / 2 - (PIVOT[2] + TOUCH[1] - JAW_END)
    x = TOUCH[0] + aside * back + ahead * JAW_THICK / 2
    y = TOUCH[1] + ahead * back - aside * JAW_THICK / 2
    return Solid((JAW_THICK, JAW_LONG, JAW_WIDE), (x, y, JAW_MIDDLE), (0.0, 0.0, -PARALLEL))


def _build_robot() -> ET.Element:
    robot = ET.Element("robot", name="so101")
    add_link(robot, "base_link", mass=0.147, solids=(Solid((0.07, 0.08, 0.06), (0.02, 0.0, 0.03)),))
    parent = "base_link"
    for link in _LINKS:
        add_link(robot, link.name, mass=link.mass, solids=link.solids, rgba="0.95 0.78 0.15 1")
        limit = (*link.limit, EFFORT, SPEED)
        add_joint(
            robot,
            link.joint,
            parent,
            link.name,
            kind="revolute",
            xyz=link.xyz,
            rpy=link.rpy,
            axis=(0, 0, 1),
            limit=limit,
        )
        parent = link.name
    add_link(robot, "gripper_frame_link")
    place = (-0.0079, -0.000218121, -0.0981274)
    add_joint(robot, "gripper_frame_joint", parent, "gripper_frame_link", xyz=place, rpy=(0.0, math.pi, 0.0))
    add_link(robot, "jaw_link", mass=0.012, solids=(_jaw(),), rgba="0.95 0.78 0.15 1")
    limit = (*JAW_RANGE, EFFORT, SPEED)
    add_joint(
        robot,
        GRIPPER.joint,
        parent,
        "jaw_link",
        kind="revolute",
        xyz=PIVOT,
        rpy=(HALF, 0.0, 0.0),
        axis=(0, 0, 1),
        limit=limit,
    )
    add_link(robot, GRIPPER.tip)
    place = (FACE + BESIDE, place[1], JAW_END + BEYOND)
    add_joint(robot, "tcp_joint", parent, GRIPPER.tip, xyz=place, rpy=(math.pi, 0.0, -HALF))
    ET.indent(robot)
    return robot


ARM = ArmDescription(
    name="so101",
    title="SO-101",
    build_urdf=_build_robot,
    joints=tuple(link.joint for link in _LINKS),
    home=(0.0,) * len(_LINKS),
    base="base_link",
    tips={"gripper_frame_link": "gripper_frame_link", GRIPPER.tip: GRIPPER.tip},
    default_tip="gripper_frame_link",
    workcell=WORKCELL,
    armature=ARMATURE,
    gripper=GRIPPER,
    cameras=(CameraMount("overview", "world", (0.80, -0.62, 0.40), (0.16, 0.0, 0.09), fovy=32.0),),
)

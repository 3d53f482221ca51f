"""The 3-DOF arm of the button task: a turning base and a two-link arm that moves in a vertical plane.

Geometry, masses and inertias are those of the course project's arm; the shapes are primitives. The end effector is a
point on the third link.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from kinreach.robots._description import ArmDescription
from kinreach.robots._urdf import Solid, add_joint, add_link, named, numbers
from kinreach.robots._workcell import Box, CameraMount, QuadrantRegion, Workcell

BASE_HEIGHT = 0.158
BEND_LIMIT = 2.0


@dataclass(frozen=True)
class _Link:
    name: str
    mass: float
    com: tuple[float, float, float]
    diagonal: tuple[float, float, float]
    quat: tuple[float, float, float, float]  # w, x, y, z
    origin: tuple[float, float, float]
    axis: tuple[float, float, float]
    limit: float
    effort: float
    solids: tuple[Solid, ...]
    rgba: str


def _between(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Solid:
    """A cylinder from one point to another, both in the link's frame [m]."""
    d = [e - s for s, e in zip(start, end, strict=True)]
    length = math.hypot(*d)
    pitch = math.acos(d[2] / length)
    yaw = math.atan2(d[1], d[0])
    middle = tuple((s + e) / 2 for s, e in zip(start, end, strict=True))
    return Solid((radius, length), middle, (0.0, pitch, yaw))  # type: ignore[arg-type]


_SIDEWAYS = (math.pi / 2, 0.0, 0.0)
_LINKS = (
    _Link(
        "link_1", 5.7854, (0.033215, -0.0082402, 0.12846), (0.0457732, 0.038138, 0.0238257),
        (0.899131, 0.0812666, -0.353255, -0.245295), (0, 0, BASE_HEIGHT), (0, 0, 1), math.pi, 40.0,
        (Solid((0.075, 0.10), (0, 0, 0.05)), _between((0.03, 0.0, 0.09), (0.062468, 0.05, 0.18), 0.045),
         Solid((0.055, 0.10), (0.062468, 0.085, 0.18), _SIDEWAYS)), "0.20 0.36 0.55 1",
    ),
    _Link(
        "link_2", 6.2559, (0.021249, 0.0010698, 0.16335), (0.146809, 0.141204, 0.0152276),
        (0.731774, -0.00441777, -0.00264645, 0.681527), (0.062468, 0.11617, 0.18), (0, 1, 0), BEND_LIMIT, 80.0,
        (_between((0, 0.02, 0), (0.012532, 0.02, 0.365), 0.042), Solid((0.05, 0.06), (0.012532, 0, 0.365), _SIDEWAYS)),
        "0.86 0.87 0.88 1",
    ),
    _Link(
        "link_3", 7.1667, (-0.062257, -0.0012327, 0.14769), (0.164013, 0.160813, 0.0216148),
        (0.548153, 0.0890732, 0.0521709, 0.829984), (0.012532, -0.11717, 0.365), (0, 1, 0), BEND_LIMIT, 25.0,
        (Solid((0.05, 0.10), (0, 0.03, 0), _SIDEWAYS), _between((0, 0, 0), (-0.08, 0, 0.34), 0.036),
         _between((-0.08, 0, 0.34), (-0.0895, 0, 0.465), 0.02)), "0.86 0.48 0.16 1",
    ),
)  # fmt: skip


def _euler(quat: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of a quaternion (w, x, y, z)."""
    w, x, y, z = (c / math.hypot(*quat) for c in quat)
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def _build_robot() -> ET.Element:
    robot = ET.Element("robot", name="arm3")
    add_link(robot, "world")
    add_link(robot, "base_link", mass=8.0, solids=(Solid((0.11, 0.15), (0, 0, 0.075)),), rgba="0.25 0.26 0.28 1")
    add_joint(robot, "world_joint", "world", "base_link")
    parent = "base_link"
    for link in _LINKS:
        add_link(robot, link.name, solids=link.solids, rgba=link.rgba)
        _set_inertia(robot, link)
        add_joint(
            robot,
            f"{link.name}_joint",
            parent,
            link.name,
            kind="revolute",
            xyz=link.origin,
            axis=link.axis,
            limit=(-link.limit, link.limit, link.effort, 10.0),
        )
        parent = link.name
    add_link(robot, "end_effector")
    add_joint(robot, "end_effector_joint", parent, "end_effector", xyz=(-0.090, 0.0, 0.48))
    ET.indent(robot)
    return robot


def _set_inertia(robot: ET.Element, link: _Link) -> None:
    element = named(robot, "link", link.name)
    inertial = ET.SubElement(element, "inertial")  # type: ignore[arg-type]
    ET.SubElement(inertial, "origin", xyz=numbers(link.com), rpy=numbers(_euler(link.quat)))
    ET.SubElement(inertial, "mass", value=repr(link.mass))
    ixx, iyy, izz = (repr(v) for v in link.diagonal)
    ET.SubElement(inertial, "inertia", {"ixx": ixx, "iyy": iyy, "izz": izz, "ixy": "0", "ixz": "0", "iyz": "0"})


ARM = ArmDescription(
    name="arm3",
    title="3-DOF arm of the button task",
    build_urdf=_build_robot,
    joints=("link_1_joint", "link_2_joint", "link_3_joint"),
    home=(0.0, 0.0, 0.0),
    base="base_link",
    tips={"end_effector": "end_effector"},
    default_tip="end_effector",
    workcell=Workcell(
        obstacles=(Box("floor", (6.0, 6.0, 0.10), (0.0, 0.0, -0.05)),),
        touching=(("floor", "base_link"),),
        goals=QuadrantRegion(across=(0.2, 0.6), height=(0.1, 0.6)),
        reached_distance=0.05,
    ),
    disabled_collisions=(("base_link", "link_1"), ("link_1", "link_2"), ("link_2", "link_3")),
    position_gains=(2500.0, 2500.0, 1200.0),
    speed_limit=3.0,
    acceleration_limit=10.0,
    armature=0.2,
    joint_damping=(12.0, 20.0, 6.0),
    cameras=(CameraMount("overview", "world", (1.7, -1.5, 0.95), (0.05, 0.0, 0.48), fovy=38.0),),
)

"""Universal Robots arms as numbers: the lengths of all models, and a URDF made from them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kinreach.robots._grippers import TCP_OFFSET
from kinreach.robots._ur_shapes import UR_SHAPES, URShape, link_solids
from kinreach.robots._urdf import add_joint, add_link

MOUNT_YAW = math.pi / 2
#: base_link is the frame in which the DH lengths are given, turned by pi about z; either from the other.
FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])
JOINTS = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)


class Lengths(NamedTuple):
    """Denavit-Hartenberg lengths of a UR [m]; the angles alpha are pi/2, 0, 0, pi/2, -pi/2, 0 for all models."""

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float


#: The lengths of every model, as Universal Robots publishes them (DH parameters for calculations of kinematics and
#: dynamics). UR7e and UR12e are the UR5e and the UR10e under new names.
UR_LENGTHS: Mapping[str, Lengths] = {
    "ur3": Lengths(0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur3e": Lengths(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5": Lengths(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur5e": Lengths(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur7e": Lengths(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur8long": Lengths(0.2186, -0.8989, -0.7149, 0.1824, 0.1361, 0.1434),
    "ur10": Lengths(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "ur10e": Lengths(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur12e": Lengths(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur15": Lengths(0.2186, -0.6475, -0.5164, 0.1824, 0.1361, 0.1434),
    "ur16e": Lengths(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "ur18": Lengths(0.2186, -0.475, -0.3389, 0.1824, 0.1361, 0.1434),
    "ur20": Lengths(0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
    "ur30": Lengths(0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
}


#: Largest acceleration of a joint in a planned motion [rad/s^2]. Universal Robots publishes none ("acceleration limits
#: are not publicly available", joint_limits.yaml of Universal_Robots_ROS2_Description 2.4.5). ur_moveit_config 7.0.0 of
#: Universal_Robots_ROS2_Driver, an example by the maker, has this for all joints of all models: "the robot does not
#: inherently have any limits on joint accelerations (only on torques)", and the value is "chosen conservatively".
#: URScript's movej takes 1.4 where none is given.
UR_ACCELERATION = 5.0


def shape_of(name: str) -> URShape:
    """Return the shape of a model: its own, or that of the model with the most similar joints, by d4, d5 and d6."""
    joints = {key: np.array(lengths[3:]) for key, lengths in UR_LENGTHS.items()}
    return UR_SHAPES[min(UR_SHAPES, key=lambda own: (own != name, float(np.abs(joints[own] - joints[name]).sum())))]


def ur_speeds(name: str) -> tuple[float, ...]:
    """Largest speeds of a model's joints by its data sheet [rad/s]; arms of other names have the highest of all."""
    model = name.lower().partition("_")[0]
    if model in UR_LENGTHS:
        return shape_of(model).speeds
    return (2.0 * math.pi,) * len(JOINTS)


def nominal_urdf(name: str) -> str:
    """Build the URDF of a model from its lengths and its shapes; links as in example-robot-data.

    The limits are the data sheet's, but the elbow has half of them, as in the maker's ROS description: on the way to
    the other half wrist_1 hits the upper arm.
    """
    d1, a2, a3, d4, d5, d6 = UR_LENGTHS[name]
    y, z, quarter = (0, 1, 0), (0, 0, 1), (0, math.pi / 2, 0)
    steps = (
        ("shoulder_link", (0, 0, d1), (0, 0, 0), z),
        ("upper_arm_link", (0, d4, 0), quarter, y),
        ("forearm_link", (0, 0, -a2), (0, 0, 0), y),
        ("wrist_1_link", (0, 0, -a3), quarter, y),
        ("wrist_2_link", (0, 0, 0), (0, 0, 0), z),
        ("wrist_3_link", (0, 0, d5), (0, 0, 0), y),
    )
    shape = shape_of(name)
    solids = link_solids(shape, UR_LENGTHS[name])
    masses = dict(zip([step[0] for step in steps], shape.masses, strict=True))
    robot = ET.Element("robot", name=name)
    for link in ("world", "base_link", *(step[0] for step in steps), "tool0", "tcp"):
        add_link(robot, link, mass=masses.get(link, 0.0), solids=solids.get(link, ()), rgba="0.62 0.64 0.67 1")
    add_joint(robot, "world_joint", "world", "base_link", rpy=(0, 0, MOUNT_YAW))
    parent = "base_link"
    for joint, (link, xyz, rpy, axis), torque, speed in zip(JOINTS, steps, shape.torques, shape.speeds, strict=True):
        turn = math.pi if joint == "elbow_joint" else 2 * math.pi
        limit = (-turn, turn, torque, speed)
        add_joint(robot, joint, parent, link, kind="revolute", xyz=xyz, rpy=rpy, axis=axis, limit=limit)
        parent = link
    add_joint(robot, "tool0_joint", parent, "tool0", xyz=(0, d6, 0), rpy=(-math.pi / 2, 0, 0))
    add_joint(robot, "tcp_joint", "tool0", "tcp", xyz=(0, 0, TCP_OFFSET))
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode")

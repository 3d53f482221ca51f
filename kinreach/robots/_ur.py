"""Universal Robots arms as numbers: the lengths of all models, and a URDF made from them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from kinreach.robots._grippers import TCP_OFFSET
from kinreach.robots._ur_shapes import UR_SHAPES, URShape, link_solids
from kinreach.robots._urdf import add_joint, add_link, set_limits

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


class URModel(NamedTuple):
    """What Universal Robots publishes of a model: lengths, and the largest speeds and torques of its joints.

    Attributes:
        lengths: Denavit-Hartenberg lengths [m].
        speeds: Of base and shoulder, of the elbow, and of the wrists [degrees/s].
        torques: Of base and shoulder, of the elbow, and of the wrists [N m].
        endless: Whether wrist_3 turns without a limit.
    """

    lengths: Lengths
    speeds: tuple[float, float, float]
    torques: tuple[float, float, float]
    endless: bool = False


#: Every model. Lengths: the maker's article "DH parameters for calculations of kinematics and dynamics"; UR7e and UR12e
#: are the UR5e and the UR10e under new names. Speeds: `config/MODEL/joint_limits.yaml` of the maker's
#: Universal_Robots_ROS2_Description, which has them from the user manuals: version 2.4.5 (of October 2024) for the
#: older models, commit 272bddd for UR18. Neither file nor data sheet of UR8 Long and UR15 was at hand: they have the
#: speeds of a UR20, the slowest of all. Torques: the maker's article "Max. joint torques" for CB3 and e-Series, those
#: files for the others; UR8 Long and UR15 have the wrist of a UR18, and so its torques.
UR_MODELS: Mapping[str, URModel] = {
    "ur3": URModel(
        Lengths(0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819), (180, 180, 360), (56, 28, 12), endless=True
    ),
    "ur3e": URModel(
        Lengths(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921), (180, 180, 360), (56, 28, 12), endless=True
    ),
    "ur5": URModel(Lengths(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823), (180, 180, 180), (150, 150, 28)),
    "ur5e": URModel(Lengths(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996), (180, 180, 180), (150, 150, 28)),
    "ur7e": URModel(Lengths(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996), (180, 180, 180), (150, 150, 28)),
    "ur8long": URModel(Lengths(0.2186, -0.8989, -0.7149, 0.1824, 0.1361, 0.1434), (120, 150, 210), (433, 204, 70)),
    "ur10": URModel(Lengths(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922), (120, 180, 180), (330, 150, 56)),
    "ur10e": URModel(Lengths(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655), (120, 180, 180), (330, 150, 56)),
    "ur12e": URModel(Lengths(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655), (120, 180, 180), (330, 150, 56)),
    "ur15": URModel(Lengths(0.2186, -0.6475, -0.5164, 0.1824, 0.1361, 0.1434), (120, 150, 210), (433, 204, 70)),
    "ur16e": URModel(Lengths(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655), (120, 180, 180), (330, 150, 56)),
    "ur18": URModel(Lengths(0.2186, -0.475, -0.3389, 0.1824, 0.1361, 0.1434), (180, 240, 300), (433, 204, 70)),
    "ur20": URModel(Lengths(0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543), (120, 150, 210), (738, 433, 107)),
    "ur30": URModel(Lengths(0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543), (120, 150, 210), (738, 433, 107)),
}
#: The lengths of every model.
UR_LENGTHS: Mapping[str, Lengths] = {name: model.lengths for name, model in UR_MODELS.items()}

#: Limits of the joints [rad]: ±360 degrees by the user manuals of all models. The elbow has half of that, as in the
#: maker's ROS description: on the way to the other half wrist_1 hits the upper arm. A wrist_3 that turns endlessly
#: has `ENDLESS`, ten turns each way: an angle beyond them is most likely a mistake.
LIMIT, ELBOW_LIMIT, ENDLESS = 2.0 * math.pi, math.pi, 20.0 * math.pi

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


def ur_model(name: str) -> str | None:
    """Return the model that an arm's name begins with, such as "ur5" of "ur5_calibrated" and "ur5-thesis"."""
    model = re.split("[_-]", name.lower(), maxsplit=1)[0]
    return model if model in UR_MODELS else None


def ur_speeds(name: str) -> tuple[float, ...]:
    """Largest speeds of a model's joints [rad/s]; of arms with other names the highest of all models."""
    model = ur_model(name)
    if model is not None:
        return _of_joints(UR_MODELS[model].speeds, in_degrees=True)
    return (2.0 * math.pi,) * len(JOINTS)


def set_ur_limits(robot: ET.Element, name: str) -> None:
    """Give the joints of a parsed URDF the limits, speeds and torques of a model."""
    model = UR_MODELS[name]
    turns = dict.fromkeys(JOINTS, LIMIT) | {"elbow_joint": ELBOW_LIMIT}
    if model.endless:
        turns["wrist_3_joint"] = ENDLESS
    for joint, speed, torque in zip(JOINTS, ur_speeds(name), _of_joints(model.torques), strict=True):
        set_limits(robot, joint, -turns[joint], turns[joint], velocity=speed, effort=torque)


def _of_joints(three: tuple[float, float, float], *, in_degrees: bool = False) -> tuple[float, ...]:
    """Numbers of the six joints from those of base and shoulder, elbow, and wrists."""
    base, elbow, wrist = (math.radians(each) if in_degrees else float(each) for each in three)
    return (base, base, elbow, wrist, wrist, wrist)


def nominal_robot(name: str) -> ET.Element:
    """Build the URDF of a model from its lengths and its shapes; links as in example-robot-data."""
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
    for joint, (link, xyz, rpy, axis) in zip(JOINTS, steps, strict=True):
        add_joint(robot, joint, parent, link, kind="revolute", xyz=xyz, rpy=rpy, axis=axis, limit=(0, 0, 0, 0))
        parent = link
    set_ur_limits(robot, name)
    add_joint(robot, "tool0_joint", parent, "tool0", xyz=(0, d6, 0), rpy=(-math.pi / 2, 0, 0))
    add_joint(robot, "tcp_joint", "tool0", "tcp", xyz=(0, 0, TCP_OFFSET))
    ET.indent(robot)
    return robot

"""Universal Robots arms as numbers: the lengths, shapes and masses of all models, and a URDF made from them.

Shapes are cylinders along the joints' axes and the tubes: a UR is made of joints of a few sizes and tubes between them.
The numbers are read, to the millimetre, off the maker's visual meshes (Universal_Robots_ROS2_Description 2.4.5); masses
are those of its data sheets. No meshes exist of UR8 Long, UR15 and UR18: they have the shapes of a UR20 in proportion
to their lengths.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kinreach.robots._grippers import TCP_OFFSET
from kinreach.robots._urdf import Solid, add_joint, add_link, set_limits

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


#: From, to and radius of a cylinder [m].
Span = tuple[float, float, float]


@dataclass(frozen=True)
class URShape:
    """Cylinders of a UR's links [m], and masses [kg].

    Heights are along the axis of the joint that carries the link, measured from the plane of the base's axis.

    Attributes:
        base: Along the base's axis from the floor, two of them.
        shoulder: Along the base's axis from the height of the shoulder; and how far the housing reaches to the side.
        upper_arm: At the shoulder, at the elbow, and the height and the radius of the tube.
        forearm: At the elbow, at wrist_1, and the height and the radius of the tube.
        collars: Length along the tube from the joint's axis, and radius, at the upper arm's two ends and the elbow.
        wrist_1, wrist_2: Along the own axis, ending at the middle of the next joint's housing; and along that.
        wrist_3: From the flange backwards: length and radius.
        masses: Of shoulder, upper arm, forearm and the three wrists.
    """

    base: tuple[Span, Span]
    shoulder: tuple[Span, float]
    upper_arm: tuple[Span, Span, tuple[float, float]]
    forearm: tuple[Span, Span, tuple[float, float]]
    collars: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    wrist_1: tuple[float, Span]
    wrist_2: tuple[float, Span]
    wrist_3: tuple[float, float]
    masses: tuple[float, ...]

    def scaled(self, factor: float) -> URShape:
        """Return the shape in another size; masses scale with the volume."""

        def times(value: Any, factor: float) -> Any:
            if isinstance(value, tuple):
                return tuple(times(each, factor) for each in value)
            return round(value * factor, 4)

        sizes = {name: times(value, factor) for name, value in vars(self).items()}
        return URShape(**(sizes | {"masses": times(self.masses, factor**3)}))


_UR3E = URShape(
    base=((0.0, 0.04, 0.064), (0.04, 0.095, 0.055)),
    shoulder=((-0.057, 0.047, 0.047), 0.063),
    upper_arm=((0.063, 0.177, 0.047), (0.066, 0.177, 0.039), (0.120, 0.033)),
    forearm=((-0.006, 0.069, 0.038), (-0.019, 0.077, 0.032), (0.027, 0.027)),
    collars=((0.075, 0.045), (0.065, 0.037), (0.055, 0.032)),
    wrist_1=(-0.054, (-0.050, 0.047, 0.032)),
    wrist_2=(-0.035, (-0.047, 0.050, 0.032)),
    wrist_3=(0.042, 0.032),
    masses=(1.98, 3.4445, 1.437, 0.871, 0.805, 0.261),
)
_UR5E = URShape(
    base=((0.0, 0.05, 0.075), (0.05, 0.099, 0.062)),
    shoulder=((-0.064, 0.060, 0.060), 0.074),
    upper_arm=((0.074, 0.210, 0.060), (0.060, 0.210, 0.060), (0.138, 0.043)),
    forearm=((-0.041, 0.060, 0.058), (-0.049, 0.060, 0.038), (0.007, 0.038)),
    collars=((0.088, 0.058), (0.088, 0.058), (0.088, 0.049)),
    wrist_1=(-0.074, (-0.054, 0.056, 0.039)),
    wrist_2=(-0.046, (-0.057, 0.053, 0.039)),
    wrist_3=(0.046, 0.038),
    masses=(3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
)
_UR10E = URShape(
    base=((0.0, 0.05, 0.095), (0.05, 0.099, 0.080)),
    shoulder=((-0.082, 0.076, 0.076), 0.095),
    upper_arm=((0.095, 0.269, 0.076), (0.098, 0.245, 0.060), (0.176, 0.055)),
    forearm=((-0.018, 0.100, 0.058), (-0.016, 0.106, 0.046), (0.039, 0.043)),
    collars=((0.108, 0.075), (0.085, 0.058), (0.088, 0.058)),
    wrist_1=(-0.068, (-0.067, 0.058, 0.047)),
    wrist_2=(-0.053, (-0.057, 0.068, 0.047)),
    wrist_3=(0.049, 0.045),
    masses=(7.369, 13.051, 3.989, 2.1, 1.98, 0.615),
)
_UR16E = URShape(**{**vars(_UR10E), "masses": (7.369, 10.45, 4.321, 2.18, 2.033, 0.907)})
_UR20 = URShape(
    base=((0.0, 0.05, 0.123), (0.05, 0.108, 0.102)),
    shoulder=((-0.128, 0.090, 0.090), 0.134),
    upper_arm=((0.129, 0.351, 0.091), (0.143, 0.336, 0.076), (0.258, 0.076)),
    forearm=((-0.035, 0.148, 0.076), (-0.009, 0.125, 0.051), (0.043, 0.057)),
    collars=((0.190, 0.090), (0.085, 0.076), (0.170, 0.074)),
    wrist_1=(-0.077, (-0.085, 0.052, 0.050)),
    wrist_2=(-0.075, (-0.054, 0.084, 0.050)),
    wrist_3=(0.070, 0.050),
    masses=(16.343, 29.632, 7.879, 3.054, 3.126, 0.926),
)
_UR30 = URShape(**{**vars(_UR20), "masses": (16.343, 28.542, 7.156, 3.054, 3.126, 0.926)})
#: Of the sum of d4, d5 and d6 of a UR20 that those of a UR15 are.
_UR15 = _UR20.scaled(0.9)

_UR3 = URShape(
    base=((0.0, 0.04, 0.064), (0.04, 0.086, 0.055)),
    shoulder=((-0.066, 0.046, 0.046), 0.054),
    upper_arm=((0.054, 0.177, 0.046), (0.069, 0.177, 0.039), (0.120, 0.033)),
    forearm=((0.0, 0.078, 0.038), (-0.019, 0.070, 0.032), (0.027, 0.027)),
    collars=_UR3E.collars,
    wrist_1=(-0.046, (-0.042, 0.046, 0.032)),
    wrist_2=(-0.046, (-0.048, 0.041, 0.032)),
    wrist_3=(0.041, 0.032),
    masses=(2.0, 3.42, 1.26, 0.8, 0.8, 0.35),
)
_UR5 = URShape(
    base=((0.0, 0.012, 0.075), (0.012, 0.021, 0.066)),
    shoulder=((-0.065, 0.060, 0.060), 0.071),
    upper_arm=((0.071, 0.204, 0.060), (0.071, 0.204, 0.060), (0.136, 0.050)),
    forearm=((-0.019, 0.071, 0.058), (-0.041, 0.064, 0.038), (0.0165, 0.038)),
    collars=_UR5E.collars,
    wrist_1=(-0.046, (-0.047, 0.057, 0.039)),
    wrist_2=(-0.046, (-0.057, 0.047, 0.039)),
    wrist_3=(0.034, 0.038),
    masses=(3.7, 8.393, 2.33, 1.219, 1.219, 0.1879),
)
_UR10 = URShape(
    base=((0.0, 0.02, 0.095), (0.02, 0.038, 0.090)),
    shoulder=((-0.089, 0.075, 0.075), 0.086),
    upper_arm=((0.086, 0.263, 0.075), (0.116, 0.238, 0.061), (0.176, 0.054)),
    forearm=((-0.013, 0.116, 0.060), (-0.020, 0.110, 0.046), (0.048, 0.043)),
    collars=_UR10E.collars,
    wrist_1=(-0.054, (-0.062, 0.057, 0.046)),
    wrist_2=(-0.054, (-0.057, 0.062, 0.046)),
    wrist_3=(0.031, 0.045),
    masses=(7.1, 12.7, 4.27, 2.0, 2.0, 0.365),
)

#: Shapes by model; of others see `kinreach.robots._ur.shape_of`.
UR_SHAPES = {
    "ur3": _UR3, "ur3e": _UR3E, "ur5": _UR5, "ur5e": _UR5E, "ur8long": _UR15, "ur10": _UR10, "ur10e": _UR10E,
    "ur15": _UR15, "ur16e": _UR16E, "ur18": _UR15, "ur20": _UR20, "ur30": _UR30,
}  # fmt: skip


def link_solids(shape: URShape, lengths: Sequence[float]) -> dict[str, tuple[Solid, ...]]:
    """Cylinders by link, in the frames of `kinreach.robots._ur.nominal_urdf`; the first carries the link's mass."""
    _, a2, a3, d4, d5, d6 = lengths
    low, side = shape.shoulder[0], shape.shoulder[1]
    at_shoulder, at_elbow, upper = shape.upper_arm
    from_elbow, at_wrist, fore = shape.forearm
    near, far, elbow = shape.collars
    wrist_1, across_1 = shape.wrist_1
    wrist_2, across_2 = shape.wrist_2
    length, radius = shape.wrist_3
    lower, higher, r = across_1
    return {
        "base_link": tuple(_along_z(*span) for span in shape.base),
        "shoulder_link": (_along_z(*low), _along_y(0.0, side, low[2])),
        "upper_arm_link": (
            _along_z(0.0, -a2, upper[1], y=upper[0] - d4),
            _along_y(at_shoulder[0] - d4, at_shoulder[1] - d4, at_shoulder[2]),
            _along_y(at_elbow[0] - d4, at_elbow[1] - d4, at_elbow[2], z=-a2),
            _along_z(0.0, *near, y=upper[0] - d4),
            _along_z(-a2 - far[0], -a2, far[1], y=upper[0] - d4),
        ),
        "forearm_link": (
            _along_z(0.0, -a3, fore[1], y=fore[0] - d4),
            _along_y(from_elbow[0] - d4, from_elbow[1] - d4, from_elbow[2]),
            _along_y(at_wrist[0] - d4, at_wrist[1] - d4, at_wrist[2], z=-a3),
            _along_z(0.0, *elbow, y=fore[0] - d4),
        ),
        "wrist_1_link": (_along_z(-higher, -lower, r), _along_y(wrist_1, 0.0, r)),
        "wrist_2_link": (_along_y(*across_2, z=d5), _along_z(d5 + wrist_2, d5, across_2[2])),
        "wrist_3_link": (_along_y(d6 - length, d6, radius),),
    }


def _along_z(start: float, end: float, radius: float, *, y: float = 0.0) -> Solid:
    return Solid((radius, end - start), (0.0, y, (start + end) / 2))


def _along_y(start: float, end: float, radius: float, *, z: float = 0.0) -> Solid:
    return Solid((radius, end - start), (0.0, (start + end) / 2, z), (math.pi / 2, 0.0, 0.0))

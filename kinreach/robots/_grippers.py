"""Grippers, and a parallel gripper that can be added to any URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from kinreach.robots._urdf import Solid, add_joint, add_link

#: Distance from the flange to the point between the finger tips, along the flange's z axis [m].
TCP_OFFSET = 0.20
#: Largest opening between the fingers of the parallel gripper [m].
STROKE = 0.16


@dataclass(frozen=True)
class Gripper:
    """A parallel gripper driven by one prismatic joint; the other finger mimics it.

    Attributes:
        joint: Name of the driven prismatic joint; its position is half the opening [m].
        mimic_joint: Name of the joint that follows with ratio 1.
        stroke: Largest opening between the fingers [m].
        opening: Opening in which the arm reaches [m].
        force: Largest force of the drive [N].
    """

    joint: str
    mimic_joint: str
    stroke: float
    opening: float
    force: float


#: The gripper that `add_parallel_gripper` adds.
PARALLEL_GRIPPER = Gripper("finger_left_joint", "finger_right_joint", stroke=STROKE, opening=0.10, force=120.0)
#: Its links that touch by construction.
PARALLEL_GRIPPER_PAIRS = (
    ("gripper_palm", "finger_left"),
    ("gripper_palm", "finger_right"),
    ("finger_left", "finger_right"),
)


#: Palm and rail, and masses of these and of a finger [kg].
PALM = (Solid((0.07, 0.10, 0.085), (0, 0, 0.0425)), Solid((0.03, 0.20, 0.02), (0, 0, 0.095)))
PALM_MASS, FINGER_MASS = 0.9, 0.1


def finger(y: float) -> Solid:
    """Return a finger at a distance from the flange's z axis, along its y axis [m]."""
    return Solid((0.022, 0.012, 0.105), (0, y, 0.1575))


def add_parallel_gripper(robot: ET.Element, flange: str) -> None:
    """Mount the parallel gripper on a link of a parsed URDF, in place. `PARALLEL_GRIPPER` describes it.

    It has the proportions of an OnRobot RG6, made of boxes: palm and rail, and two fingers that slide along the
    flange's y axis. The link `tcp` lies between the finger tips, 0.20 m along z from the flange.
    """
    add_link(robot, "gripper_palm", mass=PALM_MASS, solids=PALM, rgba="0.62 0.64 0.67 1")
    add_joint(robot, "gripper_joint", flange, "gripper_palm")
    gripper = PARALLEL_GRIPPER
    for side, sign, joint in (("left", 1.0, gripper.joint), ("right", -1.0, gripper.mimic_joint)):
        add_link(robot, f"finger_{side}", mass=FINGER_MASS, solids=(finger(sign * 0.006),), rgba="0.20 0.21 0.23 1")
        add_joint(
            robot,
            joint,
            "gripper_palm",
            f"finger_{side}",
            kind="prismatic",
            axis=(0, sign, 0),
            limit=(0.0, gripper.stroke / 2, gripper.force, 0.2),
            mimic=gripper.joint if side == "right" else None,
        )
    add_link(robot, "tcp")
    add_joint(robot, "tcp_joint", flange, "tcp", xyz=(0, 0, TCP_OFFSET))

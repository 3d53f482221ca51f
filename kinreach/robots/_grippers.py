"""Grippers, and a parallel gripper that can be added to any URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from kinreach._checks import check_number, shown
from kinreach.errors import InputError
from kinreach.robots._urdf import Solid, add_joint, add_link

#: Distance from the flange to the point between the finger tips, along the flange's z axis [m].
TCP_OFFSET = 0.20
#: Largest opening between the fingers of the parallel gripper [m].
STROKE = 0.16
#: Middle of the rail, and the length of a gripper whose fingers end just before it [m].
RAIL, SHORTEST = 0.095, 0.12


@dataclass(frozen=True)
class Gripper:
    """A parallel gripper driven by one prismatic joint; the other finger mimics it.

    Attributes:
        joint: Name of the driven prismatic joint; its position is half the opening [m].
        mimic_joint: Name of the joint that follows with ratio 1.
        stroke: Largest opening between the fingers [m].
        opening: Opening in which the arm reaches [m].
        force: Largest force of the drive [N].
        length: From the flange to the point between the finger tips [m]; of one that is mounted, not of one in a file.

    Raises:
        InputError: A number or a name that no gripper has.
    """

    joint: str
    mimic_joint: str
    stroke: float
    opening: float
    force: float
    length: float = TCP_OFFSET

    def __post_init__(self) -> None:
        for name in ("joint", "mimic_joint"):
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InputError(f"{name} of a gripper must be a joint's name, got {shown(getattr(self, name))}")
        if self.joint == self.mimic_joint:
            raise InputError(f"the fingers of a gripper must have two joints, got {self.joint!r} twice")
        check_number("stroke of a gripper [m]", self.stroke, above=0.0, most=1.0)
        check_number("opening of a gripper [m]", self.opening, least=0.0, most=self.stroke)
        check_number("force of a gripper [N]", self.force, above=0.0, most=1e6)
        check_number("length of a gripper [m]", self.length, least=SHORTEST, most=1.0)


#: The thesis's gripper.
PARALLEL_GRIPPER = Gripper("finger_left_joint", "finger_right_joint", stroke=STROKE, opening=0.10, force=120.0)
#: Its links that touch by construction.
PARALLEL_GRIPPER_PAIRS = (
    ("gripper_palm", "finger_left"),
    ("gripper_palm", "finger_right"),
    ("finger_left", "finger_right"),
)


#: Masses of palm and rail, and of a finger [kg].
PALM_MASS, FINGER_MASS = 0.9, 0.1


def palm(gripper: Gripper = PARALLEL_GRIPPER) -> tuple[Solid, Solid]:
    """Return palm and rail; the rail is wider than the fingers open."""
    return Solid((0.07, 0.10, 0.085), (0, 0, 0.0425)), Solid((0.03, gripper.stroke + 0.04, 0.02), (0, 0, RAIL))


def finger(y: float, gripper: Gripper = PARALLEL_GRIPPER) -> Solid:
    """Return a finger at a distance from the flange's z axis, along its y axis [m]."""
    begin, end = RAIL + 0.01, gripper.length + 0.01
    return Solid((0.022, 0.012, round(end - begin, 9)), (0, y, round(0.5 * (begin + end), 9)))


def add_parallel_gripper(robot: ET.Element, flange: str, gripper: Gripper = PARALLEL_GRIPPER) -> None:
    """Mount a parallel gripper on a link of a parsed URDF, in place.

    It has the proportions of an OnRobot RG6, made of boxes: palm and rail, and two fingers that slide along the
    flange's y axis. The link `tcp` lies between the finger tips, along z from the flange.
    """
    add_link(robot, "gripper_palm", mass=PALM_MASS, solids=palm(gripper), rgba="0.62 0.64 0.67 1")
    add_joint(robot, "gripper_joint", flange, "gripper_palm")
    for side, sign, joint in (("left", 1.0, gripper.joint), ("right", -1.0, gripper.mimic_joint)):
        add_link(
            robot, f"finger_{side}", mass=FINGER_MASS, solids=(finger(sign * 0.006, gripper),), rgba="0.20 0.21 0.23 1"
        )
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
    add_joint(robot, "tcp_joint", flange, "tcp", xyz=(0, 0, gripper.length))

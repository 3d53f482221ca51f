"""Grippers: two fingers that slide, which can be added to any URDF, or a jaw that turns beside a fixed one."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from kinreach._checks import MAX_ANGLE, Floats, check_number, shown
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

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joints, in the order of `positions`."""
        return self.joint, self.mimic_joint

    def positions(self, openings: Floats) -> Floats:
        """Return positions of the joints [m], shape (..., 2), for openings [m], shape (...,)."""
        return np.repeat(openings[..., None] / 2, 2, axis=-1)

    def openings(self, positions: Floats) -> Floats:
        """Return openings [m] for positions of the joints [m]."""
        return np.asarray(positions.sum(axis=-1))

    @property
    def sides(self) -> tuple[float, float]:
        """Distances from the tip to the fingers along its y axis and against it, open as the arm reaches [m]."""
        return self.opening / 2, self.opening / 2

    @property
    def meeting(self) -> float:
        """Where the fingers meet when they close, along the tip's y axis [m]."""
        return 0.0

    def opening_around(self, size: float) -> float:
        """Return the opening at which the fingers hold an object of a radius, or half its edge, around the tip [m]."""
        return 2.0 * size


@dataclass(frozen=True)
class JawGripper:
    """A gripper with one jaw that is fixed to its link and one that turns, as that of an SO-101.

    The opening is the distance from the fixed jaw's face to the other jaw's tip, perpendicular to that face:
    pivot + length sin(angle - ahead).

    Attributes:
        joint: Name of the revolute joint of the jaw, which opens it as the angle grows.
        tip: Name of a tip of the arm between the jaws: its z axis points ahead, and its y axis to the fixed jaw.
        stroke: Largest opening that is used [m].
        opening: Opening in which the arm reaches [m].
        torque: Largest torque of the drive [N m].
        pivot: From the face of the fixed jaw to the joint's axis [m].
        length: From the joint's axis to the tip of its jaw [m].
        ahead: Angle at which that tip is straight ahead of the axis [rad].
        least: Least angle of the joint [rad]; openings below that of this angle stop there.
        beside: From the tip to the face of the fixed jaw [m].

    Raises:
        InputError: A number or a name that no such gripper has.
    """

    joint: str
    tip: str
    stroke: float
    opening: float
    torque: float
    pivot: float
    length: float
    ahead: float
    least: float
    beside: float

    def __post_init__(self) -> None:
        for name in ("joint", "tip"):
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InputError(f"{name} of a gripper must be a name, got {shown(getattr(self, name))}")
        check_number("pivot of a gripper [m]", self.pivot, least=0.0, most=1.0)
        check_number("length of a gripper [m]", self.length, above=0.0, most=1.0)
        check_number("ahead of a gripper [rad]", self.ahead, least=-MAX_ANGLE, most=MAX_ANGLE)
        quarter = math.pi / 2
        check_number("least of a gripper [rad]", self.least, least=self.ahead - quarter, most=self.ahead + quarter)
        check_number("stroke of a gripper [m]", self.stroke, above=0.0, most=self.pivot + self.length)
        closed = max(0.0, float(self.openings(np.array([self.least]))))
        check_number("opening of a gripper [m]", self.opening, least=closed, most=self.stroke)
        check_number("torque of a gripper [N m]", self.torque, above=0.0, most=1e6)
        check_number("beside of a gripper [m]", self.beside, least=0.0, most=self.opening)

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joint."""
        return (self.joint,)

    def positions(self, openings: Floats) -> Floats:
        """Return angles of the joint [rad], shape (..., 1), for openings [m], shape (...,)."""
        sine = np.clip((openings[..., None] - self.pivot) / self.length, -1.0, 1.0)
        return np.maximum(self.ahead + np.arcsin(sine), self.least)

    def openings(self, positions: Floats) -> Floats:
        """Return openings [m] for angles of the joint [rad], shape (..., 1)."""
        return np.asarray(self.pivot + self.length * np.sin(positions[..., 0] - self.ahead))

    @property
    def sides(self) -> tuple[float, float]:
        """Distances from the tip to the jaws along its y axis and against it, open as the arm reaches [m]."""
        return self.beside, self.opening - self.beside

    @property
    def meeting(self) -> float:
        """Where the jaws meet when they close, along the tip's y axis [m]: at the fixed one."""
        return self.beside

    def opening_around(self, size: float) -> float:
        """Return the opening at which the jaws hold an object of a radius, or half its edge, around the tip [m].

        The jaw that turns is taken for the line from its axis to its tip. Where it opens by more than `pivot` it is
        inclined, and touches the object's upper edge, a `size` behind the tip: w = opening - size tan(angle - ahead).

        Raises:
            InputError: The object is wider than the jaws come open there.
        """
        width, steepest = 2.0 * size, math.acos(min(1.0, size / self.length) ** (1 / 3))
        if width <= self.pivot:
            return width
        if self._gap(steepest, size) < width:
            raise InputError(
                f"the jaws of {self.joint!r} cannot hold an object {width:g} m wide: inclined as the one that turns "
                f"is, they come open by {self._gap(steepest, size):.3f} m at its upper edge"
            )
        low, high = 0.0, steepest
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._gap(middle, size) < width else (low, middle)
        return self._gap(high, 0.0)

    def _gap(self, angle: float, behind: float) -> float:
        """Return the distance between the jaws so far behind the tip [m]; angle from straight ahead [rad]."""
        return float(self.openings(np.array([self.ahead + angle]))) - behind * math.tan(angle)


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

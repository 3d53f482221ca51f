"""The arm in a URDF: which joints lead to its tip, and defaults for what a URDF does not say."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property

from kinreach.errors import InputError, raise_unknown
from kinreach.robots.workcell import CameraMount

#: Answer of a default position servo [1/s]: stiffness is this squared times the inertia.
SERVO_RATE = 30.0
#: Largest speed [rad/s] and acceleration [rad/s^2] that are taken for a default.
MOST_SPEED, MOST_ACCELERATION = 3.0, 10.0
#: Field of view of the default `overview` camera [degrees].
OVERVIEW_FOVY = 40.0

_TURNING = ("revolute", "continuous")
_MOVING = (*_TURNING, "prismatic")


class UrdfArm:
    """The serial chain from the root of a URDF to a tip.

    Args:
        name: What error messages call the arm.
        robot: The checked URDF.
        tip: Link at the end; default is the link with the most turning, then the most joints between it and the root,
            with no sliding joint among them; of equals one without a shape, which is a mere frame.
        joints: Names of the joints of `q`; default are all that move between root and tip.
        held: Names of joints that are no part of `q`, and may move.

    Attributes:
        tip: Link at the end of the arm.
        joints: Names of the joints of `q`, from the root to the tip.

    Raises:
        InputError: There is no such link or joint, a joint is not between root and tip, or none moves there.
    """

    def __init__(
        self,
        name: str,
        robot: ET.Element,
        *,
        tip: str | None = None,
        joints: Sequence[str] | None = None,
        held: Collection[str] = (),
    ) -> None:
        self.name = name
        self._links = {link.get("name", ""): link for link in robot.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
        self._carried_by = {_end(joint, "child"): joint for joint in self._joints.values()}
        if tip is not None and tip not in self._links:
            raise_unknown(f"link of arm {name!r}", tip, self._links)
        for joint in joints or ():
            if joint not in self._joints:
                raise_unknown(f"joint of arm {name!r}", joint, self._joints)
        self.tip = tip if tip is not None else self._farthest_link()
        path = [joint.get("name", "") for joint in self._path(self.tip)]
        moving = [joint for joint in path if self._kind(joint) in _MOVING and joint not in held]
        self.joints = tuple(joint for joint in moving if not joints or joint in joints)
        if joints and self.joints != tuple(joints):
            raise InputError(
                f"arm {name!r}: joints must be some of {', '.join(moving)}, which move the tip {self.tip!r}, in this "
                f"order; got {', '.join(joints)}"
            )
        if not self.joints:
            raise InputError(f"arm {name!r}: no joint moves the tip {self.tip!r}; give tip= one of its links")
        for joint in self.joints:
            if self._kind(joint) == "prismatic" or self._joints[joint].find("mimic") is not None:
                raise InputError(f"arm {name!r}: joint {joint!r} slides or mimics another; leave it out of joints=")

    @property
    def base(self) -> str:
        """The first link, or the one that `world` carries."""
        (root,) = (link for link in self._links if link not in self._carried_by)
        carried = [_end(joint, "child") for joint in self._joints.values() if _end(joint, "parent") == root]
        return carried[0] if root == "world" and len(carried) == 1 else root

    @cached_property
    def tips(self) -> Mapping[str, str]:
        """The links that the last joint carries rigidly, and the tip first."""
        rigid = [link for link in self._links if self._moved_by(link) == self.joints[-1] and link != self.tip]
        return {link: link for link in (self.tip, *rigid)}

    @property
    def home(self) -> tuple[float, ...]:
        """The middle of each joint's range [rad]; 0 for a joint without limits."""
        limits = [self._limits(joint) for joint in self.joints]
        return tuple(0.5 * (low + high) for low, high in limits)

    @property
    def damping(self) -> tuple[float, ...]:
        """Viscous friction of each joint [N m s/rad]; 0 where the URDF gives none."""
        return tuple(self._number(joint, "dynamics", "damping") for joint in self.joints)

    @property
    def speed_limit(self) -> float:
        """The slowest joint's limit [rad/s]."""
        given = [speed for joint in self.joints if (speed := self._number(joint, "limit", "velocity")) > 0.0]
        return min([MOST_SPEED, *given])

    def acceleration_limit(self, armature: float) -> float:
        """What every joint can do with half of its torque [rad/s^2], with this rotor inertia [kg m^2]."""
        torques = [self._number(joint, "limit", "effort") for joint in self.joints]
        loads = [inertia + armature for inertia in self._inertias]
        return min([MOST_ACCELERATION, *(t / (2.0 * load) for t, load in zip(torques, loads, strict=True) if t > 0.0)])

    def position_gains(self, armature: float) -> tuple[float, ...]:
        """Stiffness with which each servo answers at `SERVO_RATE` [N m/rad], with this rotor inertia [kg m^2]."""
        return tuple(SERVO_RATE**2 * (inertia + armature) for inertia in self._inertias)

    @property
    def overview(self) -> CameraMount:
        """A camera from which the arm is seen, however it is stretched."""
        size = sum(_length(joint) for joint in self._path(self.tip))
        return CameraMount(
            "overview", "world", (1.5 * size, -1.5 * size, 0.9 * size), (0.15 * size, 0.0, 0.3 * size),
            fovy=OVERVIEW_FOVY,
        )  # fmt: skip

    @cached_property
    def _inertias(self) -> list[float]:
        """Inertia that each joint carries, stretched out: masses at their distances along the chain [kg m^2]."""
        carried = dict.fromkeys(self.joints, 0.0)
        for name, link in self._links.items():
            inertial = link.find("inertial")
            distance, mass = _length(inertial), _value(inertial, "mass", "value")
            own = max(_value(inertial, "inertia", axis) for axis in ("ixx", "iyy", "izz"))
            for joint in reversed(self._path(name)):
                if joint.get("name") in carried:
                    carried[joint.get("name", "")] += mass * distance**2 + own
                distance += _length(joint)
        return list(carried.values())

    def _farthest_link(self) -> str:
        def rank(link: str) -> tuple[int, int, bool]:
            kinds = [joint.get("type", "") for joint in self._path(link)]
            turning = -1 if "prismatic" in kinds else sum(kind in _TURNING for kind in kinds)
            return turning, len(kinds), self._links[link].find("collision") is None

        return max(self._links, key=rank)

    def _moved_by(self, link: str) -> str:
        """The last joint of `q` before a link; empty if none moves it, or if another joint moves it as well."""
        for joint in reversed(self._path(link)):
            if joint.get("type") in _MOVING:
                name = joint.get("name", "")
                return name if name in self.joints else ""
        return ""

    def _path(self, link: str) -> list[ET.Element]:
        """The joints from the root to a link."""
        path = []
        while link in self._carried_by:
            path.append(self._carried_by[link])
            link = _end(path[-1], "parent")
        return path[::-1]

    def _kind(self, joint: str) -> str:
        return self._joints[joint].get("type", "")

    def _limits(self, joint: str) -> tuple[float, float]:
        if self._kind(joint) == "continuous":
            return -math.pi, math.pi
        return self._number(joint, "limit", "lower"), self._number(joint, "limit", "upper")

    def _number(self, joint: str, tag: str, key: str) -> float:
        return _value(self._joints[joint], tag, key)


def _end(joint: ET.Element, part: str) -> str:
    element = joint.find(part)
    return "" if element is None else element.get("link", "")


def _value(element: ET.Element | None, tag: str, key: str) -> float:
    """A number in a child of an element; 0 where there is none."""
    child = None if element is None else element.find(tag)
    return 0.0 if child is None else float(child.get(key, "0"))


def _length(placed: ET.Element | None) -> float:
    """How far what has an `<origin>` is from its parent's origin [m]."""
    origin = None if placed is None else placed.find("origin")
    return 0.0 if origin is None else math.hypot(*map(float, origin.get("xyz", "0 0 0").split()))

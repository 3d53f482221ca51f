"""URDF texts: built from primitives, and checked before an engine is given one."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import NoReturn
from xml.parsers import expat

import numpy as np

from kinreach.checks import Floats, shown
from kinreach.errors import InputError
from kinreach.robots.rotations import pose


@dataclass(frozen=True)
class Solid:
    """A box (three sizes) or a cylinder (radius, length) [m], placed in its link's frame."""

    size: tuple[float, ...]
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)


def numbers(values: Sequence[float]) -> str:
    """Numbers as URDF writes them, without loss."""
    return " ".join(repr(float(v)) for v in values)


def prune(robot: ET.Element, *, tags: Sequence[str] = (), links: Sequence[str] = ()) -> None:
    """Remove all children with the given tags, and the given leaf links with their joints."""
    for child in list(robot):
        joint_child = child.find("child") if child.tag == "joint" else None
        named_link = child.tag == "link" and child.get("name") in links
        if child.tag in tags or named_link or (joint_child is not None and joint_child.get("link") in links):
            robot.remove(child)


def without_shapes(text: str, *kinds: str) -> ET.Element:
    """A URDF without the shapes of its links that are of these kinds, `"visual"` or `"collision"`."""
    robot = ET.fromstring(text)
    for link in robot.iter("link"):
        prune(link, tags=kinds)
    return robot


def named(robot: ET.Element, tag: str, name: str) -> ET.Element | None:
    """The link or joint of this name, whatever characters are in it."""
    return next((element for element in robot.findall(tag) if element.get("name") == name), None)


def link_at(joint: ET.Element, end: str) -> str:
    """Name of the link at a joint's end, `"parent"` or `"child"`; empty where none is named."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def origin_of(element: ET.Element) -> Floats:
    """Pose of a joint or a shape in its parent's frame, shape (4, 4); the unit matrix without an `<origin>`."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = ([float(v) for v in origin.get(key, "0 0 0").split()] for key in ("xyz", "rpy"))
    return pose(xyz, rpy)


def set_origin(robot: ET.Element, joint: str, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    """Place a joint's child in its parent's frame [m], roll-pitch-yaw [rad]."""
    element = named(robot, "joint", joint)
    if element is None:
        raise KeyError(joint)
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    origin.set("xyz", numbers(xyz))
    origin.set("rpy", numbers(rpy))


def set_limits(robot: ET.Element, joint: str, lower: float, upper: float) -> None:
    """Set the lower and the upper limit of a joint [rad].

    Raises:
        InputError: There is no such joint, or it is of a kind that has no limits.
    """
    element = named(robot, "joint", joint)
    limit = None if element is None or element.get("type") not in _LIMITED else element.find("limit")
    if limit is None:
        raise InputError(f"the URDF has no joint {shown(joint)} of a kind that has limits")
    limit.set("lower", repr(lower))
    limit.set("upper", repr(upper))


def add_link(robot: ET.Element, name: str, *, mass: float = 0.0, solids: Sequence[Solid] = (), rgba: str = "") -> None:
    """Add a link; its inertia is that of the first solid with the given mass [kg], spread evenly."""
    link = ET.SubElement(robot, "link", name=name)
    if mass > 0:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=numbers(solids[0].xyz), rpy=numbers(solids[0].rpy))
        ET.SubElement(inertial, "mass", value=repr(mass))
        ET.SubElement(inertial, "inertia", _inertia(mass, solids[0]))
    for kind in ("visual", "collision"):
        for index, solid in enumerate(solids):
            element = ET.SubElement(link, kind, name=f"{name}_{kind}_{index}")
            ET.SubElement(element, "origin", xyz=numbers(solid.xyz), rpy=numbers(solid.rpy))
            geometry = ET.SubElement(element, "geometry")
            if len(solid.size) == 3:
                ET.SubElement(geometry, "box", size=numbers(solid.size))
            else:
                ET.SubElement(geometry, "cylinder", radius=repr(solid.size[0]), length=repr(solid.size[1]))
            if kind == "visual" and rgba:
                material = ET.SubElement(element, "material", name=f"{name}_material")
                ET.SubElement(material, "color", rgba=rgba)


def _inertia(mass: float, solid: Solid) -> dict[str, str]:
    if len(solid.size) == 3:
        x, y, z = (s * s for s in solid.size)
        diagonal = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    else:
        r, h = solid.size
        across = mass * (3 * r * r + h * h) / 12
        diagonal = (across, across, mass * r * r / 2)
    ixx, iyy, izz = (repr(v) for v in diagonal)
    return {"ixx": ixx, "iyy": iyy, "izz": izz, "ixy": "0", "ixz": "0", "iyz": "0"}


def add_joint(
    robot: ET.Element,
    name: str,
    parent: str,
    child: str,
    *,
    kind: str = "fixed",
    xyz: Sequence[float] = (0, 0, 0),
    rpy: Sequence[float] = (0, 0, 0),
    axis: Sequence[float] | None = None,
    limit: Sequence[float] | None = None,
    mimic: str | None = None,
) -> None:
    """Add a joint; `limit` is (lower, upper, effort, velocity) in SI units, `mimic` follows with ratio 1."""
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "origin", xyz=numbers(xyz), rpy=numbers(rpy))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    if axis is not None:
        ET.SubElement(joint, "axis", xyz=numbers(axis))
    if limit is not None:
        keys = ("lower", "upper", "effort", "velocity")
        ET.SubElement(joint, "limit", dict(zip(keys, map(repr, map(float, limit)), strict=True)))
    if mimic is not None:
        ET.SubElement(joint, "mimic", joint=mimic, multiplier="1", offset="0")


#: Bounds of a URDF: characters, links, and how large a number in it may be.
MOST_CHARACTERS, MOST_LINKS, MOST_NUMBER = 2**23, 500, 1e9
#: Deepest nesting of elements, and the shortest vector that has a direction: rounding takes it from shorter ones.
MAX_DEPTH, SHORTEST_AXIS = 100, 1e-6
PACKAGE = "package://"
KINDS = ("revolute", "continuous", "prismatic", "fixed")
_MOVED = ("revolute", "continuous", "prismatic")
_LIMITED = ("revolute", "prismatic")
#: Attributes that are numbers, by element, with how many there are.
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "mimic": {"multiplier": 1, "offset": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "color": {"rgba": 4},
}
#: Numbers that must be above 0, or not below.
_POSITIVE = ("size", "radius", "length", "scale")
_NOT_NEGATIVE = ("value", "effort", "velocity", "damping", "friction")


def parse_urdf(text: object) -> ET.Element:
    """The `<robot>` element of a URDF text.

    Raises:
        InputError: It is too long or too deep, no XML or no URDF, or it has a document type.
    """
    if not isinstance(text, str) or len(text) > MOST_CHARACTERS:
        raise InputError(f"a URDF must be text of at most {MOST_CHARACTERS} characters, got {shown(text)}")
    depth = 0

    def deeper(*element: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"the URDF is nested deeper than {MAX_DEPTH} elements")

    def higher(*element: object) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = _refuse_declarations
    parser.StartElementHandler, parser.EndElementHandler = deeper, higher
    try:
        parser.Parse(text.encode(), True)
        robot = ET.fromstring(text)
    except (expat.ExpatError, ET.ParseError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the URDF is no XML: {error}") from None
    if robot.tag != "robot":
        raise InputError(f"the URDF must begin with <robot>, got <{shown(robot.tag)}>")
    return robot


def check_urdf(text: object, package_root: str | None) -> None:
    """Refuse what is no URDF of one arm, and what would make a reader open other files or take much memory.

    Args:
        text: The URDF.
        package_root: Folder that `package://` stands for; None if there is none.

    Raises:
        InputError: It is too long or no XML; it declares entities; links and joints are no tree; a number is not
            finite, too large or of the wrong sign; a lower limit is above the upper one; a mesh is outside the package.
    """
    robot = parse_urdf(text)
    _check_tree(robot)
    for element in robot.iter():
        for name, count in _NUMBERS.get(element.tag, {}).items():
            if name in element.attrib:
                _check_numbers(f"{name} of <{element.tag}>", element.attrib[name], count, name)
        if element.tag in ("mesh", "texture"):
            _check_file(element.get("filename", ""), package_root)
    for joint in robot.findall("joint"):
        _check_limits(joint)


def check_limits_complete(robot: ET.Element) -> None:
    """Refuse a joint that moves with a `<limit>` that leaves out what the engines ask for."""
    for joint in robot.findall("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in _MOVED:
            continue
        for name, what in (("effort", "largest torque [N m] or force [N]"), ("velocity", "largest speed [rad/s, m/s]")):
            if name not in limit.attrib:
                raise InputError(
                    f"joint {shown(joint.get('name'))} of the URDF has a <limit> without {name}=, its {what}; add it"
                )


def _refuse_declarations(*declared: object) -> NoReturn:
    raise InputError("a URDF must not have a document type: entities could name other files, or grow without bound")


def _check_tree(robot: ET.Element) -> None:
    """Every joint connects two links, no link hangs on two, and all hang on one: some engines leave out a loop."""
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = robot.findall("joint")
    if not 1 <= len(links) <= MOST_LINKS:
        raise InputError(f"the URDF must have 1 to {MOST_LINKS} links, got {len(links)}")
    for name, count in Counter(links).items():
        if not name.isprintable() or not name or count > 1:
            raise InputError(f"the URDF names {shown(name)} {count} times" if name else "the URDF has a nameless part")
    if not all(name and name.isprintable() for name in (joint.get("name", "") for joint in joints)):
        raise InputError("the URDF has a joint without a name that can be printed")
    if len({joint.get("name") for joint in joints}) < len(joints):
        raise InputError("the URDF has two joints of one name")
    held: set[str] = set()
    children: dict[str, list[str]] = {link: [] for link in links}
    for joint in joints:
        name, ends = shown(joint.get("name")), [link_at(joint, end) for end in ("parent", "child")]
        if not set(ends) <= set(links) or ends[1] in held:
            raise InputError(
                f"joint {name} of the URDF must connect two links, each of which hangs on one joint at most"
            )
        held.add(ends[1])
        children[ends[0]].append(ends[1])
        kind, limit, axis = joint.get("type"), joint.find("limit"), joint.find("axis")
        if kind not in KINDS or (kind in _LIMITED and limit is None):
            raise InputError(f"joint {name} of the URDF must be one of {', '.join(KINDS)}, with its limits")
        if kind in _MOVED and axis is not None and math.hypot(*_floats(axis.get("xyz", "1 0 0"))) < SHORTEST_AXIS:
            raise InputError(f"joint {name} of the URDF has an axis without direction: {shown(axis.get('xyz'))}")
    roots = [link for link in links if link not in held]
    if len(roots) != 1 or len(links) != len(joints) + 1:
        raise InputError(f"the links of the URDF must hang on one, got {len(roots)} that hang on none")
    hanging = roots[:]
    for link in hanging:  # grows until all that hang on the root were there
        hanging += children[link]
    if len(hanging) < len(links):
        loose = [link for link in links if link not in hanging]
        raise InputError(f"all links of the URDF must hang on {shown(roots[0])}, and not on a loop: {shown(loose)}")


def _check_limits(joint: ET.Element) -> None:
    """The lower limit is not above the upper one, where the kind of joint has limits; one that is left out is 0."""
    limit = joint.find("limit")
    if limit is None or joint.get("type") not in _LIMITED:
        return
    lower, upper = (float(limit.get(name, "0")) for name in ("lower", "upper"))
    if lower > upper:
        name = shown(joint.get("name"))
        raise InputError(f"joint {name} of the URDF has its lower limit above the upper one: {lower:g} > {upper:g}")


def _floats(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _check_numbers(what: str, text: str, count: int, name: str) -> None:
    values = _floats(text)
    if len(values) != count or not all(math.isfinite(value) and abs(value) <= MOST_NUMBER for value in values):
        raise InputError(f"{what} must be {count} numbers within ±{MOST_NUMBER:g}, got {shown(text)}")
    least = min(values)
    if (name in _POSITIVE and least <= 0) or (name in _NOT_NEGATIVE and least < 0):
        raise InputError(f"{what} must not be negative, and a size not zero; got {shown(text)}")


def _check_file(name: str, package_root: str | None) -> None:
    """A file is within the package: nothing else of this machine is read because a URDF says so."""
    path = PurePosixPath(name.removeprefix(PACKAGE))
    inside = name.startswith(PACKAGE) and not path.is_absolute() and ".." not in path.parts and name.isprintable()
    if package_root is None or not inside:
        raise InputError(
            f"files of a URDF must be within {PACKAGE}, and the arm must have a package; got {shown(name)}"
        )

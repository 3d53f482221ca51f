"""URDFs: built from primitives, checked before an engine reads them, and the chain of an arm in one."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import PurePosixPath
from typing import NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np

from kinreach._checks import MAX_ANGLE, Floats, check_known, shown
from kinreach._rotations import placement, rotation, rpy, turn
from kinreach.errors import InputError, raise_unknown
from kinreach.robots._workcell import CameraMount


@dataclass(frozen=True)
class Solid:
    """A box (three sizes), a cylinder (radius, length) or a sphere (radius) [m], placed in its link's frame."""

    size: tuple[float, ...]
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __repr__(self) -> str:
        return repr((self.size, self.xyz, self.rpy))


def numbers(values: Sequence[float]) -> str:
    """Write numbers as in a URDF, without loss."""
    return " ".join(repr(float(v)) for v in values)


def prune(robot: ET.Element, *, tags: Sequence[str] = (), links: Sequence[str] = ()) -> None:
    """Remove all children with the given tags, and the given leaf links with their joints."""
    for child in list(robot):
        joint_child = child.find("child") if child.tag == "joint" else None
        named_link = child.tag == "link" and child.get("name") in links
        if child.tag in tags or named_link or (joint_child is not None and joint_child.get("link") in links):
            robot.remove(child)


def without_shapes(robot: ET.Element, *kinds: str) -> ET.Element:
    """Return a copy of a URDF without the shapes of its links that are of these kinds, `"visual"` or `"collision"`."""
    robot = deepcopy(robot)
    for link in robot.iter("link"):
        prune(link, tags=kinds)
    return robot


def named(robot: ET.Element, tag: str, name: str) -> ET.Element | None:
    """Find a link or joint by its name, which may have any characters."""
    return next((element for element in robot.findall(tag) if element.get("name") == name), None)


def link_at(joint: ET.Element, end: str) -> str:
    """Return the name of the link at a joint's end, `"parent"` or `"child"`; empty where none is named."""
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def links_below(robot: ET.Element, link: str) -> list[str]:
    """Return the names of all links that a link carries, without its own."""
    found = [link]
    for parent in found:  # which grows
        found += [link_at(joint, "child") for joint in robot.findall("joint") if link_at(joint, "parent") == parent]
    return found[1:]


def joints_above(robot: ET.Element) -> dict[str, ET.Element]:
    """Return the joint that carries each link, by the link's name; the root has none."""
    return {link_at(joint, "child"): joint for joint in robot.findall("joint")}


def way_down(above: Mapping[str, ET.Element], link: str) -> list[ET.Element]:
    """Return the joints between a link and the root of a tree, that of the link first; of `joints_above`."""
    way = []
    while link in above:
        way.append(above[link])
        link = link_at(way[-1], "parent")
    return way


def is_only_way_on(robot: ET.Element, joint: ET.Element) -> bool:
    """Whether what carries a joint carries nothing else: no other joint that moves, and no frame beside the way."""
    above = joints_above(robot)
    body, way = [link_at(joint, "parent")], {link_at(joint, "parent")}
    for carrier in way_down(above, body[0]):
        way.add(link_at(carrier, "parent"))
        if carrier.get("type") == "fixed" and body[0] == link_at(carrier, "child"):
            body[0] = link_at(carrier, "parent")
    below = [each for each in robot.findall("joint") if each is not joint]
    for link in body:  # which grows
        here = [each for each in below if link_at(each, "parent") == link]
        if any(each.get("type") != "fixed" and link_at(each, "child") not in way for each in here):
            return False
        body += [link_at(each, "child") for each in here if each.get("type") == "fixed"]
    return way.issuperset(body)


def link_before(robot: ET.Element, link: str) -> str:
    """Return the name of the link before the last joint that moves a link; empty if none does."""
    way = way_down(joints_above(robot), link)
    return next((link_at(joint, "parent") for joint in way if joint.get("type") != "fixed"), "")


def neighbours(robot: ET.Element) -> list[tuple[str, str]]:
    """Return pairs of links with shapes on either side of a joint that moves; links without shapes do not count."""
    shaped = {link.get("name", "") for link in robot.findall("link") if link.find("collision") is not None}
    above, pairs = joints_above(robot), []
    for child in sorted(shaped & set(above)):
        link, moves = child, False
        while link in above and (link == child or link not in shaped):
            moves |= above[link].get("type") != "fixed"
            link = link_at(above[link], "parent")
        if moves and link in shaped:
            pairs.append((min(link, child), max(link, child)))
    return pairs


def origin_of(element: ET.Element) -> Floats:
    """Return the pose of a joint or a shape in its parent's frame (4, 4); the unit matrix without an `<origin>`."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = ([float(v) for v in origin.get(key, "0 0 0").split()] for key in ("xyz", "rpy"))
    return placement(xyz, rpy)


def set_origin(robot: ET.Element, joint: str, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    """Place a joint's child in its parent's frame [m], roll-pitch-yaw [rad]."""
    element = next(each for each in robot.findall("joint") if each.get("name") == joint)
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    origin.set("xyz", numbers(xyz))
    origin.set("rpy", numbers(rpy))


def set_limits(robot: ET.Element, joint: str, lower: float, upper: float, **others: float) -> None:
    """Set a joint's limits [rad, m], and others by their names in URDF: velocity and effort in SI units.

    A joint that turns without end is a revolute one from then on.
    """
    element = named(robot, "joint", joint)
    if element is None or element.get("type") not in MOVED:
        raise InputError(f"the URDF has no joint {shown(joint)} of a kind that has limits")
    limit = limit_of(element)
    if element.get("type") == ENDLESS:
        element.set("type", "revolute")
    limit.attrib.update({key: repr(value) for key, value in {"lower": lower, "upper": upper, **others}.items()})


def limit_of(joint: ET.Element) -> ET.Element:
    """Return the `<limit>` of a joint that moves; one without is given it, with no torque and no speed known."""
    limit = joint.find("limit")
    return ET.SubElement(joint, "limit", effort="0", velocity=repr(MAX_SPEED)) if limit is None else limit


def endless_joints(robot: ET.Element) -> list[str]:
    """Return the names of the joints that turn without end."""
    return [joint.get("name", "") for joint in robot.findall("joint") if joint.get("type") == ENDLESS]


def sliding_joints(robot: ET.Element) -> list[str]:
    """Return the names of the joints that slide."""
    return [joint.get("name", "") for joint in robot.findall("joint") if joint.get("type") == "prismatic"]


def following_joints(robot: ET.Element) -> dict[str, Follows]:
    """Return the joints of a checked URDF that follow another, by their names, and how."""
    moving = [joint for joint in robot.findall("joint") if joint.get("type") in MOVED]
    names = [joint.get("name", "") for joint in moving if joint.find("mimic") is not None]
    return {name: followed("", robot, name) for name in names}


def one_number_each(robot: ET.Element) -> ET.Element:
    """Return a URDF in which joints that turn without end are revolute, with limits that no posture reaches.

    Pinocchio and placo then have an angle for such a joint, not its cosine and sine.
    """
    names = endless_joints(robot)
    if not names:
        return robot
    robot = deepcopy(robot)
    for name in names:
        set_limits(robot, name, -MAX_ANGLE, MAX_ANGLE)
    return robot


def without_offsets(robot: ET.Element) -> ET.Element:
    """Return a URDF in which joints that follow others are where these are times their factor, without an offset."""
    shifted = {name: follows.offset for name, follows in following_joints(robot).items() if follows.offset != 0.0}
    if not shifted:
        return robot
    robot = deepcopy(robot)
    for name, offset in shifted.items():
        joint = named(robot, "joint", name)
        mimic = None if joint is None else joint.find("mimic")
        if joint is None or mimic is None:
            continue
        place_origin(joint, offset)
        mimic.set("offset", "0")
        lower, upper = limits_of(joint)
        if math.isfinite(upper - lower):
            set_limits(robot, name, lower - offset, upper - offset)
    return robot


def place_origin(joint: ET.Element, place: float) -> None:
    """Put the origin of a joint where it is moved to by a place [rad, m]."""
    axis, origin = joint.find("axis"), joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    direction = np.array([float(v) for v in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()])
    direction /= np.linalg.norm(direction)
    xyz = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
    R = rotation([float(v) for v in origin.get("rpy", "0 0 0").split()])
    if joint.get("type") == "prismatic":
        origin.set("xyz", numbers(xyz + place * R @ direction))
    else:
        origin.set("rpy", numbers(rpy(R @ turn(direction, place))))


def add_link(
    robot: ET.Element,
    name: str,
    *,
    mass: float = 0.0,
    centre: Sequence[float] | None = None,
    solids: Sequence[Solid] = (),
    rgba: str = "",
) -> ET.Element:
    """Add a link with a mass [kg], which is spread evenly in the first solid, a cube of 5 cm without any."""
    link = ET.SubElement(robot, "link", name=name)
    if mass > 0:
        solid = solids[0] if solids else Solid((0.05, 0.05, 0.05))
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=numbers(solid.xyz if centre is None else centre), rpy=numbers(solid.rpy))
        ET.SubElement(inertial, "mass", value=repr(mass))
        ET.SubElement(inertial, "inertia", _inertia(mass, solid))
    for kind in ("visual", "collision"):
        for index, solid in enumerate(solids):
            element = ET.SubElement(link, kind, name=f"{name}_{kind}_{index}")
            ET.SubElement(element, "origin", xyz=numbers(solid.xyz), rpy=numbers(solid.rpy))
            geometry = ET.SubElement(element, "geometry")
            if len(solid.size) == 3:
                ET.SubElement(geometry, "box", size=numbers(solid.size))
            elif len(solid.size) == 1:
                ET.SubElement(geometry, "sphere", radius=repr(solid.size[0]))
            else:
                ET.SubElement(geometry, "cylinder", radius=repr(solid.size[0]), length=repr(solid.size[1]))
            if kind == "visual" and rgba:
                material = ET.SubElement(element, "material", name=f"{name}_material")
                ET.SubElement(material, "color", rgba=rgba)
    return link


def _inertia(mass: float, solid: Solid) -> dict[str, str]:
    if len(solid.size) == 3:
        x, y, z = (s * s for s in solid.size)
        diagonal = (mass * (y + z) / 12, mass * (x + z) / 12, mass * (x + y) / 12)
    elif len(solid.size) == 1:
        diagonal = (0.4 * mass * solid.size[0] ** 2,) * 3
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
) -> ET.Element:
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
    return joint


def skeleton(robot: ET.Element, tip: str) -> tuple[str, str]:
    """Return a URDF's text without shapes, and so without files, and the link that is the tip in it.

    Some engines, such as placo, find links and joints by one name: where a joint has the tip's, a link in the same
    place is the tip. They have one number for each joint (`one_number_each`), also for those that follow
    others, without an offset.
    """
    robot = without_offsets(one_number_each(without_shapes(robot, "visual", "collision")))
    if named(robot, "joint", tip) is not None:
        add_link(robot, f"{tip} (link)")
        add_joint(robot, f"{tip} (link) mount", tip, f"{tip} (link)")
        tip = f"{tip} (link)"
    return ET.tostring(robot, encoding="unicode"), tip


#: Bounds of a URDF: characters, links, and how large a number in it may be.
MAX_CHARACTERS, MAX_LINKS, MAX_NUMBER = 2**23, 500, 1e9
#: Deepest nesting of elements, and the shortest axis.
MAX_DEPTH, MIN_AXIS = 100, 1e-6
PACKAGE = "package://"
WORLD = "world"
#: Mesh files that a URDF may name, by their ends.
MESHES = (".stl", ".obj", ".dae", ".glb")
#: Kind of joint that turns without end.
ENDLESS = "continuous"
KINDS = ("revolute", ENDLESS, "prismatic", "fixed")
TURNING = ("revolute", ENDLESS)
MOVED = (*TURNING, "prismatic")
_LIMITED = ("revolute", "prismatic")
#: Parts of the names of a gripper's joints, and of its fingers'.
_GRIPPER = re.compile("gripper|finger|jaw|knuckle|thumb", re.IGNORECASE)
_FINGER = re.compile("finger|jaw|knuckle|thumb", re.IGNORECASE)
#: Parts of the names of links of cameras, of other sensors, and of flanges and tools.
_CAMERAS = (
    r"camera|(?<![a-z])cam(?![a-z])|optical|realsense|kinect|(?<![a-z])zed(?![a-z])|(?<![a-z])d4\d\d|depth|rgb|infra"
)
_CAMERA = re.compile(_CAMERAS, re.IGNORECASE)
_SENSOR = re.compile(rf"{_CAMERAS}|sensor|lidar|(?<![a-z])(?:laser|imu|sonar|scan)(?![a-z])|scanner", re.IGNORECASE)
_TOOL = re.compile(r"tool|flange|end.?effector|(?<![a-z])(?:tcp|eef?|hand|gripper|grasp)(?![a-z])", re.IGNORECASE)
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
_POSITIVE = ("size", "radius", "length")
_NOT_NEGATIVE = ("value", "effort", "velocity", "damping", "friction")


#: What to do about a file of Gazebo.
SDF = (
    "Gazebo's SDF, which is not read: take the URDF or xacro that it was made from, or make an MJCF of it with "
    "`sdf2mjcf FILE.sdf FILE.xml`, which is part of Gazebo's gz-mujoco"
)
#: The element that a URDF begins with, and formats of robots by that of others.
ROBOT = "robot"
_OTHER_FORMATS = {
    "mujoco": "MuJoCo's MJCF",
    "sdf": SDF,
    "COLLADA": "a COLLADA mesh",
    "launch": "a launch file of ROS",
    "package": "a package.xml of ROS",
}


def parse_urdf(text: object) -> ET.Element:
    """Return the `<robot>` element of a URDF text, in which every prefix is declared."""
    return parse_xml(text, tags=(ROBOT,))


def parse_xml(text: object, *, tags: Sequence[str], prefixed: bool = False) -> ET.Element:
    """Return the first element of a text, which has one of these tags.

    With `prefixed`, a prefix is part of a name and needs no declaration, as in urdfdom: `<xacro:property>` has the tag
    `"xacro:property"`.
    """
    if not isinstance(text, str) or len(text) > MAX_CHARACTERS:
        raise InputError(f"a URDF must be text of at most {MAX_CHARACTERS} characters, got {shown(text)}")
    depth, builder = 0, ET.TreeBuilder()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"the URDF is nested deeper than {MAX_DEPTH} elements")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser = expat.ParserCreate("utf-8")  # whatever the text says that its file is encoded in
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = _refuse_entities if prefixed else _refuse_declarations
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.encode(), True)
        root = builder.close() if prefixed else ET.fromstring(text)
    except (expat.ExpatError, ET.ParseError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the URDF is not XML: {error}") from None
    if root.tag not in tags:
        other = _OTHER_FORMATS.get(root.tag)
        is_other = f": this is {other}" if other else ""
        starts = " or ".join(f"<{tag}>" for tag in tags)
        raise InputError(f"the file must begin with {starts}, got <{shown(root.tag)}>{is_other}")
    return root


class CheckedUrdf:
    """A URDF that was checked, or made from one that was, and its text. Called, it returns the text.

    Attributes:
        robot: The `<robot>` element; only to be read, as many arms may share it.
    """

    def __init__(self, robot: ET.Element, text: str | None = None) -> None:
        self.robot, self._text = robot, text

    @classmethod
    def of(cls, name: str, urdf: object, package_root: str | None) -> CheckedUrdf:
        """Check the URDF of an arm with this name, its text or its element.

        Raises:
            InputError: As `check_urdf`; a joint that moves has a `<limit>` without the numbers that engines need; or
                the link `world` hangs on another.
        """
        robot = check_urdf(urdf, package_root)
        check_limits_complete(robot)
        if any(link_at(joint, "child") == WORLD for joint in robot.findall("joint")):
            raise InputError(f"arm {name!r}: the link {WORLD!r} must carry all others, and hang on none")
        return cls(robot, urdf if isinstance(urdf, str) else None)

    def copy(self) -> ET.Element:
        """Return the element, to be changed."""
        return deepcopy(self.robot)

    def __call__(self) -> str:
        if self._text is None:
            self._text = ET.tostring(self.robot, encoding="unicode")
        return self._text


def check_urdf(urdf: object, package_root: str | None) -> ET.Element:
    """Refuse what is not a URDF of one arm, and what would make a reader open other files or take much memory.

    Returns the `<robot>` element of a URDF that is text, or the given one.
    """
    robot = urdf if isinstance(urdf, ET.Element) else parse_urdf(urdf)
    check_parts(robot, package_root)
    for joint in robot.findall("joint"):
        _check_limits(joint)
    return robot


def check_parts(robot: ET.Element, package_root: str | None, *, kinds: Collection[str] = KINDS) -> None:
    """As `check_urdf`, without the order of the joints' limits, and for joints of these kinds."""
    for part in (robot, *robot):
        where = f", in {part.tag} {shown(part.get('name'))}" if part.tag in ("link", "joint") else ""
        for element in [robot] if part is robot else part.iter():
            for name, count in _NUMBERS.get(element.tag, {}).items():
                if name in element.attrib:
                    _check_numbers(f"{name} of <{element.tag}>", element.attrib[name], count, name, where)
            if element.tag in ("mesh", "texture"):
                _check_file(element.get("filename", ""), package_root)
    _check_tree(robot, kinds)


def check_limits_complete(robot: ET.Element) -> None:
    """Refuse a joint that moves and has a `<limit>` without the numbers that the engines need."""
    for joint in robot.findall("joint"):
        limit = joint.find("limit")
        if limit is None or joint.get("type") not in MOVED:
            continue
        for name, what in (("effort", "largest torque [N m] or force [N]"), ("velocity", "largest speed [rad/s, m/s]")):
            if name not in limit.attrib:
                raise InputError(
                    f"joint {shown(joint.get('name'))} of the URDF has a <limit> without {name}=, its {what}; add it"
                )


def _refuse_declarations(*declared: object) -> NoReturn:
    raise InputError("a URDF must not have a document type: entities could name other files, or grow without bound")


def _refuse_entities(name: str, *subsets: object) -> None:
    """Refuse a document type that has more than the name of the first element."""
    if any(subsets):
        _refuse_declarations()


def _check_tree(robot: ET.Element, kinds: Collection[str]) -> None:
    """Refuse links and joints that are not a tree: some engines leave out a loop."""
    links = [link.get("name", "") for link in robot.findall("link")]
    joints = robot.findall("joint")
    if not 1 <= len(links) <= MAX_LINKS:
        raise InputError(f"the URDF must have 1 to {MAX_LINKS} links, got {len(links)}")
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
        kind, limit, axis = joint.get("type", ""), joint.find("limit"), joint.find("axis")
        if kind not in kinds:
            raise InputError(f"joint {name} of the URDF must be one of {', '.join(KINDS)}, got {shown(kind)}")
        if kind in _LIMITED and limit is None:
            without = "; one that turns without end is continuous" if kind in TURNING else ""
            raise InputError(f"joint {name} of the URDF is {kind} and has no <limit>, which it must have{without}")
        if kind in MOVED and axis is not None and math.hypot(*floats_in(axis.get("xyz", ""))) < MIN_AXIS:
            raise InputError(f"joint {name} of the URDF has an axis without direction: {shown(axis.get('xyz', ''))}")
    roots = [link for link in links if link not in held]
    if len(roots) != 1 or len(links) != len(joints) + 1:
        raise InputError(f"the links of the URDF must hang on one, got {len(roots)} that hang on none")
    hanging = roots[:]
    for link in hanging:  # grows until it has all that hang on the root
        hanging += children[link]
    if len(hanging) < len(links):
        loose = [link for link in links if link not in hanging]
        raise InputError(f"all links of the URDF must hang on {shown(roots[0])}, and not on a loop: {shown(loose)}")


def _check_limits(joint: ET.Element) -> None:
    """Refuse a lower limit above the upper one; a missing one is 0."""
    lower, upper = limits_of(joint)
    if joint.get("type") in _LIMITED and lower > upper:
        name = shown(joint.get("name"))
        raise InputError(f"joint {name} of the URDF has its lower limit above the upper one: {lower:g} > {upper:g}")


def floats_in(text: str) -> list[float]:
    """Return the numbers of a text; none if it has something else."""
    try:
        # Python takes 1_000 for a number, and digits of other scripts
        return [] if "_" in text or not text.isascii() else [float(word) for word in text.split()]
    except ValueError:
        return []


def _check_numbers(what: str, text: str, count: int, name: str, where: str) -> None:
    values = floats_in(text)
    if len(values) != count or not all(math.isfinite(value) and abs(value) <= MAX_NUMBER for value in values):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise InputError(f"{what} must be {wanted} within ±{MAX_NUMBER:g}, got {shown(text)}{where}")
    least = min(values)
    if name == "scale" and 0.0 in values:
        raise InputError(f"{what} must not be zero, got {shown(text)}{where}")
    if (name in _POSITIVE and least <= 0) or (name in _NOT_NEGATIVE and least < 0):
        raise InputError(f"{what} must not be negative, and a size not zero; got {shown(text)}{where}")


def _check_file(name: str, package_root: str | None) -> None:
    path = PurePosixPath(name.removeprefix(PACKAGE))
    inside = name.startswith(PACKAGE) and not path.is_absolute() and ".." not in path.parts and name.isprintable()
    if package_root is None or not inside:
        raise InputError(
            f"files of a URDF must be within {PACKAGE}, and the arm must have a package; got {shown(name)}"
        )


#: A slide beyond so many joints that turn is a tool's, and one under so many is a rail.
FEWEST_TURNING = 4
#: Answer of a default position servo [1/s]: stiffness is this squared times the inertia.
SERVO_RATE = 30.0
#: Largest default speed [rad/s] and acceleration [rad/s^2].
MAX_SPEED, MAX_ACCELERATION = 3.0, 10.0
#: Branches that an error message names.
MAX_NAMED = 6
#: How far a start posture may be beyond a limit [rad]: URDFs write pi with few digits.
LIMIT_DIGITS = 1e-5


class UrdfArm:
    """The serial chain from the root of a URDF to a tip.

    Args:
        name: What error messages call the arm.
        robot: The checked URDF.
        tip: Link at the end; default is the link with the most joints of an arm, then the most joints between it and
            the root, and no sensor's; of equals one without a shape, which is a mere frame. An arm's are those that
            move, follow no other, and are no tool's: slides beyond four or more that turn, or beside a flange.
        joints: Names of the joints of `q`; default are all that move between root and tip and follow no other.
        held: Names of joints that are not part of `q`, and may move.

    Attributes:
        tip: Link at the end of the arm.
        joints: Names of the joints of `q`, from the root to the tip.
        followers: The joints between root and tip that follow one of `q`, by their names.
        limits: Lower and upper limit of each joint of `q` [rad, m], within which those that follow it are within
            theirs; infinite for one that turns without end.
        passed_over: Link that would be the default tip if it were not a sensor's; empty if there is none.
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
        self.name, self._robot = name, robot
        self._links = {link.get("name", ""): link for link in robot.findall("link")}
        self._joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
        self._carried_by = joints_above(robot)
        if tip is not None and tip not in self._links:
            raise_unknown(f"link of arm {name!r}", tip, self._links)
        for joint in joints or ():
            if joint not in self._joints:
                raise_unknown(f"joint of arm {name!r}", joint, self._joints)
        self.passed_over = ""
        self.tip = tip if tip is not None else self._farthest_link(held)
        path = [joint.get("name", "") for joint in self.path]
        self._moving = [joint for joint in path if self._kind(joint) in MOVED and joint not in held]
        self.followers = followers_on_way(name, robot, self._moving, held)
        moving = [joint for joint in self._moving if joint not in self.followers]
        self.joints = tuple(joint for joint in moving if not joints or joint in joints)
        if joints and self.joints != tuple(joints):
            raise InputError(
                f"arm {name!r}: joints must be some of {', '.join(moving)}, which move the tip {self.tip!r}, in this "
                f"order; got {', '.join(joints)}"
            )
        if not self.joints:
            raise InputError(f"arm {name!r}: no joint moves the tip {self.tip!r}; give tip= one of its links")
        self.limits = [self._limits_with_followers(joint) for joint in self.joints]
        for joint, (lower, upper) in zip(self.joints, self.limits, strict=True):
            unit = unit_of(self._joints[joint])
            if lower == upper:
                raise InputError(
                    f"arm {name!r}: joint {joint!r} cannot move, its limits are {lower:g} and {upper:g} {unit}; a URDF "
                    f"that leaves lower or upper out means 0. Give it limits, or hold it with held={{{joint!r}: "
                    f"{lower:g}}}"
                )

    def _limits_with_followers(self, joint: str) -> tuple[float, float]:
        lower, upper = limits_of(self._joints[joint])
        for name, follows in self.followers.items():
            if follows.joint == joint:
                low, high = follows.limits_of_leader(*limits_of(self._joints[name]))
                lower, upper = max(lower, low), min(upper, high)
                if lower >= upper:
                    raise InputError(
                        f"arm {self.name!r}: joint {name!r}, which follows {joint!r}, cannot be within its limits"
                    )
        return lower, upper

    @property
    def base(self) -> str:
        """The first link, or the only one that `world` carries, fixed."""
        return base_of(self._robot)

    @property
    def path(self) -> list[ET.Element]:
        """The joints from the root to the tip."""
        return self._path(self.tip)

    @cached_property
    def tips(self) -> Mapping[str, str]:
        """The links that the last joint carries rigidly, and the tip first."""
        last = next(joint for joint in reversed(self._moving) if joint in (*self.joints, *self.followers))
        rigid = [link for link in self._links if self._moved_by(link) == last and link != self.tip]
        return {link: link for link in (self.tip, *rigid)}

    @property
    def home(self) -> tuple[float, ...]:
        """The middle of each joint's range [rad]; 0 for a joint without limits."""
        return tuple(0.5 * (low + high) if math.isfinite(high - low) else 0.0 for low, high in self.limits)

    @property
    def damping(self) -> tuple[float, ...]:
        """Viscous friction of each joint [N m s/rad, N s/m]; 0 where the URDF gives none."""
        return tuple(self._number(joint, "dynamics", "damping") for joint in self.joints)

    @property
    def speed_limit(self) -> float:
        """The slowest joint's limit [rad/s, m/s]."""
        given = [speed for joint in self.joints if (speed := self._number(joint, "limit", "velocity")) > 0.0]
        return min([MAX_SPEED, *given])

    def acceleration_limit(self, armature: float) -> float:
        """Return what every joint reaches with half of its torque or force [rad/s^2, m/s^2].

        Armature is the inertia of its rotor [kg m^2, kg].
        """
        torques = [self._number(joint, "limit", "effort") for joint in self.joints]
        loads = [inertia + armature for inertia in self._inertias]
        return min([MAX_ACCELERATION, *(t / (2.0 * load) for t, load in zip(torques, loads, strict=True) if t > 0.0)])

    def position_gains(self, armature: float) -> tuple[float, ...]:
        """Return the stiffness of servos that answer at `SERVO_RATE` [N m/rad, N/m].

        Armature is the inertia of their rotors [kg m^2, kg].
        """
        return tuple(SERVO_RATE**2 * (inertia + armature) for inertia in self._inertias)

    @property
    def overview(self) -> CameraMount:
        """A camera from which the arm is seen, however it is stretched."""
        size = sum(_length(joint) for joint in self._path(self.tip)) or 1.0
        return CameraMount(
            "overview", "world", (1.5 * size, -1.5 * size, 0.9 * size), (0.15 * size, 0.0, 0.3 * size),
            fovy=40.0,
        )  # fmt: skip

    @cached_property
    def _inertias(self) -> list[float]:
        """Inertia that each joint carries when the arm is stretched out [kg m^2]; of a slide the mass [kg]."""
        carried = dict.fromkeys(self.joints, 0.0)
        for name, link in self._links.items():
            inertial = link.find("inertial")
            distance, mass = _length(inertial), _value(inertial, "mass", "value")
            own = max(_value(inertial, "inertia", axis) for axis in ("ixx", "iyy", "izz"))
            for joint in reversed(self._path(name)):
                if joint.get("name") in carried:
                    turned = mass if joint.get("type") == "prismatic" else mass * distance**2 + own
                    carried[joint.get("name", "")] += turned
                distance += _length(joint)
        return list(carried.values())

    def _farthest_link(self, held: Collection[str]) -> str:
        def own(link: str, *, slides: bool) -> list[ET.Element]:
            """Joints of an arm on the way to a link; with `slides`, those at the end of few others that turn, too."""
            moving = [joint for joint in self._path(link) if self._leads(joint, held)]
            turning = [joint for joint in moving if joint.get("type") in TURNING]
            if not turning:
                return moving
            first = moving.index(turning[-1]) + 1
            few = slides and len(turning) < FEWEST_TURNING
            return (
                moving if few and all(is_only_way_on(self._robot, each) for each in moving[first:]) else moving[:first]
            )

        def rank(link: str, *, slides: bool) -> tuple[int, bool, bool, int, bool]:
            path, arm = self._path(link), own(link, slides=slides)
            last = path.index(arm[-1]) if arm else -1
            beyond = [joint for joint in path[last + 1 :] if not self._is_coupled(joint, arm, held)]
            finger = any(joint.get("name") in held or _is_finger(joint) for joint in beyond)
            finger &= last < 0 or not _is_finger(path[last])  # else the robot is a finger
            finger |= any(joint.get("type") == "prismatic" for joint in beyond)
            sensor = self._is_of_a_sensor(link)
            return len(arm), not finger, not sensor, len(path), self._links[link].find("collision") is None

        for slides in (True, False):
            ranks = {link: rank(link, slides=slides) for link in self._links}
            farthest = max(self._links, key=lambda link: ranks[link])
            count = ranks[farthest][0]
            ends = {
                own(link, slides=slides)[-1].get("name") if count else "": link
                for link in self._links
                if ranks[link][0] == count
            }
            if len(ends) == 1:
                break
        else:
            raise InputError(
                f"arm {self.name!r} has {len(ends)} branches of {count} joints, which end in "
                f"{', '.join(list(ends.values())[:MAX_NAMED])}{', ...' * (len(ends) > MAX_NAMED)}; say with tip= "
                "which one is meant"
            )
        others = max(self._links, key=lambda link: (*ranks[link][:2], *ranks[link][3:]))
        self.passed_over = others if self._is_of_a_sensor(others) and not self._is_of_a_sensor(farthest) else ""
        return farthest

    def _is_of_a_sensor(self, link: str) -> bool:
        """Whether a link is a sensor's by its name, or a frame on a camera, and not called like a tool."""
        rigid = [link]
        for joint in reversed(self._path(link)):
            if joint.get("type") != "fixed":
                break
            rigid.append(link_at(joint, "parent"))
        named_so = _SENSOR.search(link) or any(_CAMERA.search(carrier) for carrier in rigid[1:])
        return bool(named_so) and not _TOOL.search(link)

    def _leads(self, joint: ET.Element, held: Collection[str]) -> bool:
        """Whether a joint moves, is not held, and follows no other."""
        return joint.get("type") in MOVED and joint.get("name") not in held and joint.find("mimic") is None

    def _is_coupled(self, joint: ET.Element, arm: Sequence[ET.Element], held: Collection[str]) -> bool:
        """Whether a joint follows one of an arm's."""
        name = joint.get("name", "")
        if joint.get("type") not in MOVED or joint.find("mimic") is None or name in held:
            return False
        return self._joints[followed(self.name, self._robot, name).joint] in arm

    def _moved_by(self, link: str) -> str:
        """The last joint that moves a link; empty if none does."""
        return next((joint.get("name", "") for joint in reversed(self._path(link)) if joint.get("type") in MOVED), "")

    def _path(self, link: str) -> list[ET.Element]:
        """The joints from the root to a link."""
        return way_down(self._carried_by, link)[::-1]

    def _kind(self, joint: str) -> str:
        return self._joints[joint].get("type", "")

    def _number(self, joint: str, tag: str, key: str) -> float:
        return _value(self._joints[joint], tag, key)


class Follows(NamedTuple):
    """How a joint follows another: `factor` times that, plus `offset` [rad, m]."""

    joint: str
    factor: float
    offset: float

    def limits_of_leader(self, lower: float, upper: float) -> tuple[float, float]:
        """Return the limits of the other within which this one is within its own."""
        ends = sorted(((lower - self.offset) / self.factor, (upper - self.offset) / self.factor))
        return ends[0], ends[1]


def followed(name: str, robot: ET.Element, joint: str) -> Follows:
    """Return which joint one follows, over others, and how; itself if it follows none."""
    joints = {each.get("name", ""): each for each in robot.findall("joint")}
    found, seen = Follows(joint, 1.0, 0.0), {joint}
    while (mimic := joints[found.joint].find("mimic")) is not None:
        leader, values = mimic.get("joint", ""), []
        if leader not in joints or leader in seen:
            what = "which follows it" if leader in seen else "which is not in the URDF"
            raise InputError(f"arm {name!r}: joint {found.joint!r} mimics {shown(leader)}, {what}")
        for key, default in (("multiplier", "1"), ("offset", "0")):
            values += floats_in(mimic.get(key, default)) or [math.nan]
        if len(values) != 2 or not all(map(math.isfinite, values)):
            raise InputError(f"joint {found.joint!r} of the URDF has a <mimic> with what is no number")
        seen.add(leader)
        found = Follows(leader, found.factor * values[0], found.factor * values[1] + found.offset)
    return found


def followers_on_way(name: str, robot: ET.Element, moving: Sequence[str], held: Collection[str]) -> dict[str, Follows]:
    """Return the joints on the way to a tip that follow one before them, by their names, and how.

    Of joints that move together, the first on the way is one of `q`, and the others follow it, whichever mimics which.
    """
    firsts: dict[str, Follows] = {}
    found = {}
    for joint in moving:
        follows = followed(name, robot, joint)
        if follows.joint in held and follows.joint != joint:
            continue
        if follows.factor == 0.0:
            place = f"{{{joint!r}: {follows.offset:g}}}"
            raise InputError(
                f"arm {name!r}: joint {joint!r} mimics {follows.joint!r} times 0, and does not move; hold it with "
                f"held={place}"
            )
        first = firsts.get(follows.joint)
        if first is None:
            firsts[follows.joint] = Follows(joint, follows.factor, follows.offset)
        else:
            factor = follows.factor / first.factor
            found[joint] = Follows(first.joint, factor, follows.offset - factor * first.offset)
    return found


def set_follows(robot: ET.Element, joint: str, follows: Follows | None) -> None:
    """Write how a joint follows another into its `<mimic>`; None takes that out."""
    element = named(robot, "joint", joint)
    if element is None:
        return
    for mimic in element.findall("mimic"):
        element.remove(mimic)
    if follows is not None:
        values = {"joint": follows.joint, "multiplier": repr(follows.factor), "offset": repr(follows.offset)}
        ET.SubElement(element, "mimic", values)


def base_of(robot: ET.Element) -> str:
    """Return the link with an arm's own coordinate system: the root, or the only link that `world` carries, fixed."""
    above = joints_above(robot)
    (root,) = (name for link in robot.findall("link") if (name := link.get("name", "")) not in above)
    carried = [(link, joint.get("type")) for link, joint in above.items() if link_at(joint, "parent") == root]
    return carried[0][0] if root == WORLD and [kind for _, kind in carried] == ["fixed"] else root


def _is_finger(joint: ET.Element) -> bool:
    return joint.find("mimic") is not None or _FINGER.search(joint.get("name", "")) is not None


def gripper_joints(robot: ET.Element, *, coupled: Collection[str] = ()) -> list[str]:
    """Names of the joints of a gripper on an arm, in the order of the file.

    They are named so, or mimic another, or another mimics them, or they are coupled in another way. Beyond them no
    other joint moves, and before them one of the arm's turns. Joints on one way that follow each other, as in an arm's
    wrist, are the arm's if none is named like a gripper's and there is no flange beside them.
    """
    moving = {joint.get("name", ""): joint for joint in robot.findall("joint") if joint.get("type") in MOVED}
    above = joints_above(robot)
    before = {name: way_down(above, link_at(joint, "parent")) for name, joint in moving.items()}
    leaders = set()
    for name, joint in moving.items():
        leader = _mimicked(joint)
        beyond = {link_at(each, "parent") for each in before[name]} | {link_at(joint, "parent")}
        if leader in moving and link_at(moving[leader], "parent") in beyond:  # else a rod on an earlier link follows it
            leaders.add(leader)
    alike = {
        name
        for name, joint in moving.items()
        if _GRIPPER.search(name) or name in leaders or name in coupled or joint.find("mimic") is not None
    }
    carries, carried = set(), set()
    for name in moving:
        for other in before[name]:
            if name not in alike:
                carries.add(other.get("name"))
            elif other.get("name") not in alike and other.get("type") in TURNING:
                carried.add(name)
    found = [name for name in moving if name in alike & carried - carries]
    return [name for name in found if not _is_of_the_way(robot, name, moving, before, found)]


def _is_of_the_way(
    robot: ET.Element,
    name: str,
    moving: Mapping[str, ET.Element],
    before: Mapping[str, list[ET.Element]],
    found: Collection[str],
) -> bool:
    """Whether a joint, one of a gripper by what it mimics, belongs to the way that it is on."""
    leader = _mimicked(moving[name]) or name
    group = {leader, *(each for each, joint in moving.items() if _mimicked(joint) == leader)}
    if len(group) == 1 or leader not in moving or any(_GRIPPER.search(each) for each in group):
        return False
    ways = {each: {each, *(joint.get("name", "") for joint in before[each])} for each in group}
    if leader not in found:
        return leader in ways[name]
    carrier = link_at(moving[leader], "parent")
    links = {each: {link_at(moving[other], "parent") for other in ways[each] if other in moving} for each in group}
    ordered = sorted((each for each in group if carrier in links[each]), key=lambda each: len(ways[each]))  # no rods
    chained = all(ways[one] <= ways[other] for one, other in pairwise(ordered))
    return chained and is_only_way_on(robot, moving[ordered[0]])


def _mimicked(joint: ET.Element) -> str:
    """The joint that a joint mimics; empty if there is none."""
    mimic = joint.find("mimic")
    return "" if mimic is None else mimic.get("joint", "")


def check_home(name: str, robot: ET.Element, home: Mapping[str, float]) -> None:
    """Refuse a start posture outside of the limits."""
    joints = {joint.get("name", ""): joint for joint in robot.findall("joint")}
    for joint, angle in home.items():
        check_known(f"joint of arm {name!r}", joint, joints)
        low, high = limits_of(joints[joint])
        if not low - LIMIT_DIGITS <= angle <= high + LIMIT_DIGITS:
            raise InputError(
                f"arm {name!r}: home has joint {joint!r} at {angle:g} {unit_of(joints[joint])}, outside its limits "
                f"{low:g} to {high:g}"
            )


def unit_of(joint: ET.Element) -> str:
    """Return the unit of a joint's place, "rad" or "m"."""
    return "m" if joint.get("type") == "prismatic" else "rad"


def limits_of(joint: ET.Element) -> tuple[float, float]:
    """Return lower and upper limit of a joint [rad, m]; one that is missing is 0, and one without end has none."""
    if joint.get("type") == ENDLESS:
        return -math.inf, math.inf
    return _value(joint, "limit", "lower"), _value(joint, "limit", "upper")


def _value(element: ET.Element | None, tag: str, key: str) -> float:
    """A number in a child of an element; 0 where there is none."""
    child = None if element is None else element.find(tag)
    return 0.0 if child is None else float(child.get(key, "0"))


def _length(placed: ET.Element | None) -> float:
    """How far what has an `<origin>` is from its parent's origin [m]."""
    origin = None if placed is None else placed.find("origin")
    return 0.0 if origin is None else math.hypot(*map(float, origin.get("xyz", "0 0 0").split()))

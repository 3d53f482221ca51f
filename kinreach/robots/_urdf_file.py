"""Arms from files: URDFs as ROS's packages have them, and MuJoCo's MJCF."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from kinreach._checks import check_number, check_path, shown
from kinreach._files import decoded, read_bytes
from kinreach.cli import quoted
from kinreach.errors import InputError, raise_unknown
from kinreach.robots._mesh_units import scale_to_metres
from kinreach.robots._mjcf import MJCF, Mjcf, read_mjcf
from kinreach.robots._packages import find_meshes
from kinreach.robots._urdf import (
    ENDLESS,
    FEWEST_TURNING,
    KINDS,
    LIMIT_DIGITS,
    MAX_CHARACTERS,
    MAX_NAMED,
    MAX_SPEED,
    MOVED,
    ROBOT,
    TURNING,
    WORLD,
    UrdfArm,
    add_joint,
    base_of,
    check_parts,
    followed,
    gripper_joints,
    joints_above,
    limit_of,
    limits_of,
    link_at,
    links_below,
    named,
    parse_xml,
    place_origin,
    set_follows,
    set_limits,
    unit_of,
    way_down,
)
from kinreach.robots._urdf_repair import floats, listed_names, only_urdf, repair

XACRO = ".xacro"
#: Elements of xacro that define something, and add nothing where it is not used.
_DEFINITIONS = ("xacro:property", "xacro:arg", "xacro:macro")
#: What xacro replaces.
_EXPRESSION = re.compile(r"\$[{(]")
#: Encodings that a file may name; what is neither that nor UTF-8 is read as Latin-1, byte by byte.
_ENCODING = re.compile(rb"""<\?xml[^>]*\bencoding\s*=\s*["']([\w.-]+)["']""")
_ENCODINGS = re.compile(
    r"iso-?8859-?\d+|latin-?1|us-ascii|(?:windows|cp)-?125\d|koi8-r|gbk|gb2312|gb18030|big5|shift[_-]jis|euc-(?:jp|kr)",
    re.IGNORECASE,
)
_BARE_AMPERSAND = re.compile(r"&(?!(?:#\d+|#x[0-9a-fA-F]+|[A-Za-z]+);)")
#: Joints that kinreach does not move, and takes for fixed where no turning joint is before or after them.
FREE = ("floating", "planar", "spherical")
#: A base that slides has at most so many slides, or it is part of what the arm is.
MOST_SLIDES = 2
#: Default speed of a joint that slides [m/s].
MAX_SLIDING_SPEED = 1.0
#: Limits of more turns than this may be degrees.
MOST_TURNS = 3


@dataclass(frozen=True)
class ArmSource:
    """An arm read from a file.

    Attributes:
        robot: The URDF for the engines.
        package_root: Folder that `package://` stands for in it; None without meshes.
        base: Link that carries the arm's own coordinate system.
        home: Start posture by the names of the joints [rad]; None if the file has none.
        may_touch: Pairs of links that the file lets touch beside neighbours; None if it does not say.
        meshes: What collision checks use of a mesh, `"triangles"` or `"hulls"`.
        missing_shapes: Why collision shapes are missing; empty if none is.
        notes: What the reader left out or assumed, a line each.
    """

    name: str
    robot: ET.Element
    package_root: str | None
    joints: tuple[str, ...]
    base: str
    tip: str
    tips: Mapping[str, str]
    home: Mapping[str, float] | None
    may_touch: tuple[tuple[str, str], ...] | None
    meshes: str
    missing_shapes: str
    notes: tuple[str, ...]


def read_arm(
    file: str | Path,
    *,
    tip: str | None,
    joints: Sequence[str] | None,
    held: Mapping[str, float],
    package_dirs: Sequence[str | Path],
    gripper: Collection[str] = (),
) -> ArmSource:
    """Read an arm from a URDF or MJCF file; the arguments are those of `ArmDescription.from_file`.

    `gripper` are the joints that stay as they are, for a gripper.
    """
    path = check_path("file", file)
    first = _parse(path)
    read = read_mjcf(first, path) if first.tag == MJCF else Mjcf(first)
    robot = read.robot
    name = robot.get("name") or path.stem
    xacro = _Xacro(robot, path)
    only_urdf(robot)
    xacro.check_expressions(robot)
    repaired, unread = repair(robot)
    root, lost, places = find_meshes(robot, path.resolve(), package_dirs)
    xacro.check_complete(robot, root)
    scaled, too_long = ([], "") if first.tag == MJCF else scale_to_metres(robot, places)
    missing = lost or unread or too_long
    notes = [*read.notes, *xacro.notes, *repaired, *scaled, *_rename_world(robot), *_fix_free_joints(name, robot)]
    every = [joint.get("name", "") for joint in robot.findall("joint")]
    for joint in (*held, *(joints or ()), *gripper):
        if joint not in every:
            raise_unknown(f"joint of arm {name!r}", joint, every)
    base = base_of(robot)
    grippers = [] if joints else gripper_joints(robot, coupled=read.coupled)
    grippers = [joint for joint in grippers if joint not in (*held, *gripper)]
    still = [] if joints else [*_sliding_base(robot), *_stuck(robot)]
    others = [*grippers, *still]
    if joints:
        together = {followed(name, robot, joint).joint for joint in joints}
        others = [
            joint for joint in every if joint not in joints and followed(name, robot, joint).joint not in together
        ]
    arm = UrdfArm(name, robot, tip=tip, joints=joints, held=[*held, *others, *gripper])
    for joint in arm.joints:
        if joint in read.looped:
            raise InputError(
                f"arm {name!r}: joint {joint!r} is part of a closed loop, which is not solved; hold it with "
                f"held={{{joint!r}: 0.0}}, or name with tip= a body before it"
            )
    holding = _Holding(robot, arm, held, grippers, gripper)
    holding.hold()
    notes += [*holding.notes, *_many_turns(robot, arm), *_couple(robot, arm)]
    if arm.passed_over:
        rest = [link for link in arm.tips if link not in (arm.tip, arm.passed_over)]
        also = f", or {listed_names(rest)}" if rest else ""
        notes.append(f"the tip is {arm.tip}; give tip= for {arm.passed_over}, which is a sensor's by its name{also}")
    notes += [f"no collision checks and no simulation: {missing}"] if missing else []
    for endless in robot.findall(f"joint[@type='{ENDLESS}']"):
        limit_of(endless)
    for each in robot.findall("joint"):
        limit = each.find("limit")
        if limit is not None and float(limit.get("velocity", "0")) == 0.0:  # missing: a solver's steps would be 0
            slides = unit_of(each) == "m" and each.get("name") in arm.joints
            limit.set("velocity", repr(MAX_SLIDING_SPEED if slides else MAX_SPEED))
    if named(robot, "link", WORLD) is None:
        root_link = base_of(robot)
        robot.append(ET.Element("link", name=WORLD))
        add_joint(robot, _new_name(f"{WORLD}_joint", robot.findall("joint")), WORLD, root_link)
    tips = UrdfArm(name, robot, tip=arm.tip, joints=arm.joints, held=gripper).tips
    home = None
    if read.home:
        home, moved = _moved_into_limits(read.home, arm)
        notes += moved
    return ArmSource(
        name, robot, root, arm.joints, base, arm.tip, tips, home, read.may_touch, read.meshes, missing, tuple(notes)
    )


def _moved_into_limits(home: Mapping[str, float], arm: UrdfArm) -> tuple[dict[str, float], list[str]]:
    """Move a file's start posture into the limits; returns it, and a note on what is moved."""
    ends = dict(zip(arm.joints, arm.limits, strict=True))
    within = {joint: min(max(home[joint], lower), upper) for joint, (lower, upper) in ends.items()}
    moved = [joint for joint, place in within.items() if abs(place - home[joint]) > LIMIT_DIGITS]
    return within, [f"the start posture is moved into the limits: {listed_names(moved)}"] if moved else []


def turning_joints(file: str) -> set[str]:
    """Return the names of the joints in an arm's file that turn; none of what is not one."""
    path = check_path("file", file)
    if not path.is_file():
        return set()
    first = _parse(path)
    robot = read_mjcf(first, path).robot if first.tag == MJCF else first
    return {joint.get("name", "") for joint in robot.iter("joint") if joint.get("type") in TURNING}


def _parse(path: Path) -> ET.Element:
    """Parse the text of a file; what urdfdom reads though it is not XML is read as urdfdom does."""
    text = _text(read_bytes(path, "the URDF", most=MAX_CHARACTERS)).lstrip("\ufeff \t\r\n")
    try:
        return parse_xml(text, tags=(ROBOT, MJCF), prefixed=True)
    except InputError as error:
        lenient = _BARE_AMPERSAND.sub("&amp;", _without_comments(text))
        if lenient == text:
            raise
        try:
            return parse_xml(lenient, tags=(ROBOT, MJCF), prefixed=True)
        except InputError:
            raise error from None


def _text(content: bytes) -> str:
    found = _ENCODING.match(content[:200].lstrip())
    encoding = found[1].decode() if found is not None else ""
    return decoded(content, otherwise=encoding if _ENCODINGS.fullmatch(encoding) else "latin-1")


def _without_comments(text: str) -> str:
    """Remove comments; XML allows no `--` in them, and people write it."""
    before, *commented = text.split("<!--")
    return before + "".join(part.partition("-->")[2] for part in commented)


class _Xacro:
    """What xacro left in a file, or what it has still to do.

    Attributes:
        notes: A line if there is something.
    """

    def __init__(self, robot: ET.Element, path: Path) -> None:
        self._path = path
        tags: dict[str, None] = {}
        todo = [robot]
        for element in todo:  # which grows
            for child in list(element):
                if child.tag.startswith("xacro:"):
                    tags[child.tag] = None
                    element.remove(child)
            todo += element
        makers = [tag for tag in tags if tag not in _DEFINITIONS]
        self._missing = bool(makers)
        if makers and path.suffix.lower() == XACRO:
            raise self.error
        what = listed_names([f"<{tag}>" for tag in makers or tags])
        add = ", with whatever they would add" if makers else ""
        self.notes = [f"leftovers of xacro are ignored{add}: {what}"] if tags else []

    def check_expressions(self, robot: ET.Element) -> None:
        """Refuse a file with an expression that xacro would replace, but for the address of a mesh."""
        for element in robot.iter():
            for key, value in element.attrib.items():
                if key != "filename" and _EXPRESSION.search(value):
                    raise self.error

    def check_complete(self, robot: ET.Element, package_root: str | None) -> None:
        """Refuse what is no URDF of an arm; where parts of it may be missing, say so."""
        try:
            check_parts(robot, package_root, kinds=(*KINDS, *FREE))
        except InputError:
            if self._missing:
                raise self.error from None
            raise
        if self._missing and not any(joint.get("type") in MOVED for joint in robot.findall("joint")):
            raise self.error

    @property
    def error(self) -> InputError:
        """What to do about a file that is a template."""
        name = re.sub(r"(\.urdf)?(\.xacro)?$", "", self._path.name, flags=re.IGNORECASE)
        names = chain([f"{name}.urdf", f"{name}_expanded.urdf"], (f"{name}_expanded_{i}.urdf" for i in count(2)))
        other = next(other for each in names if not (other := self._path.with_name(each)).exists())
        return InputError(
            f"{shown(str(self._path))} is xacro, which URDFs are made from; run "
            f"`xacro {quoted(str(self._path))} > {quoted(str(other))}`, with the arguments NAME:=VALUE that it "
            "asks for, and give the result"
        )


def _new_name(name: str, elements: Sequence[ET.Element]) -> str:
    """The name, or with a number behind it if an element has it."""
    names = {element.get("name") for element in elements}
    return next(new for i in range(len(names) + 1) if (new := f"{name}_{i}" if i else name) not in names)


def _rename_world(robot: ET.Element) -> list[str]:
    """Give a link `world` that is not the first another name: simulators take it for the ground."""
    if WORLD not in joints_above(robot):
        return []
    other = _new_name(WORLD, robot.findall("link"))
    for link in robot.findall("link"):
        if link.get("name") == WORLD:
            link.set("name", other)
    for end in (*robot.iterfind("joint/parent"), *robot.iterfind("joint/child")):
        if end.get("link") == WORLD:
            end.set("link", other)
    return [f"the link {WORLD} is not the first, and is called {other}"]


def _fix_free_joints(name: str, robot: ET.Element) -> list[str]:
    """Make fixed joints of those that float, where they carry the whole arm or nothing of it."""
    around = _turning_around(robot)
    free = [joint for joint in robot.findall("joint") if joint.get("type") in FREE]
    for joint in free:
        if all(around[joint]):
            raise InputError(
                f"arm {name!r}: joint {shown(joint.get('name'))} is {joint.get('type')}, between joints that turn; "
                "kinreach moves joints that turn about an axis"
            )
    for joint in free:
        _fix(joint, 0.0)
    head, verb = ("joints", "float and are") if len(free) > 1 else ("joint", "floats and is")
    names = listed_names([joint.get("name", "") for joint in free])
    return [f"{head} {names} {verb} held where the file has it"] if free else []


def _turning_around(robot: ET.Element) -> dict[ET.Element, tuple[int, int]]:
    """How many joints turn before each joint, and how many it carries that do; those that mimic do not count."""
    above = joints_above(robot)
    before = {joint: way_down(above, link_at(joint, "parent")) for joint in above.values()}
    turns = {joint: joint.get("type") in TURNING and joint.find("mimic") is None for joint in before}
    carried = Counter(each for joint, way in before.items() if turns[joint] for each in way)
    return {joint: (sum(turns[each] for each in way), carried[joint]) for joint, way in before.items()}


def _sliding_base(robot: ET.Element) -> list[str]:
    """Names of the joints that slide under the whole arm, such as a rail's; not those that make a gantry or a SCARA."""
    slides = [
        joint.get("name", "")
        for joint, (before, after) in _turning_around(robot).items()
        if joint.get("type") == "prismatic" and joint.find("mimic") is None and not before and after >= FEWEST_TURNING
    ]
    return slides if len(slides) <= MOST_SLIDES else []


def _stuck(robot: ET.Element) -> list[str]:
    """Names of joints whose limits hold them at one place; both limits 0 mean that nobody gave them."""
    ends = {joint.get("name", ""): joint for joint in robot.findall("joint") if joint.get("type") in MOVED}
    return [name for name, joint in ends.items() if limits_of(joint)[0] == limits_of(joint)[1] != 0.0]


def _many_turns(robot: ET.Element, arm: UrdfArm) -> list[str]:
    """A note on limits that may be degrees."""
    turning = {joint.get("name") for joint in robot.findall("joint") if joint.get("type") in TURNING}
    many = [
        name
        for name, ends in zip(arm.joints, arm.limits, strict=True)
        if name in turning and math.inf > max(map(abs, ends)) > MOST_TURNS * math.tau
    ]
    which = "joints" if len(many) > 1 else "joint"
    said = (
        f"the limits of {which} {listed_names(many)} are more than {MOST_TURNS} turns; a URDF has radians, not degrees"
    )
    return [said] if many else []


def _couple(robot: ET.Element, arm: UrdfArm) -> list[str]:
    """Let joints on the way follow one of `q` directly, which is limited so that they are within their limits."""
    notes = []
    for joint, limits in zip(arm.joints, arm.limits, strict=True):
        element = named(robot, "joint", joint)
        names = [name for name, follows in arm.followers.items() if follows.joint == joint]
        if element is not None and element.find("mimic") is not None:
            set_follows(robot, joint, None)
        if not names:
            continue
        several = len(names) > 1
        head, verb, are = ("joints", "follow", "are") if several else ("joint", "follows", "is")
        notes.append(f"{head} {listed_names(names)} {verb} {joint} and {are} not part of q")
        if math.isfinite(limits[1] - limits[0]):
            set_limits(robot, joint, *limits)
    for name, follows in arm.followers.items():
        set_follows(robot, name, follows)
    return notes


class _Holding:
    """Joints that are not part of `q`: where they are held, and what is said of it."""

    def __init__(
        self,
        robot: ET.Element,
        arm: UrdfArm,
        held: Mapping[str, float],
        grippers: Sequence[str],
        stays: Collection[str],
    ) -> None:
        self._robot, self._arm, self._held = robot, arm, held
        self._all = {joint.get("name", ""): joint for joint in robot.findall("joint")}
        self._joints = {
            name: joint
            for name, joint in self._all.items()
            if joint.get("type") in MOVED and name not in (*arm.joints, *arm.followers) and name not in stays
        }
        self._rods = [name for name in self._joints if name not in held and self._leader(name) in arm.joints]
        self._grippers = [name for name in grippers if name in self._joints and name not in self._rods]
        self.notes: list[str] = []

    def hold(self) -> None:
        """Make every joint that is not one of the arm's a fixed one."""
        places = {name: self._place(name) for name in self._joints}
        self.notes = self._notes(places)
        for name, place in places.items():
            _fix(self._joints[name], place)
        for name in self._rods:
            child = link_at(self._joints[name], "child")
            for link in (child, *links_below(self._robot, child)):
                element = named(self._robot, "link", link)
                for shape in [] if element is None else element.findall("collision"):
                    element.remove(shape)  # type: ignore[union-attr]

    def _leader(self, name: str) -> str:
        """The joint that a joint follows, over others; itself if it follows none."""
        seen = {name}
        while (mimic := self._all[name].find("mimic")) is not None:
            name = mimic.get("joint", "")
            if name in seen or name not in self._all:
                return ""
            seen.add(name)
        return name

    def _place(self, name: str) -> float:
        """Where a joint is held [rad, m]: where the caller says, or its leader takes it; else near 0."""
        if name in self._arm.joints:
            return 0.0
        joint = self._all[name]
        unit = "m" if joint.get("type") == "prismatic" else "rad"
        lower, upper = limits_of(joint)
        if name in self._held:
            place = check_number(f"the place of joint {name!r}", self._held[name])
            if lower <= upper and not lower - LIMIT_DIGITS <= place <= upper + LIMIT_DIGITS:
                degrees = "; it is in radians, not degrees" if unit == "rad" and abs(place) > 2 * math.pi else ""
                raise InputError(
                    f"the place of joint {name!r} must be within its limits, {lower:g} to {upper:g} {unit}, got "
                    f"{place:g}{degrees}"
                )
            return place
        mimic = joint.find("mimic")
        if mimic is not None and self._leader(name):
            factor, offset = (
                floats(mimic.get(key, default), 1) for key, default in (("multiplier", "1"), ("offset", "0"))
            )
            if factor is None or offset is None:
                raise InputError(f"joint {name!r} of the URDF has a <mimic> with what is no number")
            return factor[0] * self._place(mimic.get("joint", "")) + offset[0]
        return 0.0 if lower > upper else min(max(0.0, lower), upper)

    def _notes(self, places: Mapping[str, float]) -> list[str]:
        notes = [_left_out(self._robot, self._grippers)] if self._grippers else []
        if self._rods:
            follow, verb = ("joints", "follow the arm") if len(self._rods) > 1 else ("joint", "follows the arm")
            notes.append(
                f"{follow} {listed_names(self._rods)} {verb} beside the way to the tip, and collision checks leave out "
                "what is on it"
            )
        rest = [name for name in places if name not in (*self._held, *self._grippers, *self._rods)]
        stuck = [name for name in rest if name in _stuck(self._robot)]
        if stuck:
            head, verb = ("joints", "are") if len(stuck) > 1 else ("joint", "is")
            notes.append(f"{head} {listed_names(stuck)} cannot move within the limits and {verb} not part of q")
        for kind, unit, does in (("prismatic", "m", "slide"), ("", "rad", "turn")):
            names = [n for n in rest if n not in stuck and (self._joints[n].get("type") == "prismatic") is bool(kind)]
            if not names:
                continue
            first = names[0]
            at = [f"{places[name]:g} {unit}" for name in names]
            what = f"joint {first} {does}s and is held at {at[0]}"
            if len(names) > 1:
                pairs = [f"{name} ({place})" for name, place in zip(names, at, strict=True)]
                what = f"joints {listed_names(pairs)} {does} and are held there"
            middle = 0.5 * sum(limits_of(self._joints[first]))
            example = middle if math.isfinite(middle) and middle != places[first] else 0.1
            notes.append(f"{what}, not part of q; held={{{first!r}: {example:.3g}}} holds {first} elsewhere")
        return notes


def _left_out(robot: ET.Element, joints: Sequence[str]) -> str:
    several = len(joints) > 1
    turning = [
        name
        for joint in robot.findall("joint")
        if (name := joint.get("name", "")) in joints and joint.get("type") in TURNING and joint.find("mimic") is None
    ]
    take = f"; to take in {', '.join(turning[:MAX_NAMED])}, name all joints of q with joints=" if turning else ""
    head, verb = ("joints", "are") if several else ("joint", "is")
    return f"{head} {listed_names(joints)} of a gripper {verb} held still and not part of q{take}"


def _fix(joint: ET.Element, place: float) -> None:
    """Turn a joint into a fixed one at a place [rad, m]."""
    if joint.find("origin") is None:
        ET.SubElement(joint, "origin")
    if place != 0.0:
        place_origin(joint, place)
    joint.set("type", "fixed")
    for element in list(joint):
        if element.tag not in ("origin", "parent", "child"):
            joint.remove(element)

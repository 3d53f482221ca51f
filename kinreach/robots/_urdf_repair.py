"""What a URDF file has that kinematics does not use: repaired or left out, with a note.

Shapes without size, torques below zero, colours of three numbers, masses that are none, and elements of other programs.
Nothing here changes where a joint is or how it turns. All functions change the parsed file in place.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Collection
from copy import deepcopy

import numpy as np

from kinreach._checks import shown
from kinreach._rotations import rpy
from kinreach.errors import InputError
from kinreach.robots._urdf import MAX_NAMED, MAX_NUMBER, floats_in, numbers, origin_of

#: What is kept of each element; everything else is for other programs, such as `<gazebo>` and `<transmission>`.
_KEPT = {
    "robot": ("link", "joint", "material"),
    "link": ("inertial", "visual", "collision"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry"),
    "material": ("color", "texture"),
}
#: What an element has several of; of everything else the first counts, as in urdfdom.
_SEVERAL = ("link", "joint", "material", "visual", "collision")
_SHAPES = ("visual", "collision")
#: Numbers of the shapes that URDFs have, with how many there are.
_SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1},
          "capsule": {"radius": 1, "length": 1}}  # fmt: skip
#: Thickness of a shape that has none [m].
THIN = 1e-4
#: How far below zero an inertia may be by the digits of its numbers, as a share of its largest.
ROUNDING = 1e-6
_BESIDE = ("ixy", "ixz", "iyz")
#: Limits of a joint beyond this are none [rad]: files write 1e16.
ENDLESS = 1e4


class Notes:
    """Notes on parts of a file, those of one kind on one line."""

    def __init__(self) -> None:
        self._names: defaultdict[tuple[str, str], dict[str, None]] = defaultdict(dict)

    def add(self, text: str, part: str, name: str) -> None:
        """Note something of a part, such as `"link"`, by its name."""
        self._names[text, part][name] = None

    @property
    def lines(self) -> list[str]:
        return [
            f"{text}: {part}{'s' * (len(names) > 1)} {listed_names(names)}"
            for (text, part), names in self._names.items()
        ]


def listed_names(names: Collection[str]) -> str:
    """Return names with commas between them, the first few of many."""
    return ", ".join([*names][:MAX_NAMED]) + ", ..." * (len(names) > MAX_NAMED)


def only_urdf(robot: ET.Element) -> None:
    """Leave out elements of other programs, and those that are there twice."""
    robot.attrib = {"name": robot.get("name", "")}
    todo = [robot]
    for element in todo:  # which grows
        element.attrib = {key: value for key, value in element.attrib.items() if ":" not in key and key != "xmlns"}
        kept = _KEPT.get(element.tag)
        if kept is not None:
            seen: set[str] = set()
            for child in list(element):
                if child.tag not in kept or (child.tag in seen and child.tag not in _SEVERAL):
                    element.remove(child)
                seen.add(child.tag)
        todo += element


def repair(robot: ET.Element) -> tuple[list[str], str]:
    """Repair what kinematics does not use, or leave it out.

    Returns:
        Notes, a line each; and why collision shapes are missing, or "".
    """
    notes, unread = Notes(), ""
    _repair_materials(robot, notes)
    for link in robot.findall("link"):
        name = link.get("name", "")
        for material in link.iterfind("visual/material"):
            _repair_colour(material, "link", name, notes)
        _repair_inertial(link, notes)
        for shape in [child for child in link if child.tag in _SHAPES]:
            wrong = _repair_shape(link, shape, notes)
            if wrong and shape.tag == "collision" and not unread:
                unread = f"the collision shape of link {shown(name)} cannot be read: {wrong}"
    for joint in robot.findall("joint"):
        _repair_joint(joint, notes)
    return notes.lines, unread


def floats(text: str | None, count: int) -> list[float] | None:
    """Return so many numbers of a text; None if it has others."""
    values = floats_in(text or "")
    usable = len(values) == count and all(math.isfinite(value) and abs(value) <= MAX_NUMBER for value in values)
    return values if usable else None


def _repair_materials(robot: ET.Element, notes: Notes) -> None:
    """Of materials with one name keep the first: two are an error to urdfdom."""
    seen: set[str] = set()
    for material in robot.findall("material"):
        name = material.get("name", "")
        if name in seen:
            robot.remove(material)
        else:
            _repair_colour(material, "material", name, notes)
        seen.add(name)


def _repair_colour(material: ET.Element, part: str, name: str, notes: Notes) -> None:
    colour = material.find("color")
    if colour is None:
        return
    text = colour.get("rgba")
    values = floats(text, 4)
    if values is None and (three := floats(text, 3)) is not None:
        values = [*three, 1.0]
        notes.add("a colour has three numbers and is taken as opaque", part, name)
    if values is not None and 1.0 < max(values) <= 255.0:
        values = [value / 255.0 for value in values]
        notes.add("a colour has numbers up to 255, which are taken as shares of that", part, name)
    if values is None or not all(0.0 <= value <= 1.0 for value in values):
        material.remove(colour)
        notes.add("a colour that cannot be read is left out", part, name)
        return
    colour.set("rgba", numbers(values))


def _repair_inertial(link: ET.Element, notes: Notes) -> None:
    """Leave out an inertia that is none, and complete one without its entries beside the diagonal."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    usable = mass is not None and inertia is not None and _place_can_be_read(origin)
    if mass is not None and inertia is not None and usable:
        for key in _BESIDE:
            inertia.attrib.setdefault(key, "0")
        value = floats(mass.get("value"), 1)
        usable = value is not None and value[0] >= 0.0 and _is_an_inertia(inertia)
    if not usable:
        link.remove(inertial)
        notes.add("a mass or inertia that cannot be is left out", "link", link.get("name", ""))


def _is_an_inertia(inertia: ET.Element) -> bool:
    """Return whether an inertia has its numbers, and none below zero about any axis."""
    entries = [floats(inertia.get(key), 1) for key in ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")]
    if None in entries:
        return False
    matrix = np.array(entries).reshape(3, 3)
    return bool(np.linalg.eigvalsh(matrix)[0] >= -ROUNDING * np.abs(matrix).max())


def _place_can_be_read(origin: ET.Element | None) -> bool:
    return origin is None or all(floats(origin.get(key, "0 0 0"), 3) is not None for key in ("xyz", "rpy"))


def _repair_shape(link: ET.Element, shape: ET.Element, notes: Notes) -> str:
    """Repair a visual or collision shape, or take it out of its link; returns what is wrong with one that is unread."""
    name, kind = link.get("name", ""), shape.tag
    geometry = shape.find("geometry")
    solid = next(iter(geometry), None) if geometry is not None else None
    if solid is None or geometry is None:
        link.remove(shape)
        notes.add(f"a {kind} without a shape is left out", "link", name)
        return ""
    geometry[:] = [solid]  # the first counts, as in urdfdom
    wrong = (
        ""
        if _place_can_be_read(shape.find("origin"))
        else f"its <origin> is {shown(_attributes(shape.find('origin')))}"
    )
    wrong = wrong or (_mesh_problem(solid, name, notes) if solid.tag == "mesh" else _solid_problem(solid))
    if wrong:
        link.remove(shape)
        if kind == "visual":
            notes.add("a visual shape that cannot be read is left out", "link", name)
        return wrong
    if solid.tag == "mesh":
        return ""
    sizes = {key: floats(solid.get(key), count) or [] for key, count in _SIZES[solid.tag].items()}
    every = [value for values in sizes.values() for value in values]
    if not any(every) or (solid.tag == "capsule" and not sizes["radius"][0]):
        link.remove(shape)
        notes.add(f"a {kind} shape without size is left out", "link", name)
        return ""
    if solid.tag == "capsule":
        _without_capsule(link, shape, *sizes["radius"], *sizes["length"])
        return ""
    if not all(every):
        for key, values in sizes.items():
            solid.set(key, numbers([value or THIN for value in values]))
        notes.add(f"a {kind} shape without thickness is made {1e3 * THIN:g} mm thick", "link", name)
    return ""


def _solid_problem(solid: ET.Element) -> str:
    """Say what is wrong with a box, cylinder, sphere or capsule; a size of zero is not."""
    if solid.tag not in _SIZES:
        return f"<{solid.tag}> is not one of mesh, {', '.join(_SIZES)}"
    for key, count in _SIZES[solid.tag].items():
        values = floats(solid.get(key), count)
        if values is None or min(values) < 0.0:
            return f"{key} of <{solid.tag}> is {shown(solid.get(key, ''))}"
    return ""


def _mesh_problem(mesh: ET.Element, link: str, notes: Notes) -> str:
    """Say what is wrong with the scale of a mesh; one number stands for all three."""
    scale = mesh.get("scale")
    if scale is None:
        return ""
    one, three = floats(scale, 1), floats(scale, 3)
    if one is not None:
        three = one * 3
        notes.add("the scale of a mesh is one number, which is taken for all three axes", "link", link)
    if three is None or 0.0 in three:
        return f"scale of <mesh> is {shown(scale)}"
    mesh.set("scale", numbers(three))
    return ""


def _attributes(element: ET.Element | None) -> str:
    return "" if element is None else " ".join(f'{key}="{value}"' for key, value in element.attrib.items())


def _without_capsule(link: ET.Element, shape: ET.Element, radius: float, length: float) -> None:
    """Put a cylinder and two spheres in the place of a capsule, which is as long as its cylinder."""
    T, place = origin_of(shape), list(link).index(shape)
    parts: list[tuple[str, float]] = (
        [("sphere", 0.5 * length), ("sphere", -0.5 * length)] if length else [("sphere", 0.0)]
    )
    parts += [("cylinder", 0.0)] if length else []
    link.remove(shape)
    for tag, up in parts:
        part = deepcopy(shape)
        for child in part.findall("origin"):
            part.remove(child)
        ET.SubElement(part, "origin", xyz=numbers((T[:3, 3] + up * T[:3, 2]).tolist()), rpy=numbers(rpy(T[:3, :3])))
        sizes = {"radius": repr(radius)} | ({"length": repr(length)} if tag == "cylinder" else {})
        part.find("geometry")[:] = [ET.Element(tag, sizes)]  # type: ignore[index]
        link.insert(place, part)


def _repair_joint(joint: ET.Element, notes: Notes) -> None:
    """Complete torque and speed, leave out friction that is none, and write its place and limits in plain numbers."""
    name = joint.get("name", "")
    if _without_quaternion(joint):
        notes.add("a quaternion is taken as the rotation of its <origin>", "joint", name)
    if joint.get("type") == "fixed":
        joint[:] = [child for child in joint if child.tag in ("origin", "parent", "child", "mimic")]
    dynamics = joint.find("dynamics")
    if dynamics is not None:
        given = {key: floats(dynamics.get(key, "0"), 1) for key in ("damping", "friction")}
        if any(value is None or value[0] < 0.0 for value in given.values()):
            notes.add("damping or friction that cannot be is left out", "joint", name)
            joint.remove(dynamics)
        elif not {"damping", "friction"} & set(dynamics.attrib):
            joint.remove(dynamics)
    limit = joint.find("limit")
    if limit is None:
        return
    for key, what in (("effort", "torque"), ("velocity", "speed")):
        value = floats(limit.get(key), 1)
        if value is None or value[0] < 0.0:
            is_missing = limit.get(key) is None
            how = "is missing" if is_missing else "cannot be"
            notes.add(f"the largest {what} ({key} of <limit>) {how} and is taken as not known", "joint", name)
            value = [0.0]
        limit.set(key, repr(value[0]))
    for key in ("lower", "upper"):
        if (value := floats(limit.get(key), 1)) is not None:
            limit.set(key, repr(value[0]))
    if joint.get("type") == "continuous":  # which has none
        for key in ("lower", "upper"):
            limit.attrib.pop(key, None)
    elif joint.get("type") == "revolute" and _is_endless(limit):
        notes.add("limits so wide that they are none are left out", "joint", name)
        joint.set("type", "continuous")
        for key in ("lower", "upper"):
            del limit.attrib[key]


def _is_endless(limit: ET.Element) -> bool:
    """Return whether a joint turns without end, also where the file says -inf and inf."""
    try:
        lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
    except ValueError:
        return False
    return lower <= -ENDLESS and upper >= ENDLESS


def _without_quaternion(joint: ET.Element) -> bool:
    """Write the rotation of a joint as roll, pitch and yaw where the file has a quaternion (x, y, z, w) of URDF 1.2.

    Returns whether it has one.
    """
    origin = joint.find("origin")
    text = None if origin is None else origin.attrib.pop("quat_xyzw", None)
    if origin is None or text is None or "rpy" in origin.attrib:
        return False
    values = floats(text, 4)
    if values is None or not math.hypot(*values) > 1e-6:
        raise InputError(
            f"quat_xyzw of <origin> must be four numbers, got {shown(text)}, in joint {shown(joint.get('name'))}"
        )
    x, y, z, w = np.array(values) / math.hypot(*values)
    R = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    origin.set("rpy", numbers(rpy(R)))
    return True

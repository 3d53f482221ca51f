"""Small editing steps on a URDF: prune, move, and add links made of primitives."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass


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


def set_origin(robot: ET.Element, joint: str, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    """Place a joint's child in its parent's frame [m], roll-pitch-yaw [rad]."""
    element = robot.find(f"joint[@name='{joint}']")
    if element is None:
        raise KeyError(joint)
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    origin.set("xyz", numbers(xyz))
    origin.set("rpy", numbers(rpy))


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

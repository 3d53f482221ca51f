"""Arms from URDF files, as ROS's packages have them."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kinreach._checks import check_number, check_path, shown
from kinreach._files import read_text
from kinreach.errors import InputError, raise_unknown
from kinreach.robots._packages import find_meshes
from kinreach.robots._rotations import rotation, rpy, turn
from kinreach.robots._urdf import (
    MAX_CHARACTERS,
    MAX_NAMED,
    MAX_SPEED,
    TURNING,
    WORLD,
    UrdfArm,
    add_joint,
    check_urdf,
    gripper_joints,
    limits_of,
    named,
    numbers,
    parse_urdf,
)

#: Elements that do not describe the arm itself.
OTHERS = ("gazebo", "transmission", "ros2_control")
XACRO = ".xacro"


@dataclass(frozen=True)
class UrdfSource:
    """An arm read from a file.

    Attributes:
        robot: The URDF for the engines.
        package_root: Folder that `package://` stands for in it; None without meshes.
        missing_shapes: Why collision shapes are missing; empty if none is.
        notes: What the reader left out, a line each.
    """

    name: str
    robot: ET.Element
    package_root: str | None
    joints: tuple[str, ...]
    tip: str
    tips: Mapping[str, str]
    missing_shapes: str
    notes: tuple[str, ...]


def read_urdf(
    file: str | Path,
    *,
    tip: str | None,
    joints: Sequence[str] | None,
    held: Mapping[str, float],
    package_dirs: Sequence[str | Path],
) -> UrdfSource:
    """Read an arm from a URDF file; the arguments are those of `ArmDescription.from_urdf`."""
    path = check_path("file", file)
    robot = _parse(path)
    name = robot.get("name") or path.stem
    for tag in OTHERS:
        for element in robot.findall(tag):
            robot.remove(element)
    root, missing = find_meshes(robot, path.resolve(), package_dirs)
    check_urdf(ET.tostring(robot, encoding="unicode"), root)
    every = [joint.get("name", "") for joint in robot.findall("joint")]
    for joint in (*held, *(joints or ())):
        if joint not in every:
            raise_unknown(f"joint of arm {name!r}", joint, every)
    grippers = [] if joints else [joint for joint in gripper_joints(robot) if joint not in held]
    others = [joint for joint in every if joint not in joints] if joints else grippers
    arm = UrdfArm(name, robot, tip=tip, joints=joints, held=[*held, *others])
    notes = [_left_out(robot, grippers)] if grippers else []
    notes += [f"no collision checks and no simulation: {missing}"] if missing else []
    _hold(robot, arm.joints, held)
    for endless in robot.findall("joint[@type='continuous']"):
        _limit_to_a_turn(endless)
    for limit in robot.findall("joint/limit"):
        if float(limit.get("velocity", "0")) == 0.0:  # missing: a solver's steps would hold the joint still
            limit.set("velocity", repr(MAX_SPEED))
    if named(robot, "link", WORLD) is None:
        root_link = UrdfArm(name, robot, tip=arm.tip).base
        robot.append(ET.Element("link", name=WORLD))
        add_joint(robot, f"{WORLD}_joint", WORLD, root_link)
    tips = UrdfArm(name, robot, tip=arm.tip, joints=arm.joints).tips
    return UrdfSource(name, robot, root, arm.joints, arm.tip, tips, missing, tuple(notes))


def _parse(path: Path) -> ET.Element:
    text = read_text(path, "the URDF", most=MAX_CHARACTERS)
    try:
        robot = parse_urdf(text)
        template = any(element.tag.startswith("{") and "xacro" in element.tag for element in robot.iter())
    except InputError:
        if not re.search(r"<xacro:\w", text):  # a prefix that is not declared is not XML
            raise
        template = True
    if template or path.suffix.lower() == XACRO:
        urdf = path.name.removesuffix(XACRO).removesuffix(".urdf")
        raise InputError(
            f"{shown(str(path))} is xacro, which URDFs are made from; run `xacro {path.name} > {urdf}.urdf`, with the "
            "arguments NAME:=VALUE that it asks for, and give the result"
        )
    return robot


def _left_out(robot: ET.Element, joints: Sequence[str]) -> str:
    several = len(joints) > 1
    names = ", ".join(joints[:MAX_NAMED]) + ", ..." * (len(joints) > MAX_NAMED)
    turning = [
        name
        for joint in robot.findall("joint")
        if (name := joint.get("name", "")) in joints and joint.get("type") in TURNING and joint.find("mimic") is None
    ]
    take = f"; to take in {', '.join(turning[:MAX_NAMED])}, name all joints of q with joints=" if turning else ""
    head, verb = ("joints", "are") if several else ("joint", "is")
    return f"{head} {names} of a gripper {verb} held still and not part of q{take}"


def _hold(robot: ET.Element, joints: Sequence[str], held: Mapping[str, float]) -> None:
    """Make every joint that is not one of `joints` a fixed one."""
    moving = [joint for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    places = {joint.get("name", ""): _place(joint, held) for joint in moving}
    for joint in moving:
        mimic = joint.find("mimic")
        if joint.get("name") in joints:
            continue
        place = places[joint.get("name", "")]
        if mimic is not None and joint.get("name") not in held:
            leader = mimic.get("joint", "")
            if leader in joints:
                raise InputError(
                    f"joint {joint.get('name')!r} mimics {leader!r}, which moves the tip: give held= a place for it"
                )
            place = float(mimic.get("multiplier", "1")) * places.get(leader, 0.0) + float(mimic.get("offset", "0"))
        _fix(joint, place)


def _place(joint: ET.Element, held: Mapping[str, float]) -> float:
    name = joint.get("name", "")
    if name in held:
        return check_number(f"the place of joint {name!r}", held[name])
    lower, upper = limits_of(joint)
    return min(max(0.0, lower), upper)


def _fix(joint: ET.Element, place: float) -> None:
    """Turn a joint into a fixed one at a place [rad, m]."""
    axis, origin = joint.find("axis"), joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    if place != 0.0:
        direction = np.array([float(v) for v in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()])
        direction /= np.linalg.norm(direction)
        xyz = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
        R = rotation([float(v) for v in origin.get("rpy", "0 0 0").split()])
        if joint.get("type") == "prismatic":
            origin.set("xyz", numbers(xyz + place * R @ direction))
        else:
            origin.set("rpy", numbers(rpy(R @ turn(direction, place))))
    joint.set("type", "fixed")
    for element in list(joint):
        if element.tag not in ("origin", "parent", "child"):
            joint.remove(element)


def _limit_to_a_turn(joint: ET.Element) -> None:
    """Make a continuous joint a revolute one from -pi to pi, so that a posture is a plain vector."""
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", effort="0", velocity="0")
    limit.set("lower", repr(-math.pi))
    limit.set("upper", repr(math.pi))

"""Flags of the command line that choose the arm: its name or file, its calibration, its tool and its tip."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import check_known, shown
from kinreach.cli import complain, in_flags
from kinreach.errors import InputError
from kinreach.robots._description import ArmDescription
from kinreach.robots._registry import arm_named
from kinreach.robots._tools import TOOLS, Tool
from kinreach.robots._urdf_file import turning_joints

#: The flags of `add_arm_flags`, as attributes of the parsed arguments.
ARM_FLAGS = (
    "calibration", "repair", "tool", "tool_radius", "tool_mass", "tool_mesh", "tool_mesh_scale", "tip", "joints",
    "hold", "package_dir",
)  # fmt: skip


def add_arm_flags(parser: argparse.ArgumentParser) -> None:
    """Add `--calibration`, `--repair`, the flags of the tool, `--tip`, `--joints`, `--hold` and `--package-dir`."""
    group = parser.add_argument_group("the arm")
    group.add_argument(
        "--calibration",
        metavar="FILE",
        help="factory calibration of a UR: the ROS driver's kinematics.yaml, the controller's calibration.conf, a "
        "program of PolyScope (.urp), a calibrated URDF, a recording that it is fitted to (see kinreach calibrate), "
        "or the name of a published one, such as ur5e_a",
    )
    group.add_argument("--repair", action="store_true", help="correct a calibration that an old exporter folded")
    group.add_argument(
        "--tool",
        metavar="X,Y,Z,RX,RY,RZ",
        help="tool centre point on the flange, as on the pendant: metres, rotation vector in radians; or the name of a "
        f"tool: {', '.join(TOOLS)}",
    )
    group.add_argument("--tool-radius", metavar="M", help="the tool fills a tube of this radius from flange to point")
    group.add_argument(
        "--tool-mass", metavar="KG", help="mass of the tool, with its centre half way from flange to point"
    )
    group.add_argument("--tool-mesh", metavar="FILE", help="shape of the tool in the flange's frame: STL, OBJ or DAE")
    group.add_argument("--tool-mesh-scale", metavar="S", help="metres per unit of that file; 0.001 for millimetres")
    group.add_argument("--tip", metavar="NAME", help="tip without a tool, such as tool0 (default: the arm's own)")
    group.add_argument(
        "--joints", metavar="A,B,...", help="of a URDF: the arm's joints, if others move too, or to take in a gripper's"
    )
    group.add_argument(
        "--hold",
        action="append",
        metavar="JOINT=VALUE",
        help="of a URDF: hold a joint that is not one of q, such as a rail's, at a place in metres, or in radians if "
        "it turns (with --degrees in degrees); may be repeated, or several separated by commas",
    )
    group.add_argument(
        "--package-dir",
        action="append",
        metavar="DIR",
        help=f"of a URDF: folder of the packages with its meshes; may be repeated, or several separated by "
        f"{os.pathsep!r} (also looked for: around the file, in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH)",
    )


def arm_of(name: str, arguments: argparse.Namespace) -> ArmDescription:
    """Return the arm that the flags of `add_arm_flags` describe, with `--tip` as its default tip."""
    return arm_with(name, **arm_options(arguments))


def arm_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options for `arm_with` that the flags of `add_arm_flags` give."""
    return {
        "calibration": arguments.calibration,
        "repair": arguments.repair,
        "tool": tool_of(arguments),
        "tip": arguments.tip,
        "joints": joints_of(arguments),
        "held": held_of(arguments),
        "package_dirs": package_dirs_of(arguments),
    }


def arm_with(
    name: str,
    *,
    calibration: str | None = None,
    repair: bool = False,
    tool: Tool | None = None,
    tip: str | None = None,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    package_dirs: Sequence[str] = (),
) -> ArmDescription:
    """Return an arm with a calibration, and with a tool or another tip."""
    if tool is not None and tip is not None:
        raise InputError("give --tip or --tool, not both")
    arm = arm_named(name, tip=tip, joints=joints, held=held, package_dirs=package_dirs)
    if calibration is not None:
        arm = arm.calibrated(calibration, repair=repair)
    if tool is not None:
        return arm.with_tool(tool)
    if tip is None:
        return arm
    check_known("tip", tip, arm.tips)
    return replace(arm, default_tip=tip)


def joints_of(arguments: argparse.Namespace) -> list[str] | None:
    return None if arguments.joints is None else [joint.strip() for joint in arguments.joints.split(",")]


def held_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the places of `--hold` [rad, m]; with `--degrees`, those of joints that turn are typed in degrees."""
    held: dict[str, float] = {}
    for text in [part for given in arguments.hold or () for part in given.split(",")]:
        joint, _, value = text.rpartition("=")
        if not joint.strip():
            raise InputError(f"--hold must be JOINT=VALUE, got {shown(text)}")
        held[joint.strip()] = numbers_of(f"--hold {joint.strip()}", value, 1)[0]
    if held and getattr(arguments, "degrees", False):
        turning = turning_joints(arguments.arm)
        held = {joint: math.radians(value) if joint in turning else value for joint, value in held.items()}
    return held


def package_dirs_of(arguments: argparse.Namespace) -> list[str]:
    given = os.pathsep.join(arguments.package_dir or ())
    return [folder for folder in given.split(os.pathsep) if folder]


def print_notes(arm: ArmDescription) -> None:
    """Print on stderr what was left out of an arm's URDF, a line each."""
    for note in arm.notes:
        complain(f"note: {in_flags(note)}")


def tool_of(arguments: argparse.Namespace) -> Tool | None:
    """Return the tool that the flags of `add_arm_flags` describe, None without one."""
    others = [name for name in ARM_FLAGS if name.startswith("tool_") and getattr(arguments, name) is not None]
    if arguments.tool is None:
        if others:
            raise InputError(f"--{others[0].replace('_', '-')} needs --tool")
        return None
    if arguments.tool in TOOLS:
        if others:
            raise InputError(
                f"the tool {arguments.tool} has a shape and a mass; leave out --{others[0].replace('_', '-')}"
            )
        return TOOLS[arguments.tool]
    centre = pose_numbers_of("--tool", arguments.tool)
    mass, radius, scale = (
        None if (text := getattr(arguments, name)) is None else numbers_of(f"--{name.replace('_', '-')}", text, 1)[0]
        for name in ("tool_mass", "tool_radius", "tool_mesh_scale")
    )
    middle: Any = tuple(np.divide(centre[:3], 2).tolist())
    try:
        tool = Tool(centre, mass or 0.0, middle) if radius is None else Tool.tube(centre, radius, mass=mass or 0.0)
    except InputError as error:
        raise InputError(re.sub(r"^tool\b", "--tool", str(error))) from None
    if arguments.tool_mesh is None:
        return tool
    return replace(tool, mesh=arguments.tool_mesh, mesh_scale=1.0 if scale is None else scale)


def numbers_of(flag: str, text: str, count: int) -> list[float]:
    """Return the numbers of a flag, separated by commas or spaces, also in URScript's brackets: p[...] or [...]."""
    bare = text.strip().removeprefix("p")
    bare = bare[1:-1] if bare[:1] + bare[-1:] == "[]" else text
    words, values = bare.replace(",", " ").split(), []
    wanted = "a number" if count == 1 else f"{count} numbers, separated by commas"
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            which = f": {shown(word)} is no number" if count > 1 else ""
            raise InputError(f"{flag} must be {wanted}, got {shown(text)}{which}") from None
    if len(values) != count:
        raise InputError(f"{flag} must be {wanted}, got {shown(text)}")
    return values


def pose_numbers_of(flag: str, text: str, *, strict: bool = False) -> list[float]:
    """Return the six numbers of a pose; one whose rotation vector may be in degrees gets a note, or is refused."""
    numbers = numbers_of(flag, text, 6)
    said = may_be_degrees(f"of {flag}", numbers[3:])
    if said and strict:
        raise InputError(said)
    if said:
        complain(f"note: {said}")
    return numbers


def may_be_degrees(of: str, rotation: Sequence[float]) -> str:
    """Say so if a rotation vector is longer than a turn; empty if it is not."""
    turns = float(np.linalg.norm(rotation)) / (2 * np.pi)
    said = f"the rotation vector {of} is {turns:.3g} turns long; rx, ry, rz are in radians, not degrees"
    return said if turns > 1.0 else ""


def posture_of(
    flag: str, text: str, count: int, *, degrees: bool, limits: Sequence[ArrayLike] = ()
) -> NDArray[np.float64]:
    """Return the joint angles of a flag [rad], within a turn, or within the limits of joints that turn farther."""
    angles = np.array(numbers_of(flag, text, count))
    q = np.radians(angles) if degrees else angles
    most = np.abs(np.array([np.full(count, 2.0 * np.pi), *limits])).max(axis=0)
    beyond = ~(np.abs(q) <= most + 1e-6)
    if beyond.any():
        joint = int(np.where(beyond, np.abs(q), 0.0).argmax())
        unit = f"±{np.degrees(most[joint]):g} degrees" if degrees else f"±{most[joint]:.4g} rad"
        hint = "" if degrees else "; for degrees add --degrees"
        raise InputError(f"{flag} must be within {unit}, got {angles[joint]:g}{hint}")
    return q

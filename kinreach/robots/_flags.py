"""Flags of the command line that choose the arm: its name or file, its calibration, its tool and its tip."""

from __future__ import annotations

import argparse
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from kinreach._checks import check_known, shown
from kinreach._flags import numbers_of, pose_numbers_of
from kinreach.errors import InputError
from kinreach.robots._description import ArmDescription
from kinreach.robots._registry import arm_named
from kinreach.robots._tools import TOOLS, Tool
from kinreach.robots._urdf_file import turning_joints


@dataclass(frozen=True)
class ArmFlags:
    """What the flags of the command line say of an arm.

    Attributes:
        calibration: File or name, as `ArmDescription.calibrated` takes it.
        repair: Correct a calibration that an old exporter folded.
        tool: On the flange.
        tip: Key of the arm's tips; not with a tool.
        joints: Names of a file's joints that are the arm's.
        held: Where a file's other joints are held [rad, m].
        package_dirs: Folders of a file's packages.
        srdf: MoveIt's file with the links that may touch.
    """

    #: The flags, as attributes of the parsed arguments.
    NAMES: ClassVar = (
        "calibration", "repair", "tool", "tool_radius", "tool_mass", "tool_mesh", "tool_mesh_scale", "tip", "joints",
        "hold", "package_dir", "srdf",
    )  # fmt: skip

    calibration: str | None = None
    repair: bool = False
    tool: Tool | None = None
    tip: str | None = None
    joints: Sequence[str] | None = None
    held: Mapping[str, float] | None = None
    package_dirs: Sequence[str] = ()
    srdf: str | None = None

    @staticmethod
    def add_to(parser: argparse.ArgumentParser) -> None:
        """Add the flags of `NAMES`."""
        group = parser.add_argument_group("the arm")
        group.add_argument(
            "--calibration",
            metavar="FILE",
            help="factory calibration of a UR: the ROS driver's kinematics.yaml, the controller's calibration.conf, a "
            "program of PolyScope (.urp), a calibrated URDF, a recording that it is fitted to (see kinreach "
            "calibrate), or the name of a published one, such as ur5e_a",
        )
        group.add_argument("--repair", action="store_true", help="correct a calibration that an old exporter folded")
        group.add_argument(
            "--tool",
            metavar="X,Y,Z,RX,RY,RZ",
            help="tool centre point on the flange, as on the pendant: metres, rotation vector in radians; or the name "
            f"of a tool: {', '.join(TOOLS)}",
        )
        group.add_argument(
            "--tool-radius", metavar="M", help="the tool fills a tube of this radius from flange to point"
        )
        group.add_argument(
            "--tool-mass", metavar="KG", help="mass of the tool, with its centre half way from flange to point"
        )
        group.add_argument(
            "--tool-mesh", metavar="FILE", help="shape of the tool in the flange's frame: STL, OBJ, DAE or GLB"
        )
        group.add_argument("--tool-mesh-scale", metavar="S", help="metres per unit of that file; 0.001 for millimetres")
        group.add_argument("--tip", metavar="NAME", help="tip without a tool, such as tool0 (default: the arm's own)")
        group.add_argument(
            "--joints",
            metavar="A,B,...",
            help="of a file: the arm's joints, if others move too, or to take in a gripper's",
        )
        group.add_argument(
            "--hold",
            action="append",
            metavar="JOINT=VALUE",
            help="of a file: hold a joint that is not one of q, such as a rail's, at a place in metres, or in radians "
            "if it turns (with --degrees in degrees); may be repeated, or several separated by commas",
        )
        group.add_argument(
            "--package-dir",
            action="append",
            metavar="DIR",
            help=f"of a file: folder of the packages with its meshes; may be repeated, or several separated by "
            f"{os.pathsep!r} (also looked for: around the file, in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH)",
        )
        group.add_argument(
            "--srdf", metavar="FILE", help="MoveIt's file: collision checks leave out its pairs of links that may touch"
        )

    @classmethod
    def of(cls, arguments: argparse.Namespace) -> ArmFlags:
        """Read the flags of `add_to` from the parsed arguments."""
        return cls(
            arguments.calibration, arguments.repair, tool_of(arguments), arguments.tip, joints_of(arguments),
            held_of(arguments), package_dirs_of(arguments), arguments.srdf,
        )  # fmt: skip

    @classmethod
    def words(cls, arguments: argparse.Namespace) -> list[str]:
        """Return the flags of `add_to` as they were typed, for a command line without `--degrees`."""
        words: list[str] = []
        for name in cls.NAMES:
            flag, value = f"--{name.replace('_', '-')}", getattr(arguments, name)
            if name == "hold":
                value = [f"{joint}={place!r}" for joint, place in held_of(arguments).items()]
            if value is True:
                words.append(flag)
            elif value:
                words += [word for each in ([value] if isinstance(value, str) else value) for word in (flag, each)]
        return words

    def arm(self, name: str) -> ArmDescription:
        """Return the arm of this name or file, calibrated, with the tool or with the tip as its default."""
        if self.tool is not None and self.tip is not None:
            raise InputError("give --tip or --tool, not both")
        arm = arm_named(name, tip=self.tip, joints=self.joints, held=self.held, package_dirs=self.package_dirs)
        if self.calibration is not None:
            arm = arm.calibrated(self.calibration, repair=self.repair)
        if self.srdf is not None:
            arm = arm.with_srdf(self.srdf)
        if self.tool is not None:
            return arm.with_tool(self.tool)
        if self.tip is None:
            return arm
        check_known("tip", self.tip, arm.tips)
        return replace(arm, default_tip=self.tip)


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


def tool_of(arguments: argparse.Namespace) -> Tool | None:
    """Return the tool that the flags of `add_arm_flags` describe, None without one."""
    others = [name for name in ArmFlags.NAMES if name.startswith("tool_") and getattr(arguments, name) is not None]
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

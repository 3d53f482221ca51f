"""The serial chain of an arm's URDF as transforms, and the URDF with other transforms."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from kinreach._checks import Floats, shown
from kinreach._rotations import rpy
from kinreach.errors import InputError
from kinreach.robots._urdf import TURNING, CheckedUrdf, link_at, origin_of, set_origin


@dataclass(frozen=True, eq=False)
class UrdfChain:
    """The joints of `q` between base and tip, each turning about the z axis of a frame of its own.

    An arm with others is refused.

    Attributes:
        robot: The `<robot>` element that it is of.
        names: Of the joints.
        placements: A0 to An of `T_base_tip = A0 Rz(q0) A1 ... An`, shape (n + 1, 4, 4).
        turned: From each joint's frame in the URDF to the one whose z axis is the joint's, shape (n, 4, 4).
        before: From the frame of the joint before to the joint's parent link, fixed joints between, shape (n, 4, 4).
    """

    robot: ET.Element
    names: tuple[str, ...]
    placements: Floats
    turned: Floats
    before: Floats

    @property
    def joints(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, robot: ET.Element, names: tuple[str, ...], *, base: str, tip: str) -> UrdfChain:
        """Read the chain of a parsed URDF from one link to another; joints that are not named are fixed."""
        from scipy.spatial.transform import Rotation

        carried_by = {link_at(joint, "child"): joint for joint in robot.findall("joint")}
        link, path = tip, []
        while link != base:
            path.append(carried_by[link])
            link = link_at(path[-1], "parent")
        for joint in path:
            if joint.get("type") != "fixed" and (joint.get("type") not in TURNING or joint.find("mimic") is not None):
                does = "slides" if joint.find("mimic") is None else "follows another"
                raise InputError(
                    f"joint {shown(joint.get('name'))} {does}; only arms whose joints turn, each alone, are calibrated"
                )
        placements, turned, before, T = [], [], [], np.eye(4)
        for joint in reversed(path):
            if joint.get("name") not in names:
                T = T @ origin_of(joint)
                continue
            axis = joint.find("axis")
            direction = np.array((1.0, 0.0, 0.0) if axis is None else axis.get("xyz", "1 0 0").split(), dtype=float)
            align = np.eye(4)
            align[:3, :3] = Rotation.align_vectors([direction / np.linalg.norm(direction)], [(0.0, 0.0, 1.0)])[
                0
            ].as_matrix()
            before.append(T)
            placements.append(T @ origin_of(joint) @ align)
            turned.append(align)
            T = align.T
        return cls(robot, names, np.array([*placements, T]), np.array(turned), np.array(before))

    def urdf_with(self, placements: Floats) -> CheckedUrdf:
        """Return the URDF with joints 2 to n placed as in `placements`; the first stays, and the tip."""
        robot = deepcopy(self.robot)
        for index in range(1, self.joints):
            T = np.linalg.inv(self.before[index]) @ placements[index] @ self.turned[index].T
            set_origin(robot, self.names[index], T[:3, 3], rpy(T[:3, :3]))
        return CheckedUrdf(robot)

"""Tools: what is mounted on an arm's flange, where its centre point is, and how it is put into a URDF."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import Floats, as_vector, check_known, check_number, check_path, shown
from kinreach._rotations import MAX_TOOL, as_frame, rpy
from kinreach.errors import InputError
from kinreach.robots._grippers import FINGER_MASS, PALM_MASS, PARALLEL_GRIPPER, TCP_OFFSET, finger, palm
from kinreach.robots._meshes import collision_mesh
from kinreach.robots._urdf import PACKAGE, Solid, add_joint, add_link, named

#: The tip that carries a tool, where an arm has it.
FLANGE = "tool0"
#: The tip that a tool's centre point is, and the link with its mass and shapes.
TOOL, TOOL_BODY = "tool", "tool_body"


@dataclass(frozen=True, eq=False)
class Tool:
    """A tool on an arm's flange. Poses and lengths are in the flange's frame (`tool0` of a UR).

    Attributes:
        centre: Pose of the tool centre point, as on the pendant: `[x, y, z, rx, ry, rz]` [m, rotation vector in rad],
            or a 4x4 transform.
        mass: [kg]; 0 leaves the tool out of the dynamics.
        centre_of_mass: [m].
        shapes: Boxes, `((x, y, z), xyz, rpy)`, cylinders, `((radius, length), xyz, rpy)`, and spheres,
            `((radius,), xyz)`, that collide and are drawn, in metres and radians; `rpy` may be left out. The mass is
            spread in the first.
        mesh: A mesh file (STL, OBJ, DAE) that collides and is drawn.
        mesh_scale: Metres per unit of the mesh; 0.001 for millimetres.

    Raises:
        InputError: Not a rigid motion, metres that are millimetres, a negative mass, or another shape than
            these.
    """

    centre: ArrayLike
    mass: float = 0.0
    centre_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shapes: Sequence[Any] = ()
    mesh: str | Path | None = None
    mesh_scale: float = 1.0
    T: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", as_frame("tool", self.centre))
        check_number("mass of the tool [kg]", self.mass, least=0.0, most=1e3)
        as_vector("centre_of_mass of the tool [m]", self.centre_of_mass, 3, most=MAX_TOOL)
        object.__setattr__(self, "shapes", tuple(map(_solid, self.shapes)))
        check_number("mesh_scale of the tool", self.mesh_scale, above=0.0, most=1e3)
        if self.mesh is not None:
            object.__setattr__(self, "mesh", str(check_path("mesh of the tool", self.mesh)))

    @classmethod
    def of(cls, tool: Tool | str | ArrayLike) -> Tool:
        """Return the tool itself, the one of a name in `TOOLS`, or one of this centre point and nothing else."""
        if isinstance(tool, str):
            check_known("tool", tool, TOOLS)
            return TOOLS[tool]
        return tool if isinstance(tool, Tool) else cls(tool)

    @classmethod
    def tube(cls, centre: ArrayLike, radius: float, *, mass: float = 0.0) -> Tool:
        """Return a tool that fills a cylinder from the flange to its centre point, such as a gripper or a nozzle.

        Args:
            centre: As in `Tool`.
            radius: Of the cylinder [m].
            mass: [kg], in the middle of the cylinder.

        Raises:
            InputError: As `Tool`, or a centre point on the flange.
        """
        radius = check_number("radius of the tool [m]", radius, above=0.0, most=1.0)
        end = as_frame("tool", centre)[:3, 3]
        length = float(np.linalg.norm(end))
        if length < 1e-3:
            raise InputError("a tube from the flange to the tool centre point needs the two 1 mm apart or more")
        pitch, yaw = float(np.arccos(np.clip(end[2] / length, -1, 1))), float(np.arctan2(end[1], end[0]))
        middle: Any = tuple((end / 2).tolist())
        return cls(centre, mass, middle, (Solid((radius, length), middle, (0.0, pitch, yaw)),))


def _solid(shape: Any) -> Solid:
    """Check a shape of a tool, (size, xyz) or (size, xyz, rpy)."""
    if isinstance(shape, Solid):
        return shape
    if not isinstance(shape, tuple | list) or len(shape) not in (2, 3) or np.size(shape[0]) not in (1, 2, 3):
        raise InputError(
            "a shape of the tool must be ((x, y, z), xyz, rpy), ((radius, length), xyz, rpy) or ((radius,), xyz), got "
            f"{shown(shape)}"
        )
    size, xyz, rpy = shape if len(shape) == 3 else (*shape, (0.0, 0.0, 0.0))
    for length in size:
        check_number("size of a shape of the tool [m]", length, above=0.0, most=MAX_TOOL)
    place = as_vector("xyz of a shape of the tool [m]", xyz, 3, most=MAX_TOOL)
    turn = as_vector("rpy of a shape of the tool [rad]", rpy, 3, most=2 * np.pi)
    numbers: Any = (tuple(map(float, size)), tuple(place.tolist()), tuple(turn.tolist()))
    return Solid(*numbers)


_OPEN = PARALLEL_GRIPPER.opening / 2 + 0.006
#: Tools by name: the thesis's gripper, open by 10 cm, for arms that do not carry it.
TOOLS = {
    "gripper": Tool(
        [0.0, 0.0, TCP_OFFSET, 0.0, 0.0, 0.0],
        PALM_MASS + 2 * FINGER_MASS,
        (0.0, 0.0, 0.065),
        (*palm(), finger(_OPEN), finger(-_OPEN)),
    )
}


def add_tool(robot: ET.Element, flange: str, tool: Tool, package_root: str | None) -> str | None:
    """Add a tool to a parsed URDF: the link `tool` at its centre point, and `tool_body` if it has a mass or shapes.

    Returns:
        The folder that `package://` stands for now.
    """
    if tool.mass or tool.shapes or tool.mesh:
        add_link(
            robot,
            TOOL_BODY,
            mass=tool.mass,
            centre=tool.centre_of_mass,
            solids=tool.shapes,
            rgba="0.25 0.45 0.70 1",
        )
        add_joint(robot, f"{TOOL_BODY}_joint", flange, TOOL_BODY)
    if tool.mesh is not None:
        package_root = _add_mesh(robot, Path(tool.mesh), tool.mesh_scale, package_root)
    add_link(robot, TOOL)
    add_joint(robot, f"{TOOL}_joint", flange, TOOL, xyz=tool.T[:3, 3].tolist(), rpy=rpy(tool.T[:3, :3]))
    return package_root


def _add_mesh(robot: ET.Element, file: Path, scale: float, package_root: str | None) -> str:
    """Give `tool_body` a mesh; where others are in another folder, all get addresses below a common one."""
    folder = file.resolve().parent
    root = folder if package_root is None else Path(os.path.commonpath([Path(package_root).resolve(), folder]))
    if package_root is not None:
        way = Path(package_root).resolve().relative_to(root).as_posix()
        for mesh in robot.iter("mesh"):
            inside = mesh.get("filename", "").removeprefix(PACKAGE)
            mesh.set("filename", f"{PACKAGE}{inside if way == '.' else f'{way}/{inside}'}")
    address = f"{PACKAGE}{file.resolve().relative_to(root).as_posix()}"
    small = np.full(3, 1e-3 * scale)  # so that one in millimetres is read, and named as such
    reach = float(np.abs(collision_mesh(address, str(root), small).vertices).max()) * scale
    if reach > MAX_TOOL:
        raise InputError(f"the tool's mesh {file} reaches {reach:g} m away; millimetres need mesh_scale=0.001")
    body = named(robot, "link", TOOL_BODY)
    for kind in ("visual", "collision"):
        geometry = ET.SubElement(ET.SubElement(body, kind), "geometry")  # type: ignore[arg-type]
        ET.SubElement(geometry, "mesh", filename=address, scale=" ".join([repr(float(scale))] * 3))
    return str(root)

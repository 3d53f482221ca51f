"""The shapes of an arm's links as triangles, to be drawn."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.robots._description import ArmDescription
from kinreach.robots._meshes import placed_parts
from kinreach.robots._ur_figures import figure_of
from kinreach.robots._urdf import origin_of

#: Default colour.
GREY = (0.62, 0.64, 0.67, 1.0)


@dataclass(frozen=True, eq=False)
class LinkShape:
    """Triangles of one colour.

    Attributes:
        link: Link that carries them.
        vertices: Corners in the link's frame [m], shape (v, 3).
        normals: Direction of the surface at each corner, shape (v, 3).
        faces: Indices of corners, shape (f, 3).
        rgba: Colour, 0 to 1, as the file has it.
    """

    link: str
    vertices: Floats
    normals: Floats
    faces: NDArray[np.int64]
    rgba: tuple[float, ...]


def link_shapes(arm: ArmDescription, kind: str = "visual", *, meshes_only: bool = False) -> list[LinkShape]:
    """Return the shapes of all links, as they are drawn or as they collide.

    Links that are drawn by the cylinders of a UR without meshes have the figure that is made from these
    (`kinreach.robots._ur_figures`), also with `meshes_only`, which leaves out boxes, cylinders and spheres.

    Returns:
        Link by link in the order of the URDF, one for each colour of a mesh; empty for an arm without shapes.
    """
    robot = arm.robot
    materials = {m.get("name", ""): _rgba(m) for m in robot.findall("material")}
    return [
        shape
        for link in robot.iter("link")
        for shape in _shapes_of(link, kind, materials, arm, meshes_only=meshes_only)
    ]


def _shapes_of(
    link: ET.Element,
    kind: str,
    materials: Mapping[str, tuple[float, ...] | None],
    arm: ArmDescription,
    *,
    meshes_only: bool,
) -> Iterator[LinkShape]:
    name = link.get("name", "")
    if kind == "visual" and (figure := figure_of(link)) is not None:
        yield from (LinkShape(name, *part) for part in figure)
        return
    for element in link.iter(kind):
        if not meshes_only or element.find("geometry/mesh") is not None:
            yield from _shapes(name, element, materials, arm)


def _shapes(
    link: str, element: ET.Element, materials: Mapping[str, tuple[float, ...] | None], arm: ArmDescription
) -> Iterator[LinkShape]:
    import trimesh

    material = element.find("material")
    rgba = None if material is None else _rgba(material) or materials.get(material.get("name", ""))
    T = origin_of(element)
    parts: list[tuple[Any, Floats, tuple[float, ...]]] = []
    if (box := element.find("geometry/box")) is not None:
        parts.append((trimesh.creation.box([float(v) for v in box.get("size", "").split()]), np.eye(4), rgba or GREY))
    elif (cylinder := element.find("geometry/cylinder")) is not None:
        radius, length = (float(cylinder.get(key, "0")) for key in ("radius", "length"))
        parts.append((trimesh.creation.cylinder(radius, length, sections=32), np.eye(4), rgba or GREY))
    elif (sphere := element.find("geometry/sphere")) is not None:
        parts.append((trimesh.creation.icosphere(3, float(sphere.get("radius", "0"))), np.eye(4), rgba or GREY))
    elif (mesh := element.find("geometry/mesh")) is not None:
        scale = np.array([float(s) for s in mesh.get("scale", "1 1 1").split()])
        T[:3, :3] *= scale
        for part, T_part in placed_parts(mesh.get("filename", ""), arm.package_root(), scale):
            merged = part.process().copy()
            colour = getattr(merged.visual, "material", merged.visual).main_color
            parts.append((merged, T_part, rgba or tuple((np.asarray(colour, dtype=float) / 255).tolist())))
    for part, T_part, colour in parts:
        part.apply_transform(T @ T_part)
        yield LinkShape(link, np.array(part.vertices), np.array(part.vertex_normals), np.array(part.faces), colour)


def _rgba(material: ET.Element) -> tuple[float, ...] | None:
    colour = material.find("color")
    return None if colour is None else tuple(float(v) for v in colour.get("rgba", "").split())

"""The URDF's visual meshes as MuJoCo geoms.

MuJoCo reads no Collada. The files are read with trimesh, and the parts of a link that have the same colour become
one mesh. They have no mass and no contact; the collision shapes of such a link are put out of sight.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import numpy as np

from kinreach.envs.engine import mujoco
from kinreach.envs.looks import DRAWN_ONLY, HIDDEN_GROUP
from kinreach.errors import InstallationError
from kinreach.kinematics.goals import Floats
from kinreach.robots import ArmDescription

#: The files' colours are darker than the arm is; they are raised to this power.
_GAMMA = 0.75
_Colour = tuple[float, ...]


def add_visual_meshes(spec: Any, arm: ArmDescription) -> None:
    """Draw the links that have visual meshes by them.

    Raises:
        InstallationError: trimesh or pycollada is missing.
    """
    for link in ET.fromstring(arm.urdf).iter("link"):
        name = link.get("name", "")
        parts = [part for visual in link.iter("visual") for part in _parts(visual, arm)]
        if not parts:
            continue
        for geom in spec.body(name).geoms:
            geom.group = HIDDEN_GROUP
        for index, (colour, mesh) in enumerate(_by_colour(parts)):
            _add_mesh(spec, name, f"{name}_visual_{index}", colour, mesh)


def _parts(visual: ET.Element, arm: ArmDescription) -> Iterator[tuple[_Colour, Any]]:
    """Colours and meshes of one `<visual>`, in the link's frame."""
    element = visual.find("geometry/mesh")
    if element is None:
        return
    try:
        import collada  # noqa: F401  (trimesh reads .dae with it, and says nothing helpful if it is missing)
        import trimesh
    except ImportError as error:
        raise InstallationError(f"{error}; visual meshes need: pip install trimesh pycollada") from error
    file = element.get("filename", "").replace("package://", f"{arm.package_root()}/")
    scene: Any = trimesh.load(file, force="scene")
    T = _origin(visual.find("origin"))
    T[:3, :3] *= np.array([float(s) for s in element.get("scale", "1 1 1").split()])
    for node in scene.graph.nodes_geometry:
        T_scene_part, geometry = scene.graph[node]
        mesh = scene.geometry[geometry].copy()
        colour = np.asarray(getattr(mesh.visual, "material", mesh.visual).main_color, dtype=float)
        colour = (colour / 255) ** _GAMMA
        mesh.apply_transform(T @ T_scene_part)
        yield tuple(colour), mesh


def _origin(element: ET.Element | None) -> Floats:
    T = np.eye(4)
    if element is not None:
        T[:3, 3] = [float(v) for v in element.get("xyz", "0 0 0").split()]
        roll, pitch, yaw = (float(v) for v in element.get("rpy", "0 0 0").split())
        quat, R = np.empty(4), np.empty(9)
        mujoco.mju_euler2Quat(quat, np.array([roll, pitch, yaw]), "XYZ")  # capitals: about fixed axes, as in URDF
        mujoco.mju_quat2Mat(R, quat)
        T[:3, :3] = R.reshape(3, 3)
    return T


def _by_colour(parts: list[tuple[_Colour, Any]]) -> Iterator[tuple[_Colour, list[Any]]]:
    groups: dict[_Colour, list[Any]] = defaultdict(list)
    for colour, mesh in parts:
        groups[colour].append(mesh)
    yield from groups.items()


def _add_mesh(spec: Any, body: str, name: str, colour: _Colour, meshes: list[Any]) -> None:
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)])
    spec.add_mesh(
        name=name,
        uservert=np.concatenate([mesh.vertices for mesh in meshes]).ravel(),
        usernormal=np.concatenate([mesh.vertex_normals for mesh in meshes]).ravel(),
        userface=faces.ravel(),
        userfacenormal=faces.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # the parts are open surfaces
    )
    spec.body(body).add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        rgba=colour,
        **DRAWN_ONLY,
    )

"""Visuals of a scene: light, materials, cameras and their housings, and how the links are drawn.

None of it has mass or contact.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.robots import ArmDescription, Box, CameraMount
from kinreach.robots.inside import LinkShape, link_shapes
from kinreach.sim._engine import mujoco

#: Geoms of this group are not drawn by default.
HIDDEN_GROUP = 3
#: Largest pictures that can be drawn [px].
MAX_WIDTH, MAX_HEIGHT = 1920, 1080
#: What makes a geom a drawing: no mass, no contact.
DRAWN_ONLY: Mapping[str, Any] = {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0.0}
_LEG = 0.05  # edge of a table leg [m]
DEFAULT_MATERIAL = "metal"
#: Colour, shininess and reflectance of the materials; obstacles of other names are metal.
_MATERIALS = {
    "floor": ((0.80, 0.82, 0.85, 1.0), 0.1, 0.03),
    "table": ((0.78, 0.71, 0.60, 1.0), 0.1, 0.0),
    "metal": ((0.36, 0.38, 0.42, 1.0), 0.5, 0.0),
}
#: Width, height and depth of the housing that is drawn behind the lens [m], about those of a RealSense D435.
HOUSING = (0.09, 0.025, 0.025)
_GREY, _BLACK = (0.72, 0.73, 0.75, 1.0), (0.03, 0.03, 0.04, 1.0)
#: The files' colours are darker than the arm is; they are raised to this power.
_GAMMA = 0.75


def add_visuals(spec: Any, boxes: Sequence[Box], *, visual: bool) -> None:
    """Add sky, lights, materials of the obstacles and picture quality.

    With `visual` also table legs, an endless floor and smooth edges. Without, frames are ten times faster (5 ms instead
    of 55 ms at 320x180, in software, no shadows), for cameras that measure.
    """
    _add_light(spec)
    _add_materials(spec)
    for box in boxes:
        spec.geom(box.name).material = box.name if box.name in _MATERIALS else DEFAULT_MATERIAL
        if visual and box.name == "floor":
            _draw_endless(spec, box)
        if visual and box.legs > 0:
            _draw_legs(spec, box)
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4 if visual else 0
    spec.visual.global_.offwidth, spec.visual.global_.offheight = MAX_WIDTH, MAX_HEIGHT
    # Depth resolution and shadows are scaled by these; fixed, they do not depend on how large the floor is.
    spec.stat.extent = 1.5
    spec.stat.center = (0.2, 0.0, 0.0)
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 20.0
    spec.visual.map.shadowclip = 1.6


def _add_light(spec: Any) -> None:
    # Every environment has a copy of its model with the textures. A finer sky looks the same and costs milliseconds.
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.95, 0.96, 0.97),
        rgb2=(0.60, 0.68, 0.77),
        width=128,
        height=128,
    )
    lamps = mujoco.mjtLightType
    spec.worldbody.add_light(
        name="key", type=lamps.mjLIGHT_DIRECTIONAL, pos=(1.0, -1.5, 3.0), dir=(-0.35, 0.5, -1.0),
        diffuse=(0.58, 0.56, 0.53), specular=(0.2, 0.2, 0.2), ambient=(0, 0, 0), castshadow=True,
    )  # fmt: skip
    spec.worldbody.add_light(
        name="fill", type=lamps.mjLIGHT_DIRECTIONAL, pos=(-1.5, -1.0, 2.5), dir=(0.8, 0.4, -0.8),
        diffuse=(0.16, 0.18, 0.21), specular=(0, 0, 0), ambient=(0, 0, 0), castshadow=False,
    )  # fmt: skip
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = (0.36, 0.37, 0.39), (0.12, 0.12, 0.12), (0.0, 0.0, 0.0)
    spec.visual.rgba.haze = (0.86, 0.89, 0.92, 1.0)


def _add_materials(spec: Any) -> None:
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_EDGE, rgb1=(0.97, 0.97, 0.97), rgb2=(0.97, 0.97, 0.97), markrgb=(0.72, 0.74, 0.77),
        width=256, height=256,
    )  # fmt: skip
    for name, (rgba, shininess, reflectance) in _MATERIALS.items():
        spec.add_material(name=name, rgba=rgba, shininess=shininess, specular=0.3, reflectance=reflectance)
    floor = spec.material("floor")
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    floor.texuniform, floor.texrepeat = True, (2, 2)


def _draw_endless(spec: Any, box: Box) -> None:
    """Draw a floor to the horizon instead of the box that ends in the middle of the picture."""
    spec.geom(box.name).group = HIDDEN_GROUP
    spec.body(box.name).add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1), pos=(0, 0, box.size[2] / 2), material="floor", **DRAWN_ONLY
    )


def _draw_legs(spec: Any, box: Box) -> None:
    x, y, z = np.array(box.size) / 2
    for sx in (-1, 1):
        for sy in (-1, 1):
            spec.body(box.name).add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=(_LEG / 2, _LEG / 2, box.legs / 2),
                pos=(sx * (x - _LEG), sy * (y - _LEG), -z - box.legs / 2),
                material=DEFAULT_MATERIAL,
                **DRAWN_ONLY,
            )


def camera_rotation(mount: CameraMount) -> Floats:
    """Return the orientation of a camera in its link's frame, shape (3, 3).

    Columns are the picture's right, its up, and the direction from the target to the camera (OpenGL's convention).
    """
    back = np.subtract(mount.position, mount.target)
    back = back / np.linalg.norm(back)
    right = np.cross(mount.up, back)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(back, right), back])


def add_camera(spec: Any, mount: CameraMount, *, housing: bool) -> None:
    """Add a camera and, if it has a holder and `housing` is true, draw its housing and holder."""
    body = spec.body(mount.link)
    R = camera_rotation(mount)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, R.ravel())
    body.add_camera(name=mount.name, pos=mount.position, quat=quat, fovy=mount.fovy)
    if not housing or mount.holder is None:
        return
    # The lens must not see the housing: it ends 1 mm behind the optical centre.
    centre = np.array(mount.position) + R[:, 2] * (HOUSING[2] / 2 + 0.001)
    shapes = mujoco.mjtGeom
    half = [edge / 2 for edge in HOUSING]
    body.add_geom(type=shapes.mjGEOM_BOX, size=half, pos=centre, quat=quat, rgba=_GREY, **DRAWN_ONLY)
    for side in (-0.025, 0.0, 0.025):
        lens = centre + R[:, 0] * side
        ends = [*lens, *(lens - R[:, 2] * (HOUSING[2] / 2 + 0.0005))]
        body.add_geom(type=shapes.mjGEOM_CYLINDER, size=[0.007, 0, 0], fromto=ends, rgba=_BLACK, **DRAWN_ONLY)
    stem = [*mount.holder, *centre]
    body.add_geom(type=shapes.mjGEOM_CAPSULE, size=[0.006, 0, 0], fromto=stem, rgba=_BLACK, **DRAWN_ONLY)


def add_visual_meshes(spec: Any, arm: ArmDescription) -> None:
    """Draw links by their visual meshes or a UR's figure, if they have any."""
    shapes: dict[str, dict[tuple[float, ...], list[LinkShape]]] = defaultdict(lambda: defaultdict(list))
    for shape in link_shapes(arm, meshes_only=True):
        shapes[shape.link][tuple((np.array(shape.rgba) ** _GAMMA).tolist())].append(shape)
    for link, by_colour in shapes.items():
        for geom in spec.body(link).geoms:
            geom.group = HIDDEN_GROUP
        for index, (colour, parts) in enumerate(by_colour.items()):
            _add_mesh(spec, link, f"{link}_visual_{index}", colour, parts)


def _add_mesh(spec: Any, body: str, name: str, colour: tuple[float, ...], meshes: list[LinkShape]) -> None:
    if sum(len(mesh.vertices) for mesh in meshes) < 4:  # a triangle is drawn twice; MuJoCo refuses a mesh of fewer
        meshes = meshes * 2
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)])
    spec.add_mesh(
        name=name,
        uservert=np.concatenate([mesh.vertices for mesh in meshes]).ravel(),
        usernormal=np.concatenate([mesh.normals for mesh in meshes]).ravel(),
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

"""Light, sky and materials. Nothing here has mass or contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kinreach.envs.engine import mujoco
from kinreach.robots import Box

#: Geoms of this group are not drawn by default.
HIDDEN_GROUP = 3
#: What makes a geom a drawing: no mass, no contact.
DRAWN_ONLY: Mapping[str, Any] = {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0.0}
_LEG = 0.05  # edge of a table leg [m]
_DEFAULT_LOOK = "metal"
#: Colour, shininess and reflectance of the materials; obstacles of these names wear them, all others are metal.
_MATERIALS = {
    "floor": ((0.80, 0.82, 0.85, 1.0), 0.1, 0.03),
    "table": ((0.78, 0.71, 0.60, 1.0), 0.1, 0.0),
    "metal": ((0.36, 0.38, 0.42, 1.0), 0.5, 0.0),
}


def add_looks(spec: Any, boxes: Sequence[Box], *, visual: bool) -> None:
    """Sky, lights, materials of the obstacles and picture quality.

    With `visual` also what is only drawn, table legs and a floor without end, and smooth edges. Without, a frame takes
    a tenth of the time (5 ms instead of 55 ms at 320x180, in software, no shadows): right for cameras that measure.
    """
    _add_light(spec)
    _add_materials(spec)
    for box in boxes:
        spec.geom(box.name).material = box.name if box.name in _MATERIALS else _DEFAULT_LOOK
        if visual and box.name == "floor":
            _draw_endless(spec, box)
        if visual and box.legs > 0:
            _draw_legs(spec, box)
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4 if visual else 0
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    # Depth resolution and shadows are scaled by these; fixed, they do not depend on how large the floor is.
    spec.stat.extent = 1.5
    spec.stat.center = (0.2, 0.0, 0.0)
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 20.0
    spec.visual.map.shadowclip = 1.6


def _add_light(spec: Any) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.95, 0.96, 0.97),
        rgb2=(0.60, 0.68, 0.77),
        width=512,
        height=512,
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
    """Draw a floor to the horizon in place of the box that ends in the middle of the picture."""
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
                material=_DEFAULT_LOOK,
                **DRAWN_ONLY,
            )

"""The shapes, poses and contacts of a MuJoCo scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinreach._checks import Floats
from kinreach.sim.inside import mujoco
from kinreach.view._draw import box_colour
from kinreach.view._figure import Piece, shade

#: Number of groups of geoms that MuJoCo draws, and the group of collision meshes.
DRAWN, COLLIDING = 3, 3
#: Sides of round shapes.
SECTIONS = 24


@dataclass(frozen=True, eq=False)
class Contact:
    """Names of two bodies that touch, and the position in the world [m], shape (3,)."""

    bodies: tuple[str, str]
    position: Floats


class MujocoScene:
    """The drawn bodies of a model, without the floor; `simple` draws collision meshes, a tenth of the triangles."""

    def __init__(self, model: Any, *, simple: bool = False) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        drawn = [index for index in range(model.ngeom) if _is_drawn(model, index, simple=simple)]
        self._bodies = sorted({int(model.geom_bodyid[index]) for index in drawn})
        self.links = tuple(model.body(body).name for body in self._bodies)
        self.fine = self.coarse = [
            _piece(model, index, self._bodies.index(int(model.geom_bodyid[index]))) for index in drawn
        ]

    def take(self, data: Any) -> tuple[Floats, list[Contact]]:
        """Return poses of the bodies, shape (k, 7), position [m] and quaternion w x y z in the world, and contacts."""
        own = self._data
        own.qpos[:], own.mocap_pos[:], own.mocap_quat[:] = data.qpos, data.mocap_pos, data.mocap_quat
        mujoco.mj_fwdPosition(self._model, own)
        poses = np.hstack([own.xpos[self._bodies], own.xquat[self._bodies]])
        contacts = []
        for contact in own.contact if own.ncon else ():
            if contact.dist <= 0.0:
                first, second = (self._model.body(self._model.geom_bodyid[geom]).name for geom in contact.geom)
                contacts.append(Contact((first, second), contact.pos.copy()))
        return poses, contacts


def _is_drawn(model: Any, index: int, *, simple: bool) -> bool:
    kind, group = model.geom_type[index], model.geom_group[index]
    mesh = kind == mujoco.mjtGeom.mjGEOM_MESH
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return False
    return bool(group == COLLIDING if mesh and simple else group < DRAWN)


def _piece(model: Any, index: int, link: int) -> Piece:
    vertices, faces = _triangles(model, index)
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.geom_quat[index])
    material = model.geom_matid[index]
    rgb = shade(model.geom_rgba[index]) if material < 0 else box_colour(model.mat(material).name)
    return Piece(link, vertices @ R.reshape(3, 3).T + model.geom_pos[index], faces, rgb)


def _triangles(model: Any, index: int) -> tuple[Any, Any]:
    """Vertices of a geom in its own frame, and faces."""
    import trimesh.creation as make

    kind, shapes, size = model.geom_type[index], mujoco.mjtGeom, model.geom_size[index]
    if kind == shapes.mjGEOM_MESH:
        mesh = model.geom_dataid[index]
        corners, sides = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        return (
            model.mesh_vert[corners : corners + model.mesh_vertnum[mesh]].astype(np.float64),
            model.mesh_face[sides : sides + model.mesh_facenum[mesh]].astype(np.int64),
        )
    if kind == shapes.mjGEOM_BOX:
        solid = make.box(2 * size)
    elif kind == shapes.mjGEOM_SPHERE:
        solid = make.icosphere(3, size[0])
    elif kind == shapes.mjGEOM_CAPSULE:
        solid = make.capsule(2 * size[1], size[0], count=(SECTIONS, SECTIONS))
    elif kind == shapes.mjGEOM_CYLINDER:
        solid = make.cylinder(size[0], 2 * size[1], sections=SECTIONS)
    else:
        solid = make.icosphere(3, 1.0)
        solid.apply_scale(size)
    return np.array(solid.vertices), np.array(solid.faces)

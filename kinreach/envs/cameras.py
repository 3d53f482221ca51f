"""Cameras of the description as cameras of the scene, and what is drawn of the devices."""

from __future__ import annotations

from typing import Any

import numpy as np

from kinreach.envs.engine import mujoco
from kinreach.envs.looks import DRAWN_ONLY
from kinreach.kinematics.goals import Floats
from kinreach.robots import CameraMount

#: Width, height and depth of the housing that is drawn behind the lens [m], about those of a RealSense D435.
HOUSING = (0.09, 0.025, 0.025)
_GREY, _BLACK = (0.72, 0.73, 0.75, 1.0), (0.03, 0.03, 0.04, 1.0)


def camera_rotation(mount: CameraMount) -> Floats:
    """Orientation of a camera in its link's frame, shape (3, 3).

    Columns are the picture's right, its up, and the direction from the target to the camera (OpenGL's convention).
    """
    back = np.subtract(mount.position, mount.target)
    back = back / np.linalg.norm(back)
    right = np.cross(mount.up, back)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(back, right), back])


def add_camera(spec: Any, mount: CameraMount, *, housing: bool) -> None:
    """Add a camera, and if asked for the drawing of its housing and holder (if it has a holder)."""
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

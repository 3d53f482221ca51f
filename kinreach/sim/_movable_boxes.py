"""Boxes of a scene that can be put elsewhere, with other edges: obstacles that change from episode to episode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kinreach.robots import Box
from kinreach.sim._engine import mujoco
from kinreach.sim._visuals import DEFAULT_MATERIAL, DRAWN_ONLY, HIDDEN_GROUP

#: Largest number of boxes in a scene.
MAX_BOXES = 100
#: Edges of a box that is not used [m], and where the first one lies, far below any floor; the others follow in line.
SPARE_EDGE, SPARE_PLACE, SPARE_STEP = 0.04, -20.0, -1.0


def box_names(count: int) -> tuple[str, ...]:
    """Return the names of the bodies of movable boxes."""
    return tuple(f"box {index + 1}" for index in range(count))


def spare_boxes(count: int) -> tuple[Box, ...]:
    """Return the boxes of a scene as they are before they are put somewhere."""
    return tuple(
        Box(name, 3 * (SPARE_EDGE,), 3 * (SPARE_PLACE + SPARE_STEP * index,))
        for index, name in enumerate(box_names(count))
    )


def add_movable_boxes(spec: Any, count: int) -> None:
    """Add boxes that are not in use yet to a scene."""
    for box in spare_boxes(count):
        body = spec.worldbody.add_body(name=box.name, pos=box.position)
        # so that its bounding box is along the axes whatever its edges are; it never moves by itself
        body.explicitinertial, body.mass, body.inertia = True, 1.0, (1.0, 1.0, 1.0)
        shapes, half = mujoco.mjtGeom, SPARE_EDGE / 2
        body.add_geom(name=box.name, type=shapes.mjGEOM_BOX, size=3 * [half], material=DEFAULT_MATERIAL)
        # as in obstacles that stay: bounding boxes are compared before the search for a contact
        body.add_geom(type=shapes.mjGEOM_SPHERE, size=[half / 2, 0, 0], **{**DRAWN_ONLY, "group": HIDDEN_GROUP})


def put_boxes(model: Any, boxes: Sequence[Box]) -> None:
    """Put the first movable boxes of a model where boxes are, with their edges."""
    for name, box in zip(box_names(len(boxes)), boxes, strict=True):
        body, geom = model.body(name).id, model.geom(name).id
        half = np.array(box.size) / 2
        model.body_pos[body] = box.position
        model.geom_size[geom] = half
        model.geom_rbound[geom] = np.linalg.norm(half)
        model.geom_aabb[geom, 3:] = model.bvh_aabb[model.body_bvhadr[body], 3:] = half

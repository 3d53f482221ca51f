"""Objects that lie free in a scene and can be grasped: their shape, mass and friction, of each simulation its own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats
from kinreach.sim._engine import mujoco

#: Names of the objects of a scene: the one that counts, and one beside it.
OBJECT, OTHER = OBJECTS = ("object", "other")
#: Shapes, in the order of their numbers.
BALL_SHAPE, CUBE, CYLINDER = SHAPES = ("ball", "cube", "cylinder")
COLOURS = ((0.86, 0.04, 0.03, 1.0), (0.10, 0.35, 0.80, 1.0))
#: Friction coefficients for turning about the contact's normal and for rolling [m], MuJoCo's defaults.
TORSION, ROLLING = 0.005, 0.0001
#: Fields of the model in which objects differ between simulations.
GEOM_FIELDS = ("geom_type", "geom_size", "geom_rbound", "geom_aabb", "geom_friction")
BODY_FIELDS = ("body_mass", "body_inertia")
_TYPES = np.array([mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER], dtype=int)


class Objects(NamedTuple):
    """Objects of k simulations; every array has shape (k,).

    Attributes:
        shape: Index into `SHAPES`.
        size: Radius of a ball or of an upright cylinder, which is as high as wide; half the edge of a cube [m].
        mass: [kg].
        friction: Coefficient of sliding friction with everything it touches.
    """

    shape: NDArray[np.intp]
    size: Floats
    mass: Floats
    friction: Floats

    def of(self, rows: NDArray[Any]) -> Objects:
        """Return some of them, by their indices or where it is True."""
        return Objects(self.shape[rows], self.size[rows], self.mass[rows], self.friction[rows])

    def fields(self) -> dict[str, NDArray[Any]]:
        """Return the fields of MuJoCo's model for these objects, k rows each."""
        ball, cube, cylinder = (self.shape == index for index in range(len(SHAPES)))
        one, none = self.size, np.zeros_like(self.size)
        square = self.mass * one**2
        across = np.where(ball, 0.4 * square, np.where(cube, square * 2 / 3, square * (0.25 + 1 / 3)))
        along = np.where(cylinder, 0.5 * square, across)
        half = np.where(cylinder[:, None], np.column_stack([one, one, none]), one[:, None])
        return {
            "geom_type": _TYPES[self.shape],
            "geom_size": np.where(ball[:, None], np.column_stack([one, none, none]), half),
            "geom_rbound": one * np.select([ball, cube], [1.0, np.sqrt(3.0)], np.sqrt(2.0)),
            "geom_aabb": np.column_stack([none, none, none, one, one, one]),
            "geom_friction": np.column_stack([self.friction, none + TORSION, none + ROLLING]),
            "body_mass": self.mass,
            "body_inertia": np.column_stack([across, across, along]),
        }

    def lowest(self, rotation: Floats) -> Floats:
        """Return how far below its centre each object's lowest point is [m], for rotations to the world (k, 3, 3)."""
        down = np.abs(rotation[:, 2])
        cube, cylinder = down.sum(axis=1), np.sqrt(np.maximum(1.0 - down[:, 2] ** 2, 0.0)) + down[:, 2]
        return self.size * np.select([self.shape == 0, self.shape == 1], [1.0, cube], cylinder)


def add_free_objects(spec: Any, count: int, place: Sequence[float]) -> None:
    """Add objects to a scene, balls for the time being.

    Friction acts as that of an elliptic cone, and ten times as stiff as the normal force: what is held creeps less.
    """
    if not count:
        return
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    for name, colour in zip(OBJECTS[:count], COLOURS, strict=False):
        body = spec.worldbody.add_body(name=name, pos=place)
        body.add_freejoint(name=name)
        # The priority makes it the object's friction that counts, not the larger one of both bodies.
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.025, 0, 0],
            condim=6,
            priority=1,
            rgba=colour,
        )

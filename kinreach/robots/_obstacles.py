"""Obstacles of any shape and pose, for collision checks and paths; those of a work cell are boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import as_vector, check_number, check_path, shown
from kinreach.errors import InputError
from kinreach.robots._workcell import MAX_SIZE, Box, check_name, check_names_differ


@dataclass(frozen=True)
class Obstacle:
    """A solid or a mesh that the arm must not touch.

    Attributes:
        name: What a collision report calls it.
        shape: Sizes [m]: `(x, y, z)` of a box, `(radius, length)` of a cylinder along z, `(radius,)` of a sphere, about
            the origin; or a mesh file (STL, OBJ, DAE), taken as its triangles.
        pose: Its pose in the world, `[x, y, z, rx, ry, rz]` [m, rotation vector in rad], as `kinreach.kinematics.pose`
            has it.
        scale: Metres per unit of the mesh; 0.001 for millimetres.

    Raises:
        InputError: A size or a coordinate that is not finite, not positive where it must be, or beyond 1 km.

    Examples:
        >>> from kinreach.robots import Obstacle
        >>> Obstacle("shelf", (0.2, 0.4, 0.02), [0.5, 0, 0.3, 0, 0, 0]).shape
        (0.2, 0.4, 0.02)
    """

    name: str
    shape: Sequence[float] | str | Path
    pose: ArrayLike = (0.0,) * 6
    scale: float = 1.0

    def __post_init__(self) -> None:
        check_name("the name of an obstacle", self.name)
        of = f"of the obstacle {self.name!r}"
        pose = as_vector(f"the pose {of}", self.pose, 6, most=MAX_SIZE)
        object.__setattr__(self, "pose", tuple(pose.tolist()))
        check_number(f"the scale {of}", self.scale, above=0.0, most=MAX_SIZE)
        size: Any = self.shape
        if isinstance(size, str | Path):
            object.__setattr__(self, "shape", str(check_path(f"the mesh {of}", size)))
            return
        if not isinstance(size, Sequence | np.ndarray) or not 1 <= len(size) <= 3:
            raise InputError(f"the size {of} must be one to three numbers, or the shape a file, got {shown(size)}")
        numbers = [check_number(f"the size {of}", value, above=0.0, most=MAX_SIZE) for value in size]
        object.__setattr__(self, "shape", tuple(numbers))


def as_obstacles(obstacles: Sequence[Box | Obstacle]) -> tuple[Box | Obstacle, ...]:
    """Check obstacles, and that each has a name of its own."""
    given: Any = obstacles
    if not isinstance(given, Sequence) or not all(isinstance(each, Box | Obstacle) for each in given):
        raise InputError(f"obstacles must be a list of Box and Obstacle, got {shown(obstacles)}")
    check_names_differ([each.name for each in obstacles])
    return tuple(obstacles)

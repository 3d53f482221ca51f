"""Simple convex bodies for the links' collision shapes, boxes with rounded edges; and whether they overlap.

A body is fitted to the hull of a mesh, and is exact for a box. Overlap is by separating axes (Gottschalk, Lin and
Manocha, OBBTree, 1996), for many pairs at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.engines import load
from kinreach.errors import InputError

coal: Any = load("coal")

Single = NDArray[np.float32]

#: Longer hulls than this many times their width are cut into pieces along their length.
SLENDER = 2.5
#: Directions in which a fit is judged.
DIRECTIONS = 500
#: A radius below this [m] is that of a box.
ROUNDING = 1e-6

#: x, y, z and once more x, y: so the next and the last but one axis are slices.
WRAPPED = [0, 1, 2, 0, 1]
THIS, NEXT, LAST = slice(0, 3), slice(1, 4), slice(2, 5)
#: Two edges that are parallel separate nothing; this keeps rounding from saying they do [m].
PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class RoundedBox:
    """A box that is swept by a ball.

    Attributes:
        name: The link or obstacle that it stands for.
        joint: Index of the joint that moves it, from 0; -1 if it stands still.
        centre: In that joint's frame, or in the world [m], shape (3,).
        half: Half edges of the inner box, along the axes of the same frame [m], shape (3,).
        radius: Radius of the ball [m]; 0 for a box with sharp edges.
    """

    name: str
    joint: int
    centre: Floats
    half: Floats
    radius: float

    @property
    def top(self) -> float:
        """Largest z coordinate [m]."""
        return float(self.centre[2] + self.half[2]) + self.radius

    @property
    def bottom(self) -> float:
        """Smallest z coordinate [m]."""
        return float(self.centre[2] - self.half[2]) - self.radius

    @property
    def reach(self) -> float:
        """Radius of the ball around the centre that holds the body [m]."""
        return float(np.linalg.norm(self.half)) + self.radius


def fits(shape: Any) -> bool:
    """Whether `fitted` takes one of Pinocchio's geometry objects."""
    return isinstance(shape.geometry, (coal.Box, coal.ConvexBase))


def fitted(name: str, joint: int, shape: Any) -> Iterator[RoundedBox]:
    """Bodies that stand for one of Pinocchio's geometry objects; exact for a box that is not askew.

    Raises:
        InputError: The shape is neither a box nor a convex mesh.
    """
    corners = _vertices(shape.geometry)
    if corners is None:
        raise InputError(f"{name}: a rounded box can stand for a box or a convex mesh, not for {shape.geometry}")
    points = corners @ shape.placement.rotation.T + shape.placement.translation
    for part in [points] if isinstance(shape.geometry, coal.Box) else _pieces(points):
        yield _fit(name, joint, part)


def enclosing(boxes: Sequence[RoundedBox]) -> RoundedBox:
    """The smallest box with sharp edges around bodies of one joint."""
    low = np.min([box.centre - box.half - box.radius for box in boxes], axis=0)
    high = np.max([box.centre + box.half + box.radius for box in boxes], axis=0)
    centre = 0.5 * (low + high)
    return RoundedBox(
        boxes[0].name, boxes[0].joint, np.where(np.abs(centre) < ROUNDING, 0.0, centre), 0.5 * (high - low), 0.0
    )


def _vertices(geometry: Any) -> Floats | None:
    if isinstance(geometry, coal.Box):
        signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
        return signs * geometry.halfSide
    if isinstance(geometry, coal.ConvexBase):
        return np.array([geometry.point(index) for index in range(geometry.num_points)])
    return None


def _pieces(points: Floats) -> list[Floats]:
    """Points whose hulls make up the hull of `points`: one piece, or slices of a slender one."""
    size = np.ptp(points, axis=0)
    long = int(np.argmax(size))
    count = int(np.ceil(size[long] / np.delete(size, long).max()))
    if size[long] < SLENDER * np.delete(size, long).max():
        return [points]
    cuts = np.linspace(points[:, long].min(), points[:, long].max(), count + 1)
    sections = [_section(points, long, cut) for cut in cuts]
    pieces = []
    for k in range(count):
        inside = (points[:, long] >= cuts[k]) & (points[:, long] <= cuts[k + 1])
        pieces.append(np.concatenate([points[inside], sections[k], sections[k + 1]]))
    return pieces


def _section(points: Floats, axis: int, cut: float) -> Floats:
    """Points in a plane across `axis` whose hull is the section of the hull of `points`."""
    below, above = points[points[:, axis] <= cut], points[points[:, axis] > cut]
    if not len(below) or not len(above):
        return np.empty((0, 3))
    weight = (cut - below[:, None, axis]) / (above[None, :, axis] - below[:, None, axis])
    met: Floats = below[:, None] + weight[..., None] * (above[None] - below[:, None])
    return met.reshape(-1, 3)


def _fit(name: str, joint: int, points: Floats) -> RoundedBox:
    """The box around the points, rounded so that it reaches as far as they do: least squares over all directions."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    directions = np.abs(_sphere(DIRECTIONS))
    reached = ((points - centre) @ _sphere(DIRECTIONS).T).max(axis=0)
    corner = directions.sum(axis=1) - 1.0
    radius = float(corner @ (directions @ half - reached) / (corner @ corner))
    radius = min(radius, float(half.min())) if radius > ROUNDING else 0.0
    return RoundedBox(name, joint, centre, half - radius, radius)


def _sphere(count: int) -> Floats:
    """Unit vectors that are spread evenly (Fibonacci's lattice), shape (count, 3)."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - z * z)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def overlap(axes: Single, half: Single, radius: Single, offset: Single, box_half: Single) -> NDArray[np.bool_]:
    """Which rounded boxes overlap a box that lies along the coordinate axes.

    Exact where the radius is 0.

    Args:
        axes: Axes of the rounded boxes, shape (3, 3, m): axis, coordinate, box.
        half: Their half edges along them, without the rounding [m], shape (3, m).
        radius: Their rounding [m], shape (m,).
        offset: Their centres from the centre of the other box [m], shape (3, m).
        box_half: Half edges of the other boxes [m], shape (3, m).
    """
    size = np.abs(axes)
    met: NDArray[np.bool_] = (np.abs(offset) <= box_half + radius + (half[:, None] * size).sum(axis=0)).all(axis=0)
    met &= (np.abs((axes * offset).sum(axis=1)) <= half + radius + (size * box_half).sum(axis=1)).all(axis=0)
    close = np.flatnonzero(met)  # no face separates these
    met[close] = _edges_meet(*(array.take(close, axis=-1) for array in (axes, half, radius, offset, box_half)))
    return met


def _edges_meet(axes: Single, half: Single, radius: Single, offset: Single, box_half: Single) -> NDArray[np.bool_]:
    """Whether no cross product of one's own axes with the coordinate axes separates the boxes."""
    size = np.abs(axes)
    spread = radius * np.sqrt(np.maximum(1.0 - axes * axes, 0.0))
    axes, size = axes[:, WRAPPED], size[WRAPPED][:, WRAPPED]
    half, offset, box_half = half[WRAPPED, None], offset[WRAPPED], box_half[WRAPPED]
    spread += box_half[NEXT] * size[THIS, LAST]
    spread += box_half[LAST] * size[THIS, NEXT]
    spread += half[NEXT] * size[LAST, THIS]
    spread += half[LAST] * size[NEXT, THIS]
    apart = np.abs(offset[LAST] * axes[:, NEXT] - offset[NEXT] * axes[:, LAST]) > spread + PARALLEL
    met: NDArray[np.bool_] = ~apart.any(axis=(0, 1))
    return met

"""Where one joint cannot stand, as a table over one or two others: collisions between links few joints apart.

Whether two links touch depends only on the joints between them. With up to three of those, the colliding positions of
one are an arc of the circle that depends on the other two (one or none, in all but a few postures of the UR5), and a
table of its ends is nearly as good as the meshes it was measured on, for the price of a look-up.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach.checks import Floats
from kinreach.engines import load
from kinreach.kinematics.angles import TURN
from kinreach.kinematics.collision import GJK_TOLERANCE, CollisionChecker, Shape

pin: Any = load("pinocchio")

Flags = NDArray[np.bool_]
Single = NDArray[np.float32]
#: Whether a posture collides.
Collides = Callable[[Floats], bool]

#: Positions of the joint at which a collision is looked for, and halvings of the last step to find an arc's ends:
#: arcs narrower than 0.26 rad may be missed, ends are known to 1 mrad.
SCAN = 24
HALVINGS = 8
#: Finest step of a table: positions of a joint that the look-up tells apart.
FINE = {1: 2048, 2: 128}
#: Around the arc the table is in doubt, for as much as the arc differs at the next points of the grid, and by this
#: for what lies between them [rad].
DOUBT = 0.02


class Arcs(NamedTuple):
    """The question that a table answers.

    Attributes:
        joint: Index of the joint whose arc it is.
        over: Indices of the joints on which the arc depends, one or two.
        grid: At how many positions of each of those it is measured.
        averaged: Index of a joint on which it depends little: the mean of two positions is taken.
    """

    joint: int
    over: tuple[int, ...]
    grid: tuple[int, ...]
    averaged: int | None = None


class BlockedArcs:
    """The blocked arc of a joint as a table over others.

    Args:
        arcs: Which joint, over which.
        collides: Whether a posture collides, by the links in question.
        joints: Number of joints of the arm.

    Attributes:
        arcs: As given.
        any: Whether an arc was found at all.
    """

    def __init__(self, arcs: Arcs, collides: Collides, joints: int) -> None:
        self.arcs = arcs
        ends = _measure(arcs, collides, joints)
        self.any = bool((ends[..., 0] != ends[..., 1]).any())
        middle, half, outer = _arcs_of(ends)
        fine = FINE[len(arcs.over)]
        for axis in range(len(arcs.over)):
            middle, half, outer = (_refined(table, axis, fine) for table in (middle, half, outer))
        self._middle = np.angle(middle).astype(np.float32).ravel()
        self._open = np.where(half > 0.0, np.pi - half, TURN).astype(np.float32).ravel()
        self._outer_open = np.where(outer > 0.0, np.pi - outer, TURN).astype(np.float32).ravel()

    def blocked(self, q: Single, rows: NDArray[np.intp]) -> Flags:
        """Whether the joint stands in its blocked arc, shape (m,).

        Args:
            q: Angles within ±pi [rad], shape (n, m).
            rows: `rows_of(q, arcs.over)`, which several tables may share.
        """
        blocked: Flags = self._from_opposite(q, rows) > self._open.take(rows)
        return blocked

    def doubtful(self, q: Single, rows: NDArray[np.intp]) -> Flags:
        """Whether the joint stands in or so near its blocked arc that the table may be wrong, as `blocked`."""
        doubtful: Flags = self._from_opposite(q, rows) > self._outer_open.take(rows)
        return doubtful

    def _from_opposite(self, q: Single, rows: NDArray[np.intp]) -> Single:
        """How far the joint is from the point opposite the arc's middle [rad]: pi minus its distance on the circle."""
        opposite: Single = np.abs(np.abs(q[self.arcs.joint] - self._middle.take(rows)) - np.pi)
        return opposite


def rows_of(q: Single, over: Sequence[int]) -> NDArray[np.intp]:
    """Rows of the tables over these joints, shape (m,), for angles within ±pi [rad], shape (n, m)."""
    fine = FINE[len(over)]
    places = [np.rint(fine / TURN * q[joint] + 0.5 * fine) for joint in over]
    row = reduce(lambda before, place: (fine + 1) * before + place, places)
    return row.astype(np.intp)


def collision_test(checker: CollisionChecker, choose: Callable[[Shape, Shape], bool]) -> Collides:
    """A test whether a posture makes any of some pairs of shapes touch.

    Args:
        checker: Where shapes and pairs are from.
        choose: Whether a pair counts; is asked for all that the checker checks, the shape nearer to the base first.
    """
    shapes, geometry = checker.shapes, pin.GeometryModel()
    place: dict[int, int] = {}
    for pair in checker.geometry.collisionPairs:
        first, second = sorted((pair.first, pair.second), key=lambda index: shapes[index].joint)
        if choose(shapes[first], shapes[second]):
            for index in (first, second):
                if index not in place:
                    place[index] = geometry.addGeometryObject(checker.geometry.geometryObjects[index])
            geometry.addCollisionPair(pin.CollisionPair(place[first], place[second]))
    results, data = geometry.createData(), checker.model.createData()
    for request in results.collisionRequests:
        request.gjk_tolerance = GJK_TOLERANCE
    manager = pin.BroadPhaseManager_NaiveCollisionManager(checker.model, geometry, results)

    def touches(q: Floats, *, _kept: object = (geometry, results)) -> bool:  # the manager does not keep them alive
        return bool(pin.computeCollisions(checker.model, data, manager, q, True))

    return touches


def _measure(arcs: Arcs, collides: Collides, joints: int) -> Floats:
    """Ends of the arc [rad] on the grid, shape (*grid, averaged positions, 2); equal where there is none."""
    positions = (0.0,) if arcs.averaged is None else (0.0, np.pi / 2)
    ends = np.empty((*arcs.grid, len(positions), 2))
    q = np.zeros(joints)

    def hit(angle: float) -> bool:
        q[arcs.joint] = angle
        return collides(q)

    for cell in product(*map(range, arcs.grid)):
        q[list(arcs.over)] = [TURN * k / size - np.pi for k, size in zip(cell, arcs.grid, strict=True)]
        for k, position in enumerate(positions):
            if arcs.averaged is not None:
                q[arcs.averaged] = position
            ends[(*cell, k)] = _blocked_arc(hit)
    return ends


def _arcs_of(ends: Floats) -> tuple[NDArray[np.complex128], Floats, Floats]:
    """Tables on the grid from what was measured.

    Returns:
        Middle of the arc, as a unit complex number; its half width [rad], 0 where there is none; and the half width
        of what holds the arcs of all positions here and at the next points of the grid [rad].
    """
    low, high = ends[..., 0], ends[..., 1]
    middle = (np.exp(0.5j * (low + high)) * (high > low)).sum(axis=-1)
    half = (0.5 * (high - low)).mean(axis=-1)
    while (middle == 0).any() and (middle != 0).any():  # without an arc, the neighbours' middle is as good as any
        spread = sum(np.roll(middle, shift, axis) for shift in (-1, 1) for axis in range(middle.ndim))
        middle = np.where(middle == 0, spread, middle)
    middle = middle / np.maximum(np.abs(middle), 1e-300)
    outer = np.zeros_like(half)
    for shift in product((-1, 0, 1), repeat=half.ndim):
        near = np.roll(ends, shift, axis=tuple(range(half.ndim)))
        width = 0.5 * (near[..., 1] - near[..., 0])
        away = np.abs(np.angle(np.exp(0.5j * near.sum(axis=-1)) * np.conj(middle)[..., None]))
        outer = np.maximum(outer, np.where(width > 0.0, away + width + DOUBT, 0.0).max(axis=-1))
    return middle, half, np.minimum(outer, np.pi)


def _blocked_arc(hit: Callable[[float], bool]) -> tuple[float, float]:
    """Ends of the arc outside the longest free one [rad]; equal if nothing is blocked."""
    step = TURN / SCAN
    hits = [k for k in range(SCAN) if hit(k * step - np.pi)]
    if not hits:
        return 0.0, 0.0
    gaps = [after - before for before, after in pairwise([*hits, hits[0] + SCAN])]
    widest = int(np.argmax(gaps))
    if gaps[widest] == 1:
        return -np.pi, np.pi
    last = hits[widest] * step - np.pi
    first = last + gaps[widest] * step - TURN
    return _edge(hit, first, first - step), _edge(hit, last, last + step)


def _edge(hit: Callable[[float], bool], inside: float, outside: float) -> float:
    for _ in range(HALVINGS):
        angle = 0.5 * (inside + outside)
        inside, outside = (angle, outside) if hit(angle) else (inside, angle)
    return 0.5 * (inside + outside)


def _refined(values: np.ndarray, axis: int, count: int) -> np.ndarray:
    """A periodic table on a finer grid of `count` steps, by linear interpolation; both ends are there."""
    size = values.shape[axis]
    position = np.arange(count + 1) * (size / count)
    low = np.floor(position).astype(int)
    shape = [-1 if k == axis else 1 for k in range(values.ndim)]
    weight = (position - low).reshape(shape)
    return values.take(low % size, axis) * (1.0 - weight) + values.take((low + 1) % size, axis) * weight

"""The collision shapes of an arm in its work cell: by which joint each is moved, and tests of chosen pairs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from kinreach.checks import Floats
from kinreach.engines import load
from kinreach.kinematics.collision import GJK_TOLERANCE, CollisionChecker
from kinreach.kinematics.rounded_boxes import RoundedBox, fitted

pin: Any = load("pinocchio")


@dataclass(frozen=True)
class Part:
    """One collision shape.

    Attributes:
        name: Link or obstacle.
        joint: Index of the joint that moves it, from 0; -1 if it stands still.
        obstacle: Whether it belongs to the work cell.
    """

    name: str
    joint: int
    obstacle: bool


class CellShapes:
    """What `CollisionChecker` checks, shape by shape.

    Args:
        checker: Where the shapes and the pairs are from.
        obstacles: Names of the obstacles.

    Attributes:
        parts: The shapes, links first.
    """

    def __init__(self, checker: CollisionChecker, obstacles: frozenset[str]) -> None:
        self._model, self._geometry = checker.model, checker.geometry
        self.parts = tuple(self._part(shape, obstacles) for shape in self._geometry.geometryObjects)

    def bodies(self, choose: Callable[[Part], bool]) -> tuple[RoundedBox, ...]:
        """Bodies that stand for the chosen shapes."""
        shapes = zip(self.parts, self._geometry.geometryObjects, strict=True)
        return tuple(body for part, shape in shapes if choose(part) for body in fitted(part.name, part.joint, shape))

    def test(self, choose: Callable[[Part, Part], bool]) -> Callable[[Floats], bool]:
        """A test whether a posture makes any of the chosen pairs touch.

        Args:
            choose: Whether a pair counts; is asked for all that the checker checks, the part nearer to the base first.
        """
        chosen = [pair for pair in self._pairs() if choose(*(self.parts[index] for index in pair))]
        geometry = pin.GeometryModel()
        place = {
            index: geometry.addGeometryObject(self._geometry.geometryObjects[index])
            for index in sorted({index for pair in chosen for index in pair})
        }
        for first, second in chosen:
            geometry.addCollisionPair(pin.CollisionPair(place[first], place[second]))
        results, data = geometry.createData(), self._model.createData()
        for request in results.collisionRequests:
            request.gjk_tolerance = GJK_TOLERANCE
        manager = pin.BroadPhaseManager_NaiveCollisionManager(self._model, geometry, results)

        def touches(q: Floats, *, _kept: object = (geometry, results)) -> bool:  # the manager does not keep them alive
            return bool(pin.computeCollisions(self._model, data, manager, q, True))

        return touches

    def _pairs(self) -> Iterator[tuple[int, int]]:
        for pair in self._geometry.collisionPairs:
            first, second = sorted((pair.first, pair.second), key=lambda index: self.parts[index].joint)
            yield first, second

    def _part(self, shape: Any, obstacles: frozenset[str]) -> Part:
        fixed = shape.name in obstacles
        name = shape.name if fixed else self._model.frames[shape.parentFrame].name
        return Part(name, shape.parentJoint - 1, fixed)

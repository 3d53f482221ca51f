"""Whether a posture collides: the arm with itself, and with what stands around it.

Meshes are taken as their convex hulls, as MuJoCo takes them, so that both give the same verdict (measured: the same
pairs in 10 000 of 10 000 random postures of either arm). Boxes and cylinders are what they are. The gripper is held at
`arm.locked_joints`.
"""

from __future__ import annotations

import threading
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinreach.checks import MOST_DISTANCE, Floats, check_number
from kinreach.engines import load
from kinreach.errors import InputError
from kinreach.kinematics.arm import ArmKinematics, build_model
from kinreach.robots import ArmDescription, Box, arm_names, get_arm
from kinreach.robots.meshes import collision_mesh
from kinreach.robots.urdf import link_at, without_shapes
from kinreach.robots.workcell import as_boxes

pin: Any = load("pinocchio")
coal: Any = load("coal")

#: Joint and frame of the world in every Pinocchio model; obstacles are what is fixed to it directly.
WORLD = 0

#: At coal's own 1e-6 the search for a separating plane misses one overlap, up to 10 mm deep, in some 50 000 postures.
GJK_TOLERANCE = 1e-8
#: Random postures that tell which links always touch.
SAMPLES = 300

#: Two links or obstacles by name, in alphabetical order.
Pair = tuple[str, str]


class NoShapesError(InputError):
    """The arm has no collision shapes."""


@dataclass(frozen=True)
class Clearance:
    """How near a posture is to a collision.

    Attributes:
        distance: Smallest distance of all pairs that are checked [m]; negative is the depth of a penetration.
        pair: The links or obstacles that are that near.
    """

    distance: float
    pair: Pair


@dataclass(frozen=True)
class Shape:
    """One collision shape.

    Attributes:
        name: Link or obstacle.
        joint: Index of the joint that moves it, from 0; -1 if it stands still.
        obstacle: Whether it belongs to the work cell.
    """

    name: str
    joint: int
    obstacle: bool


class _Search(threading.local):
    """What one thread searches with.

    Args:
        model, geometry: Pinocchio's.
        margin: Of the checks [m].
    """

    def __init__(self, model: Any, geometry: Any, margin: float) -> None:
        self.data = model.createData()
        self.results = _search_data(geometry, margin)
        # The naive manager tests every pair's bounding boxes: with some ten shapes no tree is faster.
        self.broad_phase = pin.BroadPhaseManager_NaiveCollisionManager(model, geometry, self.results)


class CollisionChecker:
    """Collision checks of one arm on Pinocchio and coal. Threads may share an instance.

    Every pair of links is checked but those that no joint can move apart or together (a finger and its palm) and
    `disabled_pairs(arm)`; and every obstacle against every link but `arm.workcell.touching`.

    Args:
        arm: Kinematics, description or name of the arm. Only the arm matters: a posture collides whatever the tip.
        obstacles: Boxes in the world frame; default are those of the arm's work cell.
        margin: Pairs nearer than this [m] count as colliding, at least 0.

    Attributes:
        kinematics: Of the arm.
        pairs: The pairs that are checked.
        shapes: The shapes in `geometry.geometryObjects`, links first.
        model, geometry: Pinocchio's models of the arm and of its shapes.

    Raises:
        NoShapesError: The arm has no collision shapes.
        InputError: `margin` cannot be used, or a shape cannot be read or has no convex hull.
        UnknownNameError: There is no arm of that name.
        InstallationError: Pinocchio or coal cannot be loaded.
    """

    def __init__(
        self,
        arm: str | ArmDescription | ArmKinematics,
        *,
        obstacles: Sequence[Box] | None = None,
        margin: float = 0.0,
    ) -> None:
        margin = check_number("margin", margin, least=0.0, most=MOST_DISTANCE)
        self.kinematics = arm if isinstance(arm, ArmKinematics) else ArmKinematics(arm)
        description = self.kinematics.arm
        boxes = description.workcell.obstacles if obstacles is None else as_boxes(obstacles)
        self._obstacles, self._margin = boxes, margin
        self.model = self.kinematics.model
        self.geometry = _shapes(description, self.model, boxes)
        skipped = (*disabled_pairs(description), *description.workcell.touching)
        self._names = _pair_up(self.geometry, self.model, skipped)
        self.pairs: tuple[Pair, ...] = tuple(sorted(set(self._names)))
        self._search = _Search(self.model, self.geometry, margin)
        names = {box.name for box in boxes}
        self.shapes = tuple(
            Shape(name := _name(shape, self.model), shape.parentJoint - 1, shape.parentFrame == WORLD and name in names)
            for shape in self.geometry.geometryObjects
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(CollisionChecker, obstacles=self._obstacles, margin=self._margin), (self.kinematics,)

    def in_collision(self, q: ArrayLike) -> bool:
        """Whether any pair touches or is nearer than the margin; stops at the first.

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: `q` is malformed.
        """
        q = self.kinematics.as_posture("q", q)
        search = self._search
        return bool(pin.computeCollisions(self.model, search.data, search.broad_phase, q, True))

    def free(self, q: ArrayLike) -> bool:
        """The opposite of `in_collision`; fits where a solver takes `accept`."""
        return not self.in_collision(q)

    def contacts(self, q: ArrayLike) -> tuple[Pair, ...]:
        """All pairs that touch or are nearer than the margin, each once, in alphabetical order.

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: `q` is malformed.
        """
        q = self.kinematics.as_posture("q", q)
        search = self._search
        pin.computeCollisions(self.model, search.data, self.geometry, search.results, q, False)
        results = search.results.collisionResults
        touching = {name for name, result in zip(self._names, results, strict=True) if result.isCollision()}
        return tuple(sorted(touching))

    def distance(self, q: ArrayLike) -> Clearance:
        """The smallest distance of all pairs; the margin plays no part.

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: `q` is malformed, or there are no pairs.
        """
        if not self.pairs:
            raise InputError(f"arm {self.kinematics.arm.name!r} has no two shapes that could come nearer to each other")
        q = self.kinematics.as_posture("q", q)
        search = self._search
        nearest = pin.computeDistances(self.model, search.data, self.geometry, search.results, q)
        return Clearance(float(search.results.distanceResults[nearest].min_distance), self._names[nearest])


@lru_cache(maxsize=16)
def disabled_pairs(arm: ArmDescription) -> tuple[tuple[str, str], ...]:
    """The pairs of links that are not checked: `arm.disabled_collisions`, or if that is None, what is found.

    Found are neighbours, the links on either side of a joint; pairs that touch in the arm's home posture; and pairs
    that touch in every one of `SAMPLES` random postures.

    Raises:
        InputError: The collision shapes cannot be read.
    """
    if arm.disabled_collisions is not None:
        return arm.disabled_collisions
    model = build_model(arm)
    geometry = _shapes(arm, model, ())
    neighbours = _neighbours(arm, {_name(shape, model) for shape in geometry.geometryObjects})
    names = _pair_up(geometry, model, neighbours)
    results, data = _search_data(geometry, 0.0), model.createData()

    def touching(q: Floats) -> set[Pair]:
        pin.computeCollisions(model, data, geometry, results, q, False)
        return {name for name, result in zip(names, results.collisionResults, strict=True) if result.isCollision()}

    at_home = touching(np.array(arm.home, dtype=np.float64))
    rng, always = np.random.default_rng(0), set(names)
    for _ in range(SAMPLES):
        always &= touching(rng.uniform(model.lowerPositionLimit, model.upperPositionLimit))
    return (*neighbours, *sorted(at_home | always))


def _neighbours(arm: ArmDescription, shaped: set[str]) -> list[Pair]:
    """Links with shapes on either side of a joint that moves; links without shapes between them do not count."""
    robot = ET.fromstring(arm.urdf)
    joints = {link_at(joint, "child"): joint for joint in robot.findall("joint")}
    pairs = []
    for child in sorted(shaped & set(joints)):
        link, moves = child, False
        while link in joints and (link == child or link not in shaped):
            moves |= joints[link].get("type") != "fixed"
            link = link_at(joints[link], "parent")
        if moves and link in shaped:
            pairs.append((min(link, child), max(link, child)))
    return pairs


def _search_data(geometry: Any, margin: float) -> Any:
    """What is asked of each pair, and where the answers go.

    A search begins anew, as coal's own requests say: Pinocchio's begin where the one before ended, and a distance would
    depend on that one by up to 2e-7 m. (The switch in them is deprecated, and silencing its warning would change the
    filters of all threads.)
    """
    results = geometry.createData()
    collision, distance = coal.CollisionRequest(coal.CollisionRequestFlag.NO_REQUEST, 1), coal.DistanceRequest()
    collision.security_margin, collision.gjk_tolerance = margin, GJK_TOLERANCE
    for pair in range(len(geometry.collisionPairs)):
        results.collisionRequests[pair] = collision
        results.distanceRequests[pair] = distance
    return results


def _shapes(arm: ArmDescription, model: Any, obstacles: Sequence[Box]) -> Any:
    """Geometry of the links, meshes as their hulls, followed by the obstacles, fixed to the world."""
    robot = without_shapes(arm.urdf, "visual")
    meshes = {
        link.get("name", ""): [_take_mesh(shape, arm) for shape in link.findall("collision")]
        for link in robot.findall("link")
    }
    try:
        geometry = pin.buildGeomFromUrdfString(model, ET.tostring(robot, encoding="unicode"), pin.COLLISION)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"the collision shapes of arm {arm.name!r} cannot be read: {error}") from None
    if not len(geometry.geometryObjects):
        shaped = [name for name in arm_names() if "<collision" in get_arm(name).urdf]
        raise NoShapesError(
            f"arm {arm.name!r} has no collision shapes, which collision checks and the simulation need; its kinematics "
            f"works without. Arms with shapes: {', '.join(shaped)}, and from a URDF with <collision> any other"
        )
    for shape in geometry.geometryObjects:
        if (points := meshes[_name(shape, model)].pop(0)) is not None:
            shape.geometry = _hull(shape.name, points)
    for box in obstacles:
        placement = pin.SE3(np.eye(3), np.array(box.position, dtype=np.float64))
        geometry.addGeometryObject(pin.GeometryObject(box.name, WORLD, WORLD, placement, coal.Box(*box.size)))
    return geometry


def _take_mesh(shape: ET.Element, arm: ArmDescription) -> Floats | None:
    """Corners of a collision mesh in the shape's frame [m], with a ball in its place; None for another shape."""
    geometry = shape.find("geometry")
    mesh = None if geometry is None else geometry.find("mesh")
    if geometry is None or mesh is None:
        return None
    scale = np.array([float(s) for s in mesh.get("scale", "1 1 1").split()])
    vertices, _ = collision_mesh(mesh.get("filename", ""), arm.package_root(), scale)
    geometry.remove(mesh)
    ET.SubElement(geometry, "sphere", radius="1")
    return vertices * scale


def _hull(name: str, points: Floats) -> Any:
    corners = coal.StdVec_Vec3s()
    corners.extend(points)
    try:
        return coal.Convex.convexHull(corners, True, "Qt")
    except (RuntimeError, ValueError) as error:
        raise InputError(f"the collision mesh {name!r} has no convex hull: {error}") from error


def _pair_up(geometry: Any, model: Any, skipped: Iterable[tuple[str, str]]) -> list[Pair]:
    """Register the pairs to check, all but the skipped ones; returns their names in the same order."""
    left_out = {frozenset(pair) for pair in skipped}
    names: list[Pair] = []
    for (i, one), (j, other) in combinations(enumerate(geometry.geometryObjects), 2):
        a, b = _name(one, model), _name(other, model)
        rigid = one.parentJoint == other.parentJoint and (one.parentFrame == WORLD) == (other.parentFrame == WORLD)
        if rigid or frozenset((a, b)) in left_out:
            continue
        geometry.addCollisionPair(pin.CollisionPair(i, j))
        names.append((min(a, b), max(a, b)))
    return names


def _name(shape: Any, model: Any) -> str:
    return str(shape.name if shape.parentFrame == WORLD else model.frames[shape.parentFrame].name)

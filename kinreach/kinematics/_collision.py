"""Collision checks of postures: the arm with itself, and with obstacles.

Solvers and environments, single and in batches, use this one verdict. With `arm.meshes` "hulls" the convex hulls of
meshes are checked, as in MuJoCo, so that its contacts agree (`benchmarks.studies.collision_agreement`); with
"triangles" the meshes themselves. The gripper is held at `arm.locked_joints`.
"""

from __future__ import annotations

import threading
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache, partial
from itertools import combinations
from pathlib import Path
from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_DISTANCE, Floats, as_floats, check_entries, check_known, check_number
from kinreach._engines import load
from kinreach._rotations import placement, pose
from kinreach.errors import InputError, NoShapesError
from kinreach.kinematics._arm import ArmKinematics, build_model, sampling_limits
from kinreach.kinematics._solutions import SLACK
from kinreach.robots import ArmDescription, Box, Obstacle, arm_names, get_arm
from kinreach.robots.inside import (
    MESHES_AS,
    Mesh,
    as_obstacles,
    collision_mesh,
    mesh_in_metres,
    neighbours,
    without_shapes,
)

pin: Any = load("pinocchio")
coal: Any = load("coal")

HULLS, TRIANGLES = MESHES_AS
#: Joint and frame of the world in every Pinocchio model; obstacles are what is fixed to it directly.
WORLD = 0

#: At coal's own 1e-6 the search for a separating plane misses one overlap, up to 10 mm deep, in some 50 000 postures.
#: With this, overlaps that are missed are less than 1 µm deep, in the same time.
GJK_TOLERANCE = 1e-10
#: Defaults of `margin` [m]: of checkers and environments; of paths, whose margin must be above 0.
MARGIN, PATH_MARGIN = 0.0, 0.005
#: Number of random postures in which links that always touch are found.
SAMPLES = 300

#: Two links or obstacles by name, in alphabetical order.
Pair = tuple[str, str]


class Cause(IntEnum):
    """Why a posture is impossible; the first that is true."""

    NONE = 0
    LIMITS = 1
    SELF = 2
    OBSTACLE = 3


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
    """The search data of one thread."""

    def __init__(self, model: Any, geometry: Any, links: Any, margin: float) -> None:
        self.data = model.createData()
        self.results, self.link_results = _search_data(geometry, margin), _search_data(links, margin)
        # The naive manager tests every pair's bounding boxes: with some ten shapes no tree is faster.
        self.any_pair = pin.BroadPhaseManager_NaiveCollisionManager(model, geometry, self.results)
        self.links = pin.BroadPhaseManager_NaiveCollisionManager(model, links, self.link_results)


class CollisionChecker:
    """Collision checks of one arm on Pinocchio and coal. Threads may share an instance.

    Every pair of links is checked but those that no joint can move apart or together (a finger and its palm) and
    `disabled_pairs(arm)`; and every obstacle against every link but `arm.workcell.touching`.

    Args:
        arm: Kinematics, description or name of the arm. Only the arm matters: a posture collides whatever the tip.
        obstacles: Boxes and `kinreach.robots.Obstacle`s in the world frame; default are those of the arm's work cell,
            to which you add yours by `[*arm.workcell.obstacles, ...]`.
        margin: Pairs nearer than this [m] count as colliding, at least 0.
        meshes: `"hulls"` checks the convex hulls of meshes, `"triangles"` their surfaces: a part that is wholly
            inside a mesh does not touch it. Default is `arm.meshes`.

    Attributes:
        kinematics: Of the arm.
        margin: As given.
        pairs: The pairs that are checked.
        reach: Upper bound of how far anything that a joint carries is from its axis, in any posture [m], 1 for one that
            slides, shape (n,): while the joints move by dq, no point of the arm moves farther than the sum of
            |dq_i| reach_i.
        shapes: The shapes in `geometry.geometryObjects`, links first.
        model, geometry: Pinocchio's models of the arm and of its shapes.

    Raises:
        NoShapesError: Collision shapes are missing.
        InputError: `margin` cannot be used, or a shape cannot be read or has no convex hull.
        UnknownNameError: Unknown arm, or `meshes` is neither.
        InstallationError: Pinocchio or coal cannot be loaded.

    Examples:
        >>> from kinreach.kinematics import CollisionChecker
        >>> from kinreach.robots import Obstacle
        >>> shelf = Obstacle("shelf", (0.2, 0.4, 0.02), [0.5, 0, 0.3, 0, 0, 0])
        >>> checker = CollisionChecker("ur5e", obstacles=[shelf])
        >>> checker.free(checker.kinematics.arm.home)
        True
    """

    def __init__(
        self,
        arm: str | ArmDescription | ArmKinematics,
        *,
        obstacles: Sequence[Box | Obstacle] | None = None,
        margin: float = MARGIN,
        meshes: str | None = None,
    ) -> None:
        margin = check_number("margin", margin, least=0.0, most=MAX_DISTANCE)
        self.kinematics = arm if isinstance(arm, ArmKinematics) else ArmKinematics(arm)
        description = self.kinematics.arm
        around = description.workcell.obstacles if obstacles is None else as_obstacles(obstacles)
        meshes = description.meshes if meshes is None else meshes
        check_known("meshes", meshes, MESHES_AS)
        self._obstacles, self.margin, self._meshes = around, margin, meshes
        self.model = self.kinematics.model
        self.geometry = _shapes(self.kinematics, around, meshes)
        skipped = (*disabled_pairs(description), *description.workcell.touching)
        self._names = _pair_up(self.geometry, self.model, skipped)
        self.pairs: tuple[Pair, ...] = tuple(sorted(set(self._names)))
        names = {each.name for each in around}
        self.shapes = tuple(
            Shape(name := _name(shape, self.model), shape.parentJoint - 1, shape.parentFrame == WORLD and name in names)
            for shape in self.geometry.geometryObjects
        )
        self._links = self.geometry.copy()
        self._links.removeAllCollisionPairs()
        for pair in self.geometry.collisionPairs:
            if not (self.shapes[pair.first].obstacle or self.shapes[pair.second].obstacle):
                self._links.addCollisionPair(pair)
        self._search = _Search(self.model, self.geometry, self._links, margin)

    @cached_property
    def reach(self) -> Floats:
        return _reach(self.kinematics, self.geometry)

    def __reduce__(self) -> tuple[Any, ...]:
        return (
            partial(CollisionChecker, obstacles=self._obstacles, margin=self.margin, meshes=self._meshes),
            (self.kinematics,),
        )

    def in_collision(self, q: ArrayLike) -> bool:
        """Return whether any pair touches or is nearer than the margin; stops at the first.

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: `q` is malformed.
        """
        return self._collides(self.kinematics.as_posture("q", q))

    def free(self, q: ArrayLike) -> bool:
        """Return the opposite of `in_collision`; pass it to a solver as `accept`."""
        return not self.in_collision(q)

    def causes(self, q: ArrayLike) -> NDArray[np.uint8]:
        """Return why postures are impossible. The verdict on one does not depend on the others.

        Args:
            q: Postures [rad], shape (m, n).

        Returns:
            Values of `Cause`, shape (m,).

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        kin, search = self.kinematics, self._search
        q = np.ascontiguousarray(as_floats("q", q))
        if q.ndim != 2 or q.shape[1] != kin.n:
            raise InputError(f"q must have shape (m, {kin.n}), got {q.shape}")
        check_entries("q", q, float_info.max)
        outside = kin.past_limits(q)
        causes = np.where(outside.any(axis=1), np.uint8(Cause.LIMITS), np.uint8(Cause.NONE))
        for row in np.flatnonzero(causes == Cause.NONE):
            if self._collides(q[row]):
                itself = pin.computeCollisions(self.model, search.data, search.links, q[row], True)
                causes[row] = Cause.SELF if itself else Cause.OBSTACLE
        return causes

    def _collides(self, q: Floats) -> bool:
        """Whether any pair touches or is nearer than the margin in a checked posture (n,)."""
        search = self._search
        return bool(pin.computeCollisions(self.model, search.data, search.any_pair, q, True))

    def _any_collides(self, q: Floats) -> bool:
        """Whether any of the postures (m, n) does; stops at the first."""
        model, data, pairs = self.model, self._search.data, self._search.any_pair
        return any(pin.computeCollisions(model, data, pairs, each, True) for each in q)

    def impossible(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Return which postures are outside the joint limits or collide, shape (m,).

        Args:
            q: Postures [rad], shape (m, n).

        Raises:
            InputError: Wrong shape, or a value that is not finite.
        """
        return self.causes(q) != Cause.NONE

    def reason(self, q: ArrayLike) -> str:
        """Describe what makes a posture impossible; empty if nothing does.

        Joints outside their limits, or of the pairs of the `Cause` the nearest, or deepest in one another
        ("finger_left - table").

        Args:
            q: Posture [rad], shape (n,).

        Raises:
            InputError: `q` is malformed.
        """
        q = self.kinematics.as_posture("q", q)
        (cause,) = self.causes(q[None])
        if cause == Cause.NONE:
            return ""
        if cause == Cause.LIMITS:
            return f"out of limits: {', '.join(self.kinematics.joints_outside_limits(q, tolerance=SLACK))}"
        search = self._search
        # no link touches another where the cause is an obstacle
        geometry, results = (
            (self._links, search.link_results) if cause == Cause.SELF else (self.geometry, search.results)
        )
        pin.computeCollisions(self.model, search.data, geometry, results, q, False)
        touching = [pair for pair, result in enumerate(results.collisionResults) if result.isCollision()]
        # at the border, a second search for the nearest points, which begins where the last one ended, may find none
        touching = touching or [*range(len(results.collisionResults))]
        nearest = min(touching, key=lambda pair: float(pin.computeDistance(geometry, results, pair).min_distance))
        deepest = geometry.collisionPairs[nearest]
        return f"{self.shapes[deepest.first].name} - {self.shapes[deepest.second].name}"

    def contacts(self, q: ArrayLike) -> tuple[Pair, ...]:
        """Return all pairs that touch or are nearer than the margin, each once, in alphabetical order.

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
        """Return the smallest distance of all pairs; the margin plays no part.

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


def _reach(kin: ArmKinematics, geometry: Any) -> Floats:
    model, moves = kin.model, kin.moves
    farthest = np.maximum(np.abs(kin.lower), np.abs(kin.upper))
    far = np.zeros(model.njoints)  # of what each joint carries from its own origin
    for shape in geometry.geometryObjects:
        if not shape.parentJoint:
            continue  # fixed to the world
        centre = shape.placement.act(shape.geometry.aabb_center)
        far[shape.parentJoint] = max(far[shape.parentJoint], np.linalg.norm(centre) + shape.geometry.aabb_radius)
    for joint in range(model.njoints - 2, 0, -1):
        slid = moves[joint]
        way = abs(slid.factor) * farthest[slid.entry] + abs(slid.offset) if slid.slides else 0.0
        origin = np.linalg.norm(model.jointPlacements[joint + 1].translation) + way
        far[joint] = max(far[joint], origin + far[joint + 1])
    reach = np.zeros(kin.n)
    for each, carried in zip(moves, far[1:], strict=True):
        reach[each.entry] += abs(each.factor) * (1.0 if each.slides else carried)
    return reach


@lru_cache(maxsize=16)
def disabled_pairs(arm: ArmDescription) -> tuple[tuple[str, str], ...]:
    """Return the pairs of links that are not checked: `arm.disabled_collisions`, or if that is None, those found.

    These are neighbours, the links on either side of a joint; pairs whose hulls touch in the arm's home posture; and
    pairs whose hulls touch in each of `SAMPLES` random postures.
    """
    if arm.disabled_collisions is not None:
        return arm.disabled_collisions
    model = build_model(arm)
    geometry = _shared_shapes(arm, HULLS).copy()
    beside = neighbours(arm.robot)
    names = _pair_up(geometry, model, beside)
    results, data = _search_data(geometry, 0.0), model.createData()

    def touching(q: Floats) -> set[Pair]:
        pin.computeCollisions(model, data, geometry, results, q, False)
        return {name for name, result in zip(names, results.collisionResults, strict=True) if result.isCollision()}

    at_home = touching(np.array(arm.home, dtype=np.float64))
    rng, always = np.random.default_rng(0), set(names)
    for _ in range(SAMPLES):
        always &= touching(rng.uniform(*sampling_limits(model)))
    return (*beside, *sorted(at_home | always))


def _search_data(geometry: Any, margin: float) -> Any:
    """Create the requests and results of all pairs.

    Each search begins anew, as in coal's own requests: Pinocchio's begin where the last one ended, and a distance would
    depend on that by up to 2e-7 m. (Their switch is deprecated, and silencing its warning would change the filters of
    all threads.)
    """
    results = geometry.createData()
    collision, distance = coal.CollisionRequest(coal.CollisionRequestFlag.NO_REQUEST, 1), coal.DistanceRequest()
    collision.security_margin, collision.gjk_tolerance = margin, GJK_TOLERANCE
    # the search begins at the centres of the bounding boxes: the same verdicts, up to twice as fast
    collision.gjk_initial_guess = coal.GJKInitialGuess.BoundingVolumeGuess
    for number, pair in enumerate(geometry.collisionPairs):
        results.collisionRequests[number] = collision
        results.distanceRequests[number] = distance
        if any(
            isinstance(geometry.geometryObjects[shape].geometry, coal.BVHModelBase)
            for shape in (pair.first, pair.second)
        ):  # single triangles have no boxes to begin with
            results.collisionRequests[number].gjk_initial_guess = coal.GJKInitialGuess.DefaultGuess
    return results


def check_shapes(arm: ArmDescription) -> None:
    """Refuse an arm with a missing collision shape."""
    if arm.missing_shapes:
        raise NoShapesError(f"arm {arm.name!r} has no collision checks and no simulation: {arm.missing_shapes}")


def _shapes(kinematics: ArmKinematics, obstacles: Sequence[Box | Obstacle], meshes_as: str) -> Any:
    """Build the geometry of the links, followed by the obstacles, fixed to the world."""
    geometry = _shared_shapes(kinematics.arm, meshes_as).copy()
    for each in obstacles:
        T, shape = _obstacle(each)
        shape.computeLocalAABB()
        geometry.addGeometryObject(pin.GeometryObject(each.name, WORLD, WORLD, pin.SE3(T), shape))
    return geometry


@lru_cache(maxsize=8)
def _shared_shapes(arm: ArmDescription, meshes_as: str) -> Any:
    """Return the geometry of the links, which all checkers of an arm have in common: hulls take long."""
    return _link_shapes(arm, build_model(arm), meshes_as)


def _link_shapes(arm: ArmDescription, model: Any, meshes_as: str) -> Any:
    """Build the geometry of the links."""
    check_shapes(arm)
    robot = without_shapes(arm.robot, "visual")
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
        if (mesh := meshes[_name(shape, model)].pop(0)) is not None:
            shape.geometry = _hull(shape.name, mesh.vertices) if meshes_as == HULLS else _triangles(mesh)
    for shape in geometry.geometryObjects:
        shape.geometry.computeLocalAABB()
    return geometry


def _take_mesh(shape: ET.Element, arm: ArmDescription) -> Mesh | None:
    """Replace a collision mesh by a ball and return it in the shape's frame [m]; None for another shape."""
    geometry = shape.find("geometry")
    mesh = None if geometry is None else geometry.find("mesh")
    if geometry is None or mesh is None:
        return None
    scale = np.array([float(s) for s in mesh.get("scale", "1 1 1").split()])
    vertices, faces = collision_mesh(mesh.get("filename", ""), arm.package_root(), scale)
    geometry.remove(mesh)
    ET.SubElement(geometry, "sphere", radius="1")
    return Mesh(vertices * scale, faces)


def _obstacle(obstacle: Box | Obstacle) -> tuple[Floats, Any]:
    """Pose in the world and shape of an obstacle."""
    if isinstance(obstacle, Box):
        return placement(obstacle.position, (0.0, 0.0, 0.0)), coal.Box(*obstacle.size)
    T, shape = pose(obstacle.pose), obstacle.shape
    if isinstance(shape, str | Path):
        return T, _triangles(mesh_in_metres(str(shape), obstacle.scale))
    kind = {1: coal.Sphere, 2: coal.Cylinder, 3: coal.Box}[len(shape)]
    return T, kind(*shape)


def _triangles(mesh: Mesh) -> Any:
    vertices, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    vertices.extend(mesh.vertices)
    faces.extend(coal.Triangle(*face) for face in mesh.faces.tolist())
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addSubModel(vertices, faces)
    model.endModel()
    return model


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
    shapes = [(_name(each, model), (each.parentJoint, each.parentFrame == WORLD)) for each in geometry.geometryObjects]
    for (i, (a, carrier)), (j, (b, other)) in combinations(enumerate(shapes), 2):
        rigid = carrier == other
        if rigid or frozenset((a, b)) in left_out:
            continue
        geometry.addCollisionPair(pin.CollisionPair(i, j))
        names.append((min(a, b), max(a, b)))
    return names


def _name(shape: Any, model: Any) -> str:
    return str(shape.name if shape.parentFrame == WORLD else model.frames[shape.parentFrame].name)

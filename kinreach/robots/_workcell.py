"""The world around an arm: what it must not touch, and where goals are placed.

World frame: z up. All lengths in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_DISTANCE, as_vector, check_flag, check_number, check_path, shown
from kinreach.errors import InputError

#: Largest edge and coordinate of an obstacle [m]: collision engines miss contacts of shapes of too different sizes.
MAX_SIZE = 1000.0
#: Smallest sine of the angle between a camera's line of sight and its up direction.
MIN_SINE = 1e-6


@dataclass(frozen=True)
class Box:
    """An axis-aligned obstacle in the world frame.

    Attributes:
        name: What a collision report calls it.
        size: Full edge lengths [m].
        position: Centre [m].
        legs: Length of the four legs under it [m]; they are drawn and have no contact.

    Raises:
        InputError: A length or a coordinate that is not finite, not positive where it must be, or beyond 1 km.
    """

    name: str
    size: tuple[float, float, float]
    position: tuple[float, float, float]
    legs: float = 0.0

    def __post_init__(self) -> None:
        given: dict[str, Any] = vars(self)
        check_name("the name of a box", self.name)
        for part, above in (("size", 0.0), ("position", -inf)):
            values = given[part]
            if not isinstance(values, Sequence | np.ndarray) or len(values) != 3:
                raise InputError(f"the {part} of the box {self.name!r} must be three numbers, got {shown(values)}")
            for value in values:
                check_number(f"the {part} of the box {self.name!r}", value, above=above, least=-MAX_SIZE, most=MAX_SIZE)
        check_number(f"the legs of the box {self.name!r}", self.legs, least=0.0, most=MAX_SIZE)


@dataclass(frozen=True)
class CameraMount:
    """A camera that is fixed to a link; all points are in that link's frame [m].

    Attributes:
        name: Such as `"front"`.
        link: Link that carries it; `"world"` for a camera that stands still.
        position: Optical centre.
        target: Point in the middle of the picture.
        up: Direction that is up in the picture.
        fovy: Vertical field of view [degrees].
        holder: Where the holder of the device starts; device and holder are drawn and have no contact. Without it
            nothing is drawn: the camera is a viewpoint, not a device.
        observed: Whether the camera measures the goal: the goal's position in its frame is part of the observation.

    Raises:
        InputError: A name is not text, a point not three finite numbers, the field of view not between 0 and 180
            degrees, the target is where the camera is, or `up` is along the line of sight.
    """

    name: str
    link: str
    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fovy: float = 58.0
    holder: tuple[float, float, float] | None = None
    observed: bool = False

    def __post_init__(self) -> None:
        check_name("the name of a camera", self.name)
        of = f"of the camera {self.name!r}"
        check_name(f"the link {of}", self.link)
        check_number(f"fovy {of}", self.fovy, above=0.0, most=179.0)
        check_flag(f"observed {of}", self.observed)
        position, target, up = (
            as_vector(f"the {part} {of}", getattr(self, part), 3, most=MAX_DISTANCE)
            for part in ("position", "target", "up")
        )
        if self.holder is not None:
            as_vector(f"the holder {of}", self.holder, 3, most=MAX_DISTANCE)
        sight = target - position
        if not np.linalg.norm(np.cross(sight, up)) > MIN_SINE * np.linalg.norm(sight) * np.linalg.norm(up):
            raise InputError(f"the target {of} must not be where it stands, nor up or down from there: {self.target}")


def check_name(what: str, name: object) -> None:
    if not isinstance(name, str) or not name:
        raise InputError(f"{what} must be text, got {shown(name)}")


def check_names_differ(names: Sequence[str]) -> None:
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two obstacles are named {twice[0]!r}")


class GoalRegion(Protocol):
    """Where goals are drawn from."""

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw `count` goal positions in the world frame [m], shape (count, 3)."""
        ...


@dataclass(frozen=True)
class BoxRegion:
    """Uniform in an axis-aligned box, given by the range of each coordinate [m].

    Raises:
        InputError: A range is not two finite numbers, the smaller one first.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]

    def __post_init__(self) -> None:
        for name in "xyz":
            _check_range(name, getattr(self, name))

    def wider(self, beyond: float, *, above: float = 0.0) -> BoxRegion:
        """Return the box with `beyond` [m] more on each of its four sides, and `above` [m] more on top."""
        (x0, x1), (y0, y1), (z0, z1) = self.x, self.y, self.z
        return BoxRegion((x0 - beyond, x1 + beyond), (y0 - beyond, y1 + beyond), (z0, z1 + above))

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw `count` goal positions in the world frame [m], shape (count, 3)."""
        low, high = np.array([self.x, self.y, self.z]).T
        return rng.uniform(low, high, (count, 3))


@dataclass(frozen=True)
class QuadrantRegion:
    """Uniform in one of the four quadrants around the base: |x| and |y| in `across`, z in `height` [m].

    Raises:
        InputError: A range is not two finite numbers, the smaller one first.
    """

    across: tuple[float, float]
    height: tuple[float, float]

    def __post_init__(self) -> None:
        _check_range("across", self.across)
        _check_range("height", self.height)

    def sample(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        xy = rng.uniform(*self.across, (count, 2)) * rng.choice((-1.0, 1.0), (count, 2))
        return np.column_stack([xy, rng.uniform(*self.height, count)])


def _check_range(name: str, ends: tuple[float, float]) -> None:
    low, high = as_vector(name, ends, 2, most=MAX_SIZE)
    if low > high:
        raise InputError(f"the range {name} of goals ends below its beginning: {low} to {high}")


@dataclass(frozen=True)
class Workcell:
    """Obstacles and goals of one arm; by default there is nothing around it.

    Attributes:
        obstacles: What the arm must not touch.
        touching: (obstacle, link) pairs that touch by construction.
        goals: Where the centre of the ball may be; None if no goals are drawn in this cell.
        ball_radius: Radius of the ball that marks the goal [m]; it has no contact with the arm.
        reached_distance: How near to a goal the tip has to come [m].

    Raises:
        InputError: An obstacle is not a `Box` or has the name of another, `touching` is not pairs of names, `goals`
            cannot be drawn from, or a length is not positive.
    """

    obstacles: tuple[Box, ...] = ()
    touching: tuple[tuple[str, str], ...] = ()
    goals: GoalRegion | None = None
    ball_radius: float = 0.025
    reached_distance: float = 0.01

    def __post_init__(self) -> None:
        boxes: Any = self.obstacles
        if not isinstance(boxes, Sequence) or not all(isinstance(box, Box) for box in boxes):
            raise InputError(
                f"obstacles of a work cell must be a list of Box, got {shown(boxes)}; an Obstacle is for "
                "CollisionChecker(kin, obstacles=...)"
            )
        check_names_differ([box.name for box in boxes])
        touching: Any = self.touching
        if not isinstance(touching, Sequence) or not all(_is_pair(pair) for pair in touching):
            raise InputError(f"touching must be pairs of an obstacle and a link, got {shown(touching)}")
        if self.goals is not None and not callable(getattr(self.goals, "sample", None)):
            raise InputError(f"goals must be a region such as BoxRegion(x, y, z), got {shown(self.goals)}")
        check_number("ball_radius", self.ball_radius, above=0.0, most=MAX_SIZE)
        check_number("reached_distance", self.reached_distance, above=0.0, most=MAX_SIZE)

    def draw_goals(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Draw `count` goal positions in the world frame [m], shape (count, 3).

        Raises:
            InputError: This cell has no goals.
        """
        if self.goals is None:
            raise InputError("this work cell has no goals; give the arm a Workcell with goals=BoxRegion(x, y, z)")
        return self.goals.sample(rng, count)


def _is_pair(pair: Any) -> bool:
    return isinstance(pair, Sequence) and len(pair) == 2 and all(isinstance(name, str) for name in pair)


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

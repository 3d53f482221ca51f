"""Goals of inverse kinematics, in the base frame of the kinematics they belong to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from math import atan2, dist, hypot
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinreach._checks import MAX_DISTANCE, Floats, as_pose, as_vector, check_poses, shown
from kinreach._engines import load
from kinreach._rotations import pose as pose  # public here
from kinreach._rotations import pose_error
from kinreach._rotations import pose_vector as pose_vector
from kinreach._tensors import blocks, like
from kinreach.errors import InputError

if TYPE_CHECKING:
    from kinreach.kinematics._solutions import Accept, IKResult

pin: Any = load("pinocchio")

#: Sine of the angle between two axes below which the plane they span is not defined.
PARALLEL = 1e-12
#: How far products of a rotation's columns may be off by rounding alone.
ROUNDING = 1e-12


class Goal(ABC):
    """What the tip is to meet, in the base frame of the kinematics. The numeric solvers solve a class of your own.

    Attributes:
        lengths: How many entries of `way`, the first ones, are lengths; the others are angles.
        orientation_yields: The goal is reached with any orientation error; a solver makes it as little as it can be.

    Examples:
        >>> import numpy as np
        >>> from kinreach.kinematics import Goal, LevenbergMarquardtSolver, URKinematics
        >>> class AtHeight(Goal):
        ...     lengths = 1
        ...
        ...     def __init__(self, z):
        ...         self.z = z
        ...
        ...     def error(self, T):
        ...         return abs(self.z - T[2, 3]), 0.0
        ...
        ...     def way(self, tip):
        ...         up = tip.rotation[2]  # the z axis of the base, in the tip's own
        ...         return np.array([self.z - tip.translation[2]]), np.append(up, np.zeros(3))[None]
        >>> kin = URKinematics("ur5e")
        >>> found = LevenbergMarquardtSolver(kin).solve(AtHeight(0.6), kin.arm.home)
        >>> round(float(kin.fk(found.q)[2, 3]), 3)
        0.6
    """

    lengths: ClassVar[int] = 3
    orientation_yields: ClassVar[bool] = False

    @abstractmethod
    def error(self, T: Floats) -> tuple[float, float]:
        """Return how far a pose (4, 4) of the tip is from the goal: position [m] and orientation [rad], 0 if free."""

    @abstractmethod
    def way(self, tip: Any) -> tuple[Floats, Floats | None]:
        """Return what is left to the goal, and how a motion of the tip shortens it.

        Args:
            tip: Pose of the tip, a `pinocchio.SE3`: `tip.rotation` (3, 3) and `tip.translation` [m], shape (3,).

        Returns:
            e [m, rad], shape (m,); and L, shape (m, 6): after a small twist (v, w) of the tip, in its own axes
            [m, rad], e - L (v, w) is left. None: L is the first m rows of the identity.
        """

    def frame(self) -> Floats:
        """Return a pose (4, 4) that meets the goal; what the goal leaves free is chosen.

        Raises:
            InputError: This kind of goal names none.
        """
        raise InputError(f"{type(self).__name__} names no pose that meets it; the numeric solvers need none")

    def solved_by(self, kinematics: SolvesGoals, seed: ArrayLike, accept: Accept | None) -> IKResult:
        """Return the posture nearest to a seed, as `ClosedFormKinematics.solve`.

        Raises:
            InputError: The kinematics do not solve this kind of goal.
        """
        raise InputError(f"closed forms do not know the goal {shown(self)}; the numeric solvers solve any")


@dataclass(frozen=True)
class _OfPose(Goal):
    """A goal that a pose is, of shape (4, 4)."""

    T: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", as_pose("T", self.T).copy())

    @property
    def position(self) -> Floats:
        """Position of the tip [m], shape (3,)."""
        return self.T[:3, 3]

    def error(self, T: Floats) -> tuple[float, float]:
        return pose_error(self.T, T)

    def frame(self) -> Floats:
        return self.T


@dataclass(frozen=True)
class PoseGoal(_OfPose):
    r"""A full pose of the tip: position [m] and orientation. `T` has shape (4, 4).

    With the tip at (R, p) and the goal at (R*, p*) the numeric solvers bring to zero, in the tip's axes (Siciliano et
    al., Robotics, section 3.7),

    .. math::

        e = \begin{pmatrix} R^\top (p^* - p) \\ \log(R^\top R^*)^\vee \end{pmatrix}

    Examples:
        >>> from kinreach.kinematics import LevenbergMarquardtSolver, PoseGoal, URKinematics
        >>> kin = URKinematics("ur5e")
        >>> goal = PoseGoal(kin.fk([0.1, -1.4, 1.5, -1.6, -1.5, 0.2]))
        >>> LevenbergMarquardtSolver(kin).solve(goal, kin.arm.home).success
        True
    """

    @cached_property
    def _placement(self) -> Any:
        return pin.SE3(self.T)

    def way(self, tip: Any) -> tuple[Floats, None]:
        ahead = tip.actInv(self._placement)
        e = np.empty(6)
        e[:3] = ahead.translation
        e[3:] = pin.log3(ahead.rotation)
        return e, None

    def solved_by(self, kinematics: SolvesGoals, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return kinematics._solve_pose(self, seed, accept)


@dataclass(frozen=True)
class AxisGoal(Goal):
    r"""The tip's origin is at `position` [m] and its z axis points along `axis`; rotation about it is free.

    As in `PoseGoal`, with the x and y entries of the shortest turn that takes the z axis to the direction a

    .. math::

        \theta \, \frac{z \times R^\top a}{|z \times R^\top a|}, \qquad \theta = \angle(z, R^\top a)

    in place of the rotation.

    Examples:
        >>> from kinreach.kinematics import AxisGoal, QPSolver, URKinematics
        >>> kin = URKinematics("ur5e", base="world")
        >>> down = AxisGoal([0.5, 0.1, 0.3], [0, 0, -1])
        >>> QPSolver(kin).solve(down, kin.arm.home).success
        True
    """

    position: Floats
    axis: Floats = (0.0, 0.0, -1.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _as_point(self.position))
        axis = as_vector("axis", self.axis, 3, most=MAX_DISTANCE)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise InputError("axis must not be the zero vector")
        object.__setattr__(self, "axis", axis / length)

    def error(self, T: Floats) -> tuple[float, float]:
        position = dist(self.position.tolist(), T[:3, 3].tolist())
        return position, _angle_between(T[:3, 2].tolist(), self.axis.tolist())

    def way(self, tip: Any) -> tuple[Floats, None]:
        R, e = tip.rotation, np.empty(5)
        e[:3] = (self.position - tip.translation).dot(R)
        e[3:] = _turn_to(*self.axis.dot(R).tolist())
        return e, None

    def frame(self) -> Floats:
        T = np.eye(4)
        T[:3, :3] = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), self.axis).toRotationMatrix()
        T[:3, 3] = self.position
        return T

    def solved_by(self, kinematics: SolvesGoals, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return kinematics._solve_axis(self, seed, accept)


@dataclass(frozen=True)
class PositionGoal(Goal):
    """The tip's origin is at `position` [m], shape (3,); its orientation is free."""

    position: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _as_point(self.position))

    def error(self, T: Floats) -> tuple[float, float]:
        return dist(self.position.tolist(), T[:3, 3].tolist()), 0.0

    def way(self, tip: Any) -> tuple[Floats, None]:
        return tip.actInv(self.position), None

    def frame(self) -> Floats:
        T = np.eye(4)
        T[:3, 3] = self.position
        return T

    def solved_by(self, kinematics: SolvesGoals, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return kinematics._solve_position(self, seed, accept)


class SolvesGoals(ABC):
    """Kinematics that solve goals exactly; a class has a method for each kind of goal that its arms can."""

    #: What is said of the other kinds.
    unsolved: ClassVar[str]

    @abstractmethod
    def nearest(self, T: ArrayLike, seed: ArrayLike, *, accept: Accept | None = None) -> IKResult:
        """Compute the posture for a pose that is nearest to a seed."""

    def _solve_pose(self, goal: PoseGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return self.nearest(goal.T, seed, accept=accept)

    def _solve_axis(self, goal: AxisGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        raise InputError(self.unsolved)

    def _solve_position(self, goal: PositionGoal, seed: ArrayLike, accept: Accept | None) -> IKResult:
        raise InputError(self.unsolved)

    def _solve_nearest_orientation(
        self, goal: NearestOrientationGoal, seed: ArrayLike, accept: Accept | None
    ) -> IKResult:
        raise InputError(ONLY_FOUR_OR_FIVE)


#: What others say of a `NearestOrientationGoal`.
ONLY_FOUR_OR_FIVE = (
    "a NearestOrientationGoal is solved by the kinematics of an arm with four or five joints, "
    "ArmKinematics.of(arm).solve(goal, seed); others take a PoseGoal, an AxisGoal or a PositionGoal"
)


@dataclass(frozen=True)
class NearestOrientationGoal(_OfPose):
    """The tip's origin is at a pose's position [m], exactly, and its orientation as near to the pose's as it goes.

    The goal of arms with four or five joints, which `FiveAxisKinematics` solves; `orientation_error` of the result says
    what is left [rad]. `T` has shape (4, 4).

    Examples:
        >>> from kinreach.kinematics import ArmKinematics, NearestOrientationGoal, pose
        >>> kin = ArmKinematics.of("so101")
        >>> found = kin.solve(NearestOrientationGoal(pose([0.25, 0.1, 0.1, 0.0, 3.0, 0.5])), kin.arm.home)
        >>> found.success, found.position_error < 1e-9, round(found.orientation_error, 2)
        (True, True, 0.26)
    """

    orientation_yields = True

    def way(self, tip: Any) -> tuple[Floats, Floats | None]:
        raise InputError(ONLY_FOUR_OR_FIVE)

    def solved_by(self, kinematics: SolvesGoals, seed: ArrayLike, accept: Accept | None) -> IKResult:
        return kinematics._solve_nearest_orientation(self, seed, accept)


def _as_point(position: ArrayLike) -> Floats:
    """Return a copy, which the caller cannot change later."""
    return as_vector("position", position, 3, most=MAX_DISTANCE).copy()


def check_goal(goal: object) -> Goal:
    """Return a goal.

    Raises:
        InputError: It is none.
    """
    if not isinstance(goal, Goal):
        raise InputError(f"goal must be a PoseGoal, an AxisGoal or a PositionGoal, got {type(goal).__name__}")
    return goal


def nearest_rotations(R: Any) -> Any:
    """Return the rotations nearest to matrices (..., 3, 3) that almost are, by two Newton steps of the polar form."""
    for _ in range(2):
        R = R @ (1.5 * like(R, np.eye(3)) - 0.5 * R.swapaxes(-1, -2) @ R)
    return R


def skewed(entries: Any) -> Any:
    """Return which poses are no rigid motions to rounding, last rows apart, for entries (12, count) of the others."""
    nx, ox, ax, px, ny, oy, ay, py, nz, oz, az, pz = entries
    off = abs(nx * nx + ny * ny + nz * nz - 1.0)
    off += abs(ox * ox + oy * oy + oz * oz - 1.0)
    off += abs(nx * ox + ny * oy + nz * oz)
    off += abs(ny * oz - nz * oy - ax)
    off += abs(nz * ox - nx * oz - ay)
    off += abs(nx * oy - ny * ox - az)
    near = abs(px) + abs(py) + abs(pz) < MAX_DISTANCE
    return ~(near & (off < ROUNDING))


def rigid_pose(T: ArrayLike) -> Floats:
    """Return a pose (4, 4) with a rotation that is exact to rounding.

    Raises:
        InputError: It is not a finite rigid motion.
    """
    return np.asarray(rigid_poses(as_pose("T", T)[None])[0])


def rigid_poses(T: Floats) -> Floats:
    """Return poses (count, 4, 4) with rotations that are exact to rounding."""
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise InputError(f"T must have shape (count, 4, 4), got {T.shape}")
    off = np.empty(len(T), dtype=np.bool_)
    with np.errstate(invalid="ignore", over="ignore"):
        for rows in blocks(len(T)):
            off[rows] = skewed(np.ascontiguousarray(T[rows, :3].reshape(-1, 12).T))
    if off.any() or (T[:, 3] != (0.0, 0.0, 0.0, 1.0)).any():
        check_poses("T", T)
        T = T.copy()
        T[off, :3, :3] = nearest_rotations(T[off, :3, :3])
        T[:, 3] = (0.0, 0.0, 0.0, 1.0)
    return T


def _turn_to(x: float, y: float, z: float) -> tuple[float, float]:
    """First two components of the rotation vector [rad] that takes the z axis to the unit vector (x, y, z)."""
    sine = hypot(x, y)
    angle = atan2(sine, z)
    if sine < PARALLEL:  # aligned, or opposite: then any axis in the plane will do
        return angle, 0.0
    return -y * angle / sine, x * angle / sine


def _angle_between(a: list[float], b: list[float]) -> float:
    """Angle [rad] between two vectors, exact also where it is tiny."""
    (ax, ay, az), (bx, by, bz) = a, b
    sine = hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return atan2(sine, ax * bx + ay * by + az * bz)

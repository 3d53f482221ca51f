"""What an inverse-kinematics solver is asked for, in the base frame of the kinematics it belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, dist, hypot
from numbers import Real
from sys import float_info
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach.errors import InputError
from kinreach.inputs import check_number, shown

Floats = NDArray[np.float64]

#: How far a matrix may be from a rotation before it is refused (float32 poses pass).
ROTATION_TOLERANCE = 1e-5
#: Bounds of what is taken for a joint angle [rad] and for a coordinate [m]. Far beyond any arm, and near enough that
#: what is lost by rounding does not count: sines are exact to 1e-10, and no square overflows.
MOST_ANGLE, MOST_DISTANCE = 1e6, 1e6

#: Bounds of a closed form's tolerance [m, rad].
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-9, 1.0


def as_vector(name: str, value: ArrayLike, size: int, *, most: float = float_info.max) -> Floats:
    """A finite float vector of the given size with entries up to `most`, or an `InputError` that says what is wrong."""
    vector = as_floats(name, value)
    if vector.shape != (size,):
        raise InputError(f"{name} must have shape ({size},), got {vector.shape}")
    for entry in vector.tolist():  # faster than an array's operations
        if not -most <= entry <= most:
            _refuse_entries(name, vector, most)
    return vector


def check_entries(name: str, values: Floats, most: float) -> None:
    """Refuse an array with an entry that is not finite, or larger than `most`."""
    if not (values.max(initial=0.0) <= most and values.min(initial=0.0) >= -most):
        _refuse_entries(name, values, most)


def _refuse_entries(name: str, values: Floats, most: float) -> None:
    values = np.atleast_1d(values)
    finite = np.isfinite(values)
    if not finite.all():
        rows = finite.reshape(-1, values.shape[-1])
        raise InputError(f"{name} must be finite, got {values.reshape(rows.shape)[~rows.all(axis=1)][0]}")
    raise InputError(f"{name} must be within ±{most:g}, got {values.flat[np.abs(values).argmax()]:g}")


def as_pose(name: str, value: ArrayLike) -> Floats:
    """A homogeneous transform, shape (4, 4), or an `InputError` that says what is wrong."""
    T = as_floats(name, value)
    if T.shape != (4, 4):
        raise InputError(f"{name} must be a 4x4 homogeneous transform, got shape {T.shape}")
    check_poses(name, T[None])
    return T


def check_poses(name: str, T: Floats) -> None:
    """Refuse a stack of transforms, shape (n, 4, 4), in which one is no rigid motion or goes beyond `MOST_DISTANCE`."""
    if not np.isfinite(T).all():
        raise InputError(f"{name} must be finite; {_where(~np.isfinite(T).all(axis=(1, 2)))} is not")
    check_entries(f"every entry of {name}", T, MOST_DISTANCE)
    bad_row = (np.abs(T[:, 3] - (0.0, 0.0, 0.0, 1.0)) > ROTATION_TOLERANCE).any(axis=1)
    if bad_row.any():
        raise InputError(f"{name} must have the last row 0 0 0 1; {_where(bad_row)} has {T[bad_row.argmax(), 3]}")
    R = T[:, :3, :3]
    gram = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    skewed = (gram > ROTATION_TOLERANCE) | (np.linalg.det(R) < 0)
    if skewed.any():
        worst = int(skewed.argmax())
        raise InputError(
            f"the upper left 3x3 block of {name} must be a rotation; {_where(skewed)} is not "
            f"(largest entry of |R^T R - I| is {gram[worst]:.2g}, determinant {np.linalg.det(R[worst]):.3g})"
        )


def as_floats(name: str, value: ArrayLike) -> Floats:
    """An array of doubles, or an `InputError` that says what is wrong: text, complex numbers, dates, None are none."""
    array = as_array(name, value)
    if array.dtype == np.float64:
        return array
    try:
        if array.dtype.kind in "biuf" or (array.dtype.kind == "O" and all(isinstance(x, Real) for x in array.flat)):
            with np.errstate(over="ignore"):  # what is too large becomes infinite, and that is refused by who asks
                return array.astype(np.float64)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(f"{name} must be an array of numbers: {error}") from None
    raise InputError(f"{name} must be an array of numbers, got {shown(value)}")


def as_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """An array of whatever it may be, or an `InputError`."""
    try:
        return np.asarray(value)
    except Exception as error:  # whatever the conversion of somebody else's object raises
        raise InputError(f"{name} must be an array of numbers: {error}") from None


def as_flags(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    """An array of truth values, or an `InputError`; 0 and 1 are taken for such, other numbers are not."""
    if isinstance(value, np.ndarray | bool) and np.asarray(value).dtype == np.bool_:
        return np.asarray(value)
    values = as_floats(name, value)
    if not ((values == 0.0) | (values == 1.0)).all():
        raise InputError(f"{name} must be true or false, got {values[(values != 0.0) & (values != 1.0)][0]:g}")
    return values.astype(np.bool_)


def check_tolerance(tol: float) -> float:
    """A tolerance that means something: below the bound rounding decides, and above it there is no arm so large."""
    inside = type(tol) is float and LEAST_TOLERANCE <= tol <= MOST_TOLERANCE
    return tol if inside else check_number("tol", tol, least=LEAST_TOLERANCE, most=MOST_TOLERANCE)


def _where(bad: ArrayLike) -> str:
    bad = np.asarray(bad)
    return "it" if len(bad) == 1 else f"entry {int(bad.argmax())}"


@dataclass(frozen=True)
class PoseGoal:
    """The tip takes a full pose: position [m] and orientation. `T` has shape (4, 4)."""

    T: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "T", as_pose("T", self.T))

    @property
    def position(self) -> Floats:
        """Position of the tip [m], shape (3,)."""
        return self.T[:3, 3]


@dataclass(frozen=True)
class AxisGoal:
    """The tip's origin is at `position` [m] and its z axis points along `axis`; rotation about it is free."""

    position: Floats
    axis: Floats = (0.0, 0.0, -1.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", as_vector("position", self.position, 3, most=MOST_DISTANCE))
        axis = as_vector("axis", self.axis, 3, most=MOST_DISTANCE)
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise InputError("axis must not be the zero vector")
        object.__setattr__(self, "axis", axis / length)


@dataclass(frozen=True)
class PositionGoal:
    """The tip's origin is at `position` [m], shape (3,); its orientation is free."""

    position: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", as_vector("position", self.position, 3, most=MOST_DISTANCE))


Goal = PoseGoal | AxisGoal | PositionGoal


def goal_error(goal: Goal, T: Floats) -> tuple[float, float]:
    """How far a tip pose is from a goal: position [m] and orientation [rad] (0 where it is free)."""
    if isinstance(goal, PoseGoal):
        return pose_error(goal.T, T)
    position = dist(goal.position.tolist(), T[:3, 3].tolist())
    if isinstance(goal, AxisGoal):
        return position, _angle_between(T[:3, 2].tolist(), goal.axis.tolist())
    return position, 0.0


def pose_error(T_wanted: Floats, T: Floats) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses, shape (4, 4)."""
    position = dist(T_wanted[:3, 3].tolist(), T[:3, 3].tolist())
    return position, rotation_angle(T[:3, :3], T_wanted[:3, :3])


def nearest_rotations(R: Floats) -> Floats:
    """The rotations nearest to matrices (..., 3, 3) that almost are some, by two Newton steps of the polar form."""
    for _ in range(2):
        R = R @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(R, -1, -2) @ R)
    return R


def rotation_angle(R_a: Floats, R_b: Floats) -> float:
    """Angle [rad] of the rotation from `R_a` to `R_b`, exact also where it is tiny."""
    (_, b, c), (d, _, f), (g, h, _) = rows = (R_a.T @ R_b).tolist()
    sine = hypot(h - f, c - g, d - b)
    return atan2(sine, rows[0][0] + rows[1][1] + rows[2][2] - 1.0)


def _angle_between(a: list[float], b: list[float]) -> float:
    """Angle [rad] between two vectors, exact also where it is tiny."""
    (ax, ay, az), (bx, by, bz) = a, b
    sine = hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return atan2(sine, ax * bx + ay * by + az * bz)

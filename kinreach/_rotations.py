"""Angles, rotations and poses: full turns, roll, pitch and yaw of a URDF, the six numbers of a UR's pendant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinreach._checks import MAX_DISTANCE, Floats, as_floats, as_pose, check_entries, check_poses
from kinreach.errors import InputError

#: Largest distance of a tool centre point from its flange, and of a frame from the arm's base [m].
MAX_TOOL = 5.0
#: A full turn [rad].
TURN = 2 * math.pi


def wrap(angle: float) -> float:
    """Wrap an angle into [-pi, pi]; one within it stays as it is, to the last digit."""
    return angle - TURN * round(angle / TURN) if not -math.pi <= angle <= math.pi else angle


def wrapped(q: Floats) -> Floats:
    """Wrap angles of any shape into [-pi, pi]."""
    return q - TURN * np.rint(q / TURN)


def joints_apart(q: ArrayLike, other: ArrayLike) -> Any:
    """Return the largest difference of a joint between postures (..., n) [rad], full turns aside, shape (...)."""
    return np.abs(wrapped(np.subtract(q, other))).max(axis=-1)


def small_motion(T_wanted: Floats, T: Floats) -> Floats:
    """Return the motion from a pose to one that is near, shape (6,): translation [m], rotation vector [sines of rad].

    Both in the frame of the poses, as a Jacobian has them.
    """
    R = T_wanted[:3, :3] @ T[:3, :3].T
    turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return np.concatenate([T_wanted[:3, 3] - T[:3, 3], turn])


def rotation(rpy: Sequence[float]) -> Floats:
    """Return Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3)."""
    x, y, z = (turn(axis, angle) for axis, angle in zip(np.eye(3), rpy, strict=True))
    return z @ y @ x


def turn(axis: Floats, angle: float) -> Floats:
    """Return the rotation about a unit axis by Rodrigues' formula, shape (3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K


def turns(vectors: Floats) -> Floats:
    """Return the rotations of rotation vectors (..., 3) [rad] by Rodrigues' formula, shape (..., 3, 3).

    As scipy's `Rotation`, whose import takes as long as that of the rest of the kinematics.
    """
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    K = np.zeros((*vectors.shape, 3))
    K[..., 2, 1], K[..., 0, 2], K[..., 1, 0] = np.moveaxis(vectors, -1, 0)
    K -= K.swapaxes(-1, -2)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * np.sinc(angle / TURN) ** 2 * (K @ K))


def vectors_of(R: Floats) -> Floats:
    """Return the rotation vectors of rotations (..., 3, 3), at most pi long [rad], shape (..., 3)."""
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    trace = diagonal.sum(axis=-1, keepdims=True)
    Q = np.empty((*R.shape[:-2], 4, 4))  # four multiples of the quaternion (w, x, y, z)
    Q[..., 1:, 1:] = R + R.swapaxes(-1, -2)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1)), start=1):
        Q[..., 0, i] = Q[..., i, 0] = R[..., k, j] - R[..., j, k]
    squares = np.concatenate([trace, 2.0 * diagonal - trace], axis=-1)
    Q[..., range(4), range(4)] = 1.0 + squares
    longest = squares.argmax(axis=-1)[..., None, None]
    quaternion = np.take_along_axis(Q, longest, axis=-2)[..., 0, :]
    quaternion *= np.where(quaternion[..., :1] < 0.0, -1.0, 1.0)
    sine = np.linalg.norm(quaternion[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, quaternion[..., :1])
    return np.asarray(angle / np.where(sine > 0.0, sine, 1.0) * quaternion[..., 1:])


def rotation_to(axis: Floats) -> Floats:
    """Return a rotation whose third column is the given unit axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


def turns_about_z(angle: NDArray[Any]) -> Floats:
    """Return the rotations about z by angles (m,) [rad], shape (m, 4, 4)."""
    T = np.tile(np.eye(4), (len(angle), 1, 1))
    T[:, 0, 0] = T[:, 1, 1] = np.cos(angle)
    T[:, 1, 0] = np.sin(angle)
    T[:, 0, 1] = -T[:, 1, 0]
    return T


class PoseLine:
    """The poses between two: the position on a line, the rotation at an even rate about one axis.

    Args:
        start, end: Homogeneous transforms, shape (4, 4).

    Attributes:
        way: From start to end [m], shape (3,).
        length: Of the way [m].
        axis: Unit axis in the start's frame, shape (3,); that of z if nothing turns.
        angle: From 0 to pi [rad].
    """

    def __init__(self, start: Floats, end: Floats) -> None:
        vector = vectors_of(start[:3, :3].T @ end[:3, :3])
        self._start = start
        self.way: Floats = end[:3, 3] - start[:3, 3]
        self.length = float(np.linalg.norm(self.way))
        self.angle = float(np.linalg.norm(vector))
        self.axis: Floats = vector / self.angle if self.angle > 1e-12 else np.array([0.0, 0.0, 1.0])

    def at(self, part: float) -> Floats:
        """Return the pose (4, 4) at a part of the line, from 0 to 1."""
        T = np.eye(4)
        T[:3, :3] = self._start[:3, :3] @ turn(self.axis, part * self.angle)
        T[:3, 3] = self._start[:3, 3] + part * self.way
        return T


def rpy(R: Floats) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation; yaw is 0 where the pitch is a right angle."""
    across = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if across > 1e-12 else 0.0
    s, c = math.sin(yaw), math.cos(yaw)
    return math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1]), math.atan2(-R[2, 0], across), yaw


def placement(xyz: Sequence[float], angles: Sequence[float]) -> Floats:
    """Return the transform of a translation [m] after a rotation by roll, pitch and yaw [rad], shape (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = rotation(angles)
    T[:3, 3] = xyz
    return T


def pose(numbers: ArrayLike) -> Floats:
    r"""Return the pose that a UR's pendant, URScript and RTDE write as six numbers.

    .. math::

        T = \begin{pmatrix} e^{[r]_\times} & p \\ 0 & 1 \end{pmatrix}

    Args:
        numbers: `[x, y, z, rx, ry, rz]`: position p [m], and rotation vector r [rad], whose length is the angle and
            whose direction is the axis. Shape (6,) or (..., 6).

    Returns:
        Homogeneous transforms, shape (4, 4) or (..., 4, 4).

    Raises:
        InputError: Another shape, or a number that is not finite.

    Examples:
        >>> from kinreach.kinematics import pose
        >>> pose([0.4, 0, 0.2, 0, 0, 3.141592653589793]).round(6)[:2].tolist()
        [[-1.0, -0.0, 0.0, 0.4], [0.0, -1.0, 0.0, 0.0]]
    """
    numbers = as_floats("numbers", numbers)
    if numbers.shape[-1:] != (6,):
        raise InputError(f"a pose has six numbers, x, y, z, rx, ry, rz, got shape {numbers.shape}")
    check_entries("numbers", numbers, MAX_DISTANCE)
    T = np.zeros((*numbers.shape[:-1], 4, 4))
    T[..., :3, :3] = turns(numbers[..., 3:])
    T[..., :3, 3], T[..., 3, 3] = numbers[..., :3], 1.0
    return T


def pose_vector(T: ArrayLike) -> Floats:
    """Return the six numbers of a pose, the opposite of `pose`.

    Args:
        T: Homogeneous transforms, shape (4, 4) or (..., 4, 4).

    Returns:
        `[x, y, z, rx, ry, rz]` [m, rad], shape (6,) or (..., 6); the rotation vector is at most pi long.

    Raises:
        InputError: Not a rigid motion.

    Examples:
        >>> from kinreach.kinematics import pose, pose_vector
        >>> pose_vector(pose([0.4, 0, 0.2, 0, 0, 1.5])).round(6).tolist()
        [0.4, 0.0, 0.2, 0.0, 0.0, 1.5]
    """
    T = as_floats("T", T)
    if T.shape[-2:] != (4, 4):
        raise InputError(f"T must have shape (..., 4, 4), got {T.shape}")
    check_poses("T", T.reshape(-1, 4, 4))
    return np.concatenate([T[..., :3, 3], vectors_of(T[..., :3, :3])], axis=-1)


def quick_pose_vector(T: Floats) -> list[float]:
    """Return the six numbers of one pose (4, 4), as `pose_vector` does, in a seventieth of its time, without checks.

    A controller asks for several in each of 500 cycles a second.
    """
    (a, b, c, x), (d, e, f, y), (g, h, i, z), _ = T.tolist()
    if (trace := a + e + i) > max(a, e, i):  # a quaternion by its largest entry
        quaternion = (1.0 + trace, h - f, c - g, d - b)
    elif a >= max(e, i):
        quaternion = (h - f, 1.0 + a - e - i, b + d, c + g)
    elif e >= i:
        quaternion = (c - g, b + d, 1.0 - a + e - i, f + h)
    else:
        quaternion = (d - b, c + g, f + h, 1.0 - a - e + i)
    w, *axis = quaternion if quaternion[0] >= 0.0 else (-entry for entry in quaternion)
    sine = math.hypot(*axis)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 0.0
    return [x, y, z, *(scale * entry for entry in axis)]


def pose_error(T_wanted: Floats, T: Floats) -> tuple[float, float]:
    """Return the distance [m] and the angle [rad] between two poses, shape (4, 4)."""
    position = math.dist(T_wanted[:3, 3].tolist(), T[:3, 3].tolist())
    return position, rotation_angle(T[:3, :3], T_wanted[:3, :3])


def rotation_angle(R_a: Floats, R_b: Floats) -> float:
    """Return the angle [rad] of the rotation from `R_a` to `R_b`, exact also where it is tiny."""
    (_, b, c), (d, _, f), (g, h, _) = rows = (R_a.T @ R_b).tolist()
    sine = math.hypot(h - f, c - g, d - b)
    return math.atan2(sine, rows[0][0] + rows[1][1] + rows[2][2] - 1.0)


def listed_pose(T: Floats) -> str:
    """Return the six numbers of a pose (4, 4) as flags take them, to 1e-7 m and rad."""
    return ",".join(f"{number:.6g}" for number in pose_vector(T).round(7) + 0.0)


def as_frame(name: str, value: ArrayLike) -> Floats:
    """Return a frame that a user gives as a 4x4 transform or as six numbers of `pose`; shape (4, 4)."""
    given = as_floats(name, value)
    check_entries(name, given, MAX_DISTANCE)
    if given.shape == (6,):
        T = pose(given)
    elif given.shape == (4, 4):
        T = as_pose(name, given)
    else:
        raise InputError(f"{name} must be a 4x4 transform or [x, y, z, rx, ry, rz], got shape {given.shape}")
    farthest = float(np.abs(T[:3, 3]).max())
    if farthest > MAX_TOOL:
        raise InputError(f"{name} must be within {MAX_TOOL:g} m, got {farthest:g}; lengths are metres, not millimetres")
    return T

"""Rotations as URDF writes them: roll, pitch and yaw, or an axis and an angle."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from kinreach.checks import Floats


def rotation(rpy: Sequence[float]) -> Floats:
    """Return Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3)."""
    x, y, z = (turn(axis, angle) for axis, angle in zip(np.eye(3), rpy, strict=True))
    return z @ y @ x


def turn(axis: Floats, angle: float) -> Floats:
    """Return the rotation about a unit axis by Rodrigues' formula, shape (3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K


def rpy(R: Floats) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation; yaw is 0 where the pitch is a right angle.

    Roll is what is left of the rotation without yaw, so that the three make it up also near that pitch.
    """
    across = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if across > 1e-12 else 0.0
    s, c = math.sin(yaw), math.cos(yaw)
    return math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1]), math.atan2(-R[2, 0], across), yaw


def pose(xyz: Sequence[float], angles: Sequence[float]) -> Floats:
    """Return the transform of a translation [m] after a rotation by roll, pitch and yaw [rad], shape (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = rotation(angles)
    T[:3, 3] = xyz
    return T

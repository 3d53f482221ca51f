"""Forward kinematics of many postures at once, for any serial arm, in numpy.

The chain is brought to a form in which every joint turns about its own z axis, so that a joint only mixes two
columns of the running rotation. Coordinates are kept as separate arrays (structure of arrays) and worked on in
blocks that stay in the cache; constants that are 0 or 1 cost nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kinreach.kinematics.goals import Floats

BLOCK = 2048
Columns = list[list[Floats | float]]


class SerialChain:
    """Serial chain of revolute joints, `T = A0 Rz(q0) A1 Rz(q1) ... An`.

    Args:
        placements: Pose of each joint's frame in its parent joint's frame, n arrays (4, 4).
        axes: Unit axis of each joint in its own frame, n arrays (3,).
        tip: Pose of the tip in the last joint's frame (4, 4).
    """

    def __init__(self, placements: Sequence[Floats], axes: Sequence[Floats], tip: Floats) -> None:
        self.constants: list[Floats] = []
        before = np.eye(4)
        for placement, axis in zip(placements, axes, strict=True):
            align = np.eye(4)
            align[:3, :3] = _rotation_to(axis)
            self.constants.append(before @ placement @ align)
            before = align.T
        self.constants.append(before @ tip)

    def fk(self, q: Floats) -> Floats:
        """Poses of the tip in the base frame, shape (m, 4, 4), for postures `q` [rad], shape (m, n)."""
        T = np.empty((len(q), 4, 4))
        for start in range(0, len(q), BLOCK):
            block = slice(start, start + BLOCK)
            columns = self._block(np.ascontiguousarray(q[block].T))
            for j, column in enumerate(columns):
                for i, value in enumerate(column):
                    T[block, i, j] = value
        T[:, 3] = (0.0, 0.0, 0.0, 1.0)
        return T

    def _block(self, q: Floats) -> Columns:
        columns: Columns = [list(self.constants[0][:3, j]) for j in range(4)]
        for angle, constant in zip(q, self.constants[1:], strict=True):
            c, s = np.cos(angle), np.sin(angle)
            x, y, z, p = columns
            turned: Columns = [
                [xi * c + yi * s for xi, yi in zip(x, y, strict=True)],
                [yi * c - xi * s for xi, yi in zip(x, y, strict=True)],
                z,
            ]
            columns = [_combine(turned, constant[:3, j], None) for j in range(3)]
            columns.append(_combine(turned, constant[:3, 3], p))
        return columns


def _combine(basis: Columns, weights: Floats, offset: list[Floats | float] | None) -> list[Floats | float]:
    """The sum of three vectors with constant weights, leaving out what is zero."""
    total = offset
    for vector, weight in zip(basis, weights, strict=True):
        if abs(weight) < 1e-15:
            continue
        scaled = vector if weight == 1.0 else [weight * v for v in vector]
        total = scaled if total is None else [a + b for a, b in zip(total, scaled, strict=True)]
    return [0.0, 0.0, 0.0] if total is None else total


def _rotation_to(axis: Floats) -> Floats:
    """A rotation whose third column is the given unit axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])

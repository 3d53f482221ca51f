"""Forward kinematics of many postures at once, for any serial arm, in numpy.

The chain is brought to a form in which every joint turns about its own z axis, so that a joint only mixes two axes of
the running frame, and neighbours with parallel axes turn by the sum of their angles. It is a formula, which
`straight_line` brings to as few numpy calls as possible; they run on blocks that stay in the cache.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from kinreach.checks import Floats
from kinreach.kinematics.straight_line import Entry, Program, Symbol, apply

BLOCK = 4096

#: What is nearer to 0, 1 or -1 is taken for it: URDFs write pi/2 with twelve digits, which leaves 5e-12 where a zero is
#: meant. The tip of an arm of one metre is off by 1e-11 m.
SNAP = 1e-11

Vector = Sequence[Entry]


class Frame(NamedTuple):
    """Axes and origin of a frame in the base frame, each as three coordinates [m]."""

    x: Vector
    y: Vector
    z: Vector
    p: Vector

    def direction(self, weights: Vector) -> Vector:
        """A vector that is given in this frame, in the base frame."""
        u, v, w = weights
        return [u * x + v * y + w * z for x, y, z in zip(self.x, self.y, self.z, strict=True)]

    def point(self, offset: Vector) -> Vector:
        """A point that is given in this frame [m], in the base frame."""
        return [p + along for p, along in zip(self.p, self.direction(offset), strict=True)]

    def moved(self, T: Floats) -> Frame:
        """The frame whose pose in this one is `T`, shape (4, 4)."""
        x, y, z, p = T[:3].T.tolist()
        return Frame(self.direction(x), self.direction(y), self.direction(z), self.point(p))

    def turned(self, c: Entry, s: Entry) -> Frame:
        """The frame after a turn about z by the angle with this cosine and sine."""
        pairs = list(zip(self.x, self.y, strict=True))
        return Frame([c * x + s * y for x, y in pairs], [c * y + -s * x for x, y in pairs], self.z, self.p)


class SerialChain:
    """Serial chain of revolute joints, `T = A0 Rz(q0) A1 Rz(q1) ... An`.

    Args:
        placements: Pose of each joint's frame in its parent joint's frame, n arrays (4, 4).
        axes: Unit axis of each joint in its own frame, n arrays (3,).
        tip: Pose of the tip in the last joint's frame (4, 4).

    Attributes:
        joints: Number of joints.
    """

    def __init__(self, placements: Sequence[Floats], axes: Sequence[Floats], tip: Floats) -> None:
        self._constants: list[Floats] = []
        self._joints: list[Floats] = []
        before = np.eye(4)
        for placement, axis in zip(placements, axes, strict=True):
            align = np.eye(4)
            align[:3, :3] = _rotation_to(axis)
            self._constants.append(_snapped(before @ placement @ align))
            before = align.T
            self._joints.append(before)
        self._tip = _snapped(before @ tip)
        self.joints = len(self._joints)

    def fk(self, q: Floats) -> Floats:
        """Poses of the tip in the base frame, shape (m, 4, 4), for postures `q` [rad], shape (m, n)."""
        T = np.empty((len(q), 4, 4))
        for block in blocks(len(q)):
            entries = self._pose(np.ascontiguousarray(q[block].T))
            for index, value in enumerate(entries):
                T[block, index % 3, index // 3] = value
        T[:, 3] = (0.0, 0.0, 0.0, 1.0)
        return T

    def positions(self, q: Floats) -> Floats:
        """Positions of the tip in the base frame [m], shape (m, 3), for postures `q` [rad], shape (m, n).

        They equal those in `fk`, and take a third of the time.
        """
        p = np.empty((3, len(q)))
        for block in blocks(len(q)):
            for i, value in enumerate(self._position(np.ascontiguousarray(q[block].T))):
                p[i, block] = value
        return p.T

    def frames(self, q: Vector, *, single: bool = False) -> list[Frame]:
        """The joints' own frames in the base frame, as a formula of the angles `q` [rad], n symbols.

        Args:
            q: The angles.
            single: The inputs will be single precision, for which numpy has a fast sine.
        """
        return [frame.moved(joint) for frame, joint in zip(self._turned(q, single), self._joints, strict=True)]

    @cached_property
    def _pose(self) -> Program:
        def formula(q: Sequence[Symbol]) -> Vector:
            x, y, z, p = self._turned(q)[-1].moved(self._tip)
            return [*x, *y, *z, *p]

        return Program(formula, self.joints)

    @cached_property
    def _position(self) -> Program:
        return Program(lambda q: self._turned(q)[-1].moved(self._tip).p, self.joints)

    def _turned(self, q: Vector, single: bool = False) -> list[Frame]:
        """The frames in which the joints turn about z, each after its turn."""
        frame = Frame((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        root, total = frame, q[0]
        frames = []
        for index, (angle, constant) in enumerate(zip(q, self._constants, strict=True)):
            if index > 0 and constant[2, 2] == 1.0:  # parallel to the joint before: the same axes turn further
                total = total + angle + float(np.arctan2(constant[1, 0], constant[0, 0]))
                root = root._replace(p=frame.point(constant[:3, 3].tolist()))
            else:
                root, total = frame.moved(constant), angle
            c, s = (apply(np.cos, total), apply(np.sin, total)) if single else _cos_sin(total)
            frame = root.turned(c, s)
            frames.append(frame)
        return frames


def blocks(count: int) -> Iterator[slice]:
    """Slices of at most BLOCK rows that make up `count` rows: few enough that their numbers stay in the cache."""
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))


def _cos_sin(angle: Entry) -> tuple[Entry, Entry]:
    """Cosine and sine of an angle [rad] in double precision.

    numpy has a fast tangent in double precision (where the processor has AVX-512), but no fast sine: both from the
    tangent of half the angle, to 3e-16, take a third of the time.
    """
    t = apply(np.tan, 0.5 * angle)
    t2 = t * t
    scale = 1.0 / (1.0 + t2)
    return (1.0 - t2) * scale, (t + t) * scale


def _snapped(T: Floats) -> Floats:
    whole = np.rint(T)
    return np.where(np.abs(T - whole) < SNAP, whole, T)


def _rotation_to(axis: Floats) -> Floats:
    """A rotation whose third column is the given unit axis."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])

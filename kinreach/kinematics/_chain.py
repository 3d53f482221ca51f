"""Forward kinematics of many postures at once, for any serial arm, in numpy or on tensors of torch.

The chain is brought to a form in which every joint turns about its own z axis, so that a joint only mixes two axes of
the running frame, and neighbours with parallel axes turn by the sum of their angles. Frames are kept as coordinates,
one array for all postures each; a coordinate that is the same number for all stays a float, and sums and products with
0, 1 and -1 are left out: half of a UR5's are. Arrays are blocks that stay in the cache; tensors are taken whole, and
autograd goes through.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinreach._checks import Floats, is_tensor, torch_module
from kinreach._rotations import rotation_to, turns_about_z
from kinreach._tensors import blocks

#: Entries nearer to 0, 1 or -1 become those: URDFs write pi/2 with twelve digits, which leaves 5e-12 instead of zero.
#: The tip of an arm of one metre is off by 1e-11 m.
SNAP = 1e-11
#: By how much the product of a rotation and its transpose may be off.
ORTHONORMAL = 1e-15

#: Turns about an axis goal's direction that are tried [rad].
TURNS = np.linspace(-np.pi, np.pi, 120, endpoint=False)

#: One number for each posture, an array of shape (m,) or a tensor, or one number for all, a float.
Entry = Any
Vector = Sequence[Entry]


def times(a: Entry, b: Entry) -> Entry:
    """Multiply; nothing is computed where a factor is 0, 1 or -1 for all postures."""
    if isinstance(b, float):
        a, b = b, a
    if isinstance(a, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
        if a == -1.0:
            return -b
    return a * b


def plus(a: Entry, b: Entry) -> Entry:
    """Add; nothing is computed where a summand is 0 for all postures."""
    if isinstance(a, float) and a == 0.0:
        return b
    return a if isinstance(b, float) and b == 0.0 else a + b


def minus(a: Entry, b: Entry) -> Entry:
    """Subtract; nothing is computed where the second is 0 for all postures."""
    if isinstance(a, float) and a == 0.0:
        return -b
    return a if isinstance(b, float) and b == 0.0 else a - b


def cross(a: Vector, b: Vector) -> list[Entry]:
    return [minus(times(a[i - 2], b[i - 1]), times(a[i - 1], b[i - 2])) for i in range(3)]


class Frame(NamedTuple):
    """Axes and origin of a frame in the base frame, each as three coordinates [m]."""

    x: Vector
    y: Vector
    z: Vector
    p: Vector

    def direction(self, weights: Sequence[float]) -> Vector:
        """Express a vector of this frame in the base frame."""
        u, v, w = weights
        return [
            plus(plus(times(u, x), times(v, y)), times(w, z)) for x, y, z in zip(self.x, self.y, self.z, strict=True)
        ]

    def point(self, offset: Sequence[float]) -> Vector:
        """Express a point of this frame [m] in the base frame."""
        return [plus(p, along) for p, along in zip(self.p, self.direction(offset), strict=True)]

    def moved(self, T: Floats) -> Frame:
        """Return the frame whose pose in this one is `T`, shape (4, 4)."""
        x, y, z, p = T[:3].T.tolist()
        return Frame(self.direction(x), self.direction(y), self.direction(z), self.point(p))

    def turned(self, c: Entry, s: Entry) -> Frame:
        """Return the frame after a turn about z by the angle with this cosine and sine."""
        pairs = list(zip(self.x, self.y, strict=True))
        x = [plus(times(c, x), times(s, y)) for x, y in pairs]
        y = [minus(times(c, y), times(s, x)) for x, y in pairs]
        return Frame(x, y, self.z, self.p)


class Moves(NamedTuple):
    """How one joint of a chain moves.

    Attributes:
        entry: Entry of `q` that it follows.
        factor: By how much, 1 for a joint that is one of `q`.
        offset: Where it is when that is 0 [rad, m].
        slides: Whether it slides along its axis; if not, it turns about it.
    """

    entry: int
    factor: float = 1.0
    offset: float = 0.0
    slides: bool = False


class SerialChain:
    """Serial chain, `T = A0 Rz(q0) A1 Rz(q1) ... An`, or with joints that slide along z, or that follow others.

    Args:
        placements: Pose of each joint's frame in its parent joint's frame, m arrays (4, 4).
        axes: Unit axis of each joint in its own frame, m arrays (3,).
        tip: Pose of the tip in the last joint's frame (4, 4).
        moves: How each joint moves; default is that all turn by their own entry of `q`.
    """

    def __init__(
        self,
        placements: Sequence[Floats],
        axes: Sequence[Floats],
        tip: Floats,
        moves: Sequence[Moves] | None = None,
    ) -> None:
        *self._constants, self._tip = map(_snapped, about_z(placements, axes, tip))
        self._moves = [Moves(joint) for joint in range(len(axes))] if moves is None else moves
        self.joints = 1 + max(each.entry for each in self._moves)

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Which joints slide, shape (m,)."""
        return np.array([each.slides for each in self._moves])

    @property
    def placements(self) -> Floats:
        """A0 to An of the same chain with joints that turn about their own z axis, shape (n + 1, 4, 4)."""
        return np.array([*self._constants, self._tip])

    def fk(self, q: Any) -> Any:
        """Compute poses of the tip in the base frame, (m, 4, 4), for postures [rad], (m, n) or a tensor (..., n)."""
        return _evaluated(self._pose, q, 4, 4)

    def jacobian(self, q: Any) -> Any:
        """Compute geometric Jacobians of the tip along the base's axes, (m, 6, n), linear rows first; q as in `fk`."""
        return _evaluated(self._jacobian, q, 6, self.joints)

    def positions(self, q: Floats) -> Floats:
        """Compute the positions in `fk` [m], shape (m, 3), in three quarters of its time for many postures."""
        p = np.empty((3, len(q)))
        for block in blocks(len(q)):
            angles: list[Entry] = [*np.ascontiguousarray(q[block].T)]
            last = self._moves[-1]
            if not (self._tip[:2, 3].any() or last.slides or any(m.entry == last.entry for m in self._moves[:-1])):
                angles[last.entry] = 0.0  # the last joint does not move a tip on its axis
            for row, value in enumerate(self._last(angles).point(self._tip[:3, 3].tolist())):
                p[row, block] = value
        return p.T

    def _pose(self, q: Vector) -> Sequence[Vector]:
        frame = self._last(q).moved(self._tip)
        return [*zip(*frame, strict=True), (0.0, 0.0, 0.0, 1.0)]

    def _jacobian(self, q: Vector) -> Sequence[Vector]:
        """Rows of the Jacobian: joint i moves the tip along z_i x (p_tip - p_i) and turns it about z_i.

        One that slides moves it along z_i. Joints that follow one entry of `q` share its column.
        """
        frames = list(self._turned(q))
        tip = frames[-1].point(self._tip[:3, 3].tolist())
        columns: list[Vector] = [(0.0,) * 6] * self.joints
        for frame, moves in zip(frames, self._moves, strict=True):
            arm = [minus(a, b) for a, b in zip(tip, frame.p, strict=True)]
            column = (*frame.z, 0.0, 0.0, 0.0) if moves.slides else (*cross(frame.z, arm), *frame.z)
            before = columns[moves.entry]
            columns[moves.entry] = [plus(a, times(moves.factor, b)) for a, b in zip(before, column, strict=True)]
        return list(zip(*columns, strict=True))

    def _last(self, q: Vector) -> Frame:
        # each frame is made from the one before, which is then let go: few arrays stay in the cache
        return deque(self._turned(q), maxlen=1)[0]

    def _turned(self, q: Vector) -> Iterator[Frame]:
        """The frames in which the joints turn about z, or slide along it, each after its move."""
        frame = Frame((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        root, total = frame, q[0]
        cos_sin = _of_tensors if is_tensor(total) else _of_arrays
        for index, (moves, constant) in enumerate(zip(self._moves, self._constants, strict=True)):
            angle = plus(times(moves.factor, q[moves.entry]), moves.offset)
            if moves.slides:
                frame = frame.moved(constant)
                slid = [plus(p, times(angle, z)) for p, z in zip(frame.p, frame.z, strict=True)]
                root, total, frame = frame, 0.0, frame._replace(p=slid)
                yield frame
                continue
            if (
                index > 0 and constant[2, 2] == 1.0 and not constant[:2, 2].any()
            ):  # parallel to the joint before: the same axes turn further
                total = plus(plus(total, angle), float(np.arctan2(constant[1, 0], constant[0, 0])))
                root = root._replace(p=frame.point(constant[:3, 3].tolist()))
            else:
                root, total = frame.moved(constant), angle
            c, s = cos_sin(total)
            frame = root.turned(c, s)
            yield frame


def _evaluated(entries: Callable[[Vector], Sequence[Vector]], q: Any, rows: int, columns: int) -> Any:
    """Fill matrices (m, rows, columns) with the entries that a function computes from postures q (m, n)."""
    if is_tensor(q):
        stack = torch_module().stack
        whole = [[e if is_tensor(e) else q.new_full(q.shape[:-1], e) for e in row] for row in entries(q.unbind(-1))]
        return stack([stack(row, -1) for row in whole], -2)
    found = np.empty((len(q), rows, columns))
    for block in blocks(len(q)):
        for row, values in enumerate(entries([*np.ascontiguousarray(q[block].T)])):
            for column, value in enumerate(values):
                found[block, row, column] = value
    return found


def _of_tensors(angle: Entry) -> tuple[Entry, Entry]:
    """Cosine and sine of an angle [rad]."""
    return angle.cos(), angle.sin()


def _of_arrays(angle: Entry) -> tuple[Entry, Entry]:
    """Cosine and sine of an angle [rad].

    numpy has a fast tangent in double precision (where the processor has AVX-512), but no fast sine: both from the
    tangent of half the angle, to 3e-16, take a third of the time.
    """
    if isinstance(angle, float):
        return float(np.cos(angle)), float(np.sin(angle))
    t = np.tan(0.5 * angle)
    t2 = t * t
    scale = 1.0 / (1.0 + t2)
    return (1.0 - t2) * scale, (t + t) * scale


def about_z(placements: Sequence[Floats], axes: Sequence[Floats], tip: Floats) -> Floats:
    """Convert the chain of `SerialChain` to one whose joints turn about z, `A0 Rz(q0) A1 ... An`: (n + 1, 4, 4)."""
    before, found = np.eye(4), []
    for placement, axis in zip(placements, axes, strict=True):
        align = np.eye(4)
        align[:3, :3] = rotation_to(axis)
        found.append(before @ placement @ align)
        before = align.T
    return np.array([*found, before @ tip])


def _snapped(T: Floats) -> Floats:
    """Round entries that almost are whole numbers, unless the rotation would not be one any more."""
    whole = np.rint(T)
    snapped = np.where(np.abs(T - whole) < SNAP, whole, T)
    R = snapped[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > ORTHONORMAL:
        snapped[:3, :3] = T[:3, :3]
    return snapped


def turns_and_own(turns: Floats, axis: Floats, T: Floats) -> Floats:
    """Return turns [rad] of `poses_about`, and last the one that comes nearest to the orientation of a pose."""
    R = rotation_to(axis).T @ T[:3, :3]
    return np.append(turns, np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))


def poses_about(position: Floats, axis: Floats, turns: Floats) -> Floats:
    """Return poses at a point with the z axis along a direction, one for each turn about it [rad], shape (m, 4, 4)."""
    T = turns_about_z(turns)
    T[:, :3, :3] = rotation_to(axis) @ T[:, :3, :3]
    T[:, :3, 3] = position
    return T

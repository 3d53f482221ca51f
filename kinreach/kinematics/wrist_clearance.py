"""Whether wrist and gripper touch the work cell, the base or the shoulder, for many postures at once.

Two steps. First a short program over all postures: exactly how low the finger tips are, and whether anything else may
be below the table top or near the arm's foot. That decides most postures, and the common contact, finger tips on the
table, exactly. In the rest every body near a box is tested against it by separating axes.

Everything is first computed where q0 is 0, for the first joint only turns the arm about the vertical.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from kinreach.kinematics.box_overlap import overlap
from kinreach.kinematics.chain import Frame, SerialChain
from kinreach.kinematics.rounded_boxes import RoundedBox, enclosing
from kinreach.kinematics.straight_line import Entry, Program, Symbol, all_of, any_of, apply

Flags = NDArray[np.bool_]
Single = NDArray[np.float32]


class WristClearance:
    """Wrist and gripper against what stands still or turns with the first joint.

    Args:
        chain: The arm, in the world frame; its first axis is the world's z axis.
        bodies: Bodies of wrist and gripper; the fingers, equal and side by side, are the last two.
        table: What is in front of the arm; everything else is below its top or is part of the foot.
        foot: Obstacles under and around the base.
        ground: Obstacles that are lower than the table.
        base: Bodies of the base.
        shoulder: Bodies of the first link.
    """

    def __init__(
        self,
        chain: SerialChain,
        bodies: Sequence[RoundedBox],
        *,
        table: RoundedBox,
        ground: Sequence[RoundedBox],
        foot: Sequence[RoundedBox],
        base: Sequence[RoundedBox],
        shoulder: Sequence[RoundedBox],
    ) -> None:
        self._chain, self._bodies = chain, bodies
        self._table = table
        turning = [_where_q0_is_0(chain, body) for body in shoulder]
        self._foot = enclosing([*foot, *base, *map(_swept, turning)])
        self._floor = max(box.top for box in ground)
        self._joints = sorted({body.joint for body in bodies})
        self._level = np.array([self._joints.index(body.joint) for body in bodies])
        self._centre = np.array([body.centre for body in bodies], dtype=np.float32).T
        self._half = np.array([body.half for body in bodies], dtype=np.float32).T
        self._radius = np.array([body.radius for body in bodies], dtype=np.float32)
        boxes = [table, *ground, *foot, *base, *turning]
        self._box_centre = np.array([box.centre for box in boxes], dtype=np.float32).T
        self._box_half = np.array([box.half + box.radius for box in boxes], dtype=np.float32).T
        # how near centres are where a body and a box may touch: box, body, coordinate
        self._near = self._box_half.T[:, None] + np.array([[body.reach] for body in bodies], dtype=np.float32)
        links = len(base) + len(turning)
        self._is_link = np.arange(len(boxes)) >= len(boxes) - links
        self._turns = (np.arange(len(boxes)) >= len(boxes) - len(turning)).astype(np.intp)
        self._screen = Program(self._screened, chain.joints)
        self._poses = Program(self._posed, chain.joints)

    def touches(self, q: Single) -> tuple[Flags, Flags]:
        """Which postures touch the work cell, and which the base or the shoulder.

        Args:
            q: Postures [rad], shape (6, m).
        """
        on_table, unclear = self._screen(q)
        on_arm = np.zeros(q.shape[1], dtype=np.bool_)
        rows = np.flatnonzero(unclear)
        if len(rows):
            on_table[rows], on_arm[rows] = self._examined(q.take(rows, axis=1))
        return on_table, on_arm

    def _screened(self, q: Sequence[Symbol]) -> list[Entry]:
        """Whether the gripper is in the table for certain; whether that, or something else, has to be looked at."""
        frames = self._chain.frames([0.0, *q[1:]], single=True)
        c, s = apply(np.cos, q[0]), apply(np.sin, q[0])
        table = self._table
        hand = [body for body in self._bodies if body.joint == self._joints[-1]]
        frame, tips = frames[self._joints[-1]], enclosing(hand[-2:])
        low: list[Entry] = []
        near = []
        for joint in self._joints:
            centre, radius = _ball([body for body in self._bodies if body.joint == joint])
            x, y, z = frames[joint].point(centre)
            x, y = c * x + -s * y, s * x + c * y
            if joint == hand[0].joint:
                low.append(apply(np.minimum, _bottom(frame, tips), _bottom(frame, enclosing(hand[:-2]))))
            else:
                low.append(z - radius)
            near.append(all_of([apply(np.less, z, self._foot.top + radius), *_above(self._foot, x, y, radius)]))
            near.append(all_of([apply(np.less, low[-1], table.top), *_above(table, x, y, radius)]))
        near.append(apply(np.less, reduce(lambda a, b: apply(np.minimum, a, b), low), self._floor))
        # x, y, z: the centre of the hand. From there to the ends of the fingers it is in one piece.
        end = _end(tips)
        below = apply(np.less, _bottom(frame, end), table.top)
        inside = [below, apply(np.greater, z, table.bottom), *_above(table, x, y, -end.reach)]
        x, y, z = frame.point(end.centre.tolist())
        inside += _above(table, c * x + -s * y, s * x + c * y, -end.reach)
        on_table = all_of(inside)
        return [on_table, apply(np.greater, any_of(near), on_table)]

    def _posed(self, q: Sequence[Symbol]) -> list[Entry]:
        frames = self._chain.frames([0.0, *q[1:]], single=True)
        return [entry for joint in self._joints for vector in frames[joint] for entry in vector]

    def _examined(self, q: Single) -> tuple[Flags, Flags]:
        """The same as `touches`, by separating axes."""
        count, bodies = q.shape[1], len(self._bodies)
        # in the world, and where q0 is 0; joint; three axes and the origin; coordinate; posture
        frames = np.empty((2, len(self._joints), 4, 3, count), dtype=np.float32)
        turned, still = frames
        for place, entry in zip(still.reshape(-1, count), self._poses(q), strict=True):
            place[:] = entry
        c, s = np.cos(q[0]), np.sin(q[0])
        turned[:, :, 0] = c * still[:, :, 0] - s * still[:, :, 1]
        turned[:, :, 1] = s * still[:, :, 0] + c * still[:, :, 1]
        turned[:, :, 2] = still[:, :, 2]
        own = frames[:, self._level]  # body instead of joint
        centre = own[:, :, 3].copy()
        for axis in range(3):
            centre += own[:, :, axis] * self._centre[axis, :, None, None]
        gap = centre[self._turns] - self._box_centre.T[:, None, :, None]
        near = (np.abs(gap, out=gap) < self._near[..., None]).all(axis=2)
        box, body, row = np.nonzero(near)
        which = self._turns[box] * bodies + body
        axes = own.ravel().take(_gather(12 * which, count, row, 9)).reshape(3, 3, -1)
        offset = centre.ravel().take(_gather(3 * which, count, row, 3)) - self._box_centre[:, box]
        met = overlap(axes, self._half[:, body], self._radius[body], offset, self._box_half[:, box])
        found = np.zeros((2, count), dtype=np.bool_)
        found[self._is_link[box[met]].astype(np.intp), row[met]] = True
        return found[0], found[1]


def _gather(first: NDArray[np.intp], count: int, row: NDArray[np.intp], entries: int) -> NDArray[np.intp]:
    """Where the entries that begin at `first` are in an array whose last dimension, of length `count`, is `row`."""
    return first * count + row + count * np.arange(entries)[:, None]


def _where_q0_is_0(chain: SerialChain, body: RoundedBox) -> RoundedBox:
    """A body of the first link, in the world."""
    frame = chain.frames([0.0] * chain.joints)[0]
    R, centre = np.array(frame[:3], dtype=np.float64).T, np.array(frame.point(body.centre.tolist()), dtype=np.float64)
    return RoundedBox(body.name, -1, centre, np.abs(R) @ body.half, body.radius)


def _ball(bodies: Sequence[RoundedBox]) -> tuple[list[float], float]:
    """Centre [m], with as few coordinates as possible, and radius [m] of a ball around bodies of one joint."""
    centre = enclosing(bodies).centre
    centre = np.where(np.abs(centre) < 0.1 * np.abs(centre).max(), 0.0, centre)
    return centre.tolist(), max(float(np.linalg.norm(body.centre - centre)) + body.reach for body in bodies)


def _swept(body: RoundedBox) -> RoundedBox:
    """A box around everything that a body reaches when it turns about the vertical."""
    across = float(np.linalg.norm(np.abs(body.centre[:2]) + body.half[:2])) + body.radius
    half = np.array([across, across, body.half[2] + body.radius])
    return RoundedBox(body.name, body.joint, body.centre * (0.0, 0.0, 1.0), half, 0.0)


def _end(box: RoundedBox) -> RoundedBox:
    """The face of a box that is farthest from its joint."""
    axis = int(np.argmax(np.abs(box.centre)))
    face, half = box.centre.copy(), box.half.copy()
    face[axis] += np.copysign(half[axis], face[axis])
    half[axis] = 0.0
    return RoundedBox(box.name, box.joint, face, half, 0.0)


def _bottom(frame: Frame, box: RoundedBox) -> Entry:
    """Height of the lowest point of a box with sharp edges [m]."""
    z = frame.point(box.centre.tolist())[2]
    for axis, half in zip(frame[:3], box.half.tolist(), strict=True):
        z = z - apply(np.absolute, axis[2]) * half
    return z


def _above(box: RoundedBox, x: Entry, y: Entry, slack: float) -> list[Entry]:
    """Whether a point is over a box that is wider by `slack` [m]."""
    return [
        apply(np.less, apply(np.absolute, value - float(box.centre[axis])), float(box.half[axis] + slack))
        for axis, value in enumerate((x, y))
    ]

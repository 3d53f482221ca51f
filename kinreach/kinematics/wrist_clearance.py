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
        self._centre = np.array([body.centre for body in bodies], dtype=np.float32)
        boxes = [table, *ground, *foot, *base, *turning]
        self._fixed, self._obstacles = len(boxes) - len(turning), len(boxes) - len(turning) - len(base)
        self._turns = (np.arange(len(boxes)) >= self._fixed).astype(np.intp)
        self._box_centre = np.array([box.centre for box in boxes], dtype=np.float32)[:, None, :, None]
        # how near centres are where a body and a box may touch: box, body, coordinate
        reach = [[box.half + box.radius + body.reach for body in bodies] for box in boxes]
        self._reach = np.array(reach, dtype=np.float32)[..., None]
        # all there is to know of a body and a box, in a column for each pair
        pairs = [
            [*body.half, body.radius, *body.centre, *(box.half + box.radius), *box.centre]
            for box in boxes
            for body in bodies
        ]
        self._pairs = np.array(pairs, dtype=np.float32).T.copy()
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
            boxes = (self._foot, table)
            near += [all_of([apply(np.less, low[-1], box.top), *_above(box, x, y, radius)]) for box in boxes]
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
        count = q.shape[1]
        # where q0 is 0: joint; three axes and the origin; coordinate; posture
        frames = np.empty((len(self._joints), 4, 3, count), dtype=np.float32)
        for place, entry in zip(frames.reshape(-1, count), self._poses(q), strict=True):
            place[:] = entry
        pair, row = np.divmod(np.flatnonzero(self._near(frames, q[0])), count)
        box, body = np.divmod(pair, len(self._bodies))
        entries = 12 * count * self._level[body] + row + count * np.arange(12)[:, None]
        frame = frames.ravel().take(entries).reshape(4, 3, -1)
        _turn(frame, np.where(box < self._fixed, q[0].take(row), np.float32(0.0)))
        half, radius, centre, box_half, box_centre = np.split(self._pairs.take(pair, axis=1), (3, 4, 7, 10))
        axes, origin = frame[:3], frame[3]
        offset = origin + (axes * centre[:, None]).sum(axis=0) - box_centre
        met = np.flatnonzero(overlap(axes, half, radius[0], offset, box_half))
        found = np.zeros((2, count), dtype=np.bool_)
        found[(box[met] >= self._obstacles).astype(np.intp), row[met]] = True
        return found[0], found[1]

    def _near(self, frames: Single, q0: Single) -> Flags:
        """Where a body is so near to a box that they may touch, shape (boxes, bodies, m)."""
        own = frames[self._level]
        centres = np.empty((2, *own[:, 3].shape), dtype=np.float32)  # in the world, and where q0 is 0
        turned, still = centres
        still[:] = own[:, 3]
        for axis in range(3):
            still += own[:, axis] * self._centre[:, axis, None, None]
        turned[:] = still
        _turn(turned, q0)
        gap = centres[self._turns]
        gap -= self._box_centre
        x, y, z = (np.abs(gap, out=gap) < self._reach).transpose(2, 0, 1, 3)
        near: Flags = x & y & z
        return near


def _turn(vectors: Single, angle: Single) -> None:
    """Turn vectors about the vertical, in place: any number of them, shape (k, 3, m), by m angles [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[:, 0].copy(), vectors[:, 1]
    vectors[:, 0] = c * x - s * y
    vectors[:, 1] = s * x + c * y


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
